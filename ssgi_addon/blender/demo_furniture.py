# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene's furniture: glossy, rough, mirroring and thin things for the light to meet."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import dataclass

import bmesh
import bpy
from mathutils import Matrix, Vector

from .build import add_ball, add_box, add_lathe, add_mesh, add_rod, new_material

_BOOK_COLORS = (
    (0.62, 0.10, 0.06),
    (0.07, 0.20, 0.34),
    (0.80, 0.72, 0.56),
    (0.10, 0.30, 0.20),
    (0.74, 0.44, 0.10),
)


@dataclass(frozen=True)
class _Finishes:
    """Materials that several pieces share."""

    oak: bpy.types.Material
    steel: bpy.types.Material
    brass: bpy.types.Material


def furnish(scene: bpy.types.Scene, *, left: float, back: float, height: float) -> None:
    """Put furniture into a room whose left wall, back wall and ceiling lie at these coordinates, metres."""
    finishes = _Finishes(
        oak=new_material("Oak", (0.52, 0.34, 0.18), roughness=0.4),
        steel=new_material("Black Steel", (0.03, 0.03, 0.035), roughness=0.35),
        brass=new_material("Brushed Brass", (0.86, 0.60, 0.26), roughness=0.32, metallic=1.0),
    )
    _add_chair(scene, finishes)
    _add_table(scene, finishes)
    _add_shelf(scene, finishes, back)
    _add_sideboard(scene, finishes, left)
    _add_pendant(scene, finishes, height)
    _add_picture(scene, back)
    _add_plant(scene)

    mirror = new_material("Mirror", (0.95, 0.95, 0.95), roughness=0.0, metallic=1.0)
    add_ball(scene, "Mirror Ball", mirror, (0.02, -0.42, 0.27), 0.27)
    wool = new_material("Rug", (0.55, 0.50, 0.42), roughness=1.0, specular=0.0)
    rug = [(0.0, 0.0), (1.06, 0.0), (1.06, 0.010), (1.05, 0.014), (0.0, 0.014)]
    add_lathe(scene, "Rug", wool, rug, (-0.35, 0.95, 0.0))


def _add_chair(scene: bpy.types.Scene, finishes: _Finishes) -> None:
    """Two cushions on a frame of thin steel."""
    wool = new_material("Ochre Wool", (0.74, 0.40, 0.06), roughness=0.95, specular=0.1)
    place = Matrix.Translation((-1.22, 1.22, 0.0)) @ Matrix.Rotation(math.radians(38.0), 4, "Z")

    for name, low, high, offset, tilt in (
        ("Chair Seat", (-0.36, -0.38, 0.0), (0.36, 0.36, 0.17), (0.0, 0.0, 0.34), -7.0),
        ("Chair Back", (-0.36, -0.08, 0.0), (0.36, 0.08, 0.62), (0.0, 0.36, 0.42), -20.0),
    ):
        cushion = add_box(scene, name, wool, low, high, bevel=0.05)
        tilted = Matrix.Rotation(math.radians(tilt), 4, "X")
        cushion.matrix_world = place @ Matrix.Translation(offset) @ tilted

    sides = [
        rod
        for x in (-0.39, 0.39)
        for rod in (
            ((x, -0.42, 0.0), (x, -0.34, 0.56)),
            ((x, -0.34, 0.56), (x, 0.44, 0.50)),
            ((x, 0.62, 0.0), (x, 0.44, 0.50)),
            ((x, -0.39, 0.34), (x, 0.50, 0.34)),
        )
    ]
    crossbars = [((-0.39, y, 0.34), (0.39, y, 0.34)) for y in (-0.385, 0.50)]
    for start, end in sides + crossbars:
        add_rod(scene, "Chair Frame", finishes.steel, place @ Vector(start), place @ Vector(end), 0.011)


