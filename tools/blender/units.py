# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's strengths as radiometric numbers, and Blender's axes as those of glTF.

A pixel of Cycles is a radiance in W·sr⁻¹·m⁻², and so is one of ltm. README.md has each factor with a worked number.
"""

from math import cos, pi


def axes(vector):
    """A vector of Blender (z up) in the axes of glTF (y up)."""
    x, y, z = vector
    return (x, z, -y)


def intensity_per_watt():
    """W·sr⁻¹ of a point or spot for each watt; a spot is a point of which a cone is seen."""
    return 1.0 / (4.0 * pi)


def radiance_per_watt(area):
    """W·sr⁻¹·m⁻² of an area light of so many square metres for each watt."""
    return 1.0 / (pi * area)


def full_light(half_angle, blend):
    """Cosine of the half angle within which a spot of this half angle (radians) and blend (0 to 1) shines fully."""
    edge = cos(half_angle)
    return edge + (1.0 - edge) * blend


def finite(numbers):
    """The numbers as a list of plain floats."""
    return [float(number) for number in numbers]
