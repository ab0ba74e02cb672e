"""Robots in Gazebo: they see and hit what ours do, obey their limits, and their processes end."""

import copy
import json
import math
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from PIL import Image

from adrl import _core
from adrl.cli import main
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.envs import MILD, NavSim, Setting
from adrl.errors import ConfigError, MissingExtra, UnknownName, WorldError
from adrl.evaluation.drives import read_drives
from adrl.evaluation.results import compare_paired
from adrl.evaluation.rollout import rollout
from adrl.integrations.gazebo import Gazebo
from adrl.integrations.gazebo.server import gazebo_folder, is_installed, plugin_file
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.observation import EncoderConfig, to_action
from adrl.types import Task, World
from adrl.worlds import ROBOTS, SCENARIOS, load_robot, robot_from_fields, task_set
from adrl.worlds.shapes import box, enclosure

ROBOT = load_robot("diffbot")
TRIANGLE = np.array([(3.0, 3.0), (4.0, 3.2), (3.3, 4.1)])
ROOM = World(
    bounds=(0.0, 0.0, 6.0, 6.0),
    circles=np.array([(4.5, 1.5, 0.4)]),
    polygons=(TRIANGLE, box(1.5, 4.5, 0.8, 0.3, 0.7)),
    segments=enclosure((0.0, 0.0, 6.0, 6.0)),
)


@pytest.fixture(scope="module")
def gazebo() -> Iterator[Gazebo]:
    """Two robots. Where Gazebo is not set up: skipped, in CI failed."""
    if not is_installed() and os.environ.get("CI") != "true":
        pytest.skip("Gazebo is not set up; run scripts/gazebo-chroot")
    quiet = replace(ROBOT, lidar=replace(ROBOT.lidar, noise_std_m=0.0))
    with Gazebo(quiet, 2) as running:
        yield running


def a_task(start: tuple[float, float, float], world: World = ROOM) -> Task:
    path = np.array([start[:2], (5.0, 5.0)])
    return Task(world=world, start=start, goal=(5.0, 5.0), path=path, shortest_m=5.0, time_limit_s=60.0)


def a_sim(gazebo: Gazebo, *tasks: Task) -> NavSim:
    sim = NavSim(len(tasks), gazebo.robot, body=gazebo)
    sim.reset(np.arange(len(tasks)), tasks, np.zeros(len(tasks), np.uint64), np.random.default_rng(0))
    return sim


def action(speed_mps: float, yaw_rate_radps: float) -> np.ndarray:
    return np.array(
        [(2.0 * speed_mps / ROBOT.max_speed_mps - 1.0, yaw_rate_radps / ROBOT.max_yaw_rate_radps)]
    )


