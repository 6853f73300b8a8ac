# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure all methods of the benchmark on one scene, in turns, so that the machine's load hits all alike."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bench.methods import Method, cycles_method, shipped_preset, tiers
from ..bench.options import BenchOptions
from ..bench.scores import Scores, score
from ..bench.store import Record, SceneState, method_key, picture_path, scene_folder
from ..core.metrics import pixel_subsets
from ..core.types import BoolArray
from ..files import replacing
from ..heatmap import error_map
from ..job_options import DEFAULT_PRESET
from ..png import write_png
from . import compat
from .bench_reference import truth_of
from .bench_renders import INDIRECT, Run, borrow_bench, kind_of_state, run_method, why_not
from .display import to_display
from .gl_driver import missing_gl_driver, renderer_name
from .restore import Restorer

FloatArray = NDArray[np.float32]
Progress = Callable[[float, str], None]

# A run that takes longer says enough by itself: its warm-up is a single sample, and it is not repeated.
LONG_SECONDS = 12.0
_REFERENCE_SHARE = 0.2
# Of the time that is left: a round of timed runs takes a little longer than that of the warm-ups.
_WARM_UP_SHARE = 0.45
_PASS_NAMES = ("diffuse", "glossy")


class SceneBench:
    """Measures methods on an open scene, which is exactly as before afterwards.

    Parameters
    ----------
    scene
        Open.
    options
        What to measure.
    methods
        In the order of the report.
    state
        What is known already; filled and saved after each run.
    deadline
        `time.time` after which no measurement starts.
    progress
        Called with a fraction and a text; may raise to stop.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        options: BenchOptions,
        methods: Sequence[Method],
        state: SceneState,
        deadline: float,
        progress: Progress,
    ) -> None:
        self.scene, self.options, self.state, self.progress = scene, options, state, progress
        self.methods, self.deadline = methods, deadline
        self.folder = scene_folder(options, state.name)
        self.exposure = scene.view_settings.exposure
        # Pictures of direct light, to take from those with indirect light
        self.direct: dict[str, FloatArray] = {}
        # Pictures to show
        self.shown: dict[str, FloatArray] = {}
        self.warm: tuple[Any, ...] = ()
        self.done, self.planned = 0, 1

    def measure(self) -> None:
        """Measure all that is not known yet.

        Raises
        ------
        SSGIError
            If the scene cannot be rendered at all, or a result cannot be written.
        """
        with Restorer() as restorer:
            borrow_bench(restorer, self.scene, self.options.resolution)
            self.truth = truth_of(
                self.scene,
                self.state.key,
                self.options.reference_folder,
                self.options.resolution,
                self.options.reference_samples,
                lambda fraction, text: self.progress(_REFERENCE_SHARE * fraction, text),
            )
            self.mean = {
                name: getattr(self.truth, name).mean(axis=0) for name in ("combined", "direct", *_PASS_NAMES)
            }
            self.subsets = self._subsets()
            self._describe()
            self._measure_all([method for method in self.methods if method.kind != "eevee"])
        eevee = [method for method in self.methods if method.kind == "eevee"]
        if eevee and missing_gl_driver() is None:
            with Restorer() as restorer:
                borrow_bench(restorer, self.scene, self.options.resolution, compat.eevee_engine_id())
                self._measure_all(eevee)
            self.state.facts["opengl"] = renderer_name()
        else:
            self._measure_all(eevee)
        self._write_pictures()
        self._save()

    def _subsets(self) -> dict[str, dict[str, BoolArray]]:
        """Return the parts of the pixels for each target: what the default preset could answer, for all."""
        path = self.folder / "known.npz"
        preset = shipped_preset(DEFAULT_PRESET)
        key = method_key(preset, self.state.key, self.options)
        known: dict[str, FloatArray] = {}
        if path.is_file():
            with np.load(path) as kept:
                if str(kept["key"]) == key:
                    known = {name: kept[name] for name in _PASS_NAMES}
        if not known:
            self.progress(_REFERENCE_SHARE, "What rays can answer")
            light = run_method(self.scene, preset, self.options.resolution).picture.light
            known = {"diffuse": light.known_diffuse, "glossy": light.known_glossy}
            with replacing(path) as temporary, temporary.open("wb") as file:
                np.savez(file, key=np.array(key), **known)
        known["picture"] = np.minimum(known["diffuse"], known["glossy"])
        return {name: pixel_subsets(self.truth.depth, known[name]) for name in ("picture", *_PASS_NAMES)}

    def _describe(self) -> None:
        """Note what the reference and the scene are."""
        truth, state = self.truth, self.state
        nothing = score(self.mean["direct"], self.mean["combined"], self.subsets["picture"], self.exposure)
        state.reference = {
            "samples": 2 * self.options.reference_samples,
            "seconds": float(truth.seconds),
            "own_error": truth.own_errors(),
            "is_denoised": compat.has_denoiser(self.scene),
            "without_indirect": nothing,
        }
        state.facts = {
            "resolution": list(self.options.resolution),
            "known": {name: float(parts["known"].mean()) for name, parts in self.subsets.items()},
            "blender": bpy.app.version_string,
        }
        self._save()

    def _measure_all(self, methods: Sequence[Method]) -> None:
        """Measure methods of one engine: all in turns, or the main ones first where time is short."""
        pending = [method for method in methods if self._is_pending(method)]
        self.done, self.planned = 0, max(1, len(pending) * (1 + self.options.repeats))
        for tier in tiers(pending) if self.options.minutes else [pending]:
            self._take_turns(tier)

    def _take_turns(self, pending: Sequence[Method]) -> None:
        """Warm each method up, then run all in turns until each has its timed runs."""
        now = time.time()
        # What is warm shall be timed, too
        until = now + _WARM_UP_SHARE * (self.deadline - now)
        for method in pending:
            self._guarded(method, self._warm_up, until)
        warm = [method for method in pending if method.name not in self.state.left_out]
        for _ in range(self.options.repeats):
            for method in warm:
                self._guarded(method, self._timed, self.deadline)

    def _is_pending(self, method: Method) -> bool:
        """Return whether a method is to be run; note why not."""
        record = self._record(method)
        reason = why_not(self.scene, method, missing_gl_driver())
        if reason is not None:
            self.state.left_out[method.name] = reason
            return False
        return record.failure is None and len(record.seconds) < self._wanted(record)

    def _record(self, method: Method) -> Record:
        return self.state.record(method, method_key(method, self.state.key, self.options))

    def _wanted(self, record: Record) -> int:
        """Return how many timed runs a method gets."""
        is_long = record.seconds and min(record.seconds) > LONG_SECONDS
        return 1 if is_long else self.options.repeats

    def _guarded(self, method: Method, work: Callable[[Method], None], until: float) -> None:
        """Run a method if that begins in time; what goes wrong is its own affair."""
        self.done += 1
        record = self._record(method)
        if record.failure is not None or len(record.seconds) >= self._wanted(record):
            return
        if time.time() >= until:
            if not record.seconds:
                self.state.left_out[method.name] = "the time was up"
            return
        self.state.left_out.pop(method.name, None)
        share = _REFERENCE_SHARE + (1.0 - _REFERENCE_SHARE) * self.done / self.planned
        self.progress(min(share, 1.0), method.name)
        self.state.running = method.name
        self._save()
        try:
            work(method)
        except Exception as error:
            traceback.print_exc()
            record.failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
            self.warm = ()
        self.state.running = None
        self._save()

    def _warm_up(self, method: Method) -> None:
        """Run a method so that the next run finds all warm; a long run of a rival counts."""
        if method.kind == "cycles":
            self._settle(method)
        run = self._run(method)
        if method.kind == "cycles" and run.seconds > LONG_SECONDS:
            self._keep(method, run)
        if method.light == "direct":
            self.direct[method.name] = run.combined
        if method.kind == "cycles" and method.denoiser == "raw" and method.light != "direct":
            layers = self._run(method, passes=INDIRECT).layers
            passes = zip(_PASS_NAMES, INDIRECT, strict=True)
            self._record(method).passes = {name: self._score(name, layers[long]) for name, long in passes}

    def _timed(self, method: Method) -> None:
        self._settle(method)
        self._keep(method, self._run(method))

    def _settle(self, method: Method) -> None:
        """Leave the engine as a run of this kind leaves it: what another kind changed is not its cost."""
        if self.warm != kind_of_state(method):
            self._run(method, samples=1 if method.kind == "cycles" else None)

    def _run(self, method: Method, **changes: Any) -> Run:
        run = run_method(self.scene, method, self.options.resolution, **changes)
        self.warm = kind_of_state(method)
        return run

    def _keep(self, method: Method, run: Run) -> None:
        """Note a timed run; the picture that counts is that of the fastest."""
        record = self._record(method)
        if not record.add_run(run.seconds):
            return
        is_same = method.kind != "ours" and record.best  # the same seed gives the same picture
        scores = record.best["scores"] if is_same else self._scores(method, run)
        record.best = {"seconds": run.seconds, "memory_mb": run.memory_mb, "scores": scores}
        if run.picture is not None:
            frame, light = run.picture.frame, run.picture.light
            record.best |= {
                "beyond_direct": run.seconds - frame.seconds["light"],
                "passes": sum(light.seconds.values()),
                "steps": {**frame.seconds, **light.seconds},
                "known": float(light.known.mean(dtype=np.float64)),
                "notes": [f"{what}: {why}" for what, why in (*frame.skipped, *light.skipped)],
            }
        if method.headline:
            self.shown[method.name] = run.combined

    def _scores(self, method: Method, run: Run) -> dict[str, Scores]:
        scores = {"picture": self._score("picture", run.combined)}
        if run.picture is not None:
            scores |= {name: self._score(name, getattr(run.picture.light, name)) for name in _PASS_NAMES}
            direct = run.picture.frame.gbuffer.direct
        elif method.direct_partner is not None:
            direct = self._direct_picture(method)
        else:
            return scores
        replaced = self.mean["direct"] + (run.combined - direct)
        return {**scores, "replaced": self._score("picture", replaced)}

    def _direct_picture(self, method: Method) -> FloatArray:
        """Return Cycles' direct light of a method's samples and denoising."""
        name = method.direct_partner
        if name not in self.direct:
            partner = cycles_method("direct", method.samples, method.denoiser)
            self.direct[name] = self._run(partner).combined
        return self.direct[name]

    def _score(self, target: str, image: FloatArray) -> Scores:
        reference = self.mean["combined" if target == "picture" else target]
        return score(image, reference, self.subsets[target], self.exposure)

    def _write_pictures(self) -> None:
        """Write what the report shows: the reference, the main methods, and where they err."""
        reference = self.mean["combined"]
        write_png(self.folder / "reference.png", to_display(self.scene, reference))
        for method in self.methods:
            record = self._record(method)
            path = picture_path(self.folder, method.name)
            if not method.headline or not record.seconds:
                continue
            if method.name not in self.shown and not path.is_file():
                self.shown[method.name] = run_method(self.scene, method, self.options.resolution).combined
            if method.name in self.shown:
                write_png(path, to_display(self.scene, self.shown[method.name]))
                errors = error_map(self.shown[method.name], reference)
                write_png(picture_path(self.folder, method.name, "error"), errors)

    def _save(self) -> None:
        self.state.save(self.folder)
