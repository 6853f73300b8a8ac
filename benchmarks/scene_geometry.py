# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of a Blender scene as its renders show them, to cast rays at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ssgi_addon.core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class WorldTriangles:
    """All triangles that rays of one kind meet.

    Attributes
    ----------
    point_ws : (V, 3) float64
        Corners.
    corner : (T, 3) int64
        Of each triangle, as rows of `point_ws`.
    is_cut_out : (T + 1,) bool
        The material lets rays through in places, as leaves on a quad do. False at the end.
    """

    point_ws: FloatArray
    corner: IntArray
    is_cut_out: BoolArray

    @cached_property
    def normals(self) -> FloatArray:
        """(T + 1, 3) unit normals of the triangles' planes; zero where one has no area, and at the end."""
        a, b, c = (self.point_ws[self.corner[:, i]] for i in range(3))
        normal = np.pad(np.cross(b - a, c - a), ((0, 1), (0, 0)))
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)

    def first_hits(self, origin_ws: FloatArray, direction_ws: FloatArray) -> tuple[FloatArray, IntArray]:
        """Cast rays one by one.

        Parameters
        ----------
        origin_ws, direction_ws : (N, 3)
            World space.

        Returns
        -------
        distance : (N,) float64
            In units of the directions' length; +inf where nothing is hit.
        triangle : (N,) int64
            -1 where nothing is hit.
        """
        tree = BVHTree.FromPolygons(self.point_ws.tolist(), self.corner.tolist(), all_triangles=True)
        distance, triangle = np.full(origin_ws.shape[0], np.inf), np.full(origin_ws.shape[0], -1)
        for ray, (origin, direction) in enumerate(
            zip(origin_ws.tolist(), direction_ws.tolist(), strict=True)
        ):
            _, _, index, length = tree.ray_cast(origin, direction)
            if index is not None:
                distance[ray], triangle[ray] = length, index
        return distance / np.linalg.norm(direction_ws, axis=1), triangle


def show_as_rendered(scene: bpy.types.Scene) -> None:
    """Make the viewport show what a render shows; the scene is not put back.

    Python reaches the evaluated geometry of the viewport alone, which has its own switches for what is hidden
    and for modifiers.
    """
    for thing in (*bpy.data.objects, *bpy.data.collections):
        thing.hide_viewport = thing.hide_render
    for item in bpy.data.objects:
        item.show_instancer_for_viewport = item.show_instancer_for_render
        for modifier in item.modifiers:
            modifier.show_viewport = modifier.show_render
            if modifier.type in ("SUBSURF", "MULTIRES"):
                modifier.levels = modifier.render_levels
    scene.render.simplify_subdivision = scene.render.simplify_subdivision_render
    for layer in scene.view_layers:
        _show(layer.layer_collection)
        for item in layer.objects:
            item.hide_set(False, view_layer=layer)


def _show(layer_collection: bpy.types.LayerCollection) -> None:
    layer_collection.hide_viewport = False
    for child in layer_collection.children:
        _show(child)


def world_triangles(visible_to: str) -> WorldTriangles:
    """Return the triangles of the open scene, instances included, as evaluated for the viewport.

    Hair, points and volumes have none, and displacement in materials is left out.

    Parameters
    ----------
    visible_to
        Kind of ray, as in the names of `bpy.types.Object.visible_camera` and its like.
    """
    points, corners, cut_outs = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], [np.zeros(0, bool)]
    count = 0
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for point, corner, is_cut_out in _meshes(depsgraph, f"visible_{visible_to}"):
        points.append(point)
        corners.append(corner + count)
        cut_outs.append(is_cut_out)
        count += point.shape[0]
    return WorldTriangles(
        np.concatenate(points), np.concatenate(corners), np.concatenate([*cut_outs, [False]])
    )


def _meshes(
    depsgraph: bpy.types.Depsgraph, visibility: str
) -> Iterator[tuple[FloatArray, IntArray, BoolArray]]:
    """Yield corners (V, 3) in world space, triangles (T, 3) and which are cut-outs, object by object."""
    for instance in depsgraph.object_instances:
        item = instance.object
        if not (instance.show_self and getattr(item, visibility)):
            continue
        if item.type not in ("MESH", "CURVE", "SURFACE", "FONT", "META"):
            continue
        mesh = item.to_mesh()
        if mesh is None:
            continue
        mesh.calc_loop_triangles()
        point = np.empty(3 * len(mesh.vertices))
        mesh.vertices.foreach_get("co", point)
        corner = np.empty(3 * len(mesh.loop_triangles), np.int64)
        mesh.loop_triangles.foreach_get("vertices", corner)
        slot = np.empty(len(mesh.loop_triangles), np.int64)
        mesh.loop_triangles.foreach_get("material_index", slot)
        # One more for meshes without a material
        lets_through = np.array([*(_lets_rays_through(one.material) for one in item.material_slots), False])
        pose = np.array(instance.matrix_world)
        moved = point.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]
        yield moved, corner.reshape(-1, 3), lets_through[np.minimum(slot, lets_through.size - 1)]
        item.to_mesh_clear()


def _lets_rays_through(material: bpy.types.Material | None) -> bool:
    """Return whether a material may be transparent somewhere; glass is not, rays end on it."""
    return material is not None and material.node_tree is not None and _is_transparent(material.node_tree)


def _is_transparent(tree: bpy.types.NodeTree) -> bool:
    for node in tree.nodes:
        if node.type == "BSDF_TRANSPARENT":
            return True
        if node.type == "GROUP" and node.node_tree is not None and _is_transparent(node.node_tree):
            return True
        if node.type == "BSDF_PRINCIPLED":
            alpha = node.inputs["Alpha"]
            if alpha.is_linked or alpha.default_value < 1.0:
                return True
    return False
