# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth buffer as rays see it: a small slab per pixel, and a pyramid of both depth bounds.

Everything is in q: 1 / depth for a perspective camera, -depth for an orthographic one. q is linear along a
ray in screen space and linear across a plane in screen space; larger is nearer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera import Camera
from .gbuffer import GBuffer
from .types import BoolArray, FloatArray, IntArray

MAX_LEVEL = 7
# Bounds of a cell are widened by this much of themselves, so that rounding never makes them cut into a patch.
_BOUND_MARGIN = 1e-6
# Neighbours farther apart than this share of the distance (orthographic: of the width) are two surfaces.
_LARGEST_STEP = 0.1
# A normal confirms a neighbour's difference in q when its plane predicts it to within this fraction.
_CONFIRMED = 0.02


@dataclass(frozen=True, eq=False)
class DepthField:
    """Per-pixel slabs and their bounds per cell of a pyramid.

    Attributes
    ----------
    camera
        The camera that sees the field.
    is_background : (H*W,) bool
        Pixels without a surface; rays pass them.
    planes : (H*W, 4) float32
        Columns `front`, `gradient_x`, `gradient_y`, `slab`: the front plane
        q = front + gradient_x * dx + gradient_y * dy at an offset (dx, dy) px from the pixel's centre (-inf
        on background, which is behind every ray), and the extent of the slab behind it in q.
    reach : (H*W,) float32
        How deep in q a ray may enter the slab between two pixels and still count as meeting the front.
    footprint : (H*W,) float32
        As wide as a pixel, in q: how deep it may do so over the edge of a surface.
    largest_step : (H*W,) float32
        Largest difference in q to a neighbour of the same surface.
    normal : (H*W, 3) float32
        View-space shading normals.
    bounds : (cells, 2) float32
        Columns `nearest` and `farthest`: largest front q and smallest back q per cell of every level, all
        levels in one image with a common row stride: level 0 at the left, the others stacked beside it.
        Background neither stops a ray that passes in front (nearest = -inf) nor one that passes behind
        (farthest = +inf).
    stride
        Row stride of the atlas, cells.
    origins : (levels,) int64
        Atlas index of each level's cell (0, 0).
    padded_width, padded_height
        Size of level 0 with padding, a multiple of 2**(levels - 1).
    q_end
        q at which a ray has left every surface behind: 0, or an orthographic camera's sentinel.
    """

    camera: Camera
    is_background: BoolArray
    planes: FloatArray
    reach: FloatArray
    footprint: FloatArray
    largest_step: FloatArray
    normal: FloatArray
    bounds: FloatArray
    stride: int
    origins: IntArray
    padded_width: int
    padded_height: int
    q_end: float

    @property
    def levels(self) -> int:
        """Number of pyramid levels, at least 1."""
        return int(self.origins.shape[0])

    @property
    def front(self) -> FloatArray:
        """Q at the pixels' centres (H*W,)."""
        return self.planes[:, 0]

    @property
    def gradient_x(self) -> FloatArray:
        """dq/dx per pixel (H*W,)."""
        return self.planes[:, 1]

    @property
    def gradient_y(self) -> FloatArray:
        """dq/dy per pixel, y down (H*W,)."""
        return self.planes[:, 2]

    @property
    def slab(self) -> FloatArray:
        """Extent of the slabs in q (H*W,)."""
        return self.planes[:, 3]

    @property
    def nearest(self) -> FloatArray:
        """Largest front q per cell (cells,)."""
        return self.bounds[:, 0]

    @property
    def farthest(self) -> FloatArray:
        """Smallest back q per cell (cells,)."""
        return self.bounds[:, 1]

    @classmethod
    def build(
        cls,
        gbuffer: GBuffer,
        camera: Camera,
        thickness: float,
        *,
        max_level: int = MAX_LEVEL,
        bounds: str = "both",
    ) -> DepthField:
        """Derive slabs and pyramid from a G-buffer.

        Parameters
        ----------
        gbuffer
            Depth, normal and, where captured, thickness of every pixel.
        camera
            The camera of `gbuffer`.
        thickness
            Thickness relative to depth (orthographic: to the width of the view) where none was captured.
        max_level
            Coarsest level to build; 0 leaves a linear walk.
        bounds
            ``"both"``, or ``"nearest"`` for the usual min-Z pyramid: no ray is then known to pass behind a
            cell, and the hits are the same.

        Raises
        ------
        ValueError
            If G-buffer and camera differ in size.
        """
        height, width = gbuffer.shape
        if (camera.height, camera.width) != (height, width):
            raise ValueError(
                f"camera: expected {width}x{height} as the G-buffer, got {camera.width}x{camera.height}"
            )
        is_background = gbuffer.is_background
        q, q_end = _q_of_depth(gbuffer.depth, is_background, camera)
        gradient_x, gradient_y = _patch_gradients(gbuffer, camera, q, is_background)
        slab = _slab_extent(gbuffer, camera, q, is_background, thickness, q_end)

        tilt = np.abs(gradient_x) + np.abs(gradient_y)
        footprint, largest_step = _footprint(q, camera), _largest_step(q, slab, camera)
        margin = _BOUND_MARGIN * np.abs(q)
        nearest = np.where(is_background, -np.inf, q + 0.5 * tilt + margin).astype(q.dtype)
        farthest = np.where(is_background, np.inf, q - 0.5 * tilt - slab - margin).astype(q.dtype)
        level = min(max_level, max(0, (max(width, height) - 1).bit_length() - 1))
        if bounds == "nearest":
            farthest = np.full_like(q, -np.inf)
        atlas_nearest, stride, origins, padded = _stack_levels(nearest, level, np.maximum, -np.inf)
        atlas_farthest, _, _, _ = _stack_levels(farthest, level, np.minimum, np.inf)
        front = np.where(is_background, -np.inf, q)
        return cls(
            camera=camera,
            is_background=is_background.ravel(),
            planes=np.stack([front, gradient_x, gradient_y, slab], axis=-1).reshape(-1, 4).astype(q.dtype),
            reach=np.maximum(footprint + tilt, _step_to_border(q, largest_step)).ravel(),
            footprint=footprint.ravel(),
            largest_step=largest_step.ravel(),
            normal=gbuffer.normal.reshape(-1, 3),
            bounds=np.stack([atlas_nearest, atlas_farthest], axis=-1),
            stride=stride,
            origins=origins,
            padded_width=padded[1],
            padded_height=padded[0],
            q_end=q_end,
        )


