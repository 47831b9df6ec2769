"""Makes the references that tests/transport/references.rs compares with: Mitsuba 3, scalar_rgb, its path
integrator, and its particle tracer for caustics of lights without a body, which paths from the camera never find; for
single layers and rough conductors llvm_ad_rgb, its rays, surfaces and lights (3.6.4; the scenes of `lobes.py` were made with 3.9.1).

    pip install mitsuba numpy
    python tests/references/make.py tests/references            # all scenes
    python tests/references/make.py tests/references caustics   # only this one

Each scene is a room lit by a panel of two texels, or by a point light and a spot, whose glass or mirror ball the
camera does not see: particles are joined to the camera at scattering surfaces alone. Balls are facets, a mesh with
smooth normals, or perfect spheres, as the scene's name says (facets where it says nothing). Those called direct have
emission, seen straight or in mirrors and smooth glass, and direct light of the first surface that scatters. A file holds, as little-endian f32, the mean image of each texel (or light) lit
alone, then the variance of that mean from independent renders: [mean, variance][texel][channel][y][x].
"""
import math
import os
import sys
import tempfile

import drjit as dr
import mitsuba as mi
import numpy as np

import compensated
import lobes

mi.set_variant("scalar_rgb")
SIDE, RENDERS, SAMPLES, DEPTH = 16, 16, 512, 24
# Of these the difference is compared: its noise is that of both.
OFTENER = {"smooth_glossy": 4, "direct_smooth_glossy": 4}


def add(a, b):
    return tuple(x + y for x, y in zip(a, b))


def quad(origin, u, v):
    return [(origin, add(origin, u), add(add(origin, u), v), add(origin, v))]


def room(low, high):
    d = tuple(h - l for l, h in zip(low, high))
    x, y, z = (d[0], 0, 0), (0, d[1], 0), (0, 0, d[2])
    minus = lambda a: tuple(-c for c in a)
    near = [(low, z, x), (low, x, y), (low, y, z)]
    far = [(high, minus(x), minus(z)), (high, minus(y), minus(x)), (high, minus(z), minus(y))]
    sides = near + far
    return [quad(*side)[0] for side in sides]


def sphere(centre, radius, rings):
    def at(i, j):
        t, p = math.pi * i / rings, math.pi * j / rings
        return (math.sin(t) * math.cos(p), math.cos(t), math.sin(t) * math.sin(p))

    faces = []
    for i in range(rings):
        for j in range(2 * rings):
            corners = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]
            faces.append([add(centre, tuple(radius * c for c in m)) for m in corners])
    return faces


class Ball:
    """A ball as a mesh with smooth normals of so many rings, or perfect (no rings)."""

    def __init__(self, centre, radius, rings=None):
        self.centre, self.radius, self.rings = centre, radius, rings

    def described(self, folder, name, bsdf):
        if self.rings is None:
            return {"type": "sphere", "center": list(self.centre), "radius": self.radius, "bsdf": bsdf}
        faces = sphere(self.centre, self.radius, self.rings)
        normal = lambda p: tuple((c - o) / self.radius for c, o in zip(p, self.centre))
        path = obj(folder, name, faces, [[normal(p) for p in face] for face in faces])
        return {"type": "obj", "filename": path, "bsdf": bsdf}


def obj(folder, name, faces, normals=None):
    path = os.path.join(folder, name + ".obj")
    with open(path, "w") as f:
        for face in faces:
            for p in face:
                f.write("v %.9g %.9g %.9g\n" % tuple(p))
        for face in normals or []:
            for n in face:
                f.write("vn %.9g %.9g %.9g\n" % tuple(n))
        for k in range(len(faces)):
            for corner in [(1, 2, 3), (1, 3, 4)]:
                ids = [4 * k + c for c in corner]
                points = [np.array(faces[k][c - 1]) for c in corner]
                if np.linalg.norm(np.cross(points[1] - points[0], points[2] - points[0])) < 1e-9:
                    continue
                f.write("f " + " ".join(f"{i}//{i}" if normals else str(i) for i in ids) + "\n")
    return path


def grey(r):
    return {"type": "rgb", "value": [r, r, r]}


