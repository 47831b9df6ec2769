"""Making, checking and joining files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _ltm
from ._lights import Light, light_tuples, real_array
from ._matrix import Block, Matrix, open
from ._progress import Progress, told

_Path = str | os.PathLike[str]


@dataclass(frozen=True)
class PackReport:
    """What packing did. ``relative_l2`` is ‖T − T'‖/‖T‖ of the file against what was packed, measured to about 1 %."""

    seconds: float
    raw_bytes: int
    packed_bytes: int
    mean_rank: float
    sparse_entries: int
    relative_l2: float
    #: Entries that were not finite, or too large, and were replaced.
    replaced_entries: int
    #: Where the target was not reached: how near, as text.
    short_of_target: str | None
    #: Blocks that an earlier, interrupted run had done.
    blocks_kept: int


@dataclass(frozen=True)
class RenderReport:
    """What rendering did; ``packed`` is None for a stored matrix."""

    seconds: float
    rays: int
    blocks_traced: int
    #: Blocks that an earlier, interrupted run had done.
    blocks_kept: int
    #: Path contributions that were not finite and were dropped.
    non_finite: int
    packed: PackReport | None = None


@dataclass(frozen=True)
class Estimate:
    """One container of a progressive render: all lights, cleaned, at some resolution."""

    #: The container. That of an early estimate is replaced by the next.
    path: Path
    #: (height, width) in pixels.
    size: tuple[int, int]
    samples_per_pixel: int
    #: Whether it is the finished container.
    is_final: bool
    #: Stated error: estimated relative L2 of images of single lights against infinitely many samples; None where it is not known.
    error: float | None
    #: Seconds since the start.
    seconds: float
    #: Seconds since the start by which the finished container is expected; None where nothing is known yet.
    expected_seconds: float | None

    def open(self) -> Matrix:
        """Opens the container; close it as any other."""
        return open(self.path)


@dataclass(frozen=True)
class Verified:
    """What checking found; true if nothing is wrong."""

    blocks: int
    #: What is damaged, one line each.
    faults: list[str]
    #: Blocks that were never written.
    missing: int
    bytes: int
    seconds: float

    def __bool__(self) -> bool:
        return not self.faults


@dataclass(frozen=True)
class BuiltIn:
    """A scene that needs no file; names are in ``ltm.BUILT_IN_SCENES``. ``texels``: along each side of its light."""

    name: str = "mixed"
    width: int = 256
    height: int = 192
    texels: int = 32


def _output(path: _Path, overwrite: bool) -> str:
    path = os.path.abspath(os.fspath(path))
    if not overwrite and os.path.isfile(path):
        raise FileExistsError(f"{path}: exists already; choose another name, or overwrite=True")
    if not os.path.isdir(os.path.dirname(path)):
        raise FileNotFoundError(f"{path}: there is no folder {os.path.dirname(path)}")
    return path


def _choices(
    target: str | None,
    rank: int | None,
    keep_noise: bool,
    denoise: bool,
    basis: _Path | None,
    overwrite: bool,
    memory: int | None,
) -> dict[str, Any]:
    if target is not None and not isinstance(target, str):
        raise TypeError("target: is text, as '45dB', '0.01' or '2MiB'")
    return {
        "target": target,
        "rank": rank,
        "keep_noise": keep_noise,
        "denoise": denoise,
        "basis": basis,
        "overwrite": overwrite,
        "memory_bytes": memory,
    }


