# SPDX-License-Identifier: GPL-3.0-or-later
# %% [markdown]
# Indirect light on arrays: a room that is ray-cast with a few lines of numpy, lit by one lamp, and then by
# what its walls reflect. Run it as a script (`pip install .`, then `python examples/arrays.py`), or cell by
# cell in an editor that knows `# %%` or, with jupytext, in Jupyter. It leaves arrays.png in the current
# folder.

# %%
from dataclasses import replace

import numpy as np

from ssgi_addon.core import Camera, GBuffer, Settings, composite, render_indirect
from ssgi_addon.core.metrics import display_referred
from ssgi_addon.png import write_png

WIDTH, HEIGHT = 300, 200
LAMP, POWER = np.array([0.0, 0.95, -2.4]), 4.0
BALL, RADIUS = np.array([0.35, -0.55, -2.8]), 0.45

# %% [markdown]
# ## The frame as arrays
# View space: the camera stands at the origin and looks down -Z, Y is up. The room's walls are at x = ±1.2,
# y = ±1 and z = -4; a ball lies on the floor.

# %%
camera = Camera.perspective(WIDTH, HEIGHT, fov_x=1.25)
x_px, y_px = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
rays = camera.pixel_to_view(x_px, y_px, np.ones_like(x_px))  # (H, W, 3), one unit of depth long

WHITE, RED, GREEN = (0.75, 0.75, 0.75), (0.7, 0.1, 0.08), (0.1, 0.5, 0.12)
WALLS = (  # axis, position, normal, colour
    (0, -1.2, (1, 0, 0), RED),
    (0, 1.2, (-1, 0, 0), GREEN),
    (1, -1.0, (0, 1, 0), WHITE),
    (1, 1.0, (0, -1, 0), WHITE),
    (2, -4.0, (0, 0, 1), WHITE),
)

depth = np.full((HEIGHT, WIDTH), np.inf)
normal, albedo = np.zeros((HEIGHT, WIDTH, 3)), np.zeros((HEIGHT, WIDTH, 3))
for axis, position, facing, color in WALLS:
    with np.errstate(divide="ignore"):
        distance = position / rays[..., axis]
    is_nearer = (distance > 0.0) & (distance < depth)
    depth[is_nearer], normal[is_nearer], albedo[is_nearer] = distance[is_nearer], facing, color


def meet_ball(origin, direction):
    """Return how far rays go to the ball, in lengths of `direction`; infinite where they miss it."""
    offset = origin - BALL
    a, b = (direction**2).sum(-1), (offset * direction).sum(-1)
    root = b**2 - a * ((offset**2).sum(-1) - RADIUS**2)
    distance = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    return np.where((root > 0.0) & (distance > 1e-6), distance, np.inf)


distance = meet_ball(np.zeros(3), rays)
is_ball = distance < depth
depth = np.minimum(depth, distance)
points = rays * depth[..., None]
normal[is_ball] = (points[is_ball] - BALL) / RADIUS
albedo[is_ball] = WHITE

# %% [markdown]
# ## Direct light
# One lamp under the ceiling, which shines downward, with the shadow that the ball casts.

# %%
to_lamp = LAMP - points
reach = np.linalg.norm(to_lamp, axis=-1)
cosine = np.maximum((normal * to_lamp).sum(-1) / reach, 0.0)
# From a little above the surface, or the ball would shade itself
is_lit = meet_ball(points + 1e-3 * normal, to_lamp) >= 1.0
downward = np.maximum(to_lamp[..., 1] / reach, 0.0)
irradiance = np.where(is_lit, POWER * downward * cosine / reach**2, 0.0)
direct = albedo / np.pi * irradiance[..., None]

gbuffer = GBuffer(
    depth,
    normal,
    albedo,
    specular=np.zeros_like(albedo),
    roughness=np.ones_like(depth),
    direct=direct,
)

# %% [markdown]
# ## Indirect light
# Settings are frozen dataclasses: `replace` makes variants. `light.known` says how much of each pixel the
# frame could answer: what lies behind the camera, or behind the ball, it does not show.

# %%
settings = Settings.preset("balanced")
settings = replace(settings, diffuse=replace(settings.diffuse, rays=16, bounces=6))
light = render_indirect(gbuffer, camera, settings)
picture = composite(gbuffer, light)
print(f"direct {gbuffer.direct.mean():.3f}, with bounced light {picture.mean():.3f}")
print(f"{light.known.mean():.0%} of the rays found an answer in the frame")

# %% [markdown]
# ## A picture
# Direct light, with indirect light, and the visibility (ambient occlusion).

# %%
visibility = np.repeat(light.visibility[..., None], 3, axis=-1)
panels = [display_referred(gbuffer.direct, 1.0), display_referred(picture, 1.0), display_referred(visibility)]
write_png("arrays.png", np.rint(255.0 * np.concatenate(panels, axis=1)).astype(np.uint8))
print("arrays.png: direct light, with indirect light, visibility")
