"""Small matrices that the tests share."""

import os
from pathlib import Path

import ltm
import numpy as np
import pytest

NAMES = ["desk", "lamp 1", "lamp 2", "sky"]
#: The last light has 2 × 3 texels.
COLUMNS = 9
HEIGHT, WIDTH = 37, 50


def smooth(seed: int = 1) -> np.ndarray:
    """A matrix (lights, h, w, 3) of smooth images, of low rank but for a spot."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] / 40.0
    images = []
    for _ in range(COLUMNS):
        a, b, c = random.uniform(0.2, 2.0, 3)
        image = 1.0 + np.sin(a * x + b * y) ** 2 * c
        images.append(image[..., None] * random.uniform(0.3, 1.0, 3))
    array = np.array(images, np.float32)
    array[1, 5, 40] = [7.0, 8.0, 9.0]
    return array


def lights() -> list:
    return [*NAMES[:3], ltm.Light("sky", kind="lat-long", grid=(2, 3), unit="radiance")]


@pytest.fixture(scope="session")
def images() -> np.ndarray:
    return smooth()


@pytest.fixture(scope="session")
def matrix_path(tmp_path_factory: pytest.TempPathFactory, images: np.ndarray) -> Path:
    path = tmp_path_factory.mktemp("matrix") / "room.ltm"
    ltm.write(images, path, lights=lights(), block_side=16)
    return path


@pytest.fixture(scope="session")
def container_path(tmp_path_factory: pytest.TempPathFactory, images: np.ndarray) -> Path:
    path = tmp_path_factory.mktemp("container") / "room.ltc"
    ltm.pack(images, path, lights=lights(), block_side=16, target="60dB")
    return path


@pytest.fixture(params=["ltm", "ltc"])
def path(request: pytest.FixtureRequest, matrix_path: Path, container_path: Path) -> Path:
    return matrix_path if request.param == "ltm" else container_path


@pytest.fixture
def m(path: Path):
    with ltm.open(path) as m:
        yield m


@pytest.fixture(scope="session")
def adapter() -> ltm.Gpu:
    """The GPU, a software one too; LTM_REQUIRE_GPU=1 makes a missing one a failure."""
    found = ltm.gpu()
    if found is None:
        if os.environ.get("LTM_REQUIRE_GPU") == "1":
            pytest.fail("LTM_REQUIRE_GPU=1, and there is no adapter")
        pytest.skip("no Vulkan, Metal or DX12 adapter: relighting on a GPU is not tested")
    return found


def copy_of(path: Path, folder: Path) -> Path:
    """A copy that a test may damage."""
    copy = folder / path.name
    copy.write_bytes(path.read_bytes())
    return copy
