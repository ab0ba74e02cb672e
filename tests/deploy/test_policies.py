"""Policies of one's own: found by every form of name, run as they ask to be, refused in one line."""

import dataclasses
import json
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import adrl
from adrl import registry
from adrl.api import PLANNER
from adrl.baselines.planners import PLANNERS
from adrl.deploy import Navigator, Odometry, Scan, find_policy
from adrl.envs import NavSim
from adrl.errors import AdrlError, CheckpointError, ConfigError, MissingExtra, UnknownName
from adrl.export.onnx_graph import to_onnx
from adrl.observation import Measurements, ObservationDecoder, to_action
from adrl.types import Array, LidarConfig, RobotConfig
from adrl.worlds import ROBOTS
from deploy.recorded import a_policy
from refusals import Adrl
from small_run import run_cli

F32 = NDArray[np.float32]


class PurePursuit:
    """Follows waypoints on circles."""

    name = "pursuit"
    guidance = "map"
    robot = "diffbot"
    training_worlds = ()

    def __init__(self) -> None:
        self.decoder = ObservationDecoder(ROBOTS["diffbot"])

    def act(self, observation: F32) -> F32:
        robot, goal = self.decoder.robot, self.decoder.decode(observation).goal
        curvature = 2.0 * goal[:, 1] / np.maximum((goal**2).sum(axis=1), 0.01)
        speed = np.where(goal[:, 0] < 0.0, 0.05, robot.max_speed_mps / (1.0 + np.abs(curvature)))
        turn = np.where(goal[:, 0] < 0.0, np.sign(goal[:, 1]) * robot.max_yaw_rate_radps, speed * curvature)
        return to_action(np.stack([speed, turn], axis=1), robot)


class MeasuredPursuit(PurePursuit):
    """The same of measurements."""

    encoder = Measurements()

    def act(self, observation: F32) -> F32:
        assert observation.shape[1] == 186
        self.decoder.decode = lambda _: self.encoder.split(observation)  # type: ignore[method-assign]
        return super().act(observation)


class Remembers(PurePursuit):
    """Counts its steps, and is told when they begin."""

    def __init__(self) -> None:
        super().__init__()
        self.steps = np.full(3, -1)

    def reset(self, rows: NDArray[np.intp]) -> None:
        self.steps[rows] = 0

    def act(self, observation: F32) -> F32:
        assert (self.steps >= 0).all()
        self.steps += 1
        return super().act(observation)


class LooksIn(PurePursuit):
    """Drives by what the simulator holds, and keeps it; whether it is led tells what it says of itself."""

    guidance = "replan"
    guidances = ("map", "replan")

    def act_in(self, sim: NavSim) -> F32:
        self.sim = sim
        return super().act(sim.observe())


class PlansItself(LooksIn):
    plans_itself = True


def run_navigator(navigator: Navigator, steps: int) -> Array:
    """(steps, 2) commands to a robot that is held in place, in the open, on its way to a goal."""
    lidar = navigator.robot.lidar
    navigator.set_goal((4.0, 1.0))
    twists = []
    for k in range(steps):
        now_s = 0.1 * k
        scan = Scan(
            ranges=np.linspace(1.0, lidar.max_range_m, lidar.num_beams),
            angle_min_rad=lidar.angle_min_rad,
            angle_increment_rad=lidar.angle_increment_rad,
            range_max_m=lidar.max_range_m,
            stamp_s=now_s,
        )
        odometry = Odometry(pose=(0.0, 0.0, 0.0), twist=(0.0, 0.0), stamp_s=now_s)
        twists.append(navigator.step(scan, odometry, now_s).twist)
    return np.array(twists)


