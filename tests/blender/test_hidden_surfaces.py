# SPDX-License-Identifier: GPL-3.0-or-later
"""Back faces and the layer behind: what the camera would see with the first surface gone from its sight."""

from __future__ import annotations

from dataclasses import replace

import bmesh
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ssgi_addon.blender import hidden_surfaces, roughness
from ssgi_addon.blender.build import (
    add_box,
    add_camera,
    add_lamp,
    add_mesh,
    new_material,
    new_world,
    node_tree,
)
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.restore import Restorer
from ssgi_addon.core import Camera, GBuffer, Settings
from ssgi_addon.thickness import Orientation, SurfaceIdentity, thickness_of
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.opengl import needs_opengl
from tests.blender.test_roughness import Network, new_group
from tests.scenes import GREEN, RED, WHITE
from tests.tolerances import BACK_FACE, CAPTURED_GEOMETRY, MEAN_OF_NOISY_PIXELS, PEELED_LIGHT, ROUGHNESS_AOV

OPTIONS = CaptureOptions(samples=1, denoiser="none", back_faces=True, behind=True)
HALF = 0.5  # of the cube's edge
DISTANCE = 5.0  # of the camera from the middle
WALL = 3.0  # beyond the middle


@pytest.fixture
def stage(empty_file):
    """A wall, a sun that casts hard shadows, a camera that looks straight at the wall."""
    scene = empty_file
    scene.world = new_world("Dark", (0, 0, 0), 0.0)
    wall = new_material("Wall", GREEN, roughness=0.7)
    add_box(scene, "Wall", wall, (-9.0, WALL, -9.0), (9.0, WALL + 1.0, 9.0))
    sun = add_lamp(scene, "Sun", "SUN", (0.8, -5.0, 1.0), (0.0, 0.0, 0.0), energy=3.0, color=(1, 1, 1))
    sun.data.angle = 0.0
    camera = add_camera(scene, (0.0, -DISTANCE, 0.0), (0.0, 0.0, 0.0), lens=45.0)
    # No ray through an edge of the cube: it would meet two sides at once
    camera.data.shift_x, camera.data.shift_y = 0.013, 0.007
    scene.render.resolution_x, scene.render.resolution_y = 15, 11
    # The frame's light through pixel centres as well, to compare with
    scene.render.engine = "CYCLES"
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    return scene


def clay(net):
    return net.add("ShaderNodeBsdfPrincipled", Roughness=0.3)


def material_of(build, name="Clay"):
    """A material whose surface is what `build` makes in its network."""
    material = bpy.data.materials.new(name)
    net = Network(node_tree(material))
    net.tree.nodes.clear()
    output = net.tree.nodes.new("ShaderNodeOutputMaterial")
    surface = build(net)
    if surface is not None:
        net.link(surface, output.inputs["Surface"])
    return material


def add_cube(scene, material, middle=(0.0, 0.0, 0.0)):
    low, high = (tuple(value + side for value in middle) for side in (-HALF, HALF))
    return add_box(scene, "Cube", material, low, high)


def add_sheet(scene, material, *, y=0.0, half=1.0):
    """A square that faces the camera."""

    def square(builder):
        corners = [(-half, y, -half), (half, y, -half), (half, y, half), (-half, y, half)]
        builder.faces.new([builder.verts.new(corner) for corner in corners])

    return add_mesh(scene, "Sheet", material, square)


def flip(thing):
    thing.data.flip_normals()
    return thing


def pixels_of(frame, depth):
    """Pixels whose surface lies nearer than `depth`."""
    found = frame.gbuffer.depth < depth
    assert found.any()
    return found


def cube_exit(camera):
    """Depth at which the ray of each pixel leaves the cube in the middle."""
    y_px, x_px = np.mgrid[: camera.height, : camera.width] + 0.5
    ray = camera.pixel_to_view(x_px, y_px, np.ones_like(x_px))
    with np.errstate(divide="ignore"):
        side = HALF / np.abs(ray[..., :2]).max(axis=-1)
    return np.minimum(side, DISTANCE + HALF)


def assert_cube_is_solid_before_the_wall(frame):
    cube = pixels_of(frame, DISTANCE)
    thickness = (cube_exit(frame.camera) - frame.gbuffer.depth)[cube]
    assert np.allclose(frame.gbuffer.thickness[cube], thickness, atol=BACK_FACE)
    assert np.allclose(frame.gbuffer.behind.depth[cube], DISTANCE + WALL, rtol=CAPTURED_GEOMETRY)


