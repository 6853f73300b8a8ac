# SPDX-License-Identifier: GPL-3.0-or-later
"""Kill runs at random moments, and look at what they leave and at how the next run copes with it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ssgi_addon.child import environment
from ssgi_addon.exr import read_layers, write_layers

ROOT = Path(__file__).resolve().parents[2]
TINY = (
    "--resolution", "48x27", "--samples", "1", "--preset", "draft", "--denoiser", "none", "--fill", "0",
    "--surround", "0", "--stations", "0", "--no-keep-world", "--frames", "1-3",
)  # fmt: skip
# Seconds after a run has said that it writes, within which half of the kills strike
_WRITING = 0.3
# Seconds for which processes that a killed one started may take to notice
PATIENCE = 20.0

Files = Mapping[str, bytes]


@dataclass
class Kills:
    """How many runs were killed, how many had ended before, and what was wrong, a text each."""

    killed: int = 0
    finished: int = 0
    faults: list[str] = field(default_factory=list)

    def judge(self, was_killed: bool, faults: Sequence[str]) -> None:
        self.killed += was_killed
        self.finished += not was_killed
        self.faults += faults


def render_command(blend: Path, output: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "ssgi_addon", "render", str(blend), "--output", str(output), *TINY, *more]


def apply_command(passes: Path, output: Path) -> list[str]:
    line = ["apply", str(passes), "--output", str(output), "--preset", "draft", "--rays", "1"]
    return [sys.executable, "-m", "ssgi_addon", *line]


def run(command: Sequence[str], temporary: Path) -> float:
    """Run a command to its end; return the seconds."""
    begun = time.monotonic()
    variables = environment(TMPDIR=str(temporary))
    subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, check=True)
    return time.monotonic() - begun


def kill(
    command: Sequence[str], temporary: Path, seconds: float, rng: np.random.Generator, step: str, frames: int
) -> bool:
    """Run a command and kill it: half of the times when it writes, else within so many seconds.

    It says `step` before it writes a frame. Return whether it was killed before its end.
    """
    process = subprocess.Popen(
        command, cwd=ROOT, env=environment(TMPDIR=str(temporary)), stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    if rng.random() < 0.5:
        wanted, wait = int(rng.integers(1, frames + 1)), rng.uniform(0.0, _WRITING)
        for line in process.stderr:
            wanted -= step in line
            if not wanted:
                break
        time.sleep(wait)
    else:
        with suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0.0, seconds))
    is_running = process.poll() is None
    process.kill()
    process.communicate()
    return is_running and process.returncode == -signal.SIGKILL


def files_below(folder: Path) -> dict[str, bytes]:
    """Names and contents of all files but those that say how long things took."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix != ".json"
    }


def write_old(folder: Path, like: Files) -> Files:
    """Write other files of the same names, as an older run could have left them."""
    for name in like:
        path = folder / name
        if path.suffix == ".exr":
            write_layers(path, {"combined": np.zeros((3, 4, 3), np.float32)})
        else:
            path.write_bytes(b"old")
    return files_below(folder)


def unfinished(folder: Path) -> list[str]:
    """Temporary files and folders of ours."""
    return [path.name for path in folder.rglob("*") if path.name.endswith(".tmp") or path.name[:5] == "ssgi-"]


def half_files(folder: Path, old: Files, new: Files) -> Iterator[str]:
    """Say which files are neither as before nor as after a whole run."""
    for name, data in files_below(folder).items():
        if not name.endswith(".tmp") and data not in (old.get(name), new.get(name)):
            yield f"{name} is neither old nor new"
    for path in folder.rglob("*.json"):
        try:
            json.loads(path.read_text())
        except ValueError:
            yield f"{path.name} is no JSON"
    for path in folder.rglob("*.exr"):
        read_layers(path)


