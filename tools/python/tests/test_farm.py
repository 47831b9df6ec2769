"""Farms: units as tasks of Dask, of a Slurm script and of an Open Job Description, and the container of one machine in the end.

They want the program: ``LTM`` says where it is. ``LTM_FARM_GIB=4`` makes the matrix of the proof so large; a worker is killed every ten
seconds then.
"""

import hashlib
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

distributed = pytest.importorskip("distributed")
from ltm import farm  # noqa: E402
from slurm import cluster, why_not  # noqa: E402
from stores import BUCKET, FAULTS, Network, moto  # noqa: E402

PROGRAM = os.environ.get("LTM") or shutil.which("ltm")
FARM = Path(__file__).parents[2] / "farm"
pytestmark = [
    pytest.mark.skipif(PROGRAM is None, reason="the program ltm is not there, and LTM does not say where it is"),
    # Dask's own, of clusters that are killed.
    pytest.mark.filterwarnings("ignore"),
]

OBJ = """mtllib room.mtl
v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1
v -0.5 2 -0.5\nv 0.5 2 -0.5\nv 0.5 2 0.5\nv -0.5 2 0.5
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl floor\nf 4 3 2 1
usemtl lamp\nf 5/1 6/2 7/3 8/4
"""
MTL = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 2 1\n"
SCENE = """
geometry = ["room.obj"]

[camera]
eye = [0.0, 1.0, 3.0]
look_at = [0.0, 0.5, 0.0]
vertical_fov_degrees = 50.0
width = {width}
height = {height}

[render]
samples_per_pixel = {samples}
block_side = {side}

[[light]]
material = "lamp"
texels = [{texels}, {texels}]
"""


def run(*words: object) -> subprocess.CompletedProcess:
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, f"{words}: {done.stderr}"
    return done


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def make(folder: Path, width: int, height: int, texels: int, samples: int, side: int, blocks: int, *words: str) -> Path:
    """Writes a room, its plan, and the container of one machine, `single.ltc`."""
    (folder / "room.obj").write_text(OBJ)
    (folder / "room.mtl").write_text(MTL)
    (folder / "room.toml").write_text(SCENE.format(width=width, height=height, texels=texels, samples=samples, side=side))
    run(PROGRAM, "plan", folder / "room.toml", "-o", folder / "room.plan.json", "--blocks", blocks, *words)
    run(PROGRAM, "render", folder / "room.toml", "--pack", "-o", folder / "single.ltc", *words)
    return folder / "room.plan.json"


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("room")
    make(folder, 48, 32, 8, 16, 8, 5)
    return folder


@pytest.fixture(scope="module")
def client():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            yield client


def failing(folder: Path, when: str) -> str:
    """The program, but for the cases of a shell's pattern of its arguments."""
    path = folder / "ltm"
    path.write_text(f'#!/bin/bash\n{when}\nexec "{PROGRAM}" "$@"\n')
    path.chmod(0o755)
    return str(path)


def test_a_farm_makes_the_container_of_one_machine(room: Path, client, tmp_path: Path):
    told = []
    out = farm.render(
        room / "room.plan.json", client, tmp_path / "room.ltc", tmp_path / "shards", progress=lambda *now: told.append(now)
    )
    assert digest(out) == digest(room / "single.ltc")
    # 24 blocks by five, three times; one window; and what stands before each round after the first.
    names = [path.suffix for path in (tmp_path / "shards").iterdir()]
    counts = {suffix: names.count(suffix) for suffix in names}
    assert counts == {".shard": 5, ".images": 1, ".summaries": 5, ".coded": 5, ".reduced": 3}
    rounds = [("trace", 5), ("clean", 1), ("analyse", 5), ("code", 5)]
    assert told == [(name, done, of, 0) for name, of in rounds for done in range(of + 1)]
    with pytest.raises(FileExistsError):
        farm.render(room / "room.plan.json", client, out, tmp_path / "shards")
    told.clear()
    farm.render(
        room / "room.plan.json", client, out, tmp_path / "shards", overwrite=True, progress=lambda *now: told.append(now)
    )
    assert told == [], "nothing was built again"


