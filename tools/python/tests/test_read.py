"""Opening, what is known beside the entries, and slices."""

import ltm
import numpy as np
import pytest
from conftest import COLUMNS, HEIGHT, NAMES, WIDTH


def test_shape_lights_and_attributes(m):
    assert m.shape == (HEIGHT, WIDTH, 3, COLUMNS) and m.dtype == np.float32 and len(m) == HEIGHT
    assert list(m.lights.keys()) == NAMES and [light.name for light in m.lights] == NAMES
    sky = m.lights["sky"]
    assert sky is m.lights[3] and sky.grid == (2, 3) and sky.columns == range(3, 9) and sky.kind == "lat-long"
    assert "sky" in m.lights and "sea" not in m.lights and m.lights.get("sea") is None
    assert [light.name for light in m.lights.match("lamp ?")] == ["lamp 1", "lamp 2"]
    with pytest.raises(KeyError, match="nearest names are 'sky'"):
        m.lights["skye"]
    assert m.attrs["path"] == m.path and m.attrs["source"] == "array" and m.attrs["block_side"] == 16
    # No camera made an array.
    assert m.attrs["camera"] is None
    assert m.scene_weights.shape == (COLUMNS, 3) and (m.scene_weights == 1).all()
    assert ltm.info(m.path)["lights"] == NAMES


def test_blocks_say_what_they_are(m):
    blocks = m.blocks
    assert len(blocks) == 3 * 4
    last = blocks[-1]
    assert (last.x, last.y, last.width, last.height) == (48, 32, 2, 5) and last.present
    if m.attrs["kind"] == "ltc":
        assert all(block.rank > 0 and block.bytes > 0 and block.relative_error < 0.01 for block in blocks)
        assert sum(block.bytes for block in blocks) < m.attrs["bytes"]
    with pytest.raises(IndexError):
        blocks[12]


SLICES = [
    np.s_[...],
    np.s_[3],
    np.s_[-1, -2],
    np.s_[10:30, 5:20, 1],
    np.s_[..., 4],
    np.s_[5, 40, :, 1],
    np.s_[::7, ::-5, ::-1, ::2],
    np.s_[30:2:-3, 49, 0:2, -3:],
    np.s_[5, 40, 2, 1],
    np.s_[4:4],
    np.s_[:, :, :, 100:],
    np.s_[..., 3:9],
    np.s_[15:17, 15:17, ...],
]


@pytest.mark.parametrize("index", range(len(SLICES)))
def test_slices_are_those_of_the_array(m, images, index):
    whole = images.transpose(1, 2, 3, 0)
    wanted, found = whole[SLICES[index]], m[SLICES[index]]
    assert np.shape(found) == wanted.shape and found.dtype == np.float32
    if m.attrs["kind"] == "ltm":
        np.testing.assert_array_equal(found, wanted)
    else:
        # What 60 dB leaves, most of it at the spot, which is far above white.
        np.testing.assert_allclose(found, wanted, atol=0.2)
        assert np.size(found) < 10_000 or np.abs(found - wanted).mean() < 5e-3


def test_names_globs_and_lists_choose(m, images):
    whole = m[...]
    np.testing.assert_array_equal(m[2:9, 3:40, :, "lamp 2"], whole[2:9, 3:40, :, 2])
    np.testing.assert_array_equal(m[..., "lamp *"], whole[..., 1:3])
    np.testing.assert_array_equal(m[..., "sky"], whole[..., 3:9])
    np.testing.assert_array_equal(m[0, ..., ["sky", "desk"]], whole[0][..., [3, 4, 5, 6, 7, 8, 0]])
    np.testing.assert_array_equal(m[[9, 2, 9, -1], :, 0], whole[[9, 2, 9, -1], :, 0])
    mask = np.arange(WIDTH) % 7 == 3
    np.testing.assert_array_equal(m[:, mask], whole[:, mask])
    np.testing.assert_array_equal(m[[1, 30], [0, 17, 44]], whole[np.ix_([1, 30], [0, 17, 44])])


