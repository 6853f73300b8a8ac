# SPDX-License-Identifier: GPL-3.0-or-later
"""The captured roughness is that of the shader that each pixel shows, however its material is built."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import capture, compat, roughness
from ssgi_addon.blender.build import node_tree
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from tests.tolerances import ROUGHNESS_AOV, ROUGHNESS_DENOISING

COLUMNS = 6
CELL_PX = 4
TOLERANCES = {"aov": ROUGHNESS_AOV, "denoising": ROUGHNESS_DENOISING}


class Network:
    """Shader nodes of one tree, written down in a line each."""

    def __init__(self, tree):
        self.tree = tree

    def add(self, kind, *links, **values):
        """Add a node; `links` feed its shader inputs in order, `values` its named inputs."""
        node = self.tree.nodes.new(kind)
        shaders = [socket for socket in node.inputs if socket.type == "SHADER"]
        for socket, source in zip(shaders, links, strict=False):
            self.link(source, socket)
        for name, value in values.items():
            socket = node.inputs[name.replace("_", " ")]
            if isinstance(value, bpy.types.NodeSocket):
                self.link(value, socket)
            else:
                socket.default_value = value
        return node.outputs[0]

    def link(self, source, socket):
        self.tree.links.new(socket, source)

    def glossy(self, value):
        return self.add("ShaderNodeBsdfAnisotropic", Roughness=value)

    def diffuse(self):
        return self.add("ShaderNodeBsdfDiffuse")

    def mix(self, first, second, factor):
        mixed = self.add("ShaderNodeMixShader", first, second)
        mixed.node.inputs[0].default_value = factor
        return mixed

    def value(self, number):
        node = self.tree.nodes.new("ShaderNodeValue")
        node.outputs[0].default_value = number
        return node.outputs[0]

    def group(self, tree, *links, **values):
        node = self.tree.nodes.new("ShaderNodeGroup")
        node.node_tree = tree
        for name, value in values.items():
            node.inputs[name].default_value = value
        for socket, source in zip((s for s in node.inputs if s.type == "SHADER"), links, strict=False):
            self.link(source, socket)
        return node.outputs[0]


def new_group(name, build, *, inputs=()):
    """A node group with one shader output; `build` gets its network and its inputs' sockets."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    for socket_name, kind in inputs:
        tree.interface.new_socket(socket_name, in_out="INPUT", socket_type=kind)
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(end.inputs[0], build(Network(tree), start.outputs))
    return tree


def glossy_group():
    """Passes its input Polish on as a roughness."""
    return new_group(
        "Polished", lambda net, ins: net.glossy(ins["Polish"]), inputs=[("Polish", "NodeSocketFloat")]
    )


def nested(net):
    inner = glossy_group()
    outer = new_group("Nested", lambda inside, ins: inside.group(inner, Polish=0.45))
    return net.group(outer)


def shared_group(net):
    inner = glossy_group()
    return net.mix(net.group(inner, Polish=0.2), net.group(inner, Polish=0.3), 0.5)


def shader_into_group(net):
    """A group that mixes the shader that it is given with a diffuse one."""
    coat = new_group(
        "Coat",
        lambda inside, ins: inside.mix(inside.diffuse(), ins["Base"], 0.5),
        inputs=[("Base", "NodeSocketShader")],
    )
    return net.group(coat, net.glossy(net.value(0.65)))


def muted_mix(net):
    """A muted Mix Shader hands its first shader on."""
    mixed = net.mix(net.glossy(0.15), net.glossy(0.9), 0.5)
    mixed.node.mute = True
    return mixed


def muted_link(net):
    """A roughness whose link is muted is the number on the socket."""
    lobe = net.glossy(0.3)
    net.link(net.value(0.9), lobe.node.inputs["Roughness"])
    net.tree.links[-1].is_muted = True
    return lobe


def through_reroute(net):
    reroute = net.tree.nodes.new("NodeReroute")
    net.link(net.glossy(0.35), reroute.inputs[0])
    return reroute.outputs[0]


