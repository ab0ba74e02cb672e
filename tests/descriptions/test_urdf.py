"""URDF: the LiDAR where its joints put it, the footprint around its shapes, and what cannot be used refused by name."""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl.descriptions import Reading, Standing, read_urdf, settle
from adrl.descriptions.outline import footprint_of
from adrl.errors import ConfigError
from adrl.geometry import compose
from adrl.types import outline
from adrl.worlds.sdf.footprint import Footprint
from urdf_files import joint, sensor, urdf, write

pytest.importorskip("yourdfpy")
MOUNT = ("lidar.mount_x_m", "lidar.mount_y_m", "lidar.mount_yaw_rad")


def values(reading: Reading) -> dict[str, Any]:
    settled = settle(reading.findings)
    assert settled.faults == ()
    return {name: finding.value for name, finding in settled.chosen.items()}


def read(tmp_path: Path, text: str, lidar: str | None = None) -> dict[str, Any]:
    return values(read_urdf(write(tmp_path / "cart.urdf", text), lidar))


@pytest.mark.parametrize("kind", ["ray", "gpu_ray", "lidar", "gpu_lidar"])
def test_all_of_a_cart_is_read(tmp_path: Path, kind: str) -> None:
    found = read(tmp_path, urdf(tags=sensor(kind=kind)))
    assert sorted(found["footprint_m"]) == [(-0.35, -0.2), (-0.35, 0.2), (0.15, -0.2), (0.15, 0.2)]
    assert [found[name] for name in MOUNT] == pytest.approx([0.25, 0.05, 0.0])
    assert (found["lidar.num_beams"], found["lidar.fov_rad"], found["lidar.max_range_m"]) == (271, 4.0, 12.0)
    assert (found["lidar.noise_std_m"], found["control_period_s"]) == (0.02, 0.05)
    assert (found["max_speed_mps"], found["min_speed_mps"], found["max_yaw_rate_radps"]) == (1.5, -0.5, 2.5)
    assert (found["max_acceleration_mps2"], found["max_yaw_acceleration_radps2"]) == (1.2, 3.5)
    assert (found["odom_frame"], found["base_frame"]) == ("odom", "base_link")


poses = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.1, 3.1))


@settings(max_examples=40, deadline=None)
@given(chain=st.lists(poses, min_size=1, max_size=4), upside_down=st.booleans(), middle=st.floats(-1.0, 1.0))
def test_a_lidar_is_where_its_chain_of_joints_puts_it(
    tmp_path_factory: pytest.TempPathFactory,
    chain: list[tuple[float, float, float]],
    upside_down: bool,
    middle: float,
) -> None:
    links, parent, expected = "", "base_link", (0.0, 0.0, 0.0)
    for number, (x, y, yaw) in enumerate(chain):
        links += joint(f"l{number}", parent, f"{x} {y} 0.1", f"0 0 {yaw}")
        parent, expected = f"l{number}", compose(expected, (x, y, yaw))
    links += joint("laser", parent, rpy=f"{math.pi if upside_down else 0.0} 0 0")
    text = urdf(laser=links, tags=sensor(first=middle - 1.0, last=middle + 1.0))
    found = read(tmp_path_factory.mktemp("urdf"), text)
    looks = expected[2] + (-middle if upside_down else middle)
    assert_allclose([found[name] for name in MOUNT[:2]], expected[:2], atol=1e-6)
    assert math.remainder(found[MOUNT[2]] - looks, 2.0 * math.pi) == pytest.approx(0.0, abs=2e-3)
    if abs(middle) > 0.01:  # what the nodes need: where the sensor's own x axis points
        assert math.remainder(found["sensor_yaw_rad"] - expected[2], 2.0 * math.pi) == pytest.approx(
            0.0, abs=1e-6
        )


def test_the_mount_is_in_the_robot_s_frame_by_other_sources(tmp_path: Path) -> None:
    path = write(tmp_path / "cart.urdf", urdf())
    found = values(read_urdf(path, base="plate"))
    assert [found[name] for name in MOUNT] == pytest.approx([0.2, 0.05, 0.0])
    assert found["base_frame"] == "plate"
    assert values(read_urdf(path, base="elsewhere"))["base_frame"] == "base_link"


