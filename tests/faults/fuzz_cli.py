# SPDX-License-Identifier: GPL-3.0-or-later
"""Hand damaged files to the commands `apply` and `compare`, case after case, and say what each did wrong.

It runs in a process of its own, since a library that crashes takes its process along:
``python -m tests.faults.fuzz_cli FOLDER FIRST COUNT`` prints a line of JSON before and after each case.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ssgi_addon.child import environment
from ssgi_addon.cli import main
from ssgi_addon.core import Camera, Environment, Fill, GBuffer, Settings
from ssgi_addon.exr import read_layers, write_layers
from ssgi_addon.frame import CapturedFrame
from ssgi_addon.passes import write_passes
from tests.faults.mutations import damaged_exr, damaged_json

ROOT = Path(__file__).resolve().parents[2]
SEED = 20240229
WIDTH, HEIGHT = 20, 12
# Resident memory that one case may add, bytes: what a header may ask for (256 MB as the file has it, as
# float32, and once more in its window), and what Python and numpy keep from case to case.
MOST_MEMORY = 1 << 30
_CRASH = "crashed"


@dataclass
class Outcome:
    """What a run of cases gave: how many ended how, and what was wrong, by the number of the case."""

    ended: Counter[str] = field(default_factory=Counter)
    faults: dict[int, str] = field(default_factory=dict)
    largest_growth: int = 0


def run_cases(folder: Path, first: int, count: int) -> Outcome:
    """Run cases in processes of their own; one that crashes is a fault, and the next one goes on after it."""
    make_good_files(folder / "good")
    outcome, index = Outcome(), first
    while index < first + count:
        command = [sys.executable, "-m", "tests.faults.fuzz_cli", folder, index, first + count - index]
        done = subprocess.run(
            [*map(str, command)], cwd=ROOT, env=environment(), capture_output=True, text=True, check=False
        )
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        begun = max((line["begun"] for line in lines if "begun" in line), default=index)
        for line in lines:
            if "ended" in line:
                outcome.ended[line["ended"]] += 1
                outcome.largest_growth = max(outcome.largest_growth, line["growth"])
                if line["fault"]:
                    outcome.faults[line["case"]] = line["fault"]
        if done.returncode == 0:
            break
        outcome.ended[_CRASH] += 1
        outcome.faults[begun] = f"{_CRASH} ({done.returncode}): {done.stderr[-2000:]}"
        index = begun + 1
    return outcome


def make_good_files(folder: Path) -> None:
    """Write passes of our own with all that they can hold, Blender's in several layouts, and two pictures."""
    rng = np.random.default_rng(SEED)
    settings = Settings.preset("draft")
    write_passes(_own_frame(rng), folder / "own", "a_0001", settings)
    layers, camera = _blender_layers(rng)
    for name, kind in (("zip", "single"), ("piz", "parts"), ("half", "half"), ("tiled", "tiled")):
        _write_as(folder / name / "a.exr", layers, kind)
    (folder / "camera").mkdir(parents=True, exist_ok=True)
    _write_as(
        folder / "camera" / "a.exr", {name: v for name, v in layers.items() if name != "Position"}, "single"
    )
    (folder / "camera" / "camera.json").write_text(json.dumps({"camera": camera}))
    picture = rng.uniform(0, 2, (HEIGHT, WIDTH, 3)).astype(np.float32)
    known = rng.uniform(0, 1, (HEIGHT, WIDTH)).astype(np.float32)
    write_layers(
        folder / "pictures" / "image.exr", {"combined": picture, "known": known}, {"Software": "ssgi"}
    )
    write_layers(folder / "pictures" / "reference.exr", {"Combined": picture * 1.1})


def large_passes(folder: Path) -> Path:
    """Write passes of a frame that takes some tens of megabytes to compute, by one thread.

    Where memory runs out, Python may wait forever for a thread that could not start.
    """
    camera, gbuffer = _view(np.random.default_rng(SEED), 640, 360)
    frame = CapturedFrame(gbuffer, camera, None, "cycles", True, True)
    return write_passes(frame, folder / "passes", "a_0001", replace(Settings.preset("draft"), threads=1))