SOURCE = """
from tests_of_policies import PurePursuit
pursuit = PurePursuit()
make = lambda: PurePursuit()
number = 7
class Needs:
    def __init__(self, weights): ...
class Breaks(PurePursuit):
    def act(self, observation):
        return observation @ self.weights
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of a module in the working folder, which is not on sys.path."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    monkeypatch.setitem(sys.modules, "tests_of_policies", sys.modules[__name__])
    (tmp_path / "mine_for_test.py").write_text(SOURCE)
    (tmp_path / "unreadable_for_test.py").write_text("def act(:\n")
    (tmp_path / "lacking_for_test.py").write_text("import no_such_dependency\n")
    yield "mine_for_test"
    for name in ("mine_for_test", "unreadable_for_test", "lacking_for_test"):
        sys.modules.pop(name, None)


class TestNames:
    def test_a_class_a_function_and_an_object_of_a_module(self, module: str) -> None:
        for attribute in ("PurePursuit", "make", "pursuit"):
            found = find_policy(f"{module}:{attribute}")
            assert (found.name, found.guidance, found.robot) == ("pursuit", "map", ROBOTS["diffbot"])
        assert find_policy(found) is found

    def test_an_installed_package_offers_one(self, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
        points = [EntryPoint("chase", f"{module}:PurePursuit", "adrl.policies")]
        monkeypatch.setattr(
            registry, "entry_points", lambda *, group: points if group == "adrl.policies" else []
        )
        monkeypatch.syspath_prepend(str(Path.cwd()))
        assert find_policy("chase").name == "pursuit"
        with pytest.raises(UnknownName, match="did you mean 'chase'"):
            find_policy("chas")

    def test_planners_are_known_where_worlds_are(self) -> None:
        planner = find_policy(PLANNER, PLANNERS)
        assert (planner.name, planner.method, planner.knows_the_world) == (PLANNER, PLANNER, True)
        with pytest.raises(UnknownName):
            find_policy(PLANNER)
        with pytest.raises(ConfigError, match="simulators only"):
            Navigator(planner)

    @pytest.mark.parametrize(
        ("text", "error", "says"),
        [
            ("no_such_module_here:P", ConfigError, "no module no_such_module_here"),
            ("mine_for_test.below:P", ConfigError, "mine_for_test.below"),
            ("lacking_for_test:P", ConfigError, "needs the module no_such_dependency"),
            ("unreadable_for_test:P", ConfigError, "SyntaxError"),
            ("mine_for_test:PurePursuits", UnknownName, "did you mean 'PurePursuit'"),
            ("mine_for_test:number", ConfigError, "has no act"),
            ("mine_for_test:Needs", ConfigError, "mine_for_test:Needs.*weights"),
            ("mine_for_test:", ConfigError, "give MODULE:OBJECT"),
            (":P", ConfigError, "give MODULE:OBJECT"),
            ("mine/for.py:P", ConfigError, "give MODULE:OBJECT"),
            ("defalt", UnknownName, "did you mean 'default'"),
            ("runs/gone", CheckpointError, "no such folder"),
            ("gone.onnx", CheckpointError, "gone.onnx does not exist; give"),
            ("gone.zip", CheckpointError, "gone.zip does not exist; give"),
        ],
    )
    def test_what_is_not_there_is_said(
        self, module: str, text: str, error: type[AdrlError], says: str
    ) -> None:
        with pytest.raises(error, match=says) as caught:
            find_policy(text)
        assert "\n" not in str(caught.value)

    def test_attributes_that_are_none(self) -> None:
        for name, value, says in (
            ("guidance", "mapp", "did you mean 'map'"),
            ("robot", "diffbott", "did you mean 'diffbot'"),
            ("encoder", 7, "give an EncoderConfig"),
        ):
            policy = PurePursuit()
            setattr(policy, name, value)
            with pytest.raises(AdrlError, match=says):
                find_policy(policy)


class TestDriving:
    def test_the_replanner_leads_every_policy_but_one_that_plans_itself(self) -> None:
        """One that looks into the simulator is led, too; its waypoints are the replanner's, not the goal."""
        for policy, led in ((LooksIn(), True), (PlansItself(), False)):
            adrl.evaluate(policy, scenario="rooms", episodes=2, num_threads=1)
            sim = policy.sim
            assert (sim.replanner is not None) == led
            goals = np.array([task.goal for task in sim.tasks if task is not None])
            assert np.allclose(sim.b["waypoint"], goals) != led

    def test_equations_as_printed_are_for_those_that_the_replanner_leads(self) -> None:
        assert adrl.evaluate(LooksIn(), episodes=1, num_threads=1, paper_literal=True).summary[
            "paper_literal"
        ]
        with pytest.raises(ConfigError, match="makes its own routes"):
            adrl.evaluate(PlansItself(), episodes=1, num_threads=1, paper_literal=True)

    def test_pure_pursuit_follows_the_map_and_is_named(self) -> None:
        result = adrl.evaluate(PurePursuit(), episodes=10, num_threads=1)
        summary = result.summary
        assert (summary["policy"], summary["guidance"], summary["method"]) == ("pursuit", "map", "external")
        assert summary["success"] >= 0.9
        assert (summary["trained_for"], summary["warnings"]) == ("diffbot", [])

    def test_decoded_or_measured_is_the_same_drive(self) -> None:
        both = [adrl.evaluate(p, episodes=4, num_threads=1) for p in (PurePursuit(), MeasuredPursuit())]
        first, second = (result.rollout.episodes.final_pose for result in both)
        np.testing.assert_allclose(first, second, atol=0.02)

    def test_memory_is_told_when_an_episode_begins(self) -> None:
        policy = Remembers()
        result = adrl.evaluate(policy, episodes=3, num_threads=1)
        assert policy.steps.max() * 0.1 == pytest.approx(result.rollout.episodes.time_s.max())
        policy = Remembers()
        policy.steps = np.full(1, -1)
        navigator = Navigator(policy, guidance="goal", supervisor=None)
        run_navigator(navigator, steps=5)
        assert policy.steps.tolist() == [5]
        navigator.cancel()
        run_navigator(navigator, steps=2)
        assert policy.steps.tolist() == [2]

    def test_a_robot_needs_to_be_known(self) -> None:
        policy = PurePursuit()
        policy.robot = None  # type: ignore[assignment]
        with pytest.raises(ConfigError, match="give robot"):
            Navigator(policy, guidance="goal")
        own = dataclasses.replace(RobotConfig(), name="own", radius_m=0.31)
        assert Navigator(policy, guidance="goal", robot=own).robot == own

    @pytest.mark.parametrize(
        ("act", "says"),
        [
            (lambda o: np.zeros((len(o), 3)), "actions of shape"),
            (lambda o: np.full((len(o), 2), np.nan), "not finite"),
            (lambda o: None, "actions of shape"),
            (lambda o: o @ np.zeros((10, 2)), r"\(4, 44\) \(ValueError: .*test_policies.py:"),
        ],
    )
    def test_what_is_no_action_is_refused_in_a_line(self, act, says: str) -> None:
        policy = PurePursuit()
        policy.act = act  # type: ignore[method-assign]
        with pytest.raises(ConfigError, match=says) as caught:
            adrl.evaluate(policy, episodes=4, num_threads=1)
        assert "pursuit" in str(caught.value)
        assert "\n" not in str(caught.value)


