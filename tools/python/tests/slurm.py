"""Slurm's own daemons as processes of a test: one machine, that of the test, in a folder that is gone afterwards."""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

DAEMONS = ("munged", "slurmctld", "slurmd")
CONFIGURATION = """
ClusterName=ltm
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SchedulerParameters=sched_interval=1
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=8000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def _program(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def why_not() -> str | None:
    """What is missing for a cluster; none where nothing is."""
    missing = [name for name in (*DAEMONS, "sbatch", "sinfo") if _program(name) is None]
    if missing:
        return f"no {missing[0]} here (apt-get install slurm-wlm munge)"
    return None if os.geteuid() == 0 else "Slurm's daemons want root"


@contextmanager
def cluster(folder: Path) -> Iterator[Path]:
    """Starts a cluster of as many processors as the machine has; gives its configuration, for SLURM_CONF."""
    if why_not():
        pytest.skip(why_not())
    for name in ("state", "spool"):
        (folder / name).mkdir()
    # The daemons check who could write to the folders above their socket and their key.
    folder.chmod(0o755)
    key = folder / "munge.key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o600)
    with ExitStack() as free:
        sockets = [free.enter_context(socket.socket()) for _ in range(2)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        ports = [each.getsockname()[1] for each in sockets]
    configuration = folder / "slurm.conf"
    host, cpus = socket.gethostname().split(".")[0], os.cpu_count()
    configuration.write_text(CONFIGURATION.format(host=host, ports=ports, folder=folder, cpus=cpus))
    munge = ["--foreground", "--force", f"--socket={folder}/munge.socket", f"--key-file={key}", f"--pid-file={folder}/munged.pid"]
    commands = [
        ["munged", *munge, f"--log-file={folder}/munged.log", f"--seed-file={folder}/munged.seed"],
        ["slurmctld", "-D", "-f", str(configuration)],
        ["slurmd", "-D", "-f", str(configuration), "-N", host],
    ]
    daemons: list[subprocess.Popen] = []
    try:
        for name, *words in commands:
            with open(folder / f"{name}.out", "wb") as log:
                daemons.append(subprocess.Popen([_program(name), *words], stdout=log, stderr=log, stdin=subprocess.DEVNULL))
            time.sleep(1)
        _wait_for_node(configuration, daemons, folder)
        yield configuration
    finally:
        for daemon in reversed(daemons):
            daemon.terminate()
            try:
                daemon.wait(20)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def _wait_for_node(configuration: Path, daemons: list[subprocess.Popen], folder: Path) -> None:
    end = time.monotonic() + 60
    environment = os.environ | {"SLURM_CONF": str(configuration)}
    while True:
        words = [_program("sinfo"), "--noheader", "--format=%T"]
        done = subprocess.run(words, capture_output=True, text=True, env=environment)
        if done.stdout.strip() == "idle":
            return
        if any(daemon.poll() is not None for daemon in daemons) or time.monotonic() > end:
            said = "\n".join(f"{log.name}: {log.read_text(errors='replace')[-600:]}" for log in sorted(folder.glob("*.out")))
            pytest.fail(f"Slurm did not start: {done.stdout}{done.stderr}\n{said}")
        time.sleep(0.5)
