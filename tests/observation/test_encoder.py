"""The encoder against a slow twin, its symmetries and its extremes."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.errors import ConfigError
from adrl.observation import EncoderConfig, ObservationEncoder, in_robot_frame, to_action, to_twist
from adrl.types import Array, LidarConfig, RobotConfig
from adrl.worlds import ROBOTS
from env_tasks import wrapped

lidars = st.builds(
    LidarConfig,
    num_beams=st.integers(1, 90),
    fov_rad=st.one_of(st.just(2.0 * math.pi), st.floats(0.2, 6.0)),
    max_range_m=st.floats(0.5, 30.0),
    mount_x_m=st.floats(-0.15, 0.15),
    mount_y_m=st.floats(-0.15, 0.15),
    # Not a borderline of the sectors by 1e-9 rad, where rounding decides.
    mount_yaw_rad=st.floats(-4.0, 4.0).map(lambda yaw: round(yaw, 4)),
)
CORNERS = ((0.3, 0.2), (-0.2, 0.25), (-0.25, -0.2), (0.25, -0.2))
robots = st.builds(
    lambda lidar, polygon: RobotConfig(
        radius_m=None if polygon else 0.25, footprint_m=CORNERS if polygon else None, lidar=lidar
    ),
    lidars,
    st.booleans(),
)
seeds = st.integers(0, 2**32 - 1)


def slow_extent(robot: RobotConfig, angle: float, step_m: float = 1e-4) -> float:
    """How far one can walk from the LiDAR along angle before leaving the footprint, in small steps."""
    reach = np.arange(0.0, 1.0, step_m)
    x = robot.lidar.mount_x_m + reach * math.cos(angle)
    y = robot.lidar.mount_y_m + reach * math.sin(angle)
    if robot.radius_m is not None:
        inside = np.hypot(x, y) <= robot.radius_m
    else:
        inside = np.full(len(reach), True)
        for (ax, ay), (bx, by) in zip(robot.polygon, np.roll(robot.polygon, -1, axis=0), strict=True):
            inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0
    return float(reach[np.argmin(inside)]) if inside[0] else 0.0


def slow_sectors(
    robot: RobotConfig, config: EncoderConfig, ranges: Array, extents: list[float]
) -> list[float]:
    """Sector by sector: the nearest beam at most half a sector off, from contact to far on a log scale."""
    half = math.pi / config.num_sectors
    sectors = []
    for s in range(config.num_sectors):
        centre = -math.pi + (2 * s + 1) * half
        nearest = robot.lidar.max_range_m
        for angle, reading in zip(robot.lidar.angles_rad + robot.lidar.mount_yaw_rad, ranges, strict=True):
            if abs(wrapped(angle - centre)) <= half + 1e-9:
                nearest = min(nearest, float(reading))
        gap = max(nearest - extents[s], 0.0)
        sectors.append(math.log1p(gap / config.near_m) / math.log1p(robot.lidar.max_range_m / config.near_m))
    return sectors


def encode_scan(robot: RobotConfig, config: EncoderConfig, ranges: Array) -> Array:
    n = len(ranges)
    encoder = ObservationEncoder(robot, config)
    still = np.zeros((n, 2), dtype=np.float32)
    scan = encoder.encode(ranges.astype(np.float32), np.ones((n, 2)), np.zeros((n, 2)), still)[
        :, : config.num_sectors
    ]
    return scan.astype(np.float64)


@given(robots, st.integers(4, 40), seeds)
def test_a_sector_is_its_nearest_beam(robot: RobotConfig, sectors: int, seed: int) -> None:
    config = EncoderConfig(num_sectors=sectors)
    ranges = np.random.default_rng(seed).uniform(0.0, robot.lidar.max_range_m, (2, robot.lidar.num_beams))
    ranges = ranges.astype(np.float32).astype(np.float64)
    extents = [slow_extent(robot, -math.pi + (2 * s + 1) * math.pi / sectors) for s in range(sectors)]
    expected = [slow_sectors(robot, config, row, extents) for row in ranges]
    np.testing.assert_allclose(encode_scan(robot, config, ranges), expected, atol=2e-3)


@pytest.mark.parametrize("name", ROBOTS)
def test_contact_reads_zero_and_free_space_one(name: str) -> None:
    """The footprint's own edge is contact all round, wherever the LiDAR sits; far walls read about 1."""
    robot = dataclasses.replace(ROBOTS[name], lidar=dataclasses.replace(ROBOTS[name].lidar, num_beams=37))
    config = EncoderConfig(num_sectors=2048)
    angles = robot.lidar.angles_rad + robot.lidar.mount_yaw_rad
    edge = np.array([[slow_extent(robot, a) for a in angles]])
    nearest_sector = (
        np.floor((np.remainder(angles + math.pi, 2 * math.pi)) / (2 * math.pi) * 2048).astype(int) % 2048
    )
    assert encode_scan(robot, config, edge)[0, nearest_sector].max() < 4e-3
    far = np.full_like(edge, robot.lidar.max_range_m)
    assert 0.95 < encode_scan(robot, config, far).min() <= encode_scan(robot, config, far).max() <= 1.0