def _own_frame(rng: np.random.Generator) -> CapturedFrame:
    camera, gbuffer = _view(rng, WIDTH, HEIGHT)
    small, other = _view(rng, 8, 6)
    fill = Fill(other.depth, other.normal, other.direct, other.albedo, small, 4.0, is_denoised=True)
    sky = Environment.equirectangular(rng.uniform(0, 1, (4, 8, 3)), np.eye(4))
    return CapturedFrame(
        gbuffer, camera, sky, "cycles", True, True, views=((other, small),), view_names=("surround",),
        seconds={"light": 0.5}, notes=("a note",), fill=fill,
    )  # fmt: skip


def _view(rng: np.random.Generator, width: int, height: int) -> tuple[Camera, GBuffer]:
    camera = Camera.perspective(width, height, 1.0)
    normal = rng.normal(size=(height, width, 3)) + np.array([0, 0, 2])
    light = {
        name: rng.uniform(0, 1, (height, width, 3)) for name in ("albedo", "specular", "direct", "source")
    }
    depth, roughness = rng.uniform(2, 4, (height, width)), rng.uniform(0, 1, (height, width))
    return camera, GBuffer(depth=depth, normal=normal, roughness=roughness, **light)


def _blender_layers(rng: np.random.Generator) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    camera, gbuffer = _view(rng, WIDTH, HEIGHT)
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    names = ("Diffuse Color", "Diffuse Direct", "Glossy Color", "Glossy Direct", "Emission", "Environment")
    layers = {name: rng.uniform(0, 1, (HEIGHT, WIDTH, 3)) for name in names}
    layers |= {
        "Depth": gbuffer.depth,
        "Normal": gbuffer.normal,
        "Position": camera.pixel_to_view(x, y, gbuffer.depth),
    }
    told = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    pose = camera.world_from_view.tolist()
    named = {"projection": "perspective", **told, "world_from_view": pose}
    return {name: np.float32(values) for name, values in layers.items()}, named


def _write_as(path: Path, layers: dict[str, np.ndarray], kind: str) -> None:
    """Write passes as Blender 4.5 (one part) or 5.x (parts) has them, as half floats, or in tiles."""
    import OpenEXR

    path.parent.mkdir(parents=True, exist_ok=True)
    dtype = np.float16 if kind == "half" else np.float32
    channels: dict[str, dict[str, np.ndarray]] = {}
    for name, values in layers.items():
        letters = "Z" if values.ndim == 2 else "XYZ" if name in ("Normal", "Position") else "RGB"
        planes = values[..., None] if values.ndim == 2 else values
        channels[name] = {
            f"View.Layer.{name}.{letter}": np.ascontiguousarray(planes[..., index], dtype)
            for index, letter in enumerate(letters)
        }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if kind == "parts":
        header["compression"] = OpenEXR.PIZ_COMPRESSION
        parts = [OpenEXR.Part({**header, "name": name}, planes) for name, planes in channels.items()]
        OpenEXR.File(parts).write(str(path))
        return
    if kind == "tiled":
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    together = {name: plane for planes in channels.values() for name, plane in planes.items()}
    OpenEXR.File(header, together).write(str(path))


def run_case(good: Path, work: Path, index: int) -> tuple[str, str]:
    """Damage a file by the case's number and run a command on it; return how it ended and what was wrong."""
    rng = np.random.default_rng([SEED, index])
    kinds = ("own", "own", "json", "zip", "piz", "half", "tiled", "camera", "pictures", "pictures")
    kind = kinds[rng.integers(len(kinds))]
    shutil.copytree(good / ("own" if kind == "json" else kind), work / "in")
    if kind == "pictures":
        return _compare_case(work, rng)
    target = _target(work / "in", kind, rng)
    _damage(target, rng)
    line = ["apply", str(next((work / "in").glob("a*.exr"))), "--output", str(work / "out" / "b.exr")]
    if kind == "own":
        line[1] = str(work / "in" / "a_0001.exr")
    if kind == "camera":
        line += ["--camera", str(work / "in" / "camera.json")]
    return _run(work, [*line, "--rays", "1"], work / "out" / "b.exr")