def lambert(r):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": grey(r)}}


MIRROR = {"type": "twosided", "bsdf": {"type": "conductor", "material": "none", "specular_reflectance": grey(0.9)}}
GLOSSY = {"type": "twosided", "bsdf": {"type": "compensated", "alpha": 0.2}}
GLASS = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
SHEET = {"type": "thindielectric", "int_ior": 1.5, "ext_ior": 1.0}

WALLS = (room((0, 0, 0), (1, 1, 1)), lambert(0.5))
CEILING = ((0.25, 0.98, 0.25), (0.25, 0, 0), (0, 0, 0.5))
SCENES = {
    "diffuse": ([WALLS, (sphere((0.4, 0.25, 0.4), 0.2, 12), lambert(0.8))], CEILING),
    "reflections": (
        [WALLS, (sphere((0.3, 0.25, 0.4), 0.2, 24), MIRROR), (sphere((0.72, 0.22, 0.4), 0.18, 24), GLOSSY)],
        CEILING,
    ),
    "caustics": ([WALLS, (sphere((0.5, 0.35, 0.4), 0.25, 24), GLASS)], CEILING),
    "smooth_mirror": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25, 24), MIRROR)], CEILING),
    "smooth_glossy": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25, 24), GLOSSY)], CEILING),
    "smooth_glass": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25, 24), GLASS)], CEILING),
    "coarse_mirror": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25, 8), MIRROR)], CEILING),
    "coarse_glossy": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25, 8), GLOSSY)], CEILING),
    "coarse_glass": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25, 8), GLASS)], CEILING),
    "perfect_mirror": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25), MIRROR)], CEILING),
    "perfect_glossy": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25), GLOSSY)], CEILING),
    "perfect_glass": ([WALLS, (Ball((0.5, 0.35, 0.4), 0.25), GLASS)], CEILING),
    "light_in_view": (
        [WALLS, (quad((0.1, 0.2, 0.3), (0.5, 0, 0), (0, 0.6, 0)), SHEET)],
        ((0.3, 0.3, 0.02), (0.2, 0, 0), (0, 0.4, 0)),
    ),
}
SCENES |= {name: ([WALLS, *parts], CEILING) for name, parts in lobes.scenes(Ball, lambert).items()}


# A ball behind the upper edge of the picture, whose caustic falls on the wall in view; lights at its other side.
HIDDEN = Ball((0.5, 0.8, 0.5), 0.1, 128)
POINTS = {
    "point_glass": ([WALLS, (HIDDEN, GLASS)], (0.5, 0.9, 0.75)),
    "point_mirror": ([WALLS, (HIDDEN, MIRROR)], (0.5, 0.85, 0.25)),
}


LAMPS = [lamp for _, lamp in POINTS.values()]


# Emission and direct light alone.
DIRECT = {f"direct_{name}": name for name in ["diffuse", "smooth_glossy", "reflections", "caustics"]}


def bodiless(light, position):
    if light == 0:
        return {"type": "point", "position": list(position), "intensity": grey(1.0)}
    towards = mi.ScalarTransform4f().look_at(origin=list(position), target=list(HIDDEN.centre), up=[1, 0, 0])
    # An even cone: the two programs fade its edge by other rules.
    return {"type": "spot", "to_world": towards, "cutoff_angle": 30.0, "beam_width": 29.999, "intensity": grey(1.0)}


