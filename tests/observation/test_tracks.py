"""Tracks of what moves: none in still worlds, true places and velocities, and the same however they are had."""

import dataclasses
import math

import numpy as np
import pytest

from adrl import _core
from adrl.envs import NavSim, NavVectorEnv
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig, ObservationEncoder, to_action
from adrl.observation.config import FOLLOWED_STEPS
from adrl.observation.motion import F32, ScanHistory
from adrl.observation.tracks import FASTEST_MPS, NUMBERS
from adrl.types import Array, RobotConfig, Task
from adrl.worlds import FAMILIES, ROBOTS, SCENARIOS, single_task, task_set
from env_tasks import quiet, room

TRACKED = EncoderConfig(num_tracks=3)
EVERY_ROBOT = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)


def start(robot: RobotConfig, tasks: list[Task], encoder: EncoderConfig = TRACKED) -> NavSim:
    sim = NavSim(len(tasks), robot, guidance="map", encoder=encoder)
    everyone = np.arange(len(tasks))
    sim.reset(everyone, tasks, everyone.astype(np.uint64), np.random.default_rng(0))
    return sim


def tracks(sim: NavSim) -> F32:
    """(N, T, 5)."""
    return sim.observe()[:, sim.encoder.places["tracks"]].reshape(sim.num_envs, -1, NUMBERS)


def in_metres(told: F32, robot: RobotConfig) -> Array:
    """(..., 5) as the kernel has them: x, y, vx, vy, age."""
    nearness = np.hypot(told[..., 0], told[..., 1])
    reach = math.log1p(robot.lidar.max_range_m / TRACKED.near_m)
    away = TRACKED.near_m * np.expm1((1.0 - nearness) * reach)
    place = told[..., :2] * (away / np.maximum(nearness, 1e-9))[..., None]
    age = told[..., 4:] * FOLLOWED_STEPS * robot.control_period_s
    return np.concatenate([place, told[..., 2:4] * FASTEST_MPS, age], axis=-1, dtype=np.float64)


def with_discs(*rows: tuple[float, float, float, float, float]) -> Task:
    """A robot at (0, 0) that looks along x in a wide room; discs of 0.25 m from (x, y) to (x, y) at a speed."""
    discs = np.array([[*ends, 0.25, speed, 0.0, math.inf] for *ends, speed in rows])
    world = dataclasses.replace(room(), discs=discs)
    return single_task(world, (0.0, 0.0, 0.0), (4.0, 4.0), RobotConfig())


def drive(sim: NavSim, twist: tuple[float, float], steps: int = 2 * FOLLOWED_STEPS) -> F32:
    for _ in range(steps):
        sim.step(to_action(np.full((sim.num_envs, 2), twist), sim.robot))
    return tracks(sim)


@EVERY_ROBOT
def test_still_worlds_have_no_tracks_while_the_robot_drives_and_turns(robot: RobotConfig) -> None:
    """With sensor noise, among many small things: hardly ever one; moving discs make many more."""
    shares = []
    for scenario in ("complex", "dynamic"):
        sim = start(robot, task_set(SCENARIOS[scenario], robot, "train", 8))
        rng = np.random.default_rng(1)
        seen = []
        for _ in range(60):
            wild = 0.5 * rng.standard_normal((8, 2)).astype(np.float32)
            sim.step(np.asarray(sim.expert_actions() + wild, dtype=np.float32))
            seen.append(tracks(sim)[:, 0].any(axis=1))
        shares.append(float(np.mean(seen)))
    assert shares[0] < 0.04
    assert shares[1] > 2.0 * shares[0] + 0.02


@pytest.mark.parametrize("turn", [-1.5, 0.0, 1.5])
def test_an_empty_room_has_none_to_the_last_bit(turn: float) -> None:
    robot = quiet(RobotConfig())
    sim = start(robot, [single_task(room(8.0), (0.3, -0.4, 0.7), (2.0, 2.0), robot)])
    assert not drive(sim, (0.3, turn)).any()


