"""Noise, dropouts, latency, drift and randomisation do what they say; the nominal robot has its own only."""

import dataclasses

import numpy as np
import pytest

from adrl import _core
from adrl.envs import MILD, NOMINAL, NavVectorEnv, Randomization
from adrl.envs.randomization import draw_params, nominal_params
from adrl.errors import ConfigError
from adrl.types import Array, LidarConfig, RobotConfig, World
from adrl.worlds import ROBOTS, single_task
from env_tasks import OneTask, quiet, room, straight_task

STOP = np.array([-1.0, 0.0], dtype=np.float32)
PILLARS = [(-3.0, 0.5, 0.4), (-2.0, 1.5, 0.3), (-1.5, -1.5, 0.5)]


def standing_scans(robot: RobotConfig, steps: int, rows: int = 8, **options: object) -> tuple[Array, Array]:
    """(steps, rows, K) ranges of robots that stand among pillars, and (K,) exact ones."""
    world = room(circles=PILLARS)
    task = single_task(world, (-2.0, 0.0, 0.0), (2.0, 0.0), robot)
    env = NavVectorEnv(rows, scenario=OneTask(task), robot=robot, **options)  # pyright: ignore
    env.reset(seed=0)
    scans = []
    for _ in range(steps):
        env.step(np.tile(STOP, (rows, 1)))
        scans.append(env.sim.b["ranges"].copy())
    return np.stack(scans), exact_scan(world, robot)


def exact_scan(world: World, robot: RobotConfig) -> Array:
    pose = np.array([[-2.0 + robot.lidar.mount_x_m, robot.lidar.mount_y_m, robot.lidar.mount_yaw_rad]])
    return _core.raycast(world.native, pose, robot.lidar.angles_rad, robot.lidar.max_range_m)[0]


def with_lidar(**changes: object) -> RobotConfig:
    return RobotConfig(lidar=LidarConfig(**changes))  # pyright: ignore


def test_a_quiet_lidar_is_exact() -> None:
    scans, exact = standing_scans(quiet(RobotConfig()), 3, randomize=False)
    assert (scans == exact).all()


