# SPDX-License-Identifier: GPL-3.0-or-later
"""A turntable animation: the camera goes once around a model, and each frame gets its indirect light.

With the extension installed, in Blender:

    blender --background --python examples/turntable.py -- --frames 48 --output turntable

With the Python package (`pip install '.[blender]'`):

    python examples/turntable.py --frames 48 --output turntable

`--scene FILE.blend` takes a scene of yours, whose camera then circles around `--center`. Each frame leaves a
PNG, a multilayer EXR file and an entry in report.json; the same line goes on after a stop. To make a film:

    ffmpeg -framerate 24 -i turntable/turntable_%04d.png turntable.mp4
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

try:  # the extension, inside Blender
    from bl_ext.user_default.ssgi.ssgi_addon.blender.job import run_job
    from bl_ext.user_default.ssgi.ssgi_addon.job_options import JobOptions
except ImportError:  # the Python package
    from ssgi_addon.blender.job import run_job
    from ssgi_addon.job_options import JobOptions

# A tray with coloured rims, which a grey model between them takes colour from
TRAY = (
    ("Floor", (0.8, 0.8, 0.78), (0.0, 0.0, -0.1), (4.0, 4.0, 0.2)),
    ("Red Rim", (0.75, 0.06, 0.04), (-2.0, 0.0, 0.35), (0.15, 4.0, 0.9)),
    ("Green Rim", (0.08, 0.5, 0.1), (2.0, 0.0, 0.35), (0.15, 4.0, 0.9)),
    ("Blue Rim", (0.05, 0.15, 0.65), (0.0, 2.0, 0.35), (4.15, 0.15, 0.9)),
    ("Yellow Rim", (0.8, 0.55, 0.05), (0.0, -2.0, 0.35), (4.15, 0.15, 0.9)),
)


def main() -> None:
    """Save the scene with its camera move, and render all frames of it."""
    arguments = parse_arguments()
    # The results are named after the file that the scene is saved in, and belong to it.
    path = arguments.output.resolve() / "turntable.blend"
    if arguments.overwrite or not path.exists():
        save_turntable(arguments, path)
    options = JobOptions.preset(
        arguments.preset,
        arguments.output,
        resolution=tuple(arguments.resolution),
        frames=tuple(range(1, arguments.frames + 1)),
        resume=True,
        overwrite=arguments.overwrite,
    )
    report = run_job(path, options, lambda fraction, text: print(f"{fraction:4.0%} {text}"))
    for frame in report["frames"]:
        print(f"frame {frame['frame']}: {frame['seconds']['total']:.1f} s")


def parse_arguments() -> argparse.Namespace:
    """Read what follows `--` in Blender's own command line, or all of it in Python's."""
    parser = argparse.ArgumentParser(prog="turntable.py", description=__doc__.splitlines()[0])
    parser.add_argument("--scene", type=Path, help="the .blend file (default: a model on a tray)")
    parser.add_argument(
        "--center", type=float, nargs=3, default=(0.0, 0.0, 0.6), help="what the camera goes around"
    )
    parser.add_argument("--frames", type=int, default=48, help="of one turn (default: 48)")
    parser.add_argument("--resolution", type=int, nargs=2, default=(640, 360), help="pixels")
    parser.add_argument("--preset", default="balanced", help="draft, balanced or final")
    parser.add_argument("--output", type=Path, default=Path("turntable"), help="folder for the results")
    parser.add_argument("--overwrite", action="store_true", help="begin anew, with all frames")
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    return parser.parse_args(own)


def save_turntable(arguments: argparse.Namespace, path: Path) -> None:
    """Build or open the scene, animate the camera, save it for the job."""
    if arguments.scene:
        bpy.ops.wm.open_mainfile(filepath=str(arguments.scene))
    else:
        build_scene()
    circle_camera(bpy.context.scene, Vector(arguments.center), arguments.frames)
    path.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def build_scene() -> None:
    """A monkey's head on a tray, in sunlight under a dim sky."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    for name, color, center, size in TRAY:
        bpy.ops.mesh.primitive_cube_add(size=1, location=center)
        bpy.context.object.scale = size
        paint(bpy.context.object, name, color)
    bpy.ops.mesh.primitive_monkey_add(size=1.7, location=(0.0, 0.0, 0.65))
    bpy.ops.object.shade_smooth()
    paint(bpy.context.object, "Model", (0.75, 0.75, 0.75))
    bpy.ops.object.light_add(type="SUN", rotation=(0.5, 0.35, 0.0))
    bpy.context.object.data.energy = 2.2
    scene.world = bpy.data.worlds.new("Sky")
    scene.world.color = (0.03, 0.035, 0.045)
    place, target = Vector((0.0, -5.2, 3.6)), Vector((0.0, 0.0, 0.5))
    bpy.ops.object.camera_add(location=place, rotation=(target - place).to_track_quat("-Z", "Y").to_euler())
    scene.camera = bpy.context.object
    scene.render.engine = "CYCLES"


def paint(thing: bpy.types.Object, name: str, color: tuple[float, float, float]) -> None:
    """Give an object a matt material of one colour."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before Blender 5.0
        material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"].inputs
    surface["Base Color"].default_value = (*color, 1.0)
    surface["Roughness"].default_value = 0.7
    thing.data.materials.append(material)


def circle_camera(scene: bpy.types.Scene, center: Vector, frames: int) -> None:
    """Move the camera once around a vertical axis; the last frame stands one step before the first."""
    camera = scene.camera
    begin = camera.matrix_world.copy()
    camera.parent = None
    camera.rotation_mode = "QUATERNION"
    for frame in range(1, frames + 1):
        turn = Matrix.Rotation(math.tau * (frame - 1) / frames, 4, "Z")
        camera.matrix_world = Matrix.Translation(center) @ turn @ Matrix.Translation(-center) @ begin
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_quaternion", frame=frame)
    scene.frame_start, scene.frame_end = 1, frames
    scene.frame_set(1)


if __name__ == "__main__":
    main()
