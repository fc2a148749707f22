"""A motion record whose times are late is put right by the photographs, within what is known of the clocks."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from procedures import BadInput, BlurSpec, RestorationParameters, Scheme, blur_of
from procedures.raw import Exposure, ImuRecord, Plane, RawFrame, ShakerPath, ShakerResponse, measured_path
from procedures.restoration.known_blur import recorded_motion
from procedures.restoration.masks.camera_motion import poses_on

OPEN_S, FOCAL_PX, ROWS, COLUMNS, NOISE = 0.13, 700.0, 96, 128, 0.003
NEAR, FAR = 1 / 1.2, 1 / 2.2
"""Inverse distances of the left and the right half of the scene, 1/m."""
WAVES = (((0.9e-2, 5.0, 0.3), (0.5e-2, 11.0, 1.0)), ((0.6e-2, 7.0, 2.0), (0.7e-2, 4.0, 0.5)))
"""Amplitude in metres, frequency and phase of x and y during each photograph, which is no whole number of rounds."""


def position(wave, t):
    amplitude, frequency, phase = wave
    return amplitude * np.sin(2 * np.pi * frequency * t + phase)


def scene(rng):
    texture = gaussian_filter(rng.normal(size=(ROWS + 80, COLUMNS + 80)), 1.0)
    return 0.5 + 0.15 * texture / texture.std()


def photographed(sharp, waves, rng):
    """Averaged instant by instant: nothing of the masks is in it."""
    y, x = np.mgrid[:ROWS, :COLUMNS].astype(float)
    inverse = np.where(x < COLUMNS / 2, NEAR, FAR)
    total = np.zeros((ROWS, COLUMNS))
    times = (np.arange(200) + 0.5) / 200 * OPEN_S
    for t in times:
        # a rig to the right moves the picture to the left, a rig up moves it down
        dx, dy = -FOCAL_PX * position(waves[0], t) * inverse, FOCAL_PX * position(waves[1], t) * inverse
        total += map_coordinates(sharp, [y - dy + 40, x - dx + 40], order=3)
    return total / len(times) + rng.normal(0, NOISE, total.shape)


def record(waves, late_s, within_s, rng):
    t = np.arange(-0.25, 0.45, 0.005)
    a = np.stack([-((2 * np.pi * f) ** 2) * position((A, f, p), t) for A, f, p in waves] + [0 * t], axis=1)
    a = a + np.array([0, 9.81, 0]) + rng.normal(0, 0.02, a.shape)
    return ImuRecord(t + late_s, a, rng.normal(0, 1e-4, a.shape), within_s)


@pytest.fixture(scope="module")
def pictures():
    rng = np.random.default_rng(2)
    sharp = scene(rng)
    return sharp[40 : 40 + ROWS, 40 : 40 + COLUMNS], [photographed(sharp, waves, rng) for waves in WAVES]


def frames_of(photographs, late_s, within_s):
    rng = np.random.default_rng(5)
    return [
        RawFrame(Path(str(n)), "", {"G1": Plane("G1", one, 1.0)}, Exposure(exposure_s=OPEN_S),
                 record(waves, late_s, within_s, rng))
        for n, (one, waves) in enumerate(zip(photographs, WAVES, strict=True))
    ]  # fmt: skip


def blur_with(photographs, late_s, within_s):
    motion = recorded_motion(frames_of(photographs, late_s, within_s), FOCAL_PX)
    return blur_of(BlurSpec(motion, 10.0), photographs)


@pytest.mark.slow
@pytest.mark.parametrize(
    "late_ms", [20.0, *(pytest.param(ms, marks=pytest.mark.nightly) for ms in (-8.0, 0.0, 4.0, 16.0))]
)
def test_the_photographs_put_late_times_right(pictures, late_ms):
    fitted = blur_with(pictures[1], late_ms / 1000, 0.02).time_shift
    assert fitted.within_s == 0.02
    # three standard uncertainties; the record's own noise and drift, which are not in it, move the motion a little
    assert abs(fitted.late_s - late_ms / 1000) < 3 * fitted.uncertainty_s + 5e-4
    assert fitted.uncertainty_s < 0.001


def test_times_that_are_known_or_not_covered_are_not_fitted(pictures):
    assert blur_with(pictures[1], 0.0, 0.0).time_shift is None
    frames = frames_of(pictures[1], 0.4, 0.0)
    assert recorded_motion(frames, FOCAL_PX) is None
    motion = recorded_motion(frames_of(pictures[1], 0.0, 0.02), FOCAL_PX)
    with pytest.raises(BadInput, match="does not cover its exposure"):
        motion.late(0.4)


@pytest.mark.nightly
def test_a_delayed_record_restores_as_well_as_a_true_one(pictures):
    sharp, photographs = pictures
    scheme = RestorationParameters(scheme=Scheme.parse("3x(4+4)+1x6"))

    def psnr_db(late_s, within_s):
        picture = blur_with(photographs, late_s, within_s).restored(photographs, scheme).value.sharp[0]
        inside = np.s_[16:-16, 16:-16]
        error = (picture - sharp)[inside]
        return -10 * np.log10(np.mean((error - error.mean()) ** 2))

    true = psnr_db(0.0, 0.0)
    assert psnr_db(0.016, 0.0) < true - 1.0  # what it would be without the fit
    for late_s in (0.016, 0.04):
        assert psnr_db(late_s, 0.04) == pytest.approx(true, abs=0.3)


def test_an_axis_lags_behind_its_command_by_its_response():
    t = np.arange(64) / 64
    command = np.stack([1e-3 * np.cos(2 * np.pi * t), 5e-4 * np.sin(4 * np.pi * t), 0 * t], axis=1)
    x, y = ShakerResponse(0.9, 25.0, 0.4), ShakerResponse(1.1, 60.0, 0.7)
    path = ShakerPath(command, 0.1 / 64, 0.02, (x, y, ShakerResponse()))
    poses = poses_on(path, 0.1)
    times = 0.02 + np.linspace(0, 0.1, len(poses.position_m))
    # steady state of a mass on a damped spring, whose differential equation is integrated here
    for column, one, amplitude, frequency, sine in ((0, x, 1e-3, 10.0, False), (1, y, 5e-4, 20.0, True)):
        w, w0 = 2 * np.pi * frequency, 2 * np.pi * one.frequency_hz
        phase = w * times - (np.pi / 2 if sine else 0.0)
        lag = np.arctan2(2 * one.damping * w * w0, w0**2 - w**2)
        size = one.gain * w0**2 / np.hypot(w0**2 - w**2, 2 * one.damping * w * w0)
        found = poses.position_m[:, column] * (1 if column == 0 else -1)
        np.testing.assert_allclose(found, amplitude * size * np.cos(phase - lag), atol=2e-6)


def test_poses_of_a_shaker_may_be_late_too():
    t = np.arange(64) / 64
    path = ShakerPath(1e-3 * np.stack([np.cos(2 * np.pi * t)] * 3, axis=1), 0.1 / 64, 0.02)
    late, moved = poses_on(path, 0.05, 0.003), partial(poses_on, ShakerPath(path.position_m, path.interval_s, 0.023))
    np.testing.assert_allclose(late.position_m, moved(0.05).position_m, atol=1e-12)


def test_the_path_that_a_shaker_really_played_is_measured_by_a_unit_on_its_box():
    rng, t = np.random.default_rng(8), np.arange(64) / 64
    command = 1e-3 * np.stack(
        [np.cos(2 * np.pi * t) + 0.3 * np.cos(6 * np.pi * t), np.sin(4 * np.pi * t), 0 * t], axis=1
    )
    responses = (ShakerResponse(0.8, 25.0, 0.4), ShakerResponse(1.1, 60.0, 0.7), ShakerResponse())
    commanded = ShakerPath(command, 0.1 / 64, 0.02)
    played = ShakerPath(command, 0.1 / 64, 0.02, responses)
    times = np.arange(-0.2, 0.5, 0.005)
    w = 2 * np.pi * np.arange(1, 4) / 0.1
    position = poses_on(played, times[-1] - times[0], times[0])
    grid = times[0] + np.linspace(0, times[-1] - times[0], len(position.position_m))
    fine = np.stack([np.interp(times, grid, p) for p in (position.position_m * [1, -1, -1]).T], axis=1)
    # three harmonics have accelerations known exactly
    waves = np.hstack([np.cos(times[:, None] * w), np.sin(times[:, None] * w)])
    parts = np.linalg.lstsq(waves, fine, rcond=None)[0]
    acceleration = -waves @ (parts * np.tile(w, 2)[:, None] ** 2) + [0.3, 9.8, -0.2]
    record = ImuRecord(times, acceleration + rng.normal(0, 0.02, acceleration.shape), np.zeros((len(times), 3)), 0.002)
    found = poses_on(measured_path(commanded, record), 0.1)
    # 0.02 m/s^2 over 140 samples at 10 Hz: 0.6 um of each amplitude; the interpolated truth adds some
    np.testing.assert_allclose(found.position_m, poses_on(played, 0.1).position_m, atol=1e-5)
    assert np.abs(poses_on(commanded, 0.1).position_m - found.position_m).max() > 1e-4
    with pytest.raises(BadInput, match="two rounds or more"):
        measured_path(commanded, ImuRecord(times[:30], acceleration[:30], acceleration[:30]))


def test_the_scale_of_depth_is_as_uncertain_as_the_measured_amplitude(pictures):
    rng, angle = np.random.default_rng(9), 2 * np.pi * np.arange(32) / 32
    path = ShakerPath(1e-3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), 0.1 / 32, 0.0)
    times = np.arange(0, 0.4, 0.005)
    phase = 2 * np.pi * times / 0.1
    still = -1e-3 * (2 * np.pi / 0.1) ** 2 * np.stack([np.cos(phase), np.sin(phase), 0 * phase], axis=1)
    draws = [
        measured_path(path, ImuRecord(times, still + rng.normal(0, 0.3, still.shape), 0 * still)) for _ in range(200)
    ]
    errors = [np.linalg.norm(one.position_m - path.position_m) / np.linalg.norm(path.position_m) for one in draws]
    # the mean square of 200 draws, each of some ten normal numbers: within 10 %
    stated = np.mean([one.amplitude_uncertainty**2 for one in draws])
    assert stated == pytest.approx(np.mean(np.square(errors)), rel=0.1)
    angle = 2 * np.pi * np.arange(32) / 32
    circle = 1e-2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    paths = [ShakerPath(circle, OPEN_S / 32, 0.0, amplitude_uncertainty=one) for one in (0.02, 0.01)]
    frames = frames_of(pictures[1], 0.0, 0.0)
    frames = [replace(frame, imu=None, shaker_path=path) for frame, path in zip(frames, paths, strict=True)]
    assert recorded_motion(frames, FOCAL_PX).scale_uncertainty == 0.02
