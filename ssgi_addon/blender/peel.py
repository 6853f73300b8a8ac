# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials that let the camera look through the surfaces which it sees first (Cycles).

Each material gets a second output node, in use for the time of some renders: it mixes the surface to
Transparent for camera rays alone, so that light still meets what the user made. Cycles counts the transparent
surfaces along a ray; that is how a surface knows that it is the first one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..thickness import SurfaceIdentity
from .cycles_passes import CYCLES
from .restore import Restorer
from .shader_trees import active_link, shaded_materials

FloatArray = NDArray[np.float32]

# Passes take the first hit that is less transparent than this; at 0 that would be a surface looked through.
_LEAST_OPACITY = 0.01
# So many bounces more a camera ray needs: two surfaces, and the last one must not be the limit.
_LOOKED_THROUGH = 3


@dataclass(frozen=True)
class SurfacePasses:
    """The passes that tell which surface a ray came to, and how to read them.

    Attributes
    ----------
    facts
        Colour AOV: 1 for each surface that was met, 1 where it shows its back, the number of its material.
    thing
        Value AOV: a random number of its object.
    """

    facts: str
    thing: str

    @property
    def names(self) -> tuple[str, str]:
        """Both passes."""
        return self.facts, self.thing

    def read(self, layers: Mapping[str, FloatArray]) -> SurfaceIdentity:
        """Return what rendered passes tell."""
        facts = layers[self.facts]
        return SurfaceIdentity(
            # Holes in leaves add their own numbers
            is_known=facts[..., 0] == 1.0,
            is_back=facts[..., 1] == 1.0,
            material=facts[..., 2].astype(np.int64),
            thing=layers[self.thing],
        )


def borrow_second_surface(
    restorer: Restorer, view_layer: bpy.types.ViewLayer
) -> tuple[SurfacePasses, SurfacePasses]:
    """Let camera rays pass the first surface, whatever it is, until `restorer` closes.

    Surfaces that cannot be edited stay what the camera sees: those without a material or without nodes, and
    what stands behind holes in leaves, since the hole was the first surface.

    Returns
    -------
    first, second
        Where the next renders tell about the surface that was passed, and the one behind it.
    """
    _borrow_view(restorer, view_layer)
    passes = (
        SurfacePasses("SSGI First Surface", "SSGI First Object"),
        SurfacePasses("SSGI Second Surface", "SSGI Second Object"),
    )
    passes = tuple(_borrow_aovs(restorer, view_layer, item) for item in passes)
    for number, tree in enumerate(_peelable_trees()):
        peel = _Peel(restorer, tree)
        is_first = peel.is_before(1)
        peel.look_through(is_first)
        peel.tell(passes[0], is_first, number)
        peel.tell(passes[1], peel.math("SUBTRACT", 1.0, is_first), number)
    return passes


def borrow_layer_behind(
    restorer: Restorer, view_layer: bpy.types.ViewLayer, flipped: Collection[int] = ()
) -> None:
    """Let camera rays pass the first surface, and the back face after it, until `restorer` closes.

    What they see is where something else begins. They pass no more than one back face: many a wall shows its
    back to the camera, and is the layer that matters.

    Parameters
    ----------
    flipped
        Numbers of the materials, as `borrow_second_surface` counts them, whose normals point inward: their
        back faces are the front.
    """
    _borrow_view(restorer, view_layer)
    for number, tree in enumerate(_peelable_trees()):
        peel = _Peel(restorer, tree)
        leaves = peel.is_back
        if number in flipped:
            leaves = peel.math("SUBTRACT", 1.0, leaves)
        is_back_after_first = peel.math("MULTIPLY", peel.is_before(2), leaves)
        peel.look_through(peel.math("MAXIMUM", peel.is_before(1), is_back_after_first))


def _borrow_view(restorer: Restorer, view_layer: bpy.types.ViewLayer) -> None:
    restorer.change(view_layer, pass_alpha_threshold=max(view_layer.pass_alpha_threshold, _LEAST_OPACITY))
    cycles = view_layer.id_data.cycles
    restorer.change(cycles, transparent_max_bounces=cycles.transparent_max_bounces + _LOOKED_THROUGH)


