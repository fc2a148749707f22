"""A rig that translates and rotates: poses from an inertial unit on it, and the resulting blur over the frame."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.outcome import BadInput, BadParameter, Refused
from procedures.raw import ImuRecord, ShakerPath
from procedures.restoration.masks import camera_motion as c
from procedures.restoration.masks.mask_fields import positions

from .velocity_field import Exposure, Motion, curve

OPEN_S = 0.2
OMEGA = 2 * np.pi * 10.0
SHIFT_M = np.array([2e-3, 1e-3, 5e-4])
TURN = np.array([3e-3, -4e-3, 0.02])
PHASES = np.array([0.0, 0.7, 1.9])
SHAPE = (96, 128)
FOCAL = 900.0
GRAVITY = np.array([0.0, 9.81, 0.0])


def truth(t):
    """Position and turn of the rig at times t, picture axes."""
    return tuple(
        size * np.cos(OMEGA * np.asarray(t)[:, None] + PHASES + more) for size, more in ((SHIFT_M, 0), (TURN, 1.3))
    )


def ideal(t):
    """Measurements of an ideal unit, in its axes, and the camera's velocity: by differences of the truth."""
    h = 1e-4
    before, now, after = (truth(t + d) for d in (-h, 0.0, h))
    turn, earlier, later = (Rotation.from_rotvec(one[1]) for one in (now, before, after))
    force = turn.inv().apply((before[0] - 2 * now[0] + after[0]) / h**2 - GRAVITY)
    rate = (earlier.inv() * later).as_rotvec() / (2 * h)
    return ImuRecord(t, force * c.FLIPPED, rate * c.FLIPPED), turn.inv().apply((after[0] - before[0]) / (2 * h))


def record(zero=0.0):
    """The same as a real one shows it, at 200 Hz, with zero errors."""
    imu, _ = ideal(np.arange(-0.3, 0.5, 0.005))
    return ImuRecord(
        imu.time_s,
        imu.acceleration_m_s2 + zero * np.array([0.3, -0.1, 0.2]),
        imu.rotation_rad_s + zero * np.array([0.01, 0.02, -0.03]),
    )


@pytest.fixture(scope="module")
def poses():
    return c.poses_of(record(zero=1.0), OPEN_S)


def test_poses_and_their_curves_are_recovered_from_the_records(poses):
    position, turn = truth(np.linspace(0, OPEN_S, c.INSTANTS))
    # the fitted line and parabola remove some hundredths of the motion
    assert np.abs(poses.turn_rad - turn).max() < 0.01 * np.abs(turn).max()
    assert np.abs(poses.position_m - position).max() < 0.03 * np.abs(position).max()
    # (5.1) integrated step by step over the same motion
    t = np.linspace(-0.05, OPEN_S, 1001)
    imu, speed = ideal(t)
    x, y, inverse = 0.06, -0.04, 0.8
    exposure = Exposure(0.0, OPEN_S, reference_s=0.0)
    count = int(np.sum((t >= -1e-9) & (t <= OPEN_S)))
    projected = c.image_curves(c.Poses(*truth(np.linspace(0, OPEN_S, count))), x, y, np.array([inverse]))[0]
    first = projected[0] + (x, y)
    stepped = curve(
        Motion(t, speed, imu.rotation_rad_s * c.FLIPPED), *first, 1 / inverse, steps=1001, exposure=exposure
    )
    # midpoint rule; the depth at the first instant is that at rest to 2e-3
    assert np.abs(projected + np.array([x, y]) - stepped).max() < 0.005 * np.abs(projected).max()
    t = np.linspace(0.0, OPEN_S, 4001)
    position, turn = truth(t)
    given = c.poses_at(t, position * c.FLIPPED, turn * c.FLIPPED)
    expected = truth(np.linspace(0, OPEN_S, c.INSTANTS))
    # linear between 4001 instants of two periods: (omega dt)^2 / 8
    np.testing.assert_allclose(given.position_m, expected[0], atol=2e-6 * np.abs(SHIFT_M).max())
    np.testing.assert_allclose(given.turn_rad, expected[1], atol=2e-6 * np.abs(TURN).max())
    t, position = np.linspace(0, 0.1, 9), np.arange(27.0).reshape(9, 3)
    ours, theirs = (c.poses_at(since + t, position, 0 * position) for since in (0.0, 1.75e9))
    # a double of 1.75e9 s resolves 2.4e-7 s, and the position moves by 240 m/s
    np.testing.assert_allclose(theirs.position_m, ours.position_m, atol=2e-4)


