# SPDX-License-Identifier: GPL-3.0-or-later
"""Capture what lies beyond the frame, as far as its rays need it and the budget allows.

What is taken depends on the frame and the options alone: the budget is counted in work, never in seconds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import bpy

from ..core import Camera, Settings
from ..core.planner import is_colored
from ..core.stations import LostRays, find_lost_rays
from ..frame import CapturedFrame
from ..surface_light import seen_from_elsewhere
from ..view_cameras import overscan_camera, square_camera, surround_cameras
from .capture_costs import QUICK_PASS, RENDER_START, fill_work, render_work
from .capture_options import CaptureOptions
from .engines import Engine
from .fill import capture_fill, denoised_fill
from .hidden_surfaces import Take, add_hidden_surfaces
from .kept_world import KeptWorld
from .light_views import light_cameras
from .views import borrow_cameras, capture_views

Progress = Callable[[float, str], None]

# Views that do not look from the frame's place.
_ELSEWHERE = ("stations", "lights")
# Fewer rays than this share are not worth a render.
LEAST_LOST = 0.02
# Lobes of less roughness show single things, and colours from here on show them well; fewer pixels with both
# than this share of the picture are no mirrors worth a render.
_SHARP, _SHINING, LEAST_MIRRORS = 0.12, 0.1, 0.005


class BeyondTheFrame:
    """Adds to a captured frame, one kind after the other: each is left out that has nothing to win.

    A quick pass of some thousand rays tells how many leave the frame, and how many are lost behind things.
    What is left out, and why, is noted in the frame.

    Parameters
    ----------
    engine, scene, view_layer
        Set up by `borrow_scene`; exactly as before afterwards, also after an error.
    options
        What to take at most, and with how much work.
    report
        Called with a fraction and a text before each render; an exception from it ends the capture.
    kept
        What earlier frames captured of this world, and where this one's captures are kept; None keeps none.
    """

    def __init__(
        self,
        engine: Engine,
        scene: bpy.types.Scene,
        view_layer: bpy.types.ViewLayer,
        options: CaptureOptions,
        report: Progress,
        kept: KeptWorld | None = None,
    ) -> None:
        self.kept = kept
        self.engine, self.scene, self.view_layer = engine, scene, view_layer
        self.options, self.report = options, report

    def added_to(self, frame: CapturedFrame) -> CapturedFrame:
        """Return the frame with views beyond it, and with what stands behind its surfaces.

        Raises
        ------
        SSGIError
            If a view cannot be rendered, or the render was cancelled.
        """
        options = self.options
        outward = {"surround": options.surround > 0, "overscan": options.overscan > 1.0}
        hidden = {
            "stations": options.stations > 0,
            "lights": options.light_views > 0,
            "back faces": options.back_faces,
            "behind": options.behind,
        }
        if not (options.fill or any(outward.values()) or any(hidden.values())):
            return frame
        if frame.gbuffer.is_background.all():
            return frame
        self.frame = frame
        self.lost: LostRays | None = None
        self.light_work = _work(frame.camera, options.samples)
        self.work_left = options.budget * self.light_work
        # What brings most for its work comes first
        if options.fill:
            self._fill()
        if self._has_kept_views():
            self._look_behind(around=False)
            return self.frame
        if not self._has_mirrors():
            names = ", ".join(name for name, is_wanted in (*outward.items(), *hidden.items()) if is_wanted)
            if names:
                self._leave_out(names, "few pixels are mirrors, and the fill brings the light of all else")
            return self.frame
        if self._needs(outward, lambda lost: lost.left):
            self._take("surround", self._surround())
            self._take("overscan", self._overscan())
        if self._needs(hidden, lambda lost: lost.share):
            self._take("stations", self._stations(), at_least=1)
            self._take("lights", self._lamps())
            self._look_behind()
        if self.kept is not None and self.frame.views:
            frame = self.frame
            self.kept.keep(frame.views, frame.view_names, self._look().share, self.scene.frame_current)
        return self.frame

    def _has_mirrors(self) -> bool:
        """Whether views are wanted: for all surfaces, or for what mirrors enough of them sharply."""
        if not self.options.mirrors_only or self.frame.fill is None:
            return True
        gbuffer = self.frame.gbuffer
        is_mirror = (gbuffer.roughness < _SHARP) & (gbuffer.specular.max(axis=-1) > _SHINING)
        return float(is_mirror.mean()) >= LEAST_MIRRORS

    def _has_kept_views(self) -> bool:
        """Go on with the views of an earlier frame where they answer this one's rays as well as its own."""
        kept = self.kept
        if kept is None or not kept.views:
            return False
        alone = self.frame
        self.frame = replace(alone, views=kept.views, view_names=kept.view_names)
        if self._look().share <= kept.lost + LEAST_LOST:
            self._leave_out(", ".join(dict.fromkeys(kept.view_names)), f"kept from frame {kept.frame}")
            return True
        self.frame, self.lost = replace(alone, seconds=self.frame.seconds), None
        return False

    def _fill(self) -> None:
        """Render the fill."""
        if self.engine.name != "cycles":
            note = "Only Cycles can render a fill: it is left out."
            self.frame = replace(self.frame, notes=(*self.frame.notes, note))
            return
        pixels = self.frame.camera.width * self.frame.camera.height
        if not self._affords("fill", fill_work(pixels, self.options.fill)):
            return
        self.report(0.6, "Fill")
        denoiser = self.options.fill_denoiser
        is_clean = denoiser != "none"
        fill, seconds = capture_fill(
            self.scene,
            self.view_layer,
            samples=self.options.fill,
            is_fine=is_clean,
            share=1.0 if self.kept is None else self.kept.fill_share,
        )
        begun = time.perf_counter()
        if is_clean:
            has_glossy = bool(is_colored(self.frame.gbuffer.specular).any())
            fill = denoised_fill(self.scene, fill, denoiser=denoiser, has_glossy=has_glossy)
        if self.kept is not None:
            # After the denoiser: what is carried from view to view is not the noise that it knows (ADR 25)
            fill = self.kept.averaged(fill)
        self._note_seconds("fill", seconds + time.perf_counter() - begun)
        self.frame = replace(self.frame, fill=fill)

    def _needs(self, wanted: dict[str, bool], share: Callable[[LostRays], float]) -> bool:
        """Return whether some of what is wanted has rays to win, and fits at all; note it where not."""
        names = ", ".join(name for name, is_wanted in wanted.items() if is_wanted)
        if not names:
            return False
        least = QUICK_PASS + RENDER_START
        if least > self.work_left:
            self._leave_out(names, self._too_dear(least))
            return False
        lost = share(self._look())
        if lost >= LEAST_LOST:
            return True
        self._leave_out(names, f"only {lost:.1%} of the rays need them")
        return False

    def _look(self) -> LostRays:
        """Return what the quick pass loses in the views that there are."""
        if self.lost is None:
            begun, frame = time.perf_counter(), self.frame
            self.lost = find_lost_rays(frame.gbuffer, frame.camera, frame.views, Settings())
            self._note_seconds("planning", time.perf_counter() - begun)
        return self.lost

    def _note_gain(self, *names: str) -> None:
        """Note by how much fewer rays are lost since the last look."""
        before = self._look().share
        self.lost = None
        gain = before - self._look().share
        self.frame = replace(self.frame, gains={**self.frame.gains, ", ".join(names): gain})

    def _take(self, name: str, cameras: Sequence[Camera], at_least: int | None = None) -> None:
        """Capture views, as many as the budget holds if that is no fewer than `at_least` (None: all)."""
        if not cameras:
            return
        least = len(cameras) if at_least is None else at_least
        views = [_work(camera, self.options.view_samples) for camera in cameras]
        costs = [QUICK_PASS + sum(views[:count]) for count in range(len(views) + 1)]
        affordable = max((count for count, cost in enumerate(costs) if cost <= self.work_left), default=0)
        if affordable < len(cameras):
            what = name if affordable < least else f"{len(cameras) - affordable} of {len(cameras)} {name}"
            self._leave_out(what, self._too_dear(costs[-1]))
        if affordable < least:
            return
        self.work_left -= costs[affordable]
        cameras = cameras[:affordable]
        views, seconds = capture_views(
            self.engine,
            self.scene,
            self.view_layer,
            cameras,
            samples=self.options.view_samples,
            denoiser=self.options.view_denoiser or self.options.denoiser,
            progress=lambda fraction: self.report(0.6 + 0.2 * fraction, name.capitalize()),
        )
        if name in _ELSEWHERE:
            views = tuple((seen_from_elsewhere(gbuffer), camera) for gbuffer, camera in views)
        self._note_seconds(name, seconds)
        self.frame = replace(
            self.frame,
            views=(*self.frame.views, *views),
            view_names=(*self.frame.view_names, *[name] * len(views)),
        )
        self._note_gain(name)

    def _overscan(self) -> list[Camera]:
        factor = self.options.overscan
        return [overscan_camera(self.frame.camera, factor)] if factor > 1.0 else []

    def _surround(self) -> list[Camera]:
        if not self.options.surround:
            return []
        nearest = float(self.frame.gbuffer.depth.min())
        clip_start = self.scene.camera.data.clip_start
        return surround_cameras(self.frame.camera, nearest, clip_start, self.options.surround)

    def _lamps(self) -> list[Camera]:
        return light_cameras(self.view_layer, self.frame, self.options.light_views, self.options.view_size)

    def _stations(self) -> list[Camera]:
        begun = time.perf_counter()
        poses = self._look().stations(self.options.stations)
        self._note_seconds("planning", time.perf_counter() - begun)
        return [square_camera(pose, self.options.view_size) for pose in poses]

    def _look_behind(self, around: bool = True) -> None:
        """Capture thickness and the layer behind: of all views, or of the frame alone."""
        options = self.options
        wanted = {"back faces": options.back_faces, "behind": options.behind}
        if not any(wanted.values()):
            return
        if self.engine.name != "cycles":
            note = "Only Cycles can look behind surfaces: their back faces and the layer behind are left out."
            self.frame = replace(self.frame, notes=(*self.frame.notes, note))
            return
        frame = self.frame
        if wanted["back faces"] and options.stations and "stations" not in frame.view_names:
            # What passes behind things then is seen by no view, and guessed at (ADR 13)
            wanted["back faces"] = False
            self._leave_out("back faces", "without stations they bring nothing")
        cameras = [camera for _, camera in frame.views] if around else []
        once = _work(frame.camera, 1) + sum(_work(camera, 1) for camera in cameras)
        lit = _work(frame.camera, options.samples)
        lit += sum(_work(camera, options.view_samples) for camera in cameras)
        if around:
            once += QUICK_PASS
        wanted["back faces"] = wanted["back faces"] and self._affords("back faces", once)
        # A layer behind takes the round of the back faces, too
        lit += 0.0 if wanted["back faces"] else once
        wanted["behind"] = wanted["behind"] and self._affords("behind", lit)
        if any(wanted.values()):
            self._add_hidden_surfaces(cameras, wanted["back faces"], wanted["behind"])
            if around:
                self._note_gain(*(name for name, is_wanted in wanted.items() if is_wanted))

    def _add_hidden_surfaces(self, cameras: Sequence[Camera], back_faces: bool, behind: bool) -> None:
        frame, options = self.frame, self.options
        takes = [Take(((frame.gbuffer, frame.camera),), lambda _: iter([None]), options.samples)]
        if cameras:
            takes.append(
                Take(
                    frame.views,
                    lambda restorer: borrow_cameras(restorer, self.scene, cameras),
                    options.view_samples,
                )
            )
        (front, *around), seconds = add_hidden_surfaces(
            self.engine,
            self.scene,
            self.view_layer,
            takes,
            back_faces=back_faces,
            behind=behind,
            denoiser=options.denoiser,
            progress=lambda fraction, text: self.report(0.8 + 0.2 * fraction, text),
        )
        self.frame = replace(frame, gbuffer=front[0][0], views=around[0] if around else frame.views)
        for name, value in seconds.items():
            self._note_seconds(name, value)

    def _affords(self, what: str, cost: float) -> bool:
        """Take work from the budget if it holds so much; note it where not."""
        if cost > self.work_left:
            self._leave_out(what, self._too_dear(cost))
            return False
        self.work_left -= cost
        return True

    def _note_seconds(self, name: str, seconds: float) -> None:
        """Note the time that something took: for the report alone."""
        spent = self.frame.seconds.get(name, 0.0) + seconds
        self.frame = replace(self.frame, seconds={**self.frame.seconds, name: spent})

    def _leave_out(self, what: str, why: str) -> None:
        self.frame = replace(self.frame, skipped=(*self.frame.skipped, (what, why)))

    def _too_dear(self, cost: float) -> str:
        cost, left = cost / self.light_work, self.work_left / self.light_work
        return f"about {cost:.2f} times the work of the direct light, and {left:.2f} are left"


def _work(camera: Camera, samples: int) -> float:
    return render_work(camera.width * camera.height, samples)