def linked_math(net):
    node = net.tree.nodes.new("ShaderNodeMath")
    node.operation = "MULTIPLY"
    net.link(net.value(0.5), node.inputs[0])
    node.inputs[1].default_value = 0.5
    return net.add("ShaderNodeBsdfPrincipled", Roughness=node.outputs[0], Metallic=1.0)


MATERIALS = {
    "principled metal": (lambda net: net.add("ShaderNodeBsdfPrincipled", Roughness=0.3, Metallic=1.0), 0.3),
    "principled dielectric": (lambda net: net.add("ShaderNodeBsdfPrincipled", Roughness=0.2), 0.2),
    "glossy": (lambda net: net.glossy(0.6), 0.6),
    "mirror": (lambda net: net.glossy(0.0), 0.0),
    "glass": (lambda net: net.add("ShaderNodeBsdfGlass", Roughness=0.4), 0.4),
    "metallic": (lambda net: net.add("ShaderNodeBsdfMetallic", Roughness=0.55), 0.55),
    "diffuse": (lambda net: net.diffuse(), 1.0),
    "subsurface": (lambda net: net.add("ShaderNodeSubsurfaceScattering"), 1.0),
    "translucent": (lambda net: net.add("ShaderNodeBsdfTranslucent"), 1.0),
    "emission": (lambda net: net.add("ShaderNodeEmission"), 1.0),
    "diffuse and glossy": (lambda net: net.mix(net.diffuse(), net.glossy(0.25), 0.3), 0.25),
    "two lobes": (lambda net: net.mix(net.glossy(0.2), net.glossy(0.6), 0.5), 0.4),
    "added": (lambda net: net.add("ShaderNodeAddShader", net.diffuse(), net.glossy(0.7)), 0.7),
    "glow and glossy": (
        lambda net: net.add("ShaderNodeAddShader", net.add("ShaderNodeEmission"), net.glossy(0.5)),
        0.5,
    ),
    "linked roughness": (linked_math, 0.25),
    "nested groups": (nested, 0.45),
    "group used twice": (shared_group, 0.25),
    "shader into group": (shader_into_group, 0.65),
    "muted mix": (muted_mix, 0.15),
    "muted link": (muted_link, 0.3),
    "reroute": (through_reroute, 0.35),
    "no output": (None, 1.0),
    "no material": (None, 0.5 if bpy.app.version >= (5, 0, 0) else 1.0),  # Cycles' default surface
    "nothing linked": (lambda net: None, 1.0),
}


def material_of(name):
    """A material of the table; None for none."""
    if name == "no material":
        return None
    material = bpy.data.materials.new(name)
    tree = node_tree(material)
    tree.nodes.clear()
    if name == "no output":
        return material
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    surface = MATERIALS[name][0](Network(tree))
    if surface is not None:
        tree.links.new(output.inputs["Surface"], surface)
    return material


def add_tile(scene, index, material, *, height=0.0):
    """A square of one cell, seen from above; cell 0 is the top left one."""
    row, column = divmod(index, COLUMNS)
    mesh = bpy.data.meshes.new("Tile")
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    if material is not None:
        mesh.materials.append(material)
    tile = bpy.data.objects.new("Tile", mesh)
    tile.location = (column, -row - 1, height)
    scene.collection.objects.link(tile)
    return tile