@pytest.mark.parametrize(
    ("key", "error"),
    [
        (np.s_[HEIGHT], IndexError),
        (np.s_[0, 0, 0, 0, 0], IndexError),
        (np.s_[..., 0, ...], IndexError),
        (np.s_[1.5], IndexError),
        (np.s_[None], IndexError),
        (np.s_[..., "sea"], KeyError),
        (np.s_[[0, HEIGHT]], IndexError),
    ],
)
def test_indices_that_do_not_fit_are_refused(m, key, error):
    with pytest.raises(error):
        m[key]


def test_only_the_blocks_that_are_touched_are_read(matrix_path, container_path, images, tmp_path):
    from conftest import copy_of

    for path in (matrix_path, container_path):
        copy = copy_of(path, tmp_path)
        with ltm.open(copy) as m:
            kept = m[0:16, 0:16]
        damage_last_block(copy, images)
        with ltm.open(copy) as m:
            np.testing.assert_array_equal(m[0:16, 0:16], kept)
            with pytest.raises(ltm.DamagedError, match="block 11"):
                m[36, 49]
            m.relight(np.ones(COLUMNS), roi=np.s_[0:16, 0:16])
            with pytest.raises(ltm.DamagedError, match="block 11"):
                m.relight(np.ones(COLUMNS))
            with pytest.raises(ltm.DamagedError, match="block 11"):
                m.adjoint(np.ones((HEIGHT, WIDTH, 3)))
        assert not ltm.verify(copy)


def damage_last_block(path, images):
    """Flips a byte of the entries of the last block."""
    data = bytearray(path.read_bytes())
    if path.suffix == ".ltm":
        at = data.rfind(images[0, 36, 48:50, 0].tobytes())
        assert at > 0
        data[at] ^= 0xFF
        path.write_bytes(data)
        return
    # Where a container keeps them is found by looking.
    for at in range(len(data) - 1, 0, -20):
        data[at] ^= 0xFF
        path.write_bytes(data)
        try:
            with ltm.open(path) as m:
                m[0:32]
                try:
                    m[36, 49]
                except ltm.DamagedError:
                    m[36, 0:48]
                    return
        except (ltm.DamagedError, ValueError):
            pass
        data[at] ^= 0xFF
    raise AssertionError("no byte of the last block was found")


def test_blocks_are_iterated(m):
    whole = m[...]
    seen = np.zeros((HEIGHT, WIDTH), int)
    for block, entries in m.iter_blocks():
        y, x = slice(block.y, block.y + block.height), slice(block.x, block.x + block.width)
        seen[y, x] += 1
        np.testing.assert_array_equal(entries, whole[y, x])
    assert (seen == 1).all()


def test_numpy_makes_an_array_of_small_matrices_only(m, monkeypatch):
    np.testing.assert_array_equal(np.asarray(m), m[...])
    assert np.asarray(m, np.float64).dtype == np.float64
    monkeypatch.setattr("ltm._matrix.ASARRAY_BYTES", 1000)
    with pytest.raises(MemoryError, match="to_numpy"):
        np.asarray(m)
    assert m.to_numpy().shape == m.shape


def test_other_libraries_take_the_entries_by_dlpack(m, monkeypatch):
    np.testing.assert_array_equal(np.from_dlpack(m), m[...])
    monkeypatch.setattr("ltm._matrix.ASARRAY_BYTES", 1000)
    with pytest.raises(MemoryError, match="to_numpy"):
        np.from_dlpack(m)


def test_a_slice_stays_within_the_memory(path):
    with ltm.open(path, memory=1000) as m, pytest.raises(MemoryError):
        m[...]


def test_xarray(m):
    pytest.importorskip("xarray")
    array = m.to_xarray(y=slice(3, 9), light="sky")
    assert array.dims == ("y", "x", "channel", "light") and list(array.light.values)[0] == "sky[0]"
    np.testing.assert_array_equal(array.values, m[3:9, ..., "sky"])
    assert m.to_xarray(channel=1).dims == ("y", "x", "light")
