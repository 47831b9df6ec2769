"""Relighting and its adjoint."""

import os
import runpy
from pathlib import Path

import ltm
import numpy as np
import pytest
from conftest import COLUMNS, HEIGHT, WIDTH


@pytest.fixture
def random():
    return np.random.default_rng(5)


def product(m, weights):
    """What numpy makes of the entries."""
    return np.einsum("yxcj,...jc->...yxc", m[...].astype(np.float64), weights)


def close(m, found, wanted):
    # Factors of a container are kept in 8 and 16 bits for relighting.
    tolerance = 1e-5 if m.attrs["kind"] == "ltm" else 3e-3
    np.testing.assert_allclose(found, wanted, atol=tolerance * np.abs(wanted).max())


def test_relighting_is_the_product_with_the_weights(m, random):
    weights = random.uniform(0, 2, (COLUMNS, 3))
    image = m.relight(weights)
    assert image.shape == (HEIGHT, WIDTH, 3) and image.dtype == np.float32
    close(m, image, product(m, weights))
    grey = random.uniform(0, 2, COLUMNS)
    close(m, m.relight(grey), product(m, np.repeat(grey[:, None], 3, 1)))
    close(m, m.relight(list(grey)), m.relight(grey))


def test_batches_regions_and_targets(m, random):
    weights = random.uniform(-1, 2, (5, COLUMNS, 3)).astype(np.float32)
    images = m.relight(weights)
    assert images.shape == (5, HEIGHT, WIDTH, 3)
    for image, w in zip(images, weights, strict=True):
        np.testing.assert_array_equal(image, m.relight(w))
    part = m.relight(weights, roi=np.s_[10:33, 15:-1])
    np.testing.assert_array_equal(part, images[:, 10:33, 15:-1])
    out = np.full((HEIGHT, WIDTH, 3), 9, np.float32)
    assert m.relight(weights[1], out=out) is out
    np.testing.assert_array_equal(out, images[1])
    assert m.relight(weights, roi=np.s_[4:4, :]).shape == (5, 0, WIDTH, 3)
    assert m.relight(np.zeros((0, COLUMNS, 3))).shape == (0, HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("memory", [None, 1000])
def test_a_batch_is_its_images_one_by_one(path, random, memory):
    # More than are worked on at once, and an odd number of them.
    weights = random.uniform(-1, 2, (19, COLUMNS, 3)).astype(np.float32)
    x = random.normal(size=(3, HEIGHT, WIDTH, 3)).astype(np.float32)
    with ltm.open(path, memory=memory) as m:
        for image, w in zip(m.relight(weights), weights, strict=True):
            np.testing.assert_array_equal(image, m.relight(w))
        sums = m.adjoint(x)
        assert sums.shape == (3, COLUMNS, 3)
        for of_image, image in zip(sums, x, strict=True):
            np.testing.assert_array_equal(of_image, m.adjoint(image))
        out = np.zeros((3, COLUMNS, 3), np.float32)
        assert m.adjoint(x, out=out) is out
        np.testing.assert_array_equal(out, sums)
        assert m.adjoint(x[:0]).shape == (0, COLUMNS, 3)


def test_black_blocks_have_no_products(images, tmp_path):
    dark = images.copy()
    dark[:, :16, :16] = 0
    ltm.write(dark, tmp_path / "a.ltm", block_side=16)
    ltm.pack(dark, tmp_path / "a.ltc", block_side=16)
    x = np.zeros((HEIGHT, WIDTH, 3))
    x[:16, :16] = 1
    for name in ("a.ltm", "a.ltc"):
        with ltm.open(tmp_path / name) as m:
            assert (m.adjoint(x) == 0).all() and (m.adjoint(np.array([x, x])) == 0).all()
            assert (m.relight(np.ones((2, COLUMNS, 3)))[:, :16, :16] == 0).all()


def test_weights_by_name_and_glob(m):
    weights = m.weights({"*": 0.5, "lamp *": [1, 2, 3], "lamp 2": 4.0, "sky": np.arange(6)})
    assert weights.shape == (COLUMNS, 3)
    np.testing.assert_array_equal(weights[0], [0.5] * 3)
    np.testing.assert_array_equal(weights[1], [1, 2, 3])
    np.testing.assert_array_equal(weights[2], [4] * 3)
    np.testing.assert_array_equal(weights[3:, 1], np.arange(6))
    np.testing.assert_array_equal(m.relight({"desk": 1.0}), m.relight(np.eye(COLUMNS)[0]))
    with pytest.raises(KeyError, match="sea"):
        m.relight({"sea": 1.0})
    with pytest.raises(ValueError, match="sky"):
        m.relight({"sky": np.ones(4)})


def test_looks(m, tmp_path):
    path = tmp_path / "look.toml"
    path.write_text(
        'base = "off"\n[[light]]\nname = "desk"\nintensity = 2.0\n[[look]]\nname = "day"\n[[look.light]]\nname = "sky"\nintensity = 1.0\n'
    )
    weights = ltm.Look.read(path).to_weights(m)
    np.testing.assert_allclose(weights, m.weights({"desk": 2.0}))
    np.testing.assert_array_equal(m.relight(ltm.Look.read(path)), m.relight(weights))
    np.testing.assert_allclose(ltm.Look.read(path, "day").to_weights(m), m.weights({"desk": 2.0, "sky": 1.0}))
    with pytest.raises(ValueError, match="no look 'night'"):
        ltm.Look.read(path, "night").to_weights(m)
    with pytest.raises(FileNotFoundError):
        ltm.Look.read(tmp_path / "none.toml")
    path.write_text('[[light]]\nname = "dask"\n')
    with pytest.raises(ValueError, match="desk"):
        ltm.Look.read(path).to_weights(m)


@pytest.mark.parametrize("memory", [None, 1000])
def test_the_adjoint_is_the_transpose(path, random, memory):
    # With so little memory factors are not kept.
    with ltm.open(path, memory=memory) as m, ltm.open(path) as rich:
        x = random.normal(size=(HEIGHT, WIDTH, 3)).astype(np.float32)
        weights = random.normal(size=(COLUMNS, 3)).astype(np.float32)
        image, sums = m.relight(weights).astype(np.float64), m.adjoint(x)
        assert sums.shape == (COLUMNS, 3) and sums.dtype == np.float32
        for channel in range(3):
            of_image, of_columns = image[..., channel].ravel(), sums[:, channel].astype(np.float64)
            x_channel = x[..., channel].ravel().astype(np.float64)
            scale = np.linalg.norm(of_image) * np.linalg.norm(x_channel)
            # Rounding of sums in f32.
            assert abs(of_image @ x_channel - weights[:, channel] @ of_columns) < 1e-6 * scale
        np.testing.assert_array_equal(m.relight(weights), rich.relight(weights))
        np.testing.assert_array_equal(sums, rich.adjoint(x))
        close(m, sums, np.einsum("yxcj,yxc->jc", rich[...].astype(np.float64), x))
        out = np.zeros((COLUMNS, 3))
        assert m.adjoint(np.asfortranarray(x), out=out) is out
        np.testing.assert_array_equal(out.astype(np.float32), sums)


def test_inputs_that_do_not_fit_are_refused(m):
    good = np.ones((COLUMNS, 3), np.float32)
    nan = good.copy()
    nan[2, 1] = np.nan
    huge = np.full((COLUMNS, 3), 1e300)
    for weights in (np.ones(COLUMNS - 1), np.ones((3, COLUMNS)), np.ones((1, 1, COLUMNS, 3)), nan, huge):
        with pytest.raises(ValueError, match="weights|weight"):
            m.relight(weights)
    for weights in ("desk", good.astype(complex), None):
        with pytest.raises(TypeError):
            m.relight(weights)
    image = np.ones((HEIGHT, WIDTH, 3), np.float32)
    for out in (image[:-1], np.asfortranarray(image), image[:, ::-1]):
        with pytest.raises(ValueError, match="out"):
            m.relight(good, out=out)
    with pytest.raises(TypeError, match="out"):
        m.relight(good, out=image.astype(np.float64))
    frozen = image.copy()
    frozen.flags.writeable = False
    with pytest.raises(ValueError, match="out"):
        m.relight(good, out=frozen)
    with pytest.raises(ValueError, match="roi"):
        m.relight(good, roi=np.s_[::2, :])
    with pytest.raises(ValueError, match="image"):
        m.adjoint(image[1:])
    with pytest.raises(ValueError, match="image"):
        m.adjoint(np.ones((1, 1, HEIGHT, WIDTH, 3)))
    image[3, 7, 1] = np.inf
    with pytest.raises(ValueError, match="image 0, pixel 7, 3"):
        m.adjoint(image)
    with pytest.raises(ValueError, match="image 1, pixel 7, 3"):
        m.adjoint(np.array([np.ones_like(image), image]))
    with pytest.raises(ValueError, match="device"):
        m.relight(good, device="abacus")
    np.testing.assert_array_equal(m.relight(np.asfortranarray(good)), m.relight(good))


@pytest.fixture
def fit():
    pytest.importorskip("scipy")
    return runpy.run_path(str(Path(__file__).parent.parent / "examples" / "fit_lights.py"))["fit"]


def test_a_hidden_lighting_is_recovered(container_path, fit):
    with ltm.open(container_path) as m:
        hidden = np.array([[0.0, 1.5, 0.2]] * 2 + [[2.0, 0.0, 1.0]] * (COLUMNS - 2))
        picture = m.relight(hidden)
        found = fit(m, picture)
        np.testing.assert_allclose(found, hidden, atol=0.02)
        assert np.linalg.norm(m.relight(found) - picture) < 1e-5 * np.linalg.norm(picture)
        no_red = picture * [0, 1, 1]
        np.testing.assert_allclose(fit(m, no_red), hidden * [0, 1, 1], atol=0.02)


def test_where_no_light_shines_none_is_found(images, tmp_path, fit):
    green = images * np.array([0, 1, 0], np.float32)
    ltm.write(green, tmp_path / "a.ltm", block_side=16)
    with ltm.open(tmp_path / "a.ltm") as m:
        found = fit(m, m.relight(np.ones((COLUMNS, 3))))
        assert (found[:, [0, 2]] == 0).all() and (found[:, 1] >= 0).all() and found[:, 1].any()


@pytest.mark.skipif("LTM_SCENES" not in os.environ, reason="LTM_SCENES names no folder of real scenes")
def test_the_lamps_of_the_conference_room_are_recovered(tmp_path, random, fit):
    scene = Path(__file__).parents[3] / "examples" / "scenes" / "conference-24.toml"
    ltm.render(scene, tmp_path / "a.ltc", samples=1, pack=True, denoise=False)
    with ltm.open(tmp_path / "a.ltc") as m:
        hidden = random.uniform(0, 3, (24, 3)) * (random.random((24, 1)) < 0.6)
        np.testing.assert_allclose(fit(m, m.relight(hidden)), hidden, atol=1e-3)


@pytest.fixture
def torch_relight():
    torch = pytest.importorskip("torch")
    text = (Path(__file__).parent.parent / "README.md").read_text()
    code = next(part.split("```")[0] for part in text.split("```python\n") if part.startswith("class Relight"))
    names = {"torch": torch}
    exec(code, names)
    return torch, names["Relight"].apply


@pytest.mark.parametrize("dtype", ["float32", "float64", "bfloat16"])
@pytest.mark.parametrize("shape", [(COLUMNS,), (COLUMNS, 3), (4, COLUMNS, 3)])
def test_the_torch_function_of_the_documentation(m, random, torch_relight, shape, dtype):
    torch, relight = torch_relight
    weights = torch.tensor(random.uniform(size=shape), dtype=getattr(torch, dtype), requires_grad=True)
    image = relight(weights, m)
    np.testing.assert_array_equal(image.detach().numpy(), m.relight(weights.detach().float().numpy()))
    target = torch.tensor(random.uniform(size=image.shape), dtype=torch.float32)
    (image * target).sum().backward()
    wanted = m.adjoint(target.numpy())
    wanted = wanted.sum(-1) if len(shape) == 1 else wanted
    assert weights.grad.dtype == weights.dtype
    # Rounding of the weights' own type: 8 bits of bfloat16.
    np.testing.assert_allclose(weights.grad.float().numpy(), wanted, rtol=4e-3 if dtype == "bfloat16" else 1e-6)
    # A gradient that is one value everywhere has no strides.
    weights.grad = None
    relight(weights, m).sum().backward()
    assert (weights.grad > 0).all()


def test_torch_trains_weights_through_the_matrix(m, random, torch_relight):
    torch, relight = torch_relight
    hidden = torch.tensor(random.uniform(0.5, 2, (COLUMNS, 3)), dtype=torch.float32)
    target = relight(hidden, m)
    weights = torch.ones((COLUMNS, 3), requires_grad=True)
    # Least squares in 27 unknowns: quasi-Newton steps, of which it takes some tens.
    optimizer = torch.optim.LBFGS([weights], max_iter=100, tolerance_grad=0, tolerance_change=0, line_search_fn="strong_wolfe")

    def loss():
        optimizer.zero_grad()
        loss = ((relight(weights, m) - target) / target.mean()).square().mean()
        loss.backward()
        return loss

    optimizer.step(loss)
    # The lights of this room are nearly dependent, so that other weights make the same image: it is the image that is compared.
    assert loss().item() < 1e-6
