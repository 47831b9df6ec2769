"""Native half of the package: exact types only. Use what ``ltm`` exports."""

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__version__: str
BUILT_IN_SCENES: list[str]

class DamagedError(Exception):
    """A file is damaged or cut short: repair it or make it again."""

class NoGpuError(Exception):
    """A GPU was demanded and cannot be used."""

_Path = str | os.PathLike[str]
_Light = tuple[
    str, str, str, tuple[int, int], tuple[float, float, float], list[tuple[float, float, float]], list[float]
]
_Progress = Callable[[str, int, int], object] | None

class Native:
    closed: bool
    def __new__(
        cls, path: _Path, memory_bytes: int | None = None, gpu_memory_bytes: int | None = None
    ) -> Native: ...
    def close(self) -> None: ...
    def shape(self) -> tuple[int, int, int, int]: ...
    def lights(self) -> list[_Light]: ...
    def scene_weights(self) -> NDArray[np.float32]: ...
    def attrs(self) -> dict[str, Any]: ...
    def block(
        self, index: int
    ) -> tuple[tuple[int, int, int, int], bool, tuple[int, int, int, float, float] | None]: ...
    def features(self, variance: bool) -> NDArray[np.float32]: ...
    def passes(self, weights: NDArray[np.float32]) -> list[tuple[str, NDArray[np.float32]]]: ...
    def read(
        self, rows: list[int], across: list[int], channels: list[int], columns: list[int]
    ) -> NDArray[np.float32]: ...
    def relight(
        self, weights: NDArray[np.float32], region: tuple[int, int, int, int], out: NDArray[np.float32], device: str
    ) -> None: ...
    def adjoint(self, images: NDArray[np.float32]) -> NDArray[np.float32]: ...
    def look(self, path: _Path, name: str | None) -> NDArray[np.float32]: ...
    def weights_at(
        self,
        weights: NDArray[np.float32],
        climate: _Path,
        time: tuple[tuple[int, int], float],
        site: tuple[float, float],
    ) -> NDArray[np.float32]: ...
    def daylight(self, climate: _Path, choices: dict[str, Any], progress: _Progress) -> dict[str, Any]: ...

def glare(picture: NDArray[np.float32], turn: tuple[float, float], threshold: float, what: str) -> dict[str, Any]: ...
def gpu() -> tuple[str, bool] | None: ...
def pack_array(
    array: NDArray[np.float32],
    path: _Path,
    lights: list[_Light],
    source: str,
    block_side: int,
    choices: dict[str, Any],
    progress: _Progress,
) -> dict[str, Any]: ...
def write_array(
    array: NDArray[np.float32],
    path: _Path,
    lights: list[_Light],
    source: str,
    block_side: int,
    overwrite: bool,
    progress: _Progress,
) -> None: ...
def pack_store(matrix: _Path, path: _Path, choices: dict[str, Any], progress: _Progress) -> dict[str, Any]: ...
def write_basis(matrix: _Path, path: _Path, memory_bytes: int | None, progress: _Progress) -> int: ...
def render(
    scene: _Path | tuple[str, int, int, int],
    path: _Path,
    choices: dict[str, Any],
    pack: dict[str, Any] | None,
    progress: _Progress,
) -> dict[str, Any]: ...
class LiveRender:
    def __init__(
        self,
        scene: _Path | tuple[str, int, int, int],
        path: _Path,
        choices: dict[str, Any],
        pack: dict[str, Any],
        progress: _Progress,
    ) -> None: ...
    def next(self, progress: _Progress) -> dict[str, Any] | None: ...

def verify(path: _Path, progress: _Progress) -> tuple[int, list[str], int, int, float]: ...
def merge(parts: list[_Path], path: _Path, overwrite: bool, progress: _Progress) -> tuple[int, int]: ...
