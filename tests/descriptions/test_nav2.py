"""Parameter files of Nav2 and move_base: what is written of a robot is read again; what is no such robot is refused."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import nav2_files
from adrl.descriptions import Standing, read_nav2, settle
from adrl.errors import ConfigError
from adrl.types import LidarConfig, RobotConfig
from nav2_files import parameters, write

ROBOT = RobotConfig(name="cart", radius_m=0.25, max_speed_mps=0.7, min_speed_mps=-0.2)
FIELDS = (
    *("radius_m", "max_speed_mps", "min_speed_mps", "max_yaw_rate_radps", "max_acceleration_mps2"),
    *("max_yaw_acceleration_radps2", "control_period_s", "lidar.max_range_m"),
)


def value_of(robot: RobotConfig, field: str) -> Any:
    return getattr(robot.lidar, field.removeprefix("lidar.")) if "." in field else getattr(robot, field)


def read(path: Path, content: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Field -> value, of a file that contradicts itself in nothing."""
    settled = settle(read_nav2([write(path, content)], **options).findings)
    assert settled.faults == ()
    return {name: finding.value for name, finding in settled.chosen.items()}


@settings(max_examples=60, deadline=None)
@given(
    controller=st.sampled_from(["dwb", "mppi", "teb"]),
    radius=st.floats(0.05, 5.0),
    speed=st.floats(0.05, 20.0),
    reverse=st.floats(0.0, 1.0),
    numbers=st.tuples(*[st.floats(0.05, 40.0)] * 4),
    rate=st.floats(1.0, 100.0),
)
def test_a_robot_comes_back_from_its_parameters(
    tmp_path_factory: pytest.TempPathFactory,
    controller: str,
    radius: float,
    speed: float,
    reverse: float,
    numbers: tuple[float, ...],
    rate: float,
) -> None:
    robot = RobotConfig(
        radius_m=radius,
        max_speed_mps=speed,
        min_speed_mps=-reverse * speed,
        max_yaw_rate_radps=numbers[0],
        max_acceleration_mps2=numbers[1],
        max_yaw_acceleration_radps2=numbers[2],
        control_period_s=1.0 / rate,
        lidar=LidarConfig(max_range_m=numbers[3]),
    )
    found = read(tmp_path_factory.mktemp("nav2") / "p.yaml", parameters(robot, controller))
    for field in FIELDS:
        assert found[field] == pytest.approx(value_of(robot, field), abs=1e-8), field
    assert found["scan_topic"] == "/front/scan"
    assert (found["odom_frame"], found["map_frame"], found["base_frame"]) == ("odom", "map", "base_footprint")


@settings(max_examples=30, deadline=None)
@given(
    half=st.tuples(st.floats(0.05, 5.0), st.floats(0.05, 5.0), st.floats(-0.04, 0.04)),
    form=st.sampled_from([str, repr, lambda corners: corners, lambda corners: f" {corners} "]),
    turn=st.integers(0, 3),
    clockwise=st.booleans(),
)
def test_a_footprint_is_read_as_text_or_list_and_either_way_round(
    tmp_path_factory: pytest.TempPathFactory,
    half: tuple[float, float, float],
    form: Callable[[Any], Any],
    turn: int,
    clockwise: bool,
) -> None:
    x, y, ahead = half
    corners = [[x + ahead, y], [-x + ahead, y], [-x + ahead, -y], [x + ahead, -y]]
    content = parameters(ROBOT)
    costmaps = [
        content[f"{kind}_costmap"][f"{kind}_costmap"]["ros__parameters"] for kind in ("local", "global")
    ]
    for costmap in costmaps:
        del costmap["robot_radius"]
    costmaps[0]["footprint"] = form(corners)
    again = (corners[turn:] + corners[:turn])[:: -1 if clockwise else 1]
    costmaps[1]["footprint"] = str(again)
    found = read(tmp_path_factory.mktemp("nav2") / "p.yaml", content)
    np.testing.assert_allclose(sorted(found["footprint_m"]), sorted(map(tuple, corners)), atol=1e-5)


