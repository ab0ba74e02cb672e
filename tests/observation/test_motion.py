"""Motion cues: still worlds read 0, what comes is negative, what goes positive; a slow twin of the kernel."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from adrl import _core
from adrl.envs import NavSim, NavVectorEnv
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig, ObservationEncoder, to_action
from adrl.observation.motion import ROUNDING_M, ScanHistory, motion_cue
from adrl.types import Array, LidarConfig, RobotConfig, Task
from adrl.worlds import ROBOTS, SCENARIOS, single_task, task_set
from env_tasks import quiet, room, wrapped

F32 = NDArray[np.float32]

STEPS = 4
CUES = EncoderConfig(history_steps=STEPS)
SECTORS = CUES.num_sectors
EVERY_ROBOT = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
seeds = st.integers(0, 2**32 - 1)


def start(robot: RobotConfig, tasks: list[Task], encoder: EncoderConfig = CUES) -> NavSim:
    sim = NavSim(len(tasks), robot, guidance="map", encoder=encoder)
    everyone = np.arange(len(tasks))
    sim.reset(everyone, tasks, everyone.astype(np.uint64), np.random.default_rng(0))
    return sim


def cues(sim: NavSim) -> F32:
    """(N, num_sectors)."""
    return sim.observe()[:, SECTORS + 8 :]


def sector_of(angle_rad: float) -> int:
    return int((wrapped(angle_rad) + math.pi) / (2.0 * math.pi) * SECTORS)


def with_disc(ends: tuple[float, float, float, float], speed_mps: float = 0.4) -> Task:
    """A robot at (0, 0) that looks along x in a wide room where one disc runs."""
    discs = np.array([[*ends, 0.25, speed_mps, 0.0, math.inf]])
    world = dataclasses.replace(room(), discs=discs)
    return single_task(world, (0.0, 0.0, 0.0), (4.0, 4.0), RobotConfig())


def stand(sim: NavSim, steps: int = STEPS) -> F32:
    for _ in range(steps):
        sim.step(to_action(np.zeros((sim.num_envs, 2)), sim.robot))
    return cues(sim)


@EVERY_ROBOT
def test_still_surroundings_read_zero_while_the_robot_drives_and_turns(robot: RobotConfig) -> None:
    """With sensor noise, in a dense world. One cue of a hundred may mistake an edge; moving discs make many more."""
    shares = []
    for scenario in ("complex", "dynamic"):
        sim = start(robot, task_set(SCENARIOS[scenario], robot, "train", 8))
        rng = np.random.default_rng(1)
        seen = []
        for _ in range(80):
            wild = 0.5 * rng.standard_normal((8, 2)).astype(np.float32)
            sim.step(np.asarray(sim.expert_actions() + wild, dtype=np.float32))
            seen.append(cues(sim))
        shares.append((np.abs(seen) > 0.1).mean())
    assert shares[0] < 0.01
    assert shares[1] > 2.0 * shares[0]


@given(seeds, st.floats(-0.6, 0.6), st.floats(-1.5, 1.5))
def test_an_empty_room_reads_exactly_zero(seed: int, speed: float, turn: float) -> None:
    robot = quiet(RobotConfig(min_speed_mps=-0.6))
    yaw = float(np.random.default_rng(seed).uniform(-math.pi, math.pi))
    sim = start(robot, [single_task(room(8.0), (0.3, -0.4, yaw), (2.0, 2.0), robot)])
    for _ in range(2 * STEPS):
        sim.step(to_action(np.array([[speed, turn]]), robot))
    assert not cues(sim).any()


def test_what_approaches_is_negative_in_its_sector_alone() -> None:
    ahead, behind, left = (
        stand(start(quiet(RobotConfig()), [with_disc(ends)]))[0]
        for ends in ((3.0, 0.05, 1.0, 0.05), (-3.0, 0.05, -1.0, 0.05), (0.05, 3.0, 0.05, 1.0))
    )
    for cue, angle in ((ahead, 0.02), (behind, math.pi - 0.02), (left, 0.5 * math.pi - 0.02)):
        there = sector_of(angle)
        assert cue[there] < -0.3
        far = np.abs((np.arange(SECTORS) - there + 18) % SECTORS - 18) > 2
        assert not cue[far].any()
        assert cue.max() <= 0.0


def test_what_leaves_is_positive_in_its_sector() -> None:
    cue = stand(start(quiet(RobotConfig()), [with_disc((1.0, 0.05, 3.0, 0.05))]))[0]
    assert cue[sector_of(0.02)] > 0.3
    assert cue.min() >= 0.0


def test_what_crosses_comes_before_itself_and_goes_behind() -> None:
    task = with_disc((1.2, -1.0, 1.2, 3.0), speed_mps=0.8)
    cue = stand(start(quiet(RobotConfig()), [task]), 2 * STEPS)[0]
    disc = math.atan2(-1.0 + 2 * STEPS * 0.1 * 0.8, 1.2)
    half = math.asin(0.25 / 1.25)
    front, behind = sector_of(disc + half), sector_of(disc - half)
    assert cue[front] == -1.0
    assert cue[behind - 1] == 1.0
    assert cue[:front].max() == 1.0
    assert cue[front:].max() == 0.0


def test_an_approaching_disc_is_told_from_driving_towards_a_pillar() -> None:
    """The same closing speed; only the disc moves by itself."""
    robot = quiet(RobotConfig())
    world = room(circles=[[2.2, 0.0, 0.25]])
    sim = start(robot, [single_task(world, (0.0, 0.0, 0.0), (4.0, 4.0), robot)])
    for _ in range(2 * STEPS):
        sim.step(to_action(np.array([[0.4, 0.0]]), robot))
    assert not cues(sim).any()


@given(
    seeds,
    st.integers(5, 120),
    st.one_of(st.just(2.0 * math.pi), st.floats(0.5, 6.0)),
    st.integers(4, 60),
    st.floats(-0.15, 0.15),
)
@example(0, 5, 6.0, 4, 0.0)  # less than half a beam is missing to the whole circle
def test_mirrored_world_mirrored_cue(seed: int, beams: int, fov: float, sectors: int, mount_x: float) -> None:
    robot = RobotConfig(lidar=LidarConfig(num_beams=beams, fov_rad=fov, mount_x_m=mount_x))
    rng = np.random.default_rng(seed)
    now, past = rng.uniform(0.2, 7.0, (2, 4, beams)).astype(np.float32)
    # Half of the robots have stood still: their points lie on beams and on borders of sectors.
    change = rng.uniform(-0.3, 0.3, (4, 3)) * [[1], [1], [0], [0]]
    whole = fov == 2.0 * math.pi
    order = -np.arange(beams) % beams if whole else np.arange(beams)[::-1]
    motion = motion_cue(robot, sectors, 3)
    one, other = np.empty((2, 4, sectors), np.float32)
    motion.compute(now, np.zeros((4, 3)), past, change, one)
    mirrored = change * [1.0, -1.0, -1.0]
    motion.compute(
        np.ascontiguousarray(now[:, order]),
        np.zeros((4, 3)),
        np.ascontiguousarray(past[:, order]),
        mirrored,
        other,
    )
    # A point between two beams may fall to either: one of the few numbers that few sectors have, or few of many.
    assert (np.abs(other - one[:, ::-1]) > 1e-4).sum() <= max(1, 0.02 * one.size)


def test_the_encoder_s_mirror_turns_cues_too() -> None:
    """A disc from ahead on the left, and the same on the right: one observation is the other's mirror."""
    left, right = (
        start(quiet(RobotConfig()), [with_disc((2.5, 1.5 * side, 0.5, 0.3 * side))]) for side in (1.0, -1.0)
    )
    stand(left)
    stand(right)
    mirror = left.encoder.mirror
    assert mirror is not None
    seen = left.observe()
    mirror.observation(seen)
    assert seen[:, SECTORS + 8 :].any()
    np.testing.assert_allclose(seen[:, SECTORS + 8 :], cues(right), atol=1e-4)


