# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the tables of ``README.md`` from the stored results of the benchmarks.

Run from the repository's root: ``python -m benchmarks.summary``. What stands between the comments
``<!-- NAME -->`` and ``<!-- /NAME -->`` is replaced.
"""

from __future__ import annotations

import re
import statistics
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.frontier_plot import Point, on_frontier
from ssgi_addon.files import read_json

FOLDER = Path(__file__).parent
Record = Mapping[str, Any]


def tracer_speed(record: Record) -> str:
    """Return the table of `tracer_speed`."""
    what = record["parameters"]
    size = "{} × {}".format(*what["size"])
    text = f"{what['scene']}, {size}, {what['rays']:,} rays, {what['threads']} threads. {_where(record)}"
    head = (
        "walk",
        "seconds",
        "spread",
        "ns/ray",
        "cells/ray",
        "× linear",
        "× compiled",
        "differ from linear",
    )
    rows = [
        (
            row["method"],
            f"{row['seconds']:.2f}",
            f"{row['spread']:.0%}",
            f"{row['ns_per_ray']:.0f}",
            f"{row['cells_per_ray']:.1f}",
            f"{row['times_faster_than_linear']:.2f}",
            f"{row['times_slower_than_compiled']:.2f}",
            f"{row['differ_from_linear']:.4%}",
        )
        for row in record["results"]
    ]
    first = record["results"][0]
    shares = ", ".join(f"{first[name]:.1%} {name}" for name in ("hit", "blocked", "escaped", "unknown"))
    return f"{text}\nOf the rays {shares}.\n\n{_table(head, rows)}"


def scaling(record: Record) -> str:
    """Return the table of `scaling`."""
    what = record["parameters"]
    text = f"{what['scene']}, {what['threads']} threads. {_where(record)}"
    head = ("work", "size", "seconds", "spread", "ns/pixel", "resident bytes/pixel", "allocated bytes/pixel")
    rows = [
        (
            work,
            f"{row['width']} × {row['height']}",
            f"{row['seconds']:.2f}",
            f"{row['spread']:.0%}",
            f"{row['seconds'] / (row['width'] * row['height']) * 1e9:.0f}",
            "–" if row["resident_bytes"] is None else f"{row['resident_bytes']:.0f}",
            f"{row['allocated_bytes']:.0f}",
        )
        for work, found in record["results"].items()
        for row in found["sizes"]
    ]
    growth = ", ".join(
        f"{work}: seconds ~ pixels^{found['exponent']:.2f}"
        for work, found in record["results"].items()
        if found["exponent"] is not None
    )
    return f"{text}\n{growth}.\n\n{_table(head, rows)}"


def diffuse_quality(record: Record) -> str:
    """Return the table of `diffuse_quality` against the frame alone."""
    what, overall = record["parameters"], record["results"]["overall"]
    scenes = dict.fromkeys(score["scene"] for score in record["results"]["scores"])
    noise = max(score["noise"] for score in record["results"]["scores"])
    text = (
        f"{', '.join(scenes)}; {{}} × {{}}, {what['truth_rays']} rays, whose noise adds at most {noise:.4f} "
        f"to a scene's relMSE. {_where(record)}"
    ).format(*what["size"])
    head = ("variant", "seconds", "relMSE", "|bias|, median", "worst bias", "visibility off by", "frontier")
    is_best = on_frontier([Point("", "", row["seconds"], row["relmse"]) for row in overall.values()])
    rows = [
        (
            f"`{variant}`",
            f"{row['seconds']:.3f}",
            f"{row['relmse']:.4f}",
            f"{row['median_bias']:.1%}",
            f"{row['worst_bias']:+.1%}",
            f"{row['visibility_error']:.4f}",
            "yes" if best else "",
        )
        for (variant, row), best in zip(overall.items(), is_best)
    ]
    return f"{text}\n\n{_table(head, rows)}"


def diffuse_cycles(record: Record) -> str:
    """Return the table of `diffuse_quality` against Cycles."""
    what = record["parameters"]
    text = "{} × {}, {} samples of Cycles. {}".format(*what["size"], what["samples"], _where(record))
    median = "; ".join(
        f"`{variant}`: {row['median_bias']:.1%}" for variant, row in record["results"]["overall"].items()
    )
    head = ("scene", "variant", "pixels", "relMSE", "bias", "of it noise of Cycles")
    rows = [
        (
            row["scene"],
            f"`{row['variant']}`",
            f"{row['pixels']:,}",
            f"{row['relmse']:.4f}",
            f"{row['bias']:+.1%}",
            f"{row['noise']:.4f}",
        )
        for row in record["results"]["scores"]
    ]
    return f"{text}\nMedian over the scenes of the bias' size: {median}.\n\n{_table(head, rows)}"


def beyond_frame(record: Record) -> str:
    """Return the tables of `beyond_frame`: all scenes together, and the picture's error scene by scene."""
    what, results = record["parameters"], record["results"]
    text = "{} × {}, {} rays a scene, light of the `{}` preset, {} samples of Cycles. {}".format(
        *what["size"], what["rays"], what["preset"], what["samples"], _where(record)
    )
    biases: dict[str, list[float]] = {name: [] for name in results["overall"]}
    for score in results["scores"]:
        if score["light"]["known_bias"] is not None:
            biases[score["configuration"]].append(abs(score["light"]["known_bias"]))
    head = ("captured", "known", "hits right", "diffuse", "picture", "bias where known")
    rows = [
        (
            name,
            f"{row['known']:.1%}",
            f"{row['hits_right']:.1%}",
            f"{row['diffuse']:.3f}",
            f"{row['picture']:.3f}",
            f"{statistics.median(biases[name]):.1%}",
        )
        for name, row in results["overall"].items()
    ]
    scenes = tuple(dict.fromkeys(score["scene"] for score in results["scores"]))
    found = {(score["scene"], score["configuration"]): score for score in results["scores"]}
    by_scene = [
        (
            name,
            *(f"{found[one, name]['light']['picture']:.3f}" for one in scenes),
        )
        for name in results["overall"]
    ]
    known = [
        (name, *(f"{found[one, name]['rays']['known']:.0%}" for one in scenes)) for name in results["overall"]
    ]
    return "\n\n".join(
        [
            text,
            _table(head, rows),
            "Error of the picture, relative to no indirect light:",
            _table(("captured", *scenes), by_scene),
            "Share of the rays that are answered:",
            _table(("captured", *scenes), known),
        ]
    )


