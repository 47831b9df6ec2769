"""Codes a matrix with a general codec at several sizes and relights what comes back.

The folder named by the first argument holds description.json, matrix.f32 (columns × colours × height × width) and
weights.f32 (lightings × columns × colours), both little-endian. The second argument names the codec, the third and fourth
are bytes: levels are taken, each half of another, until files lie on both sides of both. Of the level of index I and the
lighting L it writes I-L.f32 (RGB, row by row) and prints the bytes and the seconds of coding. Texels of a light that has more than
a row of them are two dimensions.
"""
import io
import json
import lzma
import os
import sys
import time

import numpy as np

folder, codec, least, most = sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4])
with open(os.path.join(folder, "description.json")) as file:
    described = json.load(file)
height, width, grids = described["height"], described["width"], described["grids"]
matrix = np.fromfile(os.path.join(folder, "matrix.f32"), "<f4").reshape(-1, 3, height, width)
weights = np.fromfile(os.path.join(folder, "weights.f32"), "<f4").reshape(-1, len(matrix), 3)


def through_hdf5(array, filter):
    """Bytes of an array as one chunk, and what a reader gets of it."""
    import h5py

    with h5py.File("x", "w", driver="core", backing_store=False) as file:
        file.create_dataset("x", data=array, chunks=array.shape, compression=filter)
        file.flush()
        image, size = file.id.get_file_image(), file["x"].id.get_storage_size()
    with h5py.File(io.BytesIO(image), "r") as file:
        return size, file["x"][...]


def sz3(array, level):
    """One absolute bound, in four dimensions."""
    import hdf5plugin

    return through_hdf5(array, hdf5plugin.SZ3(absolute=float(largest * level)))


def sperr(array, level):
    """A mean squared error, in three dimensions, which is what the codec has."""
    import hdf5plugin

    flat = np.ascontiguousarray(array.reshape(-1, height, width))
    spread = float(flat.max() - flat.min())
    decibels = 20 * np.log10(spread / (largest * level)) if spread > 0 else 0
    if len(flat) == 1:
        flat = flat[0]
    if decibels <= 1:
        return 8, np.full(array.shape, flat.mean())
    size, back = through_hdf5(flat, hdf5plugin.Sperr(peak_signal_to_noise_ratio=float(decibels)))
    return size, back.reshape(array.shape)


def by_colour(code):
    """A codec of arrays (down × across × height × width) for a light of three colours."""
    def all_colours(light, level):
        parts = [code(np.ascontiguousarray(light[:, :, c]), level) for c in range(3)]
        return sum(size for size, _ in parts), np.stack([back for _, back in parts], axis=2)
    return all_colours


def packed(levels):
    """Bytes of small integers: an order of its own for low and high bytes, and the coder of xz."""
    levels = np.clip(levels, -32768, 32767).astype("<i2")
    filters = [{"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 0, "lp": 0, "pb": 0}]
    planes = levels.view(np.uint8).reshape(-1, 2).T.tobytes()
    return len(lzma.compress(planes, lzma.FORMAT_RAW, filters=filters))


def tucker(light, level):
    """A Tucker decomposition over all dimensions, colour too, its core and factors quantised by one slope: the way of TTHRESH
    (Ballester-Ripoll, Lindstrom, Pajarola 2020)."""
    if id(light) not in decomposed:
        import tensorly.decomposition
        import tensorly.tenalg

        found = tensorly.decomposition.tucker(light.astype("f8"), rank=list(light.shape), init="svd", n_iter_max=1)
        decomposed[id(light)] = found
    core, factors = decomposed[id(light)]
    step = largest * level
    levels = np.round(core / step)
    used = [np.flatnonzero(np.abs(levels).max(axis=tuple(m for m in range(core.ndim) if m != mode))) for mode in range(core.ndim)]
    ranks = [last[-1] + 1 if len(last) else 0 for last in used]
    if 0 in ranks:
        return 8, np.zeros(light.shape)
    box = tuple(slice(rank) for rank in ranks)
    levels = levels[box]
    order = np.argsort(sum(np.ogrid[tuple(slice(0, 1, rank * 1j) for rank in ranks)]).ravel(), kind="stable")
    size, kept = packed(levels.ravel()[order]) + 4 * len(ranks), []
    for mode, (factor, rank) in enumerate(zip(factors, ranks)):
        others = tuple(m for m in range(core.ndim) if m != mode)
        steps = np.minimum(step / np.sqrt(((levels * step) ** 2).sum(axis=others)).clip(step), 0.5)
        quantised = np.round(factor[:, :rank] / steps)
        size += packed(quantised.T.ravel()) + 2 * rank
        kept.append(quantised * steps)
    back = levels * step
    for mode, factor in enumerate(kept):
        back = np.moveaxis(np.tensordot(factor, back, (1, mode)), 0, mode)
    return size, back


decomposed = {}
code = {"SZ3": by_colour(sz3), "SPERR": by_colour(sperr), "Tucker": tucker}[codec]
largest = float(matrix.max())
lights, first = [], 0
for across, down in grids:
    lights.append(matrix[first : first + across * down].reshape(down, across, 3, height, width))
    first += across * down


def whole(level):
    parts = [code(light, level) for light in lights]
    back = np.concatenate([np.asarray(part, dtype="f4").reshape(-1, 3, height, width) for _, part in parts])
    return sum(size for size, _ in parts), back


points = {}
exponent = -4


def point(exponent):
    begun = time.perf_counter()
    size, back = whole(2.0**exponent)
    index = len(points)
    points[exponent] = size
    images = np.einsum("ljc,jchw->lhwc", weights, back, optimize=True)
    for lighting, image in enumerate(images):
        image.astype("<f4").tofile(os.path.join(folder, f"{index}-{lighting}.f32"))
    print(size, time.perf_counter() - begun, flush=True)
    return size


size = point(exponent)
above = below = exponent
while size > least and above < 12:
    above += 1
    size = point(above)
while points[below] < most and below > -32:
    below -= 1
    point(below)
