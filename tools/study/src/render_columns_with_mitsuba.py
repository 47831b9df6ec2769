"""Renders every column of a light transport matrix with Mitsuba 3, as a program that knows nothing of ltm would.

Arguments: a folder, the name of a scene below, width and height in pixels, texels along the light, samples per pixel, seed. Writes
NAME-SAMPLES-SEED.npy: little-endian float32, [columns, height, width, 3], a column for each texel of the light, row by row. The light is
a square of TEXELS x TEXELS, or a sky of 2 TEXELS x TEXELS directions / 2 (latitude and longitude). All columns share their camera paths,
of one light sample a vertex, as light groups do; nothing is said of the noise.
"""
import os
import sys

folder, name = sys.argv[1], sys.argv[2]
width, height, texels, samples, first_seed = map(int, sys.argv[3:8])

import mitsuba as mi

mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Error)

import drjit as dr
import numpy as np

Transform = mi.ScalarTransform4f
MAX_DEPTH = 10
# Paths that are followed at once.
PATHS = 1 << 20


def diffuse(red, green, blue):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [red, green, blue]}}}


def metal(roughness):
    if roughness == 0:
        return {"type": "conductor", "material": "Ag"}
    return {"type": "roughconductor", "material": "Al", "alpha": roughness, "distribution": "ggx"}


def plastic(red, green, blue, roughness):
    colour = {"type": "rgb", "value": [red, green, blue]}
    return {"type": "twosided", "bsdf": {"type": "roughplastic", "diffuse_reflectance": colour, "alpha": roughness}}


GLASS = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
WHITE = diffuse(0.75, 0.75, 0.75)


def rectangle(centre, towards, half, bsdf, up=(0, 0, 1), light=False):
    """Of these half sides, facing a point."""
    if abs(np.dot(np.subtract(towards, centre), up)) > 0.99 * np.linalg.norm(np.subtract(towards, centre)):
        up = (0, 1, 0)
    place = Transform().look_at(origin=centre, target=towards, up=up) @ Transform().scale([half[0], half[1], 1])
    shape = {"type": "rectangle", "to_world": place, "bsdf": bsdf}
    if light:
        shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    return shape


def box(centre, half, turn, bsdf):
    place = Transform().translate(centre) @ Transform().rotate([0, 0, 1], turn) @ Transform().scale(half)
    return {"type": "cube", "to_world": place, "bsdf": bsdf}


def sphere(centre, radius, bsdf):
    return {"type": "sphere", "center": centre, "radius": radius, "bsdf": bsdf}


def pipe(low, high, radius, bsdf):
    return {"type": "cylinder", "p0": low, "p1": high, "radius": radius, "bsdf": bsdf}


def room(left, right, floor=WHITE, back=WHITE):
    """From -1 to 1, open towards the camera at negative y."""
    return {
        "floor": rectangle((0, 0, -1), (0, 0, 0), (1, 1), floor),
        "ceiling": rectangle((0, 0, 1), (0, 0, 0), (1, 1), WHITE),
        "back": rectangle((0, 1, 0), (0, 0, 0), (1, 1), back),
        "left": rectangle((-1, 0, 0), (0, 0, 0), (1, 1), left),
        "right": rectangle((1, 0, 0), (0, 0, 0), (1, 1), right),
    }


