"""Points of the path ahead: where they lie, by each guidance, and how they are told."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.envs import NavSim, NavVectorEnv
from adrl.geometry import in_robot_frame
from adrl.imitation import find_expert
from adrl.observation import EncoderConfig, ObservationDecoder, ObservationEncoder
from adrl.observation.path_ahead import PATH_POINTS_M, PathAhead
from adrl.planning.path_guide import MapGuide
from adrl.planning.replanner import Replanner
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import RobotConfig, Task, World
from adrl.worlds import ROBOTS, get_scenario, single_task, task_set

TOLD = EncoderConfig(path=True)
ROBOT = dataclasses.replace(
    ROBOTS["diffbot"], lidar=dataclasses.replace(ROBOTS["diffbot"].lidar, noise_std_m=0.0)
)
CORNER = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]])
OPEN = World(bounds=(-6.0, -6.0, 6.0, 6.0))


def simulated(task: Task, guidance: str, robot: RobotConfig = ROBOT) -> NavSim:
    sim = NavSim(1, robot, guidance=guidance, encoder=TOLD)
    sim.reset(np.array([0]), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
    return sim


def around_the_corner() -> Task:
    return dataclasses.replace(single_task(OPEN, (0.0, 0.0, 0.0), (2.0, 3.0), ROBOT), path=CORNER)


def along(path: np.ndarray, metres: np.ndarray) -> np.ndarray:
    """(M, 2) points so far (M,) along a path."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    return np.stack([np.interp(metres, lengths, axis) for axis in path.T], axis=1)


def test_on_a_map_they_are_so_far_ahead_along_the_path() -> None:
    sim = simulated(around_the_corner(), "map")
    np.testing.assert_allclose(sim.b["path_ahead"][0], along(CORNER, PATH_POINTS_M), atol=1e-12)
    for _ in range(8):
        sim.step(np.array([[1.0, 0.0]], np.float32))
    come = sim.b["pose"][0, 0]
    assert come > 0.2
    np.testing.assert_allclose(sim.b["path_ahead"][0], along(CORNER, come + PATH_POINTS_M), atol=1e-6)


def test_beyond_the_end_they_lie_there() -> None:
    task = single_task(OPEN, (0.0, 0.0, 0.0), (1.2, 0.0), ROBOT)
    told = simulated(task, "map").b["path_ahead"][0]
    np.testing.assert_allclose(told[PATH_POINTS_M > 1.2], task.path[-1][None].repeat(3, axis=0), atol=1e-9)


def test_led_to_the_goal_alone_all_of_them_are_the_goal() -> None:
    task = around_the_corner()
    np.testing.assert_allclose(simulated(task, "goal").b["path_ahead"][0], np.tile(task.goal, (6, 1)))


def test_without_a_map_and_nothing_in_the_way_they_lie_straight_ahead() -> None:
    goal = np.array([2.0, 1.0])
    sim = simulated(single_task(OPEN, (-4.0, 0.0, 0.0), (2.0, 1.0), ROBOT), "replan")
    for _ in range(20):
        way = goal - sim.b["odometry"][0, :2]
        lengths = np.minimum(PATH_POINTS_M, np.hypot(*way))
        ahead = sim.b["odometry"][0, :2] + lengths[:, None] * way / np.hypot(*way)
        np.testing.assert_allclose(sim.b["path_ahead"][0], ahead, atol=1e-9)
        sim.step(np.array([[1.0, 0.1]], np.float32))


def test_without_a_map_and_with_a_wall_in_the_way_they_lie_on_the_robots_own_route() -> None:
    wall = np.array([[0.0, -2.0, 0.0, 2.0], [-1.5, -2.0, 0.0, -2.0], [-1.5, 2.0, 0.0, 2.0]])
    world = World(bounds=(-5, -5, 5, 5), segments=wall)
    sim = simulated(single_task(world, (-4.0, 0.0, 0.0), (2.0, 0.0), ROBOT), "replan")
    replanner = sim.replanner
    assert replanner is not None
    routed, arrived = 0, False
    for _ in range(250):
        told, here = sim.b["path_ahead"][0], sim.b["odometry"][0]
        if replanner.following[0]:
            route = replanner.b["corners"][0, : int(replanner.b["num_corners"][0])]
            near = along(route, np.linspace(0.0, 12.0, 2401))
            assert all(np.hypot(*(near - point).T).min() < 0.01 for point in told)
            routed += 1
        ahead = told[1] - here[:2]
        turn = (np.arctan2(ahead[1], ahead[0]) - here[2] + np.pi) % (2 * np.pi) - np.pi
        outcome = sim.step(
            np.array([[np.clip(1.0 - 2.0 * abs(turn), -1.0, 1.0), np.clip(turn, -1.0, 1.0)]], np.float32)
        )
        arrived = bool(outcome.reached[0])
        if arrived:
            break
    assert arrived, "who follows the second of them arrives"
    assert routed > 50


def test_the_guide_of_a_robot_tells_what_the_simulator_tells() -> None:
    robot = dataclasses.replace(ROBOT, min_turning_radius_m=0.6, min_speed_mps=-0.3)
    (task,) = task_set(get_scenario("complex"), robot, "validation", 1)
    sim, guide = simulated(task, "map", robot), MapGuide(task.world, robot)
    guide.follow(task.path)
    for k in range(60):
        guide.waypoint(tuple(sim.b["pose"][0].tolist()))
        np.testing.assert_array_equal(guide.path_ahead, sim.b["path_ahead"][0])
        sim.step(np.array([[0.6, np.sin(0.2 * k)]], np.float32))