def seen_and_direct(scene, seed):
    """What each camera ray sees of lights, through mirrors and smooth glass, and what lights send straight to the first
    surface that scatters: one sample of a light, no path beyond."""
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, SIDE * SIDE * SAMPLES)
    pixel = dr.arange(mi.UInt32, SIDE * SIDE * SAMPLES) // SAMPLES
    position = (mi.Point2f(pixel % SIDE, pixel // SIDE) + sampler.next_2d()) / SIDE
    ray, weight = scene.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
    light, active, context = mi.Color3f(0.0), mi.Bool(True), mi.BSDFContext()
    for _ in range(DEPTH):
        hit = scene.ray_intersect(ray, active)
        active &= hit.is_valid()
        bsdf = hit.bsdf(ray)
        light += dr.select(active, weight * hit.emitter(scene).eval(hit, active), 0.0)
        passes = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Delta)
        scatters = active & ~passes
        towards, arriving = scene.sample_emitter_direction(hit, sampler.next_2d(scatters), True, scatters)
        reflected = bsdf.eval(context, hit, hit.to_local(towards.d), scatters)
        light += dr.select(scatters, weight * reflected * arriving, 0.0)
        onwards, through = bsdf.sample(context, hit, sampler.next_1d(passes), sampler.next_2d(passes), passes)
        weight *= dr.select(passes, through, 1.0)
        ray = hit.spawn_ray(hit.to_world(onwards.wo))
        active = passes
        dr.eval(light, active, weight, ray, sampler)
    samples = np.array(light, dtype=np.float64).T.reshape(SIDE * SIDE, SAMPLES, 3)
    return samples.mean(axis=1).reshape(SIDE, SIDE, 3)


def scene(folder, parts, texel, panel):
    camera = mi.ScalarTransform4f().look_at(origin=[0.5, 0.5, 0.95], target=[0.5, 0.4, 0.0], up=[0, 1, 0])
    described = {
        "type": "scene",
        "integrator": {"type": "ptracer" if panel in LAMPS else "path", "max_depth": DEPTH, "rr_depth": 6},
        "sensor": {
            "type": "perspective",
            "fov": 45.0 if panel in LAMPS else 75.0,
            "fov_axis": "y",
            "near_clip": 1e-3,
            "to_world": camera,
            "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": 4 * SAMPLES if panel in LAMPS else SAMPLES},
        },
    }
    for k, (shape, bsdf) in enumerate(parts):
        if hasattr(shape, "described"):
            described[f"part{k}"] = shape.described(folder, f"part{k}", bsdf)
        else:
            described[f"part{k}"] = {"type": "obj", "filename": obj(folder, f"part{k}", shape), "bsdf": bsdf,
                                     "face_normals": True}
    if panel in LAMPS:
        described["lamp"] = bodiless(texel, panel)
        return mi.load_dict(described)
    origin, u, v = panel
    for k in range(2):
        place = origin if k == 0 else add(origin, u)
        black = {"type": "diffuse", "reflectance": grey(0.0)}
        shape = obj(folder, f"texel{k}", quad(place, u, v))
        half = {"type": "obj", "filename": shape, "bsdf": black, "face_normals": True}
        if k == texel:
            half["emitter"] = {"type": "area", "radiance": grey(1.0)}
        described[f"texel{k}"] = half
    return mi.load_dict(described)


def main(target, names):
    for name in [*SCENES, *POINTS, *DIRECT]:
        parts, panel = (SCENES | POINTS)[DIRECT.get(name, name)]
        if names and name not in names:
            continue
        is_compensated = any(bsdf is GLOSSY for _, bsdf in parts)
        mi.set_variant("llvm_ad_rgb" if name in DIRECT or is_compensated else "scalar_rgb")
        if is_compensated:
            compensated.register()
        render = seen_and_direct if name in DIRECT else lambda scene, seed: mi.render(scene, seed=seed)
        means, variances = [], []
        for texel in range(2):
            with tempfile.TemporaryDirectory() as folder:
                loaded = scene(folder, parts, texel, panel)
                # Far apart: the particle tracer draws its parts from the seeds that follow.
                apart = 100_003 if panel in LAMPS else 1
                # Other paths than the whole image's, which it is subtracted from.
                first = 1000 * texel + (500 if name in DIRECT else 0)
                renders = RENDERS * OFTENER.get(name, 1)
                seeds = [apart * (first + s) for s in range(renders)]
                images = np.stack([np.array(render(loaded, seed), dtype=np.float64) for seed in seeds])
            means.append(images.mean(axis=0).transpose(2, 0, 1))
            variances.append(images.var(axis=0, ddof=1).transpose(2, 0, 1) / renders)
        data = np.stack([np.stack(means), np.stack(variances)]).astype("<f4")
        data.tofile(os.path.join(target, name + ".f32"))
        print(name, data.shape, data[0].mean(), flush=True)


main(sys.argv[1], sys.argv[2:])
