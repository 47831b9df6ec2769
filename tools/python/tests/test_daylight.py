"""Daylight of a climate: an hour of it, and a year."""

import math

import ltm
import numpy as np
import pytest

CLIMATE = """place Testville_XX
latitude 48.1
longitude -11.6
time_zone -15
site_elevation 515
weather_data_file_units 3
6 21 11.5 80000 12000
6 21 12.5 60000 20000
"""


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    """A matrix of the irradiance of open ground under a sky of patches, and a climate."""
    folder = tmp_path_factory.mktemp("ground")
    (folder / "ground.obj").write_text("v -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\nf 4 3 2 1\n")
    (folder / "scene.toml").write_text(
        'geometry = ["ground.obj"]\n[camera]\neye = [0, 3, 0.1]\nlook_at = [0, 0, 0]\nwidth = 8\nheight = 8\nirradiance = true\n'
        '[[light]]\nkind = "environment"\nname = "sky"\npatches = "reinhart"\nsubdivision = 1\n'
    )
    (folder / "city.wea").write_text(CLIMATE)
    ltm.render(folder / "scene.toml", folder / "ground.ltm", samples=64)
    return folder


def lux(image):
    return 179 * image @ np.array([0.265, 0.670, 0.065])


def test_an_hour_lights_the_sky_as_the_climate_states_it(ground):
    with ltm.open(ground / "ground.ltm") as m:
        found = lux(m.relight(m.weights_at(ground / "city.wea", 6, 21, 12.5))).mean()
        # By the IES the sun stands 65.1° high at 12:30 here: its direct light, and the sky's.
        stated = 20000 + 60000 * math.sin(math.radians(65.1))
        assert found == pytest.approx(stated, rel=0.05)
        with pytest.raises(ValueError, match="no hours on day 1 of month 1"):
            m.weights_at(ground / "city.wea", 1, 1, 12)
        assert not m.weights_at(ground / "city.wea", 6, 21, 1).any()


def test_a_year_is_what_its_hours_are(ground):
    with ltm.open(ground / "ground.ltm") as m:
        year = m.daylight(ground / "city.wea")
        hours = [lux(m.relight(m.weights_at(ground / "city.wea", 6, 21, hour))) for hour in (11.5, 12.5)]
    np.testing.assert_allclose(year.measures["mean_lux"], np.mean(hours, 0), rtol=1e-4)
    assert year.measures["da"].shape == (8, 8) and (year.measures["da"] == 100).all()
    assert year.spatial_autonomy == 100 and year.dark == 0 and year.sunlight_exposure is None
    xarray = pytest.importorskip("xarray")
    data = year.to_xarray()
    assert isinstance(data, xarray.Dataset) and data["mean_lux"].attrs["units"] == "lx"
    assert data.attrs["spatial_autonomy"] == 100


def test_a_year_of_radiance_is_refused(ground, tmp_path):
    ltm.render(ltm.BuiltIn("diffuse", 16, 16, 2), tmp_path / "room.ltm", samples=2)
    with ltm.open(tmp_path / "room.ltm") as m, pytest.raises(ValueError, match="shows radiance"):
        m.daylight(ground / "city.wea")


def test_glare_of_a_window_is_that_of_its_formula():
    # A fisheye of even radiance but for a square of a brighter one, in the line of sight.
    side, dim, bright = 256, 1.0, 40.0
    picture = np.full((side, side, 3), dim, np.float32)
    middle = slice(side // 2 - 8, side // 2 + 8)
    picture[middle, middle] = bright
    seen = ltm.glare(picture)
    (source,) = seen.sources
    assert source.luminance == pytest.approx(179 * bright, rel=1e-3) and source.position_index == pytest.approx(1, abs=0.1)
    # Pixels are in proportion to angles, so that those of the middle have this solid angle.
    solid_angle = 256 * (math.pi / side) ** 2
    assert source.solid_angle == pytest.approx(solid_angle, rel=0.01)
    lux = math.pi * 179 * dim + 179 * (bright - dim) * solid_angle
    assert seen.eye_lux == pytest.approx(lux, rel=0.01)
    of_source = source.luminance**2 * source.solid_angle / (seen.eye_lux**1.87 * source.position_index**2)
    assert seen.probability == pytest.approx(5.87e-5 * seen.eye_lux + 9.18e-2 * math.log10(1 + of_source) + 0.16, rel=1e-3)
    # Turned away from it, less.
    panorama = np.full((128, 256, 3), dim, np.float32)
    panorama[60:68, 124:132] = bright
    assert ltm.glare(panorama, turn=(60, 0)).probability < ltm.glare(panorama).probability
    with pytest.raises(ValueError, match="shape"):
        ltm.glare(np.ones((4, 4)))
    with pytest.raises(ValueError, match="picture"):
        ltm.glare(np.ones((40, 60, 3)))
