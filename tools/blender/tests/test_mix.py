# SPDX-License-Identifier: GPL-3.0-or-later
"""Render with Cycles: the whole way without a window, and what may go wrong on it."""

import json
import subprocess
import sys
import time
import tomllib

import bpy
import pytest
import room

LONG = "長い名前の照明 " * 3


@pytest.fixture
def cycles(scene):
    """The room as Cycles renders it in no time."""
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples = "CPU", 16
    scene.render.resolution_x, scene.render.resolution_y = 48, 36
    scene.world = None
    return scene


def light_names(program, tmp_path):
    said = subprocess.run([program, "info", next(tmp_path.glob("*.ltc")), "--json"], check=True, capture_output=True).stdout
    return [light["name"] for light in json.loads(said)["lights"]]


def relit(program, tmp_path, *chosen):
    image = tmp_path / "relit.exr"
    words = [word for name in chosen for word in ("--on", name)]
    packed = next(tmp_path.glob("*.ltc"))
    subprocess.run([program, "relight", packed, "-o", image, "--device", "cpu", *words], check=True, capture_output=True)
    return room.read(image)


def state(scene):
    """All of the scene that a render with light groups might touch."""
    layers = [
        (layer.name, layer.use, sorted(g.name for g in layer.lightgroups), layer.cycles.denoising_store_passes, layer.use_pass_z)
        for layer in scene.view_layers
    ]
    render, cycles = scene.render, scene.cycles
    return {
        "layers": layers,
        "objects": sorted((thing.name, thing.lightgroup) for thing in bpy.data.objects),
        "world": scene.world and scene.world.lightgroup,
        "render": [render.filepath, render.use_compositing, render.use_multiview, render.image_settings.file_format],
        "cycles": [cycles.samples, cycles.seed, cycles.use_denoising, cycles.adaptive_threshold, cycles.time_limit],
        "data": {kind: len(getattr(bpy.data, kind)) for kind in ("objects", "scenes", "images", "materials", "meshes", "worlds")},
        "file": (bpy.data.filepath, bpy.context.view_layer.name),
    }


def left(tmp_path):
    """What a render leaves of its own files."""
    return sorted(path.name for path in tmp_path.glob("ltm-cycles-*"))


def shining_room():
    """Lamps with names of several scripts, two of one material, a world; light groups of the user's."""
    room.lamp("POINT", "Küche.001", (-1.2, -1.0, 2.5), group="warm", energy=60, color=(1.0, 0.8, 0.5), shadow_soft_size=0.1)
    room.lamp("SPOT", LONG[:20], (1.0, -1.0, 2.9), (0.3, 0.2, 0.0), group="warm", energy=200, spot_size=1.2)
    room.lamp("SUN", "a*b/c.d", (0, 0, 9), (1.0, 0.3, 0.0), energy=1.5)
    glow = room.glowing("glow", (0.4, 0.6, 1.0), 5.0)
    for number, x in enumerate((-1.5, 1.5)):
        corners = [(x - 0.3, 1.0, 2.9), (x + 0.3, 1.0, 2.9), (x + 0.3, 1.4, 2.9), (x - 0.3, 1.4, 2.9)]
        room.mesh(f"panel {number}", corners, [(3, 2, 1, 0)], glow)
    room.world((0.3, 0.5, 1.0), 0.2)