def test_an_upside_down_lidar_is_told(tmp_path: Path) -> None:
    text = urdf(laser=joint("laser", "plate", rpy=f"{math.pi} 0 0"))
    reading = read_urdf(write(tmp_path / "cart.urdf", text))
    assert any("link laser, upside down" in note for note in reading.notes)


@pytest.mark.parametrize(
    ("beams", "first", "last", "fov", "yaw"),
    [
        (360, 0.0, 2.0 * math.pi - math.radians(1.0), 2.0 * math.pi, 0.0),
        (360, 0.0, 6.28, 6.28, 0.0),
        (360, -math.pi, math.pi, 2.0 * math.pi - 1e-6, 0.0),
        (181, 0.0, math.pi, math.pi, 0.5 * math.pi),
    ],
)
def test_a_scan_all_round_looks_ahead_and_another_to_its_middle(
    tmp_path: Path, beams: int, first: float, last: float, fov: float, yaw: float
) -> None:
    found = read(tmp_path, urdf(tags=sensor(beams=beams, first=first, last=last)))
    assert (found["lidar.num_beams"], found["lidar.fov_rad"]) == (beams, pytest.approx(fov, abs=1e-9))
    assert found["lidar.mount_yaw_rad"] == pytest.approx(yaw, abs=1e-6)


def test_the_pose_of_a_sensor_counts(tmp_path: Path) -> None:
    found = read(tmp_path, urdf(tags=sensor(more="<pose>0.1 0 0 0 0 0.5</pose>")))
    assert [found[name] for name in MOUNT] == pytest.approx([0.35, 0.05, 0.5])


def test_of_several_lidars_the_link_or_the_sensor_chooses(tmp_path: Path) -> None:
    rear = joint("rear", "base_link", "-0.3 0 0", "0 0 3.0")
    text = urdf(more=rear + sensor("rear", "back", beams=91))
    assert read(tmp_path, text, "rear")["lidar.num_beams"] == 91
    assert read(tmp_path, text, "front")["lidar.num_beams"] == 271


def test_a_link_that_nothing_marks_may_be_the_lidar(tmp_path: Path) -> None:
    found = read(tmp_path, urdf(tags=""), "laser")
    assert [found[name] for name in MOUNT] == pytest.approx([0.25, 0.05, 0.0])
    assert "lidar.num_beams" not in found


def test_a_sonar_is_no_lidar(tmp_path: Path) -> None:
    sonar = sensor("plate", "sonar", more='<plugin filename="libgazebo_ros_range.so" name="p"/>')
    assert read(tmp_path, urdf(more=sonar))["lidar.num_beams"] == 271


def test_a_limit_of_the_plugin_bounds_what_nav2_says(tmp_path: Path) -> None:
    reading = read_urdf(write(tmp_path / "cart.urdf", urdf()))
    said = Reading()
    said.add("max_speed_mps", 2.0, "nav2.yaml: max_vel_x")
    chosen = settle([*said.findings, *reading.findings]).chosen["max_speed_mps"]
    assert chosen.value == 1.5
    assert "within 2 of nav2.yaml" in chosen.place
    assert all(f.standing is Standing.LIMIT for f in reading.findings if f.field == "max_speed_mps")


def test_a_round_robot_is_a_disc_and_one_beside_its_origin_is_not(tmp_path: Path) -> None:
    barrel = '<cylinder radius="0.3" length="0.4"/>'
    assert read(tmp_path, urdf(body=barrel, at="0 0 0.2"))["radius_m"] == pytest.approx(0.3)
    corners = np.array(read(tmp_path, urdf(body=barrel, at="0.1 0 0.2"))["footprint_m"])
    assert 3 <= len(corners) <= 16
    assert_allclose(corners[:, 0].max(), 0.4, atol=0.01)


