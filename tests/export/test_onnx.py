"""The exported model is the encoder and the policy: equal actions on random scans, with and without motion cues."""

import dataclasses
import json
import sys

import numpy as np
import onnxruntime
import pytest

from adrl.deploy import MlpPolicy, Scan
from adrl.deploy.lidar import LidarAdapter
from adrl.deploy.setup import setup_of
from adrl.errors import MissingExtra
from adrl.export.onnx_graph import to_onnx
from adrl.observation import ObservationEncoder, to_twist
from adrl.observation.motion import ScanHistory
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


def theirs(policy: MlpPolicy, rows: ScanRows):
    """(N, 2) actions and velocities of the exported model."""
    session = onnxruntime.InferenceSession(to_onnx(policy), providers=["CPUExecutionProvider"])
    given = {
        spec.name: getattr(rows, spec.name).astype(np.float64 if "pose" in spec.name else np.float32)
        for spec in session.get_inputs()
    }
    return tuple(map(np.asarray, session.run(["action", "velocity"], given)))


@pytest.mark.parametrize("history_steps", [0, 5])
@pytest.mark.parametrize("robot", ROBOTS_OF_ALL_KINDS, ids=lambda robot: robot.name)
def test_onnxruntime_agrees(robot: RobotConfig, history_steps: int):
    policy = a_policy(robot, history_steps=history_steps)
    rows = random_rows(robot, 200, seed=1)
    action, velocity = theirs(policy, rows)
    expected = ours(policy, robot, rows)
    assert np.abs(expected[0]).max() > 0.1
    np.testing.assert_allclose(action, expected[0], atol=1e-5)
    greatest = (robot.max_speed_mps, robot.max_yaw_rate_radps)
    np.testing.assert_allclose(velocity / greatest, expected[1] / greatest, atol=1e-5)


@pytest.mark.parametrize("history_steps", [0, 5])
def test_what_a_driver_says_of_nothing_and_of_far_things_is_taken_as_the_runtime_takes_it(history_steps: int):
    robot = ROBOTS["diffbot"]
    policy = a_policy(robot, history_steps=history_steps)
    rows, rng = random_rows(robot, 100, seed=2), np.random.default_rng(3)
    reach_m, lidar = robot.lidar.max_range_m, robot.lidar

    def as_drivers_say(ranges: np.ndarray) -> np.ndarray:
        far = np.where(rng.random(ranges.shape) < 0.5, np.inf, rng.uniform(reach_m, 30.0, ranges.shape))
        told = np.maximum(ranges, 0.05)  # 0, of a robot put into a pillar, tells the runtime nothing
        return np.where(rng.random(ranges.shape) < 0.4, far, told).astype(np.float32)

    def as_the_runtime_reads(ranges: np.ndarray) -> np.ndarray:
        angles = dict(
            angle_min_rad=lidar.angle_min_rad,
            angle_increment_rad=lidar.angle_increment_rad,
            range_max_m=30.0,
            stamp_s=0.0,
        )
        return np.stack([LidarAdapter(lidar)(Scan(ranges=row, **angles)) for row in ranges])

    raw = dataclasses.replace(
        rows, ranges=as_drivers_say(rows.ranges), past_ranges=as_drivers_say(rows.past_ranges)
    )
    read = dataclasses.replace(
        rows, ranges=as_the_runtime_reads(raw.ranges), past_ranges=as_the_runtime_reads(raw.past_ranges)
    )
    expected = ours(policy, robot, read)
    assert np.abs(expected[0]).max() > 0.1
    for got, wanted in zip(theirs(policy, raw), expected, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-5)


@pytest.mark.parametrize(("history_steps", "scan"), [(0, "ranges"), (5, "ranges"), (5, "past_ranges")])
def test_one_beam_of_nan_is_told_and_touches_no_other_robot(history_steps: int, scan: str):
    policy = a_policy(ROBOTS["diffbot"], history_steps=history_steps)
    rows = random_rows(ROBOTS["diffbot"], 6, seed=4)
    sound = theirs(policy, rows)
    ranges = getattr(rows, scan).copy()
    for row, beam in enumerate((0, 17, 90, 179)):
        ranges[row, beam] = np.nan
    broken = theirs(policy, dataclasses.replace(rows, **{scan: ranges}))
    for got, before in zip(broken, sound, strict=True):
        assert np.isnan(got[:4]).all()
        np.testing.assert_array_equal(got[4:], before[4:])


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