@pytest.mark.parametrize("two_halves", [True, False])
def test_every_light_is_mixed_as_cycles_renders_it(cycles, program, tmp_path, two_halves):
    shining_room()
    cycles.ltm.two_halves = two_halves
    before = state(cycles)
    assert bpy.ops.ltm.run_cycles() == {"FINISHED"}
    assert state(cycles) == before
    assert left(tmp_path) == []
    names = ["Küche.001", LONG[:20], "a*b/c.d", "glow", "World"]
    assert light_names(program, tmp_path) == names
    look = tomllib.loads(next(tmp_path.glob("*.look.toml")).read_text(encoding="utf-8"))
    assert look == {"groups": {"warm": ["Küche.001", LONG[:20]]}}
    # Each light alone by Cycles, of more samples, beside what was mixed; means over the picture.
    found = {name: relit(program, tmp_path, name.replace("*", "?")).mean(axis=(0, 1)) for name in names}
    together = relit(program, tmp_path).mean(axis=(0, 1))
    assert together == pytest.approx(sum(found.values()), rel=1e-2)
    cycles.render.engine = "CYCLES"
    for name, light in found.items():
        for thing in cycles.objects:
            if thing.type == "LIGHT" or thing.name.startswith("panel"):
                thing.hide_render = thing.name != name and not (name == "glow" and thing.name.startswith("panel"))
        background = cycles.world.node_tree.nodes["Background"].inputs["Strength"]
        background.default_value = 0.2 if name == "World" else 0.0
        # Clamped as the scene clamps, and with its pixel filter.
        cycles.cycles.samples, cycles.cycles.seed, cycles.cycles.use_denoising = 256, 5, False
        settings = cycles.render.image_settings
        settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGB"
        cycles.render.filepath = str(tmp_path / "alone.exr")
        bpy.ops.render.render(write_still=True)
        theirs = room.read(tmp_path / "alone.exr").mean(axis=(0, 1))
        print(name, light, theirs)
        # The noise of 16 samples over 1,728 pixels.
        assert light == pytest.approx(theirs, rel=0.1), name


def test_a_look_is_brought_back_and_taken_twice(cycles, program, tmp_path):
    shining_room()
    assert bpy.ops.ltm.run_cycles() == {"FINISHED"}
    look = tmp_path / "mixed.toml"
    rules = '[groups]\n"all of it" = ["Küche.001", "glow"]\nsky = ["World"]\n[[light]]\nname = "Küche.001"\nstops = 1\n'
    rules += '[[light]]\nname = "glow"\ncolor = { linear = [0, 0, 1] }\n[[light]]\nname = "World"\nstops = -1\n'
    rules += '[[light]]\nname = "a?b/c.d"\non = false\n'
    look.write_text(rules, encoding="utf-8")
    strength = bpy.data.materials["glow"].node_tree.nodes["Principled BSDF"].inputs["Emission Strength"]
    for _ in range(2):
        assert bpy.ops.ltm.apply_look(filepath=str(look)) == {"FINISHED"}
        assert bpy.data.lights["Küche.001"].energy == pytest.approx(120)
        assert bpy.data.lights["Küche.001"].color[:] == pytest.approx((1.0, 0.8, 0.5))
        assert bpy.data.lights["a*b/c.d"].energy == 0
        assert cycles.world.node_tree.nodes["Background"].inputs["Strength"].default_value == pytest.approx(0.1)
        emission = bpy.data.materials["glow"].node_tree.nodes["Principled BSDF"].inputs["Emission Color"].default_value
        assert emission[0] == 0 and emission[2] > 0 and strength.default_value > 0
    assert [cycles.objects[f"panel {n}"].lightgroup for n in (0, 1)] == ["all of it"] * 2
    assert (cycles.objects["Küche.001"].lightgroup, cycles.world.lightgroup) == ("all of it", "sky")


def test_one_lamp_and_none(cycles, program, tmp_path):
    with pytest.raises(RuntimeError, match="no light"):
        bpy.ops.ltm.run_cycles()
    room.lamp("POINT", "dark", (0, -1, 2.5), energy=0)
    with pytest.raises(RuntimeError, match="no light"):
        bpy.ops.ltm.run_cycles()
    room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50)
    assert bpy.ops.ltm.render_cycles() == {"FINISHED"}
    assert light_names(program, tmp_path) == ["bulb"]
    # A single light is in no group of the user's: no look is left.
    assert list(tmp_path.glob("*.look.toml")) == []
    # Once ltm itself has rendered, its own lights count again.
    assert len(list(tmp_path.glob("*.lights.json"))) == 1
    cycles.ltm.samples = 1
    assert bpy.ops.ltm.render() == {"FINISHED"}
    assert list(tmp_path.glob("*.lights.json")) == []


def test_three_hundred_lamps_in_several_renders(cycles, program, tmp_path):
    for number in range(300):
        room.lamp("POINT", f"lamp {number:03}", (-1.8 + 0.012 * number, -1.0, 2.5), energy=1 + number % 7)
    cycles.render.resolution_x, cycles.render.resolution_y, cycles.cycles.samples = 16, 12, 2
    cycles.ltm.groups_at_once = 120
    planned = sys.modules["ltm.cycles_job"].plan(bpy.context)
    assert planned.parts() == [(0, 120), (120, 240), (240, 300)]
    said = "\n".join(planned.described())
    assert "300 lights" in said and "rendered 3 times" in said and "not cleaned" in said
    assert bpy.ops.ltm.run_cycles() == {"FINISHED"}
    assert light_names(program, tmp_path) == [f"lamp {number:03}" for number in range(300)]


