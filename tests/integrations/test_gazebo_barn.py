"""BARN in Gazebo: what stands where, what drives, what is drawn, and what is kept."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest

from adrl import _core
from adrl.cli import main
from adrl.envs import NavSim
from adrl.errors import ConfigError, WorldError
from adrl.geometry import compose
from adrl.integrations.gazebo import Gazebo
from adrl.integrations.gazebo.published import Published
from adrl.integrations.gazebo.server import is_installed
from adrl.integrations.gazebo.skid_steer import JACKAL, SkidSteer, cold_jackals, skid_steered_model
from adrl.observation import to_action
from adrl.worlds import BarnScenario, load_robot
from adrl.worlds.barn import START, BarnWorld

ROBOT = load_robot("jackal")
QUIET = replace(ROBOT, lidar=replace(ROBOT.lidar, noise_std_m=0.0))


@pytest.fixture(scope="module")
def folder(barn: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two of the worlds: all take seconds to read."""
    folder = tmp_path_factory.mktemp("barn")
    for file in sorted((barn / "worlds").glob("*.world"))[:2]:
        shutil.copy(file, folder)
        shutil.copy(barn / "paths" / f"path_{file.stem.removeprefix('world_')}.npy", folder)
    return folder


@pytest.fixture(scope="module")
def scenario(folder: Path) -> BarnScenario:
    return BarnScenario(folder)


@pytest.fixture
def world(scenario: BarnScenario) -> BarnWorld:
    return scenario.worlds[0]


def published(world: BarnWorld, base: SkidSteer = JACKAL) -> Published:
    assert world.file is not None
    return Published(file=world.file, world=world.world, base=base, start=START)


def numbers(element: Element, path: str) -> list[float]:
    return [float(word) for word in element.findtext(path, "").split()]


def cylinders(world: Element) -> list[tuple[float, ...]]:
    """x, y and radius of the models that are cylinders, read as plainly as can be."""
    return sorted(
        (*numbers(model, "pose")[:2], *numbers(model, "link/collision/geometry/cylinder/radius"))
        for model in world.iterfind("model")
        if model.find("link/collision/geometry/cylinder") is not None
    )


def gathered(world: Element) -> list[tuple[float, ...]]:
    """The same of the one model that they are in Gazebo."""
    return sorted(
        (*numbers(body, "pose")[:2], *numbers(body, "geometry/cylinder/radius"))
        for body in world.iterfind("model[@name='standing']/link/collision")
        if body.find("geometry/cylinder") is not None
    )


def test_a_published_world_is_opened_with_all_its_cylinders_where_the_file_says(
    scenario: BarnScenario,
) -> None:
    for world in scenario.worlds:
        assert world.file is not None
        file = ElementTree.parse(world.file).getroot().find("world")
        opened = published(world).with_robot(ROBOT, Element("plugin", name="p", filename="f")).find("world")
        assert file is not None
        assert opened is not None
        stand = gathered(opened)
        assert stand == cylinders(file)
        assert len(stand) >= 160
        np.testing.assert_allclose(stand, sorted(map(tuple, world.world.circles)), atol=1e-9)
        assert opened.find("state") is None
        assert [model.get("name") for model in opened.iterfind("model")].count("robot_0") == 1


def test_the_physics_are_those_of_the_file(world: BarnWorld, tmp_path: Path) -> None:
    assert published(world).step_s == 0.001
    file = tmp_path / "world_1.world"
    file.write_text(
        "<sdf version='1.6'><world name='default'><physics type='ode'><max_step_size>0.002</max_step_size></physics>"
        "</world></sdf>"
    )
    assert Published(file=file, world=world.world, base=JACKAL, start=START).step_s == 0.002


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("<world><plugin filename='x.so' name='x'/></world>", "has a <plugin>"),
        ("<world><include><uri>model://sun</uri></include></world>", "has a <include>"),
        ("<model name='m'/>", "has no <world>"),
    ],
)
def test_a_file_brings_no_code_along(world: BarnWorld, tmp_path: Path, content: str, says: str) -> None:
    file = tmp_path / "world_1.world"
    file.write_text(f"<sdf version='1.6'>{content}</sdf>")
    with pytest.raises(WorldError, match=rf"{file.name}.* {says}"):
        Published(file=file, world=world.world, base=JACKAL, start=START)