def test_a_range_that_cannot_be_built_is_named_and_the_others_are_finished(room: Path, client, tmp_path: Path):
    bad = failing(tmp_path, '[[ "$*" == *"--round trace --range 1 "* ]] && { echo "ltm: the lens cap is on" >&2; exit 5; }')
    with pytest.raises(farm.FarmError, match="1 of the units .* lens cap") as raised:
        farm.render(room / "room.plan.json", client, tmp_path / "room.ltc", tmp_path / "shards", program=bad, retries=1)
    assert list(raised.value.poisoned) == ["trace 1"]
    assert len(list((tmp_path / "shards").iterdir())) == 4
    told = []
    out = farm.render(
        room / "room.plan.json", client, tmp_path / "room.ltc", tmp_path / "shards", progress=lambda *now: told.append(now)
    )
    assert told[:2] == [("trace", 4, 5, 0), ("trace", 5, 5, 0)]
    assert digest(out) == digest(room / "single.ltc")


def test_units_that_are_done_and_stay_missing_end_the_farm(room: Path, client, tmp_path: Path):
    stuck = failing(tmp_path, '[[ "$1" == merge ]] && { echo "clean 0"; exit 0; }; [[ "$*" == *" build "* ]] && exit 0')
    with pytest.raises(farm.FarmError, match="1 units of round clean are done and still missing"):
        farm.render(room / "room.plan.json", client, tmp_path / "room.ltc", tmp_path / "shards", program=stuck)


def test_a_unit_that_is_missing_at_the_merge_is_asked_for_again(room: Path, client, tmp_path: Path):
    seen = tmp_path / "seen"
    late = failing(tmp_path, f'[[ "$1" == merge && "$*" != *--list* && ! -e "{seen}" ]] && {{ touch "{seen}"; exit {farm.MISSING}; }}')
    out = farm.render(room / "room.plan.json", client, tmp_path / "room.ltc", tmp_path / "shards", program=late)
    assert seen.exists() and digest(out) == digest(room / "single.ltc")


