"""A year of daylight over a matrix, and glare in pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _ltm
from ._lights import real_array


@dataclass(frozen=True)
class DaylightYear:
    """What a year of a climate gives at each pixel or sensor, and at all of them together."""

    #: Float32 (height, width) by name, such as ``da`` and ``mean_lux``; NaN where no light reaches. The guide lists them.
    measures: dict[str, NDArray[np.float32]]
    #: Their units.
    units: dict[str, str]
    #: Spatial daylight autonomy (300 lx, half of the time of use) in percent.
    spatial_autonomy: float
    #: Annual sunlight exposure (1,000 lx, 250 hours) in percent; None where direct sun is not known.
    sunlight_exposure: float | None
    #: Class of EN 17037: 0 (less than the minimum) to 3 (high).
    en_17037_class: int
    #: Places that no light reaches.
    dark: int

    def to_xarray(self) -> Any:
        """The measures as an ``xarray.Dataset`` with the dimensions y and x. Raises ModuleNotFoundError without xarray."""
        import xarray

        arrays = {
            name: xarray.DataArray(values, dims=("y", "x"), attrs={"units": self.units[name]})
            for name, values in self.measures.items()
        }
        spatial = {
            "spatial_autonomy": self.spatial_autonomy,
            "en_17037_class": self.en_17037_class,
            "dark": self.dark,
        }
        if self.sunlight_exposure is not None:
            spatial["sunlight_exposure"] = self.sunlight_exposure
        return xarray.Dataset(arrays, attrs=spatial)


@dataclass(frozen=True)
class GlareSource:
    """A source of glare in a picture."""

    #: Unit direction of its middle: to the right, up, and along the line of sight.
    direction: tuple[float, float, float]
    #: Mean luminance in cd/m².
    luminance: float
    #: In steradians.
    solid_angle: float
    #: How little it disturbs for where it stands: 1 in the line of sight.
    position_index: float


@dataclass(frozen=True)
class Glare:
    """Glare that an eye sees."""

    #: The daylight glare probability DGP, found for 0.2 to 0.8 and above 380 lx at the eye.
    probability: float
    #: Illuminance across the line of sight in lux.
    eye_lux: float
    #: Sources of glare, the brightest for the eye first.
    sources: tuple[GlareSource, ...]


def glare(picture: ArrayLike, *, turn: tuple[float, float] = (0, 0), threshold: float = 2000) -> Glare:
    """Glare in a picture of radiance, (height, width, 3), as ``ltm glare`` finds it: a square one is a fisheye of 180°, one twice as wide
    as high a panorama, in which the eye is turned from the middle by ``turn`` degrees to the right and up. A pixel is part of a source
    above ``threshold`` cd/m².

    Raises ValueError for other shapes and for values that are not finite.
    """
    array = real_array(picture, "picture")
    if array.ndim != 3 or array.shape[2] != 3:
        raise ValueError(f"picture: has the shape {array.shape}; give (height, width, 3)")
    right, up = turn
    seen = _ltm.glare(np.ascontiguousarray(array), (right, up), threshold, "picture")
    return Glare(**{**seen, "sources": tuple(GlareSource(*source) for source in seen["sources"])})
