"""Measures the package beside the same work in numpy, in one run.

    python measure.py [width height lights]
    python measure.py --slices room.ltm
    python measure.py --program room.ltc

Renders and packs a built-in room with a ceiling light of lights × lights texels, then relights it. numpy has the whole matrix
in memory as float32; its product is the matrix times the weights of each channel. Both write into arrays that are there.
``--program`` opens and relights a file and writes the image as ``ltm relight`` (on the path, or what LTM names) does, each as a new
process and in turn, with what the interpreter and its imports take apart, and relights on a GPU if there is one; it needs
OpenEXR's module. ``--slices`` says what memory slices of a file take, which may be larger than memory.
"""

import os
import re
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import ltm
import numpy as np


def seconds(work: Callable[[], object]) -> float:
    """The least time of several runs."""
    work()
    times = []
    while len(times) < 5 or (sum(times) < 1 and len(times) < 50):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return min(times)


def products(width: int, height: int, texels: int) -> None:
    """Opening, relighting, the adjoint and a slice, beside numpy."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "room.ltc"
        report = ltm.render(ltm.BuiltIn("mixed", width, height, texels), path, samples=16, pack=True).packed
        print(f"{width} × {height}, {texels**2} texels: {report.raw_bytes} bytes, packed {report.packed_bytes}")
        print(f"open: {1e3 * seconds(lambda: ltm.open(path).close()):.2f} ms")
        with ltm.open(path) as m:
            columns, pixels = m.shape[3], height * width
            random = np.random.default_rng(0)
            weights = random.random((256, columns, 3), np.float32)
            images = np.empty((256, *m.shape[:3]), np.float32)
            sums = np.empty((256, columns, 3), np.float32)
            m.relight(weights, out=images)
            # Channels × pixels × columns, and what numpy multiplies it by: channels × columns × images.
            whole = np.ascontiguousarray(m.to_numpy().reshape(-1, 3, columns).transpose(1, 0, 2))
            lightings = np.ascontiguousarray(weights.transpose(2, 1, 0))
            planes = np.ascontiguousarray(images[:16].reshape(16, -1, 3).transpose(2, 0, 1))
            target = np.empty((3, pixels, 256), np.float32)
            rows: list[tuple[str, Callable[[], object], Callable[[], object]]] = []
            for k in (1, 16, 256):
                own, out = np.ascontiguousarray(lightings[..., :k]), np.ascontiguousarray(target[..., :k])
                rows.append(
                    (
                        f"relight, {k} images",
                        lambda k=k: m.relight(weights[:k], out=images[:k]),
                        lambda own=own, out=out: np.matmul(whole, own, out=out),
                    )
                )
            for k in (1, 16):
                own = np.ascontiguousarray(planes[:, :k])
                rows.append(
                    (
                        f"adjoint, {k} images",
                        lambda k=k: m.adjoint(images[:k], out=sums[:k]),
                        lambda own=own: np.matmul(own, whole),
                    )
                )
            rows.append(("one column", lambda: m[..., columns // 2], lambda: whole[..., columns // 2].copy()))
            rows.append(("one pixel", lambda: m[height // 2, 7], lambda: whole[:, height // 2 * width + 7].copy()))
            for name, ours, numpys in rows:
                a, b = seconds(ours), seconds(numpys)
                print(f"{name}: {1e3 * a:.2f} ms, numpy {1e3 * b:.2f} ms, ratio {b / a:.2f}")
            # Writing the pixels is what no product can be faster than.
            print(f"256 images filled: {1e3 * seconds(lambda: images.fill(1)):.2f} ms")


#: A process that does what `ltm relight` does, and says how long that took without starting and importing.
WITHIN = """
import sys, time, numpy, ltm, OpenEXR
begun = time.perf_counter()
with ltm.open(sys.argv[1]) as m:
    image = m.relight(m.scene_weights, device="cpu")
