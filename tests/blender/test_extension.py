# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension as Blender sees it: archive, registration, scene properties."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

pytest.importorskip("bpy")

from ssgi_addon.core.settings import DiffuseSettings
from tests.blender.extension_fixtures import ROOT, blender_ext, installed_extension  # noqa: F401  (a fixture)


def test_source_folder_and_archive_validate(extension):
    for place in (ROOT, extension.archive):
        checked = blender_ext("validate", place)
        assert checked.returncode == 0, checked.stdout + checked.stderr


def test_archive_holds_what_runs_and_nothing_else(extension):
    names = set(zipfile.ZipFile(extension.archive).namelist())
    assert {"blender_manifest.toml", "__init__.py", "LICENSE", "ssgi_addon/core/settings.py"} <= names
    assert {name.partition("/")[0] for name in names if name.endswith(".py")} == {
        "__init__.py",
        "operators",
        "ssgi_addon",
    }
    allowed = {"ssgi_addon", "operators", "wheels", "blender_manifest.toml", "__init__.py", "LICENSE"}
    assert {name.partition("/")[0] for name in names} <= allowed | {"README.md", "CHANGELOG.md"}


def test_wheels_of_the_archive_are_what_reads_and_writes_files(extension, tmp_path):
    if not any(name.endswith(".whl") for name in zipfile.ZipFile(extension.archive).namelist()):
        pytest.skip("built without wheels")
    script = """
from bl_ext.user_default.ssgi.ssgi_addon import exr
result = exr._openexr().__file__
"""
    assert Path(extension.run(script, tmp_path)).is_relative_to(extension.resources)


def test_disabling_leaves_nothing_behind(extension, tmp_path):
    script = """
def registered():
    classes = [name for name in dir(bpy.types) if name.startswith("SSGI_")]
    return [hasattr(bpy.types.Scene, "ssgi"), len(classes) > 5, "render" in dir(bpy.ops.ssgi)]

result = [registered()]
addon_utils.disable("bl_ext.user_default.ssgi")
result.append(registered())
enable()
result.append(registered())
"""
    assert extension.run(script, tmp_path) == [[True] * 3, [False] * 3, [True] * 3]


def test_properties_mean_the_core_settings(extension, tmp_path):
    script = """
from dataclasses import replace
from bl_ext.user_default.ssgi.ssgi_addon.core.settings import PRESETS, Settings
from bl_ext.user_default.ssgi.ssgi_addon.properties import core_settings
settings = bpy.context.scene.ssgi
result = {"default": core_settings(settings) == Settings.preset("balanced")}
settings.seed = 7
for name in PRESETS:
    settings.preset = name
    preset = Settings.preset(name)
    settings_now = core_settings(settings)
    result[name] = replace(settings_now, seed=preset.seed) == preset
result["seed"] = core_settings(settings).seed
settings.threads, settings.max_distance, settings.diffuse.rays = 2, 12.5, 9
changed = core_settings(settings)
result["changed"] = [changed.threads, changed.max_distance, changed.diffuse.rays]
"""
    assert extension.run(script, tmp_path) == {
        "default": True,
        "draft": True,
        "balanced": True,
        "final": True,
        "seed": 7,
        "changed": [2, 12.5, 9],
    }


def test_properties_mean_the_options_of_a_job(extension, tmp_path):
    script = """
from dataclasses import replace
from bl_ext.user_default.ssgi.ssgi_addon.job_options import JobOptions
from bl_ext.user_default.ssgi.ssgi_addon.properties import job_options
settings = bpy.context.scene.ssgi
default = replace(JobOptions(output=out), overwrite=True)  # a click on the same button again is meant
result = [job_options(settings, out) == default]
settings.surround, settings.samples, settings.save_passes, settings.overwrite = 0, 3, True, False
expected = replace(default, surround=0, samples=3, save_passes=True, overwrite=False)
result.append(job_options(settings, out) == expected)
"""
    assert extension.run(script, tmp_path) == [True, True]


def test_every_property_has_a_name_and_help_in_blenders_form(extension, tmp_path):
    script = """
result = []
def visit(group):
    for item in group.bl_rna.properties:
        if item.identifier in ("rna_type", "name"):
            continue
        if item.type == "POINTER":
            visit(getattr(group, item.identifier))
        elif not item.name or not item.description or item.description.endswith("."):
            result.append(item.identifier)
visit(bpy.context.scene.ssgi)
"""
    assert extension.run(script, tmp_path) == []


def test_settings_are_saved_with_the_scene(extension, tmp_path):
    script = """
bpy.context.scene.ssgi.diffuse.rays = 33
bpy.ops.wm.save_as_mainfile(filepath=str(out / "scene.blend"))
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
fresh = bpy.context.scene.ssgi.diffuse.rays
bpy.ops.wm.open_mainfile(filepath=str(out / "scene.blend"))
result = [fresh, bpy.context.scene.ssgi.diffuse.rays]
"""
    assert extension.run(script, tmp_path) == [DiffuseSettings().rays, 33]
