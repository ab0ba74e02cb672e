"""The exported model is the encoder and the policy: equal actions on random scans, with and without motion cues."""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

from adrl.deploy import MlpPolicy, Scan
from adrl.deploy.lidar import LidarAdapter
from adrl.deploy.onnx_policy import load_onnx
from adrl.deploy.setup import setup_of
from adrl.envs import NavSim
from adrl.errors import MissingExtra
from adrl.export.onnx_graph import to_onnx
from adrl.observation import ObservationEncoder, to_twist
from adrl.observation.motion import ScanHistory
from adrl.types import RobotConfig
from adrl.worlds import ROBOTS, get_scenario, task_set
from adrl.worlds.people import among_people
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
    seen = encoder.encode(
        rows.ranges,
        rows.goal,
        rows.twist,
        rows.last_action,
        history,
        rows.path.reshape(len(rows.goal), -1, 2),
    )
    action = policy.act(seen)
    return action, to_twist(action, robot)


def theirs(policy: MlpPolicy, rows: ScanRows):
    """(N, 2) actions and velocities of the exported model, in onnxruntime."""
    return by_onnxruntime(to_onnx(policy), rows)


def by_onnxruntime(model: bytes | Path, rows: ScanRows):
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    given = fed(rows, [spec.name for spec in session.get_inputs()])
    return tuple(map(np.asarray, session.run(["action", "velocity"], given)))


def by_openvino(model: bytes, rows: ScanRows, **settings: str):
    openvino = pytest.importorskip("openvino")
    core = openvino.Core()
    compiled = core.compile_model(core.read_model(model), "CPU", settings)
    out = compiled(fed(rows, [given.any_name for given in compiled.inputs]))
    return out["action"], out["velocity"]


def by_openvino_in_full(model: bytes, rows: ScanRows):
    """Newer processors compute in bfloat16 if not told otherwise."""
    return by_openvino(model, rows, INFERENCE_PRECISION_HINT="f32")


RUNTIMES = {"onnxruntime": by_onnxruntime, "openvino": by_openvino, "openvino-f32": by_openvino_in_full}


def fed(rows: ScanRows, names: list[str]) -> dict[str, np.ndarray]:
    return {name: getattr(rows, name).astype(np.float64 if "pose" in name else np.float32) for name in names}


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


@pytest.mark.parametrize("history_steps", [0, 2])
def test_a_model_with_tracks_drives_as_the_policy_it_was_made_of(history_steps: int, tmp_path: Path):
    """What runs it finds the tracks for it."""
    robot = ROBOTS["diffbot"]
    policy = a_policy(robot, history_steps=history_steps, num_tracks=3)
    (tmp_path / "policy.onnx").write_bytes(to_onnx(policy))
    model = load_onnx(tmp_path / "policy.onnx")
    tasks = task_set(among_people(get_scenario("crowd"), 12, None, legs=False), robot, "train", 3)
    sim = NavSim(3, robot, encoder=setup_of(policy).encoder)
    sim.reset(np.arange(3), tasks, np.arange(3, dtype=np.uint64), np.random.default_rng(0))
    tracked = 0
    for _ in range(30):
        seen = sim.observe()
        tracked += np.count_nonzero(seen[:, sim.encoder.places["tracks"]])
        action = policy.act(seen)
        np.testing.assert_allclose(model.act(model.encoder.encode(*sim.measured())), action, atol=1e-5)
        sim.step(action)
    assert tracked > 100


@pytest.mark.parametrize("guidance", ["map", "replan"])
def test_a_model_with_the_path_ahead_drives_as_the_policy_it_was_made_of(guidance: str, tmp_path: Path):
    robot = ROBOTS["diffbot"]
    policy = a_policy(robot, history_steps=2, path=True)
    (tmp_path / "policy.onnx").write_bytes(to_onnx(policy))
    model = load_onnx(tmp_path / "policy.onnx")
    tasks = task_set(get_scenario("complex"), robot, "train", 3)
    sim = NavSim(3, robot, guidance=guidance, encoder=setup_of(policy).encoder)
    sim.reset(np.arange(3), tasks, np.arange(3, dtype=np.uint64), np.random.default_rng(0))
    for _ in range(30):
        action = policy.act(sim.observe())
        np.testing.assert_allclose(model.act(model.encoder.encode(*sim.measured())), action, atol=1e-5)
        sim.step(action)


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