@pytest.mark.parametrize(
    ("times", "turn", "complaint"),
    [
        ([0.0], 0.0, "two times"),
        ([0.0, 0.0], 0.0, "must increase"),
        ([-1e308, 1e308], 0.0, "must be finite, from"),
        ([0.0, 0.1], 45.0, "half a turn"),
    ],
)
def test_invalid_poses_are_refused(times, turn, complaint):
    resting = np.zeros((len(times), 3))
    with pytest.raises(BadInput, match=complaint):
        c.poses_at(np.array(times), resting, np.linspace([0, 0, 0], [0, 0, turn], len(times)))


def test_rolling_blurs_the_corners_and_not_the_centre():
    n = 200
    roll = np.column_stack([np.zeros((n, 2)), 0.02 * np.sin(np.linspace(0, 2 * np.pi, n))])
    shift = np.column_stack([2e-3 * np.cos(np.linspace(0, 2 * np.pi, n)), np.zeros((n, 2))])
    blur = c.motion_blur([c.Poses(shift, roll)], FOCAL, SHAPE, 1.0)
    (field,) = blur.fields
    rows, columns = positions(field.grid, SHAPE, field.R)
    far = field.stacks[0][0].at(0.0)
    t = np.arange(-field.R, field.R + 1)
    spread = np.sqrt((far.sum(axis=1) @ t**2) + (far.sum(axis=0) @ t**2))
    distance = np.hypot(rows[0] - (SHAPE[0] - 1) / 2, columns[0] - (SHAPE[1] - 1) / 2)
    # a sine's standard deviation is its amplitude over the root of 2; the pixel's softness adds 0.3^2, interpolation
    # 1/3
    assert spread == pytest.approx(0.02 * distance / 2**0.5, rel=0.25)
    assert blur.px_per_inverse_m == pytest.approx(2e-3 * FOCAL, rel=0.03)
    assert blur.unit.per_pixel == pytest.approx(1 / blur.px_per_inverse_m)


def test_a_rig_without_rotation_needs_one_node():
    shift = 2e-3 * np.column_stack([np.cos(np.linspace(0, 6, 99)), np.sin(np.linspace(0, 6, 99)), np.zeros(99)])
    assert c.motion_blur([c.Poses(shift, np.zeros((99, 3)))], FOCAL, SHAPE, 1.0).fields[0].grid == (1, 1)


def spoiled():
    imu = record()
    t = imu.time_s
    return {
        "late": (replace(imu, time_s=t + 0.4), "cover the exposure"),
        "order": (replace(imu, time_s=t[::-1]), "increase"),
        "few": (ImuRecord(t[:5], imu.acceleration_m_s2[:5], imu.rotation_rad_s[:5]), "16 samples"),
        "nan": (replace(imu, acceleration_m_s2=imu.acceleration_m_s2 * np.nan), "must be finite"),
        "huge": (replace(imu, acceleration_m_s2=imu.acceleration_m_s2 * 1e300), "must be finite, from -1e.06"),
        "columns": (replace(imu, rotation_rad_s=imu.rotation_rad_s[:, :2]), r"array \(\d+, 3\)"),
        "ages": (replace(imu, time_s=np.where(t == t[0], -1e308, t)), "must be finite, from -1e.11"),
        "instant": (replace(imu, time_s=np.where(t == t[1], np.nextafter(t[0], 1), t)), "must increase by 1e-07 s"),
        "degrees": (replace(imu, rotation_rad_s=np.degrees(imu.rotation_rad_s)), "may rotate by up to"),
    }


