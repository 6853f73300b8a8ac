# SPDX-License-Identifier: GPL-3.0-or-later
"""What is shipped: one version, complete packages, and archives with what belongs in them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tomllib
import zipfile
from pathlib import Path

import pytest

import ssgi_addon
from release import contents, extension, wheels

ROOT = Path(__file__).resolve().parents[2]
SOURCE_MANIFEST = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
# semver.org, without build metadata, which the names of Python packages cannot hold
SEMANTIC_VERSION = r"\d+\.\d+\.\d+(-rc\.\d+)?"


def test_one_version_everywhere():
    version = ssgi_addon.__version__
    assert re.fullmatch(SEMANTIC_VERSION, version)
    assert tomllib.loads(SOURCE_MANIFEST)["version"] == version
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "version" in project["dynamic"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## \[([^\]]+)\]", changes, re.MULTILINE)
    assert headings[:2] == ["Unreleased", version]


def test_python_package_has_every_folder_of_the_package():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    folders = {path.parent.relative_to(ROOT) for path in ROOT.glob("ssgi_addon/**/*.py")}
    assert {".".join(folder.parts) for folder in folders} == set(listed["packages"])
    assert listed["package-data"] == {"ssgi_addon": ["py.typed"]}
    assert (ROOT / "ssgi_addon" / "py.typed").is_file()


def test_every_wheel_is_pinned_by_its_hash():
    text = wheels.REQUIREMENTS.read_text(encoding="utf-8")
    names = wheels.wheel_names()
    assert len(set(names)) == len(wheels.PLATFORMS) * len(wheels.PYTHONS)
    assert len(set(re.findall(r"--hash=sha256:[0-9a-f]{64}", text))) == len(names)


def test_wheel_with_other_content_is_refused(tmp_path):
    for name in wheels.wheel_names():
        (tmp_path / name).write_bytes(b"something else")
    with pytest.raises(wheels.WheelError, match="not the wheel"):
        wheels.fetch_wheels(tmp_path)


def test_staged_manifest_adds_the_wheels_and_nothing_else(tmp_path):
    wheel = tmp_path / "openexr-1-cp311-cp311-win_amd64.whl"
    wheel.write_bytes(b"")
    extension.stage(tmp_path / "ssgi", [wheel], ["windows-x64"])
    staged = tomllib.loads((tmp_path / "ssgi" / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert staged.pop("wheels") == [f"./wheels/{wheel.name}"]
    assert staged.pop("platforms") == ["windows-x64"]
    assert staged == tomllib.loads(SOURCE_MANIFEST)


def test_without_wheels_the_manifest_stays_as_it_is():
    assert tomllib.loads(extension.with_lists(SOURCE_MANIFEST, wheels=[])) == tomllib.loads(SOURCE_MANIFEST)


def test_lists_of_the_source_are_not_overruled():
    with pytest.raises(extension.BuildError, match="wheels"):
        extension.with_lists('wheels = ["./a.whl"]\n[build]\n', wheels=["./b.whl"])


@pytest.fixture(name="archive")
def archive_of_all_systems(tmp_path):
    """An archive whose wheels are empty, and what has to be in it besides."""
    names = wheels.wheel_names()
    manifest = extension.with_lists(SOURCE_MANIFEST, wheels=[f"./wheels/{name}" for name in names])
    path = tmp_path / "ssgi.zip"
    with zipfile.ZipFile(path, "w") as opened:
        opened.writestr("blender_manifest.toml", manifest)
        opened.writestr("ssgi_addon/core/light.py", "")
        for name in names:
            opened.writestr(f"wheels/{name}", "")
    return path


FILES = {"blender_manifest.toml", "ssgi_addon/core/light.py"}


def test_complete_archive_has_no_problems(archive):
    assert contents.problems(archive, FILES, has_wheels=True) == []


@pytest.mark.parametrize("name", ["ssgi_addon/core/__pycache__/light.pyc", "tests/test_a.py", "wheels/a.whl"])
def test_what_does_not_belong_is_found(archive, name):
    with zipfile.ZipFile(archive, "a") as opened:
        opened.writestr(name, "")
    assert contents.problems(archive, FILES, has_wheels=True) == [f"{name} does not belong in it"]


def test_what_is_missing_is_found(archive):
    (problem,) = contents.problems(archive, FILES | {"ssgi_addon/exr.py"}, has_wheels=True)
    assert problem == "ssgi_addon/exr.py is missing"


def test_missing_wheel_is_found(archive, monkeypatch):
    lacking = wheels.wheel_names()[-1]
    with zipfile.ZipFile(archive) as opened:
        rest = {name: opened.read(name) for name in opened.namelist() if not name.endswith(lacking)}
    with zipfile.ZipFile(archive, "w") as opened:
        for name, data in rest.items():
            opened.writestr(name, data)
    assert contents.problems(archive, FILES, has_wheels=True) == [f"wheels/{lacking} is missing"]


def test_archive_of_one_system_carries_its_own_wheels(archive):
    generated = '[build.generated]\nplatforms = ["windows-x64"]\nwheels = ["./wheels/w.whl"]\n'
    names = [name for name in wheels.wheel_names() if name.endswith("win_amd64.whl")]
    assert len(names) == len(wheels.PYTHONS)
    generated = generated.replace('"./wheels/w.whl"', ", ".join(f'"./wheels/{name}"' for name in names))
    with zipfile.ZipFile(archive, "w") as opened:
        opened.writestr("blender_manifest.toml", SOURCE_MANIFEST + generated)
        opened.writestr("ssgi_addon/core/light.py", "")
        for name in names:
            opened.writestr(f"wheels/{name}", "")
    assert contents.problems(archive, FILES, has_wheels=True) == []


def test_size_without_reason_is_found(archive, monkeypatch):
    monkeypatch.setattr(contents, "LARGEST_MB", 1e-3)
    assert contents.problems(archive, FILES, has_wheels=True) == ["it is larger than 0 MB"]


@pytest.fixture(name="check_program")
def check_with_a_program(tmp_path):
    """Run CI's check of the extension in the Blender program with a shell script in the program's place."""
    if os.name != "posix" or shutil.which("bash") is None:
        pytest.skip("CI's checks are shell scripts")

    def check(script):
        program = tmp_path / "blender"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        archive = tmp_path / "ssgi.zip"
        archive.touch()
        return subprocess.run(
            [ROOT / ".ci" / "real-blender", archive],
            env={**os.environ, "SSGI_BLENDER": str(program)},
            capture_output=True,
            text=True,
            check=False,
        )

    return check


@pytest.mark.parametrize("script", ["exit 1", "echo Blender 4.4.3", "echo something else"])
def test_lack_of_a_program_is_said_and_is_no_failure(check_program, script):
    done = check_program(script)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    assert "NOT tested" in line


@pytest.mark.parametrize("version", ["4.5.0", "5.2.2 LTS", "10.0.1"])
def test_extension_that_fails_in_a_program_is_a_failure(check_program, version):
    is_asked_for_its_version = '[ "$1" = --version ]'
    done = check_program(f"if {is_asked_for_its_version}; then echo Blender {version}; else exit 1; fi")
    assert done.returncode != 0
    assert "NOT tested" not in done.stdout


def test_extension_that_renders_nothing_is_a_failure(check_program):
    """The program says that all went well, and nothing is there."""
    done = check_program("echo Blender 5.2.2")
    assert done.returncode != 0
    assert "was tested" not in done.stdout
