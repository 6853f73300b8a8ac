# SPDX-License-Identifier: GPL-3.0-or-later
"""Code in the documentation runs, and commands mean something to what would read them."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import textwrap
import tomllib
from pathlib import Path

import pytest

from ssgi_addon.cli import build_parser
from tests.core.pages import ROOT, Block, all_pages, blocks_of

PAGES = all_pages()
# What a fence says of Python that stands for a part of a module.
NO_RUN = "no-run"
OWN_COMMANDS = {"render", "prepare", "merge", "apply", "compare", "bench", "demo"}
MAKE_TARGETS = set(re.findall(r"^(\w[\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])


def pages_with(language: str) -> list[Path]:
    return [page for page in PAGES if any(block.language == language for block in blocks_of(page))]


@pytest.mark.parametrize("page", pages_with("python"), ids=str)
def test_python_runs(page, tmp_path, monkeypatch):
    """The blocks of a page run one after the other, as somebody would try them."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    for block in blocks_of(page):
        if block.language == "python":
            place = f"{page}, line {block.line}"
            code = compile(textwrap.dedent(block.text), place, "exec", dont_inherit=True)
            if NO_RUN not in block.info:
                exec(code, names)


@pytest.mark.parametrize("page", pages_with("sh"), ids=str)
def test_shell_commands_are_understood(page):
    for block in blocks_of(page):
        if block.language == "sh":
            for command in commands_of(block):
                complaint = complaint_about(command)
                assert complaint is None, f"{page}, line {block.line}: {shlex.join(command)}: {complaint}"


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash here")
@pytest.mark.parametrize("page", pages_with("sh"), ids=str)
def test_shell_blocks_are_shell(page):
    for block in blocks_of(page):
        if block.language == "sh":
            done = subprocess.run(["bash", "-n"], input=block.text, text=True, capture_output=True)
            assert done.returncode == 0, f"{page}, line {block.line}: {done.stderr}"


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_blocks_say_what_they_are(page):
    known = {"", "sh", "python", "text", "{toctree}", "{eval-rst}"}
    assert {block.language for block in blocks_of(page)} <= known


def commands_of(block: Block) -> list[list[str]]:
    """Return the words of each command of a shell block."""
    text = block.text.replace("\\\n", " ")
    commands = []
    for line in text.splitlines():
        words = shlex.split(line, comments=True)
        while "&&" in words:
            place = words.index("&&")
            commands.append(words[:place])
            words = words[place + 1 :]
        commands.append(words)
    return [words for words in commands if words]


def complaint_about(words: list[str]) -> str | None:
    """Return what is wrong with a command that this repository answers for; None for all others."""
    if words[:2] == ["python", "-m"] and words[2] == "ssgi_addon":
        words = ["ssgi", *words[3:]]
    if words[0] == "ssgi":
        return parser_complaint(words[1:], inside_blender=False)
    if words[0] == "blender" and "--command" in words:
        command = words[words.index("--command") + 1 :]
        return parser_complaint(command[1:], inside_blender=True) if command[0] == "ssgi" else None
    if words[0] == "blender" and "--python" in words:
        script = words[words.index("--python") + 1]
        return None if (ROOT / script).is_file() else f"there is no {script}"
    if words[0] == "make":
        targets = {word for word in words[1:] if "=" not in word}
        return None if targets <= MAKE_TARGETS else f"make knows none of {targets - MAKE_TARGETS}"
    if words[:2] == ["python", "-m"] and words[2].split(".")[0] in ("benchmarks", "docs", "ssgi_addon"):
        path = ROOT / words[2].replace(".", "/")
        found = path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()
        return None if found else f"there is no module {words[2]}"
    if words[0].startswith((".ci/", "benchmarks/", "docs/")):
        return None if (ROOT / words[0]).is_file() else f"there is no {words[0]}"
    if "install" in words and words[0].endswith("pip"):
        named = {extra for word in words for extra in extras_of(word)}
        return None if named <= EXTRAS else f"there is no extra {named - EXTRAS}"
    return None


def extras_of(requirement: str) -> list[str]:
    """Return the extras that an argument of pip asks of this package."""
    found = re.fullmatch(r"(?:\.|ssgi)\[(.*)]", requirement)
    return found[1].split(",") if found else []


def parser_complaint(arguments: list[str], *, inside_blender: bool) -> str | None:
    if arguments and arguments[0] not in OWN_COMMANDS:
        return f"there is no command {arguments[0]}"
    try:
        build_parser(inside_blender=inside_blender).parse_args(arguments)
    except SystemExit as stopped:
        return None if stopped.code == 0 else "the parser refuses it"
    return None


@pytest.mark.parametrize(
    "line",
    [
        "ssgi render scene.blend",
        "ssgi rander scene.blend --output out",
        "python -m ssgi_addon render scene.blend --output out --preset fine",
        "blender --background scene.blend --command ssgi render --outputs out",
        "mkdir out && ssgi apply passes.exr",
        "make demos",
        "python -m docs.pictures.nothing",
        "pip install 'ssgi[blendr]'",
    ],
)
def test_wrong_commands_are_found(line):
    complaints = [complaint_about(words) for words in commands_of(Block("sh", 1, line))]
    assert any(complaints)
