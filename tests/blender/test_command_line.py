# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands from end to end, on real files: what they write, and what they say where they cannot."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
OpenEXR = pytest.importorskip("OpenEXR")

from ssgi_addon.cli import main
from ssgi_addon.exr import read_layers, write_layers
from tests.blender.extension_fixtures import installed_extension  # noqa: F401  (a fixture)
from tests.scenes import build_closed_room, build_emissive_room

ROOT = Path(__file__).resolve().parents[2]
SIZE = (48, 27)
TINY = [
    "--resolution", "48x27", "--samples", "1", "--preset", "draft",
    "--budget", "1000", "--fill", "0", "--surround", "8", "--stations", "0", "--no-back-faces",
]  # fmt: skip
CONTRACT_LAYERS = {"direct", "diffuse", "glossy", "visibility", "known", "combined"}
METRICS = {"relmse", "bias", "ssim", "flip"}


@pytest.fixture(scope="module", name="blend")
def saved_room(tmp_path_factory):
    """A closed room in a file with another scene, which has no camera; its camera moves."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = build_closed_room()
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x += 0.6
    scene.camera.keyframe_insert("location", frame=3)
    scene.frame_set(1)
    path = tmp_path_factory.mktemp("scenes") / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture(scope="module", name="rendered")
def rendered_room(blend, tmp_path_factory):
    """The folder that ``render --compare --passes`` filled."""
    folder = tmp_path_factory.mktemp("rendered") / "results"
    line = ["render", str(blend), "--output", str(folder), *TINY]
    assert main([*line, "--compare", "--reference-samples", "2", "--passes"]) == 0
    return folder


def files_below(folder):
    """Names and contents of all files, hidden ones too."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def read_report(folder):
    """The report as strict JSON."""

    def refuse(constant):
        pytest.fail(f"the report holds {constant}")

    return json.loads((folder / "report.json").read_text(), parse_constant=refuse)


