# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole way of the buttons, without a window: export, render, mix, bring back; and what goes wrong."""

import json
import os
import subprocess
import sys
import time
import tomllib
from math import pi
from types import SimpleNamespace

import bpy
import pytest
import room

RED = (1.0, 0.25, 0.0)


def exported(tmp_path):
    """The scene file as a tree, and its lights by name."""
    tree = tomllib.loads((tmp_path / "untitled.toml").read_text(encoding="utf-8"))
    return tree, {light["name"]: light for light in tree.get("light", [])}


def near(found, wanted, tolerance=1e-4):
    assert found == pytest.approx(wanted, abs=tolerance)


def test_lamps_are_written_in_radiometric_units(scene, tmp_path):
    """The worked numbers of README.md."""
    scene.world = None
    room.lamp("POINT", "bulb", (1, 2, 3), energy=100, color=RED, shadow_soft_size=0.25)
    room.lamp("SPOT", "spot", (0, 0, 3), energy=100, spot_size=pi / 3, spot_blend=0.0, shadow_soft_size=0)
    room.lamp("SUN", "sun", (0, 0, 3), (0, pi / 2, 0), energy=2, angle=0.1)
    room.lamp("AREA", "panel", (0, 0, 3), energy=100, shape="RECTANGLE", size=2, size_y=1).data.ltm.texels = 8
    room.lamp("AREA", "disc", (0, 0, 2), energy=100, shape="DISK", size=1)
    room.mesh("sign", [(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(0, 1, 2)], room.glowing("neon", (0.5, 1, 1), 4))
    assert bpy.ops.ltm.export() == {"FINISHED"}
    tree, lights = exported(tmp_path)
    near(lights["bulb"]["emission"], [7.9577, 1.9894, 0.0])
    near(lights["bulb"]["position"], [1, 3, -2])
    near(lights["spot"]["emission"], [7.9577] * 3)
    near([lights["spot"][k] for k in ("outer_degrees", "inner_degrees")], [30, 30], 1e-2)
    near(lights["spot"]["direction"], [0, -1, 0])
    near(lights["sun"]["emission"], [2] * 3)
    # It shines along −x after a quarter turn about y, so that it stands at +x.
    near(lights["sun"]["towards"], [1, 0, 0])
    near(lights["sun"]["angular_radius_degrees"], 2.8648)
    near(lights["panel"]["emission"], [100 / pi / 2] * 3)
    assert lights["panel"]["texels"] == [8, 4]
    near(lights["panel"]["origin"], [-1, 3, 0.5])
    # 100 / (π · π/4), and 0.16 % for the corners that the polygon lacks.
    near(lights["disc"]["emission"], [40.5285 * 1.0016] * 3, 1e-2)
    assert (lights["sign"]["object"], lights["sign"]["material"]) == ("sign", "neon")
    # Lamps are hidden from the camera, unless they are set otherwise; meshes are not.
    assert (lights["bulb"]["radius"], "radius" in lights["spot"]) == (0.25, False)
    assert [name for name, light in lights.items() if light.get("camera") is False] == ["sun", "panel", "disc"]
    assert tree["camera"]["width"] == room.WIDTH
    near(tree["camera"]["eye"], [0, 1.5, 7])
    near(tree["camera"]["direction"], [0, 0, -1])


def test_ray_visibility_for_the_camera_is_carried_over(scene, tmp_path):
    panel = room.lamp("AREA", "panel", (0, 0, 3), energy=100, shape="SQUARE", size=1)
    bulb = room.lamp("POINT", "bulb", (1, 2, 3), energy=100)
    sign = room.mesh("sign", [(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(0, 1, 2)], room.glowing("neon", (0.5, 1, 1), 4))
    sky = room.world((0.3, 0.5, 1.0), 0.4)
    panel.visible_camera = bulb.visible_camera = True
    sign.visible_camera = sky.cycles_visibility.camera = False
    assert bpy.ops.ltm.export() == {"FINISHED"}
    _, lights = exported(tmp_path)
    assert {name: light.get("camera") for name, light in lights.items()} == {"panel": None, "bulb": None, "sign": False, "World": False}


def test_the_whole_way(scene, program, tmp_path):
    """Render, a look as the mixer saves one, and the look on the lamps."""
    bulb = room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50, color=RED, group="warm")
    panel = room.lamp("AREA", "panel", (0, -4, 3), (1, 0, 0), energy=80, shape="SQUARE", size=1)
    dark = room.lamp("SUN", "dark", (0, 0, 3), energy=3)
    material = room.glowing("neon", (0.5, 1, 1), 4)
    room.mesh("sign", [(0, 0, 0.1), (1, 0, 0.1), (1, 1, 0.1)], [(0, 1, 2)], material)
    sky = room.world((1, 1, 1), 0.5)
    scene.ltm.samples = 4
    assert bpy.ops.ltm.render() == {"FINISHED"}
    assert bpy.ops.ltm.view.poll()
    look = tmp_path / "mixed.toml"
    groups = next(tmp_path.glob("*.look.toml")).read_text(encoding="utf-8")
    assert tomllib.loads(groups) == {"groups": {"warm": ["bulb"]}}
    rules = '[[light]]\nname = "warm"\nstops = 1\n[[light]]\nname = "panel"\ncolor = { linear = [0, 1, 0] }\n'
    rules += '[[light]]\nname = "dark"\non = false\n[[light]]\nname = "sign"\nstops = -1\n[[light]]\nname = "World"\nstops = -2\n'
    # Groups as the mixer makes them, one in another: the smaller is what a light can have here.
    groups += '"all of it" = ["bulb", "panel", "dark"]\nsky = ["World"]\n'
    look.write_text(groups + rules, encoding="utf-8")
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.ltm.apply_look(filepath=str(look)) == {"FINISHED"}
    assert (bulb.lightgroup, panel.lightgroup, dark.lightgroup, sky.lightgroup) == ("warm", "all of it", "all of it", "sky")
    assert {group.name for group in bpy.context.view_layer.lightgroups} >= {"warm", "all of it", "sky"}
    near(bulb.data.energy, 100)
    near(bulb.data.color[:], RED)
    near(panel.data.color[:], (0, 1, 0))
    # Green has 0.7152 of the luminance of white.
    near(panel.data.energy, 80 / 0.7152, 0.1)
    assert dark.data.energy == 0
    near(material.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value, 2)
    near(sky.node_tree.nodes["Background"].inputs["Strength"].default_value, 0.125)
    # Looks do not add up: another one, then the first, twice.
    plain = tmp_path / "plain.toml"
    plain.write_text('base = "scene"\n', encoding="utf-8")
    strengths = material.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"], sky.node_tree.nodes["Background"].inputs["Strength"]
    for file, wanted in ((plain, (4, 0.5)), (look, (2, 0.125)), (look, (2, 0.125))):
        assert bpy.ops.ltm.apply_look(filepath=str(file)) == {"FINISHED"}
        near([strength.default_value for strength in strengths], wanted)
    # What is brought back and exported once more is what was mixed.
    weights = {light["name"]: light["weight"] for light in read_look(program, tmp_path, look)}
    assert bpy.ops.ltm.export() == {"FINISHED"}
    _, lights = exported(tmp_path)
    for name in ("bulb", "panel", "dark", "World"):
        near(lights[name]["emission"], weights[name], 1e-3)


def test_a_strength_beside_a_texture_is_that_of_the_export_times_the_look(add_on):
    weights = sys.modules["ltm.weights"]
    strength, owner = SimpleNamespace(default_value=3.0), {}
    for weight, wanted in ((0.5, 1.5), (0.5, 1.5), (2.0, 6.0), (1.0, 3.0)):
        weights.rescale(owner, strength, [weight] * 3, [1.0] * 3)
        assert strength.default_value == wanted
    weights.rescale(owner, strength, [2.0] * 3, [1.0] * 3)
    weights.begin_anew([owner])
    weights.rescale(owner, strength, [0.5] * 3, [1.0] * 3)
    assert strength.default_value == 3.0


def read_look(program, tmp_path, look):
    arguments = [program, "info", next(tmp_path.glob("*.ltc")), "--json", "--lighting", look]
    return json.loads(subprocess.run(arguments, check=True, capture_output=True).stdout)["lights"]


def test_a_look_can_be_undone(scene, program, tmp_path):
    room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50)
    scene.ltm.samples = 1
    assert bpy.ops.ltm.render() == {"FINISHED"}
    look = tmp_path / "mixed.toml"
    look.write_text('[[light]]\nname = "*"\nstops = 2\n', encoding="utf-8")
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.ltm.apply_look(filepath=str(look)) == {"FINISHED"}
    near(bpy.data.lights["bulb"].energy, 200)
    bpy.ops.ed.undo_push(message="Apply Look")
    bpy.ops.ed.undo()
    near(bpy.data.lights["bulb"].energy, 50)