def _images(
    images: Any, size: tuple[int, int] | None, folder: str, are_named: bool
) -> tuple[NDArray[np.float32], Any]:
    """Images as one array in C order, those of an iterator in a file beside the output; ``are_named``: the lights are."""
    if isinstance(images, (np.ndarray, Sequence)) or hasattr(images, "__array__"):
        if size is not None:
            raise ValueError("size: is for blocks from an iterator; an array has its own")
        array = real_array(images, "images")
        if array.ndim != 4 or array.shape[3] != 3 or 0 in array.shape:
            is_last = array.ndim == 4 and array.shape[2] == 3
            turn = "; numpy.moveaxis(a, -1, 0) turns what ltm.open gives" if is_last else ""
            raise ValueError(f"images: have the shape {array.shape}, not (lights, height, width, 3){turn}")
        if array.shape[2] == 3 and array.shape[1] > 3 and not are_named:
            raise ValueError(
                f"images: have the shape {array.shape}: as many lights of images 3 pixels wide, or 3 lights in the "
                "order of ltm.open; give lights=[their names], or numpy.moveaxis(a, -1, 0)"
            )
        return np.ascontiguousarray(array), None
    if not isinstance(images, Iterable):
        raise TypeError(
            "images: give an array (lights, height, width, 3), an iterable of images or blocks, or the path of a .ltm"
        )
    import tempfile  # Not for every import of this package.

    spill = tempfile.TemporaryFile(dir=folder)
    try:
        return (_spill_images(images, spill) if size is None else _spill_blocks(images, size, spill)), spill
    except BaseException:
        spill.close()
        raise


def _spill_images(images: Iterable[Any], spill: Any) -> NDArray[np.float32]:
    """Images from an iterator, one a light, as an array in a file."""
    count, shape = 0, None
    for image in images:
        image = real_array(image, f"image {count}")
        shape = image.shape if shape is None else shape
        if image.ndim != 3 or image.shape != shape or shape[2] != 3 or 0 in shape:
            wanted = shape if count else "(height, width, 3)"
            raise ValueError(f"image {count}: has the shape {image.shape}, not {wanted}")
        spill.write(np.ascontiguousarray(image).tobytes())
        count += 1
    if shape is None:
        raise ValueError("images: there are none")
    spill.flush()
    return np.memmap(spill, np.float32, "r", shape=(count, *shape))


def _spill_blocks(blocks: Iterable[Any], size: tuple[int, int], spill: Any) -> NDArray[np.float32]:
    """Blocks from an iterator, each ((y, x) or a Block, entries (h, w, 3, columns)), as an array in a file."""
    height, width = size
    array: NDArray[np.float32] | None = None
    covered = np.zeros((height, width), bool)
    for at, entries in blocks:
        y, x = (at.y, at.x) if isinstance(at, Block) else at
        entries = real_array(entries, f"block at {y}, {x}")
        if entries.ndim != 4 or entries.shape[2] != 3 or 0 in entries.shape:
            raise ValueError(f"block at {y}, {x}: has the shape {entries.shape}, not (height, width, 3, columns)")
        rows, across, _, columns = entries.shape
        if array is None:
            array = np.memmap(spill, np.float32, "w+", shape=(columns, height, width, 3))
        if columns != array.shape[0]:
            raise ValueError(f"block at {y}, {x}: has {columns} columns, those before it {array.shape[0]}")
        place = np.s_[y : y + rows, x : x + across]
        if y < 0 or x < 0 or y + rows > height or x + across > width or covered[place].any():
            raise ValueError(f"block at {y}, {x}: reaches beyond the {height} × {width} pixels, or over another block")
        covered[place] = True
        array[(slice(None), *place)] = entries.transpose(3, 0, 1, 2)
    if array is None or not covered.all():
        raise ValueError(f"blocks: {height * width - int(covered.sum())} pixels are in none")
    return array


