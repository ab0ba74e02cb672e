"""Whole drives with faults: nothing that stands is hit, what is wrong is named, and nothing is named that is not."""

import pytest

from adrl.benchmarks.fault_drives import ROBOT_NAMES, SCENARIOS, fault_drives, params_of, table
from adrl.benchmarks.faults import FAULTS
from adrl.envs.randomization import PARAMS, nominal_params
from adrl.worlds import ROBOTS

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
    "base of half the acceleration": "base_weak",
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
    "base_weak",
}


@pytest.mark.integration
def test_a_part_of_the_drives_is_the_same_drives():
    """What is drawn in a drive hangs on the drive, not on those beside it."""
    faults = ["range noise of 3 cm", "scan lost, 10 %", "glass"]
    together = fault_drives(faults, robots=["diffbot"], scenarios=["clutter"], tasks=2)
    alone = [
        drive
        for fault in reversed(faults)
        for drive in fault_drives([fault], robots=["diffbot"], scenarios=["clutter"], first=1)
    ]
    assert [drive for drive in together if drive.task == 1] == alone[::-1]
    assert len({drive.time_s for drive in together}) > 3


def test_faults_of_the_base_change_what_they_name_and_nothing_else():
    robot = ROBOTS["jackal"]
    nominal = dict(zip(PARAMS, nominal_params(robot).tolist(), strict=True))
    lagging = nominal | {"lag_s": 3.0 * robot.lag_s}
    drifting = nominal | {"speed_drift": 0.05, "yaw_drift": -0.05}
    assert params_of(robot, FAULTS["base of thrice the lag"]).tolist() == list(lagging.values())
    assert params_of(robot, FAULTS["odometry drifts by 5 %"]).tolist() == list(drifting.values())
    for fault in FAULTS.values():
        params_of(robot, fault)


@pytest.mark.integration
@pytest.mark.parametrize("fault", NAMED)
def test_what_is_wrong_is_named_before_anything_is_hit(fault: str):
    (drive,) = fault_drives([fault], robots=["diffbot"], scenarios=["rooms"])
    assert NAMED[fault] in drive.reasons
    arrives = FAULTS[fault].drivable
    # Under noise a frozen scan is told late, maybe where there is no way on: one of six in docs/results/faults.md.
    may_stand = not arrives or fault == "scan frozen, new stamps and noise"
    assert drive.outcome in ({"arrived"} if arrives else set()) | ({"timeout"} if may_stand else set())


@pytest.mark.integration
@pytest.mark.parametrize("task", [6, 29, 37])
def test_a_policy_that_stands_by_itself_is_got_on(task: int):
    """The jackal's has to turn round between walls, and was trained among pillars: it stands until its time is up."""
    (drive,) = fault_drives(["none"], robots=["jackal"], scenarios=["rooms"], first=task)
    assert drive.outcome == "arrived"
    assert "recovering" in drive.reasons


@pytest.mark.integration
def test_a_base_that_brakes_half_as_hard_hits_nothing():
    """At 2 m/s between walls."""
    for drive in fault_drives(
        ["base of half the acceleration"], robots=["jackal"], scenarios=["rooms"], tasks=3, first=1
    ):
        assert "base_weak" in drive.reasons
        assert drive.outcome == "arrived"


@pytest.mark.integration
def test_an_arc_that_goes_blind_in_a_turn_is_told():
    """At 2 m/s and 2 rad/s between walls: what comes into view does not explain what has gone out of it."""
    (drive,) = fault_drives(["an arc of 60 deg inf for 2 s"], robots=["jackal"], scenarios=["rooms"])
    assert "scan_empty" in drive.reasons
    assert drive.outcome != "hit_standing"


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
    """Nor in the mild noise of any robot, moving discs about it included; each noise in one scenario, another for each
    robot. `adrl bench faults` drives all of them in all."""
    for number, scenario in enumerate(SCENARIOS, ROBOT_NAMES.index(robot)):
        for drive in fault_drives(
            HARMLESS[number % len(SCENARIOS) :: len(SCENARIOS)], robots=[robot], scenarios=[scenario]
        ):
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
