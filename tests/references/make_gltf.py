"""Makes `gltf.glb`, `gltf_plastic.glb` and the references that tests/scene/gltf_reference.rs compares with: Mitsuba 3, scalar_rgb,
its path integrator.

    pip install mitsuba numpy
    python tests/references/make_gltf.py tests/references

Both sides are written here from the same numbers: the glTF file byte by byte, with nodes, transforms and metallic-roughness
materials; for Mitsuba the meshes in world space, and its own names for the same materials. The room has two emissive quads. A
reference holds, as little-endian f32, the mean image of each light alone at a radiance of 1, then the variance of that mean:
[mean, variance][light][channel][y][x].
"""
import json
import math
import os
import struct
import sys
import tempfile
import zlib

import compensated
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
compensated.register()
SIDE, RENDERS, SAMPLES, DEPTH = 16, 16, 512, 24
EYE, YFOV = (0.5, 0.5, 0.95), math.radians(75.0)

#: sRGB, upper row first.
CHECKER = np.array([[[230, 230, 230], [40, 90, 200]], [[200, 60, 40], [60, 180, 60]]], np.uint8)


def translated(x, y, z):
    return np.array([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def quad(origin, u, v):
    origin, u, v = map(np.array, (origin, u, v))
    return np.array([origin, origin + u, origin + u + v, origin + v]), np.array([[0, 1, 2], [0, 2, 3]])


def ball(rings):
    """A ball of radius 1 in facets: positions and triangles."""
    points = [
        (math.sin(t) * math.cos(p), math.cos(t), math.sin(t) * math.sin(p))
        for t in (math.pi * i / rings for i in range(rings + 1))
        for p in (math.pi * j / rings for j in range(2 * rings))
    ]
    triangles = []
    for i in range(rings):
        for j in range(2 * rings):
            a, b = 2 * rings * i + j, 2 * rings * i + (j + 1) % (2 * rings)
            c, d = b + 2 * rings, a + 2 * rings
            triangles += ([(a, b, c)] if i > 0 else []) + ([(a, c, d)] if i < rings - 1 else [])
            if i == 0:
                triangles[-1] = (a, c, d)
    return np.array(points), np.array(triangles)


def pbr(colour, metallic, roughness, **more):
    return {"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1], "metallicFactor": metallic, "roughnessFactor": roughness, **more}}


def extended(material, **extensions):
    return {**material, "extensions": {f"KHR_materials_{name}": value for name, value in extensions.items()}}


def matte(colour, **more):
    return extended(pbr(colour, 0, 1, **more), specular={"specularFactor": 0})


def rgb(colour):
    return {"type": "rgb", "value": list(colour)}


def twosided(bsdf):
    return {"type": "twosided", "bsdf": bsdf}


def diffuse(colour):
    return twosided({"type": "diffuse", "reflectance": rgb(colour)})


SHEET = extended(pbr((0.8, 1.0, 0.6), 0, 0), transmission={"transmissionFactor": 1})
GLOW = {"emissiveFactor": [1, 1, 1], **extended(pbr((0, 0, 0), 0, 1), specular={"specularFactor": 0}, emissive_strength={"emissiveStrength": 2})}

# The glTF material and Mitsuba's. The floor's colours are a bitmap.
GREY = (matte((0.5, 0.5, 0.5)), diffuse((0.5, 0.5, 0.5)))
MIRROR = (pbr((0.9, 0.6, 0.3), 1, 0), twosided({"type": "conductor", "material": "none", "specular_reflectance": rgb((0.9, 0.6, 0.3))}))
METAL = (pbr((1, 1, 1), 1, 0.45), twosided({"type": "compensated", "alpha": 0.45**2}))
PANE = (SHEET, {"type": "thindielectric", "int_ior": 1.5, "ext_ior": 1.0, "specular_transmittance": rgb((0.8, 1.0, 0.6))})
PLASTIC = (pbr((0.1, 0.3, 0.7), 0, 0.5), twosided({"type": "principled", "base_color": rgb((0.1, 0.3, 0.7)), "metallic": 0.0, "roughness": 0.5, "eta": 1.5}))


def floor():
    bitmap = mi.Bitmap(CHECKER)
    texture = {"type": "bitmap", "bitmap": bitmap, "filter_type": "bilinear", "wrap_mode": "repeat"}
    return matte((1, 1, 1), baseColorTexture={"index": 0}), twosided({"type": "diffuse", "reflectance": texture})


def parts(balls):
    """Name, mesh, placement, materials; the ball's shapes are of radius 1."""
    low, high = np.zeros(3), np.ones(3)
    x, y, z = np.eye(3)
    walls = [(low, y, x), (low, z, y), (high, -x, -y), (high, -y, -z), (high, -z, -x)]
    found = [("floor", quad(low, z, x), np.eye(4), floor())]
    found += [(f"wall {i}", quad(*wall), np.eye(4), GREY) for i, wall in enumerate(walls)]
    sphere = ball(12)
    # One ball hangs below another node; one is mirrored, which changes its winding and not its shape.
    places = [translated(0.3, 0.25, 0.4) @ np.diag([0.2, 0.2, 0.2, 1]), translated(0.72, 0.22, 0.4) @ np.diag([-0.18, 0.18, 0.18, 1])]
    found += [(f"ball {i}", sphere, place, material) for i, (place, material) in enumerate(zip(places, balls))]
    found.append(("pane", quad((0.05, 0.45, 0.3), (0.3, 0, 0), (0, 0.4, 0)), np.eye(4), PANE))
    for i, name in enumerate(("left", "right")):
        found.append((name, quad((0.2 + 0.35 * i, 0.98, 0.25), (0.25, 0, 0), (0, 0, 0.5)), np.eye(4), (GLOW, None)))
    return found


def png(pixels):
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def write_glb(path, described):
    data, views, accessors, materials, meshes, nodes = b"", [], [], [], [], []

    def view(content):
        nonlocal data
        data += b"\0" * (-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content)})
        data += content
        return len(views) - 1

    def accessor(values, component, kind, **bounds):
        accessors.append({"bufferView": view(values.tobytes()), "componentType": component, "type": kind, "count": len(values), **bounds})
        return len(accessors) - 1

    known = {}
    for name, (points, triangles), place, (material, _) in described:
        materials.append({"name": name, **material})
        if id(points) not in known:
            positions = points.astype("<f4")
            bounds = {"min": positions.min(0).tolist(), "max": positions.max(0).tolist()}
            attributes = {"POSITION": accessor(positions, 5126, "VEC3", **bounds)}
            if name == "floor":
                # u along x and v along z; (0, 0) is the upper left of the image.
                attributes["TEXCOORD_0"] = accessor(points[:, [0, 2]].astype("<f4"), 5126, "VEC2")
            known[id(points)] = attributes, accessor(triangles.astype("<u2").ravel(), 5123, "SCALAR")
        attributes, indices = known[id(points)]
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": len(materials) - 1}]})
        nodes.append({"name": name, "mesh": len(meshes) - 1, "matrix": place.T.ravel().tolist()})
    tops = list(range(len(nodes)))
    # The first ball's place is that of its parent and its own together.
    first = next(i for i, node in enumerate(nodes) if node["name"] == "ball 0")
    place = described[first][2]
    nodes[first]["matrix"] = np.diag(np.diag(place)).T.ravel().tolist()
    nodes.append({"name": "stand", "translation": place[:3, 3].tolist(), "children": [first]})
    tops.remove(first)
    tops.append(len(nodes) - 1)
    # Towards 0.5, 0.4, 0: a turn about x.
    turn = math.atan2(0.4 - EYE[1], EYE[2])
    nodes.append({"name": "eye", "camera": 0, "translation": EYE, "rotation": [math.sin(turn / 2), 0, 0, math.cos(turn / 2)]})
    tops.append(len(nodes) - 1)
    image = view(png(CHECKER))
    tree = {
        "asset": {"version": "2.0", "generator": "tests/references/make_gltf.py"},
        "scene": 0, "scenes": [{"nodes": tops}], "nodes": nodes, "meshes": meshes, "materials": materials,
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data)}],
        "images": [{"bufferView": image, "mimeType": "image/png"}], "textures": [{"source": 0}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": YFOV, "znear": 0.01, "aspectRatio": 1}}],
        "extensionsUsed": [f"KHR_materials_{name}" for name in ("emissive_strength", "specular", "transmission")],
    }
    text = json.dumps(tree, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    with open(path, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data)


def scene(folder, described, lit):
    camera = mi.ScalarTransform4f().look_at(origin=EYE, target=[0.5, 0.4, 0.0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "pixel_format": "rgb", "component_format": "float32", "rfilter": {"type": "box"}}
    world = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": DEPTH, "rr_depth": 6},
        "sensor": {"type": "perspective", "fov": math.degrees(YFOV), "fov_axis": "y", "near_clip": 1e-3, "to_world": camera,
                   "film": film, "sampler": {"type": "independent", "sample_count": SAMPLES}},
    }
    for index, (name, (points, triangles), place, (_, bsdf)) in enumerate(described):
        at = points @ place[:3, :3].T + place[:3, 3]
        flip = np.linalg.det(place[:3, :3]) < 0
        path = os.path.join(folder, f"{index}.obj")
        with open(path, "w") as file:
            file.writelines("v %.9g %.9g %.9g\n" % tuple(p) for p in at)
            # Mitsuba counts v from below.
            file.writelines("vt %.9g %.9g\n" % (p[0], 1 - p[2]) for p in at)
            for a, b, c in triangles + 1:
                a, b, c = (a, c, b) if flip else (a, b, c)
                file.write(f"f {a}/{a} {b}/{b} {c}/{c}\n")
        shape = {"type": "obj", "filename": path, "face_normals": True, "bsdf": bsdf or {"type": "diffuse", "reflectance": rgb((0, 0, 0))}}
        if name == lit:
            shape["emitter"] = {"type": "area", "radiance": rgb((1, 1, 1))}
        world[f"part{index}"] = shape
    return mi.load_dict(world)


def main(target):
    for name, balls in (("gltf", (MIRROR, METAL)), ("gltf_plastic", (PLASTIC, PLASTIC))):
        described = parts(balls)
        write_glb(os.path.join(target, name + ".glb"), described)
        means, variances = [], []
        for seed, lit in enumerate(("left", "right")):
            with tempfile.TemporaryDirectory() as folder:
                loaded = scene(folder, described, lit)
                images = np.stack([np.array(mi.render(loaded, seed=1000 * seed + s), dtype=np.float64) for s in range(RENDERS)])
            means.append(images.mean(axis=0).transpose(2, 0, 1))
            variances.append(images.var(axis=0, ddof=1).transpose(2, 0, 1) / RENDERS)
        data = np.stack([np.stack(means), np.stack(variances)]).astype("<f4")
        data.tofile(os.path.join(target, name + ".f32"))
        print(name, data.shape, data[0].mean(axis=(2, 3)), flush=True)


main(sys.argv[1])
