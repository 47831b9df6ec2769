"""Fits the lights of a container to a picture: intensities and colours, none below zero.

    python fit_lights.py room.ltc

hides a lighting, relights the container with it, and recovers it from the picture alone. For each colour channel the
least squares problem min ‖T w - x‖, w ≥ 0 is solved by scipy, which is given T and its transpose as products with the
factors: T itself is never in memory.
"""

import sys

import ltm
import numpy as np
from scipy.optimize import lsq_linear
from scipy.sparse.linalg import LinearOperator


def fit(m: ltm.Matrix, picture: np.ndarray) -> np.ndarray:
    """Weights (columns, 3) that light the matrix nearest to a picture (height, width, 3)."""
    height, width, _, columns = m.shape
    weights = np.zeros((columns, 3))
    # So that a picture that is dark or bright as a whole is fitted as closely.
    scale = float(np.abs(picture).max()) or 1.0
    for channel in range(3):

        def relight(w: np.ndarray, channel: int = channel) -> np.ndarray:
            lighting = np.zeros((columns, 3), np.float32)
            lighting[:, channel] = w.ravel()
            return m.relight(lighting)[..., channel].ravel().astype(float)

        def adjoint(x: np.ndarray, channel: int = channel) -> np.ndarray:
            image = np.zeros((height, width, 3), np.float32)
            image[..., channel] = x.reshape(height, width)
            return m.adjoint(image)[:, channel].astype(float)

        operator = LinearOperator((height * width, columns), matvec=relight, rmatvec=adjoint, dtype=float)
        target = picture[..., channel].ravel().astype(float) / scale
        # Lights that look alike take more steps than there are columns.
        steps = {"max_iter": 200, "lsmr_maxiter": 20 * columns + 100}
        found = lsq_linear(operator, target, bounds=(0, np.inf), lsq_solver="lsmr", tol=1e-10, **steps)
        weights[:, channel] = found.x * scale
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