def _q_of_depth(depth: FloatArray, is_background: BoolArray, camera: Camera) -> tuple[FloatArray, float]:
    """Return q with 0 (orthographic: the sentinel) on background, and that value."""
    if not camera.is_orthographic:
        return (1.0 / depth).astype(depth.dtype), 0.0
    # Behind the farthest surface by as much as the view is wide: nothing is left for a ray to meet there.
    farthest = float(depth[~is_background].max()) if not is_background.all() else 0.0
    q_end = -(farthest + camera.width / camera.fx)
    return np.where(is_background, q_end, -depth).astype(depth.dtype), q_end


def _patch_gradients(
    gbuffer: GBuffer, camera: Camera, q: FloatArray, is_background: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return dq/dx and dq/dy of each pixel's plane, per pixel.

    From n . P = n . P0. Each is limited by the differences to the two neighbours: exact on planes, and no
    patch of a silhouette or of a bent normal sticks out past what lies beside it.
    """
    height, width = q.shape
    normal = gbuffer.normal
    nx, ny, nz = normal[..., 0], normal[..., 1], normal[..., 2]
    denominator: FloatArray = nz
    if not camera.is_orthographic:
        x_px = np.arange(width, dtype=q.dtype) + 0.5
        y_px = np.arange(height, dtype=q.dtype)[:, None] + 0.5
        # n . P0 / depth0, with P0 / depth0 = ((x - cx) / fx, (cy - y) / fy, -1)
        denominator = nx * ((x_px - camera.cx) / camera.fx) + ny * ((camera.cy - y_px) / camera.fy) - nz
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = -1.0 / denominator if camera.is_orthographic else q / denominator
        gx = _limit_to_neighbours(nx * scale / camera.fx, q, axis=1)
        gy = _limit_to_neighbours(-ny * scale / camera.fy, q, axis=0)
    gx[is_background] = 0.0
    gy[is_background] = 0.0
    return gx, gy


def _differences(q: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return the differences to the pixels before and after; at the border the one there is, twice."""
    difference = np.diff(q, axis=axis)
    if not difference.size:
        return np.zeros_like(q), np.zeros_like(q)
    first, last = np.take(difference, [0], axis=axis), np.take(difference, [-1], axis=axis)
    return np.concatenate([first, difference], axis=axis), np.concatenate([difference, last], axis=axis)


def _limit_to_neighbours(gradient: FloatArray, q: FloatArray, axis: int) -> FloatArray:
    """Limit gradients to the smaller difference of their own sign, or to the larger one that they confirm."""
    before, after = _differences(q, axis)
    # An edge-on normal has no finite gradient: 0 is as good as any
    gradient = np.nan_to_num(gradient, nan=0.0)
    sign = np.where(gradient < 0.0, -1.0, 1.0).astype(q.dtype)
    before, after = np.maximum(sign * before, 0.0), np.maximum(sign * after, 0.0)
    small, big = np.minimum(before, after), np.maximum(before, after)
    is_confirmed = np.abs(np.abs(gradient) - big) <= _CONFIRMED * big
    limit = np.where((small > 0.0) & ~is_confirmed, small, big)
    return sign * np.minimum(np.abs(gradient), limit)


def _footprint(q: FloatArray, camera: Camera) -> FloatArray:
    """Return how wide a pixel is, as a difference in q."""
    if camera.is_orthographic:
        return np.full_like(q, 1.0 / camera.fx)
    return (np.abs(q) / max(camera.fx, camera.fy)).astype(q.dtype)


def _largest_step(q: FloatArray, slab: FloatArray, camera: Camera) -> FloatArray:
    """Return the largest difference to a neighbour of the same surface.

    It lies within the slab, and within a fixed share of the distance: however thick a thing is, its invisible
    side must not be lit by its front.
    """
    near = _LARGEST_STEP * (camera.width / camera.fx if camera.is_orthographic else np.abs(q))
    return np.minimum(slab, near).astype(q.dtype)


def _step_to_border(q: FloatArray, largest_step: FloatArray) -> FloatArray:
    """Return half the largest difference to a neighbour of the same surface."""
    step = np.zeros_like(q)
    for axis in (0, 1):
        for difference in _differences(q, axis):
            size = np.abs(difference)
            step = np.maximum(step, np.where(size <= largest_step, 0.5 * size, 0.0))
    return step


def _slab_extent(
    gbuffer: GBuffer, camera: Camera, q: FloatArray, is_background: BoolArray, relative: float, q_end: float
) -> FloatArray:
    """Return the extent of each slab in q, from the captured thickness or relative to depth."""
    if camera.is_orthographic:
        units = camera.width / camera.fx
        extent = np.full_like(q, relative * units) if gbuffer.thickness is None else gbuffer.thickness
        extent = np.minimum(extent, q - q_end)
    elif gbuffer.thickness is None:
        extent = q * (relative / (1.0 + relative))
    else:
        # 1 / depth - 1 / back, whose difference has no digits left where things are thin
        is_endless = np.isinf(gbuffer.thickness)
        thickness = np.where(is_endless, 0.0, gbuffer.thickness)
        depth = np.where(is_background, 1.0, gbuffer.depth)
        extent = q * np.where(is_endless, 1.0, thickness / (depth + thickness))
    return np.where(is_background, 0.0, extent).astype(q.dtype)


def _stack_levels(
    bound: FloatArray, max_level: int, reduce: np.ufunc, fill: float
) -> tuple[FloatArray, int, IntArray, tuple[int, int]]:
    """Pad `bound`, reduce it 2 x 2 level by level, and lay all levels into one flat image."""
    height, width = bound.shape
    block = 1 << max_level
    rows, columns = -(-height // block) * block, -(-width // block) * block
    stride = columns + (columns >> 1 if max_level else 0)
    atlas = np.full((rows, stride), fill, dtype=bound.dtype)
    atlas[:height, :width] = bound
    origins = [0]
    current, row = atlas[:, :columns], 0
    for level in range(1, max_level + 1):
        pairs = reduce(current[0::2], current[1::2])
        current = reduce(pairs[:, 0::2], pairs[:, 1::2])
        atlas[row : row + (rows >> level), columns : columns + (columns >> level)] = current
        origins.append(row * stride + columns)
        row += rows >> level
    return atlas.ravel(), stride, np.array(origins, dtype=np.int64), (rows, columns)