def pack(
    images: Any,
    path: _Path,
    *,
    lights: Sequence[str | Light] | None = None,
    target: str | None = None,
    rank: int | None = None,
    keep_noise: bool = False,
    denoise: bool = True,
    basis: _Path | None = None,
    size: tuple[int, int] | None = None,
    source: str = "array",
    block_side: int = 32,
    overwrite: bool = False,
    memory: int | None = None,
    progress: Progress = None,
) -> PackReport:
    """Compresses a matrix into a container (``.ltc``).

    ``images``: an array (lights, height, width, 3) of linear radiance, any real dtype and order; an iterable of images
    (height, width, 3), one a light; with ``size`` (height, width) an iterable of blocks, each ``((y, x), entries)`` or as
    :meth:`Matrix.iter_blocks` gives them, entries (block height, block width, 3, columns), in any order and together all
    pixels once; or the path of a stored matrix (``.ltm``). What an iterable gives waits in a temporary file beside ``path``.
    ``lights``: a name for each column, or :class:`Light` for lights of several.

    ``target``: "45dB" (PSNR), "0.01" (relative L2 error), "2MiB" (size); None: as near as the noise lets it be of use.
    ``rank``: components of a block at most. ``keep_noise``: follow the matrix through its noise. ``denoise``: clean the
    images first, where a renderer kept the samples apart. ``basis``: images of :func:`write_basis` that another denoiser
    has denoised, of a ``.ltm``. Ctrl-C keeps what is analysed; the same call continues.

    Entries that are not finite are replaced and counted in the report. Raises ValueError for shapes and names,
    FileExistsError, FileNotFoundError, MemoryError for a budget, KeyboardInterrupt.
    """
    path = _output(path, overwrite)
    choices = _choices(target, rank, keep_noise, denoise, basis, overwrite, memory)
    if isinstance(images, Matrix):
        images = images.path
    if isinstance(images, (str, os.PathLike)):
        if lights is not None or size is not None:
            raise ValueError(f"{'size' if lights is None else 'lights'}: a stored matrix has its own")
        return PackReport(**_ltm.pack_store(images, path, choices, told(progress)))
    array, spill = _images(images, size, os.path.dirname(path), lights is not None)
    try:
        tuples = light_tuples(lights, array.shape[0])
        return PackReport(**_ltm.pack_array(array, path, tuples, source, block_side, choices, told(progress)))
    finally:
        if spill is not None:
            spill.close()


def write(
    images: Any,
    path: _Path,
    *,
    lights: Sequence[str | Light] | None = None,
    size: tuple[int, int] | None = None,
    source: str = "array",
    block_side: int = 32,
    overwrite: bool = False,
    progress: Progress = None,
) -> None:
    """Writes a matrix as it is (``.ltm``); ``images``, ``lights`` and ``size`` as for :func:`pack`. Raises as :func:`pack`."""
    path = _output(path, overwrite)
    array, spill = _images(images, size, os.path.dirname(path), lights is not None)
    try:
        tuples = light_tuples(lights, array.shape[0])
        _ltm.write_array(array, path, tuples, source, block_side, overwrite, told(progress))
    finally:
        if spill is not None:
            spill.close()


def write_basis(
    matrix: _Path, path: _Path, *, overwrite: bool = False, memory: int | None = None, progress: Progress = None
) -> int:
    """Writes the images that denoising works on, with albedo, normals and depth, of a rendered ``.ltm`` as one OpenEXR file:
    layers ``basis.00`` onwards. Denoised by a denoiser of your choice they are ``basis`` of :func:`pack`. Says how many.

    Raises FileExistsError, FileNotFoundError, ValueError for a matrix that does not know its samples, DamagedError,
    MemoryError, KeyboardInterrupt.
    """
    path = _output(path, overwrite)
    return _ltm.write_basis(os.fspath(matrix), path, memory, told(progress))


def _scene(scene: _Path | BuiltIn) -> Any:
    return (scene.name, scene.width, scene.height, scene.texels) if isinstance(scene, BuiltIn) else os.fspath(scene)


def _render_choices(
    samples: int | None,
    size: tuple[int, int] | None,
    seed: int | None,
    block_side: int | None,
    camera: str | None,
    allow_missing: bool,
    allow_outside: bool,
    overwrite: bool,
    memory: int | None,
) -> dict[str, Any]:
    return {
        "samples": samples,
        "size": None if size is None else (size[1], size[0]),
        "seed": seed,
        "block_side": block_side,
        "camera": camera,
        "allow_missing": allow_missing,
        "allow_outside": allow_outside,
        "overwrite": overwrite,
        "memory_bytes": memory,
    }


