# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks that end early, share their rays or run along borders find what they find however they run."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from ssgi_addon.core import Camera
from tests.core.synthetic import uniform_gbuffer
from tests.core.test_tracer import assert_walks_agree


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0, 1]))
@examples(max_examples=20)
def test_walks_agree_along_the_borders_between_pixels(seed, is_orthographic, axis):
    """A ray that runs along a border never crosses it: neither 0 * inf nor rounding may hold it up."""
    rng = np.random.default_rng(seed)
    gbuffer = uniform_gbuffer((16, 16), rng.choice([1.0, 2.0, 4.0, 8.0, np.inf], (16, 16)))
    camera = Camera(16, 16, 8.0, 8.0, 8, 8, is_orthographic, np.eye(4))
    across, along = rng.integers(0, 16, 40), rng.integers(0, 16, 40) + 0.5
    x, y = (along, across) if axis == 0 else (across, along)
    origin = np.ascontiguousarray(camera.pixel_to_view(x, y, np.full(40, 4.0)).T)
    direction = np.zeros((3, 40))
    direction[axis] = rng.choice([-0.5, 0.5], 40)
    if is_orthographic:
        direction[2] = rng.choice([-0.25, 0.0, 0.25], 40)
    assert_walks_agree((gbuffer, camera, 0.25, rng), origin, direction)