@pytest.mark.parametrize("kind", ["late", "order", "few", "nan", "huge", "columns", "ages", "instant", "degrees"])
def test_invalid_records_are_refused(kind):
    imu, complaint = spoiled()[kind]
    with pytest.raises(BadInput, match=complaint) as refusal:
        c.poses_of(imu, OPEN_S)
    assert refusal.value.remedy


def test_insufficient_motion_and_a_rig_that_meets_the_scene_are_refused(poses):
    resting = c.Poses(np.zeros((9, 3)), poses.turn_rad[:9])
    with pytest.raises(Refused, match="must move parallel"):
        c.motion_blur([resting], FOCAL, SHAPE, 1.0)
    with pytest.raises(Refused, match="too little to determine depth"):
        c.motion_blur([poses], FOCAL, SHAPE, 0.05)
    with pytest.raises(BadParameter, match="must be positive"):
        c.motion_blur([poses], 0.0, SHAPE, 1.0)
    with pytest.raises(BadParameter, match="too large"):
        c.motion_blur([poses], FOCAL, SHAPE, 40.0)
    ahead = np.column_stack(
        [np.linspace(0, 1e-3, 9), np.zeros(9), np.linspace(0, 2, 9)]
    )  # a point 1 m away is in its path
    with pytest.raises(Refused, match="not into the scene"), np.errstate(divide="ignore", invalid="ignore"):
        c.motion_blur([c.Poses(ahead, np.zeros((9, 3)))], FOCAL, SHAPE, 1.0)


def test_masks_beyond_the_memory_are_refused(monkeypatch, poses):
    monkeypatch.setattr(c, "MOST_MASK_SAMPLES", 1000)
    with pytest.raises(BadParameter, match="up to 1000 samples, these would have"):
        c.motion_blur([poses], FOCAL, SHAPE, 1.0)


def test_a_unit_at_rest_measures_gravity_and_no_motion():
    t = np.arange(-0.1, 0.4, 0.005)
    still = c.poses_of(ImuRecord(t, np.tile([0.3, 9.8, -0.2], (len(t), 1)), np.zeros((len(t), 3))), OPEN_S)
    assert np.abs(still.position_m).max() < 1e-12


def commanded(since_s=0.0):
    """The translations of the same rig, as commanded to a shaker: 64 points of a round of 0.1 s."""
    t = np.arange(64) * (0.1 / 64)
    return ShakerPath(truth(t)[0] * c.FLIPPED, 0.1 / 64, since_s)


@pytest.mark.parametrize("since_s", [0.0, 0.033, 7.55])
def test_poses_are_those_of_the_commanded_path(since_s):
    poses = c.poses_on(commanded(since_s), OPEN_S)
    at = since_s + np.linspace(0, OPEN_S, len(poses.position_m))
    # error of a cubic spline through 64 points of a sine: h^4 / 384 of its fourth derivative, 1e-6 of it
    np.testing.assert_allclose(poses.position_m, truth(at)[0], atol=1e-8)
    assert not poses.turn_rad.any()


def test_a_partial_round_requires_its_start():
    given, unknown = (c.poses_on(commanded(since_s), 0.1) for since_s in (0.04, None))
    blurs = [c.planar_stacks([one.planar_path, one.planar_path], 4.0)[0] for one in (given, unknown)]
    first, second = (stack.masks[-1] for stack in blurs)
    np.testing.assert_allclose(first, second, atol=0.02 * first.max())
    with pytest.raises(BadInput, match=r"0.13 s is no whole number of rounds of 0.1 s, and its start is not known"):
        c.poses_on(commanded(None), 0.13)
