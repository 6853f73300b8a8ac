# SPDX-License-Identifier: GPL-3.0-or-later
"""The farm files go where they belong: into the archive of the sources, not into the extension."""

from __future__ import annotations

from release import contents
from tests.farm.farm_commands import ROOT


def test_source_archive_takes_them():
    assert "graft farm" in (ROOT / "MANIFEST.in").read_text(encoding="utf-8").splitlines()


def test_extension_does_without_them():
    files = contents.files_that_ship()
    assert "blender_manifest.toml" in files
    assert not [name for name in files if name.startswith("farm")]


def test_each_is_told_about():
    page = (ROOT / "docs" / "farms.md").read_text(encoding="utf-8")
    for path in (ROOT / "farm").iterdir():
        assert f"(../farm/{path.name})" in page
