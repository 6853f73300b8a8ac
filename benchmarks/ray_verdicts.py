# SPDX-License-Identifier: GPL-3.0-or-later
"""Answers of the tracer, judged by what the rays truly hit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.ray_truth import RayTruth
from ssgi_addon.core import Camera, tracer
from ssgi_addon.core.camera import move_between
from ssgi_addon.core.depth_field import DepthField
from ssgi_addon.core.places import PlacedView
from ssgi_addon.core.scene import TraceScene
from ssgi_addon.core.types import BoolArray, FloatArray, IntArray

# A hit is right this near to the true one: relative to the distance, or pixels of the view that answered.
NEAR = 0.02
NEAR_PX = 2.0
# A ray's own surroundings, pixels.
_CONTACT_PX = 3.0
# A hit no deeper than this behind a patch lies on it; relative to depth.
_ON_FRONT = 1e-4
# What a ray did, and what makes a wrong hit wrong; each ray has one of them.
RIGHT, TOO_NEAR, TOO_FAR, NO_SKY, UNANSWERED = range(5)


@dataclass(frozen=True)
class RayScore:
    """How well a configuration answers rays whose truth is certain; shares of them unless it says other.

    None is a share of nothing.

    Attributes
    ----------
    rays
        How many count.
    sky, seen
        Truly sky, and with a true hit that some view shows: what the views could answer at best.
    known, hit, escaped, blocked, unknown
        By what the tracer answered; the first is the sum of the next two.
    missed
        Some view shows the true hit, and the ray is no hit.
    hits_right, escapes_right
        Of the hits and of the escapes.
    too_near, too_far, no_sky
        Of the hits: where the truth lies behind or before what was found, or is sky.
    """

    rays: int
    sky: float
    seen: float
    known: float
    hit: float
    escaped: float
    blocked: float
    unknown: float
    missed: float
    hits_right: float | None
    escapes_right: float | None
    too_near: float | None
    too_far: float | None
    no_sky: float | None


@dataclass(frozen=True)
class WrongHits:
    """Where wrong hits come from; shares of all hits.

    Attributes
    ----------
    near_contact, near_step, near_front
        What was found lies too near, or before the sky: within three pixels of the ray's own; else behind the
        front of the pixel that the ray entered, where a step of one surface counts as its front; else on it.
    far_hidden, far_seen
        What was found lies too far: no view shows the true hit, or one does and the ray went past it.
    """

    near_contact: float | None
    near_step: float | None
    near_front: float | None
    far_hidden: float | None
    far_seen: float | None


def judge(
    is_hit: BoolArray, distance: FloatArray, true_distance: FloatArray, is_same_place: BoolArray
) -> IntArray:
    """Return what the hits among N rays are: `RIGHT`, `TOO_NEAR`, `TOO_FAR`, `NO_SKY`; else `UNANSWERED`.

    Parameters
    ----------
    is_hit : (N,)
        The rays to judge.
    distance, true_distance : (N,)
        To what was found and to what is there; +inf for the sky.
    is_same_place : (N,)
        Both are the same place of the view that answered.
    """
    is_sky = np.isinf(true_distance)
    with np.errstate(invalid="ignore"):
        is_near = np.abs(distance - true_distance) <= NEAR * true_distance
    cases = [~is_hit, is_sky, is_near | is_same_place, distance < true_distance]
    return np.select(cases, [UNANSWERED, NO_SKY, RIGHT, TOO_NEAR], TOO_FAR)


class Judgement:
    """What the views of a scene answer to rays, against the truth.

    Parameters
    ----------
    scene
        Its first view is the frame that the rays start in.
    truth
        Rays; those whose truth is not certain are left out.
    """

    def __init__(self, scene: TraceScene, truth: RayTruth) -> None:
        counts = truth.counts
        origin, direction = truth.origin_vs[:, counts], truth.direction_vs[:, counts]
        self.scene, self.pixel, self.distance = scene, truth.pixel[counts], truth.distance[counts]
        self.answers = scene.answer(np.ascontiguousarray(origin), np.ascontiguousarray(direction), 0, None)
        self.is_sky = np.isinf(self.distance)
        self.is_hit = self.answers.status == tracer.HIT
        self.is_seen, self.is_same_place, self.is_step = np.zeros((3, self.distance.size), bool)
        # Where the truth lies, and what was found; the sky has no normal, so no view shows it
        true, found = (
            (origin + direction * np.where(np.isfinite(distance), distance, 0.0)).T.astype(np.float64)
            for distance in (self.distance, self.answers.distance)
        )
        for view in scene.views:
            self._compare(view, true, found, truth.normal_vs[:, counts].T)
        self.verdict = judge(self.is_hit, self.answers.distance, self.distance, self.is_same_place)

    def _compare(self, view: PlacedView, true: FloatArray, found: FloatArray, normal: FloatArray) -> None:
        """Tell what one view shows of the truth, and how its own answers lie to it.

        Points and normals (N, 3) are in the space of view 0.
        """
        move = move_between(self.scene.views[0].camera, view.camera)
        moved = true @ move[:3, :3].T + move[:3, 3]
        faces = _faces(view.camera, moved, normal @ move[:3, :3].T)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y, depth = view.camera.view_to_pixel(moved)
        off = np.hypot(x - self.answers.x_px, y - self.answers.y_px)
        found_depth = -(found @ move[2, :3] + move[2, 3])
        for field, offset in zip(view.fields, view.offsets, strict=True):
            shows = faces & _shows(field, x, y, depth)
            self.is_seen |= shows
            pixel = self.answers.texel - offset
            mine = (pixel >= 0) & (pixel < view.camera.width * view.camera.height)
            self.is_same_place |= mine & shows & (off <= NEAR_PX)
            front = _patch_depth(field, pixel[mine], self.answers.x_px[mine], self.answers.y_px[mine])
            self.is_step[mine] = found_depth[mine] - front > _ON_FRONT * front

    def score(self) -> RayScore:
        """Return the shares."""
        status = self.answers.status
        is_hit, is_escaped = self.is_hit, status == tracer.ESCAPED
        return RayScore(
            rays=status.size,
            sky=_share(self.is_sky),
            seen=_share(self.is_seen),
            known=_share(is_hit | is_escaped),
            hit=_share(is_hit),
            escaped=_share(is_escaped),
            blocked=_share(status == tracer.BLOCKED),
            unknown=_share(status == tracer.UNKNOWN),
            missed=_share(self.is_seen & ~is_hit),
            hits_right=_share(self.verdict[is_hit] == RIGHT),
            escapes_right=_share(self.is_sky[is_escaped]),
            too_near=_share(self.verdict[is_hit] == TOO_NEAR),
            too_far=_share(self.verdict[is_hit] == TOO_FAR),
            no_sky=_share(self.verdict[is_hit] == NO_SKY),
        )

    def wrong_hits(self) -> WrongHits:
        """Return where wrong hits come from."""
        is_hit = self.is_hit
        is_near = (self.verdict == TOO_NEAR) | (self.verdict == NO_SKY)
        is_far = self.verdict == TOO_FAR
        width = self.scene.views[0].camera.width
        row, column = np.divmod(self.pixel, width)
        off = np.hypot(self.answers.x_px - column - 0.5, self.answers.y_px - row - 0.5)
        at_contact = (self.answers.texel < self.scene.views[0].layers[0].depth.size) & (off <= _CONTACT_PX)
        return WrongHits(
            near_contact=_share((is_near & at_contact)[is_hit]),
            near_step=_share((is_near & ~at_contact & self.is_step)[is_hit]),
            near_front=_share((is_near & ~at_contact & ~self.is_step)[is_hit]),
            far_hidden=_share((is_far & ~self.is_seen)[is_hit]),
            far_seen=_share((is_far & self.is_seen)[is_hit]),
        )


def _faces(camera: Camera, point_vs: FloatArray, normal_vs: FloatArray) -> BoolArray:
    """Return (N,) where a camera looks at the side of a surface that its normal points to."""
    if camera.is_orthographic:
        return normal_vs[:, 2] > 0.0
    is_front: BoolArray = (normal_vs * point_vs).sum(axis=1) < 0.0
    return is_front


def _shows(field: DepthField, x_px: FloatArray, y_px: FloatArray, depth: FloatArray) -> BoolArray:
    """Return (N,) where the patch of a point's pixel, or of one beside it, goes through the point."""
    camera = field.camera
    is_inside = (x_px >= 0.0) & (x_px < camera.width) & (y_px >= 0.0) & (y_px < camera.height) & (depth > 0.0)
    inside = np.flatnonzero(is_inside)
    x, y, own = x_px.take(inside), y_px.take(inside), depth.take(inside)
    shows = np.zeros(inside.shape, bool)
    for down, right in np.ndindex(3, 3):
        column = np.clip(x.astype(np.int64) + right - 1, 0, camera.width - 1)
        row = np.clip(y.astype(np.int64) + down - 1, 0, camera.height - 1)
        patch = _patch_depth(field, row * camera.width + column, x, y)
        shows |= np.abs(patch - own) <= NEAR * own
    is_inside[inside] = shows
    return is_inside


def _patch_depth(field: DepthField, pixel: IntArray, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
    """Return the depth (N,) of pixels' patches at places near them, +inf beyond where they end."""
    row, column = np.divmod(pixel, field.camera.width)
    front, gx, gy, _ = field.planes.take(pixel, axis=0).T
    q = front + gx * (x_px - column - 0.5) + gy * (y_px - row - 0.5)
    if field.camera.is_orthographic:
        return -q
    with np.errstate(divide="ignore"):
        depth: FloatArray = 1.0 / np.maximum(q, 0.0)
    return depth


def _share(is_one: BoolArray) -> float | None:
    """Return the share of True, None of nothing."""
    return float(is_one.mean()) if is_one.size else None
