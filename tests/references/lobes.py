"""Scenes of `make.py` with one lobe or texture each: a ball of its rough dielectric, plastic and principled metal and mix, and a board
with a map of normals, of heights and of opacity. Their maps are 8 × 8 bytes of whole numbers, which tests/transport/lobes.rs writes alike.

Light of several facets is lost in Mitsuba: a white ball in a white room is 0.994 of rough glass of alpha 0.03, 0.959 of 0.1, and 0.795 of
`roughplastic` of alpha 0.2, so that glass is nearly smooth here and plastic smooth, which loses nothing. Maps of normals and heights soften
their terminators there unless told otherwise."""
import os

import mitsuba as mi
import numpy as np

WAVE = np.array([0, 42, 60, 42, 0, -42, -60, -42])
# Of the board: its corner and edges. Heights are in units of its width in our scene, in the scene's own in Mitsuba.
ORIGIN, EDGE_U, EDGE_V = (0.2, 0.15, 0.5), (0.6, 0.0, 0.0), (0.0, 0.4, -0.2)
HEIGHT = 0.3 * EDGE_U[0]
PLAIN = {"use_shadowing_function": False, "flip_invalid_normals": False}


class Board:
    """A parallelogram with texture coordinates from 0 to 1."""

    def described(self, folder, name, bsdf):
        corners = [np.add(ORIGIN, np.multiply(u, EDGE_U) + np.multiply(v, EDGE_V)) for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
        path = os.path.join(folder, name + ".obj")
        with open(path, "w") as f:
            for corner in corners:
                f.write("v %.9g %.9g %.9g\n" % tuple(corner))
            f.write("vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
        return {"type": "obj", "filename": path, "face_normals": True, "bsdf": bsdf}


def bitmap(pixels):
    """Numbers, upper row first."""
    bitmap = mi.Bitmap(np.asarray(pixels, np.uint8))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear", "wrap_mode": "repeat"}


def grey(value):
    return {"type": "rgb", "value": [value] * 3}


def scenes(ball, lambert):
    across, down = np.meshgrid(WAVE, WAVE)
    heights = (128 + across + down)[..., None]
    normals = np.stack([128 + across, 128 + down, np.full((8, 8), 240)], axis=-1)
    sphere = ball((0.5, 0.35, 0.4), 0.25)
    one = lambda bsdf: {"type": "twosided", "bsdf": bsdf}
    matte = {"type": "diffuse", "reflectance": grey(0.8)}
    plastic = {"type": "plastic", "int_ior": 1.5, "ext_ior": 1.0, "diffuse_reflectance": grey(0.5)}
    glass = {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.03, "int_ior": 1.5, "ext_ior": 1.0}
    metal = {"type": "principled", "base_color": grey(0.6), "metallic": 1.0, "roughness": 0.2, "eta": 1.5}
    mixed = {"type": "principled", "base_color": grey(0.6), "metallic": 0.6, "roughness": 0.5, "eta": 1.5}
    return {
        "rough_glass": [(sphere, glass)],
        "plastic": [(sphere, one(plastic))],
        "principled_metal": [(sphere, one(metal))],
        "principled": [(sphere, one(mixed))],
        "normal_map": [(Board(), one({"type": "normalmap", "normalmap": bitmap(normals), "bsdf": matte, **PLAIN}))],
        "height_map": [(Board(), one({"type": "bumpmap", "arbitrary": bitmap(heights), "scale": HEIGHT, "bsdf": matte, **PLAIN}))],
        "mask": [(Board(), {"type": "mask", "opacity": bitmap(heights), "bsdf": one(matte)})],
    }