def test_what_the_lights_lack_is_nothing(cycles, add_on, program, tmp_path):
    """Light groups add up to the picture: Cycles counts no light twice and leaves none out."""
    shining_room()
    job = sys.modules["ltm.cycles_job"]
    planned = job.plan(bpy.context)
    planned.at_once = 2
    made = job.Job(bpy.context, planned, tmp_path)
    run = sys.modules["ltm.program"].Run(made.blender(), False)
    assert run.wait() == 0, run.lines
    packer = made.packer(str(program) + "-pack", tmp_path / "sum.ltc")
    said = subprocess.run([*map(str, packer[:2]), *map(str, packer[4:])], check=True, capture_output=True, text=True).stdout
    made.remove()
    difference = float(said.split("the lights' sum is ")[1].split()[0])
    assert difference < 1e-5, said
    assert sorted(light_names(program, tmp_path)) == sorted(["Küche.001", LONG[:20], "a*b/c.d", "glow", "World"])


def test_progress_and_cancel_leave_nothing(cycles, program, add_on, tmp_path):
    shining_room()
    cycles.render.resolution_x, cycles.render.resolution_y, cycles.cycles.samples = 640, 480, 4096
    cycles.cycles.use_adaptive_sampling = False
    (tmp_path / "untitled.ltc").write_text("what was there", encoding="utf-8")
    before, job, runs = state(cycles), sys.modules["ltm.cycles_job"], sys.modules["ltm.program"]
    made = job.Job(bpy.context, job.plan(bpy.context), tmp_path)
    chain = runs.Chain((made.blender(), False), (made.packer(program, tmp_path / "untitled.ltc"), True))
    seen, begun = set(), time.monotonic()
    while len(seen) < 3 and chain.is_running() and time.monotonic() - begun < 90:
        seen.add(chain.status())
        time.sleep(0.05)
    assert any("1 of 2" in status and "%" in status for status in seen), seen
    begun = time.monotonic()
    chain.stop()
    assert chain.wait() != 0 and chain.stopped and not chain.is_running()
    assert time.monotonic() - begun < 5
    made.remove()
    assert state(cycles) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["untitled.ltc"]


@pytest.mark.parametrize(
    ("break_it", "words"),
    [
        (lambda scene: setattr(scene.render, "engine", "BLENDER_WORKBENCH"), "not rendered by Cycles"),
        (lambda scene: setattr(scene, "camera", None), "no camera"),
        (lambda scene: setattr(scene.ltm, "folder", "/dev/null/ltm"), "/dev/null/ltm"),
    ],
)
def test_what_cannot_be_rendered_is_one_clear_line(cycles, program, tmp_path, break_it, words):
    room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50)
    break_it(cycles)
    before = state(cycles)
    with pytest.raises(RuntimeError) as error:
        bpy.ops.ltm.run_cycles()
    assert words in str(error.value)
    assert state(cycles) == before and left(tmp_path) == []


def test_a_disk_without_room_is_said_before_anything_is_rendered(cycles, program, tmp_path, monkeypatch):
    room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50)
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr(sys.modules["ltm.cycles_job"].shutil, "disk_usage", lambda _: usage)
    with pytest.raises(RuntimeError, match="GiB of disk"):
        bpy.ops.ltm.run_cycles()
    assert left(tmp_path) == []


@pytest.mark.parametrize("which", ["the render", "the packer"])
def test_a_failure_in_the_middle_leaves_the_scene_and_the_container(cycles, program, tmp_path, monkeypatch, which):
    shining_room()
    (tmp_path / "untitled.ltc").write_text("what was there", encoding="utf-8")
    job = sys.modules["ltm.cycles_job"]
    if which == "the render":
        broken = tmp_path / "broken.py"
        broken.write_text("import sys\nsys.stderr.write('ltm: Cycles did not render: out of memory\\n')\nsys.exit(1)\n")
        monkeypatch.setattr(job, "SCRIPT", broken)
    else:
        monkeypatch.setattr(job.Job, "packer", lambda *_: [program, "info", tmp_path / "none.ltc"])
    before = state(cycles)
    with pytest.raises(RuntimeError) as error:
        bpy.ops.ltm.run_cycles()
    assert ("out of memory" if which == "the render" else "none.ltc") in str(error.value)
    assert state(cycles) == before and left(tmp_path) == []
    assert (tmp_path / "untitled.ltc").read_text(encoding="utf-8") == "what was there"


