# SPDX-License-Identifier: GPL-3.0-or-later
"""Where to look from so that rays find what the frame hides: stations in the open, chosen one by one.

A quick pass sends a few rays from the frame. Where one goes out of sight, behind something or into it, a view
from elsewhere is worth most that sees this very point in the open, and sees it along the ray: then it also
sees the front of what the ray meets next. So each candidate is scored by the rays that it would win back, the
best one is taken, the rays it wins count no more, and so on: the greedy choice for covering a set, which is
within 1 - 1/e of the best one (Nemhauser, Wolsey and Fisher 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import tracer
from .answers import SURELY_BEFORE
from .camera import Camera, move_between
from .frame_points import surface_points, toward_camera
from .gbuffer import GBuffer
from .planner import is_colored
from .sampling import cosine_directions, sample_square
from .scene import TraceScene, View
from .settings import Settings
from .types import FloatArray, IntArray

# Pixels whose rays ask for views, and rays of each.
_PIXELS, _RAYS = 512, 4
# Places that are tried, and how far they lie on the way from a camera to a surface.
_CANDIDATES = 96
_NEAREST, _FARTHEST = 0.3, 0.9
# Of the way to the point where a ray went out of sight: the point itself lies at the edge of what is open.
_NEARLY = 0.97
# Share of all rays that a view has to win back: it costs a render.
_WORTH = 0.002
_SEED = 11
# Where each face of a cube around a place looks, and what is up in it.
CUBE_FACES = (
    ((0, 0, -1), (0, 1, 0)),
    ((1, 0, 0), (0, 1, 0)),
    ((-1, 0, 0), (0, 1, 0)),
    ((0, 0, 1), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1)),
    ((0, -1, 0), (0, 0, -1)),
)


@dataclass(frozen=True, eq=False)
class LostRays:
    """What a few of the frame's diffuse rays lose sight of.

    Attributes
    ----------
    scene
        The views that they were sent through.
    left
        Share of rays that no view answers: they left the sight of all.
    hidden
        Share of rays that went behind something, or into it, whatever they found then.
    point, direction : (3, N)
        Where those of both kinds went out of sight, and where they were going; in the frame's view space.
    """

    scene: TraceScene
    left: float
    hidden: float
    point: FloatArray
    direction: FloatArray

    @property
    def share(self) -> float:
        """Share of rays that are lost in either way."""
        return self.left + self.hidden

    def stations(self, count: int, threads: int | None = None) -> list[FloatArray]:
        """Choose views of 90 degrees from elsewhere that see what was lost.

        Parameters
        ----------
        count
            Most views to return; fewer where hardly any more rays are lost.
        threads
            As in `Settings.threads`.

        Returns
        -------
        list of (4, 4)
            World matrices of the views, the most useful one first.
        """
        if not self.point.shape[1] or count < 1:
            return []
        place = _candidates(self.scene)
        gain, face = _gains(self.scene, place, self.point, self.direction, threads)
        weight = np.ones(self.point.shape[1], dtype=gain.dtype)
        world_from_view = self.scene.views[0].camera.world_from_view
        poses: list[FloatArray] = []
        for _ in range(count):
            sides = range(len(CUBE_FACES))
            score = np.stack([((gain * (face == side)) * weight).sum(axis=1) for side in sides])
            side, best = np.unravel_index(int(score.argmax()), score.shape)
            if score[side, best] <= _WORTH * _PIXELS * _RAYS:
                break
            weight *= 1.0 - gain[best] * (face[best] == side)
            gain[best] *= face[best] != side
            poses.append(world_from_view @ _standing_at(place[:, best]) @ facing(CUBE_FACES[side]))
        return poses


def find_lost_rays(gbuffer: GBuffer, camera: Camera, views: Sequence[View], settings: Settings) -> LostRays:
    """Send some of a frame's diffuse rays through its views.

    Parameters
    ----------
    gbuffer, camera
        The frame; one without surfaces loses nothing.
    views
        Those that there are already.
    settings
        Thickness, largest distance, threads.
    """
    scene = TraceScene(gbuffer, camera, views, settings, notes_hidden=True)
    pixel = np.flatnonzero(~gbuffer.is_background & is_colored(gbuffer.albedo))
    if not pixel.size:
        return LostRays(scene, 0.0, 0.0, *np.empty((2, 3, 0), dtype=scene.dtype))
    random = np.random.default_rng(_SEED)
    pixel = np.sort(random.choice(pixel, min(_PIXELS, pixel.size), replace=False))
    origin, normal = surface_points(gbuffer, camera, pixel)
    u, v = sample_square(pixel, camera.width, _RAYS, settings.seed, gbuffer.depth.dtype)
    direction = cosine_directions(u, v, normal).reshape(3, -1)
    origin = np.repeat(origin[:, None], _RAYS, axis=1).reshape(3, -1)
    merged = scene.merge(origin, direction, threads=settings.threads)
    is_unknown = merged.answers(scene.texels).status == tracer.UNKNOWN
    # At a hit on entry they are out of sight, but there is no more to be seen
    is_lost = merged.is_uncertain() & (merged.open_until < SURELY_BEFORE * merged.nearest)
    is_lost &= np.isfinite(merged.open_until)
    lost = np.flatnonzero(is_lost)
    direction = direction.take(lost, axis=1)
    point = origin.take(lost, axis=1) + direction * merged.open_until.take(lost)
    left, hidden = float(is_unknown.mean()), float((is_lost & ~is_unknown).mean())
    return LostRays(scene, left, hidden, point, direction)


def _candidates(scene: TraceScene) -> FloatArray:
    """Return places in the open (3, N), in the frame's view space: on the way to what views show."""
    random = np.random.default_rng(_SEED)
    frame = scene.views[0].camera
    found = []
    each = -(-_CANDIDATES // len(scene.views))
    for view in scene.views:
        gbuffer, camera = view.layers[0], view.camera
        pixel = np.flatnonzero(~gbuffer.is_background)
        if not pixel.size:
            continue
        pixel = random.choice(pixel, each)
        row, column = np.divmod(pixel, camera.width)
        depth = gbuffer.depth.reshape(-1).take(pixel) * random.uniform(_NEAREST, _FARTHEST, each)
        place = camera.pixel_to_view(column + 0.5, row + 0.5, depth)
        move = move_between(camera, frame)
        found.append(move[:3, :3] @ place.T + move[:3, 3:])
    return np.concatenate(found, axis=1).astype(scene.dtype)


def _gains(
    scene: TraceScene, place: FloatArray, point: FloatArray, direction: FloatArray, threads: int | None
) -> tuple[FloatArray, IntArray]:
    """Return how well each place (rows) sees where each ray was lost, 0..1, and in which face."""
    toward = point[:, None, :] - place[:, :, None]
    distance = np.sqrt((toward * toward).sum(axis=0))
    toward /= np.maximum(distance, np.finfo(distance.dtype).tiny)
    start = np.ascontiguousarray(np.broadcast_to(place[:, :, None], toward.shape)).reshape(3, -1)
    open_until = scene.open_from(start, toward.reshape(3, -1), threads).reshape(distance.shape)
    along = (toward * direction[:, None, :]).sum(axis=0)
    # Who looks from where the frame does loses the ray at the same edge
    sight = -toward_camera(scene.views[0].camera, point)
    askew = 1.0 - np.maximum((toward * sight[:, None, :]).sum(axis=0), 0.0)
    gain = np.maximum(along, 0.0) * askew * (open_until >= _NEARLY * distance)
    axes = np.stack([np.tensordot(np.array(forward), toward, axes=1) for forward, _ in CUBE_FACES])
    return gain.astype(scene.dtype), axes.argmax(axis=0)


def facing(face: tuple[tuple[int, int, int], tuple[int, int, int]]) -> FloatArray:
    """Return the (4, 4) rotation of a view that looks out of a face of `CUBE_FACES`."""
    forward, up = face
    turn = np.eye(4)
    turn[:3, :3] = np.column_stack([np.cross(forward, up), up, np.negative(forward)])
    return turn


def _standing_at(place: FloatArray) -> FloatArray:
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose
