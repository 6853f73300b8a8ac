# SPDX-License-Identifier: GPL-3.0-or-later
"""A made-up run of the benchmark: two scenes, every method, figures that follow from the samples."""

from __future__ import annotations

from ssgi_addon.bench.methods import all_methods
from ssgi_addon.bench.scores import METRICS, SUBSETS
from ssgi_addon.bench.store import Record, SceneState

METHODS = all_methods(quick=True)
OWN_ERROR = 1e-3
# Seconds and error of one sample, by kind
ONE_SAMPLE = {"cycles": (0.5, 0.08), "ours": (1.0, 0.05), "eevee": (2.0, 0.1)}


def scores(error: float) -> dict[str, dict[str, float | None]]:
    return {subset: {metric: None if metric == "flip" else error for metric in METRICS} for subset in SUBSETS}


def made_up_state(name: str, scale: float = 1.0) -> SceneState:
    """All methods but one, which failed; errors are `scale` times those of another scene."""
    state = SceneState(name, "key")
    state.reference = {
        "samples": 64,
        "seconds": 10.0,
        "is_denoised": True,
        "own_error": {"combined": OWN_ERROR, "diffuse": 0.01, "glossy": 0.01},
        "without_indirect": scores(0.4),
    }
    state.facts = {"resolution": [8, 4], "known": {"picture": 0.6, "diffuse": 0.7, "glossy": 0.5}}
    for method in METHODS[:-1]:
        seconds, error = ONE_SAMPLE[method.kind]
        seconds *= 0.5 * method.samples if method.light == "direct" else method.samples
        error *= scale / method.samples
        targets = ("picture", "replaced", "diffuse", "glossy") if method.kind == "ours" else ("picture",)
        if method.direct_partner is not None:
            targets = ("picture", "replaced")
        best = {
            "seconds": seconds,
            "memory_mb": 500.0,
            "scores": {target: scores(error) for target in targets},
        }
        if method.kind == "ours":
            best |= {"beyond_direct": 0.5 * seconds, "passes": 0.3 * seconds}
        state.records[method.name] = Record("key", [1.1 * seconds, seconds], best)
    state.records[METHODS[-1].name] = Record("key", failure="SSGIError: no <light> & no camera")
    state.left_out["EEVEE 16"] = "EEVEE cannot render here: there is no libEGL"
    state.flicker = {"methods": {METHODS[0].name: {"rms": 1.5, "seconds": 0.7}}}
    return state
