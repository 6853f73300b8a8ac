# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/api.md names every public name of core, and their docstrings say what each argument is."""

from __future__ import annotations

import importlib
import inspect
import re

import pytest

import ssgi_addon.core
from docs.site import one_attribute_each
from tests.core.settings_pages import text_of

DIRECTIVE = re.compile(r"^\.\. auto(\w+):: ([\w.]+)\n(?:   :members: (.+)\n)?", re.MULTILINE)
# Names that come with Python, or that the docstring of a class tells.
NOT_TOLD = {"self", "cls"}


def documented() -> dict[str, object]:
    """Return what the page documents, by its full name."""
    found: dict[str, object] = {}
    for kind, name, members in DIRECTIVE.findall(text_of("api.md")):
        owner, _, own = name.rpartition(".")
        is_module = kind == "module"
        module = importlib.import_module(name if is_module else owner)
        thing = module if is_module else getattr(module, own)
        if not is_module:
            found[name] = thing
        for member in filter(None, map(str.strip, members.split(","))):
            found[f"{name}.{member}"] = getattr(thing, member)
    return found


DOCUMENTED = documented()
FUNCTIONS = {
    name: thing for name, thing in DOCUMENTED.items() if inspect.isfunction(thing) or inspect.ismethod(thing)
}


def test_every_public_name_of_core_is_there():
    assert {f"ssgi_addon.core.{name}" for name in ssgi_addon.core.__all__} <= DOCUMENTED.keys()


@pytest.mark.parametrize("name", DOCUMENTED)
def test_everything_has_a_docstring(name):
    assert inspect.getdoc(DOCUMENTED[name])


def test_attributes_that_share_a_text_have_it_each():
    lines = ["A frame.", "", "Attributes", "----------", "a, b : (H, W)", "    Both.", "c", "    Third.", ""]
    split = ["a : (H, W)", "    Both.", "b : (H, W)", "    Both.", "c", "    Third.", ""]
    assert one_attribute_each(lines) == lines[:4] + split
    rest = ["Raises", "------", "ValueError", "    If a, b differ."]
    assert one_attribute_each(lines + rest) == lines[:4] + split + rest
    assert one_attribute_each(rest) == rest


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_is_told(name):
    thing = FUNCTIONS[name]
    text = inspect.getdoc(thing) or ""
    arguments = [key for key in inspect.signature(thing).parameters if key not in NOT_TOLD]
    told = re.findall(r"^\*{0,2}([\w, ]+?)(?: : .*)?$", text, re.MULTILINE)
    names = {part.strip() for line in told for part in line.split(",")}
    elsewhere = re.search(r"(P|p)arameters (and errors )?are those of `", text)
    missing = set(arguments) - names
    assert not missing or elsewhere


@pytest.mark.parametrize("name", FUNCTIONS)
def test_errors_that_are_raised_are_told(name):
    thing = FUNCTIONS[name]
    if re.search(r"^\s+raise (ValueError|SSGIError)", inspect.getsource(thing), re.MULTILINE):
        assert "Raises\n------" in (inspect.getdoc(thing) or "")