def assert_not_captured(frame, pixels):
    heuristic = Settings().thickness * frame.gbuffer.depth[pixels]
    assert np.allclose(frame.gbuffer.thickness[pixels], heuristic, rtol=CAPTURED_GEOMETRY)
    assert np.isposinf(frame.gbuffer.behind.depth[pixels]).all()


# --- Thickness --------------------------------------------------------------------------------------------


def test_cube_is_as_thick_as_it_is(stage):
    add_cube(stage, new_material("Clay", RED))
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))


def test_cube_of_two_slots_with_one_material_is_as_thick_as_it_is(stage):
    cube = add_cube(stage, new_material("Clay", RED))
    cube.data.materials.append(cube.data.materials[0])
    cube.data.polygons[0].material_index = 1
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))


def test_cube_under_an_orthographic_camera_is_as_thick_as_it_is(stage):
    add_cube(stage, new_material("Clay", RED))
    stage.camera.data.type, stage.camera.data.ortho_scale = "ORTHO", 4.0
    frame = capture_frame(stage, OPTIONS)
    cube = pixels_of(frame, DISTANCE)
    assert np.allclose(frame.gbuffer.thickness[cube], 2.0 * HALF, atol=BACK_FACE)
    assert np.allclose(frame.gbuffer.behind.depth[cube], DISTANCE + WALL, rtol=CAPTURED_GEOMETRY)


def test_back_face_that_is_met_twice_is_no_layer_behind(stage):
    """Rays through the edges between the cube's sides leave through both."""
    stage.camera.data.shift_x = stage.camera.data.shift_y = 0.0
    add_cube(stage, new_material("Clay", RED))
    frame = capture_frame(stage, OPTIONS)
    behind = frame.gbuffer.behind.depth[pixels_of(frame, DISTANCE)]
    assert (np.isposinf(behind) | (np.abs(behind - DISTANCE - WALL) < BACK_FACE)).all()


def test_ball_is_as_thick_as_it_is(stage):
    def ball(builder):
        bmesh.ops.create_icosphere(builder, subdivisions=7, radius=1.0)

    add_mesh(stage, "Ball", new_material("Clay", RED), ball, smooth=True)
    stage.render.resolution_x, stage.render.resolution_y = 31, 31
    frame = capture_frame(stage, OPTIONS)
    y_px, x_px = np.mgrid[:31, :31] + 0.5
    ray = frame.camera.pixel_to_view(x_px, y_px, np.ones_like(x_px))
    # Along ray · t from the camera: the ball's middle lies at depth 5
    square, middle = (ray**2).sum(axis=-1), -DISTANCE * ray[..., 2]
    with np.errstate(invalid="ignore"):
        chord = 2.0 * np.sqrt(middle**2 - square * (DISTANCE**2 - 1.0)) / square
    inner = chord > 0.5  # nearer the edge, the facets' error grows without bound
    assert inner.sum() > 100
    assert np.allclose(frame.gbuffer.thickness[inner], chord[inner], atol=BACK_FACE)


def test_cube_turned_inside_out_is_as_thick_as_it_is(stage):
    flip(add_cube(stage, new_material("Clay", RED)))
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))


@pytest.mark.parametrize("turn", [lambda sheet: sheet, flip])
@pytest.mark.parametrize("wall", ["wall", "sky"])
def test_single_plane_is_a_thin_sheet(stage, turn, wall):
    if wall == "sky":
        bpy.data.objects.remove(stage.objects["Wall"])
    turn(add_sheet(stage, new_material("Paper", WHITE)))
    frame = capture_frame(stage, OPTIONS)
    sheet = pixels_of(frame, DISTANCE + HALF)
    thickness = frame.gbuffer.thickness[sheet]
    footprint = DISTANCE / frame.camera.fx
    assert thickness.min() > 0.5 * footprint
    assert thickness.max() < 2.0 * footprint
    expected = DISTANCE + WALL if wall == "wall" else np.inf
    assert np.allclose(frame.gbuffer.behind.depth[sheet], expected, rtol=CAPTURED_GEOMETRY)