def _add_table(scene: bpy.types.Scene, finishes: _Finishes) -> None:
    """A round table on three thin legs, with a rough brass vase and two books."""
    x, y, height = 0.10, 0.98, 0.46
    top = [(0.0, -0.03), (0.40, -0.03), (0.42, -0.015), (0.42, -0.004), (0.416, 0.0), (0.0, 0.0)]
    add_lathe(scene, "Table Top", finishes.oak, top, (x, y, height))
    for turn in range(3):
        angle = math.radians(25.0 + 120.0 * turn)
        foot = (x + 0.37 * math.cos(angle), y + 0.37 * math.sin(angle), 0.0)
        head = (x + 0.24 * math.cos(angle), y + 0.24 * math.sin(angle), height - 0.03)
        add_rod(scene, "Table Leg", finishes.steel, foot, head, 0.012)

    outside = [(0.0, 0.0), (0.07, 0.0), (0.115, 0.09), (0.125, 0.14), (0.11, 0.20), (0.06, 0.27)]
    mouth = [(0.042, 0.31), (0.042, 0.36), (0.056, 0.40), (0.050, 0.40), (0.036, 0.36), (0.0, 0.33)]
    add_lathe(scene, "Brass Vase", finishes.brass, outside + mouth, (x - 0.08, y + 0.08, height))
    for level, (color, turn) in enumerate((((0.05, 0.16, 0.36), 12.0), ((0.70, 0.62, 0.50), -9.0))):
        cover = new_material("Table Book", color, roughness=0.5)
        low = height + 0.034 * level
        corners = (x + 0.05, y - 0.26, low), (x + 0.29, y - 0.09, low + 0.032)
        book = add_box(scene, "Table Book", cover, *corners, bevel=0.004)
        book.rotation_euler.z = math.radians(turn)


def _add_shelf(scene: bpy.types.Scene, finishes: _Finishes, back: float) -> None:
    """A shelf on the back wall with a row of books and a jar."""
    start, end, height = 0.35, 1.95, 1.42
    corners = (start, back - 0.24, height - 0.035), (end, back, height)
    add_box(scene, "Shelf", finishes.oak, *corners, bevel=0.004)

    covers = [new_material("Book", color, roughness=0.5) for color in _BOOK_COLORS]
    chance = random.Random(7)
    x = start + 0.05
    while x < end - 0.5:
        width, tall = chance.uniform(0.025, 0.055), chance.uniform(0.19, 0.29)
        front = back - 0.01 - chance.uniform(0.14, 0.19)
        corners = (x, front, height), (x + width, back - 0.01, height + tall)
        add_box(scene, "Book", chance.choice(covers), *corners, bevel=0.004)
        x += width + 0.002

    glaze = new_material("Celadon", (0.36, 0.52, 0.44), roughness=0.25)
    jar = [(0.0, 0.0), (0.05, 0.0), (0.085, 0.06), (0.08, 0.12), (0.045, 0.16), (0.04, 0.16), (0.0, 0.10)]
    add_lathe(scene, "Jar", glaze, jar, (1.66, back - 0.12, height))


def _add_sideboard(scene: bpy.types.Scene, finishes: _Finishes, left: float) -> None:
    """A low sideboard along the left wall, with a bowl on it."""
    lacquer = new_material("White Lacquer", (0.82, 0.81, 0.78), roughness=0.25)
    near, far, front = -1.75, -0.25, left + 0.42
    add_box(scene, "Sideboard", finishes.oak, (left + 0.03, near, 0.18), (front, far, 0.60), bevel=0.006)
    pitch = (far - near - 0.04) / 3
    for index in range(3):
        start = near + 0.02 + index * pitch
        corners = (front, start, 0.2), (front + 0.014, start + pitch - 0.008, 0.58)
        add_box(scene, "Sideboard Door", lacquer, *corners, bevel=0.003)
    for y, x in itertools.product((near + 0.12, far - 0.12), (left + 0.08, front - 0.05)):
        add_rod(scene, "Sideboard Leg", finishes.steel, (x, y, 0.0), (x, y, 0.18), 0.012)

    glaze = new_material("Blue Glaze", (0.05, 0.16, 0.36), roughness=0.3)
    bowl = [(0.0, 0.0), (0.06, 0.0), (0.07, 0.012), (0.17, 0.09), (0.165, 0.093), (0.06, 0.02), (0.0, 0.016)]
    add_lathe(scene, "Bowl", glaze, bowl, (left + 0.22, -0.62, 0.60))


