# SPDX-License-Identifier: GPL-3.0-or-later
"""How Sphinx makes the site; ``make docs`` calls it. Pages are Markdown, filled in by ``docs.site``."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # the site describes this checkout, not an installed package

import ssgi_addon

project = "Screen-Space GI for Blender"
author = "the ssgi contributors"
project_copyright = "GPL-3.0-or-later"
version = release = ssgi_addon.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "docs.site"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

autodoc_typehints = "none"  # the docstrings say shapes and units, which the types do not
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
napoleon_use_rtype = False
default_role = "code"
add_module_names = False

html_theme = "furo"
html_title = f"Screen-Space GI {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
pygments_style = "friendly"
