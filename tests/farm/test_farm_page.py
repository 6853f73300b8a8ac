# SPDX-License-Identifier: GPL-3.0-or-later
"""The shell lines of the page about farms do what it says: they run, with stand-ins for queues and ssgi."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.core.pages import blocks_of
from tests.farm.farm_commands import needs_bash, parsed

PAGE = Path("docs/farms.md")
SHOT = tuple(range(1, 241))
STAND_INS = {
    # Notes its arguments, by one write: others may run beside it
    "ssgi": r"""line=$(printf '%s\t' "$@"); printf '%s\n' "$line" >>"$COMMANDS" """,
    # Does at once what it should queue: the array's tasks one after the other
    "sbatch": r"""
while [[ $# -gt 0 ]]; do
  case $1 in --array=*) array=${1#*=} ;; --wrap) wrap=$2; shift ;; --*) ;; *) script=$1 ;; esac
  shift
done
if [[ -n $wrap ]]; then
  sh -c "$wrap" >&2
else
  IFS=:- read -r first last step <<<"$array"
  for ((id = first; id <= last; id += step)); do SLURM_ARRAY_TASK_ID=$id bash "$script" >&2; done
fi
echo 101""",
    # One argument at a time in place of {}
    "parallel": r"""
while [[ $1 != ssgi ]]; do shift; done
command=()
while [[ $1 != ::: ]]; do command+=("$1"); shift; done
shift
for item; do "${command[@]/#\{\}/$item}"; done""",
}


@pytest.fixture(name="run_block")
def run_with_stand_ins(tmp_path):
    """Run a block as a script; return what the parser makes of its ssgi commands, with their first words."""
    folder = tmp_path / "programs"
    folder.mkdir()
    for name, script in STAND_INS.items():
        (folder / name).write_text(f"#!{shutil.which('bash')}\n{script}\n")
        (folder / name).chmod(0o755)

    def run(text):
        log = tmp_path / "commands"
        log.write_text("")
        (tmp_path / "block.sh").write_text(text)
        paths = os.pathsep.join([str(folder), os.environ["PATH"]])
        environment = {**os.environ, "PATH": paths, "COMMANDS": str(log)}
        done = subprocess.run(
            ["bash", "block.sh"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        commands = [line.rstrip("\t").split("\t") for line in log.read_text().splitlines()]
        return [(words[0], parsed(words, inside_blender=False)) for words in commands]

    return run


def shell_blocks():
    """Return the blocks that run ssgi, by their first line, and the one that is a script for Slurm."""
    blocks = [block.text for block in blocks_of(PAGE) if block.language == "sh" and "ssgi " in block.text]
    (script,) = [text for text in blocks if text.startswith("#!")]
    return [text for text in blocks if "openjd" not in text and text != script], script


@needs_bash
@pytest.mark.parametrize("text", shell_blocks()[0], ids=lambda text: text.splitlines()[0])
def test_commands_of_the_page_are_ours(run_block, tmp_path, text):
    (tmp_path / "frames.sbatch").write_text(shell_blocks()[1])
    commands = run_block(text)
    assert commands
    names = [name for name, _ in commands]
    rendered = [frame for name, arguments in commands if name == "render" for frame in arguments.frames]
    if len(rendered) > len(SHOT) // 2:  # a whole shot, in tasks: each frame once
        assert sorted(rendered) == list(SHOT)
    if "merge" in names and "prepare" in names:
        assert names[0] == "prepare"
        assert names[-1] == "merge"
        assert all(tuple(arguments.frames) == SHOT for name, arguments in commands if name != "render")
        shots = {arguments.shot for name, arguments in commands if name == "render"}
        assert shots == {commands[0][1].output}


def test_whole_shots_are_among_them():
    texts = shell_blocks()[0]
    assert sum("sbatch" in text or "xargs" in text or "parallel" in text for text in texts) == 3
