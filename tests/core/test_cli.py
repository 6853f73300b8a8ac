# SPDX-License-Identifier: GPL-3.0-or-later
import io
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ssgi_addon
from ssgi_addon import bpy_module, cli, earlier_results, render_command
from ssgi_addon.bpy_module import explain_import_error, require_bpy
from ssgi_addon.cli import main
from ssgi_addon.core import Settings
from ssgi_addon.errors import SSGIError
from ssgi_addon.exr import write_layers
from ssgi_addon.job_options import JobOptions
from ssgi_addon.progress import Progress

pytest.importorskip("OpenEXR")

ROOT = Path(__file__).resolve().parents[2]
JOB = "ssgi_addon.blender.job"


@pytest.fixture
def calls(monkeypatch):
    """Stand in for the job, and keep what it was called with."""
    made = []

    def run_job(scene, options, progress):
        made.append((scene, options))
        progress(0.5, "half")
        row = {"relmse": 0.123456, "bias": -0.5, "ssim": 1.0, "flip": None}
        return {
            "frames": [
                {"frame": 3, "seconds": {"total": 2.5}, "metrics": {"combined": row, "direct_only": row}}
            ]
        }

    def apply_passes(passes, output, camera, settings, progress):
        made.append((passes, output, camera, settings))

    def run_demo(output, progress):
        return output / "demo.png"

    job = types.ModuleType(JOB)
    job.run_job, job.run_demo = run_job, run_demo
    monkeypatch.setitem(sys.modules, JOB, job)
    monkeypatch.setattr(cli, "apply_passes", apply_passes)
    for module in (cli, render_command):
        monkeypatch.setattr(module, "require_bpy", lambda: None)
    return made


def test_render_has_the_defaults_of_the_contract(calls, capsys):
    assert main(["render", "scene.blend", "--output", "out"]) == 0
    ((scene, options),) = calls
    assert (scene, options) == (Path("scene.blend"), JobOptions(output=Path("out"), resume=True))
    assert (options.engine, options.settings) == ("cycles", Settings.preset("balanced"))
    assert not any((options.overwrite, options.compare, options.save_passes))
    out, err = capsys.readouterr()
    assert "frame 3: 2.5 s" in out
    assert "0.1235" in out
    assert err == " 50% half\n"


def test_render_hands_every_option_on(calls):
    line = (
        "render a.blend --output out --engine eevee --preset final --resolution 96x54 --samples 5 --rays 7 "
        "--surround 32 --fill 6 --frames 1-9:4 --compare --reference-samples 12 --passes --overwrite"
    )
    assert main(line.split()) == 0
    final = Settings.preset("final")
    assert calls[0][1] == JobOptions.preset(
        "final",
        Path("out"),
        settings=replace(
            final,
            diffuse=replace(final.diffuse, rays=7),
            reflections=replace(final.reflections, rays=7),
            fill_mode="level",
        ),
        engine="eevee",
        samples=5,
        surround=32,
        fill=6,
        budget=6.0,  # the preset's
        resolution=(96, 54),
        frames=(1, 5, 9),
        compare=True,
        reference_samples=12,
        save_passes=True,
        overwrite=True,
        resume=True,
    )


@pytest.mark.parametrize(
    ("line", "mode"),
    [
        ("", "replace"),
        ("--rays 4", "level"),
        ("--rays 4 --fill-mode replace", "replace"),
        ("--fill-mode level", "level"),
    ],
)
def test_who_asks_for_rays_gets_their_light(calls, line, mode):
    """The fill in their place would leave no trace of them."""
    assert main(f"render a.blend --output out {line}".split()) == 0
    assert calls[0][1].settings.fill_mode == mode


