"""Fitting the base: constants that made the drives are found again, and bad files are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adrl.envs import NavSim
from adrl.errors import DatasetError
from adrl.evaluation.calibration import calibrate
from adrl.evaluation.drives import COLUMNS, DriveRecorder, Drives, read_drives
from adrl.types import RobotConfig, Task, World
from adrl.worlds import load_robot
from adrl.worlds.robot_files import robot_toml

OPEN = World(bounds=(-50.0, -50.0, 50.0, 50.0))


def driven(robot: RobotConfig, periods: int = 150, robots: int = 6) -> Drives:
    """Random commands, held for a while, in an empty world."""
    task = Task(
        world=OPEN,
        start=(0.0, 0.0, 0.0),
        goal=(40.0, 0.0),
        path=np.array([(0.0, 0.0), (40.0, 0.0)]),
        shortest_m=40.0,
        time_limit_s=1e3,
    )
    sim = NavSim(robots, robot)
    rng = np.random.default_rng(5)
    sim.reset(np.arange(robots), [task] * robots, np.zeros(robots, np.uint64), rng)
    record = DriveRecorder()
    held = np.repeat(rng.uniform(-1.0, 1.0, (periods // 4 + 1, robots, 2)), 4, axis=0)
    for actions in held[:periods].astype(np.float32):
        sim.step(actions)
        record(sim, np.arange(robots), np.ones(robots, bool))
    return record.drives()


@pytest.mark.parametrize(
    "true",
    [
        dict(lag_s=0.12, latency_s=0.0, max_acceleration_mps2=1.0, max_yaw_acceleration_radps2=3.0),
        dict(lag_s=0.03, latency_s=0.15, max_acceleration_mps2=3.0, max_yaw_acceleration_radps2=9.0),
    ],
)
def test_the_constants_that_drove_are_found(true: dict[str, float]) -> None:
    nominal = load_robot("diffbot")
    fit = calibrate(driven(replace(nominal, **true)), nominal)
    assert (fit.error_after < 0.2 * fit.error_before).all()
    assert fit.robot.latency_s == pytest.approx(true["latency_s"], abs=0.01)
    assert fit.robot.lag_s == pytest.approx(true["lag_s"], abs=0.01)
    for name in ("max_acceleration_mps2", "max_yaw_acceleration_radps2"):
        assert getattr(fit.robot, name) == pytest.approx(true[name], rel=0.05)


def test_those_of_a_car_are_found() -> None:
    """Its yaw rate is held back by its speed, which is no weakness of its base."""
    nominal = replace(load_robot("diffbot"), min_speed_mps=-0.6, min_turning_radius_m=0.5)
    true = dict(lag_s=0.12, max_acceleration_mps2=1.0, max_yaw_acceleration_radps2=3.0)
    fit = calibrate(driven(replace(nominal, **true)), nominal)
    assert (fit.error_after < 0.3 * fit.error_before).all()
    for name, value in true.items():
        assert getattr(fit.robot, name) == pytest.approx(value, rel=0.1)


def test_drives_survive_a_file(tmp_path: Path) -> None:
    drives = driven(load_robot("diffbot"), periods=12, robots=2)
    drives.save(tmp_path / "d.csv")
    again = read_drives(tmp_path / "d.csv")
    np.testing.assert_array_equal(again.drive, drives.drive)
    np.testing.assert_allclose(again.twist, drives.twist, rtol=1e-5)
    np.testing.assert_allclose(again.tracking_error(), drives.tracking_error(), rtol=1e-4)


def test_a_fitted_robot_survives_its_file(tmp_path: Path) -> None:
    for name in ("jackal", "turtlebot3_burger"):
        robot = replace(load_robot(name), lag_s=0.123)
        (tmp_path / "r.toml").write_text(robot_toml(robot))
        assert load_robot(tmp_path / "r.toml") == robot


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no row"),
        ("a,b\n1,2\n", "columns"),
        (",".join(COLUMNS) + "\n", "no row"),
        (",".join(COLUMNS) + "\n0,0.1,x,0,0,0\n", "numbers"),
        (",".join(COLUMNS) + "\n0,0.1,nan,0,0,0\n", "row 1: command_mps is nan; give a finite"),
        (",".join(COLUMNS) + "\n0,0.1,0,0,0,0\n0,0.2,0,1e300,0,0\n", "row 2: command_radps is 1e.300"),
        (",".join(COLUMNS) + "\n0,0.1,0,0\n", "row 1: speed_mps is None; numbers"),
        (",".join(COLUMNS) + '\n0,0.1,0,"' + 200_000 * "9" + '",0,0\n', "field larger"),
    ],
)
def test_a_bad_file_is_named(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(DatasetError, match=f"bad.csv.*{says}"):
        read_drives(tmp_path / "bad.csv")
    with pytest.raises(DatasetError, match=r"gone.csv: no such file"):
        read_drives(tmp_path / "gone.csv")


def test_rows_of_another_robots_period_are_refused() -> None:
    drives = driven(load_robot("diffbot"))
    with pytest.raises(DatasetError, match="resample"):
        calibrate(drives, replace(load_robot("diffbot"), control_period_s=0.05))
    few = Drives(drives.drive[:20], drives.time_s[:20], drives.command[:20], drives.twist[:20])
    with pytest.raises(DatasetError, match="too few"):
        calibrate(few, load_robot("diffbot"))
