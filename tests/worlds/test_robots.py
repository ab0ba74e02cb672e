"""Robots: the registry, and TOML files as a second way to write the same dataclass."""

import dataclasses
import json
import math
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import registry
from adrl.errors import ConfigError, UnknownName
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds import ROBOTS, load_robot, robot_from_fields

ALL_ROBOTS = pytest.mark.parametrize("name", ROBOTS)
POSITIVE = st.floats(0.05, 5.0)


@ALL_ROBOTS
def test_a_robot_is_found_by_its_own_name(name: str) -> None:
    assert load_robot(name) is ROBOTS[name]
    assert ROBOTS[name].name == name


@ALL_ROBOTS
def test_the_lidar_sits_inside_the_footprint(name: str) -> None:
    robot = ROBOTS[name]
    mount = np.array([robot.lidar.mount_x_m, robot.lidar.mount_y_m])
    corners = robot.polygon
    if len(corners) == 0:
        assert np.hypot(*mount) < robot.circumscribed_radius_m
        return
    edges = np.roll(corners, -1, axis=0) - corners
    to_mount = mount - corners
    assert (edges[:, 0] * to_mount[:, 1] - edges[:, 1] * to_mount[:, 0] > 0.0).all()


@ALL_ROBOTS
def test_a_robot_stops_within_what_its_lidar_sees(name: str) -> None:
    robot = ROBOTS[name]
    braking_m = robot.max_speed_mps**2 / (2.0 * robot.max_acceleration_mps2)
    assert braking_m + robot.circumscribed_radius_m < robot.lidar.max_range_m


def as_toml(robot: RobotConfig) -> str:
    lines = []
    for key, value in dataclasses.asdict(robot).items():
        if key == "lidar" or value is None:
            continue
        text = f'"{value}"' if isinstance(value, str) else str(value).replace("(", "[").replace(")", "]")
        lines.append(f"{key} = {text}")
    lines.append("[lidar]")
    lines += [f"{key} = {value}" for key, value in dataclasses.asdict(robot.lidar).items()]
    return "\n".join(lines)


@given(
    radius=POSITIVE,
    speed=POSITIVE,
    acceleration=POSITIVE,
    beams=st.integers(1, 2048),
    fov=st.floats(0.1, 2 * math.pi),
    max_range=POSITIVE,
    polygon=st.booleans(),
)
def test_a_robot_written_as_toml_reads_back_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    radius: float,
    speed: float,
    acceleration: float,
    beams: int,
    fov: float,
    max_range: float,
    polygon: bool,
) -> None:
    square = ((radius, radius), (-radius, radius), (-radius, -radius), (radius, -radius))
    robot = RobotConfig(
        name="mine",
        radius_m=None if polygon else radius,
        footprint_m=square if polygon else None,
        max_speed_mps=speed,
        max_acceleration_mps2=acceleration,
        lidar=LidarConfig(num_beams=beams, fov_rad=fov, max_range_m=max_range),
    )
    path = tmp_path_factory.mktemp("robot") / "other.toml"
    path.write_text(as_toml(robot))
    assert load_robot(path) == load_robot(str(path)) == robot
    assert robot_from_fields(json.loads(json.dumps(dataclasses.asdict(robot)))) == robot


@pytest.mark.parametrize("said", [6.28319, 6.283186, 6.283185, 6.2831853, 2.0 * math.pi])
def test_a_full_circle_may_be_said_in_six_digits_or_more(said: float) -> None:
    lidar = LidarConfig(num_beams=360, fov_rad=said)
    assert lidar.fov_rad == 2.0 * math.pi
    assert lidar.angle_increment_rad == 2.0 * math.pi / 360


def test_more_than_a_full_circle_is_refused_and_a_little_less_repeats_its_first_beam() -> None:
    with pytest.raises(ConfigError, match=r"lidar.fov_rad is 6.2832; give 0.001 to 6.28319"):
        LidarConfig(fov_rad=6.2832)
    fov = 2.0 * math.pi - 1e-6
    assert LidarConfig(num_beams=360, fov_rad=fov).angle_increment_rad == fov / 359


