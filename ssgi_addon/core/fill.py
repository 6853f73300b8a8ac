# SPDX-License-Identifier: GPL-3.0-or-later
"""A fill: a small image of indirect light, path-traced with all its bounces, for what views do not see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .camera import Camera
from .carry import carry_over
from .gbuffer import LARGEST, GBuffer, as_array, as_float32
from .types import FloatArray


@dataclass(frozen=True, eq=False)
class Fill:
    """Indirect light and the surfaces that receive it, at a lower resolution than the frame.

    Construction validates shapes and cleans values as a `GBuffer` does. A pixel with bad light, or without
    samples, tells nothing: it becomes background.

    Attributes
    ----------
    depth, normal
        As in `GBuffer`, one surface sample per pixel.
    diffuse, glossy : (h, w, 3) float32
        Noisy indirect light of all bounces, before it is multiplied by the surface's colours: what Cycles
        calls Diffuse Indirect and Glossy Indirect.
    camera
        Of the fill; it need not be the frame's.
    samples : (h, w) float32
        How many light paths each pixel is the mean of; a number stands for all pixels.
    is_denoised
        The light was cleaned already: by a denoiser that knows more of noise than our filter.

    Raises
    ------
    ValueError
        If an array has not the camera's size, or does not hold real numbers.
    """

    depth: FloatArray
    normal: FloatArray
    diffuse: FloatArray
    glossy: FloatArray
    camera: Camera
    samples: FloatArray | float = 1.0
    is_denoised: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.camera, Camera):
            raise ValueError(f"camera: expected Camera, got {type(self.camera).__name__}")
        shape = (self.camera.height, self.camera.width)
        given = as_array("depth", self.depth)
        if given.shape != shape:
            raise ValueError(f"depth: expected the camera's shape {shape}, got {given.shape}")
        samples = as_array("samples", self.samples)
        samples = as_float32("samples", np.full(shape, samples) if samples.ndim == 0 else samples, shape)
        light = [as_float32(name, getattr(self, name), (*shape, 3)) for name in ("diffuse", "glossy")]
        is_good = (samples > 0.0) & (samples <= LARGEST)
        for image in light:
            is_good &= ((image >= 0.0) & (image <= LARGEST)).all(axis=-1)
        black = np.zeros((*shape, 3), dtype=np.float32)
        given = as_float32("depth", given, shape)
        surfaces = GBuffer(
            np.where(is_good, given, np.float32(np.inf)), self.normal, black, black, black[..., 0], black
        )
        is_good &= ~surfaces.is_background
        set_field = object.__setattr__  # the dataclass is frozen
        for name in ("depth", "normal"):
            set_field(self, name, getattr(surfaces, name))
        for name, image in zip(("diffuse", "glossy"), light, strict=True):
            set_field(self, name, np.where(is_good[..., None], image, np.float32(0.0)))
        set_field(self, "samples", np.where(is_good, samples, np.float32(0.0)))

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w), pixels."""
        return self.depth.shape[0], self.depth.shape[1]

    @cached_property
    def surfaces(self) -> GBuffer:
        """What receives the light, without colours."""
        black = np.zeros((*self.shape, 3), dtype=np.float32)
        surfaces = GBuffer(self.depth, self.normal, black, black, black[..., 0], black)
        # Normalising a unit vector once more may change its last bit
        object.__setattr__(surfaces, "normal", self.normal)
        return surfaces

    @classmethod
    def merged(cls, fills: Sequence[Fill], threads: int | None = None) -> Fill:
        """Return the mean of several fills of one world, in the view of the last one.

        Each counts by its samples. Those of other cameras are carried over to the surfaces that the last one
        sees, and count there only where they saw the same place.

        Parameters
        ----------
        fills
            The newest last: of frames before, say, where neither lights nor things moved. Those of other
            cameras are resampled, which no denoiser allows for: denoise each of them before, or none.
        threads
            Worker threads; None means all cores. Never changes a result.

        Raises
        ------
        ValueError
            If there is none, or some are denoised and some are not.
        """
        if not fills:
            raise ValueError("fills: expected at least one Fill, got none")
        if len({fill.is_denoised for fill in fills}) > 1:
            raise ValueError("fills: expected all denoised or none, got some of each")
        *earlier, newest = fills
        pixel = np.flatnonzero(~newest.surfaces.is_background)
        total = [newest._weighted().reshape(-1, 7).take(pixel, axis=0)]
        for fill in earlier:
            if fill._sees_the_same(newest):
                total.append(fill._weighted().reshape(-1, 7).take(pixel, axis=0))
                continue
            values, _ = carry_over(
                [fill._weighted().reshape(-1, 7)],
                (fill.surfaces, fill.camera),
                (newest.surfaces, newest.camera),
                pixel,
                threads,
                is_strict=True,
            )
            total += values
        image = np.zeros((newest.depth.size, 7), dtype=np.float32)
        image[pixel] = np.sum(total, axis=0)
        light = (image[:, :6] / np.maximum(image[:, 6:], np.float32(1e-20))).reshape(*newest.shape, 6)
        return cls(
            newest.depth, newest.normal, light[..., :3], light[..., 3:], newest.camera,
            image[:, 6].reshape(newest.shape), newest.is_denoised,
        )  # fmt: skip

    def _sees_the_same(self, other: Fill) -> bool:
        """Return whether the pixels of both are the same places, so that nothing need be carried over."""
        return (
            self.shape == other.shape
            and np.array_equal(self.camera.world_from_view, other.camera.world_from_view)
            and np.array_equal(self.depth, other.depth)
            and np.array_equal(self.normal, other.normal)
        )

    def _weighted(self) -> FloatArray:
        """Return both lights times the samples, and the samples, (h, w, 7)."""
        light = np.concatenate([self.diffuse, self.glossy, np.ones((*self.shape, 1), np.float32)], axis=-1)
        weighted: FloatArray = light * np.asarray(self.samples)[..., None]
        return weighted