@given(st.lists(st.tuples(*[st.floats(-50.0, 50.0)] * 2), min_size=6, max_size=6))
def test_each_is_a_vector_towards_it_of_length_below_1(points: list[tuple[float, float]]) -> None:
    encoder = ObservationEncoder(ROBOT, TOLD)
    path = np.array([points])
    told = encoder.encode(
        np.full((1, 180), 6.0, np.float32),
        np.ones((1, 2)),
        np.zeros((1, 2)),
        np.zeros((1, 2), np.float32),
        path=path,
    )[0, encoder.places["path"]].reshape(-1, 2)
    away, length = np.hypot(*path[0].T), np.hypot(*told.T.astype(float))
    np.testing.assert_allclose(length, away / (away + encoder.config.goal_scale_m), atol=1e-6)
    assert (np.einsum("ij,ij->i", path[0], told) >= -1e-9).all()
    mirrored = told.ravel().copy()
    component = encoder.components["path"]
    mirror = component.mirror()
    assert mirror is not None
    mirror.observation(mirrored)
    np.testing.assert_allclose(mirrored.reshape(-1, 2), told * [1.0, -1.0], atol=1e-7)


def test_an_encoder_without_its_path_says_so() -> None:
    encoder = ObservationEncoder(ROBOT, TOLD)
    with pytest.raises(ValueError, match="give path"):
        encoder.encode(
            np.full((1, 180), 6.0, np.float32),
            np.ones((1, 2)),
            np.zeros((1, 2)),
            np.zeros((1, 2), np.float32),
        )


def test_policies_of_before_see_and_say_the_same() -> None:
    assert "path" not in EncoderConfig().fields()
    assert EncoderConfig(path=True).fields()["path"] is True
    before, told = ObservationEncoder(ROBOT), ObservationEncoder(ROBOT, TOLD)
    assert told.size == before.size + PathAhead.size
    sim = NavSim(1, ROBOT, guidance="map")
    sim.reset(np.array([0]), [around_the_corner()], np.zeros(1, np.uint64), np.random.default_rng(0))
    np.testing.assert_array_equal(
        simulated(around_the_corner(), "map").observe()[:, : before.size], sim.observe()
    )
    assert "path_ahead" not in sim.b


def test_what_is_told_can_be_read_back() -> None:
    sim = simulated(around_the_corner(), "map")
    decoded = ObservationDecoder(ROBOT, TOLD).decode(sim.observe())
    np.testing.assert_allclose(
        decoded.path[0], in_robot_frame(sim.b["pose"], sim.b["path_ahead"][0]), atol=1e-4
    )


def test_the_narrow_shy_leaves_it_alone() -> None:
    env = NavVectorEnv(2, scenario="clutter", guidance="map", encoder=TOLD, task_pool=4, seed=1)
    env.reset()
    seen = env.sim.observe()
    find_expert("narrow-shy:0.8").driver(env, 0).actions()
    np.testing.assert_array_equal(env.sim.observe(), seen)


@pytest.mark.parametrize("car", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_points_of_a_route_are_those_of_its_slow_twin(car: bool, seed: int) -> None:
    """On routes that turn and turn back: a car is led to no point beyond the next cusp before it is there."""
    rng = np.random.default_rng(seed)
    robot = dataclasses.replace(ROBOT, min_turning_radius_m=0.6, min_speed_mps=-0.3) if car else ROBOT
    replanner = Replanner(1, robot, ReplannerConfig(cells=40), tells_path=True)
    route = np.cumsum(rng.normal(0.0, 0.8, (12, 2)), axis=0)
    steps, legs = np.hypot(*np.diff(route, axis=0).T), np.diff(route, axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(steps)])
    cusps = lengths[1:-1][(legs[1:] * legs[:-1]).sum(axis=1) < 0.0] if car else np.empty(0)
    b = replanner.b
    b["corners"][0, :12], b["num_corners"][0], b["along"][0] = route, 12, 0.0
    come, samples = 0.0, np.linspace(0.0, lengths[-1], 200_001)
    for share in np.linspace(0.0, 1.0, 25):
        here = along(route, np.array([share * lengths[-1]]))[0] + rng.normal(0.0, 0.02, 2)
        replanner.native.ahead(
            np.ones(1, np.uint8),
            np.array([[*here, 0.0]]),
            b["corners"],
            b["num_corners"],
            b["along"],
            b["path_ahead"],
        )
        most = min(come + 3.0, *cusps[cusps > come], lengths[-1])
        near = samples[(samples >= come) & (samples <= most + 1e-9)]
        come = near[np.hypot(*(along(route, near) - here).T).argmin()]
        if len(cusps) and np.any((most - come < 0.05) & np.isclose(most, cusps)):
            come = most
        assert b["along"][0] == pytest.approx(come, abs=1e-3)
        np.testing.assert_allclose(b["path_ahead"][0], along(route, come + PATH_POINTS_M), atol=2e-3)
        come = float(b["along"][0])
