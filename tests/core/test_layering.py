# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder says what a file may import: rules over the syntax trees of all shipped files."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Of the package, these alone need Blender to be imported.
NEEDS_BLENDER = (
    "ssgi_addon/blender/",
    "ssgi_addon/preferences.py",
    "ssgi_addon/progress_panel.py",
    "ssgi_addon/properties.py",
    "ssgi_addon/view_properties.py",
    "ssgi_addon/ui/",
    "operators/",
)


def shipped_files() -> list[str]:
    files = [ROOT / "__init__.py", *ROOT.glob("ssgi_addon/**/*.py"), *ROOT.glob("operators/**/*.py")]
    return sorted(path.relative_to(ROOT).as_posix() for path in files)


def imports(tree: ast.AST, at_import: bool = False) -> Iterator[tuple[int, str]]:
    """Yield (level, module) of each import; with `at_import`, of those alone that run on import."""
    pending = [tree]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import):
            yield from ((0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # In `from . import name` the name may be a module.
            names = [node.module] if node.module else [alias.name for alias in node.names]
            yield from ((node.level, name) for name in names)
        is_deferred = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
        is_for_types = isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
        if not (at_import and (is_deferred or is_for_types)):
            pending.extend(ast.iter_child_nodes(node))


def violations(path: str, source: str) -> list[str]:
    """Return what the file at `path`, relative to the root, may not do and does."""
    tree = ast.parse(source)
    found = []
    depth = path.count("/")  # how far up a relative import may reach inside the root
    for level, module in imports(tree):
        top = module.partition(".")[0]
        if level == 0 and top in ("ssgi_addon", "operators"):
            found.append(f"{path}: imports {module} by its absolute name")
        if path.startswith("ssgi_addon/") and level > depth:
            found.append(f"{path}: imports above ssgi_addon")
        if path.startswith("ssgi_addon/core/"):
            if level == 0 and top != "numpy" and top not in sys.stdlib_module_names:
                found.append(f"{path}: core imports {module}")
            if level > depth - 1:
                found.append(f"{path}: core imports from outside core")
    for level, module in imports(tree, at_import=True):
        top = module.partition(".")[0]
        if path == "__init__.py" and (level or top not in sys.stdlib_module_names):
            found.append(f"{path}: imports {module} at module level")
        reaches_blender = top in ("bpy", "bpy_extras", "mathutils") if level == 0 else top == "blender"
        if reaches_blender and not path.startswith(NEEDS_BLENDER):
            found.append(f"{path}: needs Blender to be imported")
    if any(isinstance(node, ast.Attribute) and ast.unparse(node) == "sys.path" for node in ast.walk(tree)):
        found.append(f"{path}: uses sys.path")
    return found


@pytest.mark.parametrize("path", shipped_files())
def test_file_imports_only_what_its_folder_allows(path):
    assert violations(path, (ROOT / path).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("__init__.py", "import bpy"),
        ("__init__.py", "import numpy"),
        ("__init__.py", "from . import operators"),
        ("__init__.py", "class Late:\n    import bpy"),
        ("ssgi_addon/job.py", "from ..operators import render"),
        ("ssgi_addon/blender/capture.py", "from ... import operators"),
        ("ssgi_addon/job.py", "import ssgi_addon.core"),
        ("ssgi_addon/job.py", "import bpy"),
        ("ssgi_addon/job.py", "from .blender.capture import capture_frame"),
        ("ssgi_addon/job.py", "from . import blender"),
        ("operators/render.py", "from ssgi_addon import job"),
        ("ssgi_addon/core/camera.py", "import scipy"),
        ("ssgi_addon/core/camera.py", "def late():\n    import bpy"),
        ("ssgi_addon/core/camera.py", "from ..errors import SSGIError"),
        ("ssgi_addon/exr.py", "import sys\nsys.path.append('.')"),
    ],
)
def test_forbidden_import_is_found(path, source):
    assert violations(path, source)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("__init__.py", "def register():\n    import bpy\n    from . import operators"),
        ("ssgi_addon/job.py", "def late():\n    from .blender.capture import capture_frame"),
        ("ssgi_addon/blender/capture.py", "import bpy\nfrom ..errors import SSGIError"),
        ("operators/render.py", "from ..ssgi_addon import job"),
        ("ssgi_addon/core/camera.py", "import numpy.typing\nfrom .types import FloatArray"),
    ],
)
def test_allowed_import_is_not_complained_about(path, source):
    assert violations(path, source) == []


def test_tests_reach_operators_through_blender_alone():
    for path in ROOT.glob("tests/**/*.py"):
        modules = {
            module.partition(".")[0] for _, module in imports(ast.parse(path.read_text(encoding="utf-8")))
        }
        assert "operators" not in modules, path