def run_without_blender(*arguments):
    """Run a command in a process that cannot import bpy."""
    script = "import sys; sys.modules['bpy'] = None; from ssgi_addon.cli import main; sys.exit(main())"
    command = [sys.executable, "-W", "error", "-c", script, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def assert_one_clear_line(error_text):
    """Nothing but progress, and one line that says what is wrong."""
    lines = error_text.splitlines()
    errors = [line for line in lines if not line[:4].strip().endswith("%")]
    assert len(errors) == 1, error_text
    assert errors[0].startswith("ssgi: error: ")
    assert len(errors[0]) > len("ssgi: error: ") + 10


# --- render -----------------------------------------------------------------------------------------------


def test_results_are_the_files_of_the_contract(rendered):
    assert sorted(path.name for path in rendered.glob("*.exr")) == ["room_0001.exr"]
    assert (rendered / "room_0001.png").read_bytes().startswith(b"\x89PNG")
    assert not [path for path in rendered.rglob("*") if path.name.endswith(".tmp")]
    layers = read_layers(rendered / "room_0001.exr")
    assert layers.keys() >= CONTRACT_LAYERS
    for name, layer in layers.items():
        assert layer.shape[:2] == SIZE[::-1], name
        assert np.isfinite(layer).all(), name
        assert layer.min() >= 0.0, name


def test_channels_end_as_the_contract_says(rendered):
    with OpenEXR.File(str(rendered / "room_0001.exr"), separate_channels=True) as file:
        channels = list(file.channels())
    for wanted in ("combined.R", "diffuse.G", "glossy.B", "direct.R", "visibility.V", "known.V"):
        assert any(channel.endswith(wanted) for channel in channels), wanted


def test_combined_adds_the_coloured_light_to_the_direct(rendered):
    layers = read_layers(rendered / "room_0001.exr")
    added = layers["albedo"] * layers["diffuse"] + layers["specular"] * layers["glossy"]
    assert np.allclose(layers["combined"], layers["direct"] + added, rtol=1e-6)
    assert added.mean() > 0.1 * layers["direct"].mean()


def test_report_has_the_keys_of_the_contract(rendered):
    report = read_report(rendered)
    assert report.keys() == {"versions", "settings", "frames"}
    assert {"ssgi", "blender", "python", "numpy"} <= report["versions"].keys()
    (frame,) = report["frames"]
    assert frame["frame"] == 1
    seconds = frame["seconds"]
    assert {"capture", "passes", "total", "light", "surround", "reference"} <= seconds.keys()
    assert seconds["capture"] + seconds["passes"] <= seconds["total"]
    assert frame["peak_memory_mb"] is None or frame["peak_memory_mb"] > 10.0
    for skipped in frame["skipped"]:
        assert skipped.keys() == {"what", "why"}


def test_comparison_fills_the_metrics_and_shows_them(rendered):
    metrics = read_report(rendered)["frames"][0]["metrics"]
    assert metrics.keys() == {"combined", "direct_only", "diffuse", "glossy"}
    for row in metrics.values():
        assert row.keys() >= METRICS
        assert all(value is not None for name, value in row.items() if name != "flip")
    assert metrics["combined"]["relmse"] < metrics["direct_only"]["relmse"]
    assert (rendered / "room_0001_compare.png").read_bytes().startswith(b"\x89PNG")
    reference = read_layers(rendered / "reference" / "room_0001.exr")
    assert reference.keys() >= {"combined", "diffuse", "glossy"}


def test_written_pictures_compare_as_the_report_says(rendered, capsys):
    pictures = [rendered / "room_0001.exr", rendered / "reference" / "room_0001.exr"]
    assert main(["compare", *map(str, pictures)]) == 0
    printed = capsys.readouterr().out.splitlines()[1].split()
    told = read_report(rendered)["frames"][0]["metrics"]["combined"]["relmse"]
    assert printed[:2] == ["combined", f"{told:.4g}"]


def files_of(stem):
    """What a run of one frame leaves."""
    manifest = {f"frames/{stem}.{ending}" for ending in ("exr", "json", "png")}
    return {"report.json", f"{stem}.exr", f"{stem}.png"} | manifest


def test_without_comparison_no_metrics_and_no_other_file(blend, tmp_path, capfd):
    assert main(["render", str(blend), "--output", str(tmp_path / "out"), *TINY]) == 0
    assert files_below(tmp_path / "out").keys() == files_of("room_0001")
    assert read_report(tmp_path / "out")["frames"][0]["metrics"] is None
    assert "frame 1: " in capfd.readouterr().out


def test_frame_range_counts_its_steps(blend, tmp_path):
    assert main(["render", str(blend), "--output", str(tmp_path), *TINY, "--frames", "1-3:2"]) == 0
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["room_0001.exr", "room_0003.exr"]
    assert [frame["frame"] for frame in read_report(tmp_path)["frames"]] == [1, 3]
    first, last = (read_layers(tmp_path / f"room_000{frame}.exr")["direct"] for frame in (1, 3))
    assert not np.array_equal(first, last)


def test_results_are_replaced_on_request_alone(blend, tmp_path, capfd):
    line = ["render", str(blend), "--output", str(tmp_path), *TINY]
    assert main(line) == 0
    before = files_below(tmp_path)
    capfd.readouterr()
    assert main([*line, "--resolution", "24x18"]) == 1
    error = capfd.readouterr().err
    assert_one_clear_line(error)
    assert "--overwrite" in error
    assert files_below(tmp_path) == before
    assert main([*line, "--resolution", "24x18", "--overwrite"]) == 0
    assert read_layers(tmp_path / "room_0001.exr")["combined"].shape == (18, 24, 3)


def test_open_scene_is_rendered_inside_blender(empty_file, tmp_path):
    build_emissive_room()
    assert main(["render", "--output", str(tmp_path), *TINY], inside_blender=True) == 0
    assert files_below(tmp_path).keys() == files_of("untitled_0001")


def test_scene_that_blender_could_not_open_is_one_clear_line(empty_file, tmp_path, capfd, monkeypatch):
    """Blender itself goes on with its startup file then."""
    build_emissive_room()
    line = "blender --background missing.blend --command ssgi render other.blend --output out"
    monkeypatch.setattr(sys, "argv", line.split())
    capfd.readouterr()
    assert main(["render", "--output", str(tmp_path / "out"), *TINY], inside_blender=True) == 1
    error = capfd.readouterr().err
    assert_one_clear_line(error)
    assert "could not open missing.blend" in error
    assert not (tmp_path / "out").exists()


def test_command_of_the_extension_renders_the_open_scene(extension, tmp_path):
    script = f"""
import bl_ext.user_default.ssgi as installed
make_scene()
result = installed._run_command(["render", "--output", str(out / "results"), *{TINY}])
"""
    assert extension.run(script, tmp_path) == 0
    assert (tmp_path / "results" / "untitled_0001.exr").is_file()


def test_package_renders_as_a_module(blend, tmp_path):
    command = [sys.executable, "-m", "ssgi_addon", "render", blend, "--output", tmp_path / "out", *TINY]
    done = subprocess.run(
        [*map(str, command), "--preset", "ultra"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert_one_clear_line(done.stderr)
    done = subprocess.run([*map(str, command)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "room_0001.exr").is_file()


# --- apply ------------------------------------------------------------------------------------------------


def test_captured_passes_give_the_same_picture_without_blender(rendered, tmp_path):
    output = tmp_path / "again.exr"
    done = run_without_blender("apply", rendered / "passes" / "room_0001.exr", "--output", output)
    assert done.returncode == 0, done.stderr
    expected, found = read_layers(rendered / "room_0001.exr"), read_layers(output)
    assert found.keys() == expected.keys()
    for name, layer in expected.items():
        assert np.array_equal(found[name], layer), name


def test_applied_passes_are_as_before(rendered, tmp_path):
    before = files_below(rendered)
    assert run_without_blender("apply", rendered / "passes" / "room_0001.exr", "--output", tmp_path / "a.exr")
    assert files_below(rendered) == before


# --- What cannot be done ----------------------------------------------------------------------------------


def remove_camera(scene):
    bpy.data.objects.remove(scene.camera)


def use_panorama(scene):
    scene.camera.data.type = "PANO"


def use_no_pixels(scene):
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.resolution_percentage = 1


def use_too_many_pixels(scene):
    scene.render.resolution_x = 65536


@pytest.mark.parametrize("change", [remove_camera, use_panorama, use_no_pixels, use_too_many_pixels])
def test_scene_that_cannot_be_rendered_is_one_clear_line(empty_file, tmp_path, capfd, change):
    change(build_closed_room())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "bad.blend"))
    output = tmp_path / "out"
    capfd.readouterr()
    assert main(["render", str(tmp_path / "bad.blend"), "--output", str(output), "--passes"]) == 1
    assert_one_clear_line(capfd.readouterr().err)
    assert not output.exists()


def make_missing(path, blend):
    pass


def make_folder(path, blend):
    path.mkdir()


def make_empty(path, blend):
    path.touch()


def make_garbage(path, blend):
    path.write_bytes(bytes(range(256)) * 40)


def make_truncated(path, blend):
    whole = blend.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])