def test_sheet_seen_edge_on_is_no_thicker_than_the_heuristic():
    """Its plane has no slope that is a number."""
    shape = (3, 3)
    black, depth = np.zeros((*shape, 3)), np.full(shape, 2.0, dtype=np.float32)
    gbuffer = GBuffer(
        depth=depth,
        normal=np.broadcast_to((0.6, 0.8, 0.0), black.shape),
        albedo=black,
        specular=black,
        roughness=np.ones(shape),
        direct=black,
    )
    paper = SurfaceIdentity(
        is_known=np.ones(shape, dtype=bool),
        is_back=np.zeros(shape, dtype=bool),
        material=np.zeros(shape, dtype=np.int64),
        thing=np.zeros(shape, dtype=np.float32),
    )
    camera = Camera.orthographic(3, 3, 1.0)
    things = Orientation([paper.thing], [paper])
    thickness = thickness_of(gbuffer, camera, depth + 1.0, paper, paper, things)
    assert (thickness > 0.0).all()
    assert (thickness <= Settings().thickness).all()  # of a view that is 1 wide


def test_wall_that_shows_its_back_is_the_layer_behind(stage):
    """Normals of a room that was modelled from outside."""
    flip(stage.objects["Wall"])
    add_cube(stage, new_material("Clay", RED))
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))


def test_sheet_before_a_wall_that_shows_its_back(stage):
    flip(stage.objects["Wall"])
    add_sheet(stage, new_material("Paper", WHITE))
    frame = capture_frame(stage, OPTIONS)
    sheet = pixels_of(frame, DISTANCE + HALF)
    assert (frame.gbuffer.thickness[sheet] <= 0.1 * frame.gbuffer.depth[sheet]).all()
    assert np.allclose(frame.gbuffer.behind.depth[sheet], DISTANCE + WALL, rtol=CAPTURED_GEOMETRY)


def test_sheet_that_lies_on_a_wall_is_filled(stage):
    add_sheet(stage, new_material("Poster", WHITE), y=WALL - 0.1)
    frame = capture_frame(stage, OPTIONS)
    poster = pixels_of(frame, DISTANCE + WALL - 0.05)
    assert (frame.gbuffer.thickness[poster] >= 0.1 - BACK_FACE).all()


# --- The layer behind and its light -----------------------------------------------------------------------

BLOCKERS = {
    "opaque": clay,
    "glass": lambda net: net.add("ShaderNodeBsdfGlass", Roughness=0.0),
    "half transparent": lambda net: net.mix(net.add("ShaderNodeBsdfTransparent"), net.diffuse(), 0.6),
    "group": lambda net: net.group(new_group("Clay", lambda inside, _: inside.diffuse())),
}
EMITTERS = {
    "bright": lambda net: net.add("ShaderNodeEmission", Strength=10.0),
    "faint": lambda net: net.add("ShaderNodeEmission", Strength=0.6),
    "colour": lambda net: net.add("ShaderNodeRGB"),
    "value": lambda net: net.value(2.0),
}


def wall_behind(stage, sheet, samples=1):
    """The layer behind a sheet, and the frame of a camera that cannot see the sheet, in the same pixels."""
    options = CaptureOptions(samples=samples, denoiser="none")
    behind = capture_frame(stage, replace(options, behind=True)).gbuffer.behind
    sheet.visible_camera = False
    wall = capture_frame(stage, options).gbuffer
    is_behind = np.isfinite(behind.depth)
    assert 5 < is_behind.sum() < is_behind.size / 2
    return (lambda name: getattr(behind, name)[is_behind]), (lambda name: getattr(wall, name)[is_behind])


@pytest.mark.parametrize("name", BLOCKERS)
def test_layer_behind_is_lit_as_if_nothing_had_been_removed(stage, name):
    """A sheet that only the camera cannot see leaves its shadow on the wall."""
    sheet = add_sheet(stage, material_of(BLOCKERS[name], name), half=0.7)
    found, expected = wall_behind(stage, sheet)
    for field in ("depth", "normal", "albedo", "specular"):
        assert np.allclose(found(field), expected(field), atol=CAPTURED_GEOMETRY * DISTANCE), field
    for field in ("direct", "source", "glossy_source"):
        assert np.allclose(found(field), expected(field), atol=PEELED_LIGHT), field
    light = expected("source").max(axis=-1)
    assert light.max() > 0.05
    if name == "opaque":
        assert light.min() == 0.0


@pytest.mark.parametrize("name", EMITTERS)
def test_layer_behind_is_lit_by_what_glows_before_it(stage, name):
    """Cycles takes a mesh for a lamp by what its nodes may send out at most."""
    bpy.data.objects.remove(stage.objects["Sun"])
    sheet = add_sheet(stage, material_of(EMITTERS[name], name), half=0.7)
    found, expected = wall_behind(stage, sheet, samples=1024)  # colours and values are no lamps
    assert expected("source").mean() > 0.005
    assert np.isclose(found("source").mean(), expected("source").mean(), rtol=MEAN_OF_NOISY_PIXELS)