def test_linked_libraries_give_their_lights(cycles, program, tmp_path):
    """A collection of a library, instanced; and a lamp of it that has the name of one of the scene's."""
    library = tmp_path / "lamps.blend"
    lamp = room.lamp("POINT", "bulb", (0.5, -1, 2.0), energy=40)
    panel = room.mesh("sheet", [(-1, 0, 2.9), (0, 0, 2.9), (0, 1, 2.9)], [(2, 1, 0)], room.glowing("linked glow", (1, 1, 1), 3))
    collection = bpy.data.collections.new("fixtures")
    for thing in (lamp, panel):
        cycles.collection.objects.unlink(thing)
        collection.objects.link(thing)
    bpy.data.libraries.write(str(library), {collection})
    bpy.data.collections.remove(collection)
    for thing in (lamp, panel):
        bpy.data.objects.remove(thing)
    room.lamp("POINT", "bulb", (-0.5, -1, 2.0), energy=20, color=(1, 0, 0))
    with bpy.data.libraries.load(str(library), link=True) as (_, data):
        data.collections = ["fixtures"]
    instance = bpy.data.objects.new("fixtures", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", bpy.data.collections["fixtures"]
    cycles.collection.objects.link(instance)
    bpy.context.view_layer.update()
    assert bpy.ops.ltm.run_cycles() == {"FINISHED"}
    assert light_names(program, tmp_path) == ["bulb", "bulb 2", "linked glow"]
    red, white = (relit(program, tmp_path, name).mean(axis=(0, 1)) for name in ("bulb", "bulb 2"))
    assert red[0] > 0 and red[1] < 1e-4 * red[0]
    assert white[1] > 0.1 * white[0] > 0


def test_one_view_layer_a_region_and_one_view_are_rendered(cycles, program, tmp_path):
    """What is not in the active view layer gives no light; outside of the region it is black; stereo is one view."""
    room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50)
    hidden = bpy.data.collections.new("hidden")
    cycles.collection.children.link(hidden)
    other = room.lamp("POINT", "other", (0, -1, 2.0), energy=50)
    cycles.collection.objects.unlink(other)
    hidden.objects.link(other)
    second = cycles.view_layers.new("Über alles, with a name that is longer than most")
    second.layer_collection.children["hidden"].exclude = True
    bpy.context.window.view_layer = second
    render = cycles.render
    render.use_multiview, render.use_border = True, True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.5, 1.0
    second.use_pass_z = second.use_pass_cryptomatte_object = True
    cycles.cycles.use_denoising = True
    before = state(cycles)
    remarks = sys.modules["ltm.cycles_job"].plan(bpy.context).remarks
    assert any("stereo" in remark for remark in remarks) and any("view layer" in remark for remark in remarks)
    assert bpy.ops.ltm.run_cycles() == {"FINISHED"}
    assert state(cycles) == before
    assert light_names(program, tmp_path) == ["bulb"]
    image = relit(program, tmp_path)
    assert image.shape[:2] == (36, 48)
    # Outside of it there is what packing leaves, below a hundredth of what is brightest.
    assert image[:18, 12:36].mean() > 0.01 and max(image[19:].max(), image[:, :11].max()) < 0.01 * image.max()
    render.use_crop_to_border = True
    assert bpy.ops.ltm.run_cycles() == {"FINISHED"}
    assert relit(program, tmp_path).shape[:2] == (18, 24)


def test_halves_take_no_more_samples(cycles):
    room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50)
    job = sys.modules["ltm.cycles_job"]
    for samples, halves, each in ((16, 2, 8), (17, 2, 8), (1, 1, 1)):
        cycles.cycles.samples = samples
        planned = job.plan(bpy.context)
        assert (planned.halves, planned.samples) == (halves, each)
    bpy.context.view_layer.samples = 6
    assert job.plan(bpy.context).samples == 3
    cycles.cycles.use_layer_samples = "IGNORE"
    assert job.plan(bpy.context).halves == 1


