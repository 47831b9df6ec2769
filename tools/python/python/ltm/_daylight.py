"""A year of daylight over a matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