@pytest.mark.gazebo
class TestInGazebo:
    def test_both_simulators_see_the_same(self, gazebo: Gazebo) -> None:
        sim = a_sim(gazebo, a_task((1.0, 1.0, 0.6)), a_task((3.0, 5.0, -2.0)))
        for _ in range(4):
            for i in (0, 1):
                seen = _core.raycast(
                    ROOM.native, sim.b["pose"][i : i + 1], gazebo.robot.lidar.angles_rad, 6.0
                )
                # A wall is 0.01 m thick there, which a grazing beam meets early.
                assert np.median(np.abs(seen[0] - sim.b["ranges"][i])) < 0.007
                assert (np.abs(seen[0] - sim.b["ranges"][i]) < 0.05).mean() > 0.97
            sim.step(np.repeat(action(0.3, 0.5), 2, axis=0).astype(np.float32))

    def test_a_base_obeys_its_command_and_its_limits(self, gazebo: Gazebo) -> None:
        sim = a_sim(gazebo, a_task((1.0, 1.0, 0.6)))
        speeds = []
        for _ in range(15):
            sim.step(action(0.5, 0.0).astype(np.float32))
            speeds.append(sim.b["twist"][0, 0])
        assert speeds[0] == pytest.approx(ROBOT.max_acceleration_mps2 * 0.1, rel=0.1)
        assert speeds[-1] == pytest.approx(0.5, rel=0.02)
        travelled = float(np.hypot(*(sim.b["pose"][0, :2] - (1.0, 1.0))))
        assert sim.b["travelled"][0] == pytest.approx(travelled, abs=0.01)
        assert np.hypot(*(sim.b["odometry"][0, :2] - sim.b["pose"][0, :2])) < 0.02
        sim.reset(np.arange(1), [a_task((3.0, 1.0, 0.0))], np.zeros(1, np.uint64), np.random.default_rng(0))
        for _ in range(20):
            sim.step(action(0.0, 1.0).astype(np.float32))
        assert sim.b["pose"][0, 2] == pytest.approx(2.0 - 0.08, abs=0.06)

    def test_contact_ends_a_drive_where_the_footprint_meets_the_wall(self, gazebo: Gazebo) -> None:
        sim = a_sim(gazebo, a_task((5.0, 3.0, 0.0)), a_task((1.0, 1.0, 0.0)))
        commands = np.concatenate([action(0.5, 0.0), action(0.0, 0.0)]).astype(np.float32)
        outcome = sim.step(commands)
        while not outcome.collided[0] and sim.b["time"][0] < 5.0:
            outcome = sim.step(commands)
        assert outcome.collided[0]
        assert not outcome.collided[1]
        assert sim.b["pose"][0, 0] == pytest.approx(6.0 - ROBOT.circumscribed_radius_m, abs=0.03)
        assert sim.b["clearance"][0] < 0.03
        assert sim.b["travelled"][0] == pytest.approx(0.8, abs=0.03)

    def test_wheels_touch_no_wall_that_the_footprint_does_not(self, gazebo: Gazebo) -> None:
        """The Jackal's tyres are wider in the physics than it is itself."""
        jackal = load_robot("jackal")
        half = float(jackal.polygon[:, 1].max())
        wall = World(bounds=(0.0, 0.0, 6.0, 6.0), polygons=(box(2.5, 2.0, 4.0, 0.2, 0.0),))
        beside = 2.1 + half + 0.04
        with Gazebo(replace(jackal, lidar=replace(jackal.lidar, num_beams=36, noise_std_m=0.0))) as own:
            sim = a_sim(own, a_task((1.5, beside, 0.0), wall))
            for _ in range(20):
                outcome = sim.step(to_action(np.array([(0.8, 0.0)]), own.robot))
                assert not outcome.collided[0]
            x, y, yaw = sim.b["pose"][0]
        assert x > 2.5
        assert (y, yaw) == pytest.approx((beside, 0.0), abs=0.01)

    def test_a_base_lags_as_its_robot_does(self, gazebo: Gazebo) -> None:
        """A lag that nothing else of the base has: after a step of the command 1 - exp(-t / lag) of it."""
        slow = replace(gazebo.robot, lag_s=0.4, max_acceleration_mps2=20.0)
        with Gazebo(slow) as own:
            sim = a_sim(own, a_task((1.0, 1.0, 0.6)))
            for period in range(1, 13):
                sim.step(to_action(np.array([(0.5, 0.0)]), slow))
                share = 1.0 - math.exp(-0.1 * period / 0.4)
                assert sim.b["twist"][0, 0] == pytest.approx(0.5 * share, abs=0.02)

    def test_a_new_task_takes_the_place_of_the_old_world(self, gazebo: Gazebo) -> None:
        empty = World(bounds=(0.0, 0.0, 6.0, 6.0), circles=np.array([(5.0, 3.0, 0.3)]))
        sim = a_sim(gazebo, a_task((1.0, 1.0, 0.0)))
        for world in (empty, ROOM, empty):
            task = a_task((3.0, 2.0, 0.3), world)
            sim.reset(np.arange(1), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
            seen = _core.raycast(world.native, sim.b["pose"], gazebo.robot.lidar.angles_rad, 6.0)
            assert (np.abs(seen - sim.b["ranges"]) < 0.05).mean() > 0.97

    def test_discs_move_as_ours_do(self, gazebo: Gazebo) -> None:
        disc = np.array([(4.0, 1.0, 4.0, 3.0, 0.3, 0.5, 0.1, np.inf)])
        world = replace(ROOM, discs=disc)
        sim = a_sim(gazebo, a_task((2.5, 2.0, 0.0), world))
        for _ in range(30):
            sim.step(action(0.0, 0.0).astype(np.float32))
        time_s = float(sim.b["time"][0])
        assert time_s == pytest.approx(3.0)
        angles = gazebo.robot.lidar.angles_rad
        seen = _core.raycast(world.native, sim.b["pose"], angles, 6.0, time_s)
        assert (np.abs(seen - sim.b["ranges"]) < 0.05).mean() > 0.96

    def test_the_lidar_has_the_noise_of_the_robot_and_equal_seeds_give_equal_drives(
        self, gazebo: Gazebo
    ) -> None:
        """Drives of a policy that acts on its scan, so that its noise is in the poses too."""
        noisy = replace(ROBOT, lidar=replace(ROBOT.lidar, noise_std_m=0.03))
        task = a_task((1.0, 1.0, 0.6))
        with Gazebo(noisy) as own:
            sim = NavSim(1, noisy, body=own)

            def drive(seed: int, still: bool) -> np.ndarray:
                sim.reset(np.arange(1), [task], np.array([seed], np.uint64), np.random.default_rng(0))
                scans = [sim.b["ranges"][0].copy()]
                for _ in range(40):
                    left, right = scans[-1][90:].mean(), scans[-1][:90].mean()
                    sim.step(action(0.0, 0.0) if still else action(0.2, 0.5 * (left - right)))
                    scans.append(sim.b["ranges"][0].copy())
                return np.array(scans)

            scans = drive(1, still=True)
            truth = _core.raycast(ROOM.native, sim.b["pose"], noisy.lidar.angles_rad, 6.0)[0]
            error = (scans - truth)[:, truth < 5.5]
            assert error.std(axis=0).mean() == pytest.approx(0.03, rel=0.1)
            # Each beam its own, each time anew.
            assert abs(np.corrcoef(error[:, 3], error[:, 4])[0, 1]) < 0.6
            assert abs(np.corrcoef(error[:-1, 3], error[1:, 3])[0, 1]) < 0.6
            first, again, other = (drive(seed, still=False) for seed in (5, 5, 6))
        # Solver and resting contacts are not put back to the last bit.
        assert np.median(np.abs(first - again)) < 1e-3
        assert np.median(np.abs(first - other)) > 0.01

    def test_the_robot_of_the_ros_nodes_begins_anew_after_a_collision(self, gazebo: Gazebo) -> None:
        robot = SimulatedRobot(a_task((5.0, 3.0, 0.0)), gazebo.robot, body=gazebo)
        farthest = 0.0
        for _ in range(40):
            robot.command((0.5, 0.0))
            robot.advance()
            if robot.collisions:
                break
            farthest = robot.odometry.pose[0]
        assert farthest == pytest.approx(1.0 - ROBOT.circumscribed_radius_m, abs=0.1)
        assert robot.collisions == 1
        np.testing.assert_allclose(robot.pose, (5.0, 3.0, 0.0), atol=1e-3)
        np.testing.assert_allclose(robot.odometry.pose, 0.0, atol=1e-3)
        for _ in range(8):  # nobody tells it anything: its watchdog
            robot.advance()
        np.testing.assert_allclose(robot.odometry.twist, 0.0, atol=0.01)

    def test_it_cannot_be_put_back_amid_an_episode(self, gazebo: Gazebo) -> None:
        sim = a_sim(gazebo, a_task((1.0, 1.0, 0.6)))
        with pytest.raises(ConfigError, match="cannot be put back"):
            sim.set_state(sim.state(), sim.tasks)
        with pytest.raises(ConfigError, match="2 robots"):
            NavSim(3, gazebo.robot, body=gazebo)
        with pytest.raises(ConfigError, match="no randomization"):
            NavSim(1, gazebo.robot, body=gazebo, randomization=MILD)

    @pytest.mark.slow
    def test_the_shipped_policy_drives_as_it_does_in_our_simulator(self, gazebo: Gazebo) -> None:
        policy = load_policy(resolve_policy("diffbot"))
        robot = robot_from_fields(policy.config.robot)
        tasks = task_set(SCENARIOS["clutter"], robot, "test", 6)
        setting = Setting(
            robot=robot,
            guidance=policy.config.guidance,
            encoder=EncoderConfig(**policy.config.encoder),
        )
        native = rollout(policy, tasks, setting).episodes
        there = rollout(policy, tasks, setting, body=gazebo).episodes
        gap = compare_paired(there, native)
        assert abs(gap["success"].estimate) <= 1.0 / 6.0
        assert abs(gap["time_s"].estimate) <= 0.05 * native.time_s.mean()

    @pytest.mark.slow
    @pytest.mark.parametrize("name", [name for name in ROBOTS if name != "diffbot"])
    def test_every_robot_of_ours_drives(self, gazebo: Gazebo, name: str) -> None:
        env = gymnasium.make("adrl/Gazebo-v0", world="clutter", robot=name, guidance="map")
        try:
            env.reset(seed=0)
            base, info = env.unwrapped, {}
            for _ in range(30):
                _, _, terminated, _, info = env.step(base.expert_action())  # pyright: ignore
                if terminated:
                    break
            b = base._env.sim.b  # pyright: ignore
            assert not info["collision"]
            assert b["travelled"][0] > 0.5 * load_robot(name).max_speed_mps
            drift = np.hypot(*(b["odometry"][0, :2] - b["pose"][0, :2]))
            assert drift < 0.1 * b["travelled"][0] + 0.02
        finally:
            env.close()

    @pytest.mark.slow
    def test_it_follows_gymnasium_as_our_own_does(self, gazebo: Gazebo) -> None:
        """Without a seed it is no copy; infos are plain; steps without an episode and copies are refused."""
        env = gymnasium.make("adrl/Gazebo-v0", world="clutter", max_episode_steps=2).unwrapped
        vector = gymnasium.make_vec(
            "adrl/Gazebo-v0", num_envs=2, autoreset_mode="NextStep", max_episode_steps=2
        )
        still = np.array([-1.0, 0.0], np.float32)
        try:
            with pytest.raises(ResetNeeded):
                env.step(still)
            first, info = env.reset()
            assert info["is_success"] is False
            assert (first != env.reset()[0]).any()
            with pytest.raises(ConfigError, match="cannot be copied"):
                copy.deepcopy(env)
            # The noise alone differs: two robots draw it from one source there.
            np.testing.assert_allclose(vector.reset(seed=1)[0][1], env.reset(seed=2)[0], atol=0.1)
            both = np.tile(still, (2, 1))
            ended = [vector.step(both)[3].all() for _ in range(6)]
            assert ended == [False, True, False, False, True, False]
            with pytest.raises(UnknownName, match="render_mode"):
                gymnasium.make_vec("adrl/Gazebo-v0", render_mode="ansi")
        finally:
            env.close()
            vector.close()

    @pytest.mark.slow
    def test_a_policy_is_fine_tuned(self, gazebo: Gazebo, tmp_path: Path) -> None:
        arguments = ["train", "--env", "gazebo", "--fine-tune", "diffbot", "--method", "td3"]
        arguments += ["--guidance", "map", "--num-envs", "4", "--steps", "600", "--start-steps", "200"]
        arguments += ["--critic-warmup-updates", "8", "--task-pool", "4", "--out", str(tmp_path / "run")]
        assert main(arguments) == 0
        before, after = (load_policy(p).layers for p in (resolve_policy("diffbot"), tmp_path / "run"))
        change = [float(np.abs(a[0] - b[0]).max()) for a, b in zip(before, after, strict=True)]
        assert 0.0 < max(change) < 0.2


def test_without_gazebo_the_error_says_what_to_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ADRL_GAZEBO", str(tmp_path))
    assert gazebo_folder() == tmp_path
    with pytest.raises(MissingExtra, match="scripts/gazebo-chroot"):
        Gazebo(ROBOT)
    with pytest.raises(MissingExtra, match="scripts/gazebo-chroot"):
        gymnasium.make("adrl/Gazebo-v0", world="clutter")


@pytest.mark.parametrize("place", ["", "root/opt/adrl"])
def test_a_plugin_built_of_other_source_is_not_taken(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, place: str
) -> None:
    monkeypatch.setenv("ADRL_GAZEBO", str(tmp_path))
    built = tmp_path / place
    built.mkdir(parents=True, exist_ok=True)
    for old in ("libadrl_lockstep.so", "libadrl_lockstep-0123456789ab.so"):
        (built / old).touch()
    assert not is_installed()
    with pytest.raises(MissingExtra, match=plugin_file()):
        Gazebo(ROBOT)
    (built / plugin_file()).touch()
    assert is_installed()


@pytest.mark.gazebo
def test_a_gazebo_that_dies_is_told_and_leaves_nothing(gazebo: Gazebo) -> None:
    own = Gazebo(ROBOT)
    server = own._server
    assert server._process is not None
    server._process.kill()
    sim = NavSim(1, ROBOT, body=own)
    with pytest.raises(WorldError, match="Gazebo does not answer"):
        sim.reset(np.arange(1), [a_task((1.0, 1.0, 0.0))], np.zeros(1, np.uint64), np.random.default_rng(0))
    files = server._files
    own.close()
    own.close()
    assert not files.exists()


@pytest.mark.gazebo
@pytest.mark.slow
def test_transfer_pairs_the_simulators_and_explains_the_gap(gazebo: Gazebo, tmp_path: Path) -> None:
    out = tmp_path / "transfer"
    arguments = ["gazebo", "transfer", "--scenario", "clutter", "--episodes", "3", "--out", str(out)]
    assert main(arguments) == 0
    document = json.loads((out / "transfer.json").read_text())
    for name in ("native", "calibrated", "gazebo"):
        side = document[name]
        assert side["episodes"] == 3
        assert side["simulator"] == ("gazebo" if name == "gazebo" else "native")
        drives = read_drives(out / name / "drives.csv")
        assert set(drives.drive) == {0, 1, 2}
        assert side["tracking_error_mps"] == pytest.approx(drives.tracking_error()[0], rel=1e-3)
    gap = document["gap"]["native"]
    assert gap["success"] == pytest.approx(document["gazebo"]["success"] - document["native"]["success"])
    assert gap["time_s_low"] <= gap["time_s"] <= gap["time_s_high"]
    fit, limits = document["calibration"], np.array([ROBOT.max_speed_mps, ROBOT.max_yaw_rate_radps])
    after = np.array([fit["speed_error_mps"], fit["yaw_rate_error_radps"]]) / limits
    before = np.array([fit["speed_error_before_mps"], fit["yaw_rate_error_before_radps"]]) / limits
    assert after @ after <= before @ before + 1e-6


@pytest.mark.gazebo
@pytest.mark.slow
def test_a_film_shows_the_robot_on_its_way(gazebo: Gazebo, tmp_path: Path) -> None:
    out = tmp_path / "film.png"
    assert main(["gazebo", "film", "--scenario", "clutter", "--frames", "2", "--out", str(out)]) == 0
    pixels = np.asarray(Image.open(out).convert("RGB")).astype(int)
    blue = (pixels[..., 2] > 120) & (pixels[..., 0] < 80)
    middles = [np.argwhere(half).mean(axis=0) for half in (blue[:, :480], blue[:, 484:])]
    assert 20 < blue[:, :480].sum() < 4000
    assert np.hypot(*(middles[1] - middles[0])) > 50