def test_range_noise_has_the_stated_spread() -> None:
    """Zero mean, the stated deviation, independent between beams, steps and rows; free beams stay free."""
    scans, exact = standing_scans(with_lidar(noise_std_m=0.05), 60, randomize=False)
    hit = exact < 5.5
    error = (scans - exact)[:, :, hit]
    assert abs(error.mean()) < 0.05 * 4.0 / np.sqrt(error.size)
    assert error.std() == pytest.approx(0.05, rel=0.03)
    flat = error.reshape(60 * 8, -1)
    for one, other in ((error[:-1], error[1:]), (error[:, :-1], error[:, 1:]), (flat[:, :-1], flat[:, 1:])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.02
    assert (scans[:, :, exact >= 6.0] == 6.0).all()
    assert scans.max() <= 6.0


def test_dropouts_have_the_stated_rate() -> None:
    scans, exact = standing_scans(with_lidar(noise_std_m=0.0, dropout_probability=0.2), 60, randomize=False)
    dropped = scans[:, :, exact < 5.5] == 6.0
    assert dropped.mean() == pytest.approx(0.2, abs=4.0 * np.sqrt(0.16 / dropped.size))
    np.testing.assert_array_equal(
        scans[:, :, exact < 5.5][~dropped], np.broadcast_to(exact, scans.shape)[:, :, exact < 5.5][~dropped]
    )


@pytest.mark.parametrize("periods", [0, 1, 3, 7])
def test_latency_delays_the_motion_by_whole_periods(periods: int) -> None:
    """The robot does what it would have done without latency, that many periods later."""
    tracks = []
    for latency in (0.0, periods * 0.1):
        robot = dataclasses.replace(quiet(RobotConfig()), latency_s=latency)
        env = NavVectorEnv(1, scenario=OneTask(straight_task(robot)), robot=robot, randomize=False)
        env.reset(seed=0)
        rng = np.random.default_rng(0)
        track = []
        for _ in range(30):
            env.step(rng.uniform(-1.0, 1.0, (1, 2)).astype(np.float32))
            track.append(env.sim.b["pose"][0].copy())
        tracks.append(np.array(track))
    on_time, late = tracks
    np.testing.assert_allclose(late[periods:], on_time[: 30 - periods], atol=1e-12)
    np.testing.assert_array_equal(late[:periods], np.tile([-2.0, 0.0, 0.0], (periods, 1)))


def drift_run(drift: float, guidance: str = "goal") -> NavVectorEnv:
    robot = dataclasses.replace(quiet(RobotConfig()), odometry_drift=drift)
    task = straight_task(robot, 6.0, time_limit_s=100.0)
    env = NavVectorEnv(400, scenario=OneTask(task), robot=robot, guidance=guidance, randomize=False)
    env.reset(seed=0)
    for _ in range(60):
        env.step(np.tile(np.array([1.0, 0.0], dtype=np.float32), (400, 1)))
    return env


def test_without_drift_odometry_is_the_truth() -> None:
    env = drift_run(0.0)
    np.testing.assert_array_equal(env.sim.b["odometry"], env.sim.b["pose"])


def test_odometry_drift_has_the_stated_spread() -> None:
    """A relative error of the distance, drawn once an episode: normal with the stated standard deviation."""
    env = drift_run(0.1)
    true = env.sim.b["pose"][:, 0] + 2.0
    error = (env.sim.b["odometry"][:, 0] + 2.0) / true - 1.0
    assert abs(error.mean()) < 0.1 * 4.0 / np.sqrt(400)
    assert error.std() == pytest.approx(0.1, rel=0.15)
    assert error.std() == pytest.approx(env.sim.b["params"][:, 8].std(), rel=1e-6)


@pytest.mark.parametrize(("guidance", "drifts"), [("goal", True), ("map", False)])
def test_only_a_mapless_robot_sees_its_drift(guidance: str, drifts: bool) -> None:
    """The goal's direction and distance come from odometry without a map, from localisation with one."""
    env = drift_run(0.1, guidance)
    goal = env.sim.observe()[:, env.sim.encoder.config.num_sectors :][:, :4]
    assert (np.ptp(goal, axis=0).max() > 1e-3) == drifts


@pytest.mark.parametrize("name", ROBOTS)
def test_the_nominal_robot_is_the_configured_one(name: str) -> None:
    robot = ROBOTS[name]
    env = NavVectorEnv(16, robot=robot, randomize=False)
    env.reset(seed=0)
    lidar = robot.lidar
    limits = [robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2, robot.lag_s, robot.latency_s]
    expected = [1.0, 1.0, *limits, lidar.noise_std_m, lidar.dropout_probability, 0.0, 0.0]
    np.testing.assert_array_equal(env.sim.b["params"], np.tile(expected, (16, 1)))


def test_randomisation_stays_in_its_ranges_and_fills_them() -> None:
    robot = RobotConfig(latency_s=0.1, lidar=LidarConfig(dropout_probability=0.1))
    r = Randomization(
        gain=0.1, acceleration=0.3, lag=0.4, latency_s=0.2, range_noise=0.5, dropout_probability=0.2
    )
    nominal = nominal_params(robot)
    drawn = draw_params([robot] * 20_000, r, np.random.default_rng(0))
    relative = np.array([0.1, 0.1, 0.3, 0.3, 0.4, 0.0, 0.5, 0.0])
    low, high = nominal[:8] * (1.0 - relative), nominal[:8] * (1.0 + relative)
    high[[5, 7]] += [0.2, 0.2]
    spread = high - low
    assert (drawn[:, :8] >= low).all()
    assert (drawn[:, :8] <= high).all()
    np.testing.assert_allclose(drawn[:, :8].min(axis=0), low, atol=1e-3 * spread.max())
    np.testing.assert_allclose(drawn[:, :8].max(axis=0), high, atol=1e-3 * spread.max())
    np.testing.assert_allclose(drawn[:, :8].mean(axis=0), 0.5 * (low + high), atol=0.02 * spread.max())
    correlation = np.corrcoef(drawn[:, :8].T)
    assert np.abs(correlation - np.eye(8)).max() < 0.05


def test_mild_is_the_default_and_differs_between_episodes() -> None:
    env = NavVectorEnv(32)
    env.reset(seed=0)
    first = env.sim.b["params"].copy()
    assert len(np.unique(first[:, 0])) == 32
    assert np.abs(first[:, :2] - 1.0).max() <= MILD.gain
    env.reset()
    assert (env.sim.b["params"][:, 0] != first[:, 0]).all()
    assert Randomization() == NOMINAL


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(Randomization)])
@pytest.mark.parametrize("value", [-0.1, 1.0, float("nan")])
def test_bad_randomisation_names_the_option(field: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"randomization.{field}"):
        Randomization(**{field: value})