relit = time.perf_counter()
OpenEXR.File({"compression": OpenEXR.RLE_COMPRESSION}, {"RGB": image}).write(sys.argv[2])
print(relit - begun, time.perf_counter() - begun)
"""


def processes(commands: dict[str, list[str]], rounds: int) -> dict[str, list[tuple[float, float, str]]]:
    """Seconds from a process's start to its end, seconds of processors that it took, and what it printed, each round
    running every command once, so that what else runs on the machine meets all of them alike."""
    taken: dict[str, list[tuple[float, float, str]]] = {name: [] for name in commands}
    for _ in range(rounds):
        for name, command in commands.items():
            before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
            wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            taken[name].append((wall, spent, done.stdout))
    return taken


def program(path: str) -> None:
    """Opening, relighting once and writing an image, beside the program; further images; and a GPU's."""
    tool = os.environ.get("LTM", "ltm")
    with tempfile.TemporaryDirectory() as folder:
        image = f"{folder}/a.exr"
        commands = {"python": [sys.executable, "-c", "pass"]}
        for module in ("numpy", "ltm", "ltm, OpenEXR"):
            commands[module] = [sys.executable, "-c", f"import {module}"]
        commands["ours"] = [sys.executable, "-c", WITHIN, path, image]
        commands["program"] = [tool, "relight", path, "--device", "cpu", "-o", image]
        processes(commands, 1)
        taken = processes(commands, 15)
    wall = {name: 1e3 * median([run[0] for run in runs]) for name, runs in taken.items()}
    spent = {name: 1e3 * median([run[1] for run in runs]) for name, runs in taken.items()}
    own = [[float(value) for value in run[2].split()] for run in taken["ours"]]
    relit, done = (1e3 * median([run[i] for run in own]) for i in (0, 1))
    print("milliseconds, medians of 15 processes each in turn: from start to end, and of processors")
    print(f"the interpreter alone: {wall['python']:.0f}, {spent['python']:.0f}")
    for module in ("numpy", "ltm", "ltm, OpenEXR"):
        print(f"and import {module}: {wall[module]:.0f}, {spent[module]:.0f}")
    print(f"and open, relight, write: {wall['ours']:.0f}, {spent['ours']:.0f}")
    print(f"ltm relight: {wall['program']:.0f}, {spent['program']:.0f}")
    apart = spent["ours"] - spent["ltm, OpenEXR"]
    print(f"ours without start and imports: {done:.0f} ({relit:.0f} to the image, the rest its file), {apart:.0f}")
    ratios = [theirs[0] / mine[1] for theirs, mine in zip(taken["program"], own, strict=True)]
    print(f"speed over that of ltm relight, start and imports apart: {median(ratios):.2f}; of processors {spent['program'] / apart:.2f}")
    with ltm.open(path) as m:
        weights = m.scene_weights
        again = seconds(lambda: m.relight(weights, device="cpu"))
        print(f"{path}, {m.shape[0]} × {m.shape[1]} × 3 × {m.shape[3]}: further images {1e3 * again:.2f} ms each")
        found = ltm.gpu()
        if found is not None:
            kind = "software" if found.is_software else "hardware"
            on_gpu = seconds(lambda: m.relight(weights, device="gpu"))
            print(f"on {found.name} ({kind}): {1e3 * on_gpu:.2f} ms, ratio {again / on_gpu:.2f}")


def status(name: str) -> float:
    """A figure of the process in MiB, as Linux has it."""
    return int(re.search(rf"{name}:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024


def slices(path: str) -> None:
    """The peak of resident memory, anonymous and with what is mapped, of slices of a file."""
    with ltm.open(path) as m:
        height, width, _, columns = m.shape
        print(f"{path}: {height} × {width} × 3 × {columns}, {m.nbytes / 2**30:.1f} GiB")
        cases: list[tuple[str, Callable[[], object]]] = [
            ("one column", lambda: m[..., columns // 2]),
            ("one row of pixels, one channel", lambda: m[height // 2, :, 1]),
            ("a square of 100 × 100 pixels, 64 columns", lambda: m[100:200, 100:200, :, :64]),
            ("40 blocks", lambda: [None for _ in zip(range(40), m.iter_blocks(), strict=False)]),
        ]
        for name, work in cases:
            before, peaks, done = (status("RssAnon"), status("VmRSS")), [0.0, 0.0], threading.Event()

            def watch(peaks: list[float] = peaks, done: threading.Event = done) -> None:
                while not done.wait(0.001):
                    peaks[:] = max(peaks[0], status("RssAnon")), max(peaks[1], status("VmRSS"))

            thread = threading.Thread(target=watch)
            thread.start()
            begun = time.perf_counter()
            work()
            took = time.perf_counter() - begun
            done.set()
            thread.join()
            print(
                f"{name}: {took:.2f} s, peak {peaks[0]:.0f} MiB anonymous (before {before[0]:.0f}), "
                f"{peaks[1]:.0f} MiB resident (before {before[1]:.0f})"
            )


def main() -> None:
    if sys.argv[1:2] == ["--slices"]:
        return slices(sys.argv[2])
    if sys.argv[1:2] == ["--program"]:
        return program(sys.argv[2])
    width, height, texels = (int(argument) for argument in sys.argv[1:4]) if len(sys.argv) > 3 else (256, 192, 16)
    products(width, height, texels)


if __name__ == "__main__":
    main()
