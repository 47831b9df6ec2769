"""Measures the package beside the same work in numpy, in one run.

    python measure.py [width height lights]

Renders and packs a built-in room with a ceiling light of lights × lights texels, then relights it. numpy has the whole matrix
in memory as float32; its product is the matrix times the weights of each channel.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

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


def main() -> None:
    width, height, texels = (int(argument) for argument in sys.argv[1:4]) if len(sys.argv) > 3 else (256, 192, 16)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "room.ltc"
        report = ltm.render(ltm.BuiltIn("mixed", width, height, texels), path, samples=16, pack=True).packed
        print(f"{width} × {height}, {texels**2} texels: {report.raw_bytes} bytes, packed {report.packed_bytes}")
        print(f"open: {1e3 * seconds(lambda: ltm.open(path).close()):.2f} ms")
        with ltm.open(path) as m:
            columns = m.shape[3]
            random = np.random.default_rng(0)
            weights = random.random((256, columns, 3), np.float32)
            image = m.relight(weights[0])
            whole = np.ascontiguousarray(m.to_numpy().reshape(-1, 3, columns).transpose(1, 0, 2))
            planes = np.ascontiguousarray(image.reshape(-1, 3).T)
            rows = [
                ("relight", lambda: m.relight(weights[0]), lambda: [whole[c] @ weights[0, :, c] for c in range(3)]),
                ("adjoint", lambda: m.adjoint(image), lambda: [planes[c] @ whole[c] for c in range(3)]),
            ]
            for k in (16, 256):
                batch = weights[:k]
                own = [np.ascontiguousarray(batch[..., c].T) for c in range(3)]
                rows.append(
                    (f"{k} images", lambda b=batch: m.relight(b), lambda o=own: [whole[c] @ o[c] for c in range(3)])
                )
            rows.append(("one column", lambda: m[..., columns // 2], lambda: whole[..., columns // 2].copy()))
            for name, ours, numpys in rows:
                a, b = seconds(ours), seconds(numpys)
                print(f"{name}: {1e3 * a:.2f} ms, numpy {1e3 * b:.2f} ms, ratio {b / a:.2f}")


if __name__ == "__main__":
    main()
