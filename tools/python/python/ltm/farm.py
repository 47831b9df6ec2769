"""One job on many machines: the ranges of a plan as tasks of a Dask cluster, then the merge.

>>> from distributed import Client
>>> from ltm import farm
>>> farm.render("room.plan.json", Client("tcp://head:8786"), out="room.ltc", shards="/shared/room")

``ltm plan`` makes the plan. Dask schedules; each task is one ``ltm build`` as a process of its own, so that a worker may be killed at any
instant: a range is in the depot whole or not at all. Workers need the program ``ltm`` (on their PATH, or where ``LTM`` says), the scene
and the depot in the same places, and Dask, but not this package. Whatever was lost or cancelled, the same call goes on.

``python -m ltm.farm scene.toml --local 4`` does all of it from a command line.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from distributed import Client, Future
    from distributed.deploy import Cluster

__all__ = ["FarmError", "Progress", "main", "render"]

#: Exit code of ``ltm merge --plan`` where ranges are missing.
MISSING = 8
#: Exit codes of ``ltm build`` that come back however often a range is tried: unusable arguments or input.
HOPELESS = (2, 3)

log = logging.getLogger("ltm.farm")


class FarmError(Exception):
    """Ranges that could not be built, after all tries; the others are in the depot."""

    def __init__(self, message: str, poisoned: dict[str, str] | None = None):
        super().__init__(message)
        #: The last line of each range that failed.
        self.poisoned = poisoned or {}


class BuildError(Exception):
    """One try of one range failed."""

    def __init__(self, message: str, code: int = 1):
        super().__init__(message, code)
        self.code = code

    def __str__(self) -> str:
        return str(self.args[0])


def _program(program: str | None) -> str:
    # The wheel puts the programs where Python's own are, which need not be on the path.
    found = program or os.environ.get("LTM") or shutil.which("ltm") or shutil.which("ltm", path=sysconfig.get_path("scripts"))
    if not found:
        raise FileNotFoundError("the program ltm is not on the PATH; install it (cargo install --path tools/cli --features gpu,s3), or say where it is in LTM")
    return found


def _die_with_parent() -> None:
    """Has a child killed with the thread that started it: a worker that is killed leaves no process behind."""
    import ctypes
    import signal

    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def _build(plan: str, blocks: str, shards: str, options: dict[str, Any]) -> float:
    """The task: one range into one shard. Gives the seconds that it took."""
    import logging
    import subprocess
    import sys
    import time

    log = logging.getLogger("distributed.worker")
    words = [_program(options.get("program")), "--threads", str(options.get("threads", 1)), "build", "--plan", plan, "--blocks", blocks]
    words += ["--out", shards]
    memory = options.get("memory") or _memory_of_worker()
    words += ["--memory", str(int(memory))] if memory else []
    words += ["--check"] if options.get("check") else []
    begun = time.monotonic()
    preparation = _die_with_parent if sys.platform == "linux" else None
    done = subprocess.run(words, capture_output=True, text=True, errors="replace", stdin=subprocess.DEVNULL, preexec_fn=preparation)
    seconds = time.monotonic() - begun
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()] or ["it said nothing"]
        log.warning("blocks %s: exit code %s after %.1f s: %s", blocks, done.returncode, seconds, lines[-1])
        raise BuildError(f"blocks {blocks}: {lines[-1]}", done.returncode)
    log.info("blocks %s: %.1f s: %s", blocks, seconds, done.stdout.strip())
    return seconds


def _memory_of_worker() -> float | None:
    """Bytes that each task of this worker may take; none where the worker has no limit."""
    try:
        from distributed import get_worker

        worker = get_worker()
        limit = worker.memory_manager.memory_limit
        # The worker itself is a Python process.
        return max(limit - (256 << 20), limit // 2) / worker.state.nthreads if limit else None
    except (ImportError, ValueError, AttributeError):
        return None


class Progress:
    """Blocks done, their rate and the time left: one line on a terminal, nothing elsewhere."""

    def __init__(self, file: TextIO = sys.stderr):
        self.file = file
        self.begun = time.monotonic()
        self.before: int | None = None

    def __call__(self, done: int, total: int, retries: int) -> None:
        self.before = done if self.before is None else self.before
        if not self.file.isatty():
            return
        seconds = time.monotonic() - self.begun
        rate = (done - self.before) / seconds if seconds > 0 else 0.0
        left = f"{_clock((total - done) / rate)} left" if rate > 0 else "…"
        bar = "=" * (32 * done // max(total, 1))
        again = f", {retries} tries again" if retries else ""
        end = "\n" if done == total else ""
        print(f"\rbuilding [{bar:32}] {done}/{total} blocks, {rate:.1f} blocks/s, {left}{again}\x1b[K", end=end, file=self.file, flush=True)


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


def _length(blocks: str) -> int:
    first, end = blocks.split("..")
    return int(end) - int(first)


def render(
    plan: str | os.PathLike[str],
    client: Client | str | Callable[[], Client],
    out: str | os.PathLike[str],
    shards: str | os.PathLike[str] | None = None,
    *,
    program: str | None = None,
    retries: int = 3,
    threads: int = 1,
    memory: int | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int, int], None] | None = None,
    patience: float = 600.0,
) -> Path:
    """Builds the ranges of ``plan`` that its depot lacks on the workers of ``client``, and merges them into ``out``.

    ``client`` is a client of Dask, the address of a scheduler, or a function that gives a client; a scheduler that is gone is waited for
    ``patience`` seconds. ``shards`` is the depot, a folder that all workers see or ``s3://BUCKET/PREFIX``, by default a folder beside ``out``. A range that fails, or
    whose worker dies, is done again elsewhere, ``retries`` times; then the others are finished, and :class:`FarmError` names it. Each task
    gets ``threads`` threads, and ``memory`` bytes, by default its share of what its worker may take. Ctrl-C cancels what is not begun;
    the same call goes on. Returns ``out``.
    """
    plan, out = Path(plan).resolve(), Path(out).resolve()
    depot = str(shards) if shards is not None else f"{out}-shards"
    depot = depot if "://" in depot else str(Path(depot).resolve())
    ranges = [part["blocks"] for part in json.loads(plan.read_text())["ranges"]]
    options = {"threads": threads, "memory": memory, "program": program}
    merge = [_program(program), "merge", "--plan", str(plan), depot, "-o", str(out)] + (["--force"] if overwrite else [])
    if out.exists() and not overwrite:
        raise FileExistsError(f"{out} is there already")
    missing = _lines(subprocess.run([*merge, "--list"], stdout=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL), (0,))
    work = _Work(str(plan), depot, _Connection(client, patience), options, retries, progress or Progress())
    work.total = sum(map(_length, ranges))
    work.done = work.total - sum(map(_length, missing))
    for _ in range(retries + 1):
        work.build(missing)
        done = subprocess.run(merge, stdout=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL)
        if done.returncode != MISSING:
            _lines(done, (0,))
            return out
        # A shard that was there by its name and is not whole: read before it is trusted from now on.
        missing = _lines(done, (MISSING,))
        options["check"] = True
        work.done -= sum(map(_length, missing))
    raise FarmError(f"{len(missing)} ranges are damaged again and again in {depot}; check the disk", dict.fromkeys(missing, "damaged"))


def _lines(done: subprocess.CompletedProcess[str], expected: tuple[int, ...]) -> list[str]:
    if done.returncode not in expected:
        raise FarmError(f"ltm merge ended with exit code {done.returncode}; what it said stands above")
    return done.stdout.split()


class _Connection:
    """A client, made anew where its scheduler was lost."""

    def __init__(self, client: Client | str | Callable[[], Client], patience: float):
        self.patience = patience
        self.client: Client | None = None
        if isinstance(client, str):
            self.make = self._by_address(client)
        elif hasattr(client, "submit"):
            self.client = client  # type: ignore[assignment]
            self.make = self._by_address(client.scheduler.address)  # type: ignore[union-attr]
        else:
            self.make = client  # type: ignore[assignment]

    def _by_address(self, address: str) -> Callable[[], Client]:
        def make() -> Client:
            from distributed import Client

            return Client(address, timeout=min(self.patience, 10), set_as_default=False)

        return make

    def get(self) -> Client:
        """A client that is connected, waited for where it must be."""
        if self.client is not None and self.client.status == "running":
            return self.client
        end = time.monotonic() + self.patience
        while True:
            try:
                self.client = self.make()
                return self.client
            except OSError as error:
                if time.monotonic() > end:
                    raise FarmError(f"the scheduler did not come back within {self.patience:.0f} s; the same call goes on") from error
                time.sleep(1)

    def lose(self) -> None:
        client, self.client = self.client, None
        if client is not None:
            try:
                client.close(timeout=1)
            except (OSError, TimeoutError) as error:
                log.debug("closing a client without a scheduler: %s", error)


class _Work:
    """The ranges that are being built."""

    def __init__(self, plan: str, depot: str, connection: _Connection, options: dict[str, Any], retries: int, progress: Callable[[int, int, int], None]):
        self.plan, self.depot, self.connection, self.options = plan, depot, connection, options
        self.retries, self.progress = retries, progress
        self.done = self.total = self.again = 0

    def build(self, ranges: list[str]) -> None:
        """Builds all of them, or raises :class:`FarmError` with those that cannot be built when all others are."""
        left = dict.fromkeys(ranges, 0)
        poisoned: dict[str, str] = {}
        self.progress(self.done, self.total, self.again)
        while left:
            self._round(left, poisoned)
        if poisoned:
            lines = "; ".join(poisoned.values())
            raise FarmError(f"{len(poisoned)} of the ranges cannot be built, the others are done: {lines}", poisoned)

    def _round(self, left: dict[str, int], poisoned: dict[str, str]) -> None:
        """Submits what is left, and hears of it until all is done or the scheduler is gone."""
        from distributed import as_completed

        client = self.connection.get()
        submit = _submitter(client, (self.plan, self.depot, self.options))
        running = {submit(blocks): blocks for blocks in left}
        with client.as_current():
            results = as_completed(list(running))
        try:
            for future in results:
                blocks = running.pop(future)
                if future.status == "finished":
                    del left[blocks]
                    self.done += _length(blocks)
                elif future.status == "error":
                    if self._fails(blocks, future.exception(), left, poisoned):
                        future = submit(blocks)
                        running[future] = blocks
                        results.add(future)
                else:
                    # Cancelled, though not by us: the scheduler does not know of it any more.
                    raise ConnectionError(f"the scheduler lost blocks {blocks}")
                self.progress(self.done, self.total, self.again)
        except KeyboardInterrupt:
            client.cancel(list(running), force=True)
            raise
        except (OSError, TimeoutError) as error:
            log.warning("the scheduler is gone (%s); %d ranges are given to the next", error, len(left))
            self.connection.lose()

    def _fails(self, blocks: str, error: BaseException | None, left: dict[str, int], poisoned: dict[str, str]) -> bool:
        """Counts a failure; whether the range is to be tried again."""
        left[blocks] += 1
        # Not by its class, which a worker without this package has only a copy of.
        code = getattr(error, "code", None)
        hopeless = code in HOPELESS
        text = str(error) if code is not None else f"blocks {blocks}: {type(error).__name__}: {error}"
        log.warning("%s (try %d of %d)", text, left[blocks], self.retries + 1)
        if hopeless or left[blocks] > self.retries:
            poisoned[blocks] = text
            del left[blocks]
            return False
        self.again += 1
        return True


def _submitter(client: Client, arguments: tuple[str, str, dict[str, Any]]) -> Callable[[str], Future]:
    import cloudpickle

    # Workers need not have this package.
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    plan, depot, options = arguments

    def submit(blocks: str) -> Future:
        key = f"ltm-{blocks}-{time.monotonic_ns()}"
        return client.submit(_build, plan, blocks, depot, dict(options), key=key, pure=False)

    return submit


def main(words: list[str] | None = None) -> int:
    """The command line: plan, build, merge."""
    parser = argparse.ArgumentParser(prog="python -m ltm.farm", description="Render and pack a scene on many machines.")
    parser.add_argument("scene", type=Path, help="a scene file, or a plan that ltm plan made")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--local", type=int, metavar="N", help="N workers on this machine")
    where.add_argument("--scheduler", metavar="ADDRESS", help="the cluster of this scheduler, for example tcp://head:8786")
    where.add_argument("--slurm", metavar="WORDS", help='jobs of Slurm, for example "jobs=20 cores=4 memory=8GB --partition=night"')
    parser.add_argument("-o", "--output", type=Path, help="the container [default: the scene's name with .ltc]")
    parser.add_argument("--shards", help="where the shards go: a folder that all workers see, or s3://BUCKET/PREFIX [default: a folder beside the output]")
    parser.add_argument("--plan", default="", metavar="WORDS", help='options of ltm plan, for example "--samples 256 --each 10min"')
    parser.add_argument("--threads", type=int, default=1, help="threads of a task [default: 1]")
    parser.add_argument("--retries", type=int, default=3, help="times that a range is tried again [default: 3]")
    parser.add_argument("--force", action="store_true", help="replace a container that is there")
    asked = parser.parse_args(words)
    logging.basicConfig(format="%(message)s", level=logging.WARNING)
    try:
        plan = _planned(asked.scene, asked.plan)
        out = asked.output or Path(asked.scene.name.removesuffix(".plan.json").removesuffix(asked.scene.suffix) + ".ltc")
        with _cluster(asked) as client:
            render(plan, client, out, asked.shards, retries=asked.retries, threads=asked.threads, overwrite=asked.force)
    except KeyboardInterrupt:
        print("interrupted; the shards are kept, the same command goes on", file=sys.stderr)
        return 130
    except (FarmError, OSError) as error:
        print(f"ltm.farm: {error}", file=sys.stderr)
        return 1
    print(out)
    return 0


def _planned(scene: Path, words: str) -> Path:
    """The plan of a scene. One that is there is kept if it was made by hand, or is of the same job with the same words; else it is made."""
    if scene.suffix == ".json":
        return scene
    plan = Path(scene.with_suffix(".plan.json").name)
    try:
        held = json.loads(plan.read_text())
    except (FileNotFoundError, ValueError):
        held = {}
    if held and "words" not in held:
        if words or Path(held.get("scene", "")).resolve() != scene.resolve():
            raise FarmError(f"{plan} is there and was not made here; give it in place of the scene, or move it away")
        return plan
    made = plan.with_suffix(".new.json")
    command = [_program(None), "plan", str(scene), "-o", str(made), "--force", *shlex.split(words)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    # Of a plan that was made, the first line; the second says what is done here next.
    print("".join(done.stdout.splitlines(keepends=True)[:1]), end="", file=sys.stderr)
    if done.returncode:
        raise FarmError("ltm plan failed; what it said stands above")
    content = json.loads(made.read_text())
    if (held.get("fingerprint"), held.get("words")) == (content["fingerprint"], words):
        # Its ranges are those of the shards that may be there.
        made.unlink()
        return plan
    made.write_text(json.dumps({**content, "words": words}, indent=1))
    made.replace(plan)
    return plan


@contextmanager
def _cluster(asked: argparse.Namespace) -> Iterator[Client]:
    """A client of the cluster that was asked for; what was started for it ends with it."""
    from distributed import Client, LocalCluster

    if asked.scheduler:
        with Client(asked.scheduler) as client:
            yield client
        return
    if asked.local:
        cluster = LocalCluster(n_workers=asked.local, threads_per_worker=1, dashboard_address=None)
    else:
        cluster = _slurm(asked)
    with cluster, Client(cluster) as client:
        yield client


def _slurm(asked: argparse.Namespace) -> Cluster:
    """Jobs of Slurm; gives their tasks all their cores."""
    from dask_jobqueue import SLURMCluster

    words = shlex.split(asked.slurm)
    settings = dict(word.split("=", 1) for word in words if not word.startswith("-"))
    jobs, cores = int(settings.pop("jobs", 1)), int(settings.pop("cores", 1))
    extra = [word for word in words if word.startswith("-")]
    # One task at a time for each job, with all its cores.
    asked.threads = max(asked.threads, cores)
    cluster = SLURMCluster(cores=cores, processes=1, worker_extra_args=["--nthreads", "1"], job_extra_directives=extra, **settings)
    cluster.scale(jobs=jobs)
    return cluster


if __name__ == "__main__":
    # Under its own name, by which tasks are sent by value.
    from ltm.farm import main as run

    sys.exit(run())
