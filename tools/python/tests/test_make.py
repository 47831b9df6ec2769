"""Packing, rendering, checking, joining; progress and Ctrl-C."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import ltm
import numpy as np
import pytest
from conftest import COLUMNS, HEIGHT, WIDTH, copy_of, lights

ROOM = ltm.BuiltIn("diffuse", width=48, height=32, texels=3)


def test_a_pack_is_near_what_was_packed(images, tmp_path):
    path = tmp_path / "a.ltc"
    told = []
    report = ltm.pack(images, path, lights=lights(), target="60dB", progress=lambda *step: told.append(step))
    assert report.packed_bytes == path.stat().st_size < report.raw_bytes == images.nbytes
    assert report.relative_l2 < 0.01 and report.replaced_entries == 0
    with ltm.open(path) as m:
        lost = np.linalg.norm(m[...] - images.transpose(1, 2, 3, 0)) / np.linalg.norm(images)
        assert lost == pytest.approx(report.relative_l2, rel=0.05)
    stages = {stage for stage, _, _ in told}
    assert len(stages) >= 1 and all(0 <= done <= total for _, done, total in told)
    assert told[-1][1] == told[-1][2]


def test_arrays_of_any_kind_and_iterators_pack_alike(images, tmp_path):
    def pack(images, name):
        ltm.pack(images, tmp_path / name, target="50dB")
        return (tmp_path / name).read_bytes()

    wanted = pack(images, "a.ltc")
    assert pack(np.asfortranarray(images.astype(np.float64)), "b.ltc") == wanted
    assert pack(iter(images), "c.ltc") == wanted
    assert pack((image for image in images), "d.ltc") == wanted
    ltm.write(images, tmp_path / "e.ltm")
    ltm.pack(tmp_path / "e.ltm", tmp_path / "e.ltc", target="50dB")
    with ltm.open(tmp_path / "e.ltc") as e, ltm.open(tmp_path / "a.ltc") as a:
        np.testing.assert_array_equal(e[...], a[...])
        assert e.lights == a.lights and list(e.lights.keys())[:2] == ["light 0", "light 1"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.ltc", "b.ltc", "c.ltc", "d.ltc", "e.ltc", "e.ltm"]


def test_blocks_from_an_iterator_pack_as_the_array_does(images, tmp_path):
    ltm.pack(images, tmp_path / "a.ltc", target="50dB")
    size = (HEIGHT, WIDTH)

    def blocks(side):
        places = [(y, x) for y in range(0, HEIGHT, side) for x in range(0, WIDTH, side)]
        for y, x in reversed(places):
            yield (y, x), images[:, y : y + side, x : x + side].transpose(1, 2, 3, 0)

    ltm.pack(blocks(20), tmp_path / "b.ltc", target="50dB", size=size)
    assert (tmp_path / "b.ltc").read_bytes() == (tmp_path / "a.ltc").read_bytes()
    ltm.write(blocks(7), tmp_path / "c.ltm", size=size)
    with ltm.open(tmp_path / "c.ltm") as m:
        np.testing.assert_array_equal(m[...], images.transpose(1, 2, 3, 0))
        # A matrix changed block by block.
        dimmed = ((block, entries * 0.5) for block, entries in m.iter_blocks())
        ltm.write(dimmed, tmp_path / "d.ltm", size=size, lights=list(m.lights))
        with ltm.open(tmp_path / "d.ltm") as d:
            np.testing.assert_array_equal(d[...], m[...] * 0.5)
    for bad, text in [
        (list(blocks(20))[1:], "none"),
        ([*blocks(20), *blocks(20)], "another block"),
        ([((0, 40), np.ones((20, 20, 3, 2)))], "beyond"),
        ([((-1, 0), np.ones((20, 20, 3, 2)))], "beyond"),
        ([((0, 0), np.ones((20, 20, 3)))], "shape"),
        ([((0, 0), np.ones((37, 20, 3, 2))), ((0, 20), np.ones((37, 30, 3, 3)))], "columns"),
        ([], "none"),
    ]:
        with pytest.raises(ValueError, match=text):
            ltm.pack(iter(bad), tmp_path / "bad.ltc", size=size)
    with pytest.raises(ValueError, match="size"):
        ltm.pack(images, tmp_path / "bad.ltc", size=size)
    with pytest.raises(ValueError, match="size"):
        ltm.pack(tmp_path / "c.ltm", tmp_path / "bad.ltc", size=size)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.ltc", "b.ltc", "c.ltm", "d.ltm"]


def test_images_can_be_denoised_elsewhere(tmp_path):
    ltm.render(ROOM, tmp_path / "a.ltm", samples=8, block_side=16)
    count = ltm.write_basis(tmp_path / "a.ltm", tmp_path / "b.exr")
    assert count >= 1 and (tmp_path / "b.exr").stat().st_size > 0
    with pytest.raises(FileExistsError):
        ltm.write_basis(tmp_path / "a.ltm", tmp_path / "b.exr")
    ltm.pack(tmp_path / "a.ltm", tmp_path / "own.ltc")
    ltm.pack(tmp_path / "a.ltm", tmp_path / "given.ltc", basis=tmp_path / "b.exr")
    ltm.pack(tmp_path / "a.ltm", tmp_path / "raw.ltc", denoise=False)
    with ltm.open(tmp_path / "own.ltc") as own, ltm.open(tmp_path / "given.ltc") as given:
        with ltm.open(tmp_path / "raw.ltc") as raw:
            # The images that were not denoised at all are not those of our own denoising.
            a, b, c = (m.relight(m.scene_weights) for m in (own, given, raw))
            assert not np.array_equal(a, b) and not np.array_equal(a, c)
    with pytest.raises(FileNotFoundError, match="none.exr"):
        ltm.pack(tmp_path / "a.ltm", tmp_path / "c.ltc", basis=tmp_path / "none.exr")
    ltm.write(np.ones((2, 8, 8, 3)), tmp_path / "plain.ltm")
    with pytest.raises(ValueError, match="samples"):
        ltm.write_basis(tmp_path / "plain.ltm", tmp_path / "c.exr")


def test_passes_sum_up_to_the_image(tmp_path):
    ltm.render(ROOM, tmp_path / "a.ltm", samples=8, block_side=16)
    with ltm.open(tmp_path / "a.ltm") as m:
        weights = np.linspace(0, 1, m.shape[-1])
        passes, image = m.passes(weights), m.relight(weights)
        assert list(passes) == ["emission", "direct", "indirect"]
        np.testing.assert_allclose(sum(passes.values()), image, rtol=1e-4, atol=1e-4)
        assert all(passes[name].mean() > 0.02 * image.mean() for name in ("direct", "indirect"))
        with pytest.raises(ValueError, match="one lighting"):
            m.passes(np.ones((2, m.shape[-1], 3)))
    ltm.pack(tmp_path / "a.ltm", tmp_path / "a.ltc")
    with ltm.open(tmp_path / "a.ltc") as m, pytest.raises(ValueError, match="container holds none"):
        m.passes(weights)


def test_features_are_what_pixels_show_beside_light(tmp_path):
    ltm.render(ROOM, tmp_path / "a.ltm", samples=8, block_side=16)
    with ltm.open(tmp_path / "a.ltm") as m:
        features, variances = m.features(), m.features(variance=True)
        height, width = m.shape[:2]
    assert {name: plane.shape for name, plane in features.items() if name in ("albedo", "normal", "pixel_albedo")} == {
        name: (height, width, 3) for name in ("albedo", "normal", "pixel_albedo")
    }
    assert all(features[name].shape == (height, width) for name in ("depth", "emitter", "specular", "surface"))
    inside = features["surface"] == 1
    assert inside.any() and (features["depth"][inside] > 0).all() and (features["albedo"][inside] < 1).all()
    lengths = np.linalg.norm(features["normal"][inside], axis=-1)
    assert lengths.max() < 1 + 1e-5 and np.median(lengths) > 0.99
    numbers = np.unique(features["material"])
    assert len(numbers) > 2 and (numbers == np.round(numbers)).all() and (features["material"][inside] >= 1).all()
    assert all(variances[name].shape == plane.shape and (variances[name] >= 0).all() for name, plane in features.items())
    assert (variances["surface"][inside] == 0).all() and (variances["material"] > 0).any()
    ltm.pack(tmp_path / "a.ltm", tmp_path / "a.ltc")
    with ltm.open(tmp_path / "a.ltc") as m, pytest.raises(ValueError, match="container holds none"):
        m.features()
    ltm.write(np.ones((2, 8, 8, 3)), tmp_path / "plain.ltm")
    with ltm.open(tmp_path / "plain.ltm") as m, pytest.raises(ValueError, match="samples"):
        m.features()


OBJ = "mtllib room.mtl\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 2 -1\nv 1 2 -1\nv 1 2 1\nv -1 2 1\n"
OBJ += "usemtl floor\nf 4 3 2 1\nusemtl lamp\nf 5 6 7 8\n"


def test_files_of_strangers_are_read_on_demand_only(tmp_path):
    geometry = tmp_path / "elsewhere"
    geometry.mkdir()
    (geometry / "room.obj").write_text(OBJ)
    (geometry / "room.mtl").write_text("newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKe 1 1 1\n")
    scene = tmp_path / "scene"
    scene.mkdir()
    (scene / "room.toml").write_text(
        f'geometry = ["{geometry}/room.obj"]\n[camera]\neye = [0, 1, 3]\nlook_at = [0, 1, 0]\nwidth = 8\nheight = 8\n'
    )
    with pytest.raises(ValueError, match="allow_outside=True"):
        ltm.render(scene / "room.toml", tmp_path / "a.ltm", samples=1)
    ltm.render(scene / "room.toml", tmp_path / "a.ltm", samples=1, allow_outside=True)
    with pytest.raises(ValueError, match="camera"):
        ltm.render(scene / "room.toml", tmp_path / "b.ltm", camera="door", allow_outside=True)


def test_lights_of_a_matrix_are_given_on(container_path, images, tmp_path):
    with ltm.open(container_path) as m:
        ltm.write(images, tmp_path / "a.ltm", lights=list(m.lights))
        with ltm.open(tmp_path / "a.ltm") as again:
            assert again.lights == m.lights


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"images": np.ones((3, 4, 5))}, ValueError, "shape"),
        ({"images": np.ones((3, 4, 5, 4))}, ValueError, "shape"),
        ({"images": np.ones((0, 4, 5, 3))}, ValueError, "shape"),
        ({"images": np.ones((3, 4, 5, 3), complex)}, TypeError, "dtype"),
        ({"images": np.full((3, 4, 5, 3), "x")}, TypeError, "dtype"),
        ({"images": 7}, TypeError, "array"),
        ({"images": iter([])}, ValueError, "none"),
        ({"images": iter([np.ones((4, 5, 3)), np.ones((5, 4, 3))])}, ValueError, "image 1"),
        ({"lights": ["a", "b"]}, ValueError, "2 columns"),
        ({"lights": ["a", "a", "b"]}, ValueError, "taken"),
        ({"lights": "abc"}, TypeError, "names"),
        ({"lights": [ltm.Light("a", kind="candle"), "b", "c"]}, ValueError, "candle"),
        ({"target": "much"}, ValueError, "45dB"),
        ({"target": 45}, TypeError, "45dB"),
        ({"block_side": 0}, ValueError, "block side"),
        ({"memory": 1000}, MemoryError, "needs"),
        ({"progress": 7}, TypeError, "progress"),
    ],
)
def test_what_cannot_be_packed_is_refused(tmp_path, arguments, error, text):
    given = {"images": np.ones((3, 4, 5, 3), np.float32), **arguments}
    with pytest.raises(error, match=text):
        ltm.pack(given.pop("images"), tmp_path / "a.ltc", **given)
    assert list(tmp_path.iterdir()) == []


def test_entries_that_are_not_finite_are_counted(tmp_path):
    images = np.ones((3, 8, 8, 3), np.float32)
    images[1, 2, 3] = np.nan
    assert ltm.pack(images, tmp_path / "a.ltc").replaced_entries == 3


def test_outputs_are_not_replaced_unasked(images, tmp_path):
    path = tmp_path / "a.ltc"
    ltm.pack(images, path)
    with pytest.raises(FileExistsError):
        ltm.pack(images, path)
    ltm.pack(images, path, overwrite=True)
    with pytest.raises(FileNotFoundError):
        ltm.pack(images, tmp_path / "none" / "a.ltc")


def test_a_scene_is_rendered_and_packed(tmp_path):
    report = ltm.render(ROOM, tmp_path / "a.ltm", samples=4, block_side=16)
    assert report.blocks_traced == 6 and report.rays > 0 and report.packed is None
    packed = ltm.render(ROOM, tmp_path / "a.ltc", samples=4, block_side=16, pack=True)
    assert packed.packed.packed_bytes == (tmp_path / "a.ltc").stat().st_size
    with ltm.open(tmp_path / "a.ltm") as raw, ltm.open(tmp_path / "a.ltc") as m:
        assert raw.shape == m.shape and raw.shape[:2] == (32, 48)
        assert raw.attrs["samples_per_pixel"] == 4
        camera = m.attrs["camera"]
        assert camera == raw.attrs["camera"] and 0 < camera["vertical_fov_degrees"] < 180
        for key in ("direction", "up"):
            assert abs(np.linalg.norm(camera[key]) - 1) < 1e-6
        assert len(camera["eye"]) == 3 and abs(np.dot(camera["direction"], camera["up"])) < 1e-6
        a, b = raw.relight(raw.scene_weights), m.relight(m.scene_weights)
        assert a.max() > 0 and np.linalg.norm(a - b) < 0.3 * np.linalg.norm(a)
    assert ltm.verify(tmp_path / "a.ltm") and ltm.verify(tmp_path / "a.ltc")
    small = ltm.render(ROOM, tmp_path / "b.ltm", samples=2, size=(8, 20), seed=7)
    assert small.blocks_traced == 1
    assert ltm.info(tmp_path / "b.ltm")["shape"][:2] == (8, 20)


def test_a_live_render_gives_all_lights_at_once_and_ends_with_the_container_of_render(tmp_path):
    room = ltm.BuiltIn("mixed", width=192, height=96, texels=2)
    ltm.render(room, tmp_path / "offline.ltc", samples=24, pack=True)
    estimates, lights = [], []
    for estimate in ltm.render_live(room, tmp_path / "live.ltc", samples=24):
        with estimate.open() as m:
            lights.append([light.name for light in m.lights])
            image = m.relight(m.scene_weights)
        assert image.shape == (*estimate.size, 3) and image.max() > 0
        assert estimate.error is not None and 0 < estimate.seconds <= estimate.expected_seconds
        estimates.append(estimate)
    assert [estimate.is_final for estimate in estimates] == [False] * (len(estimates) - 1) + [True]
    assert len(estimates) > 1 and all(names == lights[0] for names in lights)
    assert (tmp_path / "live.ltc").read_bytes() == (tmp_path / "offline.ltc").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["live.ltc", "offline.ltc"]
    again = list(ltm.render_live(room, tmp_path / "live.ltc", samples=24))
    assert len(again) == 1 and again[0].is_final and again[0].path == tmp_path / "live.ltc"
    with pytest.raises((ValueError, FileExistsError)):
        next(ltm.render_live(room, tmp_path / "live.ltc", samples=8))


def test_a_live_render_that_is_left_is_gone_on_with(tmp_path):
    room = ltm.BuiltIn("diffuse", width=192, height=96, texels=2)
    for estimate in ltm.render_live(room, tmp_path / "a.ltc", samples=24):
        assert not estimate.is_final
        break
    first = next(iter(ltm.render_live(room, tmp_path / "a.ltc", samples=24)))
    assert (first.size, first.is_final, first.path.name) == (estimate.size, False, "a.early.ltc")


def test_scenes_that_cannot_be_used_are_refused(tmp_path):
    with pytest.raises(ValueError, match="nowhere"):
        ltm.render(ltm.BuiltIn("nowhere"), tmp_path / "a.ltm")
    with pytest.raises(FileNotFoundError, match="none.toml"):
        ltm.render(tmp_path / "none.toml", tmp_path / "a.ltm")
    (tmp_path / "bad.toml").write_text("name = [")
    with pytest.raises(ValueError, match="bad.toml"):
        ltm.render(tmp_path / "bad.toml", tmp_path / "a.ltm")
    with pytest.raises(ValueError, match="pack=True"):
        ltm.render(ROOM, tmp_path / "a.ltc")
    with pytest.raises(MemoryError):
        ltm.render(ROOM, tmp_path / "a.ltm", memory=1000)


class Stop(Exception):
    pass


def test_a_callback_that_raises_stops_the_work_and_it_goes_on_later(tmp_path):
    scene = ltm.BuiltIn("diffuse", width=128, height=96, texels=4)

    def stop(stage, done, total):
        if done >= 2:
            raise Stop

    with pytest.raises(Stop):
        ltm.render(scene, tmp_path / "a.ltm", samples=64, block_side=16, progress=stop)
    assert not (tmp_path / "a.ltm").exists()
    report = ltm.render(scene, tmp_path / "a.ltm", samples=64, block_side=16)
    assert report.blocks_kept >= 2 and report.blocks_kept + report.blocks_traced == 48


def test_ctrl_c_stops_the_work_and_keeps_it(tmp_path):
    code = """
        import ltm, sys
        scene = ltm.BuiltIn("diffuse", width=256, height=192, texels=4)
        try:
            ltm.render(scene, sys.argv[1], samples=1024, block_side=16, progress=lambda *step: print(*step, flush=True))
        except KeyboardInterrupt:
            print("stopped", flush=True)
    """
    path = tmp_path / "a.ltm"
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code), str(path)], stdout=subprocess.PIPE, text=True
    )
    for line in process.stdout:
        if int(line.split()[1]) > 0:
            break
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    rest = process.communicate(timeout=60)[0]
    assert rest.splitlines()[-1] == "stopped" and process.returncode == 0
    # It would have taken a minute and more.
    assert time.monotonic() - begun < 30
    assert not path.exists() and (tmp_path / "a.ltm.part").exists()


def test_damage_is_found(path, tmp_path):
    copy = copy_of(path, tmp_path)
    found = ltm.verify(copy)
    assert found and found.blocks == 12 and found.missing == 0
    data = bytearray(copy.read_bytes())
    copy.write_bytes(data[: len(data) // 2])
    with pytest.raises(ltm.DamagedError):
        assert not ltm.verify(copy)
        raise ltm.DamagedError
    (tmp_path / "text.ltc").write_text("no container")
    with pytest.raises(ValueError, match="not a container"):
        ltm.verify(tmp_path / "text.ltc")


def test_parts_are_joined(matrix_path, tmp_path):
    assert ltm.merge([matrix_path, copy_of(matrix_path, tmp_path)], tmp_path / "b.ltm") == 0
    with ltm.open(matrix_path) as a, ltm.open(tmp_path / "b.ltm") as b:
        np.testing.assert_array_equal(a[...], b[...])
    ltm.write(np.zeros((COLUMNS, HEIGHT, WIDTH, 3)), tmp_path / "c.ltm")
    with pytest.raises(ValueError, match="c.ltm"):
        ltm.merge([matrix_path, tmp_path / "c.ltm"], tmp_path / "d.ltm")


def test_containers_are_joined(container_path, tmp_path):
    assert ltm.merge([container_path, container_path], tmp_path / "b.ltc") == 0
    assert ltm.verify(tmp_path / "b.ltc")
    with pytest.raises(FileExistsError):
        ltm.merge([container_path], tmp_path / "b.ltc")


def test_a_signal_that_does_not_raise_does_not_stop(tmp_path):
    seen = []
    before = signal.signal(signal.SIGUSR1, lambda *_: seen.append(1))
    try:
        ltm.render(
            ROOM, tmp_path / "a.ltm", samples=64, progress=lambda *_: seen or os.kill(os.getpid(), signal.SIGUSR1)
        )
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert seen and (tmp_path / "a.ltm").exists()


def test_a_bar_is_shown(images, tmp_path, capfd):
    pytest.importorskip("tqdm")
    ltm.pack(images, tmp_path / "a.ltc", progress=True)
    assert "packing: 100%" in capfd.readouterr().err


def test_an_interrupted_write_goes_on(tmp_path):
    images, path = np.random.default_rng(0).random((40, 240, 320, 3), dtype=np.float32), tmp_path / "a.ltm"

    def stop(stage, done, total):
        if done > 0:
            raise KeyError("enough")

    with pytest.raises(KeyError):
        ltm.write(images, path, block_side=8, progress=stop)
    assert not path.exists() and (tmp_path / "a.ltm.part").exists()
    ltm.write(images, path, block_side=8)
    with ltm.open(path) as m:
        assert np.array_equal(m[...], images.transpose(1, 2, 3, 0))
