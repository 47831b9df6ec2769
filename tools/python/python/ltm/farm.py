"""One job on many machines: the units of each round as tasks of a Dask cluster, then the merge.

>>> from distributed import Client
>>> from ltm import farm
>>> farm.render("room.plan.json", Client("tcp://head:8786"), out="room.ltc", shards="/shared/room")

``ltm plan`` makes the plan. Four rounds follow: ranges of blocks are traced, windows of the picture denoised, ranges analysed, ranges coded
(two where nothing is denoised). What is missing in which round says ``ltm merge --rounds``, which puts together between two rounds what
the next one begins with, and in the end writes the container. Dask schedules; each task is one ``ltm build`` as a process of its own, so
that a worker may be killed at any instant: a unit is in the depot whole or not at all. Workers need the program ``ltm`` (on their PATH, or where ``LTM`` says), the scene
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

#: Exit code of ``ltm merge --plan`` where units are missing.
MISSING = 8
#: Exit code where a shard has other bytes than were written.
DAMAGED = 4
#: Exit code where the place of the shards, or the disk, did not do what it was asked to.
REFUSED = 5
#: Exit codes of ``ltm build`` that come back however often a unit is tried: unusable arguments or input.
HOPELESS = (2, 3)

log = logging.getLogger("ltm.farm")


class FarmError(Exception):
    """Units that could not be built, after all tries; the others are in the depot."""

    def __init__(self, message: str, poisoned: dict[str, str] | None = None):
        super().__init__(message)
        #: The last line of each unit that failed, by its round and number.
        self.poisoned = poisoned or {}


class BuildError(Exception):
    """One try of one unit failed."""

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


def _build(plan: str, unit: str, shards: str, options: dict[str, Any]) -> str | None:
    """The task: one unit into one shard. Gives the address of the worker that did it."""
    import logging
    import subprocess
    import sys
    import time

    log = logging.getLogger("distributed.worker")
    name, number = unit.split()
    words = [_program(options.get("program")), "--threads", str(options.get("threads", 1)), "build", "--plan", plan, "--round", name, "--range", number]
    words += ["--out", shards]
    memory = options.get("memory") or _memory_of_worker()
    words += ["--memory", str(int(memory))] if memory else []
    words += ["--check"] if options.get("check") else []
    folder = _of_worker("local_directory")
    # What is analysed here is coded here, as far as that may be.
    words += ["--keep", folder] if folder else []
    begun = time.monotonic()
    preparation = _die_with_parent if sys.platform == "linux" else None
    done = subprocess.run(words, capture_output=True, text=True, errors="replace", stdin=subprocess.DEVNULL, preexec_fn=preparation)
    seconds = time.monotonic() - begun
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()] or ["it said nothing"]
        log.warning("%s: exit code %s after %.1f s: %s", unit, done.returncode, seconds, lines[-1])
        raise BuildError(f"{unit}: {lines[-1]}", done.returncode)
    log.info("%s: %.1f s: %s", unit, seconds, done.stdout.strip())
    return _of_worker("address")


def _of_worker(name: str) -> Any:
    """Something that the worker knows of itself; nothing outside a worker."""
    try:
        from distributed import get_worker

        return getattr(get_worker(), name, None)
    except (ImportError, ValueError):
        return None


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
    """Units of a round done, their rate and the time left: one line on a terminal, nothing elsewhere."""

    def __init__(self, file: TextIO = sys.stderr):
        self.file = file
        self.begun = time.monotonic()
        self.round: str | None = None
        self.before = 0

    def __call__(self, name: str, done: int, total: int, retries: int) -> None:
        if name != self.round:
            self.round, self.before, self.begun = name, done, time.monotonic()
        if not self.file.isatty():
            return
        seconds = time.monotonic() - self.begun
        rate = (done - self.before) / seconds if seconds > 0 else 0.0
        left = f"{_clock((total - done) / rate)} left" if rate > 0 else "…"
        bar = "=" * (32 * done // max(total, 1))
        again = f", {retries} tries again" if retries else ""
        end = "\n" if done == total else ""
        print(f"\r{name:8} [{bar:32}] {done}/{total} units, {rate:.1f} units/s, {left}{again}\x1b[K", end=end, file=self.file, flush=True)


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


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
    progress: Callable[[str, int, int, int], None] | None = None,
    patience: float = 600.0,
) -> Path:
    """Builds the units of ``plan`` that its depot lacks on the workers of ``client``, round by round, and merges them into ``out``.

    ``client`` is a client of Dask, the address of a scheduler, or a function that gives a client; a scheduler that is gone is waited for
    ``patience`` seconds. ``shards`` is the depot, a folder that all workers see or ``s3://BUCKET/PREFIX``, by default a folder beside ``out``. A unit that fails, or
    whose worker dies, is done again elsewhere, ``retries`` times; then the others of its round are finished, and :class:`FarmError` names it.
    ``progress`` is told the round, its units that are done, all of them, and the tries again. Each task
    gets ``threads`` threads, and ``memory`` bytes, by default its share of what its worker may take. Ctrl-C cancels what is not begun;
    the same call goes on. Returns ``out``.
    """
    plan, out = Path(plan).resolve(), Path(out).resolve()
    depot = str(shards) if shards is not None else f"{out}-shards"
    depot = depot if "://" in depot else str(Path(depot).resolve())
    content = json.loads(plan.read_text())
    totals = {"clean": content["shape"].get("windows", 0)}
    options = {"threads": threads, "memory": memory, "program": program}
    merge = [_program(program), "merge", "--plan", str(plan), depot, "-o", str(out), "--rounds"] + (["--force"] if overwrite else [])
    if out.exists() and not overwrite:
        raise FileExistsError(f"{out} is there already")
    work = _Work(str(plan), depot, _Connection(client, patience), options, retries, progress or Progress())
    check: list[str] = []
    failures = 0
    built: list[str] = []
    while True:
        code, units = _merge([*merge, *check, "--list"])
        if code == 0 and units:
            name = units[0].split()[0]
            if units == built:
                raise FarmError(f"{len(units)} units of round {name} are done and still missing in {depot}: its shards are of different beginnings; take an empty place")
            work.build(name, units, totals.get(name, len(content["ranges"])))
        elif code == 0:
            code, _ = _merge(merge)
            if code == 0:
                return out
        # A shard that was there by its name and is not whole: all are read before they are trusted, and from now on before they are built.
        is_damaged = work.damaged or (code == DAMAGED and not check)
        check = ["--check"] if is_damaged else []
        options["check"] = options.get("check") or is_damaged
        failures += is_damaged or code != 0
        # The units that were built with nothing against them: they are not missing any more.
        built = [] if code or is_damaged else units
        work.damaged = False
        if code not in (0, DAMAGED, REFUSED, MISSING) or failures > retries:
            raise FarmError(f"ltm merge ended with exit code {code}; what it said stands above" if code else f"shards are damaged again and again in {depot}; check the disk")


def _merge(words: list[str]) -> tuple[int, list[str]]:
    """The exit code of a merge, and the lines that it wrote."""
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL)
    return done.returncode, [line for line in done.stdout.splitlines() if line]


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
    """The units that are being built."""

    def __init__(self, plan: str, depot: str, connection: _Connection, options: dict[str, Any], retries: int, progress: Callable[[str, int, int, int], None]):
        self.plan, self.depot, self.connection, self.options = plan, depot, connection, options
        self.retries, self.progress = retries, progress
        self.round, self.done, self.total, self.again = "", 0, 0, 0
        #: Whether a unit met a shard of another whose bytes have changed.
        self.damaged = False
        #: Where ranges were analysed.
        self.places: dict[str, str] = {}

    def build(self, name: str, units: list[str], total: int) -> None:
        """Builds all of them, or raises :class:`FarmError` with those that cannot be built when all others are."""
        self.round, self.done, self.total = name, total - len(units), total
        left = dict.fromkeys(units, 0)
        poisoned: dict[str, str] = {}
        self._tell()
        while left:
            self._submit(left, poisoned)
        if poisoned:
            lines = "; ".join(poisoned.values())
            raise FarmError(f"{len(poisoned)} of the units cannot be built, the others are done: {lines}", poisoned)

    def _tell(self) -> None:
        self.progress(self.round, self.done, self.total, self.again)

    def _submit(self, left: dict[str, int], poisoned: dict[str, str]) -> None:
        """Submits what is left, and hears of it until all is done or the scheduler is gone."""
        from distributed import as_completed

        client = self.connection.get()
        submit = _submitter(client, (self.plan, self.depot, self.options), self.places)
        running = {submit(unit): unit for unit in left}
        with client.as_current():
            results = as_completed(list(running))
        try:
            for future in results:
                unit = running.pop(future)
                if future.status == "finished":
                    del left[unit]
                    self.done += 1
                    self._remember(unit, future.result())
                elif future.status == "error":
                    if self._fails(unit, future.exception(), left, poisoned):
                        future = submit(unit)
                        running[future] = unit
                        results.add(future)
                else:
                    # Cancelled, though not by us: the scheduler does not know of it any more.
                    raise ConnectionError(f"the scheduler lost {unit}")
                self._tell()
        except KeyboardInterrupt:
            client.cancel(list(running), force=True)
            raise
        except (OSError, TimeoutError) as error:
            log.warning("the scheduler is gone (%s); %d units are given to the next", error, len(left))
            self.connection.lose()

    def _remember(self, unit: str, place: str | None) -> None:
        name, number = unit.split()
        if name == "analyse" and place:
            self.places[f"code {number}"] = place

    def _fails(self, unit: str, error: BaseException | None, left: dict[str, int], poisoned: dict[str, str]) -> bool:
        """Counts a failure; whether the unit is to be tried again."""
        left[unit] += 1
        # Not by its class, which a worker without this package has only a copy of.
        code = getattr(error, "code", None)
        text = str(error) if code is not None else f"{unit}: {type(error).__name__}: {error}"
        log.warning("%s (try %d of %d)", text, left[unit], self.retries + 1)
        if code == DAMAGED:
            # Not its own fault: what it reads has to be built again first.
            self.damaged = True
            del left[unit]
            return False
        if code in HOPELESS or left[unit] > self.retries:
            poisoned[unit] = text
            del left[unit]
            return False
        self.again += 1
        return True


def _submitter(client: Client, arguments: tuple[str, str, dict[str, Any]], places: dict[str, str]) -> Callable[[str], Future]:
    import cloudpickle

    # Workers need not have this package.
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    plan, depot, options = arguments

    def submit(unit: str) -> Future:
        key = f"ltm-{unit}-{time.monotonic_ns()}"
        place = places.get(unit)
        where = {"workers": [place], "allow_other_workers": True} if place else {}
        return client.submit(_build, plan, unit, depot, dict(options), key=key, pure=False, **where)

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
    parser.add_argument("--retries", type=int, default=3, help="times that a unit is tried again [default: 3]")
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