def test_luminaires_are_added_and_exported(scene, program, tmp_path):
    ies = "TILT=NONE\n1 1000 1 2 1 1 2 0 0 0 1 1 75\n0 90\n0\n358 0\n"
    (tmp_path / "lamp.ies").write_text(ies, encoding="ascii")
    scene.cursor.location = (0, -1, 2.5)
    assert bpy.ops.ltm.add_luminaires(directory=str(tmp_path), files=[{"name": "lamp.ies"}]) == {"FINISHED"}
    scene.objects["lamp"].rotation_euler = (0, 0, 0.5)
    bpy.context.view_layer.update()
    scene.ltm.samples = 1
    assert bpy.ops.ltm.render() == {"FINISHED"}
    _, lights = exported(tmp_path)
    near(lights["lamp"]["direction"], [0, -1, 0])
    # About −y of glTF, which is down; seen from above, Blender turns the other way.
    near(abs(lights["lamp"]["turn_degrees"]), 28.6479, 1e-3)
    said = subprocess.run([program, "info", next(tmp_path.glob("*.ltc"))], check=True, capture_output=True, text=True).stdout
    assert "2.000 2.000 2.000" in said


@pytest.mark.parametrize(
    ("break_it", "words"),
    [
        (lambda scene: setattr(scene, "camera", None), "no camera"),
        (lambda scene: None, "no light"),
        (lambda scene: [bpy.data.objects.remove(o) for o in list(scene.objects) if o.type == "MESH"], "no surfaces"),
        (lambda scene: setattr(scene.ltm, "folder", "/dev/null/ltm"), "/dev/null/ltm"),
    ],
)
def test_what_cannot_be_exported_is_one_clear_line(scene, break_it, words):
    break_it(scene)
    with pytest.raises(RuntimeError) as error:
        bpy.ops.ltm.export()
    assert words in str(error.value)