def test_what_is_high_above_the_robot_is_not_in_its_way(tmp_path: Path) -> None:
    mast = joint("mast", "base_link", "0 0 3.0").replace(
        '<link name="mast"/>',
        '<link name="mast"><collision><geometry><box size="4 4 0.1"/></geometry></collision></link>',
    )
    assert np.abs(read(tmp_path, urdf(more=mast))["footprint_m"]).max() < 0.4


@settings(max_examples=60, deadline=None)
@given(
    circles=st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 2, st.floats(0.05, 1.0)), max_size=4),
    points=st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 2), min_size=3, max_size=40),
)
def test_a_footprint_of_few_corners_holds_all_of_the_shapes(
    circles: list[tuple[float, float, float]], points: list[tuple[float, float]]
) -> None:
    parts = Footprint(circles=circles)
    parts.add_hull(np.array(points))
    try:
        shape = footprint_of(parts)
    except ConfigError:
        assert not circles
        return
    corners_of = [*parts.polygons, *(np.reshape(segment, (2, 2)) for segment in parts.segments)]
    spots = [tuple(spot) for corners in corners_of for spot in corners]
    spots += [*((x + r * math.cos(a), y + r * math.sin(a)) for x, y, r in circles for a in range(7))]
    if isinstance(shape, float):
        assert max(math.hypot(*spot) for spot in spots) <= shape + 2e-4
        return
    corners = outline(np.array(shape))
    edges = np.roll(corners, -1, axis=0) - corners
    for x, y in spots:
        away = edges[:, 0] * (y - corners[:, 1]) - edges[:, 1] * (x - corners[:, 0])
        assert (away / np.hypot(*edges.T)).min() > -5e-4


def test_a_mesh_that_is_not_there_leaves_the_footprint_to_be_asked_for(tmp_path: Path) -> None:
    mesh = '<mesh filename="package://cart_description/meshes/body.stl"/>'
    reading = read_urdf(write(tmp_path / "cart.urdf", urdf(body=mesh)))
    assert settle(reading.findings).missing[0] == "radius_m"
    assert any(
        "the mesh package://cart_description/meshes/body.stl of link base_link" in n for n in reading.notes
    )


def test_a_mesh_beside_the_urdf_is_read(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "body.stl").write_bytes(
        trimesh.creation.box((500.0, 400.0, 200.0)).export(file_type="stl")
    )
    mesh = '<mesh filename="package://cart_description/meshes/body.stl" scale="0.001 0.001 0.001"/>'
    corners = np.array(read(tmp_path, urdf(body=mesh))["footprint_m"])
    assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[-0.35, -0.2], [0.15, 0.2]], atol=0.012)


def test_a_long_chain_of_links_takes_no_time_and_too_long_a_one_is_refused(tmp_path: Path) -> None:
    links = [joint(f"l{i}", f"l{i - 1}" if i else "base_link", "0.001 0 0") for i in range(1100)]
    path = write(tmp_path / "cart.urdf", urdf(more="".join(links[:900])))
    begun_s = time.monotonic()
    assert values(read_urdf(path, "l899"))["lidar.mount_x_m"] == pytest.approx(0.9)
    assert time.monotonic() - begun_s < 10.0
    with pytest.raises(ConfigError, match="has 1105 links or joints; give a URDF of up to 1000"):
        read_urdf(write(path, urdf(more="".join(links))))


def lifted(more: str) -> str:
    return joint("laser", "head", "0.1 0 0") + joint("head", "plate", kind=more)


