# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed package where nothing else is: `apply` and `compare` on a file as Cycles writes it."""

import importlib.util
import subprocess
import sys
from importlib.metadata import distribution, version
from pathlib import Path

import numpy as np
from rendered_passes import write_rendered_passes

import ssgi_addon
import ssgi_addon.core
from ssgi_addon.exr import read_layers

SSGI = Path(sys.executable).with_name("ssgi")
# Float32 sums of products below 1
ROUNDING = 1e-5


def ssgi(*arguments: str) -> str:
    """Run the installed command."""
    done = subprocess.run([SSGI, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


assert importlib.util.find_spec("bpy") is None, "Blender is here; this is to show that nothing needs it"
assert Path(ssgi_addon.__file__).is_relative_to(sys.prefix), ssgi_addon.__file__
assert (Path(ssgi_addon.__file__).parent / "py.typed").is_file()
assert ssgi("--version").split() == ["ssgi", ssgi_addon.__version__]
# The index's form of the same version
assert version("ssgi").replace("rc", "-rc.") == ssgi_addon.__version__, version("ssgi")
assert any(path.name == "LICENSE" for path in distribution("ssgi").files or ())
assert {"Camera", "GBuffer", "Settings", "render_indirect"} <= set(ssgi_addon.core.__all__)

write_rendered_passes("rendered.exr")
ssgi("apply", "rendered.exr", "--output", "with_light.exr", "--preset", "balanced")
layers = read_layers("with_light.exr")
added = layers["albedo"] * layers["diffuse"] + layers["specular"] * layers["glossy"]
assert np.isfinite(layers["combined"]).all()
assert np.abs(layers["combined"] - layers["direct"] - added).max() < ROUNDING
# The wall is grey and gets no light but from the red floor.
wall = layers["combined"][: added.shape[0] // 2][layers["direct"][: added.shape[0] // 2].sum(axis=-1) == 0.0]
assert wall[:, 0].mean() > 2.0 * wall[:, 1].mean() > 0.0, wall.mean(axis=0)

print(ssgi("compare", "with_light.exr", "rendered.exr", "--heatmap", "error.png"), end="")
assert Path("error.png").read_bytes().startswith(b"\x89PNG")
print(f"ssgi {version('ssgi')} alone: apply and compare work")