def test_what_a_file_leaves_out_keeps_its_default(tmp_path: Path) -> None:
    path = tmp_path / "carrier.toml"
    path.write_text("max_speed_mps = 1\n")
    assert load_robot(path) == RobotConfig(name="carrier", max_speed_mps=1.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("max_sped_mps = 1.0", "'max_speed_mps'"),
        ("[lidar]\nbeams = 90", "'lidar.beams'"),
        ("[lidar]\nnum_beam = 90", "did you mean 'num_beams'"),
        ("[lidar]\nnum_beams = 0", "lidar.num_beams is 0; give 1 to 2048, a whole number"),
        ("[lidar]\nmax_range_m = 1e9", "lidar.max_range_m is 1000000000.0; give 0.05 to 1000"),
        ("control_period_s = 1e-9", "control_period_s is 1e-09; give 0.005 to 2"),
        ("max_speed_mps = 1" + "0" * 5000, "max_speed_mps is inf; give 0.01 to 50"),
        ("min_speed_mps = -1" + "0" * 5000, "min_speed_mps is -inf; give -50 to 0"),
        ("[lidar]\nnum_beams = 1" + "0" * 5000, "lidar.num_beams is inf; give 1 to 2048"),
        ("x = [" + "0, " * 30_000 + "]", "larger than 0.0625 MiB"),
        ("[lidar]\nnum_beams = 90.5", "whole number"),
        ("[lidar]\nmax_range_m = nan", "lidar.max_range_m"),
        ("lidar = 3", "[lidar]"),
        ("max_speed_mps = nan", "max_speed_mps"),
        ("max_speed_mps = inf", "max_speed_mps"),
        ("max_speed_mps = true", "max_speed_mps"),
        ("max_speed_mps = '1'", "max_speed_mps"),
        ("max_speed_mps = 1" + "0" * 400, "max_speed_mps"),
        ("max_speed_mps = -1", "max_speed_mps"),
        ("name = 3", "name"),
        ("radius_m = 'wide'", "radius_m"),
        ("radius_m = 0.2\nfootprint_m = [[1, 0], [0, 1], [-1, 0]]", "not both"),
        (
            "footprint_m = [[0, 0], [1, 0], [1, 1], [0.4, 0.5], [0, 1]]",
            "not convex: it bends inwards at (0.4, 0.5)",
        ),
        ("footprint_m = [[0, 0], [1, 0], [2, 0]]", "give 3 to 16"),
        ("footprint_m = [[0, 0], [1, 0], [0, 200]]", "beyond -10 to 10 m"),
        ("footprint_m = [[1, 0], [-0.8, 0.6], [0.3, -0.95], [0.3, 0.95], [-0.8, -0.6]]", "crosses itself"),
        (f"footprint_m = {[[math.cos(k * 0.37), math.sin(k * 0.37)] for k in range(17)]}", "has 17 corners"),
        ("footprint_m = [[0, 0], [1]]", "corners"),
        ("footprint_m = 4", "corners"),
        ("footprint_m = [[0, nan], [1, 0], [0, 1]]", "footprint_m"),
        ("max_speed_mps = ", "not valid TOML"),
        ("footprint_m = " + "[" * 5000, "not valid TOML"),
    ],
)
def test_a_bad_file_is_named_with_its_fault(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    assert str(path) in str(caught.value)
    assert says in str(caught.value)


def test_a_missing_or_binary_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        load_robot(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_robot(tmp_path / "binary.toml")
    for path in (tmp_path, Path("/dev/zero")):
        with pytest.raises(ConfigError, match="no ordinary file"):
            load_robot(path)


@given(
    angles=st.lists(st.integers(0, 59), min_size=3, max_size=16, unique=True),
    first=st.integers(0, 15),
    clockwise=st.booleans(),
    doubled=st.booleans(),
    between=st.floats(0.1, 0.9),
)
def test_corners_either_way_round_from_any_of_them_are_one_footprint(
    angles: list[int], first: int, clockwise: bool, doubled: bool, between: float
) -> None:
    corners = [(math.cos(a * math.pi / 30), math.sin(a * math.pi / 30)) for a in sorted(angles)]
    given = corners[first % len(corners) :] + corners[: first % len(corners)]
    given = given[::-1] if clockwise else given
    if doubled:  # a closed ring, and a corner on a straight edge
        middle = tuple(between * a + (1.0 - between) * b for a, b in zip(given[0], given[-1], strict=True))
        given = [*given, middle, given[0]]
    kept = RobotConfig(radius_m=None, footprint_m=given).footprint_m  # pyright: ignore
    assert kept is not None
    turn = corners.index(kept[0])
    assert list(kept) == corners[turn:] + corners[:turn]


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(UnknownName, match="did you mean 'turtlebot3_burger'"):
        load_robot("turtlebot3_burgr")


MINE = RobotConfig(name="mine", radius_m=0.3)
NOT_A_ROBOT = 7


def test_installed_packages_offer_robots_by_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    offered = [
        EntryPoint(name="mine", value=f"{__name__}:MINE", group="adrl.robots"),
        EntryPoint(name="odd", value=f"{__name__}:NOT_A_ROBOT", group="adrl.robots"),
        EntryPoint(name="jackal", value=f"{__name__}:MINE", group="adrl.robots"),
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: offered if group == "adrl.robots" else [])
    monkeypatch.setattr(EntryPoint, "load", lambda point: globals()[point.value.rpartition(":")[2]])
    assert load_robot("mine") is MINE
    assert load_robot("jackal") is ROBOTS["jackal"]
    with pytest.raises(ConfigError, match="not a RobotConfig"):
        load_robot("odd")
    with pytest.raises(UnknownName, match="did you mean 'mine'"):
        load_robot("mines")
