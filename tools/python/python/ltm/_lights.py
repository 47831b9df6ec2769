"""The columns of a matrix: lights by place and by name, and weights on them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Light:
    """One light and the columns that it owns.

    ``kind`` is one of lamp, area, lat-long, octahedral, point, spot, sun, ies, image, patches, suns. ``unit`` is what a weight of 1 is:
    radiance (W/(sr·m²)), intensity (W/sr), irradiance (W/m²), or multiple (of the light as it was rendered).
    ``grid`` counts its texels (down, across), (1, 1) for a light of one column; ``columns`` is their range, row by row.
    """

    name: str
    kind: str = "image"
    unit: str = "radiance"
    grid: tuple[int, int] = (1, 1)
    #: RGB weight with which the scene lights it, in ``unit``.
    emission: tuple[float, float, float] = (1.0, 1.0, 1.0)
    #: Columns × 3: centre of each emitter or texel in the scene, for environments and suns the direction towards it.
    places: NDArray[np.float32] | None = field(default=None, repr=False, compare=False)
    #: Area, or solid angle for environments and suns, of each column; 0 for point-like lights.
    extents: NDArray[np.float32] | None = field(default=None, repr=False, compare=False)
    columns: range = range(0)

    def _tuple(self) -> Any:
        down, across = self.grid
        places = np.zeros((down * across, 3)) if self.places is None else np.asarray(self.places)
        extents = np.ones(down * across) if self.extents is None else np.asarray(self.extents)
        return (
            self.name,
            self.kind,
            self.unit,
            (across, down),
            tuple(self.emission),
            places.tolist(),
            extents.tolist(),
        )


def light_tuples(lights: Sequence[str | Light] | None, columns: int) -> list[Any]:
    """What the native half wants of lights; ``light 0``, ``light 1`` … if there are none."""
    if lights is None:
        lights = [f"light {i}" for i in range(columns)]
    if isinstance(lights, str):
        raise TypeError("lights: give a sequence of names or of ltm.Light, not one string")
    return [(Light(light) if isinstance(light, str) else light)._tuple() for light in lights]


class Lights(Sequence[Light], Mapping[str, Light]):
    """The lights of a matrix in column order: a sequence, and a mapping by name.

    ``lights[0]`` and ``lights["desk"]`` are lights; iterating gives lights, ``keys()`` names; ``"desk" in lights``.
    """

    def __init__(self, tuples: list[Any]) -> None:
        self._lights: list[Light] = []
        first = 0
        for name, kind, unit, (across, down), emission, places, extents in tuples:
            columns = range(first, first + across * down)
            places = np.array(places, np.float32)
            extents = np.array(extents, np.float32)
            self._lights.append(Light(name, kind, unit, (down, across), tuple(emission), places, extents, columns))
            first = columns.stop
        self._by_name = {light.name: light for light in self._lights}
        #: Columns of the matrix.
        self.column_count = first

    def __len__(self) -> int:
        return len(self._lights)

    def __iter__(self) -> Iterator[Light]:
        return iter(self._lights)

    @overload
    def __getitem__(self, key: int | str) -> Light: ...
    @overload
    def __getitem__(self, key: slice) -> list[Light]: ...
    def __getitem__(self, key: Any) -> Any:
        """The light of a name or index. Raises KeyError with the nearest names, or IndexError."""
        if not isinstance(key, str):
            return self._lights[key]
        try:
            return self._by_name[key]
        except KeyError:
            raise KeyError(f"no light '{key}'; {self._nearest(key)}") from None

    def __contains__(self, key: object) -> bool:
        return key in self._by_name if isinstance(key, str) else key in self._lights

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lights) and self._lights == other._lights

    __hash__ = None  # type: ignore[assignment]

    def keys(self) -> Any:
        """The names."""
        return self._by_name.keys()

    def values(self) -> Any:
        """The lights."""
        return self._by_name.values()

    def items(self) -> Any:
        """Names with their lights."""
        return self._by_name.items()

    def get(self, key: Any, default: Any = None) -> Any:
        """The light of a name, or ``default``."""
        return self._by_name.get(key, default)

    def __repr__(self) -> str:
        names = ", ".join(repr(light.name) for light in self._lights[:8])
        return f"<{len(self)} lights: {names}{', …' if len(self) > 8 else ''}>"

    def match(self, pattern: str) -> list[Light]:
        """The lights whose names fit ``pattern`` (``*`` any letters, ``?`` one). Raises KeyError if there are none."""
        if pattern in self._by_name:
            return [self._by_name[pattern]]
        parts = (".*" if letter == "*" else "." if letter == "?" else re.escape(letter) for letter in pattern)
        fits = re.compile("".join(parts), re.DOTALL).fullmatch
        found = [light for light in self._lights if fits(light.name)]
        if not found:
            raise KeyError(f"no light fits '{pattern}'; {self._nearest(pattern)}")
        return found

    def _nearest(self, name: str) -> str:
        import difflib  # Not for every import of this package.

        near = difflib.get_close_matches(name, self._by_name, 3, 0.0)
        return "the nearest names are " + ", ".join(f"'{n}'" for n in near)

    def weights(self, values: Mapping[str, Any]) -> NDArray[np.float32]:
        """Weights (columns, 3) from values by light name or glob; a later entry wins, lights not named are off.

        A value is a number, an RGB colour, or for the n columns of a light an array (n,) or (n, 3); (3,) is a colour.
        Raises KeyError for a name that fits no light, ValueError for a value of another shape.
        """
        weights = np.zeros((self.column_count, 3), np.float32)
        for pattern, value in values.items():
            for light in self.match(pattern):
                part = real_array(value, f"weight of '{pattern}'")
                count = len(light.columns)
                if part.shape == (count,) and count != 3:
                    part = part[:, None]
                if part.shape not in ((), (3,), (count, 1), (count, 3)):
                    raise ValueError(
                        f"weight of '{pattern}': has the shape {part.shape}; light '{light.name}' takes a number, "
                        f"(3,), ({count},) or ({count}, 3)"
                    )
                weights[light.columns.start : light.columns.stop] = part
        return weights


def real_array(value: Any, what: str) -> NDArray[np.float32]:
    """An array of real numbers as float32. Raises TypeError for other dtypes."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{what}: has dtype {array.dtype}, real numbers are needed")
    with np.errstate(over="ignore"):
        return array.astype(np.float32, copy=False)
