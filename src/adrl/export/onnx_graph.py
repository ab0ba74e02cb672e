"""The encoder and a policy as an ONNX graph: ranges, goal and twist in, action and velocity out."""

import json
import math
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from adrl.deploy.policy import MlpPolicy
from adrl.deploy.setup import setup_of
from adrl.errors import MissingExtra
from adrl.observation import ObservationEncoder
from adrl.observation.body import Body
from adrl.observation.goal import FAR_M
from adrl.observation.motion import CueSettings, cue_settings
from adrl.observation.path_ahead import PathAhead
from adrl.types import LidarConfig, RobotConfig

OPSET = 18
"""The first in which ScatterElements takes the greatest of what falls on one place."""
IR_VERSION = 10
SLACK = 1e-3
"""Of core/world/motion_cue.cpp: a point this near, in beams or sectors, to a border is on both sides of it."""
GREATEST = 1e6
"""Of metres, speeds and actions: a number beyond is a fault, as NaN is."""
ATAN = (0.0208351, -0.0851330, 0.1801410, -0.3302995, 0.9998660)
"""Of rough_atan2 in core/world/geometry.hpp."""


class Graph:
    """Nodes and constants of a graph in the making; every method returns names of values."""

    def __init__(self, onnx: Any) -> None:
        self._onnx = onnx
        self.part = ""
        """What the next nodes are of; begins their names, so that tools can name a part, as those that quantise do."""
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any, dtype: Any = np.float32) -> str:
        """A constant array or number."""
        name = f"c{len(self.constants)}"
        self.constants.append(self._onnx.numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def op(self, kind: str, *inputs: str, output: str | None = None, **attributes: Any) -> str:
        """One node."""
        name = output or f"v{len(self.nodes)}"
        label = f"{self.part}/{kind}_{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, list(inputs), [name], name=label, **attributes))
        return name

    def columns(self, value: str, *, start: int, stop: int) -> str:
        """value[:, start:stop]."""
        ends = (self.constant([number], np.int64) for number in (start, stop, 1))
        return self.op("Slice", value, *ends)

    def cast(self, value: str, dtype: Any) -> str:
        """The same numbers in another type."""
        return self.op("Cast", value, to=self._onnx.helper.np_dtype_to_tensor_dtype(np.dtype(dtype)))


def to_onnx(policy: MlpPolicy, robot: RobotConfig | None = None) -> bytes:
    """The model of a policy, N robots at once: its own robot, or the one that is given for a policy of a family.

    Inputs, float32: ranges (N, K) metres of the trained LiDAR, those beyond its reach, infinite ones among them, taken
    as its reach; goal (N, 2) metres, in the robot's frame; twist (N, 2) measured speed and yaw rate; last_action
    (N, 2). With motion cues also past_ranges (N, K) of history_steps control periods ago, and, float64, pose and
    past_pose (N, 3) by odometry. With tracks also tracks (N, 5 num_tracks), the numbers of adrl.observation.tracks.
    With the path also path (N, 12) metres, in the robot's frame: the points of adrl.observation.path_ahead, x before y.

    Outputs: action (N, 2) in [-1, 1] and velocity (N, 2), m/s and rad/s. Both are NaN for a robot of which any input is
    NaN, or any but a range is infinite or beyond GREATEST: stop it. Nodes are named by their part: inputs, sectors,
    goal, twist, motion, path, body, network, outputs. Metadata: robot, encoder, guidance, method, maturity, version, as
    JSON.

    Raises MissingExtra without onnx, CheckpointError, ConfigError for a robot that is missing or another one.
    """
    try:
        import onnx
    except ImportError:
        raise MissingExtra.named("onnx", "writing ONNX") from None
    setup = setup_of(policy)
    given_robot, robot = robot, setup.exported_for(robot)
    encoder = ObservationEncoder(robot, setup.encoder)
    graph = Graph(onnx)
    with_motion = setup.encoder.history_steps > 0
    widths = {"goal": 2, "twist": 2, "last_action": 2}
    if "tracks" in encoder.components:
        widths["tracks"] = encoder.components["tracks"].size
    if encoder.needs_path:
        widths["path"] = PathAhead.size
    given = _inputs(graph, robot.lidar, widths, with_motion=with_motion)
    fastest = [robot.max_speed_mps, robot.max_yaw_rate_radps]
    parts = [
        _sectors(graph, encoder, given["ranges"]),
        _goal(graph, given["goal"], setup.encoder.goal_scale_m),
        _twist(graph, given["twist"], fastest),
        given["last_action"],
    ]
    if with_motion:
        cue = cue_settings(robot, setup.encoder.num_sectors, setup.encoder.history_steps)
        parts.append(_motion(graph, cue, given))
    if "tracks" in widths:
        parts.append(given["tracks"])
    if "path" in widths:
        parts.append(_path(graph, given["path"], setup.encoder.goal_scale_m))
    if setup.encoder.body:
        parts.append(_body(graph, encoder, given["goal"]))
    action = _network(graph, policy, parts)
    graph.part = "outputs"
    action = graph.op("Where", given[FAULTY], graph.constant(math.nan), action, output="action")
    span = robot.max_speed_mps - robot.min_speed_mps
    scaled = graph.op("Mul", action, graph.constant([[0.5 * span, fastest[1]]]))
    offset = graph.constant([[robot.min_speed_mps + 0.5 * span, 0.0]])
    graph.op("Add", scaled, offset, output="velocity")
    about = metadata(policy, given_robot or robot)  # OnnxPolicy slows it as the graph does
    return _model(onnx, graph, about, robot.lidar.num_beams, widths, with_motion=with_motion)


def _model(
    onnx: Any, graph: Graph, about: dict[str, str], beams: int, widths: dict[str, int], *, with_motion: bool
) -> bytes:
    single, double = onnx.TensorProto.FLOAT, onnx.TensorProto.DOUBLE
    inputs = [("ranges", beams, single), *((name, width, single) for name, width in widths.items())]
    if with_motion:
        inputs += [("past_ranges", beams, single), ("pose", 3, double), ("past_pose", 3, double)]
    outputs = [("action", 2, single), ("velocity", 2, single)]
    infos = [
        [onnx.helper.make_tensor_value_info(name, kind, ["N", width]) for name, width, kind in group]
        for group in (inputs, outputs)
    ]
    model = onnx.helper.make_model(
        onnx.helper.make_graph(graph.nodes, "adrl", *infos, initializer=graph.constants),
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="adrl",
        producer_version=version("adrl"),
    )
    onnx.helper.set_model_props(model, about)
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


def metadata(policy: MlpPolicy, robot: RobotConfig) -> dict[str, str]:
    """What an export was made for, as texts; robot and encoder are JSON."""
    config = policy.config
    trained = config.table("environment").get("taken_as", config.robot)
    return {
        "version": version("adrl"),
        "robot": json.dumps(dict(trained) or asdict(robot)),
        "encoder": json.dumps(dict(config.encoder)),
        "guidance": config.guidance,
        "method": config.method,
        "maturity": repr(float(config.maturity)),
        "stop_within_m": repr(float(config.table("environment").get("stop_within_m", math.inf))),
    }


FAULTY = "faulty"
"""(N, 1) whether a robot's inputs hold something that is no measurement."""


def _inputs(graph: Graph, lidar: LidarConfig, widths: dict[str, int], *, with_motion: bool) -> dict[str, str]:
    """Each input as numbers that every operation can take, and FAULTY. widths: of those that are no scans or poses.

    NaN has no place among sectors and beams, and runtimes differ in what minima and activations make of it.
    """
    graph.part = "inputs"
    given, faults = {}, []
    scans = ["ranges", "past_ranges"] if with_motion else ["ranges"]
    for scan in scans:
        fault = graph.op("IsNaN", scan)
        told = graph.op("Where", fault, graph.constant(0.0), scan)
        given[scan] = graph.op("Clip", told, graph.constant(0.0), graph.constant(lidar.max_range_m))
        faults.append(fault)
    poses = ["pose", "past_pose"] if with_motion else []
    for name in [*widths, *poses]:
        dtype = np.float64 if name in poses else np.float32
        sound = graph.op("LessOrEqual", graph.op("Abs", name), graph.constant(GREATEST, dtype))
        given[name] = graph.op("Where", sound, name, graph.constant(0.0, dtype))
        faults.append(graph.op("Not", sound))
    each = graph.op("Concat", *(graph.cast(fault, np.float32) for fault in faults), axis=1)
    row = graph.op("Unsqueeze", each, graph.constant([1], np.int64))
    width = len(scans) * lidar.num_beams + sum(widths.values()) + 3 * len(poses)
    given[FAULTY] = graph.op("Greater", _greatest(graph, row, width), graph.constant(0.0))
    return given


def _greatest(graph: Graph, value: str, count: int) -> str:
    """(N, C, count) -> (N, C). Pooled: what prepares models for quantisation cannot tell the shape of ReduceMax."""
    pooled = graph.op("MaxPool", value, kernel_shape=[count])
    return graph.op("Squeeze", pooled, graph.constant([2], np.int64))


def _sectors(graph: Graph, encoder: ObservationEncoder, ranges: str) -> str:
    """(N, S) log-scaled nearest ranges; see ObservationEncoder.encode."""
    graph.part = "sectors"
    greatest, near = encoder.robot.lidar.max_range_m, encoder.config.near_m
    # A column that reads the greatest range stands for the beams of sectors that have none.
    column = graph.op("Mul", graph.columns(ranges, start=0, stop=1), graph.constant(0.0))
    padded = graph.op("Concat", ranges, graph.op("Add", column, graph.constant(greatest)), axis=1)
    beams = graph.op("Gather", padded, graph.constant(encoder.beams_of_sectors, np.int64), axis=1)
    per_sector = encoder.beams_of_sectors.shape[1]
    nearest = graph.op("Neg", _greatest(graph, graph.op("Neg", beams), per_sector))
    if encoder.config.reach_m is not None:
        seen = graph.op("Less", nearest, graph.constant(greatest))
        greatest = encoder.config.reach_m
        near_enough = graph.op("Min", nearest, graph.constant(greatest))
        nearest = graph.op("Where", seen, near_enough, graph.constant(greatest))
    gap = graph.op("Max", graph.op("Sub", nearest, graph.constant(encoder.extent_m)), graph.constant(0.0))
    log = graph.op("Log", graph.op("Add", graph.op("Div", gap, graph.constant(near)), graph.constant(1.0)))
    return graph.op("Div", log, graph.constant(math.log1p(greatest / near)))


def _goal(graph: Graph, goal: str, scale_m: float) -> str:
    """(N, 4) direction to the goal and its distance on two scales."""
    graph.part = "goal"
    x, y = (graph.columns(goal, start=k, stop=k + 1) for k in range(2))
    distance = graph.op("Sqrt", graph.op("Add", graph.op("Mul", x, x), graph.op("Mul", y, y)))
    direction = graph.op("Div", goal, graph.op("Max", distance, graph.constant(1e-9)))
    near = graph.op("Div", distance, graph.op("Add", distance, graph.constant(scale_m)))
    far = graph.op("Min", graph.op("Mul", distance, graph.constant(1.0 / FAR_M)), graph.constant(1.0))
    return graph.op("Concat", direction, near, far, axis=1)


def _path(graph: Graph, path: str, scale_m: float) -> str:
    """(N, 2 P) the vectors to points, shortened; see PathAhead."""
    graph.part = "path"
    points = graph.op("Reshape", path, graph.constant([-1, PathAhead.size // 2, 2], np.int64))
    # A sum by a matrix: what prepares models for quantisation cannot tell the shape of ReduceSum.
    square = graph.op("MatMul", graph.op("Mul", points, points), graph.constant([[1.0, 1.0], [1.0, 1.0]]))
    away = graph.op("Add", graph.op("Sqrt", square), graph.constant(scale_m))
    return graph.op("Reshape", graph.op("Div", points, away), graph.constant([-1, PathAhead.size], np.int64))


def _twist(graph: Graph, twist: str, fastest: list[float]) -> str:
    """(N, 2) shares of the greatest speed and yaw rate."""
    graph.part = "twist"
    return graph.op("Div", twist, graph.constant([fastest]))


def _body(graph: Graph, encoder: ObservationEncoder, goal: str) -> str:
    """(N, B) what the robot's body is: a constant, in as many rows as there are goals."""
    graph.part = "body"
    body = encoder.components["body"]
    assert isinstance(body, Body)
    rows = graph.op("Mul", graph.columns(goal, start=0, stop=1), graph.constant(np.zeros((1, body.size))))
    return graph.op("Add", rows, graph.constant(body.numbers))


def _network(graph: Graph, policy: MlpPolicy, parts: list[str]) -> str:
    graph.part = "network"
    x = graph.op("Concat", *parts, axis=1)
    *hidden, (weight, bias) = policy.layers
    for matrix, offset in hidden:
        x = graph.op("Relu", graph.op("Gemm", x, graph.constant(matrix), graph.constant(offset)))
    return graph.op("Tanh", graph.op("Gemm", x, graph.constant(weight), graph.constant(bias)))


# --- motion cues: core/world/motion_cue.cpp, operation by operation, in the same precision -----------------------


def _motion(graph: Graph, cue: CueSettings, given: dict[str, str]) -> str:
    """(N, S) what has come, negative, or gone."""
    graph.part = "motion"
    ranges, past = given["ranges"], given["past_ranges"]
    now, then = _sensor(graph, given["pose"], cue), _sensor(graph, given["past_pose"], cue)
    zeros = graph.op(
        "Mul",
        graph.columns(given["goal"], start=0, stop=1),
        graph.constant(np.zeros((1, cue.num_sectors))),
    )
    numbers = graph.constant([np.arange(cue.num_beams)], np.float64)
    come = _marks(graph, cue, ranges, now, then, past, numbers, zeros)
    gone = _marks(graph, cue, past, then, now, ranges, None, zeros)
    taken = graph.op("Greater", come, graph.constant(0.0))
    metres = graph.op("Where", taken, graph.op("Neg", come), gone)
    share = graph.op("Div", metres, graph.constant(cue.scale_m))
    return graph.op("Clip", share, graph.constant(-1.0), graph.constant(1.0))


Place = tuple[str, str, str]
"""x, y and heading (N, 1), float64."""


def _sensor(graph: Graph, pose: str, cue: CueSettings) -> Place:
    """The LiDAR's pose on a robot at `pose`."""
    x, y, yaw = (graph.columns(pose, start=k, stop=k + 1) for k in range(3))
    dx, dy = _turned(graph, cue.mount[0], cue.mount[1], graph.op("Cos", yaw), graph.op("Sin", yaw))
    turned = graph.op("Add", yaw, graph.constant(cue.mount[2], np.float64))
    return graph.op("Add", x, dx), graph.op("Add", y, dy), turned


def _turned(graph: Graph, x: str | float, y: str | float, cos: str, sin: str) -> tuple[str, str]:
    x, y = (v if isinstance(v, str) else graph.constant(v, np.float64) for v in (x, y))
    ahead = graph.op("Sub", graph.op("Mul", cos, x), graph.op("Mul", sin, y))
    return ahead, graph.op("Add", graph.op("Mul", sin, x), graph.op("Mul", cos, y))


def _marks(
    graph: Graph,
    cue: CueSettings,
    hits: str,
    source: Place,
    target: Place,
    other: str,
    beams: str | None,
    zeros: str,
) -> str:
    """(N, S) greatest number of metres, in each sector, by which hits stand in what the other scan saw free.

    beams: (1, K) where the hits are marked, as numbers of beams; None marks them where the other sensor has them.
    zeros: (N, S), where nothing is marked.
    """
    distance, beam = _look(graph, cue, hits, source, target)
    free = _free_beyond(graph, cue, other, beam, distance)
    is_hit = graph.op("Less", hits, graph.constant(cue.max_range_m))
    counts = graph.op("And", is_hit, graph.op("Greater", free, graph.constant(0.0)))
    metres = graph.op("Where", counts, free, graph.constant(0.0))
    # Spread over the rows: a constant is one row only.
    at = (
        beam
        if beams is None
        else graph.op("Add", beams, graph.op("Mul", beam, graph.constant(0.0, np.float64)))
    )
    angle = graph.op("Mul", at, graph.constant(cue.angle_increment_rad, np.float64))
    first = graph.constant(cue.angle_min_rad, np.float64)
    angle = graph.op("Add", graph.op("Add", first, angle), graph.constant(cue.mount[2], np.float64))
    part = graph.op(
        "Div",
        graph.op("Add", angle, graph.constant(math.pi, np.float64)),
        graph.constant(2.0 * math.pi, np.float64),
    )
    sectors = graph.constant(float(cue.num_sectors), np.float64)
    place = graph.op("Mul", part, sectors)
    sides = [graph.op("Add", place, graph.constant(slack, np.float64)) for slack in (-SLACK, SLACK)]
    wrapped = [
        graph.op("Sub", side, graph.op("Mul", graph.op("Floor", graph.op("Div", side, sectors)), sectors))
        for side in sides
    ]
    index = graph.cast(graph.op("Concat", *wrapped, axis=1), np.int64)
    # Runtimes that compute with fewer digits than asked for round up to the number of sectors.
    last = graph.constant(cue.num_sectors - 1, np.int64)
    index = graph.op("Clip", index, graph.constant(0, np.int64), last)
    values = graph.op("Concat", metres, metres, axis=1)
    return graph.op("ScatterElements", zeros, index, values, axis=1, reduction="max")


def _look(graph: Graph, cue: CueSettings, hits: str, source: Place, target: Place) -> tuple[str, str]:
    """(N, K) distances of hits from another sensor, and the numbers of its beams that point there; float64."""
    angles = cue.angle_min_rad + cue.angle_increment_rad * np.arange(cue.num_beams)
    reach = graph.op("Min", graph.cast(hits, np.float64), graph.constant(cue.max_range_m, np.float64))
    x = graph.op("Mul", reach, graph.constant([np.cos(angles)], np.float64))
    y = graph.op("Mul", reach, graph.constant([np.sin(angles)], np.float64))
    turn = graph.op("Sub", source[2], target[2])
    px, py = _turned(graph, x, y, graph.op("Cos", turn), graph.op("Sin", turn))
    dx, dy = (graph.op("Sub", a, b) for a, b in zip(source[:2], target[:2], strict=True))
    back = graph.op("Neg", graph.op("Sin", target[2]))
    ox, oy = _turned(graph, dx, dy, graph.op("Cos", target[2]), back)
    px, py = graph.op("Add", px, ox), graph.op("Add", py, oy)
    square = graph.op("Add", graph.op("Mul", px, px), graph.op("Mul", py, py))
    bearing = graph.op("Sub", _rough_atan2(graph, py, px), graph.constant(cue.angle_min_rad, np.float64))
    number = graph.op("Div", bearing, graph.constant(cue.angle_increment_rad, np.float64))
    beams = 2.0 * math.pi / cue.angle_increment_rad
    circle, behind = (
        graph.constant(beams, np.float64),
        graph.constant(0.5 * (beams - cue.num_beams + 1), np.float64),
    )
    turns = graph.op("Div", graph.op("Add", number, behind), circle)
    beam = graph.op("Sub", number, graph.op("Mul", circle, graph.op("Floor", turns)))
    both = graph.op("Sqrt", square), beam
    rounded = [graph.cast(graph.cast(value, np.float32), np.float64) for value in both]
    return rounded[0], rounded[1]


def _rough_atan2(graph: Graph, y: str, x: str) -> str:
    def number(value: float) -> str:
        return graph.constant(value, np.float64)

    ax, ay = graph.op("Abs", x), graph.op("Abs", y)
    q = graph.op("Div", graph.op("Min", ax, ay), graph.op("Add", graph.op("Max", ax, ay), number(1e-300)))
    q2 = graph.op("Mul", q, q)
    angle = number(ATAN[0])
    for factor in ATAN[1:]:
        angle = graph.op("Add", number(factor), graph.op("Mul", q2, angle))
    angle = graph.op("Mul", q, angle)
    zero = number(0.0)
    for half, beyond in ((0.5 * math.pi, graph.op("Greater", ay, ax)), (math.pi, graph.op("Less", x, zero))):
        angle = graph.op("Where", beyond, graph.op("Sub", number(half), angle), angle)
    return graph.op("Where", graph.op("Less", y, zero), graph.op("Neg", angle), angle)


def _free_beyond(graph: Graph, cue: CueSettings, ranges: str, beam: str, distance: str) -> str:
    """(N, K) metres of free space that the other scan saw beyond a distance, by three beams in a row; float32."""
    count = cue.num_beams
    full_circle = abs(count * cue.angle_increment_rad - 2.0 * math.pi) < 1e-6
    middle = graph.cast(graph.op("Floor", graph.op("Add", beam, graph.constant(0.5, np.float64))), np.int64)
    read = []
    for shift in (-1, 0, 1):
        index = graph.op("Add", middle, graph.constant(shift, np.int64))
        if full_circle:
            index = graph.op("Mod", index, graph.constant(count, np.int64))
        else:
            index = graph.op("Clip", index, graph.constant(0, np.int64), graph.constant(count - 1, np.int64))
        read.append(graph.op("GatherElements", ranges, index, axis=1))
    told = graph.cast(graph.op("Add", distance, graph.constant(cue.margin_m, np.float64)), np.float32)
    free = graph.op("Sub", graph.op("Min", *read), told)
    if full_circle:
        return free
    ends = (graph.constant(-SLACK, np.float64), graph.constant(count - 1 + SLACK, np.float64))
    outside = graph.op("Or", graph.op("Less", beam, ends[0]), graph.op("Greater", beam, ends[1]))
    return graph.op("Where", outside, graph.constant(0.0), free)