def kill_renders(blend: Path, folder: Path, count: int, rng: np.random.Generator) -> Kills:
    """Kill renders of three frames, into empty folders and over older results; let the next run go on."""
    temporary, kills = folder / "temporary", Kills()
    temporary.mkdir(parents=True)
    scene = blend.read_bytes()
    seconds = run(render_command(blend, folder / "new"), temporary)
    old, new = write_old(folder / "old", files_below(folder / "new")), files_below(folder / "new")
    for index in range(count):
        output = folder / f"out{index}"
        is_over_older = bool(index % 2)
        if is_over_older:
            shutil.copytree(folder / "old", output)
        way = ["--overwrite"] if is_over_older else []
        command = render_command(blend, output, *way)
        was_killed = kill(command, temporary, seconds, rng, "Writing", frames=3)
        faults = list(half_files(output, old if is_over_older else {}, new))
        # A frame is finished once its manifest is there
        finished = [output / f"{path.stem}.exr" for path in output.glob("frames/*.json")]
        kept = {path: path.stat().st_mtime_ns for path in finished}
        run(command, temporary)
        if files_below(output) != new:
            faults.append("the next run did not finish the rest")
        if not is_over_older and any(path.stat().st_mtime_ns != written for path, written in kept.items()):
            faults.append("a whole frame was rendered again")
        faults += [f"{name} was left behind" for name in (*unfinished(output), *unfinished(temporary))]
        if blend.read_bytes() != scene:
            faults.append("the scene was changed")
        kills.judge(was_killed, [f"render {index}: {fault}" for fault in faults])
    return kills


def kill_applies(passes: Path, folder: Path, count: int, rng: np.random.Generator) -> Kills:
    """Kill `apply` over an older result, and run it again."""
    temporary, kills, output = folder / "temporary", Kills(), folder / "out" / "a.exr"
    temporary.mkdir(parents=True)
    inputs = files_below(passes.parent)
    seconds = run(apply_command(passes, output), temporary)
    new = output.read_bytes()
    for index in range(count):
        output.write_bytes(b"old")
        was_killed = kill(apply_command(passes, output), temporary, seconds, rng, "100%", frames=1)
        faults = []
        if output.read_bytes() not in (b"old", new):
            faults.append("the result is neither old nor new")
        run(apply_command(passes, output), temporary)
        if output.read_bytes() != new or os.listdir(output.parent) != [output.name]:
            faults.append(f"the next run left {os.listdir(output.parent)}")
        if files_below(passes.parent) != inputs:
            faults.append("the passes were changed")
        kills.judge(was_killed, [f"apply {index}: {fault}" for fault in faults])
    return kills


WINDOW = """
import sys, time
from pathlib import Path
from ssgi_addon.bpy_module import require_bpy
require_bpy()
import bpy
from ssgi_addon.blender.background import BackgroundRender
from ssgi_addon.core import Settings
from ssgi_addon.job_options import JobOptions
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene = bpy.context.scene
options = JobOptions(
    output=Path(sys.argv[2]), settings=Settings.preset("draft"), resolution=(48, 27), frames=(1, 2, 3),
    samples=1, denoiser="none", fill=0, surround=0, stations=0, overwrite=True, keep_world=False,
)
render = BackgroundRender(scene, scene.view_layers[0], options, Path(sys.argv[3]), blender="")
print(render.pid, flush=True)
while not render.update():
    print(render.text, flush=True)
    time.sleep(0.02)
failure = render.failure()
render.close()
print("failed" if failure else "done", flush=True)
"""


def kill_windows(blend: Path, folder: Path, count: int, rng: np.random.Generator) -> Kills:
    """Kill a process that renders in the background, or the one that waits for it."""
    kills, cache, temporary = Kills(), folder / "cache", folder / "temporary"
    for place in (cache, temporary):
        place.mkdir(parents=True)
    run([sys.executable, "-c", WINDOW, str(blend), str(folder / "new"), str(cache)], temporary)
    old, new = write_old(folder / "old", files_below(folder / "new")), files_below(folder / "new")
    for index in range(count):
        output = folder / f"out{index}"
        shutil.copytree(folder / "old", output)
        process = subprocess.Popen(
            [sys.executable, "-c", WINDOW, str(blend), str(output), str(cache)],
            cwd=ROOT, env=environment(TMPDIR=str(temporary)), stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        worker = int(next(line for line in process.stdout if line.strip().isdecimal()))
        step = ("Starting", "Opening", "Direct light", "Writing")[rng.integers(4)]
        for line in process.stdout:
            if line.strip() == step:
                break
        time.sleep(rng.uniform(0.0, _WRITING))
        is_running = process.poll() is None
        is_worker = bool(index % 2)
        with suppress(ProcessLookupError):
            os.kill(worker if is_worker else process.pid, signal.SIGKILL)
        process.communicate()
        faults = [] if ends(worker) else ["a process goes on"]
        faults += half_files(output, old, new)
        faults += [f"{name} was left behind" for name in (*unfinished(output), *unfinished(cache))]
        kills.judge(is_running, [f"window {index}: {fault}" for fault in faults])
    return kills


def ends(pid: int) -> bool:
    """Whether a process ends soon, by itself."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    os.kill(pid, signal.SIGKILL)
    return False