def _borrow_aovs(restorer: Restorer, view_layer: bpy.types.ViewLayer, wanted: SurfacePasses) -> SurfacePasses:
    """Add AOVs; Blender appends a number where a name is taken."""
    names = []
    restorer.callback(setattr, view_layer, "active_aov_index", view_layer.active_aov_index)
    for name, kind in ((wanted.facts, "COLOR"), (wanted.thing, "VALUE")):
        aov = view_layer.aovs.add()
        aov.name, aov.type = name, kind
        names.append(aov.name)
        # Blender moves the others in memory when one is removed
        restorer.callback(_remove_aov, view_layer, aov.name)
    return SurfacePasses(*names)


def _remove_aov(view_layer: bpy.types.ViewLayer, name: str) -> None:
    view_layer.aovs.remove(view_layer.aovs[name])


def _peelable_trees() -> list[bpy.types.NodeTree]:
    """Return the nodes of materials whose surface is linked to an output for Cycles."""
    return [
        material.node_tree
        for material in shaded_materials()
        if (output := material.node_tree.get_output_node(CYCLES)) is not None
        and active_link(output.inputs["Surface"]) is not None
    ]


class _Peel:
    """The nodes that are added to one material; a `Restorer` takes them away again."""

    def __init__(self, restorer: Restorer, tree: bpy.types.NodeTree) -> None:
        self._restorer, self._tree = restorer, tree
        self._light_path = self._new("ShaderNodeLightPath")
        self.is_back = self._new("ShaderNodeNewGeometry").outputs["Backfacing"]

    def is_before(self, count: int) -> bpy.types.NodeSocket:
        """Return 1 for camera rays that have passed fewer than `count` transparent surfaces, else 0."""
        depth, is_camera = (self._light_path.outputs[name] for name in ("Transparent Depth", "Is Camera Ray"))
        return self.math("MULTIPLY", is_camera, self.math("LESS_THAN", depth, count - 0.5))

    def look_through(self, factor: bpy.types.NodeSocket) -> None:
        """Use a second output whose surface is transparent where `factor` is 1, and all else as before."""
        links, before = self._tree.links, self._tree.get_output_node(CYCLES)
        mix = self._new("ShaderNodeMixShader")
        links.new(mix.inputs[0], factor)
        links.new(mix.inputs[1], active_link(before.inputs["Surface"]).from_socket)
        links.new(mix.inputs[2], self._new("ShaderNodeBsdfTransparent").outputs[0])

        self._restorer.callback(setattr, before, "is_active_output", before.is_active_output)
        output = self._new("ShaderNodeOutputMaterial")
        output.target = before.target
        for socket in before.inputs:
            link = active_link(socket)
            if link is not None:
                links.new(output.inputs[socket.name], link.from_socket)
            elif hasattr(socket, "default_value"):
                output.inputs[socket.name].default_value = socket.default_value
        links.new(output.inputs["Surface"], mix.outputs[0])
        output.is_active_output = True

    def tell(self, passes: SurfacePasses, factor: bpy.types.NodeSocket, material: int) -> None:
        """Write the surface's facts where `factor` is 1."""
        facts = self._new("ShaderNodeCombineXYZ")
        self._feed(facts.inputs["X"], factor)
        self._feed(facts.inputs["Y"], self.math("MULTIPLY", factor, self.is_back))
        self._feed(facts.inputs["Z"], self.math("MULTIPLY", factor, float(material)))
        thing = self.math("MULTIPLY", factor, self._new("ShaderNodeObjectInfo").outputs["Random"])
        for name, socket, value in (
            (passes.facts, "Color", facts.outputs[0]),
            (passes.thing, "Value", thing),
        ):
            aov = self._new("ShaderNodeOutputAOV")
            aov.aov_name = name
            self._feed(aov.inputs[socket], value)

    def math(
        self, operation: str, first: bpy.types.NodeSocket | float, second: bpy.types.NodeSocket | float
    ) -> bpy.types.NodeSocket:
        """Return the output of a Math node."""
        node = self._new("ShaderNodeMath")
        node.operation = operation
        self._feed(node.inputs[0], first)
        self._feed(node.inputs[1], second)
        return node.outputs[0]

    def _feed(self, socket: bpy.types.NodeSocket, value: bpy.types.NodeSocket | float) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self._tree.links.new(socket, value)
        else:
            socket.default_value = value

    def _new(self, kind: str) -> bpy.types.Node:
        node = self._tree.nodes.new(kind)
        self._restorer.callback(self._tree.nodes.remove, node)
        return node
