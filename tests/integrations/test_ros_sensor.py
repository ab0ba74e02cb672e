"""Where a sensor sits by transforms, and clouds of points that are looked at between two heights."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl.bags.messages import laser_scan, transform_stamped
from adrl.deploy.frames import Frames, Transform
from adrl.errors import ConfigError, TransformError
from adrl.geometry import quaternion_of
from adrl.integrations.ros.config import DriveConfig
from adrl.integrations.ros.sensor import BEAMS, Sensor, flat_scan, points_of
from adrl.types import Array
from integrations.test_ros_topics import PERIOD_S, ROBOT, Node, header, new

CONFIG = DriveConfig(robot="diffbot", guidance="goal", localisation="tf", heights=(0.1, 0.5))
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)


def cloud(points: Array, *, order: str = "<", kind: str = "f4", pad: int = 4, rows: int = 1) -> Any:
    """A sensor_msgs/PointCloud2 with something else before, between and after the coordinates."""
    size = np.dtype(kind).itemsize
    step = pad + 3 * (size + pad)
    offsets = [pad + axis * (size + pad) for axis in range(3)]
    layout = np.dtype(
        {"names": list("xyz"), "formats": [order + kind] * 3, "offsets": offsets, "itemsize": step}
    )
    table = np.zeros(len(points), layout)
    for axis, name in enumerate("xyz"):
        table[name] = points[:, axis]
    row = np.frombuffer(table.tobytes(), np.uint8).reshape(rows, -1)
    data = np.hstack([row, np.full((rows, 3), 255, np.uint8)])  # rows are padded, too
    number = {"f4": 7, "f8": 8}[kind]
    fields = [
        new("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=number, count=1)
        for name, offset in zip("xyz", offsets, strict=True)
    ]
    return new(
        "sensor_msgs/msg/PointCloud2",
        header=header(1.0, "camera"),
        height=rows,
        width=len(points) // rows,
        fields=fields,
        is_bigendian=order == ">",
        point_step=step,
        row_step=data.shape[1],
        data=data.ravel(),
        is_dense=True,
    )


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("rows", [1, 3])
def test_points_are_read_whatever_the_layout(order: str, kind: str, rows: int) -> None:
    points = np.random.default_rng(0).normal(0.0, 5.0, (12, 3))
    np.testing.assert_allclose(points_of(cloud(points, order=order, kind=kind, rows=rows)), points, rtol=1e-6)


def test_clouds_that_cannot_be_are_refused() -> None:
    whole = cloud(np.ones((4, 3)))
    for changes in (
        {"fields": whole.fields[:2]},
        {"data": whole.data[:-5]},
        {"width": 9},
        {"point_step": 0},
        {"point_step": 5},
    ):
        with pytest.raises(TransformError, match="cloud"):
            points_of(dataclasses.replace(whole, **changes))


@given(
    points=st.lists(st.tuples(*[st.floats(-8.0, 8.0)] * 3), min_size=1, max_size=40),
    place=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    yaw=st.floats(-3.0, 3.0),
)
@settings(max_examples=60)
def test_a_beam_is_the_nearest_point_of_its_direction_between_the_heights(points, place, yaw) -> None:
    low, high = 0.1, 0.5
    scan = flat_scan(np.array(points), Transform(place, quaternion_of(yaw)), (low, high), 10.0, 1.0)
    expected: dict[int, float] = {}
    for x, y, z in points:
        px = place[0] + math.cos(yaw) * x - math.sin(yaw) * y
        py = place[1] + math.sin(yaw) * x + math.cos(yaw) * y
        beam = math.floor((math.atan2(py, px) + math.pi) / (2.0 * math.pi) * BEAMS) % BEAMS
        seen = math.hypot(px, py) if low <= place[2] + z <= high else math.inf
        expected[beam] = min(expected.get(beam, math.inf), seen)
    for beam, reading in enumerate(scan.ranges):
        if beam not in expected:
            assert math.isnan(reading)
        elif not math.isclose(reading, expected[beam], abs_tol=1e-6):  # on the border between two beams
            assert any(abs(reading - expected.get((beam + k) % BEAMS, math.nan)) < 1e-6 for k in (-1, 1))


def test_a_cloud_stands_for_the_scan_where_its_sensor_is_known() -> None:
    frames = Frames()
    sensor = Sensor(CONFIG, frames, ROBOT.lidar)
    wall = np.array([(2.0, y, 0.3) for y in np.linspace(-1.0, 1.0, 50)])
    with pytest.raises(TransformError, match="'base_link' to 'camera'"):
        sensor.read(cloud(wall), 1.0)
    frames.take("base_link", "camera", 0.0, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), static=True)
    scan, mount = sensor.read(cloud(wall), 1.0)
    assert mount == (0.0, 0.0, 0.0)
    assert scan.ranges[BEAMS // 2] == pytest.approx(2.5, abs=0.01)
    assert sensor.read(cloud(wall), 1.1)[1] is None
    with pytest.raises(ConfigError, match="heights need tf"):
        DriveConfig(heights=(0.0, 1.0))
    with pytest.raises(ConfigError, match="lower one first"):
        DriveConfig(localisation="tf", heights=(1.0, 0.0))


def tell(node: Node, *links: Any, static: bool = False) -> None:
    node.hear("/tf_static" if static else "/tf", new("tf2_msgs/msg/TFMessage", transforms=list(links)))


def link(node: Node, parent: str, child: str, x_m: float = 0.0) -> Any:
    return transform_stamped(new, header(node.now_s, parent), child, (x_m, 0.0, 0.0))


def test_a_lidar_sits_where_its_transform_says() -> None:
    """Until that is known its scans are not used, and the node stands."""
    node = Node(localisation="tf").run(2)
    assert "no_scan" in node.statuses()[-1][1]["reasons"]
    tell(node, link(node, "base_link", "base_scan", 0.12), static=True)
    tell(node, link(node, "map", "odom"))
    node.run(2)
    navigator = node.topics.driver.navigator
    assert navigator.supervisor is not None
    assert navigator.supervisor._surroundings._mount == pytest.approx((0.12, 0.0, 0.0))
    node.goal(3.0, "map")
    node.run(3)
    assert node.statuses()[-1][1]["status"] == "driving"
    assert node.speeds()[-1] > 0.0


def test_a_goal_from_before_the_lidars_place_was_known_is_driven_to_within_its_limits() -> None:
    node = Node(localisation="tf").run(2)
    node.goal(3.0)
    node.topics.driver.navigator.speed_limit_mps = 0.2
    ((_, values),) = node.run(1).statuses()[-1:]
    assert (values["goal"], values["reasons"]) == ("3.000 0.000", "no_scan")
    tell(node, link(node, "base_link", "base_scan", 0.12), static=True)
    node.run(8)
    assert (node.statuses()[-1][1]["status"], node.topics.driver.taken) == ("driving", 1)
    assert 0.1 < max(node.speeds()) <= 0.2


def test_a_lidar_upside_down_is_read_from_above() -> None:
    frames = Frames()
    sensor = Sensor(dataclasses.replace(CONFIG, heights=None), frames, ROBOT.lidar)
    frames.take("base_link", "base_scan", 0.0, (0.0, 0.0, 0.2), UPSIDE_DOWN, static=True)
    ranges = np.linspace(1.0, 2.0, ROBOT.lidar.num_beams)
    told = laser_scan(new, header(1.0, "base_scan"), ROBOT.lidar, ranges, PERIOD_S)
    scan, mount = sensor.read(told, 1.0)
    assert mount == pytest.approx((0.0, 0.0, 0.0))
    assert scan.angle_increment_rad == -told.angle_increment
    assert scan.angle_min_rad == -told.angle_min
    other = laser_scan(new, header(1.1, "rear_scan"), ROBOT.lidar, ranges, PERIOD_S)
    with pytest.raises(TransformError, match="rear_scan"):
        sensor.read(other, 1.1)


def test_a_place_by_transforms_holds_for_a_while_and_then_the_node_stands_and_says_why() -> None:
    node = Node(localisation="tf").run(1)
    tell(node, link(node, "base_link", "base_scan"), static=True)
    tell(node, link(node, "map", "odom", 1.0))
    node.run(1)
    node.goal(3.0, "map")
    node.run(4, 0.2)
    assert node.speeds()[-1] > 0.0
    node.run(4, 0.2)
    level, values = node.statuses()[-1]
    assert (level, values["reasons"]) == (1, "not_localised")
    assert node.speeds()[-1] == 0.0
    tell(node, link(node, "map", "odom", 1.0))
    assert "not_localised" not in node.run(2, 0.2).statuses()[-1][1]["reasons"]
    assert node.speeds()[-1] > 0.0