@pytest.mark.parametrize("source", [roughness.borrow_aov_roughness, roughness.borrow_roughness])
def test_layer_behind_has_its_own_roughness(stage, monkeypatch, source):
    monkeypatch.setattr(hidden_surfaces, "borrow_roughness", source)
    add_sheet(stage, new_material("Paper", WHITE, roughness=0.2))
    behind = capture_frame(stage, OPTIONS).gbuffer.behind
    is_behind = np.isfinite(behind.depth)
    assert is_behind.any()
    tolerance = ROUGHNESS_AOV if source is roughness.borrow_aov_roughness else 0.01
    assert np.abs(behind.roughness[is_behind] - 0.7).max() < tolerance


def test_layer_behind_an_object_in_an_object_is_the_inner_one(stage):
    add_box(stage, "Shell", new_material("Shell", WHITE), (-1, -1, -1), (1, 1, 1))
    add_cube(stage, new_material("Clay", RED))
    frame = capture_frame(stage, OPTIONS)
    middle = (frame.camera.height // 2, frame.camera.width // 2)
    assert np.isclose(frame.gbuffer.behind.depth[middle], DISTANCE - HALF, rtol=CAPTURED_GEOMETRY)


def test_nothing_is_behind_the_last_surface(stage):
    frame = capture_frame(stage, OPTIONS)
    assert np.isposinf(frame.gbuffer.behind.depth).all()
    assert np.allclose(frame.gbuffer.thickness, 1.0, atol=BACK_FACE)


def test_nothing_is_behind_an_invisible_back(stage):
    """Cycles gives it no depth, though it tells what it is."""
    bpy.data.objects.remove(stage.objects["Wall"])
    sheet = add_sheet(stage, new_material("Paper", WHITE))
    sheet.rotation_euler = (0.3, 0.0, 0.4)
    flip(add_sheet(stage, material_of(lambda net: net.add("ShaderNodeBsdfTransparent")), y=2.0, half=0.8))
    frame = capture_frame(stage, OPTIONS)
    assert np.isposinf(frame.gbuffer.behind.depth[pixels_of(frame, DISTANCE + HALF)]).all()


def test_a_threshold_of_nothing_still_looks_through(stage):
    stage.view_layers[0].pass_alpha_threshold = 0.0
    add_cube(stage, new_material("Clay", RED))
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))


def test_scene_without_transparent_bounces_is_looked_through(stage):
    stage.cycles.transparent_max_bounces = 0
    add_cube(stage, new_material("Clay", RED))
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))


# --- What cannot be looked through ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["no material", "no output", "nothing linked", "link muted", "for EEVEE"])
def test_surface_that_cannot_be_edited_is_not_captured(stage, name):
    material = None if name == "no material" else material_of(clay, name)
    cube = add_cube(stage, material or bpy.data.materials.new("Gone"))
    if material is None:
        cube.data.materials.clear()
    else:
        output = material.node_tree.get_output_node("CYCLES")
        if name == "no output":
            material.node_tree.nodes.remove(output)
        elif name == "nothing linked":
            material.node_tree.links.clear()
        elif name == "link muted":
            material.node_tree.links[0].is_muted = True
        else:
            output.target = "EEVEE"
    frame = capture_frame(stage, OPTIONS)
    assert_not_captured(frame, pixels_of(frame, DISTANCE))


def test_material_with_nodes_switched_off_is_not_captured(stage):
    if bpy.app.version >= (5, 0, 0):
        pytest.skip("materials always use nodes since 5.0")
    material = new_material("Plain", RED)
    material.use_nodes = False
    add_cube(stage, material)
    frame = capture_frame(stage, OPTIONS)
    assert_not_captured(frame, pixels_of(frame, DISTANCE))


def test_what_stands_behind_a_hole_is_not_captured(stage):
    """Cycles counts the hole as the first surface."""
    add_sheet(stage, material_of(lambda net: net.add("ShaderNodeBsdfPrincipled", Alpha=0.0)), y=-1.0)
    add_cube(stage, new_material("Clay", RED))
    frame = capture_frame(stage, OPTIONS)
    assert_not_captured(frame, pixels_of(frame, DISTANCE))


def test_object_without_material_can_be_the_layer_behind(stage):
    stage.objects["Wall"].data.materials.clear()
    add_cube(stage, new_material("Clay", RED))
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))