@pytest.mark.parametrize("base", [JACKAL, *cold_jackals()], ids=lambda base: base.name)
def test_four_wheels_are_driven_stand_on_the_ground_and_carry_the_mass(base: SkidSteer) -> None:
    model = skid_steered_model(ROBOT, base, "robot_0", (0.0, 0.0, 0.0))
    joints = {joint.get("name"): joint for joint in model.iterfind("joint")}
    assert sorted(map(str, joints)) == ["left_front", "left_rear", "right_front", "right_rear"]
    for name, joint in joints.items():
        link = model.find(f"link[@name='{joint.findtext('child')}']")
        assert link is not None
        x, y, z = numbers(link, "pose")[:3]
        assert numbers(joint, "axis/xyz") == [0.0, 1.0, 0.0]
        assert (x > 0.0) == str(name).endswith("front")
        assert (y > 0.0) == str(name).startswith("left")
        assert numbers(link, "collision/geometry/cylinder/radius") == [z]
        assert numbers(link, "collision/surface/friction/ode/mu") == [base.friction]
        # The tyre is inside the footprint, which is what a collision is counted by.
        reach = np.array([[x + z, y + 0.5 * base.wheel_width_m], [x - z, y - 0.5 * base.wheel_width_m]])
        assert ROBOT.covers(reach).all()
    masses = [float(mass.text or "") for mass in model.iter("mass")]
    assert sum(masses) == pytest.approx(base.mass_kg)


def test_the_jackal_weighs_what_its_makers_say_and_sees_from_where_its_config_has_the_lidar() -> None:
    assert JACKAL.mass_kg == pytest.approx(18.431)
    model = skid_steered_model(ROBOT, JACKAL, "robot_0", (0.0, 0.0, 0.0))
    link = model.find("link[@name='base']")
    assert link is not None
    assert numbers(link, "sensor/pose")[:2] == [ROBOT.lidar.mount_x_m, ROBOT.lidar.mount_y_m]
    sensor_z = numbers(link, "sensor/pose")[2]
    assert JACKAL.top_m < sensor_z < 0.5  # above its own body, below the top of a cylinder


def test_the_twelve_jackals_are_the_same_for_ever_and_all_differ_within_their_ranges() -> None:
    drawn = cold_jackals()
    assert drawn == cold_jackals()
    assert len(set(drawn)) == 12
    for one in drawn:
        assert abs(one.left_radius_m / JACKAL.left_radius_m - 1.0) <= 1.05 * 1.015 - 1.0 + 1e-12
        assert abs(one.left_radius_m / one.right_radius_m - 1.0) <= 0.031
        assert 0.9 <= one.chassis_kg / JACKAL.chassis_kg <= 1.4
        assert 0.35 <= one.friction <= 0.9
        assert 0.0 <= one.latency_s <= 0.1
        assert max(abs(one.mount_x_m), abs(one.mount_y_m)) <= 0.02
        assert abs(one.mount_yaw_rad) <= np.radians(2.0)
    # The controller of each takes the wheels to be the Jackal's as made.
    assert {one.controller(ROBOT)["radius"] for one in drawn} == {(JACKAL.left_radius_m,)}


@pytest.mark.parametrize("there", ["nothing", "an empty folder", "no world"])
def test_a_folder_without_worlds_is_a_typed_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], there: str
) -> None:
    folder = tmp_path / "worlds"
    if there != "nothing":
        folder.mkdir()
    if there == "no world":
        (folder / "path_1.npy").touch()
    assert main(["gazebo", "barn", "--worlds", str(folder)]) == 2
    assert f"folder {folder} holds no world_N.world" in capsys.readouterr().err


def require_gazebo() -> None:
    if not is_installed() and os.environ.get("CI") != "true":
        pytest.skip("Gazebo is not set up; run scripts/gazebo-chroot")


