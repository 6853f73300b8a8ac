# SPDX-License-Identifier: GPL-3.0-or-later
"""What a run of the benchmark measures and where it writes."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ..core.settings import option
from ..errors import SSGIError

DEMO = "demo"
SCENES_VARIABLE = "SSGI_SCENES"
QUICK_REPEATS = 2
QUICK_MINUTES = 8.0  # a scene
QUICK_REFERENCE_SAMPLES = 32


@dataclass(frozen=True)
class BenchOptions:
    """What to measure.

    Attributes
    ----------
    output
        Folder for the report.
    scenes
        Names of scenes or .blend files; none means all in the folder that ``SSGI_SCENES`` names, else the
        demo.
    quick
        Fewer methods, repeats and samples; one scene unless some are named.
    methods
        Words: only methods whose name holds one of them.
    resolution
        Width and height, pixels.
    cache
        Folder for the references; None means ``.cache/references`` beside `output`.
    fresh
        Measure again what is measured already.
    enable_autoexec
        Run the scripts and drivers of .blend files.
    """

    output: Path
    scenes: tuple[str, ...] = ()
    quick: bool = False
    methods: tuple[str, ...] = ()
    resolution: tuple[int, int] = (480, 270)
    cache: Path | None = None
    fresh: bool = False
    enable_autoexec: bool = False
    repeats: int = option(
        3,
        "Timed runs of each method after a warm-up, the best of which counts",
        label="Repeats",
        min=1,
        max=100,
    )
    reference_samples: int = option(
        128,
        "Samples per pixel of each of the reference's two halves",
        label="Reference Samples",
        min=1,
        max=1 << 24,
    )
    minutes: float = option(
        0.0,
        "Stop starting measurements after so many minutes, shared by the scenes; what matters most comes "
        "first. References count, and a scene's first ones are always made. 0 sets no limit",
        label="Minutes",
        min=0.0,
        max=1e6,
    )
    cold: bool = option(
        True, "Measure the main methods in processes of their own, too, with their memory", label="Cold"
    )
    flicker: bool = option(
        False, "Also measure what flickers while the camera moves slowly, over ten frames", label="Flicker"
    )

    @property
    def reference_folder(self) -> Path:
        """Where references are kept."""
        return self.cache or self.output.absolute().parent / ".cache" / "references"


@dataclass(frozen=True)
class SceneSource:
    """A scene's name and file; None: the demo scene, which is built."""

    name: str
    path: Path | None


def find_scenes(options: BenchOptions) -> list[SceneSource]:
    """Return the scenes to measure.

    Raises
    ------
    SSGIError
        If one is not there, or two have the same name.
    """
    folder = Path(os.environ[SCENES_VARIABLE]) if os.environ.get(SCENES_VARIABLE) else None
    there = {path.stem: path for path in sorted(folder.glob("*.blend"))} if folder else {}
    if options.scenes:
        found = [_find(name, there, folder) for name in options.scenes]
    else:
        found = [SceneSource(name, path) for name, path in there.items()] or [SceneSource(DEMO, None)]
        if options.quick:
            found = found[:1]
    names = [source.name for source in found]
    for name in names:
        if names.count(name) > 1:
            raise SSGIError(f"two scenes are called {name}: name each once")
    return found


def _find(name: str, there: dict[str, Path], folder: Path | None) -> SceneSource:
    if name.endswith(".blend"):
        path = Path(name)
        if not path.is_file():
            raise SSGIError(f"there is no scene {path}: check the path")
        return SceneSource(path.stem, path)
    if name in there:
        return SceneSource(name, there[name])
    if name == DEMO:
        return SceneSource(DEMO, None)
    where = f"in {folder}" if folder else f"and {SCENES_VARIABLE} names no folder with scenes"
    known = ", ".join([DEMO, *there])
    raise SSGIError(f"there is no scene {name} {where}: give the path of a .blend file, or one of {known}")