def slow_cue(
    robot: RobotConfig, now: Array, pose: Array, past: Array, past_pose: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """(S,) cues point by point, and which of them do not hang on rounding."""
    lidar, width = robot.lidar, 2.0 * math.pi / SECTORS
    margin, scale = ROUNDING_M + 3.0 * lidar.noise_std_m, STEPS * robot.control_period_s * robot.max_speed_mps
    come, gone, sure = np.zeros(SECTORS), np.zeros(SECTORS), np.full(SECTORS, True)

    def sensor(p: Array) -> tuple[float, float, float]:
        c, s = math.cos(p[2]), math.sin(p[2])
        x, y = lidar.mount_x_m, lidar.mount_y_m
        return p[0] + c * x - s * y, p[1] + s * x + c * y, p[2] + lidar.mount_yaw_rad

    def compare(scan: Array, at: Array, other: Array, other_at: Array, marks: Array, own: bool) -> None:
        x, y, yaw = sensor(at)
        ox, oy, oyaw = sensor(other_at)
        for i, (angle, reading) in enumerate(zip(lidar.angles_rad, scan, strict=True)):
            if reading >= lidar.max_range_m:
                continue
            px, py = x + reading * math.cos(yaw + angle) - ox, y + reading * math.sin(yaw + angle) - oy
            bearing = wrapped(math.atan2(py, px) - oyaw)
            beams = [wrapped(bearing - a) / lidar.angle_increment_rad for a in lidar.angles_rad]
            nearest = int(np.argmin(np.abs(beams)))
            inside = abs(beams[nearest]) <= 0.5 or 0 < nearest < len(scan) - 1
            turning = lidar.angles_rad[i] if own else bearing
            place = (wrapped(turning + lidar.mount_yaw_rad) + math.pi) / width
            sides = {int(place - 1e-3) % SECTORS, int(place + 1e-3) % SECTORS}
            close = abs(abs(beams[nearest]) - 0.5) < 2e-2 or abs(place - round(place)) < 2e-3
            neighbours = [other[(nearest + k) % len(scan)] for k in (-1, 0, 1)]
            metres = min(neighbours) - math.hypot(px, py) - margin
            for s in sides | ({(s + k) % SECTORS for s in sides for k in (-1, 1)} if close else set()):
                sure[s] &= not close
                marks[s] = max(marks[s], metres if inside else 0.0)

    compare(now, pose, past, past_pose, come, True)
    compare(past, past_pose, now, pose, gone, False)
    return np.clip(np.where(come > 0.0, -come, gone) / scale, -1.0, 1.0), sure


@given(seeds, st.floats(-4.0, 4.0), st.floats(-0.15, 0.15))
def test_the_kernel_is_its_slow_twin(seed: int, mount_yaw: float, mount_x: float) -> None:
    lidar = LidarConfig(num_beams=72, mount_x_m=mount_x, mount_y_m=0.05, mount_yaw_rad=mount_yaw)
    robot = RobotConfig(lidar=lidar)
    rng = np.random.default_rng(seed)
    smooth = 2.0 + np.cumsum(rng.normal(0.0, 0.1, (2, 72)), axis=1)
    now, past = np.clip(smooth, 0.3, 6.0).astype(np.float32)
    pose, past_pose = rng.uniform(-2.0, 2.0, 3), np.zeros(3)
    past_pose[:] = pose + rng.uniform(-0.2, 0.2, 3)
    out = np.empty((1, SECTORS), np.float32)
    motion_cue(robot, SECTORS, STEPS).compute(now[None], pose[None], past[None], past_pose[None], out)
    expected, sure = slow_cue(robot, now, pose, past, past_pose)
    np.testing.assert_allclose(out[0][sure], expected[sure], atol=5e-3)


@EVERY_ROBOT
def test_the_rest_of_the_observation_is_the_same_to_the_byte(robot: RobotConfig) -> None:
    tasks = task_set(SCENARIOS["dynamic"], robot, "train", 3)
    plain, cued = start(robot, tasks, EncoderConfig()), start(robot, tasks)
    assert plain.encoder.size + SECTORS == cued.encoder.size
    for _ in range(10):
        before, after = plain.observe(), cued.observe()
        assert before.tobytes() == np.ascontiguousarray(after[:, : before.shape[1]]).tobytes()
        assert np.abs(after).max() <= cued.encoder.limit
        actions = plain.expert_actions()
        plain.step(actions)
        cued.step(actions)
    assert plain.state().keys() < cued.state().keys()


def test_an_episode_begins_without_a_past() -> None:
    env = NavVectorEnv(4, scenario="dynamic", task_pool=4, encoder=CUES, autoreset_mode="Disabled")
    observation, _ = env.reset(seed=0)
    assert not observation[:, SECTORS + 8 :].any()
    for _ in range(3 * STEPS):
        observation, *_ = env.step(env.expert_actions())
    moving = observation[:, SECTORS + 8 :].any(axis=1)
    assert moving.any()
    mask = np.arange(4) == np.argmax(moving)
    again, _ = env.reset(options={"reset_mask": mask})
    assert not again[mask, SECTORS + 8 :].any()
    np.testing.assert_array_equal(again[~mask], observation[~mask])


def test_observing_twice_changes_nothing() -> None:
    sim = start(RobotConfig(), [with_disc((3.0, 0.0, 1.0, 0.0))])
    stand(sim)
    np.testing.assert_array_equal(sim.observe(), sim.observe())


def test_a_continued_simulation_gives_the_same_bytes() -> None:
    make = {"scenario": "dynamic", "task_pool": 8, "encoder": CUES, "guidance": "map"}
    env, other = NavVectorEnv(4, **make, seed=3), NavVectorEnv(4, **make, seed=4)  # pyright: ignore
    env.reset()
    other.reset()
    for _ in range(7):
        env.step(env.expert_actions())
    other.set_state(env.state())
    for _ in range(12):
        actions = env.expert_actions()
        assert env.step(actions)[0].tobytes() == other.step(actions)[0].tobytes()


def test_one_robot_with_its_own_history_sees_what_the_simulation_sees() -> None:
    """What a robot's runtime does: begin with the first scan, add every other, encode."""
    robot = ROBOTS["diffbot"]
    sim = start(robot, task_set(SCENARIOS["dynamic"], robot, "train", 3))
    encoder = ObservationEncoder(robot, CUES)
    history = ScanHistory(1, robot.lidar.num_beams, STEPS)
    history.begin(np.array([0]), sim.b["ranges"][1:2], sim.b["odometry"][1:2])
    for _ in range(3 * STEPS):
        sim.step(sim.expert_actions())
        scan = sim.b["ranges"][1:2]
        history.add(scan, sim.b["odometry"][1:2])
        still = np.zeros((1, 2))
        observation = encoder.encode(scan, still, still, still.astype(np.float32), history)
        np.testing.assert_array_equal(observation[:, SECTORS + 8 :], cues(sim)[1:2])


def test_cues_without_a_history_are_refused() -> None:
    still = np.zeros((1, 2))
    with pytest.raises(ValueError, match="history"):
        ObservationEncoder(RobotConfig(), CUES).encode(
            np.ones((1, 180), np.float32), still, still, still.astype(np.float32)
        )


@pytest.mark.parametrize("steps", [-1, 51])
def test_bad_history_names_the_option(steps: int) -> None:
    with pytest.raises(ConfigError, match=r"encoder.history_steps"):
        EncoderConfig(history_steps=steps)


def test_the_kernel_refuses_what_does_not_fit() -> None:
    cue = motion_cue(RobotConfig(), SECTORS, STEPS)
    ranges, poses, out = np.ones((2, 180), np.float32), np.zeros((2, 3)), np.empty((2, SECTORS), np.float32)
    cue.compute(ranges, poses, ranges, poses, out)
    for bad in (
        (ranges[:, :90].copy(), poses, ranges, poses, out),
        (ranges, poses[:1], ranges, poses, out),
        (ranges, poses, ranges[:1], poses, out),
        (ranges, poses, ranges, np.full((2, 3), np.nan), out),
        (ranges, poses, ranges, poses, out[:1]),
        (ranges, poses, ranges, poses, np.empty((2, 5), np.float32)),
    ):
        with pytest.raises(ValueError, match=r"num_beams|length|finite|num_sectors"):
            cue.compute(*bad)
    for beams, increment, sectors in (
        (0, 0.1, 36),
        (4000, 0.1, 36),
        (9, 0.0, 36),
        (9, 0.1, 0),
        (9, math.nan, 36),
    ):
        with pytest.raises(ValueError, match=r"num_beams|increment|num_sectors|finite"):
            _core.MotionCue(beams, 0.0, increment, (0.0, 0.0, 0.0), 6.0, sectors, 0.05, 0.3)


def test_broken_readings_do_no_harm() -> None:
    """Not-a-number and infinity, as drivers report them for nothing seen."""
    cue = motion_cue(RobotConfig(), SECTORS, STEPS)
    out = np.empty((1, SECTORS), np.float32)
    for value in (math.nan, math.inf, 0.0):
        broken = np.full((1, 180), value, np.float32)
        cue.compute(broken, np.zeros((1, 3)), broken, np.ones((1, 3)), out)
        assert np.isfinite(out).all()
        assert np.abs(out).max() <= 1.0