@given(
    st.integers(2, 90),
    st.one_of(st.just(2.0 * math.pi), st.floats(0.2, 6.0)),
    st.integers(4, 60),
    st.floats(-0.15, 0.15),
    seeds,
)
def test_mirrored_world_mirrored_observation(
    beams: int, fov: float, sectors: int, mount_x: float, seed: int
) -> None:
    """Left and right swapped: sectors reversed, side, yaw rate and turn of the other sign, all else equal."""
    robot = RobotConfig(lidar=LidarConfig(num_beams=beams, fov_rad=fov, mount_x_m=mount_x))
    encoder = ObservationEncoder(robot, EncoderConfig(num_sectors=sectors))
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.0, 6.0, (3, beams)).astype(np.float32)
    goal, twist = rng.normal(size=(3, 2)) * 5.0, rng.uniform(-1.0, 1.0, (3, 2))
    action = rng.uniform(-1.0, 1.0, (3, 2)).astype(np.float32)
    full_circle = fov == 2.0 * math.pi  # its first beam, straight back, is its own mirror image
    mirrored_beams = -np.arange(beams) % beams if full_circle else np.arange(beams)[::-1]
    flip = np.array([1.0, -1.0])
    one = encoder.encode(ranges, goal, twist, action)
    other = encoder.encode(
        np.ascontiguousarray(ranges[:, mirrored_beams]),
        goal * flip,
        twist * flip,
        action * flip.astype(np.float32),
    )
    np.testing.assert_allclose(other[:, :sectors], one[:, :sectors][:, ::-1], atol=1e-6)
    signs = np.array([1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0, -1.0], dtype=np.float32)
    np.testing.assert_array_equal(other[:, sectors:], one[:, sectors:] * signs)


@pytest.mark.parametrize("name", ROBOTS)
def test_extremes_stay_finite_and_bounded(name: str) -> None:
    """Contact, nothing in sight, goals underfoot and beyond the horizon."""
    robot = ROBOTS[name]
    encoder = ObservationEncoder(robot)
    far = robot.lidar.max_range_m
    scans = np.repeat(
        np.array([0.0, 1e-30, far, 0.5 * far], dtype=np.float32)[:, None], robot.lidar.num_beams, 1
    )
    for goal in ([0.0, 0.0], [1e-300, 0.0], [-1e-12, 1e-12], [1e6, -1e6], [0.0, -1e12]):
        for extreme in (-1.0, 0.0, 1.0):
            twist = np.full((4, 2), extreme) * [robot.max_speed_mps, robot.max_yaw_rate_radps] * 1.99
            action = np.full((4, 2), extreme, dtype=np.float32)
            observation = encoder.encode(scans, np.tile(goal, (4, 1)), twist, action)
            assert observation.shape == (4, encoder.size)
            assert observation.dtype == np.float32
            assert np.isfinite(observation).all()
            assert np.abs(observation).max() <= encoder.limit
            assert observation[:, : encoder.config.num_sectors].min() >= 0.0


def test_nearer_is_never_more() -> None:
    """Sectors and both goal distances grow with the distance."""
    encoder = ObservationEncoder(RobotConfig())
    distance = np.linspace(0.0, 6.0, 200)
    ranges = np.repeat(distance.astype(np.float32)[:, None], 180, axis=1)
    goal = np.stack([distance, np.zeros(200)], axis=1)
    observation = encoder.encode(ranges, goal, np.zeros((200, 2)), np.zeros((200, 2), np.float32))
    grows = np.diff(observation, axis=0)
    assert (grows[:, :36] >= 0.0).all()
    assert (grows[:, 38:40] > 0.0).all()