def tuning(record: Record) -> str:
    """Return the tables of `tuning`: what each value gained, and what was taken on all scenes."""
    what, results = record["parameters"], record["results"]
    noise = ", ".join(f"{case} {value:.1%}" for case, value in results["noise"].items())
    text = (
        f"{{}} × {{}}, {what['samples']} samples of Cycles. Tuned on {', '.join(what['tuning'])}; held out: "
        f"{', '.join(what['held_out'])}. Seeds differ by: {noise}. {_where(record)}"
    ).format(*what["size"])
    tried: dict[str, list[Record]] = {}
    for point in results["points"]:
        tried.setdefault(point["parameter"], []).append(point)
    rows = []
    for name, points in tried.items():
        looks = [point for point in points if point["held_out_gain"] is None]
        checks = [point for point in points if point["held_out_gain"] is not None]
        rows.append(
            (
                f"`{name}`",
                f"{points[0]['present']}",
                "; ".join(f"{one['value']}: {one['gain']:+.1%} ({one['worst']:+.1%})" for one in looks),
                "; ".join(f"{one['value']}: {one['held_out_gain']:+.1%}" for one in checks),
                ", ".join(f"{one['value']}" for one in checks if one["taken"]),
            )
        )
    together = [
        (row["case"], row["half"], *(f"{row[name]:+.1%}" for name in ("gain", "worst")))
        for row in results["verified"]
    ]
    head = ("parameter", "now", "tried: gain (worst picture)", "gain held out", "passes")
    parts = [text, _table(head, rows)]
    changes = ", ".join(f"`{name}` = {value}" for name, value in results["taken"].items())
    if together:
        parts.append(f"Together, {changes}, on both halves:")
        parts.append(_table(("light", "half", "gain", "worst picture"), together))
    return "\n\n".join(parts)


TABLES: dict[str, Callable[[Record], str]] = {
    "tracer_speed": tracer_speed,
    "scaling": scaling,
    "diffuse_quality": diffuse_quality,
    "diffuse_cycles": diffuse_cycles,
    "beyond_frame": beyond_frame,
    "beyond_frame_cornell": beyond_frame,
    "tuning": tuning,
}


def _where(record: Record) -> str:
    machine, versions = record["machine"], record["versions"]
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gb']:.0f} GB; "
        f"Python {versions['python']}, numpy {versions['numpy']}; "
        f"commit {versions['commit']}, {record['date'][:10]}."
    )


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = tuple(head)
    lines = (head, ["---"] * len(head), *rows)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Replace the tables whose results are stored."""
    readme = FOLDER / "README.md"
    text = readme.read_text(encoding="utf-8")
    for name, table in TABLES.items():
        path = FOLDER / "results" / f"{name}.json"
        if path.is_file():
            new = f"<!-- {name} -->\n{table(read_json(path))}\n<!-- /{name} -->"
            text = re.sub(f"<!-- {name} -->.*<!-- /{name} -->", lambda _, new=new: new, text, flags=re.DOTALL)
    readme.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
