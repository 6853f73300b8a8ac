# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside the Blender program: the extension renders, and its pictures show the room with bounced light.

blender --background room.blend --python check_render.py -- FOLDER

FOLDER/command holds the result of the command `ssgi render`.
"""

import sys
from pathlib import Path

import bpy
import numpy as np
from bl_ext.user_default.ssgi.ssgi_addon import exr

MODULE = "bl_ext.user_default.ssgi"
FOLDER = Path(sys.argv[-1])

# Float32 sums of products below 10
ROUNDING = 1e-4
# The light that surfaces reflect is about a third of what lamps bring into this room.
LEAST_BOUNCED = 0.1


def check_libraries() -> None:
    """The wheel is installed, and writes what Blender's own library reads, where there is one."""
    import OpenEXR

    place = Path(OpenEXR.__file__).resolve()
    assert place.is_relative_to(bpy.utils.user_resource("EXTENSIONS")), f"{place} is not of the extension"
    print(f"OpenEXR of the extension: {place}")
    layers = {"picture": np.random.default_rng(1).random((5, 7, 3), np.float32)}
    choose = exr._openexr
    print(f"used here: {choose() or 'OpenImageIO of Blender'}")
    try:
        exr._openexr = lambda: OpenEXR
        exr.write_layers(FOLDER / "library.exr", layers)
        exr._openexr = lambda: None
        found = exr.read_layers(FOLDER / "library.exr")
        assert np.array_equal(found["picture"], layers["picture"]), "the two libraries differ"
    except exr.SSGIError as error:
        print(f"Blender's own OpenImageIO: {error}")
    finally:
        exr._openexr = choose


def check_result(path: Path) -> None:
    """The layers of a result fit together, and walls give their colours to the floor."""
    layers = exr.read_layers(path)
    for name, values in layers.items():
        assert np.isfinite(values).all(), f"{path}: {name}"
        assert values.min() >= 0.0, f"{path}: {name}"
    added = layers["albedo"] * layers["diffuse"] + layers["specular"] * layers["glossy"]
    assert np.abs(layers["combined"] - layers["direct"] - added).max() < ROUNDING, path
    assert added.mean() > LEAST_BOUNCED * layers["direct"].mean(), path
    height, width = added.shape[:2]
    near_red = layers["diffuse"][height // 2 :, : width // 4].mean(axis=(0, 1))
    near_green = layers["diffuse"][height // 2 :, -width // 4 :].mean(axis=(0, 1))
    assert near_red[0] / near_red[1] > 1.2 * near_green[0] / near_green[1], (near_red, near_green)
    print_means(str(path), layers["direct"], layers["combined"])


def print_means(name: str, direct: np.ndarray, with_light: np.ndarray) -> None:
    print(f"{name}: direct {direct.mean():.4f}, with bounced light {with_light.mean():.4f}")


def render_still(name: str) -> np.ndarray:
    """Render the frame as F12 does."""
    render = bpy.context.scene.render
    render.filepath = str(FOLDER / name)
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    bpy.ops.render.render(write_still=True)
    return exr.read_layers(FOLDER / name)["Combined"]


scene = bpy.context.scene
assert MODULE in bpy.context.preferences.addons, "the extension is not enabled"
check_libraries()
check_result(FOLDER / "command" / "room_0001.exr")
scene.ssgi.output = str(FOLDER / "operator")
assert bpy.ops.ssgi.render() == {"FINISHED"}
check_result(Path(scene.ssgi.result))
bpy.ops.ssgi.remove_layers()
scene.ssgi.enabled = True
with_light = render_still("with_light.exr")
scene.ssgi.enabled = False
scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 0
direct = render_still("direct.exr")
assert np.isfinite(with_light).all()
assert with_light.mean() > (1.0 + LEAST_BOUNCED) * direct.mean(), (with_light.mean(), direct.mean())
print_means("an ordinary render", direct, with_light)
