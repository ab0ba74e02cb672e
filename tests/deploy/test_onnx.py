"""The exported model is the encoder and the policy: equal actions on random scans, with and without motion cues."""

import dataclasses
import json
import sys

import numpy as np
import onnxruntime
import pytest

from adrl.deploy import MlpPolicy
from adrl.deploy.onnx_graph import to_onnx
from adrl.deploy.setup import setup_of
from adrl.errors import MissingExtra
from adrl.motion import ScanHistory
from adrl.observation import ObservationEncoder, to_twist
from adrl.types import RobotConfig
from adrl.worlds import ROBOTS
from deploy.recorded import a_policy
from deploy.scan_rows import ScanRows, random_rows

ROBOTS_OF_ALL_KINDS = [
    ROBOTS["diffbot"],
    ROBOTS["jackal"],
    dataclasses.replace(ROBOTS["turtlebot3_waffle"], min_speed_mps=-0.1),
]


def ours(policy: MlpPolicy, robot: RobotConfig, rows: ScanRows):
    """(N, 2) actions and velocities of the runtime."""
    encoder = ObservationEncoder(robot, setup_of(policy).encoder)
    steps = encoder.config.history_steps
    history = None
    if steps > 0:
        history = ScanHistory(len(rows.goal), robot.lidar.num_beams, steps)
        history.begin(np.arange(len(rows.goal)), rows.past_ranges, rows.past_pose)
        for _ in range(steps):
            history.add(rows.ranges, rows.pose)
    seen = encoder.encode(rows.ranges, rows.goal, rows.twist, rows.last_action, history)
    action = policy.act(seen)
    return action, to_twist(action, robot)


@pytest.mark.parametrize("history_steps", [0, 5])
@pytest.mark.parametrize("robot", ROBOTS_OF_ALL_KINDS, ids=lambda robot: robot.name)
def test_onnxruntime_agrees(robot: RobotConfig, history_steps: int):
    policy = a_policy(robot, history_steps=history_steps)
    session = onnxruntime.InferenceSession(to_onnx(policy), providers=["CPUExecutionProvider"])
    rows = random_rows(robot, 200, seed=1)
    wanted = {spec.name: spec for spec in session.get_inputs()}
    given = {
        name: getattr(rows, name).astype(np.float64 if "pose" in name else np.float32) for name in wanted
    }
    action, velocity = map(np.asarray, session.run(["action", "velocity"], given))
    expected = ours(policy, robot, rows)
    assert np.abs(expected[0]).max() > 0.1
    np.testing.assert_allclose(action, expected[0], atol=1e-5)
    np.testing.assert_allclose(velocity, expected[1], atol=1e-5)


def test_the_model_says_what_it_is_for():
    policy = a_policy(ROBOTS["jackal"])
    session = onnxruntime.InferenceSession(to_onnx(policy), providers=["CPUExecutionProvider"])
    about = session.get_modelmeta().custom_metadata_map
    assert json.loads(about["robot"])["name"] == "jackal"
    assert json.loads(about["encoder"])["num_sectors"] == 36
    assert about["guidance"] == policy.config.guidance
    assert float(about["maturity"]) == policy.config.maturity
    assert about["version"]
    ranges = session.get_inputs()[0]
    assert (ranges.name, ranges.shape) == ("ranges", ["N", 720])


def test_without_onnx_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(MissingExtra, match=r"\[onnx\]"):
        to_onnx(a_policy(ROBOTS["diffbot"]))