def test_emissive_materials_are_told_by_their_nodes(scene, add_on):
    sources = sys.modules["ltm.light_sources"]
    plain, glow = room.matte("plain", (1, 1, 1)), room.glowing("glow", (1, 1, 1), 2.0)
    assert not sources.shines(plain) and sources.shines(glow)
    linked = room.matte("linked", (1, 1, 1))
    value = linked.node_tree.nodes.new("ShaderNodeValue")
    linked.node_tree.links.new(value.outputs[0], linked.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"])
    assert sources.shines(linked)
    aside = room.matte("aside", (1, 1, 1))
    aside.node_tree.nodes.new("ShaderNodeEmission")
    assert not sources.shines(aside), "what goes nowhere shines nowhere"
    tree = bpy.data.node_groups.new("inner", "ShaderNodeTree")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    out, emission = tree.nodes.new("NodeGroupOutput"), tree.nodes.new("ShaderNodeEmission")
    tree.links.new(emission.outputs[0], out.inputs[0])
    grouped = room.matte("grouped", (1, 1, 1))
    group = grouped.node_tree.nodes.new("ShaderNodeGroup")
    group.node_tree = tree
    grouped.node_tree.links.new(group.outputs[0], grouped.node_tree.nodes["Material Output"].inputs["Surface"])
    assert sources.shines(grouped)


def test_a_render_that_is_there_is_opened(cycles, program, tmp_path):
    room.lamp("POINT", "bulb", (0, -1, 2.5), energy=50, group="key")
    room.lamp("POINT", "other", (1, -1, 2.5), energy=50, group="fill")
    cycles.cycles.use_denoising = False
    bpy.context.view_layer.cycles.denoising_store_passes = True
    cycles.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    cycles.render.filepath = str(tmp_path / "mine.exr")
    bpy.ops.render.render(write_still=True)
    assert bpy.ops.ltm.open_render(filepath=str(tmp_path / "mine.exr")) == {"FINISHED"}
    assert sorted(light_names(program, tmp_path)) == ["fill", "key"]
    with pytest.raises(RuntimeError, match="none.exr"):
        bpy.ops.ltm.open_render(filepath=str(tmp_path / "none.exr"))


def test_a_look_becomes_compositor_nodes(cycles, program, tmp_path):
    """What the nodes make of the layers is what ltm makes of the look."""
    room.lamp("POINT", "Küche.001", (0, -1, 2.5), energy=50, color=(1.0, 0.5, 0.25))
    room.lamp("POINT", "Küche_001", (1, -1, 2.5), energy=20)
    room.world((0.3, 0.5, 1.0), 0.2)
    assert bpy.ops.ltm.run_cycles() == {"FINISHED"}
    look = tmp_path / "evening.toml"
    rules = '[[light]]\nname = "Küche.001"\nstops = 2\n[[light]]\nname = "Küche_001"\non = false\n'
    look.write_text(rules + '[[light]]\nname = "World"\ncolor = { linear = [0, 1, 0.5] }\n', encoding="utf-8")
    wanted = tmp_path / "wanted.exr"
    packed = next(tmp_path.glob("*.ltc"))
    arguments = [program, "relight", packed, "-o", wanted, "--lighting", look, "--device", "cpu"]
    subprocess.run(arguments, check=True, capture_output=True)
    assert bpy.ops.ltm.look_nodes(filepath=str(look)) == {"FINISHED"}
    tree = cycles.node_tree
    group = next(node for node in tree.nodes if node.type == "GROUP")
    assert group.node_tree.name == "evening" and [socket.name for socket in group.inputs] == ["Küche.001", "Küche_001", "World"]
    for node in [node for node in tree.nodes if node.type in {"R_LAYERS", "COMPOSITE"}]:
        tree.nodes.remove(node)
    tree.links.new(group.outputs[0], tree.nodes.new("CompositorNodeComposite").inputs[0])
    settings = cycles.render.image_settings
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGB"
    cycles.render.filepath, cycles.cycles.samples = str(tmp_path / "composited.exr"), 1
    bpy.ops.render.render(write_still=True)
    found, wanted = room.read(tmp_path / "composited.exr"), room.read(wanted)
    assert abs(found - wanted).max() < 1e-4 * wanted.max()
