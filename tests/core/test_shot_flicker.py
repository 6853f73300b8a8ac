# SPDX-License-Identifier: GPL-3.0-or-later
"""Flicker without a reference: closed forms on planes, seen by a camera that stands or slides."""

from __future__ import annotations

import numpy as np
import pytest

from ssgi_addon.core import Camera
from ssgi_addon.shot.flicker import flicker_between, make_samples, measure_flicker
from ssgi_addon.shot.manifests import read_shot
from tests import tolerances
from tests.core.shot_folders import (
    camera_at,
    even_light,
    failed,
    samples_of,
    write_frame,
    write_manifest,
)

pytest.importorskip("OpenEXR")

SIZE = (96, 54)
SPEEDS = (0.0, 0.013, 0.08)  # units a frame: none, and about a third of a sample and two samples at the wall


def film(light, speed, frames=3, change=lambda frame, values: values, camera=camera_at):
    """Samples of frames 1, 2, …; `change` turns a frame's light into another."""
    found = []
    for frame in range(1, frames + 1):
        view = camera(frame, SIZE, speed=speed)
        layers = samples_of(view, light)
        layers["diffuse"] = np.asarray(change(frame, layers["diffuse"]), dtype=np.float32)
        found.append(make_samples(view, *layers.values()))
    return found


def noise(rng, deviation):
    return lambda _, values: values * (1.0 + deviation * rng.standard_normal(values.shape))


def parallel_camera(frame, size, *, speed):
    pose = np.eye(4)
    pose[:3, 3] = (speed * frame, 0.5, 2.0)
    return Camera.orthographic(*size, 6.0, world_from_view=pose)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("camera", [camera_at, parallel_camera])
def test_light_that_stays_does_not_flicker(speed, camera):
    found = flicker_between(*film(even_light, speed, camera=camera))
    assert found.value <= tolerances.FLICKER_OF_STEADY_LIGHT
    assert 0.9 < found.seen <= 1.0


@pytest.mark.parametrize("speed", SPEEDS)
def test_light_that_dims_evenly_does_not_flicker(speed):
    dimmed = film(even_light, speed, change=lambda frame, values: values * (1.0 - 0.2 * frame))
    assert flicker_between(*dimmed).value <= tolerances.FLICKER_OF_STEADY_LIGHT


@pytest.mark.parametrize("deviation", [0.01, 0.05, 0.15])
def test_known_noise_gives_its_deviation(rng, deviation):
    noisy = film(even_light, 0.0, change=noise(rng, deviation))
    expected = pytest.approx(deviation, rel=tolerances.FLICKER_OF_NOISE)
    assert flicker_between(*noisy).value == expected


@pytest.mark.parametrize("speed", SPEEDS[1:])
def test_moving_camera_takes_little_of_the_noise(rng, speed):
    noisy = film(even_light, speed, change=noise(rng, 0.05))
    lowest = tolerances.FLICKER_OF_NOISE_BETWEEN_SAMPLES - tolerances.FLICKER_OF_NOISE
    assert lowest <= flicker_between(*noisy).value / 0.05 <= 1.0 + tolerances.FLICKER_OF_NOISE


@pytest.mark.parametrize("speed", SPEEDS)
def test_jump_of_one_frame_has_its_closed_form_and_stands_out(speed):
    jump = 1.5
    frames = film(
        lambda points: np.ones((len(points), 3)),
        speed,
        frames=5,
        change=lambda frame, values: values * (jump if frame == 3 else 1.0),
    )
    values = [flicker_between(*frames[first : first + 3]).value for first in range(3)]
    change, beside = 2.0 * (jump - 1.0), jump - 1.0
    mean = (2.0 + jump) / 3.0
    expected = [beside / mean, change / mean, beside / mean]
    for value, exact in zip(values, expected):
        assert value == pytest.approx(exact / 6.0**0.5, rel=tolerances.FLICKER_OF_EVEN_LIGHT)


def test_exposure_does_not_matter():
    plain, bright = (
        film(lambda points, scale=scale: even_light(points) * scale, 0.013, change=flickering)
        for scale in (1.0, 1024.0)
    )
    assert flicker_between(*bright) == flicker_between(*plain)


def flickering(frame, values):
    return values * (1.0 + 0.1 * (frame % 2))


def test_threads_never_change_a_figure():
    frames = film(even_light, 0.013, change=flickering)
    assert flicker_between(*frames, threads=1) == flicker_between(*frames, threads=3)


def test_cut_and_darkness_and_sky_tell_nothing():
    frames = film(even_light, 0.0)
    elsewhere = film(even_light, 1000.0)
    assert flicker_between(frames[0], frames[1], elsewhere[2]) is None
    dark = film(lambda points: np.zeros((len(points), 3)), 0.0)
    assert flicker_between(*dark) is None
    sky = [
        make_samples(one.camera, np.full_like(one.surfaces.depth, np.inf), one.surfaces.normal, one.diffuse)
        for one in frames
    ]
    assert flicker_between(*sky) is None


def test_places_whose_light_is_no_number_do_not_count():
    frames = film(even_light, 0.0)
    clean = flicker_between(*frames)
    broken = frames[1].diffuse.copy()
    broken[5:20, 10:40] = np.nan
    surfaces = frames[1].surfaces
    spoilt = make_samples(frames[1].camera, surfaces.depth, surfaces.normal, broken)
    assert flicker_between(frames[0], spoilt, frames[2]).value == pytest.approx(
        clean.value, abs=tolerances.FLICKER_OF_STEADY_LIGHT
    )


def measure(folder, frames):
    shot = read_shot(folder)
    finished = [one for one in shot.manifests.values() if one.record]
    return measure_flicker(folder, finished, frames)


def test_frames_with_even_neighbours_are_measured(tmp_path):
    for frame in (1, 2, 3, 5, 7, 8):
        write_frame(tmp_path, frame, even_light)
    write_manifest(tmp_path, failed(6))
    found, unread = measure(tmp_path, [1, 2, 3, 5, 6, 7, 8])
    assert sorted(found) == [2]
    assert unread == []
    # Every second frame of a shot
    found, _ = measure(tmp_path, [1, 3, 5, 7])
    assert sorted(found) == [3, 5]


def test_samples_that_cannot_be_read_are_named_once(tmp_path):
    for frame in range(1, 8):
        write_frame(tmp_path, frame, even_light)
    (tmp_path / "frames" / "room_0004.exr").write_bytes(b"no picture")
    found, unread = measure(tmp_path, range(1, 8))
    assert sorted(found) == [2, 6]
    assert [entry.file for entry in unread] == ["room_0004.exr"]
    assert "cannot read it:" in unread[0].why


def test_samples_of_another_size_than_the_camera_are_named(tmp_path):
    for frame in range(1, 4):
        write_frame(tmp_path, frame, even_light)
    write_frame(tmp_path, 2, even_light)
    path = tmp_path / "frames" / "room_0002.json"
    path.write_text(path.read_text().replace('"width": 48', '"width": 47'))
    found, unread = measure(tmp_path, range(1, 4))
    assert found == {}
    assert "does not fit to its camera" in unread[0].why