def test_frames_that_are_there_are_skipped_and_named(calls, monkeypatch, capsys):
    skipped = {"frame": 2, "seconds": {}, "metrics": None, "skipped": [earlier_results.SKIPPED]}
    job = sys.modules[JOB]
    monkeypatch.setattr(
        job, "run_job", lambda *given: calls.append(given) or {"frames": [skipped]}, raising=True
    )
    assert main(["render", "a.blend", "--output", "out"]) == 0
    assert calls[0][1].resume
    assert "frame 2: there already" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("--frame 7", (7,)),
        ("--frames 3-3", (3,)),
        ("--frames=-2-1", (-2, -1, 0, 1)),
        ("--frames=-3--1:2", (-3, -1)),
    ],
)
def test_frames_are_read(calls, text, frames):
    assert main(["render", "a.blend", "--output", "out", *text.split()]) == 0
    assert calls[0][1].frames == frames


def test_scene_may_be_left_out_inside_blender_only(calls, capsys):
    assert main(["render", "--output", "out"], inside_blender=True) == 0
    assert calls[0][0] is None
    capsys.readouterr()
    assert main(["render", "--output", "out"]) == 2
    assert len(calls) == 1


@pytest.mark.parametrize(
    "line",
    [
        "",
        "paint",
        "render a.blend",
        "render a.blend --output out --shot shot --keep-world",
        "render a.blend --output out --progress loud",
        "prepare a.blend --output out --keys 0",
        "prepare a.blend",
        "render a.blend --output out --resolution 0x9",
        "render a.blend --output out --resolution 9",
        "render a.blend --output out --resolution -9x9",
        "render a.blend --output out --resolution 99999999999x9",
        "render a.blend --output out --samples 0",
        "render a.blend --output out --samples many",
        "render a.blend --output out --surround=-1",
        "render a.blend --output out --surround 99999",
        "render a.blend --output out --fill=-1",
        "render a.blend --output out --rays 0",
        "render a.blend --output out --rays 100000",
        "render a.blend --output out --preset ultra",
        "render a.blend --output out --engine workbench",
        "render a.blend --output out --frame one",
        "render a.blend --output out --frames 5-1",
        "render a.blend --output out --frames 1-5:0",
        "render a.blend --output out --frames 1-99999999999",
        "render a.blend --output out --frame 1 --frames 1-2",
        "render a.blend --output out --reference-samples 9",
        "apply a.exr",
        "compare a.exr",
        "demo more",
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(calls, capsys, line):
    assert main(line.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("ssgi: error: ")
    assert err.count("\n") == 1
    assert calls == []


def test_failed_work_is_one_line_and_exit_code_1(calls, capsys, monkeypatch):
    def fail(*arguments):
        raise SSGIError("cannot open a.blend:\n  no such file")

    monkeypatch.setattr(sys.modules[JOB], "run_job", fail)
    assert main(["render", "a.blend", "--output", "out"]) == 1
    assert capsys.readouterr() == ("", "ssgi: error: cannot open a.blend: no such file\n")


def test_unexpected_errors_keep_their_traceback(calls, monkeypatch):
    def fail(*arguments):
        raise ZeroDivisionError

    monkeypatch.setattr(sys.modules[JOB], "run_job", fail)
    with pytest.raises(ZeroDivisionError):
        main(["render", "a.blend", "--output", "out"])


def test_apply_uses_the_balanced_preset_where_none_is_known(calls, tmp_path):
    assert main(["apply", str(tmp_path / "a.exr"), "--output", "b.exr"]) == 0
    assert calls == [(tmp_path / "a.exr", Path("b.exr"), None, Settings.preset("balanced"))]


def test_apply_remembers_the_settings_of_the_passes(calls, monkeypatch):
    monkeypatch.setattr(cli, "remembered_settings", lambda path: Settings.preset("draft"))
    main(["apply", "a.exr", "--output", "b.exr"])
    main(["apply", "a.exr", "--output", "b.exr", "--preset", "final", "--camera", "c.json"])
    main(["apply", "a.exr", "--output", "b.exr", "--rays", "3"])
    assert [call[3] for call in calls[:2]] == [Settings.preset("draft"), Settings.preset("final")]
    assert calls[1][2] == Path("c.json")
    assert calls[2][3].diffuse.rays == calls[2][3].reflections.rays == 3
    assert calls[2][3].diffuse.bounces == Settings.preset("draft").diffuse.bounces


def test_demo_says_where_the_picture_is(calls, capsys):
    assert main(["demo"]) == 0
    assert capsys.readouterr().out == f"picture: {Path('demo/demo.png')}\n"


@pytest.mark.parametrize(
    "command", ["--help", "render --help", "apply --help", "compare --help", "demo --help", "--version"]
)
def test_help_ends_well(command, capsys):
    assert main(command.split()) == 0
    assert capsys.readouterr().out


def test_help_tells_the_default_and_the_cost_of_the_surround(capsys):
    main(["render", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert "together a few seconds at 128 (default: the preset's)" in text
    assert "0 captures none" in text


def test_surround_may_be_left_out(calls):
    assert main(["render", "a.blend", "--output", "out", "--surround", "0"]) == 0
    assert calls[0][1].surround == 0


@pytest.fixture
def pictures(tmp_path, rng):
    reference = rng.gamma(1.0, 0.3, (30, 40, 3)).astype(np.float32)
    image = (reference * 0.8).astype(np.float32)
    known = np.ones((30, 40), np.float32)
    known[:, :20] = 0.2
    write_layers(tmp_path / "image.exr", {"combined": image, "known": known, "direct": image})
    write_layers(tmp_path / "reference.exr", {"Combined": reference})
    return str(tmp_path / "image.exr"), str(tmp_path / "reference.exr")


def test_compare_prints_the_metrics_and_writes_the_heatmap(tmp_path, pictures, capsys):
    heatmap = tmp_path / "error.png"
    assert main(["compare", *pictures, "--heatmap", str(heatmap)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["relmse", "bias", "ssim", "flip"]
    assert lines[1].split()[0] == "combined"
    assert 0.02 < float(lines[1].split()[1]) < 0.04
    assert lines[2].startswith("known >= 0.9")
    assert heatmap.read_bytes().startswith(b"\x89PNG")


def test_compare_refuses_other_sizes(tmp_path, pictures, capsys):
    write_layers(tmp_path / "small.exr", {"combined": np.ones((3, 4, 3), np.float32)})
    assert main(["compare", pictures[0], str(tmp_path / "small.exr")]) == 1
    assert "40 x 30 and 4 x 3 pixels" in capsys.readouterr().err


def test_compare_refuses_a_file_without_a_picture(tmp_path, pictures, capsys):
    write_layers(tmp_path / "depth.exr", {"depth": np.ones((30, 40), np.float32)})
    assert main(["compare", str(tmp_path / "depth.exr"), pictures[1]]) == 1
    assert "holds depth" in capsys.readouterr().err


def test_compare_refuses_pixels_that_are_not_finite(tmp_path, pictures, capsys):
    broken = np.full((30, 40, 3), np.nan, np.float32)
    write_layers(tmp_path / "nan.exr", {"combined": broken})
    heatmap = tmp_path / "error.png"
    assert main(["compare", str(tmp_path / "nan.exr"), pictures[1], "--heatmap", str(heatmap)]) == 1
    assert "expected finite values" in capsys.readouterr().err
    assert not heatmap.exists()


def test_missing_files_are_one_line(capsys):
    assert main(["compare", "missing.exr", "missing.exr"]) == 1
    err = capsys.readouterr().err
    assert err.startswith("ssgi: error: cannot read missing.exr")
    assert err.count("\n") == 1


def test_module_runs_without_blender(pictures):
    """In a process that cannot import bpy, `compare` works and `render` says what to install."""
    script = (
        "import sys; sys.modules['bpy'] = None; from ssgi_addon.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-W", "error", "-c", script]
    done = subprocess.run(
        [*command, "compare", *pictures], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    done = subprocess.run(
        [*command, "render", "a.blend", "--output", "out"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "pip install 'ssgi[blender]'" in done.stderr


def test_package_runs_as_a_module():
    command = [sys.executable, "-W", "error", "-m", "ssgi_addon", "--version"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == f"ssgi {ssgi_addon.__version__}\n"


def test_missing_system_library_is_named_with_its_package(monkeypatch):
    def fail(name):
        raise ImportError("libSM.so.6: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(bpy_module.importlib, "import_module", fail)
    with pytest.raises(SSGIError, match=r"libSM\.so\.6: apt-get install libsm6"):
        require_bpy()


def test_other_import_errors_are_told():
    assert "libodd.so.3" in explain_import_error("libodd.so.3: cannot open shared object file: No such file")
    assert explain_import_error("no luck") == "Blender's Python module does not load: no luck"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_log_gets_plain_lines_and_not_too_many():
    log = io.StringIO()
    progress = Progress(stream=log)
    for step in range(1001):
        progress(step / 1000, "tracing")
    progress.close()
    lines = log.getvalue().splitlines()
    assert lines[0] == "  0% tracing"
    assert lines[-1] == "100% tracing"
    assert len(lines) == 11
    assert "\r" not in log.getvalue()


def test_terminal_gets_a_bar_on_one_line():
    terminal = Terminal()
    progress = Progress(stream=terminal)
    progress(0.0, "capture")
    progress(0.5, "tracing " + 300 * "x")
    progress(2.0, "done")
    progress.close()
    progress.close()
    text = terminal.getvalue()
    assert text.count("\n") == 1
    assert "[" + 28 * "#" + "] 100% done" in text
    assert max(len(line) for line in text.split("\r")) < 90


def test_queue_gets_its_own_lines_with_the_reason_of_a_failure():
    log = io.StringIO()
    progress = Progress("openjd", log)
    progress(0.0, "Direct light")
    progress(0.5, "Direct light\nopenjd_fail: no")
    progress.close()
    progress.fail("cannot write out/a.exr:\n  no room")
    assert log.getvalue().splitlines() == [
        "openjd_progress: 0.0",
        "openjd_status: Direct light",
        "openjd_progress: 50.0",
        "openjd_status: Direct light openjd_fail: no",
        "openjd_fail: cannot write out/a.exr: no room",
    ]
    people = io.StringIO()
    Progress("lines", people).fail("no room")
    assert people.getvalue() == ""


@pytest.mark.parametrize("style", ["auto", "bar", "lines"])
def test_style_of_progress_may_be_chosen(style):
    log = io.StringIO()
    Progress(style, log)(0.25, "tracing")
    assert ("[" in log.getvalue()) == (style == "bar")


def test_shot_and_its_preparation_are_handed_on(calls, monkeypatch, capsys):
    line = "--output shot --frames 1-4,9 --preset draft --samples 3 --keys 3 --overwrite"
    made = []
    shot = types.SimpleNamespace(
        worlds={1: b"", 4: b""}, tuned=types.SimpleNamespace(fill_share=0.25, covered=0.9)
    )
    module = types.ModuleType("ssgi_addon.blender.prepare")
    module.prepare_shot = lambda *given: made.append(given) or shot
    monkeypatch.setitem(sys.modules, module.__name__, module)
    assert main(["prepare", "a.blend", *line.split()]) == 0
    scene, options, keys, _ = made[0]
    expected = JobOptions.preset(
        "draft", Path("shot"), samples=3, frames=(1, 2, 3, 4, 9), overwrite=True, resume=True
    )
    assert (scene, options, keys) == (Path("a.blend"), expected, 3)
    assert "key frames: 1,4" in capsys.readouterr().out
    assert main(["render", "a.blend", "--output", "out", "--shot", "shot"]) == 0
    assert calls[0][1].shot == Path("shot")