@pytest.mark.parametrize("runtime", RUNTIMES)
@pytest.mark.parametrize("fault", [np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize("name", ["goal", "twist", "last_action", "pose", "past_pose"])
def test_what_is_no_measurement_is_told_in_every_runtime(runtime: str, name: str, fault: float):
    """Never a speed: a robot with a fault in any input, and no other one, gets NaN."""
    policy = a_policy(ROBOTS["diffbot"], history_steps=5)
    rows, model = random_rows(ROBOTS["diffbot"], 5, seed=4), to_onnx(policy)
    sound = RUNTIMES[runtime](model, rows)
    given = getattr(rows, name).copy()
    for row, column in ((1, 0), (3, 1)):
        given[row, column] = fault
    broken = RUNTIMES[runtime](model, dataclasses.replace(rows, **{name: given}))
    for got, before in zip(broken, sound, strict=True):
        assert np.isnan(got[[1, 3]]).all()
        np.testing.assert_allclose(got[[0, 2, 4]], before[[0, 2, 4]], atol=1e-6)


@pytest.mark.parametrize("history_steps", [0, 5])
def test_openvino_agrees(history_steps: int):
    robot = ROBOTS["jackal"]
    policy = a_policy(robot, history_steps=history_steps)
    rows = random_rows(robot, 50, seed=6)
    rows.ranges[:, ::7] = np.inf
    read = dataclasses.replace(rows, ranges=np.minimum(rows.ranges, np.float32(robot.lidar.max_range_m)))
    expected = ours(policy, robot, read)
    for got, wanted in zip(by_openvino_in_full(to_onnx(policy), rows), expected, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-4)
    rows.ranges[7, 100] = np.nan
    action, velocity = by_openvino_in_full(to_onnx(policy), rows)
    assert np.isnan(action[7]).all()
    assert np.isnan(velocity[7]).all()
    assert np.isfinite(np.delete(action, 7, axis=0)).all()


@pytest.mark.parametrize("history_steps", [0, 5])
def test_it_can_be_quantised(history_steps: int, tmp_path: Path):
    """By onnxruntime's own two steps; the network's nodes are found by their names, the encoder keeps its precision."""
    from onnxruntime.quantization import QuantType, quantize_dynamic
    from onnxruntime.quantization.shape_inference import quant_pre_process

    robot = ROBOTS["diffbot"]
    policy = a_policy(robot, history_steps=history_steps)
    model = onnx.load_from_string(to_onnx(policy))
    names = [node.name for node in model.graph.node]
    assert len(set(names)) == len(names)
    parts = {"inputs", "sectors", "goal", "twist", "network", "outputs"}
    assert {name.split("/")[0] for name in names} == parts | ({"motion"} if history_steps else set())
    paths = [tmp_path / name for name in ("plain.onnx", "prepared.onnx", "small.onnx")]
    onnx.save(model, paths[0])
    quant_pre_process(paths[0], paths[1])
    quantize_dynamic(
        paths[1],
        paths[2],
        weight_type=QuantType.QUInt8,
        nodes_to_exclude=[name for name in names if not name.startswith("network/")],
    )
    rows = random_rows(robot, 100, seed=1)
    expected = ours(policy, robot, rows)[0]
    np.testing.assert_allclose(by_onnxruntime(paths[1], rows)[0], expected, atol=1e-5)
    assert "DynamicQuantizeLinear" in {node.op_type for node in onnx.load(paths[2]).graph.node}
    assert np.abs(by_onnxruntime(paths[2], rows)[0] - expected).mean() < 0.1


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
