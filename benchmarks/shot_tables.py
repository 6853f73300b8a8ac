# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of docs/farms.md, from what the benchmarks of shots have stored.

python -m benchmarks.shot_tables
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from benchmarks.inputs import ROOT
from benchmarks.shot_folder import PHASES
from ssgi_addon.files import read_json

_PARTS = {
    "prepare": "prepare",
    "task": "a task, beside its frames",
    "frame": "a frame",
    "merge": "merge",
    "merged_frame": "merge, a frame",
}


def main() -> None:
    for name, make in TABLES.items():
        print(f"{name}\n\n{make()}\n")


def results_of(name: str) -> Mapping[str, Any]:
    """Return the stored results of a benchmark of shots."""
    return read_json(ROOT / "benchmarks" / "results" / f"shot_{name}.json")["results"]


def kills_table() -> str:
    """Return what stops did."""
    results = results_of("kills")
    all_kills, disk = results["kills"], results["full_disk"]
    kills = [kill for kill in all_kills["kills"] if kill["phase"]]
    hit = (sum(kill["phase"] == phase for kill in kills) for phase in PHASES)
    halves = sum(bool(kill["half_written"] or kill["has_begun_another"]) for kill in kills)
    kept = sum(kill["finished"] for kill in kills)
    rows = [
        ("a kill", len(kills), *hit, halves, kept, all_kills["rendered"], len(all_kills["faults"])),
        ("a full disk", 1, "", 1, "", "", disk["kept"], disk["rendered"], len(disk["faults"])),
    ]
    head = ("stopped by", "times", *(f"in {phase}" for phase in PHASES), "with files half written")
    return _table((*head, "frames kept", "rendered after", "faults"), rows)


def scaling_table() -> str:
    """Return frames per minute, and what tasks took beside their frames."""
    rows = [
        (
            scene, name, f"{run['frames_per_minute']:.2f}", f"{run['frame']:.2f} s", f"{run['first']:.2f} s",
            f"{run['beside']:.2f} s", f"{run['beside_share']:.0%}",
        )
        for scene, found in results_of("scaling").items()
        for name, run in found["runs"].items()
    ]  # fmt: skip
    head = ("scene", "workers", "frames a minute", "a frame", "a task's first", "beside them", "share")
    return _table(head, rows)


def storage_table() -> str:
    """Return what the steps read, wrote and opened."""
    rows = [
        (scene, told, _mb(cost["read"]), _mb(cost["written"]), f"{cost['opened']:.0f}")
        for scene, found in results_of("storage").items()
        for told, cost in ((told, found["parts"][name]) for name, told in _PARTS.items())
    ]
    return _table(("scene", "part", "MB read", "MB written", "opened"), rows)


def check_table() -> str:
    """Return what the model predicted, and what was measured."""
    return _table(("scene", "workers", "", "predicted", "measured"), _checks())


def _checks() -> Iterator[Sequence[object]]:
    for scene, found in results_of("storage").items():
        for workers, check in found["checks"].items():
            for name, unit in (("read", "MB read"), ("written", "MB written"), ("opened", "opened")):
                told = [check[way][name] for way in ("predicted", "measured")]
                yield scene, workers, unit, *(f"{n:.0f}" if name == "opened" else _mb(n) for n in told)
    for scene, found in results_of("scaling").items():
        for workers, check in enumerate(found["check"].values(), 1):
            told = [f"{check[way]:.2f}" for way in ("predicted", "measured")]
            yield scene, workers, "frames a minute", *told


def farms_table() -> str:
    """Return what many workers take of the storage, and how long a shot is."""
    rows = []
    for scene, found in results_of("scaling").items():
        for farm in found["farms"]:
            for chunk in (name for name in farm if name.startswith("chunks")):
                told = farm[chunk]
                rows.append(
                    (
                        scene, f"{farm['workers']:,}", chunk.removeprefix("chunks of "),
                        f"{told['read_mb_per_second']:.1f} + {told['written_mb_per_second']:.1f}",
                        f"{told['opened_per_second']:.0f}",
                        f"{told['workers_of_1_gbit']:,} / {told['workers_of_10_gbit']:,}",
                        f"{farm['frames']:,}", f"{told['seconds'] / 60:.1f} min",
                        f"{told['alone_seconds'] / told['seconds']:.1f}",
                        f"{told['prepare_share_of_seconds']:.0%}", f"{told['merge_share_of_seconds']:.0%}",
                    )
                )  # fmt: skip
    head = (
        "scene", "workers", "chunk", "MB/s read + written", "opened/s", "full at workers, 1 / 10 Gbit/s",
        "frames", "shot takes", "× one worker", "prepare", "merge",
    )  # fmt: skip
    return _table(head, rows)


TABLES = {
    "kills": kills_table,
    "scaling": scaling_table,
    "storage": storage_table,
    "check": check_table,
    "farms": farms_table,
}


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def _mb(count: float) -> str:
    return f"{max(count, 0.0) / 1e6:.2f}"  # frames differ a little, and so does what is left for a task


if __name__ == "__main__":
    main()