RED, GREEN, BLUE, YELLOW = diffuse(0.6, 0.1, 0.08), diffuse(0.15, 0.5, 0.12), diffuse(0.12, 0.2, 0.6), diffuse(0.7, 0.55, 0.1)
# Out of view, and in it.
FRONT = rectangle((0, -1.2, 1), (0, 0.2, -0.6), (0.6, 0.6), WHITE, light=True)
CORNER = rectangle((-1.4, -1.5, 0.5), (0.2, 0.3, -0.5), (0.55, 0.55), WHITE, light=True)
ABOVE = rectangle((0, 0, 0.98), (0, 0, 0), (0.6, 0.6), WHITE, light=True)
BEHIND = rectangle((0.1, 0.98, 0.2), (0.1, 0, 0.2), (0.5, 0.5), WHITE, light=True)
SKY = {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
LOOKS = {"room": ((0, -3.6, 0), (0, 0, 0), 36), "low": ((0.3, -3.4, -0.4), (0, 0, -0.15), 34), "out": ((2.6, -3.4, 1.2), (0, 0, -0.4), 36)}

# Those of "a" may be tuned on; those of "b" judge.
SCENES = {
    "diffuse-a": ("room", FRONT, room(RED, GREEN) | {
        "tall": box((-0.35, 0.3, -0.4), (0.28, 0.28, 0.6), 20, WHITE), "small": box((0.4, -0.3, -0.7), (0.3, 0.3, 0.3), -18, WHITE)}),
    "diffuse-b": ("low", CORNER, room(BLUE, YELLOW) | {
        "ball": sphere((0.4, 0.2, -0.55), 0.45, WHITE), "post": pipe((-0.4, 0.3, -1), (-0.4, 0.3, 1), 0.12, RED),
        "step": box((0.2, -0.5, -0.9), (0.6, 0.15, 0.1), 8, WHITE)}),
    "reflections-a": ("room", FRONT, room(RED, GREEN) | {
        "ball": sphere((-0.4, 0.2, -0.6), 0.4, metal(0)), "small": box((0.4, 0.0, -0.6), (0.3, 0.3, 0.4), -18, metal(0.15))}),
    "reflections-b": ("low", CORNER, room(BLUE, WHITE, floor=plastic(0.3, 0.2, 0.1, 0.1)) | {
        "post": pipe((0.1, 0.4, -1), (0.1, 0.4, 0.4), 0.3, metal(0.08)), "ball": sphere((0.6, -0.1, -0.75), 0.25, metal(0.3)),
        "case": box((-0.5, 0.2, -0.75), (0.25, 0.25, 0.25), 30, metal(0))}),
    "caustics-a": ("room", FRONT, room(RED, GREEN) | {"ball": sphere((0.1, 0, -0.45), 0.45, GLASS)}),
    "caustics-b": ("low", CORNER, room(BLUE, YELLOW) | {
        "ball": sphere((0.3, 0, -0.6), 0.38, GLASS), "second": sphere((-0.45, 0.3, -0.75), 0.25, GLASS),
        "ring": pipe((0.5, -0.6, -1), (0.5, -0.6, -0.85), 0.25, {"type": "twosided", "bsdf": metal(0)})}),
    "mixed-a": ("room", BEHIND, room(RED, GREEN, floor=plastic(0.4, 0.4, 0.4, 0.15)) | {
        "ball": sphere((-0.45, 0.1, -0.6), 0.38, GLASS), "small": box((0.45, 0.2, -0.6), (0.28, 0.28, 0.4), -18, metal(0.1))}),
    "mixed-b": ("low", ABOVE, room(BLUE, WHITE) | {
        "ball": sphere((0.45, 0.1, -0.6), 0.4, metal(0)), "second": sphere((-0.3, -0.3, -0.7), 0.3, GLASS),
        "tall": box((-0.4, 0.5, -0.5), (0.25, 0.25, 0.5), 40, plastic(0.6, 0.1, 0.1, 0.2))}),
    "environment-a": ("out", SKY, {
        "floor": rectangle((0, 0, -1), (0, 0, 0), (6, 6), WHITE), "tall": box((-0.4, 0.3, -0.3), (0.3, 0.3, 0.7), 20, RED),
        "ball": sphere((0.5, -0.3, -0.6), 0.4, metal(0.1)), "small": box((0.9, 0.9, -0.7), (0.4, 0.2, 0.3), 50, WHITE)}),
    "environment-b": ("out", SKY, {
        "floor": rectangle((0, 0, -1), (0, 0, 0), (6, 6), plastic(0.3, 0.3, 0.35, 0.2)), "wall": box((-1.2, 0.4, 0), (0.1, 1.6, 1), 0, YELLOW),
        "roof": box((-0.2, 0.6, 0.6), (1, 0.8, 0.05), 0, WHITE), "post": pipe((0.7, 0, -1), (0.7, 0, 0.6), 0.1, WHITE),
        "ball": sphere((0.1, -0.6, -0.65), 0.35, plastic(0.1, 0.3, 0.6, 0.05)), "second": sphere((0, 0.6, -0.5), 0.5, WHITE)}),
}

look, light, parts = SCENES[name]
origin, target, angle = LOOKS[look]
is_sky = light is SKY
across, down = (texels, texels // 2) if is_sky else (texels, texels)
columns = across * down
scene = mi.load_dict(parts | {
    "type": "scene", "light": light,
    "sensor": {
        "type": "perspective", "fov": angle, "fov_axis": "y", "near_clip": 1e-3,
        "to_world": Transform().look_at(origin=origin, target=target, up=(0, 0, 1)),
        "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
    },
})
sensor, context = scene.sensors()[0], mi.BSDFContext()
pixels = width * height
matrix = dr.zeros(mi.Float, columns * pixels * 3)


def add(uv, towards, value, pixel, active):
    """Adds radiance that came from a place on the light or from a direction of the sky."""
    if is_sky:
        u, v = (dr.atan2(towards.y, towards.x) + dr.pi) / (2 * dr.pi), dr.acos(dr.clip(towards.z, -1, 1)) / dr.pi
    else:
        u, v = uv.x, uv.y
    column = dr.clip(mi.Int32(v * down), 0, down - 1) * across + dr.clip(mi.Int32(u * across), 0, across - 1)
    at = (mi.UInt32(column) * pixels + pixel) * 3
    for channel in range(3):
        dr.scatter_add(matrix, value[channel], at + channel, active & dr.isfinite(value[channel]))


def follow(seed, per_pixel):
    """Paths from every pixel, by the steps of Mitsuba's own path integrator."""
    paths = pixels * per_pixel
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, paths)
    pixel = dr.arange(mi.UInt32, paths) // per_pixel
    place = mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width)) + sampler.next_2d()
    ray, weight = sensor.sample_ray(0.0, 0.5, place / mi.ScalarVector2f(width, height), sampler.next_2d())

    def step(sampler, ray, through, depth, before, before_pdf, before_delta, active):
        si = scene.ray_intersect(ray, active)
        seen = si.emitter(scene, active)
        lit = active & (seen != None)
        ds = mi.DirectionSample3f(scene, si, before)
        pdf = scene.pdf_emitter_direction(before, ds, lit & ~before_delta)
        share = dr.select(before_delta, 1.0, before_pdf / dr.maximum(before_pdf + pdf, 1e-20))
        add(si.uv, ray.d, through * share * seen.eval(si, lit), pixel, lit)

        onwards = active & si.is_valid() & (depth + 1 < MAX_DEPTH)
        bsdf = si.bsdf()
        rough = onwards & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        ds, of_light = scene.sample_emitter_direction(si, sampler.next_2d(), True, rough)
        rough &= ds.pdf > 0
        value, value_pdf, sample, sample_weight = bsdf.eval_pdf_sample(
            context, si, si.to_local(ds.d), sampler.next_1d(onwards), sampler.next_2d(onwards), onwards)
        share = ds.pdf / dr.maximum(ds.pdf + value_pdf, 1e-20)
        add(ds.uv, ds.d, through * value * of_light * share, pixel, rough)

        ray = si.spawn_ray(si.to_world(sample.wo))
        through = through * sample_weight
        lives = dr.select(depth >= 5, dr.minimum(dr.max(through), 0.95), 1.0)
        onwards &= (sampler.next_1d(onwards) < lives) & (dr.max(through) > 0)
        through = through / dr.maximum(lives, 1e-6)
        is_delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        return sampler, ray, through, depth + 1, mi.Interaction3f(si), sample.pdf, is_delta, onwards

    state = (sampler, mi.Ray3f(ray), mi.Spectrum(weight), mi.UInt32(0), dr.zeros(mi.Interaction3f, paths), mi.Float(1), mi.Bool(True), mi.Bool(True))
    dr.while_loop(state, lambda *state: state[-1], step)
    dr.eval(matrix)


per_pass = max(1, min(samples, PATHS // pixels))
done = 0
while done < samples:
    now = min(per_pass, samples - done)
    follow(first_seed * 100_000 + done, now)
    done += now
array = (np.array(matrix) / samples).reshape(columns, height, width, 3).astype("<f4")
np.save(os.path.join(folder, f"{name}-{samples}-{first_seed}.npy"), array)