def test_a_program_that_is_missing_or_fails_is_one_clear_line(scene, program, tmp_path, monkeypatch):
    room.lamp("POINT", "bulb", (0, -1, 2.5))
    monkeypatch.setenv("LTM", str(tmp_path / "none"))
    with pytest.raises(RuntimeError, match="was not found"):
        bpy.ops.ltm.render()
    monkeypatch.setenv("LTM", sys.executable)
    with pytest.raises(RuntimeError):
        bpy.ops.ltm.render()


def test_a_run_tells_its_progress_and_can_be_cancelled(scene, program, add_on, tmp_path):
    room.lamp("POINT", "bulb", (0, -1, 2.5))
    scene.render.resolution_x, scene.render.resolution_y, scene.ltm.samples = 800, 600, 4096
    assert bpy.ops.ltm.export() == {"FINISHED"}
    scene_file = tmp_path / "untitled.toml"
    run = add_on.program.Run([program, "render", scene_file, "-o", tmp_path / "a.ltc", "--pack", "--progress"])
    seen, begun = set(), time.monotonic()
    while len(seen) < 3 and run.is_running() and time.monotonic() - begun < 60:
        seen.add(run.status())
        time.sleep(0.05)
    assert any("%" in status for status in seen), seen
    run.stop()
    assert run.wait() != 0
    assert not (tmp_path / "a.ltc").exists()
    assert os.listdir(tmp_path)
