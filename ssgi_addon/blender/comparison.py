# SPDX-License-Identifier: GPL-3.0-or-later
"""Our picture beside Cycles' global illumination: metrics, and one sheet that shows both."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..exr import write_layers
from ..heatmap import error_map
from ..job_options import JobOptions
from ..last_result import reference_path
from ..results import Picture, measure_errors
from .display import to_display
from .reference import Reference, ReferenceOptions, render_reference
from .sheet import write_contact_sheet


def compare_with_cycles(
    scene: bpy.types.Scene,
    picture: Picture,
    record: dict[str, Any],
    options: JobOptions,
    stem: str,
    progress: Callable[[float, str], None],
) -> Path:
    """Render the reference of a frame, measure the picture's error and write the sheet.

    Parameters
    ----------
    scene
        Exactly as before afterwards, also after an error.
    picture
        Ours.
    record
        The frame's entry in the report; gets ``metrics`` and the reference's seconds.
    options
        The samples and the size of the reference, and the folder to write into.
    stem
        Name of the frame's files.
    progress
        Called with a fraction and a text; may raise to stop.

    Returns
    -------
    Path
        The sheet, ``<stem>_compare.png``; the reference itself is ``reference/<stem>.exr``.

    Raises
    ------
    SSGIError
        If the scene cannot be rendered, or a file cannot be written.
    """
    reference = render_reference(
        scene,
        ReferenceOptions(
            samples=options.reference_samples, resolution=options.resolution, frame=record["frame"]
        ),
        progress,
    )
    layers = {
        "combined": reference.combined,
        "diffuse": reference.diffuse_indirect,
        "glossy": reference.glossy_indirect,
    }
    write_layers(reference_path(options.output / f"{stem}.exr"), layers)
    record["metrics"] = measure_errors(
        picture, reference.combined, reference.diffuse_indirect, reference.glossy_indirect
    )
    record["seconds"]["reference"] = reference.seconds
    sheet_path = options.output / f"{stem}_compare.png"
    _write_sheet(scene, picture, reference, record, options, sheet_path)
    return sheet_path


def _write_sheet(
    scene: bpy.types.Scene,
    picture: Picture,
    reference: Reference,
    record: dict[str, Any],
    options: JobOptions,
    path: Path,
) -> None:
    """Write the sheet: direct only, ours, Cycles GI, error map, with metrics and seconds below."""
    panels = [
        ("Direct light only", to_display(scene, picture.frame.gbuffer.direct)),
        ("With indirect light (ours)", to_display(scene, picture.combined)),
        ("Cycles GI", to_display(scene, reference.combined)),
        ("Error of ours", error_map(picture.combined, reference.combined)),
    ]
    metrics, seconds = record["metrics"], record["seconds"]
    direct, ours = metrics["direct_only"], metrics["combined"]
    cells = [
        f"relMSE {direct['relmse']:.3g} · SSIM {direct['ssim']:.3f}",
        f"relMSE {ours['relmse']:.3g} · SSIM {ours['ssim']:.3f}",
        f"{reference.samples} samples · {reference.seconds:.1f} s",
        "",
    ]
    times = [
        f"light {seconds['light']:.1f} s, {options.samples} samples",
        f"total {seconds['total']:.1f} s: capture {seconds['capture']:.1f}, passes {seconds['passes']:.1f}",
        "",
        "",
    ]
    height, width = picture.combined.shape[:2]
    where = f"{Path(bpy.data.filepath).stem or scene.name}, frame {record['frame']}, {width} x {height}"
    note = f"{where} · {record['known']:.0%} of the samples answered by what was captured"
    write_contact_sheet(path, panels, ["\t".join(cells), "\t".join(times), note])