@pytest.mark.parametrize("twist", [(0.0, 0.0), (0.4, 0.0), (0.2, 0.6), (0.0, -1.0)])
@pytest.mark.parametrize(
    "way", [(1.6, -1.5, 1.6, 3.0, 1.0), (3.5, 0.4, -3.0, 0.4, 0.8), (1.0, 1.0, 4.0, 1.0, 1.4)]
)
def test_a_disc_that_moves_past_has_its_velocity_and_place_whatever_the_robot_does(
    way: tuple[float, float, float, float, float], twist: tuple[float, float]
) -> None:
    robot = quiet(RobotConfig())
    sim = start(robot, [with_discs(way)])
    (nearest, *others) = in_metres(drive(sim, twist)[0], robot)
    assert not np.any([other[2:] for other in others])
    x, y, yaw = sim.b["pose"][0]
    c, s = math.cos(yaw), math.sin(yaw)
    a, b = np.array(way[:2]), np.array(way[2:4])
    ahead = (b - a) / math.dist(a, b)
    disc = a + way[4] * sim.b["time"][0] * ahead
    place = np.array([x + c * nearest[0] - s * nearest[1], y + s * nearest[0] + c * nearest[1]])
    velocity = np.array([c * nearest[2] - s * nearest[3], s * nearest[2] + c * nearest[3]])
    # What is seen is the side that faces the robot, and which side that is changes as the disc goes by.
    np.testing.assert_allclose(velocity, way[4] * ahead, atol=0.2)
    assert math.dist(place, disc) < 0.27
    assert nearest[4] == pytest.approx(FOLLOWED_STEPS * robot.control_period_s)


def test_the_nearest_come_first_and_there_are_no_more_than_move() -> None:
    robot = quiet(RobotConfig())
    sim = start(robot, [with_discs((3.0, -1.5, 3.0, 3.0, 0.8), (1.2, 0.8, -4.0, 0.8, 0.8))])
    near, far, none = in_metres(drive(sim, (0.0, 0.0))[0], robot)
    assert 0.5 < math.hypot(*near[:2]) < 1.5 < math.hypot(*far[:2]) < 4.0
    assert near[2] < -0.6
    assert far[3] > 0.6
    assert not none[2:].any()


def test_age_rises_from_nothing_to_one() -> None:
    sim = start(quiet(RobotConfig()), [with_discs((1.6, -1.5, 1.6, 3.0, 1.0))])
    assert not tracks(sim).any()
    ages = [float(drive(sim, (0.0, 0.0), 1)[0, 0, 4]) for _ in range(8)]
    assert ages == sorted(ages)
    assert ages[0] == 0.0
    assert ages[-1] == 1.0


def test_the_encoder_s_mirror_is_the_mirrored_world_s() -> None:
    rows = ((2.5, 1.5, 0.5, 0.3, 0.5), (-1.0, -2.0, 2.0, -1.2, 1.1))
    mirrored = tuple((x, -y, to_x, -to_y, speed) for x, y, to_x, to_y, speed in rows)
    left, right = (start(quiet(RobotConfig()), [with_discs(*side)]) for side in (rows, mirrored))
    drive(left, (0.3, 0.4))
    drive(right, (0.3, -0.4))
    mirror = left.encoder.mirror
    assert mirror is not None
    seen = left.observe()
    assert tracks(left)[0, 1].any()
    mirror.observation(seen)
    np.testing.assert_allclose(
        seen[:, left.encoder.places["tracks"]], tracks(right).reshape(1, -1), atol=1e-3
    )


@EVERY_ROBOT
def test_the_rest_of_the_observation_is_the_same_to_the_byte(robot: RobotConfig) -> None:
    """With tracks, with cues of another age beside them, and without either."""
    tasks = task_set(SCENARIOS["dynamic"], robot, "train", 3)
    both = EncoderConfig(num_tracks=3, history_steps=2)
    plain, cued, all_told = (
        start(robot, tasks, config) for config in (EncoderConfig(), EncoderConfig(history_steps=2), both)
    )
    for _ in range(10):
        whole = all_told.observe()
        for sim in (plain, cued):
            assert sim.observe().tobytes() == np.ascontiguousarray(whole[:, : sim.encoder.size]).tobytes()
        assert np.abs(whole).max() <= all_told.encoder.limit
        actions = plain.expert_actions()
        for sim in (plain, cued, all_told):
            sim.step(actions)