def look_down(scene, rows):
    """An orthographic camera over the tiles, `CELL_PX` pixels to a cell."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type = "ORTHO"
    camera.data.sensor_fit = "HORIZONTAL"
    camera.data.ortho_scale = COLUMNS
    camera.location = (COLUMNS / 2, -rows / 2, 5.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = COLUMNS * CELL_PX, rows * CELL_PX


@pytest.fixture(params=["aov", "denoising"])
def source(request, empty_file, monkeypatch):
    """How the roughness is found; both ways where this Blender has both."""
    if request.param == "aov":
        monkeypatch.setattr(capture, "borrow_roughness", roughness.borrow_aov_roughness)
    elif not compat.has_roughness_pass(empty_file.view_layers[0]):
        pytest.skip("this Blender has no roughness among its denoising passes")
    return request.param


def captured_roughness(scene):
    options = CaptureOptions(samples=1, denoiser="none")
    return capture_frame(scene, options).gbuffer.roughness


def cell(image, index):
    row, column = divmod(index, COLUMNS)
    inside = slice(1, CELL_PX - 1)
    return image[row * CELL_PX : (row + 1) * CELL_PX, column * CELL_PX : (column + 1) * CELL_PX][
        inside, inside
    ]


def test_each_material_shows_its_roughness(empty_file, source):
    rows = -(-len(MATERIALS) // COLUMNS)
    for index, name in enumerate(MATERIALS):
        add_tile(empty_file, index, material_of(name))
    look_down(empty_file, rows)
    image = captured_roughness(empty_file)
    found = {name: cell(image, index) for index, name in enumerate(MATERIALS)}
    wrong = {
        name: float(found[name].mean())
        for name, (_, expected) in MATERIALS.items()
        if np.abs(found[name] - expected).max() > TOLERANCES[source]
    }
    assert wrong == {}


def test_roughness_follows_a_texture(empty_file, source):
    """Object coordinates as the roughness: 0 at the left edge of the tile, 1 at the right one."""
    material = bpy.data.materials.new("Gradient")
    net = Network(node_tree(material))
    net.tree.nodes.clear()
    split = net.tree.nodes.new("ShaderNodeSeparateXYZ")
    net.link(net.tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], split.inputs[0])
    output = net.tree.nodes.new("ShaderNodeOutputMaterial")
    net.link(net.glossy(split.outputs["X"]), output.inputs["Surface"])
    add_tile(empty_file, 0, material).scale = (COLUMNS, 1, 1)
    look_down(empty_file, 1)
    image = captured_roughness(empty_file)
    expected = (np.arange(COLUMNS * CELL_PX) + 0.5) / (COLUMNS * CELL_PX)
    assert np.abs(image - expected).max() < ROUGHNESS_DENOISING


def test_material_shared_by_objects_counts_for_each(empty_file, source):
    material = material_of("glossy")
    for index in (0, 1):
        add_tile(empty_file, index, material)
    look_down(empty_file, 1)
    image = captured_roughness(empty_file)
    assert np.abs(cell(image, 0) - 0.6).max() < TOLERANCES[source]
    assert np.abs(cell(image, 1) - 0.6).max() < TOLERANCES[source]


def test_surface_behind_a_cutout_shows_its_own_roughness(empty_file, source):
    leaf = bpy.data.materials.new("Leaf")
    net = Network(node_tree(leaf))
    net.tree.nodes.clear()
    output = net.tree.nodes.new("ShaderNodeOutputMaterial")
    net.link(
        net.add("ShaderNodeBsdfPrincipled", Roughness=0.2, Metallic=1.0, Alpha=net.value(0.0)),
        output.inputs[0],
    )
    add_tile(empty_file, 0, leaf, height=1.0)
    add_tile(empty_file, 0, material_of("glossy"))
    look_down(empty_file, 1)
    assert np.abs(cell(captured_roughness(empty_file), 0) - 0.6).max() < TOLERANCES[source]


def test_material_with_nodes_switched_off_is_rough(empty_file, source):
    if bpy.app.version >= (5, 0, 0):
        pytest.skip("materials always use nodes since 5.0")
    material = material_of("glossy")
    material.use_nodes = False
    add_tile(empty_file, 0, material)
    look_down(empty_file, 1)
    assert cell(captured_roughness(empty_file), 0).min() == 1.0


def test_linked_library_material_shows_its_roughness(empty_file, source, tmp_path):
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {material_of("nested groups")})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, linked):
        linked.materials = ["nested groups"]
    scene = bpy.context.scene
    add_tile(scene, 0, linked.materials[0])
    look_down(scene, 1)
    assert np.abs(cell(captured_roughness(scene), 0) - 0.45).max() < TOLERANCES[source]
