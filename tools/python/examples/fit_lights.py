"""Fits the lights of a container to a picture: intensities and colours, none below zero.

    python fit_lights.py room.ltc

hides a lighting, relights the container with it, and recovers it from the picture alone. For each colour channel scipy solves the
least squares problem min ‖T w - x‖, w ≥ 0. T itself is never in memory: its inner products TᵀT, columns × columns, are made once
of a few images at a time, and each of some steps takes the slope Tᵀ(x - T w) of the picture that is still missing, so that the
result is not bound by the rounding of TᵀT.
"""

import sys

import ltm
import numpy as np
from scipy.optimize import lsq_linear

#: Images that are in memory at once.
IMAGES = 8
#: Eigenvalues of TᵀT that float32 tells from zero, over the largest.
TOLD_APART = 1e-6


def inner_products(m: ltm.Matrix) -> np.ndarray:
    """TᵀT of each channel: (3, columns, columns)."""
    units = np.repeat(np.eye(m.shape[3], dtype=np.float32)[..., None], 3, 2)
    parts = [m.adjoint(m.relight(units[first : first + IMAGES])) for first in range(0, len(units), IMAGES)]
    return np.concatenate(parts).transpose(2, 0, 1).astype(float)


def fit(m: ltm.Matrix, picture: np.ndarray, steps: int = 8) -> np.ndarray:
    """Weights (columns, 3) that light the matrix nearest to a picture (height, width, 3)."""
    weights = np.zeros((m.shape[3], 3))
    factors = []
    for products in inner_products(m):
        values, vectors = np.linalg.eigh(products)
        kept = values > TOLD_APART * values[-1]
        factors.append((np.sqrt(values[kept]), vectors[:, kept].T))
    for _ in range(steps):
        slope = m.adjoint(picture - m.relight(weights))
        for channel, (roots, vectors) in enumerate(factors):
            if len(roots) == 0:  # No light shines in this colour.
                continue
            missing = vectors @ slope[:, channel] / roots
            step = lsq_linear(roots[:, None] * vectors, missing, bounds=(-weights[:, channel] - 1e-12, np.inf), tol=1e-12)
            weights[:, channel] = np.maximum(weights[:, channel] + step.x, 0)
    return weights


def main() -> None:
    with ltm.open(sys.argv[1]) as m:
        random = np.random.default_rng(0)
        # Some lights are off.
        hidden = random.uniform(0, 3, (m.shape[3], 3)) * (random.random((m.shape[3], 1)) < 0.6)
        found = fit(m, m.relight(hidden))
        error = np.linalg.norm(m.relight(found) - m.relight(hidden)) / np.linalg.norm(m.relight(hidden))
        for light in m.lights:
            is_wanted, is_found = hidden[light.columns].mean(0), found[light.columns].mean(0)
            print(f"{light.name}: hidden {np.round(is_wanted, 3)}, found {np.round(is_found, 3)}")
        print(f"the pictures differ by {100 * error:.3f} %")


if __name__ == "__main__":
    main()