def test_robots_of_several_kinds_see_what_each_alone_sees() -> None:
    robots = [FAMILIES["any"].draw("train", number) for number in range(4)]
    shared = ObservationEncoder(robots, dataclasses.replace(TRACKED, reach_m=10.0))
    beams = max(robot.lidar.num_beams for robot in robots)
    history = ScanHistory(4, beams, FOLLOWED_STEPS)
    rng = np.random.default_rng(0)
    own = []
    for i, robot in enumerate(robots):
        disc = with_discs((2.0, -1.5, 2.0, 3.0, 1.0))
        sim = start(robot, [disc], shared.config)
        for k in range(FOLLOWED_STEPS + 3):
            sim.step(to_action(rng.uniform(0.0, 0.3, (1, 2)), robot))
            newest = (k + 1) % (FOLLOWED_STEPS + 1)
            history.arrays["past_ranges"][newest, i, : robot.lidar.num_beams] = sim.b["ranges"][0]
            history.arrays["past_odometry"][newest, i] = sim.b["odometry"][0]
            history.arrays["newest"][0] = newest
        own.append(tracks(sim)[0])
    still = np.zeros((4, 2))
    ranges = history.arrays["past_ranges"][int(history.arrays["newest"][0])]
    seen = shared.encode(ranges, still, still, still.astype(np.float32), history, kind=np.arange(4))
    np.testing.assert_array_equal(seen[:, shared.places["tracks"]].reshape(4, -1, NUMBERS), own)
    assert np.any(own)


def test_a_continued_simulation_gives_the_same_bytes_and_an_episode_begins_without_a_past() -> None:
    make = {"scenario": "dynamic", "task_pool": 8, "encoder": TRACKED, "guidance": "map"}
    env, other = NavVectorEnv(4, **make, seed=3), NavVectorEnv(4, **make, seed=4)  # pyright: ignore
    first, _ = env.reset()
    other.reset()
    assert not first[:, -TRACKED.num_tracks * NUMBERS :].any()
    for _ in range(7):
        env.step(env.expert_actions())
    other.set_state(env.state())
    for _ in range(8):
        actions = env.expert_actions()
        assert env.step(actions)[0].tobytes() == other.step(actions)[0].tobytes()


def test_an_encoder_without_tracks_is_stored_as_before() -> None:
    assert "num_tracks" not in EncoderConfig().fields()
    assert EncoderConfig(**TRACKED.fields()) == TRACKED
    assert EncoderConfig().past_steps == 0


def test_bad_input_is_told() -> None:
    with pytest.raises(ConfigError, match=r"encoder.num_tracks"):
        EncoderConfig(num_tracks=-1)
    still = np.zeros((1, 2))
    with pytest.raises(ValueError, match="history"):
        ObservationEncoder(RobotConfig(), TRACKED).encode(
            np.ones((1, 180), np.float32), still, still, still.astype(np.float32)
        )
    of_one = _core.NearestTracks(9, 0.0, 0.1, (0.0, 0.0, 0.0), 6.0, 0.1, 2)
    native = _core.NearestTracksOfKinds([of_one])
    kind, ranges, poses = np.zeros(1, np.int64), np.ones((3, 1, 9), np.float32), np.zeros((3, 1, 3))
    out = np.empty((1, 2, NUMBERS), np.float32)
    native.compute(kind, ranges, poses, 0, 3, out)
    for bad in (
        (kind, ranges[:, :, :5].copy(), poses, 0, 3, out),
        (kind, ranges, poses[:2], 0, 3, out),
        (kind, ranges, np.full((3, 1, 3), np.nan), 0, 3, out),
        (kind, ranges, poses, 3, 3, out),
        (kind, ranges, poses, 0, 4, out),
        (kind + 1, ranges, poses, 0, 3, out),
        (kind, ranges, poses, 0, 3, out[:, :1].copy()),
    ):
        with pytest.raises(ValueError, match=r"ranges|poses|newest|count|kind|out"):
            native.compute(*bad)
    with pytest.raises(ValueError, match="beams"):
        _core.Tracker().take(
            0.0, (0.0, 0.0, 0.0), 0.0, 0.1, np.ones(9), np.array([3, 2], np.int32), np.zeros((2, 2))
        )