@pytest.mark.parametrize("name", ["trace", "clean", "code"])
def test_a_shard_that_was_changed_is_built_again(room: Path, client, tmp_path: Path, name: str):
    """Found by who reads it: a unit of the next round, or the merge."""
    shards, plan, out = tmp_path / "shards", room / "room.plan.json", tmp_path / "room.ltc"
    while True:
        merge = [PROGRAM, "merge", "--plan", plan, shards, "-o", out, "--rounds", "--list"]
        units = [line.split() for line in run(*merge).stdout.splitlines()]
        if not units:
            break
        for of, number in units:
            run(PROGRAM, "build", "--plan", plan, "--round", of, "--range", number, "--out", shards)
        if units[0][0] == name:
            break
    suffix = {"trace": ".shard", "clean": ".images", "code": ".coded"}[name]
    shard = next(path for path in shards.iterdir() if path.suffix == suffix)
    data = bytearray(shard.read_bytes())
    data[len(data) // 2] ^= 1
    shard.write_bytes(data)
    farm.render(plan, client, out, shards)
    assert digest(out) == digest(room / "single.ltc")


def test_the_command_line_of_a_merge_says_what_is_missing(room: Path, tmp_path: Path):
    plan, shards, out = room / "room.plan.json", tmp_path / "shards", tmp_path / "room.ltc"
    for number in (1, 3):
        run(PROGRAM, "build", "--plan", plan, "--range", number, "--out", shards)
    merge = [PROGRAM, "merge", "--plan", str(plan), str(shards), "-o", str(out)]
    done = subprocess.run(merge, capture_output=True, text=True)
    assert (done.returncode, done.stdout.split()) == (farm.MISSING, ["0..5", "10..15", "20..24"])
    assert "build the missing ranges" in done.stderr and not out.exists()
    assert run(*merge, "--list=array").stdout == "0,2,4\n"
    assert run(*merge, "--rounds", "--list=array").stdout == "trace 0,2,4\n"
    done = subprocess.run([*merge, "--rounds"], capture_output=True, text=True)
    assert (done.returncode, done.stdout.splitlines()) == (farm.MISSING, ["trace 0", "trace 2", "trace 4"])
    early = [PROGRAM, "build", "--plan", str(plan), "--round", "clean", "--range", "0", "--out", str(shards)]
    done = subprocess.run(early, capture_output=True, text=True)
    assert done.returncode == farm.MISSING and "round clean" in done.stderr


def test_the_command_line_renders_a_scene(room: Path, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LTM", PROGRAM)
    assert farm.main([str(room / "room.toml"), "--local", "2", "--plan", "--blocks 6"]) == 0
    assert capsys.readouterr().out.endswith("room.ltc\n")
    assert digest(tmp_path / "room.ltc") == digest(room / "single.ltc")


def test_a_plan_that_is_there_is_kept(room: Path, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LTM", PROGRAM)
    scene, plan = room / "room.toml", tmp_path / "room.plan.json"
    # One that was made here is made anew only with other words.
    assert farm._planned(scene, "--blocks 6") == Path("room.plan.json")
    made = plan.read_bytes()
    farm._planned(scene, "--blocks 6")
    assert plan.read_bytes() == made
    farm._planned(scene, "--blocks 4")
    assert plan.read_bytes() != made
    # Or for another scene of that name, or one that has changed; one that was cut short is none.
    elsewhere = shutil.copytree(room, tmp_path / "elsewhere") / "room.toml"
    elsewhere.write_text(elsewhere.read_text().replace("[render]", "[render]\nseed = 7"))
    farm._planned(elsewhere, "--blocks 4")
    assert json.loads(plan.read_text())["scene"] == str(elsewhere)
    plan.write_text("{")
    farm._planned(scene, "--blocks 4")
    assert json.loads(plan.read_text())["scene"] == str(scene)
    # One that was made by hand is used, or in the way.
    run(PROGRAM, "plan", scene, "-o", plan, "--force", "--samples", "3")
    made = plan.read_bytes()
    farm._planned(scene, "")
    for other, words in ((scene, "--blocks 6"), (elsewhere, "")):
        with pytest.raises(farm.FarmError, match="not made here"):
            farm._planned(other, words)
    assert plan.read_bytes() == made


def ranges_of(plan: Path) -> list:
    return json.loads(plan.read_text())["ranges"]


def test_the_script_for_slurm_builds_the_range_of_its_task(room: Path, tmp_path: Path):
    """The script itself, started as Slurm starts it."""
    plan, shards, out = room / "room.plan.json", tmp_path / "shards", tmp_path / "room.ltc"
    asked = []
    while units := run(PROGRAM, "merge", "--plan", plan, shards, "-o", out, "--rounds", "--list").stdout.splitlines():
        for name, number in map(str.split, units):
            environment = os.environ | {"LTM": PROGRAM, "SLURM_ARRAY_TASK_ID": number, "SLURM_CPUS_PER_TASK": "2"}
            subprocess.run(["bash", FARM / "array.sbatch", plan, shards, name], check=True, env=environment)
        asked.append(units[0].split()[0])
    assert asked == ["trace", "clean", "analyse", "code"]
    run(PROGRAM, "merge", "--plan", plan, shards, "-o", out, "--rounds")
    assert digest(tmp_path / "room.ltc") == digest(room / "single.ltc")


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """A cluster of Slurm of one machine, by its configuration. Its environment is that of what a test starts."""
    with cluster(tmp_path_factory.mktemp("slurm")) as configuration, pytest.MonkeyPatch.context() as patch:
        patch.setenv("SLURM_CONF", str(configuration))
        patch.setenv("LTM", PROGRAM)
        yield


needs_slurm = pytest.mark.skipif(why_not() is not None, reason=str(why_not()))


@needs_slurm
@pytest.mark.xdist_group("slurm")
def test_slurm_runs_the_array(room: Path, slurm, tmp_path: Path):
    plan, shards, out = room / "room.plan.json", tmp_path / "shards", tmp_path / "room.ltc"
    while missing := run(PROGRAM, "merge", "--plan", plan, shards, "-o", out, "--rounds", "--list=array").stdout.split():
        name, numbers = missing
        words = ["sbatch", "--wait", f"--array={numbers}", f"--chdir={tmp_path}", FARM / "array.sbatch", plan, shards, name]
        subprocess.run(words, check=True, timeout=300)
    run(PROGRAM, "merge", "--plan", plan, shards, "-o", out, "--rounds")
    assert digest(out) == digest(room / "single.ltc")


@needs_slurm
@pytest.mark.xdist_group("slurm")
def test_the_command_line_has_slurm_start_workers(room: Path, slurm, tmp_path: Path, monkeypatch):
    pytest.importorskip("dask_jobqueue", reason="no dask-jobqueue here")
    monkeypatch.chdir(tmp_path)
    words = ["--slurm", "jobs=2 cores=1 memory=1GB --comment=ltm", "--plan", "--blocks 6"]
    assert farm.main([str(room / "room.toml"), *words]) == 0
    assert digest(tmp_path / "room.ltc") == digest(room / "single.ltc")
    end = time.monotonic() + 60
    while subprocess.run(["squeue", "--noheader"], stdout=subprocess.PIPE, check=True).stdout:
        assert time.monotonic() < end, "the jobs end with the work"
        time.sleep(0.5)


OPENJD = shutil.which("openjd", path=f"{Path(sys.executable).parent}:{os.environ.get('PATH', '')}")


@pytest.mark.skipif(OPENJD is None, reason="no openjd here (pip install openjd-cli)")
def test_open_job_description_builds_and_merges(room: Path, tmp_path: Path):
    plan, template = room / "room.plan.json", FARM / "template.openjd.yaml"
    run(OPENJD, "check", template)
    parameters = {
        "Plan": plan, "Shards": tmp_path / "shards", "Output": tmp_path / "room.ltc",
        "Ranges": f"0-{len(ranges_of(plan)) - 1}", "Windows": "0", "Program": PROGRAM,
    }
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}={value}")]
    run(OPENJD, "run", template, "--step", "Merge", "--run-dependencies", *words)
    assert digest(tmp_path / "room.ltc") == digest(room / "single.ltc")


#: Of what builds one start in ten fails, half of them after the work; merging is one machine's own.
UNSTEADY = """case "$*" in *" build "*)
  ((RANDOM %% 20 == 0)) && { echo "ltm: the store does not answer" >&2; exit 5; }
  ((RANDOM %% 20 == 0)) && { "%s" "$@" > /dev/null; echo "ltm: the store's answer was lost" >&2; exit 5; }
esac"""


class Machines:
    """A scheduler and three workers as processes; who is dead is started again.

    A worker is killed after each `kill_every` units, or every `kill_seconds`; the scheduler after `scheduler_dies_after` units, and again
    between two rounds.
    """

    def __init__(self, kill_every: int, scheduler_dies_after: int, kill_seconds: float | None = None):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.kill_every, self.scheduler_dies_after, self.kill_seconds = kill_every, scheduler_dies_after, kill_seconds
        self.killed_at = time.monotonic()
        self.done = 0
        self.stopping = threading.Event()
        self.killed = {"workers": 0, "schedulers": 0}
        self.random = random.Random(7)
        self.scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", self.port, "--no-dashboard")
        self.workers = [self.worker() for _ in range(3)]
        self.thread = threading.Thread(target=self.revive)
        self.thread.start()

    def start(self, *words: object) -> subprocess.Popen:
        command = [sys.executable, "-m", "distributed.cli.dask_" + str(words[0]), *map(str, words[1:])]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def worker(self) -> subprocess.Popen:
        return self.start("worker", self.address, "--nthreads", 1, "--no-nanny", "--no-dashboard", "--death-timeout", 5)

    def revive(self) -> None:
        while not self.stopping.wait(0.2):
            if self.scheduler.poll() is not None:
                self.scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", self.port, "--no-dashboard")
            self.workers = [w if w.poll() is None else self.worker() for w in self.workers]
            if self.kill_seconds and time.monotonic() > self.killed_at + self.kill_seconds:
                self.kill_worker()

    def kill_worker(self) -> None:
        self.killed["workers"] += 1
        self.killed_at = time.monotonic()
        self.random.choice(self.workers).send_signal(signal.SIGKILL)

    def haunt(self, name: str, done: int) -> None:
        self.done += done > 0
        first = not self.killed["schedulers"] and self.done >= self.scheduler_dies_after
        between = self.killed["schedulers"] == 1 and (name, done) == ("analyse", 0)
        if first or between:
            self.killed["schedulers"] += 1
            self.scheduler.send_signal(signal.SIGKILL)
        if not self.kill_seconds and self.done >= (self.killed["workers"] + 1) * self.kill_every:
            self.kill_worker()

    def stop(self) -> None:
        self.stopping.set()
        self.thread.join()
        for process in [*self.workers, self.scheduler]:
            process.kill()
            process.wait()


@pytest.fixture(params=["folder", "store"])
def place(request, tmp_path: Path, monkeypatch):
    """Address of shards, the program, and what says how often the place failed: one time in ten, one way or another."""
    if request.param == "folder":
        yield str(tmp_path / "shards"), failing(tmp_path, UNSTEADY % PROGRAM), lambda: "a folder"
        return
    with moto() as port, Network(port, FAULTS, 0.1) as network:
        for name, value in network.environment.items():
            monkeypatch.setenv(name, value)
        yield f"s3://{BUCKET}/proof", PROGRAM, lambda: f"{network.failed} of {len(network.asked)} requests failed"


def test_with_workers_and_the_scheduler_killed_and_a_store_that_fails_the_bytes_are_those_of_one_machine(tmp_path: Path, place):
    shards, program, told = place
    gib = float(os.environ.get("LTM_FARM_GIB", "0.05"))
    # A small picture under many columns: 3 × 4 bytes for each pixel and column.
    texels, side = 32, 16
    pixels = gib * 2**30 / (12 * texels**2)
    width = max(int((pixels * 1.5) ** 0.5) // side * side, 4 * side)
    height = max(int(pixels / width) // side * side, 2 * side)
    blocks = (width // side) * (height // side)
    large = gib >= 1
    plan = make(tmp_path, width, height, texels, 16 if large else 64, side, max(blocks // 60, 1))
    raw = json.loads(plan.read_text())["shape"]["raw_bytes"]
    machines = Machines(4, 6, 10.0 if large else None)
    begun, again = time.monotonic(), []

    def progress(name: str, done: int, total: int, tries: int) -> None:
        again.append(tries)
        machines.haunt(name, done)

    try:
        out = farm.render(
            plan, machines.address, tmp_path / "farm.ltc", shards, program=program, retries=20, patience=60,
            progress=progress,
        )
    finally:
        machines.stop()
    print(
        f"{raw / 2**30:.2f} GiB of matrix, {len(ranges_of(plan))} ranges, {time.monotonic() - begun:.0f} s, "
        f"{machines.killed['workers']} workers and {machines.killed['schedulers']} schedulers killed, {again[-1]} tries again; {told()}"
    )
    assert digest(out) == digest(tmp_path / "single.ltc")
    assert machines.killed["schedulers"] == 2 and machines.killed["workers"] >= 1
