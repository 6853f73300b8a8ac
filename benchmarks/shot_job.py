# SPDX-License-Identifier: GPL-3.0-or-later
"""A shot as a farm renders it: a scene whose camera moves, and the commands that do its steps."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.inputs import ROOT, SCENES, Size, run_module
from ssgi_addon.arguments import frame_text
from ssgi_addon.bpy_module import require_bpy
from ssgi_addon.child import environment

TEMPLATE = ROOT / "farm" / "ssgi.template.yaml"
# Of the camera from frame to frame: scene units to the right, and radians.
_STEP, _TURN = 0.02, 0.01


@dataclass(frozen=True)
class ShotJob:
    """A shot, and where its results go.

    Attributes
    ----------
    scene
        The .blend file.
    output
        Folder of the results; the prepared shot is in its folder ``shot``.
    count
        It has the frames from 1 to this one.
    size
        Width and height, pixels.
    preset
        Of the settings.
    """

    scene: Path
    output: Path
    count: int
    size: Size
    preset: str

    @property
    def frames(self) -> range:
        """Numbers of its frames."""
        return range(1, self.count + 1)

    @property
    def shot(self) -> Path:
        """Folder of what is prepared."""
        return self.output / "shot"

    def chunks(self, size: int) -> list[list[int]]:
        """Return the frames in chunks of so many, as a queue hands them out."""
        return [list(self.frames[first : first + size]) for first in range(0, self.count, size)]

    def prepare(self) -> list[str]:
        """Return the command of the first step."""
        return self._command("prepare", self.shot, self.frames)

    def render(self, frames: Sequence[int], shot: Path | None = None) -> list[str]:
        """Return the command of a task of the second step; `shot` takes the place of its own one."""
        return [*self._command("render", self.output, frames), "--shot", str(shot or self.shot)]

    def merge(self) -> list[str]:
        """Return the command of the last step."""
        words = ["merge", str(self.output), "--frames", frame_text(self.frames), "--progress", "lines"]
        return [sys.executable, "-m", "ssgi_addon", *words]

    def by_shell(self, chunk: int) -> list[str]:
        """Return the command that does all steps, one after the other, until one fails."""
        steps = [self.prepare(), *map(self.render, self.chunks(chunk)), self.merge()]
        return ["bash", "-c", "\n".join(["set -e", *map(shlex.join, steps)])]

    def by_openjd(self, chunk: int) -> list[str]:
        """Return the command that does all steps by the Open Job Description template."""
        values = {
            "Scene": self.scene,
            "Output": self.output,
            "Frames": frame_text(self.frames),
            "ChunkSize": chunk,
            "Preset": self.preset,
            "Resolution": f"{self.size[0]}x{self.size[1]}",
            "Program": sys.executable,
        }
        words = [word for name, value in values.items() for word in ("-p", f"{name}={value}")]
        return [*openjd_program(), "run", str(TEMPLATE), *words]

    def _command(self, name: str, output: Path, frames: Sequence[int]) -> list[str]:
        return [
            sys.executable, "-m", "ssgi_addon", name, str(self.scene), "--output", str(output),
            "--frames", frame_text(frames), "--resolution", f"{self.size[0]}x{self.size[1]}",
            "--preset", self.preset, "--progress", "lines",
        ]  # fmt: skip


def openjd_program() -> list[str]:
    """Return what starts the command line of Open Job Description: of this Python, else from the PATH."""
    if importlib.util.find_spec("openjd") is not None:
        return [sys.executable, "-m", "openjd"]
    program = shutil.which("openjd")
    if program is None:
        raise SystemExit("this needs the command openjd: pip install openjd-cli")
    return [program]


def worker_environment(folder: Path, **changes: str) -> Mapping[str, str]:
    """Return the environment of a worker that shares neither preferences nor temporary files with others.

    Parameters
    ----------
    folder
        Of the worker alone; made if need be.
    **changes
        Further variables.
    """
    own = {"BLENDER_USER_RESOURCES": folder / "blender", "TMPDIR": folder / "temporary"}
    for place in own.values():
        place.mkdir(parents=True, exist_ok=True)
    return environment(**{name: str(place) for name, place in own.items()}, **changes)


def moving_scene(name: str, folder: Path, count: int, at: int = 1) -> Path:
    """Save a scene of `SSGI_SCENES` with a camera that moves over so many frames; return the file.

    At frame `at` the camera is where it was.
    """
    path = folder / f"{name}.blend"
    run_module("benchmarks.shot_job", str(SCENES / path.name), str(path), str(count), str(at))
    return path


def run(command: Sequence[str], env: Mapping[str, str]) -> str:
    """Run a command to its end and return what it printed; one that fails ends the benchmark."""
    done = subprocess.run(
        command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    if done.returncode:
        raise SystemExit(f"{shlex.join(command)}\n{done.stdout}")
    return done.stdout


def _save_with_a_move(source: Path, target: Path, count: int, at: int) -> None:
    """Save a scene whose camera walks, and turns, from the first frame to the last."""
    require_bpy()
    import bpy
    from mathutils import Matrix

    from ssgi_addon.blender.scene_file import open_scene

    open_scene(source)
    scene = bpy.context.scene
    camera, pose = scene.camera, scene.camera.matrix_world.copy()
    camera.animation_data_clear()
    camera.constraints.clear()
    camera.parent = None
    camera.rotation_mode = "QUATERNION"
    for marker in scene.timeline_markers:
        marker.camera = None
    scene.frame_start, scene.frame_end = 1, count
    for frame in range(1, count + 1):
        steps = frame - at
        turn = Matrix.Rotation(_TURN * steps, 4, "Y")
        camera.matrix_world = pose @ Matrix.Translation((_STEP * steps, 0.0, 0.0)) @ turn
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_quaternion", frame=frame)
    scene.frame_set(1)
    bpy.ops.wm.save_as_mainfile(filepath=str(target), copy=True)


if __name__ == "__main__":
    _save_with_a_move(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
    sys.stdout.flush()
    os._exit(0)  # how Blender ends as a module does not matter