def _add_pendant(scene: bpy.types.Scene, finishes: _Finishes, ceiling: float) -> None:
    """A brass shade that hangs over the table."""
    x, y, low = 0.10, 0.98, 1.72
    outside = [(0.0, 0.2), (0.05, 0.2), (0.06, 0.17), (0.20, 0.05), (0.23, 0.0)]
    inside = [(0.225, 0.0), (0.19, 0.045), (0.05, 0.155), (0.0, 0.16)]
    add_lathe(scene, "Pendant Shade", finishes.brass, outside + inside, (x, y, low))
    add_rod(scene, "Pendant Cord", finishes.steel, (x, y, low + 0.2), (x, y, ceiling), 0.006)


def _add_picture(scene: bpy.types.Scene, back: float) -> None:
    """A framed abstract of three discs on the back wall."""
    paper = new_material("Paper", (0.84, 0.81, 0.74), roughness=0.9, specular=0.1)
    frame = new_material("Picture Frame", (0.05, 0.04, 0.035), roughness=0.4)
    x, z, rim = -0.72, 1.62, 0.03
    left, right, low, high = x - 0.36, x + 0.36, z - 0.46, z + 0.46
    add_box(scene, "Picture Paper", paper, (left, back - 0.012, low), (right, back, high))
    for x0, x1, z0, z1 in (
        (left, right, low, low + rim),
        (left, right, high - rim, high),
        (left, left + rim, low, high),
        (right - rim, right, low, high),
    ):
        add_box(scene, "Picture Frame", frame, (x0, back - 0.03, z0), (x1, back, z1), bevel=0.003)

    for layer, (color, dx, dz, radius) in enumerate(
        (
            ((0.72, 0.13, 0.055), -0.06, 0.10, 0.19),
            ((0.06, 0.17, 0.34), 0.08, -0.14, 0.13),
            ((0.80, 0.50, 0.08), -0.13, -0.22, 0.07),
        )
    ):
        ink = new_material("Ink", color, roughness=0.9, specular=0.1)
        y = back - 0.013 - 0.001 * layer
        add_rod(scene, "Picture Disc", ink, (x + dx, y, z + dz), (x + dx, y - 0.001, z + dz), radius)


def _add_plant(scene: bpy.types.Scene) -> None:
    """A potted plant in the corner behind the chair."""
    clay = new_material("Clay Pot", (0.80, 0.78, 0.74), roughness=0.5)
    leaf = new_material("Leaf", (0.055, 0.19, 0.05), roughness=0.38)
    x, y = -1.82, 1.98
    pot = [(0.0, 0.0), (0.13, 0.0), (0.175, 0.33), (0.16, 0.33), (0.155, 0.29), (0.0, 0.29)]
    add_lathe(scene, "Pot", clay, pot, (x, y, 0.0))

    chance = random.Random(3)

    def shape(builder: bmesh.types.BMesh) -> None:
        for index in range(17):
            turn = 2.4 * index  # the golden angle, so that leaves never stack
            _add_leaf(builder, turn, rise=chance.uniform(1.0, 2.5), reach=chance.uniform(0.14, 0.5))

    leaves = add_mesh(scene, "Leaves", leaf, shape, smooth=True)
    leaves.location = (x, y, 0.29)


def _add_leaf(builder: bmesh.types.BMesh, turn: float, *, rise: float, reach: float) -> None:
    """A strip, folded along its middle, that rises and arches outwards."""
    out = Vector((math.cos(turn), math.sin(turn), 0.0))
    side = Vector((-out.y, out.x, 0.0))
    rows = []
    for step in range(9):
        along = step / 8
        middle = out * (0.03 + reach * along**1.8) + Vector((0.0, 0.0, rise * (along - 0.38 * along**3)))
        width = 0.075 * math.sin(math.pi * (0.12 + 0.88 * along) ** 0.8)
        lifted = middle + out * 0.02
        points = (lifted - side * width, middle, lifted + side * width)
        rows.append([builder.verts.new(point) for point in points])
    for lower, upper in itertools.pairwise(rows):
        for left, right in itertools.pairwise(range(3)):
            builder.faces.new((lower[left], lower[right], upper[right], upper[left]))
