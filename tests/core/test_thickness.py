# SPDX-License-Identifier: GPL-3.0-or-later
"""How thick a surface is, from what stands behind it."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import Camera, GBuffer, Settings
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.thickness import Orientation, SurfaceIdentity, is_beyond, thickness_of
from tests.tolerances import FILTER_RELATIVE

SHAPE = (6, 8)
DEPTH = 4.0
GAP = 2.0
HEURISTIC = Settings().thickness * DEPTH


def camera_of(kind="perspective"):
    height, width = SHAPE
    if kind == "orthographic":
        return Camera.orthographic(width, height, DEPTH)
    return Camera.perspective(width, height, 1.0)


def plane(depth=DEPTH, normal=(0.0, 0.0, 1.0)):
    """A G-buffer of one depth; `depth` may be an image."""
    black = np.zeros((*SHAPE, 3))
    return GBuffer(
        depth=np.broadcast_to(np.float32(depth), SHAPE),
        normal=np.broadcast_to(normal, black.shape),
        albedo=black,
        specular=black,
        roughness=np.ones(SHAPE),
        direct=black,
    )


def identity(is_back=False, thing=0.25, *, is_known=True):
    return SurfaceIdentity(
        is_known=np.full(SHAPE, is_known),
        is_back=np.broadcast_to(is_back, SHAPE),
        material=np.zeros(SHAPE, dtype=np.int64),
        thing=np.full(SHAPE, thing, dtype=np.float32),
    )


def thickness(first, second, *, gap=GAP, seen=None, gbuffer=None, camera=None):
    """Thickness in the middle; `seen` is what the views show of the things, by default `first`."""
    seen = first if seen is None else seen
    image = thickness_of(
        gbuffer or plane(),
        camera or camera_of(),
        np.full(SHAPE, DEPTH + gap, dtype=np.float32),
        first,
        second,
        Orientation([seen.thing], [seen]),
    )
    assert image.dtype == np.float32
    return image[3, 4]


def both_sides():
    """A thing that shows its back in half of its pixels."""
    return identity(np.arange(SHAPE[1]) % 2 == 0)


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_own_back_face_ends_the_surface(kind):
    found = thickness(identity(), identity(True), camera=camera_of(kind))
    assert np.isclose(found, GAP, rtol=FILTER_RELATIVE)


def test_own_back_face_ends_a_surface_that_is_inside_out():
    assert np.isclose(thickness(identity(True), identity()), GAP, rtol=FILTER_RELATIVE)


@pytest.mark.parametrize(
    ("first", "second", "seen"),
    [
        (identity(), identity(True, thing=0.5), None),
        (identity(), identity(True), both_sides()),
        (identity(True), identity(), identity()),
        (identity(), identity(is_known=False), None),
    ],
    ids=["of another thing", "of a thing that shows both sides", "behind its back", "of no material"],
)
def test_doubtful_back_face_makes_nothing_thicker_than_the_heuristic(first, second, seen):
    assert np.isclose(thickness(first, second, seen=seen), HEURISTIC, rtol=FILTER_RELATIVE)
    near = 0.5 * HEURISTIC
    assert np.isclose(thickness(first, second, seen=seen, gap=near), near, rtol=FILTER_RELATIVE)


@pytest.mark.parametrize("gap", [GAP, np.inf])
@pytest.mark.parametrize("is_back", [False, True])
def test_open_surface_is_a_sheet_of_a_pixel(gap, is_back):
    camera = Camera.perspective(*SHAPE[::-1], 0.1)
    found = thickness(identity(is_back), identity(is_back, thing=0.5), gap=gap, camera=camera)
    assert np.isclose(found, DEPTH / camera.fx, rtol=FILTER_RELATIVE)


def test_sheet_is_never_thicker_than_the_heuristic():
    camera = Camera.perspective(8, 6, 3.0)  # pixels as wide as things
    found = thickness(identity(), identity(), camera=camera)
    assert np.isclose(found, HEURISTIC, rtol=FILTER_RELATIVE)


def test_small_gap_behind_a_sheet_is_filled():
    camera = Camera.perspective(*SHAPE[::-1], 0.001)
    gap = 0.01 * DEPTH
    found = thickness(identity(), identity(thing=0.5), gap=gap, camera=camera)
    assert np.isclose(found, gap, rtol=FILTER_RELATIVE)


def test_sheet_holds_the_steps_between_its_pixels():
    """No ray that comes from before a slanted sheet slips between the slabs of two of its pixels."""
    camera = camera_of()
    slope = 1.0
    # The plane z = -4 + slope * x
    ray_x = (np.arange(SHAPE[1]) + 0.5 - camera.cx) / camera.fx
    depth = DEPTH / (1.0 + slope * ray_x)
    gbuffer = plane(depth, np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0))
    none = np.full(SHAPE, np.inf, dtype=np.float32)
    sheet = thickness_of(
        gbuffer, camera, none, identity(), identity(), Orientation([identity().thing], [identity()])
    )
    step = np.abs(np.diff(gbuffer.depth, axis=1))
    heuristic = Settings().thickness * gbuffer.depth
    for pixel in (sheet[:, 1:], sheet[:, :-1]):
        assert (pixel >= np.minimum(step, heuristic[:, 1:]) * (1.0 - FILTER_RELATIVE)).all()


def test_surface_that_was_not_looked_through_has_the_heuristic_thickness():
    for gap in (0.0, -1.0, 1e-6):
        assert np.isclose(thickness(identity(), identity(True), gap=gap), HEURISTIC, rtol=FILTER_RELATIVE)
    unknown = identity(is_known=False)
    assert np.isclose(thickness(unknown, identity(True)), HEURISTIC, rtol=FILTER_RELATIVE)


def test_orthographic_heuristic_is_relative_to_the_width():
    camera = Camera.orthographic(*SHAPE[::-1], 30.0)
    found = thickness(identity(is_known=False), identity(True), camera=camera)
    assert np.isclose(found, 3.0, rtol=FILTER_RELATIVE)


def test_background_has_no_thickness():
    depth = np.full(SHAPE, DEPTH)
    depth[3, 4] = np.inf
    assert thickness(identity(), identity(True), gbuffer=plane(depth)) == 0.0


def test_captured_thickness_makes_valid_slabs():
    """What is handed to the tracer is finite, also beside background and on surfaces seen edge-on."""
    depth = np.full(SHAPE, DEPTH)
    depth[:, ::3] = np.inf
    gbuffer = plane(depth, (1.0, 0.0, 0.0))
    for second in (DEPTH + GAP, np.inf):
        image = thickness_of(
            gbuffer,
            camera_of(),
            np.full(SHAPE, second, dtype=np.float32),
            identity(),
            identity(True),
            Orientation([identity().thing], [identity()]),
        )
        field = DepthField.build(
            GBuffer(*(getattr(gbuffer, name) for name in NAMES), thickness=image), camera_of(), 0.1
        )
        assert np.isfinite(field.slab).all()
        assert (field.slab[~field.is_background] > 0.0).all()


NAMES = ("depth", "normal", "albedo", "specular", "roughness", "direct")


def test_two_depths_within_the_jitter_are_one_surface():
    slanted = plane(normal=(0.9, 0.0, np.sqrt(1.0 - 0.81)))
    front = np.full(SHAPE, DEPTH, dtype=np.float32)
    for added, expected in ((1e-6, False), (0.01, False), (0.5, True)):
        assert (is_beyond(front + np.float32(added), front, slanted, camera_of()) == expected).all()
    assert is_beyond(front + np.float32(0.01), front, plane(), camera_of()).all()


# --- Orientation ------------------------------------------------------------------------------------------


def test_orientation_counts_known_pixels_of_all_views():
    right, wrong = identity(False), identity(True)
    nowhere = identity(True, is_known=False)
    seen = [right, right, right, wrong, nowhere]
    things = Orientation([view.thing for view in seen], seen)
    assert np.allclose(things.share(right.thing), 0.25)
    assert things.share(np.float32([0.7]))[0] == 0.0


def test_materials_that_show_mostly_backs_are_turned():
    seen = [identity(True), identity(True), identity(False)]
    assert Orientation([view.material for view in seen], seen).mostly_backs() == {0}
    assert Orientation([view.material for view in seen], seen[::-1]).mostly_backs() == {0}
    assert Orientation([seen[2].material], seen[2:]).mostly_backs() == frozenset()


def test_nothing_known_has_no_orientation():
    seen = identity(is_known=False)
    things = Orientation([seen.thing], [seen])
    assert (things.share(seen.thing) == 0.0).all()
    assert things.mostly_backs() == frozenset()
