"""Whole drives with faults: nothing that stands is hit, what is wrong is named, and nothing is named that is not."""

import pytest

from adrl.benchmarks.fault_drives import ROBOT_NAMES, SCENARIOS, fault_drives, table
from adrl.benchmarks.faults import FAULTS

NAMED = {
    "scan late by 2, unsaid": "scan_late",
    "scan frozen, new stamps": "scan_frozen",
    "scan frozen, new stamps and noise": "scan_frozen",
    "all beams inf for 2 s": "scan_empty",
    "half the beams inf for 2 s": "scan_empty",
    "mounted backwards": "mount",
    "mounted to the left": "mount",
    "mounted upside down": "mount",
    "odometry late by 2, unsaid": "odometry_late",
    "twist always 0": "odometry_contradicts",
    "twist in the odometry's frame": "odometry_contradicts",
    "commands late by 2": "base_late",
}
HARMLESS = (
    "none",
    "scan lost, 10 %",
    "beams inf, 10 %",
    "range noise of 3 cm",
    "odometry lost, 10 %",
    "odometry drifts by 5 %",
    "odometry jitters by 5 mm",
    "localisation noisy by 5 cm and 1 deg",
    "twist noisy by 5 cm/s",
    "base 10 % fast",
    "base 10 % slow",
)
ALARMS = {
    "scan_late",
    "scan_frozen",
    "scan_empty",
    "mount",
    "odometry_late",
    "odometry_contradicts",
    "base_late",
}


@pytest.mark.integration
@pytest.mark.parametrize("fault", NAMED)
def test_what_is_wrong_is_named_before_anything_is_hit(fault: str):
    (drive,) = fault_drives([fault], robots=["diffbot"], scenarios=["rooms"])
    assert NAMED[fault] in drive.reasons
    assert drive.outcome == ("arrived" if FAULTS[fault].drivable else "timeout")


@pytest.mark.integration
def test_a_lidar_mounted_otherwise_is_told_before_anything_is_hit():
    """Something stands half a metre ahead: a robot that suspects its mount goes slowly."""
    faults = [name for name in FAULTS if name.startswith("mounted")]
    for drive in fault_drives(faults, robots=["diffbot"], scenarios=["clutter"], tasks=2):
        assert drive.outcome == "timeout", drive


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("robot", ROBOT_NAMES)
def test_what_is_well_is_not_accused(robot: str):
    """Nor in the mild noise of any robot, moving discs about it included."""
    for drive in fault_drives(HARMLESS, robots=[robot], scenarios=SCENARIOS):
        assert ALARMS.isdisjoint(drive.reasons), drive
        assert drive.outcome in ("arrived", "hit_moving"), drive


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("robot", ROBOT_NAMES)
def test_nothing_that_stands_is_hit(robot: str):
    told = [name for name, fault in FAULTS.items() if fault.told and fault.drivable]
    rows = table(fault_drives(told, robots=[robot], scenarios=["clutter"]))
    assert sum(row["hit_standing"] for row in rows) == 0
    assert sum(row["timeout"] for row in rows) <= 0.05 * sum(row["drives"] for row in rows)