def _target(folder: Path, kind: str, rng: np.random.Generator) -> Path:
    names = {"json": "*.json", "camera": "camera.json"}
    files = sorted(folder.glob(names.get(kind, "*.exr")))
    return files[rng.integers(len(files))]


def _damage(path: Path, rng: np.random.Generator) -> None:
    if path.suffix == ".json":
        path.write_text(damaged_json(path.read_text(), rng), "utf-8", "surrogatepass")
    else:
        path.write_bytes(damaged_exr(path.read_bytes(), rng))


def _compare_case(work: Path, rng: np.random.Generator) -> tuple[str, str]:
    image, reference = work / "in" / "image.exr", work / "in" / "reference.exr"
    _damage(image if rng.random() < 0.5 else reference, rng)
    heatmap = work / "out" / "error.png"
    return _run(work, ["compare", str(image), str(reference), "--heatmap", str(heatmap)], heatmap)


def _run(work: Path, line: list[str], output: Path) -> tuple[str, str]:
    """Run a command with what it and its libraries print kept; judge how it ended."""
    before = _hashes(work / "in")
    with _captured() as texts:
        try:
            code: int | str = main(line)
        except BaseException:
            code = traceback.format_exc()
    out, err = texts
    fault = _fault(code, out, err, output)
    if _hashes(work / "in") != before:
        fault = fault or "an input was changed"
    left = [path.name for path in work.rglob("*") if path.name.endswith(".tmp")]
    if left:
        fault = fault or f"left {left}"
    ended = {0: "result", 1: "error"}.get(code, "traceback")
    return ended, f"{fault}\n{line}\n{out}\n{err}" if fault else ""


def _fault(code: int | str, out: str, err: str, output: Path) -> str:
    said = [line for line in err.splitlines() if not line[:4].strip().endswith("%")]
    if code == 0:
        if said:
            return "a success said something"
        if output.suffix == ".exr":
            layers = read_layers(output)
            if not all(np.isfinite(values).all() and values.min() >= 0 for values in layers.values()):
                return "the result holds bad pixels"
        return "" if output.is_file() else "there is no result"
    if code != 1:
        return str(code)
    if out or len(said) != 1 or not said[0].startswith("ssgi: error: ") or not said[0].isprintable():
        return "not one clear line"
    return "a failure left a result" if output.parent.exists() and list(output.parent.iterdir()) else ""


@contextmanager
def _captured() -> Iterator[list[str]]:
    """Keep what is printed, by libraries that know no Python, too."""
    texts: list[str] = []
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        sys.stdout.flush()
        sys.stderr.flush()
        kept = os.dup(1), os.dup(2)
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        try:
            yield texts
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for number, file in zip((1, 2), kept):
                os.dup2(file, number)
                os.close(file)
            for file in (out, err):
                file.seek(0)
                texts.append(file.read().decode("utf-8", "replace"))


def _hashes(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha1(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def _resident(name: str) -> int:
    """Return a line of what Linux tells of this process's memory, bytes; 0 where it tells nothing."""
    with suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        return int(next(line for line in lines if line.startswith(name)).split()[1]) << 10
    return 0


def _begin_peak() -> int:
    """Let the largest resident size be that from now on; return the present one."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _resident("VmRSS")


def _work(folder: Path, first: int, count: int) -> None:
    warnings.simplefilter("always")
    for index in range(first, first + count):
        print(json.dumps({"begun": index}), flush=True)
        work = Path(tempfile.mkdtemp(dir=folder))
        resident = _begin_peak()
        ended, fault = run_case(folder / "good", work, index)
        growth = _resident("VmHWM") - resident
        if growth > MOST_MEMORY:
            fault = fault or f"it took {growth >> 20} MB"
        shutil.rmtree(work)
        told = {"case": index, "ended": ended, "fault": fault, "growth": growth}
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    _work(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
