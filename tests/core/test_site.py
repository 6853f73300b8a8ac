# SPDX-License-Identifier: GPL-3.0-or-later
"""The site builds without a warning, every link in it leads somewhere, and a browser has no complaint."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tests.core.browser import open_page
from tests.core.pages import ROOT

for _needed in ("sphinx", "myst_parser", "furo"):
    pytest.importorskip(_needed, reason="the site needs pip install -e '.[docs]'")

NARROW = 500  # pixels, the least that the browser takes
# Writes the page's width, and how many of its pictures are broken, where the test finds them.
MEASURE = """<script>addEventListener("load", () => {
  const root = document.documentElement
  root.setAttribute("data-width", root.scrollWidth)
  root.setAttribute("data-missing", [...document.images].filter(image => !image.naturalWidth).length)
})</script>"""
# Whatever a page may show: pictures, tables, code, an interface description.
SHOWN = ("index.html", "diffuse.html", "api.html", "choosing.html")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "docs", str(folder / "html")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "html"


class _Page(HTMLParser):
    """Anchors of a page, and what it links to and shows."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.targets: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.anchors |= {value for value in (values.get("id"), values.get("name")) if value}
        target = values.get({"a": "href", "img": "src", "link": "href", "script": "src"}.get(tag, ""))
        if target:
            self.targets.append(target)


def test_links_and_pictures_are_there(site):
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    assert len(pages) > 40
    broken = []
    for path, page in pages.items():
        for target in page.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchors = pages[file].anchors if file in pages else {parts.fragment}
            if not file.is_file() or (parts.fragment and unquote(parts.fragment) not in anchors):
                broken.append(f"{path.relative_to(site)}: {target}")
    assert broken == []


def test_pages_need_no_network(site):
    for path in site.rglob("*.html"):
        for target in _Page(path.read_text(encoding="utf-8")).targets:
            if target.endswith((".js", ".css", ".png", ".svg", ".webp")):
                assert not urlsplit(target).netloc, f"{path.name}: {target}"


def test_what_is_filled_in_is_there(site):
    text = (site / "diffuse.html").read_text(encoding="utf-8")
    assert "DiffuseSettings.bounces" in text
    assert "<!-- fill" not in text
    assert "--reference-samples" in (site / "command_line.html").read_text(encoding="utf-8")
    assert "Cycles GI 4 + fastest denoise" in (site / "choosing.html").read_text(encoding="utf-8")
    records = len(list((ROOT / "docs" / "adr").glob("0*.md")))
    index = _Page((site / "adr" / "index.html").read_text(encoding="utf-8"))
    assert len({Path(target).name for target in index.targets if target.startswith("00")}) == records


@pytest.mark.parametrize("name", SHOWN)
def test_narrow_page_is_no_wider_than_its_window_and_shows_every_picture(site, name, tmp_path):
    copy = site / f"narrow-{name}"
    copy.write_text((site / name).read_text(encoding="utf-8").replace("</body>", f"{MEASURE}</body>"))
    shown = open_page(copy, tmp_path / "profile", width=NARROW)
    width, missing = re.search(r'data-width="(\d+)" data-missing="(\d+)"', shown).groups()
    assert int(width) <= NARROW
    assert missing == "0"


@pytest.mark.parametrize("name", SHOWN)
def test_page_opens_in_a_browser_without_complaint(site, name, tmp_path):
    shown = open_page(site / name, tmp_path / "profile")
    assert "<article" in shown