def render(
    scene: _Path | BuiltIn,
    path: _Path,
    *,
    samples: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    block_side: int | None = None,
    camera: str | None = None,
    allow_missing: bool = False,
    allow_outside: bool = False,
    pack: bool = False,
    target: str | None = None,
    rank: int | None = None,
    keep_noise: bool = False,
    denoise: bool = True,
    basis: _Path | None = None,
    overwrite: bool = False,
    memory: int | None = None,
    progress: Progress = None,
) -> RenderReport:
    """Renders a scene file (``.toml``, ``.glb``, ``.gltf``), or a :class:`BuiltIn` scene, into a matrix (``.ltm``) or, with
    ``pack``, a container (``.ltc``).

    ``samples``: paths a pixel; ``size``: (height, width) in pixels; what is None is as the scene says. ``camera``: of a glTF
    file, by name. ``allow_missing``: textures may be missing. ``allow_outside``: files outside of the scene's folder and of
    ``LTM_SCENES`` may be read, for scenes whose author you trust. ``target``, ``rank``, ``keep_noise``, ``denoise`` and
    ``basis`` are those of :func:`pack`. Warnings go to the logger ``ltm``. Ctrl-C keeps the finished blocks; the same call
    continues.

    Raises FileNotFoundError, ValueError for a scene that cannot be used, FileExistsError, MemoryError, KeyboardInterrupt.
    """
    path = _output(path, overwrite)
    if path.lower().endswith(".ltc") != pack:
        raise ValueError(f"{path}: a packed render ends with .ltc and is asked for with pack=True")
    packing = _choices(target, rank, keep_noise, denoise, basis, overwrite, memory) if pack else None
    given = _scene(scene)
    choices = _render_choices(samples, size, seed, block_side, camera, allow_missing, allow_outside, overwrite, memory)
    said = _ltm.render(given, path, choices, packing, told(progress))
    own = {key: said.pop(key) for key in ("rays", "blocks_traced", "non_finite")}
    seconds, kept = said["seconds"], said.pop("blocks_kept")
    packed = PackReport(blocks_kept=kept, **said) if pack else None
    return RenderReport(seconds=seconds, blocks_kept=kept, packed=packed, **own)


def render_live(
    scene: _Path | BuiltIn,
    path: _Path,
    *,
    samples: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    block_side: int | None = None,
    camera: str | None = None,
    allow_missing: bool = False,
    allow_outside: bool = False,
    target: str | None = None,
    rank: int | None = None,
    overwrite: bool = False,
    memory: int | None = None,
    progress: Progress = None,
) -> Iterator[Estimate]:
    """Renders a scene into a container, with estimates of all lights from the first seconds on.

    >>> for estimate in ltm.render_live("room.toml", "room.ltc"):
    ...     with estimate.open() as m:
    ...         image = m.relight({"lamp *": 2.0})
    ...     print(estimate.size, estimate.samples_per_pixel, estimate.error)

    The resolution doubles up to the full one, then the samples double; all early estimates together take at most 15 % of the time.
    They are containers beside ``path`` (``room.early.ltc``), each in the place of the one before; the last is ``path``, with the bytes
    that ``render(..., pack=True)`` gives. A loop that is left, or Ctrl-C, keeps what is there; the same call continues, and gives a
    container that is finished at once. The arguments are those of :func:`render`.
    """
    path = os.path.abspath(os.fspath(path))
    if not path.lower().endswith(".ltc"):
        raise ValueError(f"{path}: the name of a container ends with .ltc")
    packing = _choices(target, rank, False, True, None, overwrite, memory)
    choices = _render_choices(samples, size, seed, block_side, camera, allow_missing, allow_outside, overwrite, memory)
    hear = told(progress)
    render = _ltm.LiveRender(_scene(scene), path, choices, packing, hear)
    while (said := render.next(hear)) is not None:
        yield Estimate(path=Path(said.pop("path")), **said)


def verify(path: _Path, *, progress: Progress = None) -> Verified:
    """Reads and checks every byte of a file; what is damaged is listed. Raises if it cannot even be opened."""
    return Verified(*_ltm.verify(os.fspath(path), told(progress)))


def info(path: _Path) -> dict[str, Any]:
    """What a file says of itself: :attr:`Matrix.attrs`, its shape, and the names of its lights."""
    with open(path) as m:
        return {"shape": m.shape, "lights": list(m.lights.keys()), **m.attrs}


def merge(parts: Iterable[_Path], path: _Path, *, overwrite: bool = False, progress: Progress = None) -> int:
    """Joins files that hold blocks of one job; says how many blocks the result lacks.

    Raises ValueError for parts of different jobs, FileExistsError for a container that exists, DamagedError.
    """
    if str(path).lower().endswith(".ltc"):
        path = _output(path, overwrite)
    return _ltm.merge([os.fspath(part) for part in parts], os.fspath(path), overwrite, told(progress))[1]
