# SPDX-License-Identifier: GPL-3.0-or-later
"""Beyond the frame: each switch adds what it says, and what is left out says why."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("OpenEXR")

from ssgi_addon.blender import beyond, capture, engines, fill, job, one_frame
from ssgi_addon.blender.build import add_ball, add_camera, new_material, new_world
from ssgi_addon.blender.capture import CaptureOptions, capture_frame
from ssgi_addon.blender.capture_costs import QUICK_PASS, fill_work, render_work
from ssgi_addon.cli import main
from ssgi_addon.errors import SSGIError
from ssgi_addon.job_options import BEYOND_FRAME, RENDERED, JobOptions
from tests.blender.fingerprint import changes, fingerprint
from tests.blender.opengl import needs_opengl
from tests.scenes import BLACK, WHITE, build_closed_room, new_scene

WIDTH, HEIGHT, SIDE = 16, 9, 12
ALONE = CaptureOptions(samples=1, denoiser="none", view_size=SIDE, view_samples=1)
SWITCHES = {
    "surround": {"surround": SIDE},
    "overscan": {"overscan": 1.5},
    "stations": {"stations": 2},
    "lights": {"light_views": 1},
    "fill": {"fill": 1},
    "back faces": {"back_faces": True},
    "behind": {"behind": True},
}
VIEWS = {"surround": 6, "overscan": 1, "stations": 2, "lights": 1}
ALL = replace(ALONE, **{name: value for switch in SWITCHES.values() for name, value in switch.items()})
# Work of the frame's light, and of a small view.
LIGHT = render_work(WIDTH * HEIGHT, 1)
VIEW = render_work(SIDE**2, 1)


@pytest.fixture
def room(empty_file):
    scene = build_closed_room()
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    return scene


@pytest.fixture
def ball(empty_file):
    """One ball below an open sky, seen with much sky around it."""
    scene = new_scene("Ball")
    scene.world = new_world("Sky", (0.8, 0.9, 1.0), 1.0)
    add_ball(scene, "Ball", new_material("Clay", WHITE, specular=0.0), (0.0, 0.0, 0.0), 1.0)
    add_camera(scene, (0.0, -6.0, 0.0), (0.0, 0.0, 0.0), lens=40.0)
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    return scene


@pytest.fixture(params=[0.01, 100.0], ids=["fast", "slow"])
def machine(request, monkeypatch):
    """A machine on which light and geometry take next to no time, or so long that nothing else would."""

    def time_light(*arguments, real=capture._capture_light):
        rendered, is_denoised = real(*arguments)
        return replace(rendered, seconds=request.param), is_denoised

    monkeypatch.setattr(capture, "_capture_light", time_light)


def polish(scene):
    """Make all surfaces mirror, beside their diffuse light."""
    for thing in scene.objects:
        for slot in thing.material_slots:
            shader = slot.material.node_tree.nodes["Principled BSDF"]
            shader.inputs["Roughness"].default_value, shader.inputs["Metallic"].default_value = 0.0, 0.5


def what_is_skipped(frame):
    return [what for what, _ in frame.skipped]


# --- Each switch ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SWITCHES)
def test_each_switch_adds_what_it_says_and_nothing_else(room, name):
    frame = capture_frame(room, replace(ALONE, **SWITCHES[name]))
    assert frame.view_names == (name,) * VIEWS.get(name, 0)
    assert len(frame.views) == len(frame.view_names)
    assert (frame.fill is not None) == (name == "fill")
    assert (frame.gbuffer.thickness is not None) == (name == "back faces")
    assert (frame.gbuffer.behind is not None) == (name == "behind")
    assert frame.seconds[name] > 0.0
    assert frame.seconds.keys() - {"geometry", "light", "planning"} == {name}
    assert frame.skipped == ()


def test_all_switches_together_look_behind_the_surfaces_of_all_views(room):
    frame = capture_frame(room, ALL)
    assert Counter(frame.view_names) == VIEWS
    assert frame.fill is not None
    assert frame.seconds.keys() == {"geometry", "light", "planning", *SWITCHES}
    for gbuffer, camera in ((frame.gbuffer, frame.camera), *frame.views):
        assert gbuffer.shape == (camera.height, camera.width)
        assert gbuffer.thickness is not None
        assert gbuffer.behind is not None


def test_the_frame_itself_is_as_without_what_lies_beyond(room):
    alone, among = (capture_frame(room, options) for options in (ALONE, ALL))
    for name in ("depth", "normal", "albedo", "direct", "source"):
        assert np.array_equal(getattr(alone.gbuffer, name), getattr(among.gbuffer, name)), name
    assert alone.seconds.keys() == {"geometry", "light"}


# --- What is not needed -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("left", "hidden", "skipped"),
    [
        (0.5, 0.5, []),
        (0.01, 0.5, ["surround, overscan"]),
        (0.01, 0.005, ["surround, overscan", "stations, lights, back faces, behind"]),
    ],
)
def test_views_are_for_the_rays_that_are_lost(room, monkeypatch, left, hidden, skipped):
    """Surround and overscan are for rays that leave the frame; the rest is also for those behind things."""

    def find(*arguments, real=beyond.find_lost_rays):
        return replace(real(*arguments), left=left, hidden=hidden)

    monkeypatch.setattr(beyond, "find_lost_rays", find)
    frame = capture_frame(room, ALL)
    assert what_is_skipped(frame) == skipped
    assert ("surround" in frame.view_names) == ("surround, overscan" not in skipped)
    assert ("stations" in frame.view_names) == (len(skipped) < 2)
    assert all(
        why == f"only {share:.1%} of the rays need them"
        for share, (_, why) in zip((left, left + hidden), frame.skipped)
    )


def test_what_reflects_nothing_needs_no_view(ball):
    bpy.data.materials.remove(bpy.data.materials["Clay"])
    bpy.data.objects["Ball"].data.materials.clear()
    bpy.data.objects["Ball"].data.materials.append(new_material("Coal", BLACK, specular=0.0))
    frame = capture_frame(ball, replace(ALONE, surround=SIDE, stations=1))
    assert frame.views == ()
    assert frame.skipped == (
        ("surround", "only 0.0% of the rays need them"),
        ("stations", "only 0.0% of the rays need them"),
    )


def test_frame_of_sky_takes_nothing_more(ball):
    bpy.data.objects.remove(bpy.data.objects["Ball"])
    frame = capture_frame(ball, ALL)
    assert frame.seconds.keys() == {"geometry", "light"}
    assert (frame.views, frame.fill) == ((), None)


# --- What takes too much work -------------------------------------------------------------------------------


def test_back_faces_are_taken_with_stations_only_where_those_were_wanted(room, monkeypatch):
    monkeypatch.setattr(beyond.LostRays, "stations", lambda self, count: [])
    options = replace(ALONE, surround=SIDE, back_faces=True)
    assert capture_frame(room, options).gbuffer.thickness is not None
    frame = capture_frame(room, replace(options, stations=2))
    assert frame.gbuffer.thickness is None
    assert ("back faces", "without stations they bring nothing") in frame.skipped


def test_no_budget_leaves_all_out_without_a_look(room):
    frame = capture_frame(room, replace(ALL, budget=0.0))
    assert (frame.views, frame.fill, frame.gbuffer.thickness, frame.gbuffer.behind) == ((), None, None, None)
    assert what_is_skipped(frame) == [
        "fill",
        "surround, overscan",
        "stations, lights, back faces, behind",
    ]
    assert all(why.endswith(", and 0.00 are left") for _, why in frame.skipped)
    assert frame.seconds.keys() == {"geometry", "light"}


def test_middling_budget_takes_fewer_stations(room, machine):
    work = (QUICK_PASS + 2.5 * VIEW) / LIGHT
    frame = capture_frame(room, replace(ALONE, stations=4, budget=work))
    assert frame.view_names == ("stations",) * 2
    wanted = (QUICK_PASS + 4 * VIEW) / LIGHT
    why = f"about {wanted:.2f} times the work of the direct light, and {work:.2f} are left"
    assert frame.skipped == (("2 of 4 stations", why),)


def test_budget_for_five_faces_takes_no_surround(room, machine):
    """What lies between the faces would be answered by none."""
    options = replace(ALONE, surround=SIDE)
    enough = (QUICK_PASS + 6 * VIEW) / LIGHT
    frame = capture_frame(room, replace(options, budget=enough - VIEW / LIGHT))
    assert frame.views == ()
    assert what_is_skipped(frame) == ["surround"]
    assert len(capture_frame(room, replace(options, budget=enough)).views) == 6


def test_small_budget_goes_to_the_fill(room, machine):
    frame = capture_frame(room, replace(ALL, budget=fill_work(WIDTH * HEIGHT, ALL.fill) / LIGHT))
    assert frame.fill is not None
    assert frame.views == ()
    assert what_is_skipped(frame) == ["surround, overscan", "stations, lights, back faces, behind"]


@pytest.mark.parametrize("preset", RENDERED)
@pytest.mark.parametrize("size", [(4, 4), (480, 270), (7680, 4320)])
def test_budgets_of_presets_hold_their_fill(preset, size):
    pixels, values = math.prod(size), RENDERED[preset]
    light = render_work(pixels, values["samples"])
    assert fill_work(pixels, values["fill"]) <= values["budget"] * light


def test_views_that_were_taken_leave_less_for_the_rest(room, machine):
    budget = (2 * QUICK_PASS + 8.5 * VIEW) / LIGHT
    frame = capture_frame(room, replace(ALONE, surround=SIDE, stations=4, budget=budget))
    assert Counter(frame.view_names) == {"surround": 6, "stations": 2}
    (what,) = what_is_skipped(frame)
    assert what.endswith(" stations")


def test_budget_holds_back_faces_and_the_layer_behind_by_their_work(room):
    """Each takes a start and a sample; the layer behind then takes the light of the frame again."""
    options = replace(ALONE, back_faces=True, behind=True)
    once = (QUICK_PASS + render_work(WIDTH * HEIGHT, 1)) / LIGHT
    taken = {}
    for budget in (once - 0.01, once, once + 0.99, once + 1.0):
        gbuffer = capture_frame(room, replace(options, budget=budget)).gbuffer
        taken[budget] = (gbuffer.thickness is not None, gbuffer.behind is not None)
    assert list(taken.values()) == [(False, False), (True, False), (True, False), (True, True)]


# --- Report and command line ------------------------------------------------------------------------------


def test_report_lists_what_is_left_out(room, tmp_path):
    views = {"surround": SIDE, "stations": 8, "back_faces": True, "mirrors_only": False}
    options = JobOptions.preset("final", tmp_path, samples=1, resolution=(WIDTH, HEIGHT), budget=0.0, **views)
    job.render_frames(room, options)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["settings"]["budget"] == 0.0
    skipped = {entry["what"]: entry["why"] for entry in report["frames"][0]["skipped"]}
    for what in ("fill", "surround", "stations, back faces"):
        assert skipped[what].endswith(", and 0.00 are left")


@pytest.fixture
def asked_for(room, tmp_path, monkeypatch):
    """Run `render` with flags up to the capture; return its options."""

    def run(*flags):
        found = []

        def capture_nothing(scene, options, *_):
            found.append(options)
            raise SSGIError("that was all")

        monkeypatch.setattr(one_frame, "capture_frame", capture_nothing)
        assert main(["render", "--output", str(tmp_path / "out"), *flags], inside_blender=True) == 1
        return found[0]

    return run


def test_flags_reach_the_capture(asked_for):
    line = "--budget 7.5 --fill 3 --surround 20 --overscan 1.25 --stations 5 --light-views 2 --no-back-faces"
    options = asked_for(*line.split(), "--behind")
    found = {name: getattr(options, name) for name in BEYOND_FRAME}
    assert found == {
        "budget": 7.5, "fill": 3, "surround": 20, "overscan": 1.25, "stations": 5, "light_views": 2,
        "back_faces": False, "behind": True, "mirrors_only": True,
    }  # fmt: skip
    assert options.view_samples == one_frame.VIEW_SAMPLES


def test_without_flags_the_capture_takes_the_defaults(asked_for, tmp_path):
    options, default = asked_for(), JobOptions(output=tmp_path)
    for name in BEYOND_FRAME:
        assert getattr(options, name) == getattr(default, name), name


@pytest.mark.parametrize("preset", RENDERED)
def test_preset_sets_what_is_captured(asked_for, preset):
    options = asked_for("--preset", preset)
    expected = {name: value for name, value in RENDERED[preset].items() if name in BEYOND_FRAME}
    assert {name: getattr(options, name) for name in expected} == expected
    assert (options.samples, options.own_geometry) == tuple(
        RENDERED[preset][name] for name in ("samples", "own_geometry")
    )


def test_with_a_fill_views_are_for_mirrors_alone(room):
    """Nothing in the room mirrors; a polished ball does, and without a fill everything wants views."""
    options = replace(ALONE, surround=SIDE, fill=1, mirrors_only=True)
    rough = capture_frame(room, options)
    assert (rough.views, what_is_skipped(rough)) == ((), ["surround"])
    assert len(capture_frame(room, replace(options, mirrors_only=False)).views) == 6
    assert len(capture_frame(room, replace(options, fill=0)).views) == 6
    polish(room)
    assert len(capture_frame(room, options).views) == 6


def test_through_eevee_presets_capture_a_surround(asked_for):
    """It renders no fill, which knows in their place what the frame does not show."""
    assert asked_for("--engine", "eevee").surround == 128
    assert asked_for("--engine", "eevee", "--surround", "0").surround == 0


@pytest.mark.parametrize("line", ["--budget -1", "--fill -1", "--overscan 0.5", "--stations 1.5"])
def test_flag_out_of_range_is_bad_usage(tmp_path, line):
    assert main(["render", "--output", str(tmp_path / "out"), *line.split()], inside_blender=True) == 2


# --- EEVEE ------------------------------------------------------------------------------------------------


@needs_opengl
def test_eevee_takes_views_and_says_what_it_cannot(room):
    frame = capture_frame(room, replace(ALL, engine="eevee"))
    assert Counter(frame.view_names) == VIEWS
    assert (frame.fill, frame.gbuffer.thickness, frame.gbuffer.behind) == (None, None, None)
    assert frame.seconds.keys() == {"geometry", "light", "planning", *VIEWS}
    assert any("Only Cycles can render a fill" in note for note in frame.notes)
    assert any("Only Cycles can look behind surfaces" in note for note in frame.notes)


# --- The file is as before --------------------------------------------------------------------------------


def test_scene_is_as_before_when_a_render_of_any_stage_fails(room, monkeypatch):
    """In the middle of each stage: not at its first render, where it has more of them."""
    steps = Counter()
    capture_frame(room, ALL, lambda fraction, text: steps.update([text]))
    wanted = {"Fill", "Surround", "Overscan", "Stations", "Lights", "Back faces", "Layer behind"}
    assert wanted <= steps.keys()
    before = fingerprint()
    for step in sorted(wanted):
        seen = Counter()

        def fail_in_the_middle(*arguments, real=engines.render_passes, seen=seen, step=step):
            if seen[step] == (steps[step] + 2) // 2:
                raise ZeroDivisionError(step)
            return real(*arguments)

        with monkeypatch.context() as patch:
            patch.setattr(engines, "render_passes", fail_in_the_middle)
            patch.setattr(fill, "render_passes", fail_in_the_middle)
            with pytest.raises(ZeroDivisionError, match=step):
                capture_frame(room, ALL, lambda fraction, text, seen=seen: seen.update([text]))
        assert changes(before, fingerprint()) == {}, step