@pytest.mark.parametrize("make", [make_missing, make_folder, make_empty, make_garbage, make_truncated])
def test_file_that_is_no_scene_is_one_clear_line(blend, tmp_path, capfd, make):
    path, output = tmp_path / "bad.blend", tmp_path / "out"
    make(path, blend)
    assert main(["render", str(path), "--output", str(output)]) == 1
    error = capfd.readouterr().err
    assert_one_clear_line(error)
    assert str(path) in error
    assert not output.exists()


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("--resolution 0x0", 2),
        ("--resolution 65536x65536", 1),
        ("--resolution 3x9000", 1),
        ("--preset ultra", 2),
        ("--frames 3-1", 2),
        ("--surround 5000", 2),
        ("--reference-samples 4", 2),
    ],
)
def test_option_that_cannot_be_met_is_one_clear_line(blend, tmp_path, capfd, options, code):
    output = tmp_path / "out"
    assert main(["render", str(blend), "--output", str(output), *options.split()]) == code
    assert_one_clear_line(capfd.readouterr().err)
    assert not output.exists()


@pytest.fixture
def locked_folder(tmp_path):
    """A folder that this user may not write to."""
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o555)
    if os.access(folder, os.W_OK):
        pytest.skip("this user may write everywhere")
    yield folder
    folder.chmod(0o755)


def test_output_below_a_file_is_one_clear_line(blend, rendered, read_only_folder, capfd):
    passes = rendered / "passes" / "room_0001.exr"
    assert main(["render", str(blend), "--output", str(read_only_folder), *TINY]) == 1
    assert_one_clear_line(capfd.readouterr().err)
    assert main(["apply", str(passes), "--output", str(read_only_folder / "a.exr")]) == 1
    assert_one_clear_line(capfd.readouterr().err)
    assert main(["demo", "--output", str(read_only_folder)]) == 1
    assert_one_clear_line(capfd.readouterr().err)


def test_locked_output_is_one_clear_line(blend, locked_folder, capfd):
    assert main(["render", str(blend), "--output", str(locked_folder), *TINY]) == 1
    assert_one_clear_line(capfd.readouterr().err)
    assert files_below(locked_folder) == {}


def cut_short(path):
    path.write_bytes(path.read_bytes()[:-200])


def cut_to_the_header(path):
    path.write_bytes(path.read_bytes()[:100])


def leave_out_passes(path):
    layers = read_layers(path)
    write_layers(path, {name: layers[name] for name in ("albedo", "direct", "normal")})


def keep_the_picture_alone(path):
    path.with_suffix(".json").unlink()
    write_layers(path, {"Combined": read_layers(path)["direct"]})


def lose_the_camera(path):
    path.with_suffix(".json").unlink()


def lose_a_view(path):
    path.with_name(f"{path.stem}_view2.exr").unlink()


@pytest.mark.parametrize(
    "damage",
    [cut_short, cut_to_the_header, leave_out_passes, keep_the_picture_alone, lose_the_camera, lose_a_view],
)
def test_passes_that_do_not_suffice_are_one_clear_line(rendered, tmp_path, capfd, damage):
    folder = tmp_path / "passes"
    folder.mkdir()
    for path in (rendered / "passes").iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    damage(folder / "room_0001.exr")
    before = files_below(tmp_path)
    output = tmp_path / "new" / "out.exr"
    assert main(["apply", str(folder / "room_0001.exr"), "--output", str(output)]) == 1
    assert_one_clear_line(capfd.readouterr().err)
    assert files_below(tmp_path) == before


def test_truncated_picture_is_not_compared(rendered, tmp_path, capfd):
    path = tmp_path / "cut.exr"
    path.write_bytes((rendered / "room_0001.exr").read_bytes())
    cut_short(path)
    heatmap = tmp_path / "error.png"
    line = ["compare", str(path), str(rendered / "reference" / "room_0001.exr"), "--heatmap", str(heatmap)]
    assert main(line) == 1
    assert_one_clear_line(capfd.readouterr().err)
    assert not heatmap.exists()