class TestOnnx:
    @pytest.mark.parametrize("steps", [0, 3])
    def test_an_exported_policy_drives_as_the_policy_does(self, steps: int, tmp_path: Path) -> None:
        policy = a_policy(ROBOTS["turtlebot3_burger"], history_steps=steps)
        (tmp_path / "model.onnx").write_bytes(to_onnx(policy))
        drives, summaries = [], []
        for driver in (policy, tmp_path / "model.onnx"):
            commands: list[Array] = []
            result = adrl.evaluate(
                driver,
                episodes=5,
                num_threads=1,
                on_drive=lambda sim, *_, commands=commands: commands.append(sim.b["command"].copy()),
            )
            drives.append(np.array(commands[:30]))  # later the rounding of a drive shows
            summaries.append(result.summary)
        np.testing.assert_allclose(drives[0], drives[1], atol=1e-3)
        about = ("method", "robot", "guidance", "trained_for", "warnings")
        ours, theirs = ({key: summary[key] for key in about} for summary in summaries)
        assert ours == theirs
        assert summaries[1]["policy"] == "model.onnx"

    @pytest.mark.parametrize(
        ("robot", "says"),
        [
            (ROBOTS["turtlebot3_burger"], "lidar.num_beams 360 instead of 180"),
            (
                RobotConfig(name="own", max_speed_mps=0.9),
                "own has max_speed_mps 0.9 instead of 0.6; give the run",
            ),
        ],
    )
    def test_a_robot_that_its_encoder_would_see_wrong_is_refused(
        self, robot: RobotConfig, says: str, tmp_path: Path
    ) -> None:
        (tmp_path / "model.onnx").write_bytes(to_onnx(a_policy(RobotConfig())))
        with pytest.raises(ConfigError, match=says):
            adrl.evaluate(tmp_path / "model.onnx", robot=robot, episodes=1)
        with pytest.raises(ConfigError, match=says):
            Navigator(tmp_path / "model.onnx", robot=robot, guidance="goal")

    def test_on_another_robot_it_drives_as_the_policy_does(self, tmp_path: Path) -> None:
        policy = a_policy(RobotConfig())
        (tmp_path / "model.onnx").write_bytes(to_onnx(policy))
        lidar = LidarConfig(max_range_m=12.0, noise_std_m=0.02)
        robot = RobotConfig(name="own", min_speed_mps=-0.3, lag_s=0.2, control_period_s=0.05, lidar=lidar)
        ours, theirs = (
            run_navigator(Navigator(p, robot=robot, guidance="goal", supervisor=None), steps=20)
            for p in (policy, tmp_path / "model.onnx")
        )
        np.testing.assert_allclose(ours, theirs, atol=1e-4)

    def test_a_navigator_takes_it(self, tmp_path: Path) -> None:
        policy = a_policy(RobotConfig())
        (tmp_path / "model.onnx").write_bytes(to_onnx(policy))
        ours, theirs = (
            run_navigator(Navigator(p, guidance="goal", supervisor=None), steps=20)
            for p in (policy, tmp_path / "model.onnx")
        )
        np.testing.assert_allclose(ours, theirs, atol=1e-4)

    def test_other_files_are_refused(self, tmp_path: Path) -> None:
        import onnx

        broken = tmp_path / "broken.onnx"
        broken.write_bytes(b"no model")
        foreign = tmp_path / "foreign.onnx"
        single = onnx.TensorProto.FLOAT
        infos = [onnx.helper.make_tensor_value_info(name, single, ["N", 44]) for name in ("seen", "done")]
        node = onnx.helper.make_node("Relu", ["seen"], ["done"])
        graph = onnx.helper.make_graph([node], "g", infos[:1], infos[1:])
        opset = [onnx.helper.make_opsetid("", 18)]
        onnx.save(onnx.helper.make_model(graph, opset_imports=opset, ir_version=10), foreign)
        for path, says in ((broken, "not a readable ONNX model"), (foreign, "not a model of adrl export")):
            with pytest.raises(CheckpointError, match=f"{path.name}: {says}") as caught:
                find_policy(path)
            assert "\n" not in str(caught.value)

    @pytest.mark.parametrize(("missing", "file"), [("onnxruntime", "m.onnx"), ("stable_baselines3", "m.zip")])
    def test_a_missing_extra_is_named(
        self, missing: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for name in [name for name in sys.modules if name.split(".")[0] == missing]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setitem(sys.modules, missing, None)
        (tmp_path / file).touch()
        with pytest.raises(MissingExtra, match="pip install 'adrl"):
            find_policy(tmp_path / file)


class TestStableBaselines:
    @pytest.mark.parametrize("kind", ["PPO", "SAC", "TD3", "A2C", "DDPG"])
    def test_a_saved_model_drives_as_the_model_does(self, kind: str, tmp_path: Path) -> None:
        import gymnasium
        import stable_baselines3

        env = gymnasium.make("adrl/Nav-v0")
        options = {} if kind in ("PPO", "A2C") else {"buffer_size": 100}
        network = {"net_arch": [16, 16]}
        model = getattr(stable_baselines3, kind)(
            "MlpPolicy", env, seed=3, device="cpu", policy_kwargs=network, **options
        )
        model.save(tmp_path / "model")
        found = find_policy(tmp_path / "model.zip")
        assert (found.name, found.method, found.guidance) == ("model.zip", "external", "goal")
        rows = np.random.default_rng(0).uniform(-1.0, 1.0, (7, 44)).astype(np.float32)
        np.testing.assert_allclose(
            found.policy.act(rows), model.predict(rows, deterministic=True)[0], atol=1e-6
        )
        summary = adrl.evaluate(tmp_path / "model.zip", episodes=2, num_threads=1).summary
        assert summary["episodes"] == 2

    def test_other_spaces_and_files_are_refused(self, tmp_path: Path) -> None:
        import stable_baselines3

        stable_baselines3.PPO("MlpPolicy", "CartPole-v1", device="cpu").save(tmp_path / "cart")
        (tmp_path / "letters.zip").write_bytes(b"PK no")
        for name, says in (("cart", "its spaces are"), ("letters", "not a readable model")):
            with pytest.raises(CheckpointError, match=f"{name}.zip: {says}") as caught:
                find_policy(tmp_path / f"{name}.zip")
            assert "\n" not in str(caught.value)

    def test_observations_of_another_size_are_refused(self, tmp_path: Path) -> None:
        import gymnasium
        import stable_baselines3

        env = gymnasium.make("adrl/Nav-v0", encoder={"num_sectors": 24})
        stable_baselines3.PPO("MlpPolicy", env, device="cpu").save(tmp_path / "small")
        with pytest.raises(CheckpointError, match=r"observations of shape \(32,\), and they have \(44,\)"):
            adrl.evaluate(tmp_path / "small.zip", episodes=1)


@pytest.mark.integration
def test_the_commands_take_a_module(module: str, adrl: Adrl, capsys: pytest.CaptureFixture[str]) -> None:
    place = ("--episodes", 2, "--json", "out.json", "--out", "out")
    assert run_cli("evaluate", "--policy", f"{module}:PurePursuit", *place) == 0
    summary = json.loads(Path("out.json").read_text())
    assert summary["policy"] == "pursuit"
    assert summary == json.loads(Path("out", "summary.json").read_text())
    assert "pursuit" in capsys.readouterr().err
    adrl.refuses(
        "evaluate", "--policy", f"{module}:Breaks", "--episodes", 1, says=("pursuit", "weights", "mine_for")
    )
    adrl.refuses("evaluate", "--policy", f"{module}:Gone", says=("Gone", module))
