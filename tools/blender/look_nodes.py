# SPDX-License-Identifier: GPL-3.0-or-later
"""A look as a group of compositor nodes: the layer of each light times its weight, added up."""

import bpy

# Bytes of a layer's name that ltm writes at most.
NAME_BYTES = 48
ACROSS, DOWN = 220, 160


def factors(lights):
    """What multiplies the layer of each light, of the list of `ltm info --json --lighting`; and remarks."""
    found, remarks = {}, []
    for light in lights:
        pairs = zip(light["weight"], light["scene_weight"])
        found[light["name"]] = [weight / before if before > 0.0 else 0.0 for weight, before in pairs]
        if any(light["weight"]) and not any(light["scene_weight"]):
            remarks.append(f"'{light['name']}' was off when it was rendered, and is not in the nodes")
        if not light["is_even"]:
            remarks.append(f"'{light['name']}': its pattern is not in the nodes, but its mean")
    return found, remarks


def layer_names(lights):
    """The names of the layers that ltm writes for lights of these names, as `ltm relight --layers lights` makes them."""
    taken, names = set(), {}

    def kept(c):
        if c.isascii():
            return c.isalnum() or c in " _-+#()[]"
        return c.isprintable() and not c.isspace()

    for light in lights:
        plain = "".join(c if kept(c) else "_" for c in light).encode()[:NAME_BYTES].decode(errors="ignore")
        numbered = (f"{plain}_{number}" for number in range(2, len(taken) + 3))
        names[light] = plain if plain not in taken else next(name for name in numbered if name not in taken)
        taken.add(names[light])
    return names


def build(tree, name, weights, image):
    """Adds an image node of `image`, the file with a layer for each light, and a group that multiplies each by its weight and adds
    them up. Returns the group's node.
    """
    group = bpy.data.node_groups.new(name, "CompositorNodeTree")
    names = layer_names(weights)
    picture = tree.nodes.new("CompositorNodeImage")
    picture.image, picture.label = image, image.name
    layers = {socket.name: socket for socket in picture.outputs}
    group.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    lit = [light for light in weights if names[light] in layers]
    for light in lit:
        group.interface.new_socket(light, in_out="INPUT", socket_type="NodeSocketColor")
    inside, outside = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    total = None
    for row, light in enumerate(lit):
        weighted = mix(group, "MULTIPLY", inside.outputs[row], weights[light])
        weighted.node.label, weighted.node.location = light, (ACROSS, -DOWN * row)
        if total is None:
            total = weighted
            continue
        total = mix(group, "ADD", total, weighted)
        total.node.location = (2 * ACROSS, -DOWN * row)
    outside.location = (3 * ACROSS, 0)
    if total is not None:
        group.links.new(total, outside.inputs[0])
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree, node.label, node.location = group, name, (2 * ACROSS, 0)
    for row, light in enumerate(lit):
        tree.links.new(layers[names[light]], node.inputs[row])
    return node


def mix(tree, kind, first, second):
    """A node that multiplies or adds two colours; `second` is a socket or a colour. Returns its output."""
    try:
        node = tree.nodes.new("CompositorNodeMixRGB")
        colours, result = node.inputs[1:3], node.outputs[0]
        node.inputs[0].default_value = 1.0
    except RuntimeError:
        # From Blender 5 on the compositor has the mix node of the other editors.
        node = tree.nodes.new("ShaderNodeMix")
        node.data_type, node.clamp_factor = "RGBA", False
        coloured = [socket for socket in node.inputs if socket.type == "RGBA"]
        colours, result = coloured, next(socket for socket in node.outputs if socket.type == "RGBA")
        node.inputs[0].default_value = 1.0
    node.blend_type = kind
    tree.links.new(first, colours[0])
    if isinstance(second, bpy.types.NodeSocket):
        tree.links.new(second, colours[1])
    else:
        colours[1].default_value = [*second, 1.0]
    return result


def tree_of(scene):
    """The compositor's nodes of a scene, made where there are none."""
    if hasattr(scene, "compositing_node_group"):
        if scene.compositing_node_group is None:
            scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        return scene.compositing_node_group
    scene.use_nodes = True
    return scene.node_tree
