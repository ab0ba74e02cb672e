"""Frames of bags: where /tf says that the LiDAR and the goals are, through whatever links."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl.bags.transforms import Transforms
from adrl.errors import DatasetError
from adrl.geometry import compose, inverse, quaternion_of
from adrl.imitation import Demonstrations, read_demonstrations
from adrl.types import LidarConfig, RobotConfig
from bag_corridor import GOAL, YAW, Link, corridor_bag, pose_on_map

ROBOT = RobotConfig()
SECTORS = 36


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Demonstrations:
    return read(corridor_bag(tmp_path_factory.mktemp("plain") / "bag"))[0]


def read(path: Path, robot: RobotConfig = ROBOT) -> tuple[Demonstrations, tuple[str, ...]]:
    data, (summary,) = read_demonstrations([path], robot)
    return data, summary.notes


poses = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-3.0, 3.0))


@settings(max_examples=50, deadline=None)
@given(links=st.lists(st.tuples(poses, st.booleans()), min_size=1, max_size=5))
def test_a_chain_is_the_composition_of_its_links_whichever_way_they_were_told(links: list[Any]) -> None:
    transforms, expected = Transforms(), (0.0, 0.0, 0.0)
    for number, (pose, forward) in enumerate(links):
        expected = compose(expected, pose)
        ends = (str(number), str(number + 1))
        parent, child = ends if forward else ends[::-1]
        x, y, yaw = pose if forward else inverse(pose)
        transforms.add(parent, child, 1.0, (x, y, 0.0), quaternion_of(yaw))
    chain = transforms.chain("0", str(len(links)))
    assert chain is not None
    place, turn = chain.at(np.array([0.0, 5.0]))
    assert_allclose(place, np.tile([*expected[:2], 0.0], (2, 1)), atol=1e-9)
    assert_allclose(
        turn.apply([1.0, 0.0, 0.0])[0, :2], [math.cos(expected[2]), math.sin(expected[2])], atol=1e-9
    )
    assert transforms.chain("0", "elsewhere") is None


def test_between_two_messages_a_frame_is_between_the_two_poses() -> None:
    transforms = Transforms()
    for seconds, x, yaw in ((1.0, 0.0, 3.0), (3.0, 4.0, -3.0)):  # by way of pi
        transforms.add("map", "odom", seconds, (x, 0.0, 0.0), quaternion_of(yaw))
    chain = transforms.chain("map", "odom")
    assert chain is not None
    place, turn = chain.at(np.array([0.0, 1.5, 2.0, 9.0]))
    assert_allclose(place[:, 0], [0.0, 1.0, 2.0, 4.0], atol=1e-9)
    yaw = np.remainder(turn.as_euler("ZYX")[:, 0], 2.0 * math.pi)
    assert_allclose(yaw, [3.0, 3.0 + 0.25 * (2 * math.pi - 6.0), math.pi, 2 * math.pi - 3.0], atol=1e-9)


MOUNTS: dict[str, tuple[tuple[float, float, float], Callable[[np.ndarray], np.ndarray]]] = {
    "backwards": ((0.0, 0.0, math.pi), lambda a: a + math.pi),
    "to the left": ((0.0, 0.0, 0.5 * math.pi), lambda a: a + 0.5 * math.pi),
    "upside down": ((math.pi, 0.0, 0.0), lambda a: -a),
    "upside down and backwards": ((0.0, math.pi, 0.0), lambda a: math.pi - a),
    "upside down and turned": ((math.pi, 0.0, 0.5), lambda a: 0.5 - a),
}


@pytest.mark.parametrize("name", MOUNTS)
def test_a_lidar_is_read_as_tf_says_it_is_mounted(tmp_path: Path, plain: Demonstrations, name: str) -> None:
    turn, seen_at = MOUNTS[name]
    path = corridor_bag(
        tmp_path / "bag", lidar=Link(parent="base_link", child="laser", turn=turn), seen_at=seen_at
    )
    data, (note,) = read(path)
    # Turned by half a beam, a wall between two beams is met by both: an error of the resampling.
    assert_allclose(data.observation, plain.observation, atol=0.02)
    for text in ("/tf", "/scan", "base_link -> laser", "robot 'diffbot' has (0.00 m, 0.00 m, 0 degrees)"):
        assert text in note
    assert ("upside down" in note) == ("upside down" in name)


def test_a_mount_over_links_that_the_robot_file_has_too_needs_no_word(tmp_path: Path) -> None:
    robot = replace(ROBOT, lidar=LidarConfig(mount_x_m=0.1, mount_yaw_rad=0.3))
    path = corridor_bag(
        tmp_path / "bag",
        lidar=Link(parent="plate", child="laser", turn=(0.0, 0.0, 0.3)),
        links=[Link(parent="base_link", child="plate", place=(0.1, 0.0, 0.2))],
    )
    assert read(path, robot)[1] == ()
    moved, (note,) = read(path)
    assert "(0.10 m, 0.00 m, 17 degrees)" in note
    assert len(moved) == len(read(path, robot)[0])


def test_a_robot_s_frame_that_the_odometry_does_not_name_is_the_first_below_it(
    tmp_path: Path, plain: Demonstrations
) -> None:
    def nameless(_: float, odometry: Any) -> Any:
        odometry.child_frame_id = ""
        return odometry

    backwards = Link(parent="base_link", child="laser", turn=(0.0, 0.0, math.pi))
    path = corridor_bag(
        tmp_path / "bag", lidar=backwards, seen_at=lambda a: a + math.pi, edit={"/odom": nameless}
    )
    data, (note,) = read(path)
    assert_allclose(data.observation, plain.observation, atol=1e-5)
    assert "180 degrees" in note


def nodding(now_s: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return (0.0, 0.0, 0.0), (0.0, 0.0, 0.3 * math.sin(now_s))


REFUSED: dict[str, tuple[Link, str]] = {
    "tilted": (
        Link(parent="base_link", child="laser", turn=(0.0, 0.3, 0.0)),
        r"/scan \(base_link -> laser\) is tilted by 17.2 degrees",
    ),
    "on its side": (
        Link(parent="base_link", child="laser", turn=(0.5 * math.pi, 0.0, 0.0)),
        "tilted by 90.0 degrees",
    ),
    "nodding": (Link(parent="base_link", child="head", at=nodding), "moves on the robot"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_lidar_that_does_not_scan_the_plane_is_refused(tmp_path: Path, name: str) -> None:
    link, message = REFUSED[name]
    head = link.at is not None
    lidar = Link(parent="head", child="laser") if head else link
    path = corridor_bag(tmp_path / "bag", lidar=lidar, links=[link] if head else ())
    with pytest.raises(DatasetError, match=message):
        read(path)


def test_frames_that_tf_does_not_relate_are_told(tmp_path: Path, plain: Demonstrations) -> None:
    path = corridor_bag(tmp_path / "bag", lidar=Link(parent="body", child="laser", turn=(0.0, 0.0, 1.0)))
    data, (note,) = read(path)
    assert_allclose(data.observation, plain.observation)
    for text in ("'base_link'", "'laser'", "robot 'diffbot' says"):
        assert text in note


@pytest.mark.parametrize(
    ("topic", "field", "change"),
    [
        ("/scan", "header.frame_id", lambda m: setattr(m.header, "frame_id", "laser_back")),
        ("/odom", "header.frame_id", lambda m: setattr(m.header, "frame_id", "odom_combined")),
        ("/odom", "child_frame_id", lambda m: setattr(m, "child_frame_id", "camera")),
    ],
)
def test_one_topic_with_two_frames_is_refused(
    tmp_path: Path, topic: str, field: str, change: Callable[[Any], None]
) -> None:
    def every_third(now_s: float, message: Any) -> Any:
        if round(now_s * 10) % 3 == 0:
            change(message)
        return message

    path = corridor_bag(tmp_path / "bag", edit={topic: every_third})
    with pytest.raises(DatasetError, match=rf"{topic} .*{field} is '\w+' and '\w+'"):
        read(path)


def test_a_slash_before_a_frame_s_name_is_no_other_frame(tmp_path: Path, plain: Demonstrations) -> None:
    def with_slash(now_s: float, message: Any) -> Any:
        message.header.frame_id = "/laser" if now_s > 5.0 else "laser"
        return message

    assert_allclose(
        read(corridor_bag(tmp_path / "bag", edit={"/scan": with_slash}))[0].observation, plain.observation
    )


def test_goals_are_brought_through_any_links(tmp_path: Path, plain: Demonstrations) -> None:
    """map -> odom_combined -> odom, one still and one moving, one told the other way round."""
    still = (5.0, -2.0, 0.7)
    combined_on_odom = (0.5, 0.25, -0.3)
    goal = compose(compose(still, inverse(combined_on_odom)), (*GOAL, 0.0))
    links = [
        Link(parent="map", child="odom_combined", place=(*still[:2], 0.0), turn=(0.0, 0.0, still[2])),
        Link(parent="odom", child="odom_combined", at=lambda _: ((0.5, 0.25, 0.0), (0.0, 0.0, -0.3))),
    ]
    path = corridor_bag(tmp_path / "bag", links=links, goal=goal[:2], goal_frame="map")
    data, notes = read(path)
    assert_allclose(data.observation, plain.observation, atol=1e-6)
    assert notes == ()


def test_a_goal_on_the_map_stays_there_while_the_odometry_drifts(tmp_path: Path) -> None:
    """Localisation finds 0.1 m/s of drift: the goal comes nearer so much faster, and the drive has arrived earlier."""

    def drift(now_s: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (0.1 * now_s * math.cos(YAW), 0.1 * now_s * math.sin(YAW), 0.0), (0.0, 0.0, 0.0)

    links = [Link(parent="map", child="odom", at=drift)]
    data, _ = read(corridor_bag(tmp_path / "bag", links=links, goal_frame="map"))
    distance_m = data.observation[:, SECTORS + 2]
    assert data.terminated[-1]
    assert_allclose(3.0 - 0.1 * 2.0 - 0.3, (len(data) + 0.5) * 0.05, atol=0.06)
    assert (np.diff(distance_m) < 0.0).all()


def test_a_goal_given_from_where_the_robot_is_stays_where_that_was(
    tmp_path: Path, plain: Demonstrations
) -> None:
    path = corridor_bag(tmp_path / "bag", goal=(3.0, 0.0), goal_frame="base_link")
    assert_allclose(read(path)[0].observation, plain.observation, atol=1e-6)


def test_poses_on_the_map_relate_goals_where_tf_does_not(tmp_path: Path, plain: Demonstrations) -> None:
    """As our own nodes of ROS 1 are recorded: no /tf at all."""
    odom_on_map = (5.0, -2.0, 0.7)
    start = (0.0, 0.0, YAW)
    path = corridor_bag(
        tmp_path / "bag",
        edit={"/tf": lambda *_: None, "/tf_static": lambda *_: None},
        goal=compose(odom_on_map, (*GOAL, 0.0))[:2],
        goal_frame="map",
        more=[("/amcl_pose", 1.0, pose_on_map(1.0, compose(odom_on_map, start)))],
    )
    data, notes = read(path)
    assert_allclose(data.observation, plain.observation, atol=1e-6)
    assert notes == ()


def test_a_late_pose_on_the_map_is_of_when_it_was_measured(tmp_path: Path, plain: Demonstrations) -> None:
    path = corridor_bag(
        tmp_path / "bag",
        goal_frame="map",
        # Recorded at 5 s, measured 0.5 s before: the robot has driven 0.2 m since.
        more=[("/amcl_pose", 5.0, pose_on_map(4.5, (1.0 * math.cos(YAW), 1.0 * math.sin(YAW), YAW)))],
    )
    assert_allclose(read(path)[0].observation, plain.observation, atol=1e-6)


def test_goals_in_a_frame_that_nothing_relates_are_refused(tmp_path: Path) -> None:
    path = corridor_bag(tmp_path / "bag", goal_frame="map", links=[Link(parent="map", child="odom_combined")])
    with pytest.raises(
        DatasetError, match=r"frame 'map', odometry in 'odom', and neither /tf nor /amcl_pose"
    ):
        read(path)


def test_a_transform_that_is_none_is_refused(tmp_path: Path) -> None:
    def without_rotation(_: float, message: Any) -> Any:
        message.transforms[0].transform.rotation.w = 0.0
        return message

    path = corridor_bag(tmp_path / "bag", edit={"/tf_static": without_rotation})
    with pytest.raises(DatasetError, match=r"/tf_static: transform base_link -> laser .* no unit quaternion"):
        read(path)
