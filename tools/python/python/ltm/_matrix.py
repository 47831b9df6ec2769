"""An open matrix: slices, relighting, and the adjoint."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _ltm
from ._daylight import DaylightYear
from ._lights import Lights, real_array
from ._progress import Progress, told

#: Most bytes that ``numpy.asarray`` makes of a matrix without being told to.
ASARRAY_BYTES = 1 << 30


@dataclass(frozen=True)
class Block:
    """One block: a square of pixels with all channels and columns. What a stored matrix does not know is None."""

    index: int
    x: int
    y: int
    width: int
    height: int
    #: Whether the file holds it; one of a range of blocks does not hold all.
    present: bool
    #: Components, and entries kept beside them.
    rank: int | None = None
    sparse_entries: int | None = None
    #: Bytes in the file.
    bytes: int | None = None
    #: Stated relative L2 error against the matrix that was packed, and variance of that one's noise; NaN if not known.
    relative_error: float | None = None
    noise_variance: float | None = None


class Blocks(Sequence[Block]):
    """The blocks of a matrix, row by row from the top left."""

    def __init__(self, matrix: Matrix) -> None:
        self._matrix = matrix
        side = matrix.block_side
        self._count = -(-matrix.shape[0] // side) * -(-matrix.shape[1] // side)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        i = range(len(self))[index]
        (x, y, width, height), present, known = self._matrix._native.block(i)
        return Block(i, x, y, width, height, present, *(known or ()))


class Look:
    """Lightings in a look file (TOML or JSON): rules by light name, over the lights of a matrix."""

    def __init__(self, path: str | os.PathLike[str], name: str | None = None) -> None:
        self.path = os.path.abspath(os.fspath(path))
        self.name = name

    @classmethod
    def read(cls, path: str | os.PathLike[str], name: str | None = None) -> Look:
        """The look of a file, or one of its further looks by name.

        Raises FileNotFoundError. What the file says is read and checked by :meth:`to_weights`.
        """
        with _open_file(path, "rb"):
            return cls(path, name)

    def to_weights(self, m: Matrix) -> NDArray[np.float32]:
        """Weights (columns, 3) for a matrix. Raises ValueError, naming the place, for what does not fit it."""
        return m._native.look(self.path, self.name)

    def __repr__(self) -> str:
        return f"ltm.Look({self.path!r}{'' if self.name is None else f', {self.name!r}'})"


#: Where the planes of features lie that have three, and one.
_VECTORS = {"albedo": 0, "normal": 3, "pixel_albedo": 11}
_SCALARS = {"depth": 6, "emitter": 7, "specular": 8, "surface": 9, "material": 10}


def _open_file(path: Any, mode: str) -> Any:
    return os.fdopen(os.open(path, os.O_RDONLY), mode)


class Matrix:
    """An open light transport matrix; made by :func:`ltm.open`.

    Usable from many threads. Pickles as its path. After :meth:`close` every use raises ValueError.
    """

    #: Entries are float32, whatever the file stores.
    dtype = np.dtype(np.float32)
    ndim = 4

    def __init__(
        self, path: str | os.PathLike[str], memory: int | None = None, gpu_memory: int | None = None
    ) -> None:
        path = os.fspath(path)
        self.path = path if path.startswith("s3://") else os.path.abspath(path)
        self._memory = (memory, gpu_memory)
        self._native = _ltm.Native(self.path, memory, gpu_memory)
        height, width, columns, self.block_side = self._native.shape()
        #: Height and width in pixels, channels, columns.
        self.shape = (height, width, 3, columns)
        self._lights: Lights | None = None

    def __enter__(self) -> Matrix:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file. Work of other threads that is under way ends first."""
        self._native.close()

    @property
    def closed(self) -> bool:
        """Whether the matrix is closed."""
        return self._native.closed

    def __reduce__(self) -> Any:
        if self.closed:
            raise ValueError(f"{self.path}: the matrix is closed")
        return (open, (self.path, *self._memory))

    def __repr__(self) -> str:
        height, width, _, columns = self.shape
        return f"<ltm.Matrix {self.path!r}: {height} × {width} × 3 × {columns}{', closed' if self.closed else ''}>"

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(np.prod(self.shape, dtype=object))

    @property
    def nbytes(self) -> int:
        """Bytes of all entries as float32."""
        return self.size * 4

    @property
    def lights(self) -> Lights:
        """The lights, whose columns follow each other: a sequence that is also a mapping by name."""
        if self._lights is None:
            self._lights = Lights(self._native.lights())
        return self._lights

    @property
    def blocks(self) -> Blocks:
        """The blocks with their ranks, bytes and stated errors."""
        return Blocks(self)

    @property
    def attrs(self) -> dict[str, Any]:
        """What the file says of itself: job, source, program, settings, samples, seed; ``camera``, in the keys of a scene file,
        None where the file does not state it (an import, a part of a picture, a file of an older version); of a container also
        how it was packed and where its error figures come from."""
        return self._native.attrs()

    @property
    def scene_weights(self) -> NDArray[np.float32]:
        """Weights (columns, 3) of the scene's own lighting."""
        return self._native.scene_weights()

    def features(self, variance: bool = False) -> dict[str, NDArray[np.float32]]:
        """What the pixels of a rendered ``.ltm`` show beside light, at the first surface that scatters, behind mirrors and smooth glass:
        ``albedo`` and ``normal`` (height, width, 3; world space), ``depth`` (length of the path in scene units), and the shares of
        the samples that show an ``emitter``, came by a mirror or glass (``specular``), and end on a ``surface`` (height, width). All are
        means over the samples, of which those without a surface count as zero: ``depth / surface`` is the mean over those that have one.
        ``material`` is the number of the first sample's material, from 1 on in the scene's order; 0 is none, or not known.
        ``pixel_albedo`` is the albedo by further camera rays, which see fine textures and edges with less noise.

        With ``variance``, the variances of those means instead, as if samples were independent; of a material's number, it is zero
        where all samples show one material.

        Raises ValueError for a container, an import, or a matrix of one sample; DamagedError; MemoryError.
        """
        planes = self._native.features(variance)
        colours = {name: np.ascontiguousarray(np.moveaxis(planes[at : at + 3], 0, 2)) for name, at in _VECTORS.items()}
        return colours | {name: planes[at].copy() for name, at in _SCALARS.items()}

    def passes(self, weights: ArrayLike | Mapping[str, Any] | Look) -> dict[str, NDArray[np.float32]]:
        """How the light of a rendered ``.ltm`` came to its pixels under one lighting: ``emission`` (emitters in view, straight or by
        mirrors and smooth glass), ``direct`` (of one surface that scatters, come to it straight or through thin sheets) and
        ``indirect`` (all else), float32 (height, width, 3), which sum up to :meth:`relight`. ``weights`` are as there.

        Emission is exact. The rest is shared out as it is for clusters of columns, each under the mean weight of its columns: exact
        where each is lit evenly, as always with up to 80 columns, and near it otherwise.

        Raises ValueError for a container, an import, a matrix of one sample, or several lightings; DamagedError; MemoryError.
        """
        return dict(self._native.passes(self.weights(weights)))

    # Entries

    def __getitem__(self, key: Any) -> Any:
        """Entries as float32, indexed as a numpy array of :attr:`shape`; only the blocks that are touched are read.

        Each axis takes an int, a slice, or a list or array of ints or booleans; several lists choose the product of their
        indices (as ``numpy.ix_``). The last axis also takes a light's name or glob, or a list of such: a name of a light
        with one column drops the axis, all else keeps it. Raises IndexError, KeyError for names, MemoryError.
        """
        key = key if isinstance(key, tuple) else (key,)
        if sum(part is Ellipsis for part in key) > 1:
            raise IndexError("an index can only have a single ellipsis ('...')")
        at = next((i for i, part in enumerate(key) if part is Ellipsis), len(key))
        named = len(key) - (at < len(key))
        if named > 4:
            raise IndexError(f"too many indices: the matrix has 4 axes, {named} were indexed")
        key = (*key[:at], *[slice(None)] * (4 - named), *key[at + 1 :])
        if isinstance(key[3], str) or (isinstance(key[3], list) and any(isinstance(k, str) for k in key[3])):
            key = (*key[:3], self._columns(key[3]))
        wanted, places = [], []
        for axis, part in enumerate(key):
            indices, place = _indices(part, self.shape[axis], axis)
            wanted.append(indices)
            places.append(place)
        entries = self._native.read(*wanted)
        for axis, place in enumerate(places):
            if isinstance(place, np.ndarray):
                entries = np.take(entries, place, axis)
            elif isinstance(place, slice):
                entries = entries[(slice(None),) * axis + (place,)]
        drop = tuple(0 if place is None else slice(None) for place in places)
        entries = entries[drop]
        return entries[()] if entries.ndim == 0 else np.ascontiguousarray(entries)

    def _columns(self, names: Any) -> Any:
        if isinstance(names, str):
            lights = self.lights.match(names)
            if names in self.lights.keys() and len(lights[0].columns) == 1:
                return lights[0].columns.start
            names = [names]
        columns: list[int] = []
        for name in names:
            columns += (
                [c for light in self.lights.match(name) for c in light.columns] if isinstance(name, str) else [name]
            )
        return columns

    def to_numpy(self, max_bytes: int | None = None) -> NDArray[np.float32]:
        """All entries, (height, width, 3, columns). Raises MemoryError above ``max_bytes`` or what the system has."""
        if max_bytes is not None and self.nbytes > max_bytes:
            raise MemoryError(
                f"{self.path}: the matrix has {self.nbytes / 2**30:.1f} GiB, more than {max_bytes / 2**30:.1f} GiB; take a "
                "slice, iterate over blocks, or call to_numpy()"
            )
        entries: NDArray[np.float32] = self[...]
        return entries

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False:
            raise ValueError("the entries are not in memory: they can only be copied")
        entries = self.to_numpy(ASARRAY_BYTES)
        return entries if dtype is None else entries.astype(dtype, copy=False)

    def __dlpack__(self, **how: Any) -> Any:
        """All entries by the DLPack protocol, copied; refuses what :func:`numpy.asarray` refuses."""
        return self.__array__().__dlpack__(**how)

    def __dlpack_device__(self) -> tuple[int, int]:
        """The CPU."""
        return (1, 0)

    def iter_blocks(self) -> Iterator[tuple[Block, NDArray[np.float32]]]:
        """Each block with its entries, (block height, block width, 3, columns).

        Holds one block: at most ``4 · 3 · block_side² · columns`` bytes and what decoding one takes, about as much.
        """
        for block in self.blocks:
            yield block, self[block.y : block.y + block.height, block.x : block.x + block.width]

    def to_xarray(self, **key: Any) -> Any:
        """All entries, or those of ``key`` by dimension, as an ``xarray.DataArray`` with the dimensions y, x, channel,
        light. Raises ModuleNotFoundError without xarray."""
        import xarray

        dims = ("y", "x", "channel", "light")
        if unknown := set(key) - set(dims):
            raise ValueError(f"dimensions are {', '.join(dims)}, not {', '.join(sorted(unknown))}")
        column_names = [
            light.name if len(light.columns) == 1 else f"{light.name}[{i}]"
            for light in self.lights
            for i in range(len(light.columns))
        ]
        coords = [np.arange(self.shape[0]), np.arange(self.shape[1]), np.array(["r", "g", "b"]), np.array(column_names)]
        parts = [key.get(dim, slice(None)) for dim in dims]
        parts[3] = self._columns(parts[3]) if isinstance(parts[3], (str, list)) else parts[3]
        kept = {dim: coord[part] for dim, coord, part in zip(dims, coords, parts, strict=True)}
        entries = self[tuple(parts)]
        left = {dim: coord for dim, coord in kept.items() if np.ndim(coord)}
        return xarray.DataArray(entries, dims=list(left), coords=kept, name="ltm", attrs=self.attrs)

    # Products

    def weights(self, weights: Any) -> NDArray[np.float32]:
        """Weights as :meth:`relight` takes them, as an array (columns, 3) or (k, columns, 3)."""
        columns = self.shape[3]
        if isinstance(weights, Look):
            return weights.to_weights(self)
        if isinstance(weights, Mapping) and not isinstance(weights, Lights):
            return self.lights.weights(weights)
        array = real_array(weights, "weights")
        if array.shape == (columns,):
            array = np.repeat(array[:, None], 3, 1)
        if array.ndim not in (2, 3) or array.shape[-2:] != (columns, 3):
            raise ValueError(
                f"weights: have the shape {array.shape}; the matrix takes ({columns},), ({columns}, 3) or k × {columns} × 3"
            )
        return np.ascontiguousarray(array)

    def relight(
        self,
        weights: ArrayLike | Mapping[str, Any] | Look,
        roi: tuple[Any, Any] | None = None,
        out: NDArray[np.float32] | None = None,
        device: str = "auto",
    ) -> NDArray[np.float32]:
        """The image under a lighting: float32 (height, width, 3), linear Rec. 709.

        ``weights``: (columns,), the same for each channel; (columns, 3); a dict by light name or glob, see
        :meth:`Lights.weights`; or a :class:`Look`. (k, columns, 3) gives k images, (k, height, width, 3), in one pass over
        the factors. Weights are in the unit of each light.

        ``roi``: (rows, columns) of pixels as slices without steps, ``numpy.s_[y0:y1, x0:x1]``; only its blocks are worked
        on. ``out``: a float32 array of the result's shape in C order, which is set and returned.

        ``device``: "cpu", "gpu", or "auto": a GPU that is no software adapter, if it relit the scene's own lighting faster
        than the CPU when this was first asked. "gpu" takes any adapter (see :func:`ltm.gpu`) and relights containers only.
        Images of the two differ by rounding.

        The first call reads the factors of a container and keeps them if they fit the memory. Raises ValueError for
        shapes and for weights that are not finite, DamagedError, NoGpuError where "gpu" cannot be had.
        """
        array = self.weights(weights)
        y, x = (slice(None), slice(None)) if roi is None else roi
        y, x = _bounds(y, self.shape[0], "rows"), _bounds(x, self.shape[1], "columns")
        shape = (*array.shape[:-2], y.stop - y.start, x.stop - x.start, 3)
        if out is None:
            out = np.empty(shape, np.float32)
        elif not isinstance(out, np.ndarray) or out.dtype != np.float32:
            raise TypeError("out: is not an array of float32")
        elif out.shape != shape or not out.flags.c_contiguous or not out.flags.writeable:
            raise ValueError(f"out: is not a writeable array of the shape {shape} in C order")
        if device not in ("auto", "cpu", "gpu"):
            raise ValueError(f"device: '{device}' is none of auto, cpu, gpu")
        if 0 in shape:
            return out
        self._native.relight(array, (x.start, y.start, shape[-2], shape[-3]), out, device)
        return out

    def weights_at(
        self,
        climate: str | os.PathLike[str],
        month: int,
        day: int,
        hour: float,
        *,
        weights: ArrayLike | Mapping[str, Any] | Look | None = None,
        north: float = 0.0,
        ground: float = 0.2,
    ) -> NDArray[np.float32]:
        """Weights (columns, 3) with the scene's sky and sun as at an hour of the site's time in a climate, an EPW or WEA file; all other
        lights as in ``weights`` (the scene's own lighting). ``north`` is how far the scene's north (−z) is turned towards east, in
        degrees, ``ground`` the reflectance of the ground below the horizon.

        >>> noon = m.weights_at("munich.epw", 6, 21, 12.5)
        >>> image = m.relight(noon)

        Raises ValueError for a matrix without a sky, or a day that the climate does not have.
        """
        lamps = self.scene_weights if weights is None else self.weights(weights)
        if lamps.ndim != 2:
            raise ValueError("weights: give one lighting")
        return self._native.weights_at(lamps, os.fspath(climate), ((month, day), hour), (north, ground))

    def daylight(
        self,
        climate: str | os.PathLike[str],
        *,
        hours: tuple[float, float] = (8, 18),
        months: tuple[int, int] = (1, 12),
        autonomy: float = 300.0,
        north: float = 0.0,
        ground: float = 0.2,
        progress: Progress = None,
    ) -> DaylightYear:
        """A year of a climate, an EPW or WEA file, over the pixels or sensors of a matrix whose rows are irradiance: what ``ltm daylight``
        renders, or a scene with ``irradiance = true`` in its ``[camera]``. The time of use is ``hours`` of all days in ``months``,
        ``autonomy`` the illuminance of daylight autonomy in lx; ``north`` and ``ground`` are as in :meth:`weights_at`.

        Raises ValueError for a matrix of radiance, or one without a sky; DamagedError; MemoryError.
        """
        choices = {"hours": hours, "months": months, "autonomy": autonomy, "north": north, "ground": ground}
        return DaylightYear(**self._native.daylight(os.fspath(climate), choices, told(progress)))

    def adjoint(self, image: ArrayLike, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """``Tᵀ x`` for each channel: float32 (columns, 3).

        Row j is the sum over all pixels of column j times the image; ``<relight(w), x> == <w, adjoint(x)>`` to rounding.
        ``image``: (height, width, 3); (k, height, width, 3) gives (k, columns, 3) in one pass over the factors. ``out``: an
        array of the result's shape, which is set and returned.

        Raises ValueError for another shape and for values that are not finite, DamagedError.
        """
        array = real_array(image, "image")
        if array.ndim not in (3, 4) or array.shape[-3:] != self.shape[:3]:
            raise ValueError(f"image: has the shape {array.shape}; the matrix takes {self.shape[:3]} or k of them")
        shape = (*array.shape[:-3], self.shape[3], 3)
        if out is not None and (not isinstance(out, np.ndarray) or out.shape != shape):
            raise ValueError(f"out: is not an array of the shape {shape}")
        sums = self._native.adjoint(np.ascontiguousarray(array)).reshape(shape)
        if out is None:
            return sums
        out[...] = sums
        return out


def _bounds(part: Any, size: int, what: str) -> slice:
    if not isinstance(part, slice) or part.step not in (None, 1):
        raise ValueError(f"roi: its {what} are not a slice without a step; give numpy.s_[y0:y1, x0:x1]")
    start, stop, _ = part.indices(size)
    return slice(start, max(start, stop))


def _indices(part: Any, size: int, axis: int) -> tuple[list[int], Any]:
    """Ascending indices to read, and what makes of them what was asked for: None drops the axis."""
    if isinstance(part, slice):
        found = range(*part.indices(size))
        return (list(found), ...) if found.step > 0 else (list(reversed(found)), slice(None, None, -1))
    if part is None:
        raise IndexError("a new axis cannot be made in the index; index the result")
    array = np.asarray(part)
    if array.dtype == bool and array.shape == (size,):
        return np.flatnonzero(array).tolist(), ...
    if array.size == 0 and array.ndim == 1:
        return [], ...
    if array.dtype.kind not in "iu" or array.ndim > 1:
        raise IndexError(f"axis {axis}: takes an int, a slice, a list of ints, or {size} booleans")
    if ((array < -size) | (array >= size)).any():
        bad = array if array.ndim == 0 else array[(array < -size) | (array >= size)][0]
        raise IndexError(f"index {bad} is out of bounds for axis {axis} with size {size}")
    array = np.where(array < 0, array + size, array)
    if array.ndim == 0:
        return [int(array)], None
    unique, inverse = np.unique(array, return_inverse=True)
    return unique.tolist(), inverse


@dataclass(frozen=True)
class Gpu:
    """An adapter that relights."""

    #: Its name and its driver's interface.
    name: str
    #: Whether it computes on the processor, slower than ``device="cpu"``.
    is_software: bool


def gpu() -> Gpu | None:
    """The adapter that ``device="gpu"`` relights on; None where there is none."""
    found = _ltm.gpu()
    return None if found is None else Gpu(*found)


def open(  # noqa: A001
    path: str | os.PathLike[str], memory: int | None = None, gpu_memory: int | None = None
) -> Matrix:
    """Opens a stored matrix (``.ltm``) or a container (``.ltc``) to read it; a context manager.

    A container may lie in an object store, ``"s3://bucket/room.ltc"``: only what is wanted of it is fetched. The store is found and
    entered by the environment, ``AWS_ENDPOINT_URL``, ``AWS_ACCESS_KEY_ID`` and the like.

    ``memory``: bytes to stay within, for factors that are kept and for slices; None: what the system has. ``gpu_memory``:
    the same of the GPU's memory. Raises FileNotFoundError, ValueError for a file that is neither, DamagedError.
    """
    return Matrix(path, memory, gpu_memory)