def test_pure_pursuit_takes_its_accelerations_from_the_smoother(tmp_path: Path) -> None:
    found = read(tmp_path / "p.yaml", parameters(ROBOT, "pure_pursuit"))
    assert found["max_speed_mps"] == ROBOT.max_speed_mps
    assert found["min_speed_mps"] == ROBOT.min_speed_mps  # as fast as forwards, but for the smoother
    assert found["max_acceleration_mps2"] == ROBOT.max_acceleration_mps2
    assert found["max_yaw_rate_radps"] == ROBOT.max_yaw_rate_radps


def test_the_smoother_bounds_what_the_controller_asks_for(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    content["velocity_smoother"]["ros__parameters"]["max_velocity"] = [0.4, 0.0, 9.0]
    settled = settle(read_nav2([write(tmp_path / "p.yaml", content)]).findings)
    speed = settled.chosen["max_speed_mps"]
    assert speed.value == 0.4
    assert "velocity_smoother.max_velocity[0]" in speed.place
    assert "within 0.7 of" in speed.place
    assert settled.chosen["max_yaw_rate_radps"].value == ROBOT.max_yaw_rate_radps


def test_the_weaker_of_speeding_up_and_braking_is_taken(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    controller(content)["decel_lim_x"] = -0.5
    assert read(tmp_path / "p.yaml", content)["max_acceleration_mps2"] == 0.5


def test_namespaces_dotted_names_and_unused_controllers_are_read_as_nav2_does(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    server = content["controller_server"]["ros__parameters"]
    fast = controller(content) | {"max_vel_x": 5.0}
    follow = server.pop("FollowPath")
    server |= {f"FollowPath.{name}": value for name, value in follow.items()}
    server["Fast"] = fast
    found = read(tmp_path / "p.yaml", {"robot1": content, "/**": {"ros__parameters": {"use_sim_time": True}}})
    assert found["max_speed_mps"] == ROBOT.max_speed_mps


def test_a_rotation_shim_drives_by_its_primary_controller(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    shim = controller(content)
    shim["primary_controller"] = shim["plugin"]
    shim["plugin"] = "nav2_rotation_shim_controller::RotationShimController"
    assert read(tmp_path / "p.yaml", content)["max_speed_mps"] == ROBOT.max_speed_mps


def test_files_of_move_base_are_read_together(tmp_path: Path) -> None:
    common = tmp_path / "costmap_common_params.yaml"
    common.write_text(
        "footprint: [[-0.3, -0.2], [-0.3, 0.2], [0.3, 0.2], [0.3, -0.2]]\nrobot_base_frame: base_link\n"
        "obstacles: {observation_sources: laser bump, bump: {data_type: PointCloud, topic: bump},\n"
        "  laser: {data_type: LaserScan, topic: front/scan, obstacle_range: 5.5, raytrace_range: 6.0}}\n"
    )
    local = tmp_path / "base_local_planner_params.yaml"
    local.write_text(
        "TrajectoryPlannerROS: {max_vel_x: 1.0, min_vel_x: 0.1, max_vel_theta: 1.2, acc_lim_x: 2.5,\n"
        "  acc_lim_theta: 3.2, holonomic_robot: false, controller_frequency: 50.0}\n"
        "DWAPlannerROS: {max_vel_x: 0.5, min_vel_x: -0.1, max_rot_vel: 1.0, acc_lim_x: 2.0, acc_lim_th: 3.0}\n"
    )
    base = tmp_path / "move_base_params.yaml"
    base.write_text("controller_frequency: 5.0\nbase_local_planner: dwa_local_planner/DWAPlannerROS\n")
    settled = settle(read_nav2([common, local, base]).findings)
    assert settled.faults == ()
    found = {name: finding.value for name, finding in settled.chosen.items()}
    assert found["footprint_m"][0] == (-0.3, -0.2)
    assert (found["max_speed_mps"], found["min_speed_mps"], found["max_yaw_rate_radps"]) == (0.5, -0.1, 1.0)
    assert found["control_period_s"] == 0.2
    assert (found["scan_topic"], found["lidar.max_range_m"], found["ros"]) == ("/front/scan", 5.5, "ros1")
    assert settled.chosen["lidar.max_range_m"].standing is Standing.HINT
    base.write_text("controller_frequency: 5.0\n")
    (fault, *_) = [f for f in settle(read_nav2([common, local]).findings).faults if "max_speed_mps" in f]
    for text in ("TrajectoryPlannerROS.max_vel_x", "DWAPlannerROS.max_vel_x", "--set max_speed_mps=0.5"):
        assert text in fault


def test_a_key_that_is_there_twice_counts_where_it_matters(tmp_path: Path) -> None:
    path = write(tmp_path / "p.yaml", parameters(ROBOT))
    text = path.read_text()
    path.write_text(text.replace("global_frame: odom", "global_frame: odom\n      width: 3\n      width: 5"))
    assert settle(read_nav2([path]).findings).faults == ()
    path.write_text(text.replace("max_vel_x: 0.7", "max_vel_x: 0.7\n      max_vel_x: 0.7"))
    assert settle(read_nav2([path]).findings).faults == ()
    path.write_text(text.replace("max_vel_x: 0.7", "max_vel_x: 0.7\n      max_vel_x: 0.9"))
    with pytest.raises(
        ConfigError, match=r"controller_server.FollowPath.max_vel_x is 0.7 and 0.9; leave one"
    ):
        read_nav2([path])
    path.write_text(text + "amcl: {ros__parameters: {}}\n")
    with pytest.raises(ConfigError, match="has 'amcl' twice; leave one"):
        read_nav2([path])


def controller(content: dict[str, Any]) -> dict[str, Any]:
    return content["controller_server"]["ros__parameters"]["FollowPath"]


def costmap(content: dict[str, Any], kind: str = "local") -> dict[str, Any]:
    return content[f"{kind}_costmap"][f"{kind}_costmap"]["ros__parameters"]


def second_lidar(content: dict[str, Any]) -> None:
    layer = costmap(content)["obstacle_layer"] = dict(costmap(content)["obstacle_layer"])
    layer["observation_sources"] = "scan rear"
    layer["rear"] = {"topic": "rear/scan", "data_type": "LaserScan"}


REFUSED: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "omni-directional by amcl": (
        lambda c: c["amcl"]["ros__parameters"].update(robot_model_type="nav2_amcl::OmniMotionModel"),
        "amcl.robot_model_type is nav2_amcl::OmniMotionModel: that is an omni-directional robot",
    ),
    "omni-directional by controller": (
        lambda c: controller(c).update(max_vel_y=0.3),
        "FollowPath.max_vel_y is 0.3: that is an omni-directional robot",
    ),
    "omni-directional by smoother": (
        lambda c: c["velocity_smoother"]["ros__parameters"].update(max_velocity=[1.0, 0.4, 1.0]),
        r"velocity_smoother.max_velocity\[1\] is 0.4: that is an omni-directional robot",
    ),
    "omni-directional by model": (
        lambda c: controller(c).update(nav2_files.mppi(ROBOT) | {"motion_model": "Omni"}),
        "FollowPath.motion_model is Omni: that is an omni-directional robot, .* set its y speeds to 0",
    ),
    "omni-directional by its least speed": (
        lambda c: controller(c).update(min_vel_y=-0.3),
        "FollowPath.min_vel_y is -0.3: that is an omni-directional robot",
    ),
    "omni-directional by the smoother's least": (
        lambda c: c["velocity_smoother"]["ros__parameters"].update(min_velocity=[0.0, -0.4, -1.0]),
        r"velocity_smoother.min_velocity\[1\] is -0.4: that is an omni-directional robot",
    ),
    "two LiDARs": (
        second_lidar,
        "several LiDARs: /front/scan .* and /rear/scan .*: --scan-topic /front/scan, or --scan-topic /rear/scan",
    ),
    "a speed that is no number": (
        lambda c: controller(c).update(max_vel_x="fast"),
        "controller_server.FollowPath.max_vel_x is 'fast'; give a number",
    ),
    "a radius that is a list": (
        lambda c: costmap(c).update(robot_radius=[0.2, 0.3]),
        r"local_costmap.robot_radius is \[0.2, 0.3\]; give a number",
    ),
    "a footprint of words": (
        lambda c: costmap(c).update(footprint="[[a, b]]"),
        r"local_costmap.footprint is '\[\[a, b\]\]'; give corners",
    ),
    "a footprint with half a corner": (
        lambda c: costmap(c).update(footprint="[[1, 2], [3, 4], [5]]"),
        "local_costmap.footprint",
    ),
    "nothing of a robot": (lambda c: c.clear() or c.update(map_server={"a": 1}), "says nothing of a robot"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_such_robot_is_refused_by_its_place(tmp_path: Path, name: str) -> None:
    spoil, message = REFUSED[name]
    content = parameters(ROBOT)
    spoil(content)
    with pytest.raises(ConfigError, match=message) as caught:
        read_nav2([write(tmp_path / "p.yaml", content)])
    assert str(tmp_path / "p.yaml") in str(caught.value)


def smac(content: dict[str, Any], radius_m: float, plugin: str = "SmacPlannerHybrid") -> None:
    """A planner of curves."""
    grid = {"plugin": f"nav2_smac_planner::{plugin}", "minimum_turning_radius": radius_m}
    content["planner_server"] = {"ros__parameters": {"planner_plugins": ["GridBased"], "GridBased": grid}}


def ackermann(content: dict[str, Any], **constraints: float) -> None:
    controller(content).clear()
    controller(content).update(nav2_files.mppi(ROBOT) | {"motion_model": "Ackermann"})
    if constraints:
        controller(content)["AckermannConstraints"] = constraints


def never_turning(content: dict[str, Any]) -> None:
    controller(content).clear()
    controller(content).update(nav2_files.pure_pursuit(ROBOT) | {"use_rotate_to_heading": False})
    smac(content, 0.45)


CARS: dict[str, tuple[Callable[[dict[str, Any]], object], float | None]] = {
    "MPPI says it": (lambda c: ackermann(c, min_turning_r=0.35), 0.35),
    "MPPI, and the planner's radius is another": (
        lambda c: (ackermann(c, min_turning_r=0.35), smac(c, 0.5)),
        0.35,
    ),
    "MPPI says no radius, the planner does": (lambda c: (ackermann(c), smac(c, 0.5)), 0.5),
    "a lattice": (lambda c: (ackermann(c), smac(c, 0.5, "SmacPlannerLattice")), 0.5),
    "TEB": (lambda c: controller(c).update(nav2_files.teb(ROBOT) | {"min_turning_radius": 0.8}), 0.8),
    "pure pursuit that never turns on the spot": (never_turning, 0.45),
    "MPPI that drives no car": (
        lambda c: controller(c).update(
            nav2_files.mppi(ROBOT) | {"AckermannConstraints": {"min_turning_r": 0.2}}
        ),
        None,
    ),
    "a planner of curves for any robot": (lambda c: smac(c, 0.4), None),
}


@pytest.mark.parametrize("name", CARS)
def test_a_car_has_the_radius_that_is_its_own(tmp_path: Path, name: str) -> None:
    spoil, radius_m = CARS[name]
    content = parameters(ROBOT)
    spoil(content)
    assert read(tmp_path / "p.yaml", content).get("min_turning_radius_m") == radius_m


def test_a_car_without_a_radius_is_asked_for_it(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    ackermann(content)
    assert "min_turning_radius_m" in settle(read_nav2([write(tmp_path / "p.yaml", content)]).findings).missing
    assert (
        "min_turning_radius_m"
        not in settle(read_nav2([write(tmp_path / "q.yaml", parameters(ROBOT))]).findings).missing
    )


def test_a_planners_radius_that_nothing_confirms_is_told(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    smac(content, 0.4)
    (note,) = read_nav2([write(tmp_path / "p.yaml", content)]).notes
    assert "GridBased.minimum_turning_radius is 0.4" in note
    assert "--set min_turning_radius_m=0.4" in note


def test_of_two_lidars_the_topic_chooses(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    second_lidar(content)
    content["global_costmap"]["global_costmap"]["ros__parameters"].pop("obstacle_layer")
    found = read(tmp_path / "p.yaml", content, scan_topic="rear/scan")
    assert found["scan_topic"] == "/rear/scan"
    assert "lidar.max_range_m" not in found


CONTRADICTIONS: dict[str, tuple[Callable[[dict[str, Any]], object], tuple[str, ...]]] = {
    "two radii": (
        lambda c: costmap(c, "global").update(robot_radius=0.3),
        (
            "local_costmap.robot_radius",
            "global_costmap.robot_radius",
            "--set radius_m=0.25",
            "--set radius_m=0.3",
        ),
    ),
    "radius and footprint": (
        lambda c: costmap(c).update(footprint="[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]"),
        ("local_costmap.robot_radius", "local_costmap.footprint", "--set 'footprint_m=[[0.3,0.2],"),
    ),
    "two footprints": (
        lambda c: (
            costmap(c).update(robot_radius=None, footprint="[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2]]"),
            costmap(c, "global").update(
                robot_radius=None, footprint="[[0.3, 0.2], [-0.3, 0.2], [-0.4, -0.2]]"
            ),
        ),
        ("local_costmap.footprint", "global_costmap.footprint", "say which"),
    ),
    "two controllers": (
        lambda c: c["controller_server"]["ros__parameters"].update(
            controller_plugins=["FollowPath", "Slow"], Slow=nav2_files.dwb(ROBOT) | {"max_vel_x": 0.2}
        ),
        ("FollowPath.max_vel_x", "Slow.max_vel_x", "--set max_speed_mps=0.7, or --set max_speed_mps=0.2"),
    ),
    "a footprint that bends inwards": (
        lambda c: (
            costmap(c).update(robot_radius=None, footprint="[[1, 0], [0, 1], [0.1, 0.1], [0, -1]]"),
            costmap(c, "global").update(robot_radius=None),
        ),
        ("local_costmap.footprint", "is not convex: it bends inwards at (0.1, 0.1)", "--set footprint_m="),
    ),
    "a radius of no robot": (
        lambda c: (costmap(c).update(robot_radius=30.0), costmap(c, "global").update(robot_radius=None)),
        ("radius_m is 30", "local_costmap.robot_radius", "give 0.01 to 10"),
    ),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_a_contradiction_names_both_places_and_what_settles_it(tmp_path: Path, name: str) -> None:
    spoil, texts = CONTRADICTIONS[name]
    content = parameters(ROBOT)
    spoil(content)
    (fault,) = settle(read_nav2([write(tmp_path / "p.yaml", content)]).findings).faults
    for text in texts:
        assert text in fault


def test_what_a_launch_file_fills_in_is_told_and_not_found(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    controller(content)["max_vel_x"] = "$(var speed)"
    content["velocity_smoother"]["ros__parameters"]["max_velocity"] = [None, 0.0, 2.0]
    reading = read_nav2([write(tmp_path / "p.yaml", content)])
    assert "max_speed_mps" in settle(reading.findings).missing
    assert any("FollowPath.max_vel_x is $(var speed)" in note for note in reading.notes)


def test_a_controller_that_is_not_known_is_told(tmp_path: Path) -> None:
    content = parameters(ROBOT)
    controller(content)["plugin"] = "mine::Controller"
    reading = read_nav2([write(tmp_path / "p.yaml", content)])
    assert any(
        "FollowPath.plugin is Controller, whose numbers are not read" in note for note in reading.notes
    )
    assert math.isclose(settle(reading.findings).chosen["max_speed_mps"].value, ROBOT.max_speed_mps)
