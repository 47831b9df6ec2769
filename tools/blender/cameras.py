# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's camera as `[camera]` of a scene file."""

from math import atan, degrees, pi

from mathutils import Vector

from . import units
from .not_exported import NotExported


def entry(scene, remarks):
    """`[camera]` of the scene's camera. Raises NotExported."""
    camera = scene.camera
    if camera is None:
        raise NotExported("the scene has no camera: add one (Ctrl+Numpad 0 makes the selected one the scene's)")
    render = scene.render
    if render.use_border:
        remarks.append("the render region is not used: the whole image is rendered")
    turn = camera.matrix_world.to_3x3()
    size = (render.resolution_x, render.resolution_y)
    width, height = (max(1, side * render.resolution_percentage // 100) for side in size)
    found = {
        "eye": units.finite(units.axes(camera.matrix_world.translation)),
        "direction": units.finite(units.axes(turn @ Vector((0, 0, -1)))),
        "up": units.finite(units.axes(turn @ Vector((0, 1, 0)))),
        "width": width,
        "height": height,
    }
    if camera.data.type == "PANO":
        return found | panorama(camera, remarks)
    return found | flat(camera, scene, width, height) | lens(camera, turn, remarks)


def panorama(camera, remarks):
    """The keys of a panorama, of which only the whole equirectangular one is traced."""
    # From Blender 5 on the lens has it, before Cycles' part of the lens.
    pano = camera.data if hasattr(camera.data, "panorama_type") else camera.data.cycles
    if pano.panorama_type != "EQUIRECTANGULAR":
        raise NotExported(f"the camera '{camera.name}' is a panorama of another kind than equirectangular, which alone is traced")
    ranges = (pano.longitude_min, pano.longitude_max, pano.latitude_min, pano.latitude_max)
    if max(abs(a - b) for a, b in zip(ranges, (-pi, pi, -pi / 2, pi / 2))) > 1e-4:
        remarks.append("the panorama is rendered whole, not only the longitudes and latitudes that are set")
    if camera.data.dof.use_dof:
        remarks.append("depth of field is not used in a panorama: everything is in focus")
    return {"projection": "panorama"}


def flat(camera, scene, width, height):
    """The projection of a camera whose image is flat, its shift and the shape of its pixels."""
    corners = camera.data.view_frame(scene=scene)
    top, bottom = max(c.y for c in corners), min(c.y for c in corners)
    left, right = min(c.x for c in corners), max(c.x for c in corners)
    across, up = right - left, top - bottom
    if camera.data.type == "ORTHO":
        found = {"projection": "orthographic", "view_height": up}
    else:
        found = {"vertical_fov_degrees": 2 * degrees(atan(up / 2 / abs(corners[0].z)))}
    shift = [(left + right) / 2 / max(across, up), (bottom + top) / 2 / max(across, up)]
    if max(map(abs, shift)) > 1e-6:
        found["shift"] = shift
    aspect = across * height / (up * width)
    if abs(aspect - 1) > 1e-4:
        found["pixel_aspect"] = aspect
    return found


def lens(camera, turn, remarks):
    """The thin lens that Cycles makes of depth of field."""
    data = camera.data
    if not data.dof.use_dof:
        return {}
    distance = data.dof.focus_distance
    target = data.dof.focus_object
    if target is not None:
        place = target.matrix_world.translation
        bone = getattr(target, "pose", None) and target.pose.bones.get(data.dof.focus_subtarget)
        if bone:
            place = target.matrix_world @ bone.matrix.translation
        ahead = (turn @ Vector((0, 0, -1))).normalized()
        distance = abs((place - camera.matrix_world.translation).dot(ahead))
    # Of an orthographic camera the f-number is that of a lens of one metre.
    focal = 1.0 if data.type == "ORTHO" else data.lens * 1e-3
    radius = focal / (2 * max(data.dof.aperture_fstop, 1e-5))
    if not (distance > 0.0 and radius > 0.0):
        return {}
    if abs(data.dof.aperture_ratio - 1.0) > 1e-4:
        remarks.append("the ratio of the aperture is not used: its opening is as wide as high")
    found = {"aperture_radius": radius, "focus_distance": distance}
    if data.dof.aperture_blades >= 3:
        found["blades"] = min(64, data.dof.aperture_blades)
        found["blade_rotation_degrees"] = degrees(data.dof.aperture_rotation)
    return found