@given(st.floats(0.05, 4.0), st.floats(-4.0, 0.0), st.floats(0.1, 6.0), seeds)
def test_to_twist_and_to_action_are_inverse(
    fastest: float, slowest: float, turning: float, seed: int
) -> None:
    robot = RobotConfig(max_speed_mps=fastest, min_speed_mps=slowest, max_yaw_rate_radps=turning)
    action = np.random.default_rng(seed).uniform(-1.0, 1.0, (50, 2)).astype(np.float32)
    action[:4] = [[-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [0.0, 0.0]]
    twist = to_twist(action, robot)
    np.testing.assert_allclose(to_action(twist, robot), action, atol=1e-6)
    np.testing.assert_allclose(twist[:2], [[slowest, -turning], [fastest, turning]])
    np.testing.assert_array_equal(
        to_twist(3.0 * action, robot), to_twist(np.clip(3.0 * action, -1, 1), robot)
    )


def test_forward_only_robot_stands_still_at_minus_one() -> None:
    np.testing.assert_array_equal(to_twist(np.array([[-1.0, 0.0]], np.float32), RobotConfig()), [[0.0, 0.0]])


@given(seeds)
def test_robot_frame_is_a_rotation(seed: int) -> None:
    """Lengths stay, the point ahead has y = 0, and turning the robot left moves the point right."""
    rng = np.random.default_rng(seed)
    pose, reach = rng.uniform(-3.0, 3.0, (20, 3)), rng.uniform(0.1, 5.0, 20)
    ahead = pose[:, :2] + reach[:, None] * np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1)
    np.testing.assert_allclose(
        in_robot_frame(pose, ahead), np.stack([reach, np.zeros(20)], axis=1), atol=1e-12
    )
    assert (in_robot_frame(pose + np.array([0.0, 0.0, 0.1]), ahead)[:, 1] < 0.0).all()


@pytest.mark.parametrize(
    ("name", "value"),
    [("num_sectors", 3), ("num_sectors", 2049), ("near_m", 0.0), ("goal_scale_m", math.nan)],
)
def test_bad_encoder_names_the_option(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"encoder.{name}"):
        EncoderConfig(**{name: value})  # pyright: ignore


@given(robots, st.integers(4, 40), seeds)
def test_the_mirror_gives_what_is_seen_in_the_mirrored_world(robot: RobotConfig, sectors: int, seed: int):
    """Scan, goal, turn and last action of the mirrored world; no mirror for a robot that is not symmetric."""
    config = EncoderConfig(num_sectors=sectors)
    lidar = dataclasses.replace(robot.lidar, mount_y_m=0.0, mount_yaw_rad=0.0)
    symmetric = dataclasses.replace(robot, radius_m=0.25, footprint_m=None, lidar=lidar)
    encoder, n = ObservationEncoder(symmetric, config), 5
    mirror = encoder.mirror
    assert mirror is not None
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.0, lidar.max_range_m, (n, lidar.num_beams)).astype(np.float32)
    apart = np.abs(np.exp(1j * lidar.angles_rad[:, None]) - np.exp(-1j * lidar.angles_rad))
    turned = np.argmin(apart, axis=0)
    goal, twist = rng.normal(size=(2, n, 2))
    action = rng.uniform(-1.0, 1.0, (n, 2)).astype(np.float32)
    flip = np.array([1.0, -1.0], np.float32)
    mirrored = encoder.encode(ranges, goal, twist, action)
    mirror.observation(mirrored)
    expected = encoder.encode(ranges[:, turned], goal * flip, twist * flip, action * flip)
    np.testing.assert_allclose(mirrored, expected, atol=1e-5)
    turned_action = action.copy()
    mirror.action(turned_action)
    np.testing.assert_array_equal(turned_action, action * flip)
    skew = dataclasses.replace(symmetric, lidar=dataclasses.replace(lidar, mount_y_m=0.1))
    assert ObservationEncoder(skew, config).mirror is None
