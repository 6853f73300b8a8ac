# SPDX-License-Identifier: GPL-3.0-or-later
"""A shader network's roughness as a value: temporary nodes that mirror its shaders.

Each glossy shader becomes the vector (roughness, 1, 0) times its opacity, every other shader the zero
vector; Mix Shader becomes a mix of vectors and Add Shader their sum. The ratio of the first two
components is then the mean roughness of the glossy lobes, weighted as the shaders are mixed.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import bpy

from . import compat
from .restore import Restorer
from .shader_trees import active_link

# Shaders whose reflection lands in Cycles' glossy passes; their input "Roughness" is the Principled BSDF's.
_GLOSSY_SHADERS = frozenset(
    {
        "ShaderNodeBsdfPrincipled",
        "ShaderNodeBsdfAnisotropic",  # Glossy BSDF
        "ShaderNodeBsdfMetallic",
        "ShaderNodeBsdfGlass",
        "ShaderNodeBsdfRefraction",
        "ShaderNodeBsdfHairPrincipled",
    }
)


class Output(NamedTuple):
    """An output socket, found anew at each use: sockets move when the interface of a group changes."""

    node: bpy.types.Node
    identifier: str

    @property
    def socket(self) -> bpy.types.NodeSocket:
        return _by_identifier(self.node.outputs, self.identifier)


Scalar: TypeAlias = "float | Output"
Vector: TypeAlias = "tuple[float, float, float] | Output"

NO_LOBE = (0.0, 0.0, 0.0)


class RoughnessNodes:
    """Adds value nodes next to shader nodes; a `Restorer` takes all of them away again.

    Groups are edited in place, once for all materials that use them: a group whose roughness is not
    constant gets one more output, and one more input for each shader that is passed into it.
    """

    def __init__(self, restorer: Restorer) -> None:
        self._restorer = restorer
        self._known: dict[tuple[int, str], Vector] = {}
        self._group_outputs: dict[tuple[int, str], Vector | str] = {}
        self._group_inputs: dict[int, dict[str, str]] = {}  # group -> shader input: its roughness input
        self._connected: set[tuple[int, str]] = set()

    def write_aov(self, tree: bpy.types.NodeTree, aov_name: str, target: str = "CYCLES") -> None:
        """Send the roughness of the surface that an engine renders to an AOV."""
        output = tree.get_output_node(target)
        if output is None:
            return
        value = self._entering(tree, output.inputs["Surface"])
        if value != NO_LOBE:
            aov = self._new(tree, "ShaderNodeOutputAOV")
            aov.aov_name = aov_name
            if isinstance(value, Output):
                tree.links.new(aov.inputs["Color"], value.socket)
            else:
                aov.inputs["Color"].default_value = (*value, 1.0)

    def _entering(self, tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> Vector:
        """Roughness of the shader that is linked to an input socket."""
        link = active_link(socket)
        return NO_LOBE if link is None else self._leaving(tree, link.from_node, link.from_socket)

    def _leaving(
        self, tree: bpy.types.NodeTree, node: bpy.types.Node, socket: bpy.types.NodeSocket
    ) -> Vector:
        """Roughness of the shader that an output socket gives; computed once for each socket."""
        key = (node.as_pointer(), socket.identifier)
        if key not in self._known:
            self._known[key] = self._mirror(tree, node, socket)
        return self._known[key]

    def _mirror(self, tree: bpy.types.NodeTree, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> Vector:
        if node.mute:
            through = (link.from_socket for link in node.internal_links if link.to_socket == socket)
            source = next(through, None)
            return NO_LOBE if source is None else self._entering(tree, source)
        if node.bl_idname == "NodeReroute":
            return self._entering(tree, node.inputs[0])
        if node.bl_idname == "NodeGroupInput":
            return self._passed_in(tree, node, socket.identifier)
        if node.bl_idname == "ShaderNodeGroup":
            return NO_LOBE if node.node_tree is None else self._group(tree, node, socket.identifier)
        if node.bl_idname == "ShaderNodeMixShader":
            first, second = (self._entering(tree, node.inputs[index]) for index in (1, 2))
            return self._mix(tree, _scalar(node.inputs[0]), first, second)
        if node.bl_idname == "ShaderNodeAddShader":
            return self._add(tree, *(self._entering(tree, shader) for shader in node.inputs))
        if node.bl_idname in _GLOSSY_SHADERS:
            opacity = _scalar(node.inputs["Alpha"]) if "Alpha" in node.inputs else 1.0
            return self._lobe(tree, _scalar(node.inputs["Roughness"]), opacity)
        return NO_LOBE

    def _lobe(self, tree: bpy.types.NodeTree, roughness: Scalar, opacity: Scalar) -> Vector:
        if not isinstance(roughness, Output) and not isinstance(opacity, Output):
            return (roughness * opacity, opacity, 0.0)
        combine = self._new(tree, "ShaderNodeCombineXYZ")
        _feed(tree, combine.inputs["X"], roughness)
        combine.inputs["Y"].default_value = 1.0
        lobe = Output(combine, "Vector")
        if opacity == 1.0:
            return lobe
        scale = self._new(tree, "ShaderNodeVectorMath")
        scale.operation = "SCALE"
        _feed(tree, scale.inputs[0], lobe)
        _feed(tree, scale.inputs["Scale"], opacity)
        return Output(scale, "Vector")

    def _mix(self, tree: bpy.types.NodeTree, factor: Scalar, first: Vector, second: Vector) -> Vector:
        if first == second:
            return first
        node = self._new(tree, "ShaderNodeMix")
        node.data_type = "VECTOR"
        node.factor_mode = "UNIFORM"
        node.clamp_factor = True
        _feed(tree, _by_identifier(node.inputs, "Factor_Float"), factor)
        _feed(tree, _by_identifier(node.inputs, "A_Vector"), first)
        _feed(tree, _by_identifier(node.inputs, "B_Vector"), second)
        return Output(node, "Result_Vector")

    def _add(self, tree: bpy.types.NodeTree, first: Vector, second: Vector) -> Vector:
        if NO_LOBE in (first, second):
            return second if first == NO_LOBE else first
        node = self._new(tree, "ShaderNodeVectorMath")
        node.operation = "ADD"
        _feed(tree, node.inputs[0], first)
        _feed(tree, node.inputs[1], second)
        return Output(node, "Vector")

    def _group(self, tree: bpy.types.NodeTree, node: bpy.types.Node, identifier: str) -> Vector:
        """Roughness of the shader that one output of a group node gives."""
        group = node.node_tree
        key = (group.as_pointer(), identifier)
        if key not in self._group_outputs:
            self._group_outputs[key] = self._group_output(group, identifier)
        value = self._group_outputs[key]
        if not isinstance(value, str):
            return value

        # Hand the roughness of shaders that enter this group node on into the group.
        for shader, roughness in self._group_inputs.get(group.as_pointer(), {}).items():
            if (node.as_pointer(), roughness) not in self._connected:
                self._connected.add((node.as_pointer(), roughness))
                entering = self._entering(tree, _by_identifier(node.inputs, shader))
                _feed(tree, _by_identifier(node.inputs, roughness), entering)
        return Output(node, value)

    def _group_output(self, group: bpy.types.NodeTree, identifier: str) -> Vector | str:
        """The same inside the group: a constant, or the identifier of the output that now gives it."""
        ends = (node for node in group.nodes if node.bl_idname == "NodeGroupOutput" and node.is_active_output)
        end = next(ends, None)
        if end is None:
            return NO_LOBE
        value = self._entering(group, _by_identifier(end.inputs, identifier))
        if not isinstance(value, Output):
            return value
        added = self._new_group_socket(group, "OUTPUT")
        _feed(group, _by_identifier(end.inputs, added), value)
        return added

    def _passed_in(self, group: bpy.types.NodeTree, node: bpy.types.Node, shader: str) -> Vector:
        """Roughness of a shader that enters the group from outside."""
        inputs = self._group_inputs.setdefault(group.as_pointer(), {})
        if shader not in inputs:
            inputs[shader] = self._new_group_socket(group, "INPUT")
        return Output(node, inputs[shader])

    def _new_group_socket(self, group: bpy.types.NodeTree, in_out: str) -> str:
        interface = group.interface
        for item, is_selected in compat.interface_selection(interface):
            self._restorer.callback(setattr, item, "select", is_selected)
        self._restorer.callback(setattr, interface, "active_index", interface.active_index)
        item = interface.new_socket("SSGI Roughness", in_out=in_out, socket_type="NodeSocketVector")
        self._restorer.callback(interface.remove, item)
        return str(item.identifier)

    def _new(self, tree: bpy.types.NodeTree, kind: str) -> bpy.types.Node:
        node = tree.nodes.new(kind)
        self._restorer.callback(tree.nodes.remove, node)
        return node


def _scalar(socket: bpy.types.NodeSocket) -> Scalar:
    link = active_link(socket)
    if link is None:
        return float(socket.default_value)
    return Output(link.from_node, link.from_socket.identifier)


def _feed(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: Scalar | Vector) -> None:
    if isinstance(value, Output):
        tree.links.new(socket, value.socket)
    else:
        socket.default_value = value


def _by_identifier(sockets: bpy.types.bpy_prop_collection, identifier: str) -> bpy.types.NodeSocket:
    return next(socket for socket in sockets if socket.identifier == identifier)