OTHER = '<gazebo><plugin filename="{}" name="p"/></gazebo>'
REFUSED: dict[str, tuple[str, str]] = {
    "no LiDAR": (urdf(tags=""), "has no LiDAR: .*give --lidar LINK, the link that is one: laser$"),
    "two LiDARs": (
        urdf(more=joint("rear", "base_link") + sensor("rear", "back")),
        "several LiDARs: front on laser and back on rear; .*: --lidar laser, or --lidar rear$",
    ),
    "two LiDARs on a link": (
        urdf(more=sensor("laser", "back")),
        "several LiDARs: .*: --lidar front, or --lidar back$",
    ),
    "a LiDAR of many planes": (
        urdf(tags=sensor(inside="<vertical><samples>16</samples></vertical>")),
        "sensor 'front' scans 16 planes",
    ),
    "a LiDAR on no link": (urdf(tags=sensor("mast")), "has a LiDAR on 'mast', which is no link"),
    "a LiDAR that is tilted": (
        urdf(laser=joint("laser", "plate", rpy="0 0.3 0")),
        "the LiDAR on laser is tilted by 17.2 degrees",
    ),
    "a LiDAR that turns": (urdf(laser=lifted("continuous")), "moves on the robot, by joint 'head_joint'"),
    "beams that are no number": (
        urdf(tags=sensor().replace("271", "many")),
        "scan/horizontal/samples> of .*sensor front is 'many'",
    ),
    "an omni-directional base": (
        urdf(drive=OTHER.format("libgazebo_ros_planar_move.so")),
        "libgazebo_ros_planar_move.so p: that is an omni-directional robot",
    ),
    "a holonomic base": (
        urdf(drive=OTHER.format("libHolonomicDrive.so")),
        "that is an omni-directional robot, .* set its y speeds to 0",
    ),
    "xacro": (
        urdf(body="<box size='${width} 1 1'/>"),
        "is a xacro file; run: xacro .*cart.urdf > robot.urdf",
    ),
    "SDF": ("<sdf version='1.7'><model name='m'/></sdf>", "is no URDF: it has <sdf> instead of <robot>"),
    "no XML": ("robot: cart", "is not well-formed XML"),
    "entities": ("<!DOCTYPE r [<!ENTITY a 'b'>]>" + urdf().partition("\n")[2], "has a DOCTYPE"),
    "a loop of joints": (
        urdf(
            more='<joint name="j" type="fixed"><parent link="laser"/><child link="base_footprint"/></joint>'
        ),
        "is no tree of links: .* hangs on itself",
    ),
    "a joint to nowhere": (
        urdf(more='<joint name="j" type="fixed"><parent link="mast"/><child link="laser"/></joint>'),
        "is no tree of links: a joint has mast, which is no link",
    ),
    "a link on two joints": (
        urdf(more='<joint name="j" type="fixed"><parent link="wheel"/><child link="laser"/></joint>'),
        "is no tree of links: laser hangs on several joints",
    ),
    "two roots": (urdf(more='<link name="mast"/>'), "base_footprint, mast hang on no joint, and one has to"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_used_is_refused_by_name(tmp_path: Path, name: str) -> None:
    text, message = REFUSED[name]
    with pytest.raises(ConfigError, match=message) as caught:
        read_urdf(write(tmp_path / "cart.urdf", text))
    assert str(tmp_path / "cart.urdf") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_link_that_is_not_there_is_refused_with_those_that_are(tmp_path: Path) -> None:
    path = write(tmp_path / "cart.urdf", urdf())
    with pytest.raises(
        ConfigError, match="has no link 'mast'; it has base_footprint, base_link, plate, laser"
    ):
        read_urdf(path, "mast")


STEERED = (
    '<gazebo><plugin filename="gz-sim-ackermann-steering-system" name="gz::sim::systems::AckermannSteering">'
    "<wheel_base>0.5</wheel_base>{}<max_velocity>1.4</max_velocity><min_velocity>-0.4</min_velocity></plugin></gazebo>"
)


def test_a_car_has_the_tightest_curve_of_its_steering(tmp_path: Path) -> None:
    found = read(tmp_path, urdf(drive=STEERED.format("<steering_limit>0.5</steering_limit>")))
    assert found["min_turning_radius_m"] == pytest.approx(0.5 / math.tan(0.5))
    assert (found["max_speed_mps"], found["min_speed_mps"]) == (1.4, -0.4)


@pytest.mark.parametrize("drive", [STEERED.format(""), OTHER.format("libgazebo_ros_ackermann_drive.so")])
def test_a_car_whose_steering_is_not_told_is_asked_for_its_curve(tmp_path: Path, drive: str) -> None:
    reading = read_urdf(write(tmp_path / "cart.urdf", urdf(drive=drive)))
    assert "min_turning_radius_m" in settle(reading.findings).missing