@pytest.mark.gazebo
def test_in_a_published_world_the_jackal_sees_the_cylinders_turns_by_skidding_and_hits_them(
    scenario: BarnScenario, world: BarnWorld
) -> None:
    require_gazebo()
    task = scenario.task_in(world, QUIET)

    def begin(sim: NavSim) -> None:
        sim.reset(np.arange(1), [task], np.zeros(1, np.uint64), np.random.default_rng(0))

    def drive(sim: NavSim, speed: float, yaw_rate: float, periods: int) -> None:
        for _ in range(periods):
            sim.step(to_action(np.array([(speed, yaw_rate)]), QUIET))

    with Gazebo(QUIET, published=published(world)) as gazebo:
        sim = NavSim(1, QUIET, body=gazebo)
        begin(sim)
        drive(sim, 0.0, 0.0, 2)
        eye = np.array([compose(tuple(sim.b["pose"][0]), QUIET.lidar.mount)])
        seen = _core.raycast(world.world.native, eye, QUIET.lidar.angles_rad, 30.0)
        assert (np.abs(seen - sim.b["ranges"]) < 0.05).mean() > 0.97
        drive(sim, 1.0, 0.0, 10)
        assert 0.8 < sim.b["pose"][0, 1] - task.start[1] < 1.1
        assert abs(sim.b["pose"][0, 0] - task.start[0]) < 0.05
        assert not sim.b["collided"][0]
        begin(sim)
        drive(sim, 0.0, 1.0, 15)
        turned = sim.b["pose"][0, 2] - task.start[2]
        assert 0.5 < turned < 2.5
        # Heading is the IMU's: what the wheels tell of a skid is another number.
        assert sim.b["odometry"][0, 2] == pytest.approx(sim.b["pose"][0, 2], abs=0.03)
        # It turns about a point between its axles.
        assert np.hypot(*(sim.b["pose"][0, :2] - task.start[:2])) < JACKAL.wheelbase_m
        drive(sim, 1.0, 0.0, 40)
        assert sim.b["collided"][0]
        other = replace(task, world=replace(world.world, circles=world.world.circles[:5]))
        with pytest.raises(ConfigError, match="one world"):
            sim.reset(np.arange(1), [other], np.zeros(1, np.uint64), np.random.default_rng(0))


def test_other_worlds_of_the_same_numbers_are_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nor other physics, nor other ones held out; the same files elsewhere are the same worlds."""

    def stop(*_: object, **__: object) -> None:
        raise ConfigError("it drives")

    monkeypatch.setattr("adrl.commands.gazebo_barn.Gazebo", stop)

    def two_worlds(name: str, pose: str = "-4 8 0.5 0 0 0", physics: str = "") -> Path:
        """Of a cylinder each."""
        made = tmp_path / name
        made.mkdir()
        for number in (1, 2):
            (made / f"world_{number}.world").write_text(
                f"<sdf version='1.6'><world name='default'>{physics}<model name='m'><static>1</static>"
                f"<pose>{pose}</pose><link name='link'><collision name='c'><geometry><cylinder><radius>0.075</radius>"
                "<length>1</length></cylinder></geometry></collision></link></model></world></sdf>"
            )
            np.save(made / f"path_{number}.npy", np.array([(15, 0), (15, 29)]))
        return made

    def says(worlds: Path, *more: str) -> str:
        command = ["gazebo", "barn", "--worlds", str(worlds), "--out", str(tmp_path / "out"), *more]
        assert main(command) == 2
        return " ".join(capsys.readouterr().err.split())

    begun = two_worlds("begun")
    assert "it drives" in says(begun)
    assert "it drives" in says(two_worlds("copy"))
    moved = two_worlds("moved", pose="-4 9 0.5 0 0 0")
    slower = two_worlds(
        "slower", physics="<physics type='ode'><max_step_size>0.002</max_step_size></physics>"
    )
    refused = "other settings (worlds); give another folder, or go on as it was begun"
    assert refused in says(moved)
    assert refused in says(slower)
    assert refused in says(begun, "--held-out", "1")


@pytest.mark.gazebo
@pytest.mark.slow
def test_a_stopped_benchmark_goes_on_and_does_not_mix_settings(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_gazebo()
    out = tmp_path / "out"
    command = ["gazebo", "barn", "--worlds", str(folder), "--trials", "1", "--out", str(out)]
    assert main(command) == 0
    first: dict[str, Any] = json.loads((out / "summary.json").read_text())
    assert [jackal["name"] for jackal in first["jackals"]] == ["jackal"]
    assert first["jackals"][0]["worlds"] == 2

    def no_start(*_: object, **__: object) -> None:
        raise AssertionError("Gazebo was started for runs that are there")

    monkeypatch.setattr("adrl.commands.gazebo_barn.Gazebo", no_start)
    assert main(command) == 0
    assert json.loads((out / "summary.json").read_text()) == first
    assert main([*command, "--seed", "1"]) == 2
