# SPDX-License-Identifier: GPL-3.0-or-later
"""The same room through cameras of every kind, by us and by Cycles.

Tolerances, beside the noise of 256 samples: 1 % of the mean of an image; 3 % of it for the root mean square over squares of 8 × 8 pixels, where
a shift by a pixel would be some 5 %.
"""

import subprocess
from math import pi

import bpy
import numpy
import pytest
import room

MEAN, CELLS = 0.01, 0.03


def shifted(scene):
    scene.camera.data.shift_x, scene.camera.data.shift_y = 0.12, -0.2


def shifted_by_height(scene):
    """The sensor fits the height, and the image is higher than wide."""
    shifted(scene)
    scene.camera.data.sensor_fit = "VERTICAL"
    scene.render.resolution_x, scene.render.resolution_y = 72, 96


def wide_pixels(scene):
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = 1.6, 1.0
    scene.camera.data.shift_y = 0.1


def orthographic(scene):
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.6
    scene.camera.data.shift_x = 0.1


def panorama(scene):
    scene.camera.data.type = "PANO"
    pano = scene.camera.data if hasattr(scene.camera.data, "panorama_type") else scene.camera.data.cycles
    pano.panorama_type = "EQUIRECTANGULAR"
    scene.camera.location, scene.camera.rotation_euler = (0.2, -0.6, 1.4), (pi / 2 - 0.3, 0.0, 0.4)


def focus(scene, **settings):
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance = True, 5.0
    for key, value in settings.items():
        setattr(dof, key, value)


def lens(scene):
    focus(scene, aperture_fstop=0.06, aperture_blades=5, aperture_rotation=0.4)


def lens_on_the_ball(scene):
    focus(scene, aperture_fstop=0.04, focus_object=scene.objects["Sphere"])


def orthographic_lens(scene):
    orthographic(scene)
    focus(scene, aperture_fstop=1.2, aperture_blades=3)


CAMERAS = (shifted, shifted_by_height, wide_pixels, orthographic, panorama, lens, lens_on_the_ball, orthographic_lens)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.__name__)
def test_a_camera_sees_what_it_sees_in_cycles(scene, program, tmp_path, camera):
    room.lamp("POINT", "bulb", (-1.2, -1.0, 2.5), energy=60, color=(1.0, 0.8, 0.5), shadow_soft_size=0)
    room.world((0.3, 0.5, 1.0), 0.4)
    camera(scene)
    compare(scene, program, tmp_path, camera.__name__)


def compare(scene, program, tmp_path, name):
    """Holds our picture to that of Cycles."""
    scene.ltm.samples = 256
    assert bpy.ops.ltm.render() == {"FINISHED"}
    image = tmp_path / "ours.exr"
    relight = [program, "relight", next(tmp_path.glob("*.ltc")), "-o", image, "--device", "cpu"]
    subprocess.run(relight, check=True, capture_output=True)
    ours, theirs = room.read(image), room.by_cycles(scene, tmp_path / "theirs.exr")
    shift = ours.mean() / theirs.mean() - 1.0
    spread = numpy.sqrt(numpy.mean((room.cells(ours) - room.cells(theirs)) ** 2)) / theirs.mean()
    print(f"{name} mean {100 * shift:+.2f} %, cells {100 * spread:.2f} %")
    assert abs(shift) < MEAN and spread < CELLS


def test_what_the_camera_does_not_see_is_behind_it_as_in_cycles(scene, program, tmp_path):
    """A glowing sheet before the room, a world, and a ball with a soft shadow; the first two are hidden from the camera."""
    sheet = [(-0.6, -1.5, 1.0), (0.6, -1.5, 1.0), (0.6, -1.5, 2.0), (-0.6, -1.5, 2.0)]
    room.mesh("sheet", sheet, [(3, 2, 1, 0)], room.glowing("glow", (0.4, 0.6, 1.0), 3.0)).visible_camera = False
    bulb = {"energy": 60, "color": (1.0, 0.8, 0.5), "shadow_soft_size": 0.2, "use_soft_falloff": False}
    room.lamp("POINT", "bulb", (0.6, -1.0, 2.4), **bulb)
    room.world((0.3, 0.5, 1.0), 0.4).cycles_visibility.camera = False
    scene.camera.location.y = -9.0
    compare(scene, program, tmp_path, "unseen")


def test_other_panoramas_are_refused(scene):
    panorama(scene)
    room.lamp("POINT", "bulb", (-1.2, -1.0, 2.5))
    pano = scene.camera.data if hasattr(scene.camera.data, "panorama_type") else scene.camera.data.cycles
    pano.panorama_type = "FISHEYE_EQUIDISTANT"
    with pytest.raises(RuntimeError, match="equirectangular"):
        bpy.ops.ltm.export()