def test_linked_library_material_is_looked_through(stage, tmp_path):
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {material_of(BLOCKERS["group"], "Linked")})
    with bpy.data.libraries.load(library, link=True) as (_, linked):
        linked.materials = ["Linked"]
    add_cube(stage, linked.materials[0])
    before = fingerprint()
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))
    assert changes(before, fingerprint()) == {}


# --- The capture ------------------------------------------------------------------------------------------


def test_faces_of_a_surround_have_their_own(stage):
    add_cube(stage, new_material("Clay", RED))
    options = CaptureOptions(
        samples=1, denoiser="none", surround=16, view_samples=1, back_faces=True, behind=True
    )
    frame = capture_frame(stage, options)
    front = frame.views[0][0]
    cube = front.depth < DISTANCE
    assert cube.any()
    assert np.allclose(front.behind.depth[cube], DISTANCE + WALL, rtol=CAPTURED_GEOMETRY)
    expected = cube_exit(frame.views[0][1]) - front.depth
    assert np.allclose(front.thickness[cube], expected[cube], atol=BACK_FACE)
    assert all(view.behind is not None and view.thickness is not None for view, _ in frame.views)


@pytest.mark.parametrize(("back_faces", "behind"), [(False, False), (True, False), (False, True)])
def test_only_what_was_asked_for_is_captured(stage, back_faces, behind):
    add_cube(stage, new_material("Clay", RED))
    frame = capture_frame(
        stage, CaptureOptions(samples=1, denoiser="none", back_faces=back_faces, behind=behind)
    )
    assert (frame.gbuffer.thickness is not None, frame.gbuffer.behind is not None) == (back_faces, behind)
    assert ("back faces" in frame.seconds, "behind" in frame.seconds) == (back_faces, behind)


def test_frame_is_the_same_with_and_without(stage):
    add_cube(stage, new_material("Clay", RED))
    frames = [
        capture_frame(stage, options) for options in (CaptureOptions(samples=1, denoiser="none"), OPTIONS)
    ]
    for name in ("depth", "normal", "albedo", "specular", "roughness", "direct", "source"):
        assert np.array_equal(*(getattr(frame.gbuffer, name) for frame in frames)), name


def test_keeping_cycles_scene_between_renders_changes_nothing(stage, monkeypatch):
    add_cube(stage, new_material("Clay", RED))
    kept = capture_frame(stage, OPTIONS).gbuffer
    plain_change = Restorer.change

    def change_all_but_that(self, owner, **values):
        values.pop("use_persistent_data", None)
        plain_change(self, owner, **values)

    monkeypatch.setattr(Restorer, "change", change_all_but_that)
    anew = capture_frame(stage, OPTIONS).gbuffer
    assert np.array_equal(kept.thickness, anew.thickness)
    for name in ("depth", "normal", "albedo", "roughness", "direct"):
        assert np.array_equal(getattr(kept.behind, name), getattr(anew.behind, name)), name


def test_progress_goes_on_through_all_renders(stage):
    add_cube(stage, new_material("Clay", RED))
    told = []
    options = CaptureOptions(
        samples=1, denoiser="none", surround=4, view_samples=1, back_faces=True, behind=True
    )
    capture_frame(stage, options, lambda fraction, text: told.append((fraction, text)))
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    texts = [text for _, text in told]
    assert texts.count("Back faces") == texts.count("Layer behind") == 7


def test_frame_without_surfaces_has_nothing_behind(stage):
    bpy.data.objects.remove(stage.objects["Wall"])
    frame = capture_frame(stage, OPTIONS)
    assert frame.gbuffer.behind is None
    assert frame.gbuffer.thickness is None


@needs_opengl
def test_eevee_says_that_it_cannot(stage):
    add_cube(stage, new_material("Clay", RED))
    frame = capture_frame(stage, CaptureOptions(engine="eevee", samples=1, back_faces=True, behind=True))
    assert frame.gbuffer.behind is None
    assert frame.gbuffer.thickness is None
    assert any("Only Cycles" in note for note in frame.notes)


def test_names_of_the_user_are_left_alone(stage):
    """An AOV of our name, and one that is chosen in the list."""
    layer = stage.view_layers[0]
    for name in ("User", "SSGI First Surface"):
        layer.aovs.add().name = name
    layer.active_aov_index = 0
    add_cube(stage, new_material("Clay", RED))
    before = fingerprint()
    assert_cube_is_solid_before_the_wall(capture_frame(stage, OPTIONS))
    assert changes(before, fingerprint()) == {}
