"""Our nodes where Nav2 expects its own: real processes, real DDS, a client that does as its behaviour tree does."""

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from adrl.geometry import compose, inverse
from adrl.worlds import SCENARIOS, load_robot, task_set
from integrations.conftest import require_ros2
from integrations.ros_processes import Event, Probe, Ros, is_at_speed, is_idle, stands_from
from waiting import wait_until

pytestmark = [pytest.mark.ros, pytest.mark.realtime, pytest.mark.slow, pytest.mark.integration]

SOURCE = Path(__file__).resolve().parents[2]
CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, SHUTDOWN = 1, 2, 3, 4, 6
"""lifecycle_msgs/Transition."""
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
"""action_msgs/GoalStatus."""
TASK = task_set(SCENARIOS["complex"], load_robot("diffbot"), "test", 1)[0]
assert TASK.path is not None
PATH = TASK.path.tolist()


@pytest.fixture
def ros2(tmp_path: Path) -> Iterator[Ros]:
    running = Ros(2, require_ros2(), tmp_path)
    yield running
    running.close()


def nav2_probe(ros: Ros) -> Probe:
    command = [str(ros.python), str(Path(__file__).parent / "nav2_probe.py")]
    probe = Probe(command, ros.environment, ros.folder / "nav2_probe.log")
    ros.started.append(probe)
    return probe


def change(probe: Probe, transition: int) -> int:
    """Have the controller change its state. Returns the number of the event that says so."""
    at = probe.wait(lambda e: e["topic"] == "changed", probe.order(change=transition))
    assert probe.events[at]["success"]
    return at


def active(ros: Ros) -> Probe:
    """Has the controller activated, once there is a robot."""
    probe = nav2_probe(ros)
    probe.wait(lambda e: e["topic"] == "odom")
    change(probe, CONFIGURE)
    change(probe, ACTIVATE)
    return probe


def ready(probe: Probe, **here: Any) -> Probe:
    """Once the node hears scans, odometry and transforms, each by a connection of its own.

    here: the goal where the robot stands, which ends at once then.
    """
    here = here or {"follow": [TASK.start[:2]], "yaw": TASK.start[2]}
    wait_until(lambda: ended(probe, probe.order(**here))["status"] == SUCCEEDED, 60.0)
    return probe


def with_controller(ros: Ros, *options: str, speed: str = "2") -> Probe:
    """Simulator and active controller."""
    ros.node("sim", "--scenario", "complex", "--speed", speed, "--tf")
    ros.node("controller", "--robot", "diffbot", *options)
    return ready(active(ros))


def ended(probe: Probe, first: int, timeout_s: float = 90.0) -> Event:
    return probe.events[probe.wait(lambda e: e["topic"] == "ended", first, timeout_s=timeout_s)]


def stands_in_two_periods(probe: Probe, first: int) -> None:
    """Of the commands after an event two at most are not zero, and then zero stays; the robot comes to rest."""
    stands_from(probe, first, 2 + 1 + 6)
    told = [bool(event["v"] or event["w"]) for event in probe.of("cmd_vel")]
    after = told[len(told) - len(probe.of("cmd_vel", first)) :]
    assert not told[-1]
    assert sum(after) <= 2
    assert not any(after[sum(after) :])


def under_way(probe: Probe, path: list[list[float]] = PATH) -> int:
    taken = probe.wait(lambda e: e["topic"] == "taken", probe.order(follow=path))
    goal = probe.events[taken]["number"]
    at = probe.wait(lambda e: is_at_speed(e) or (e["topic"] == "ended" and e["number"] == goal), taken)
    assert is_at_speed(probe.events[at]), probe.events[at]
    return at


def test_a_path_is_followed_with_feedback_through_all_states_of_a_lifecycle(ros2: Ros) -> None:
    probe = with_controller(ros2)
    first = probe.order(follow=PATH, controller_id="FollowPath", yaw=1.0)
    end = ended(probe, first)
    assert (end["status"], end["code"]) == (SUCCEEDED, 0)
    feedback = [told for told in probe.of("feedback", first) if told["number"] == end["number"]]
    left = [event["left_m"] for event in feedback]
    assert len(left) > 100
    assert left[0] > 15.0
    assert left[-1] < 0.5
    assert max(event["speed"] for event in feedback) > 0.5
    yaw = compose(TASK.start, (0.0, 0.0, probe.of("odom")[-1]["yaw"]))[2]
    assert abs(math.remainder(yaw - 1.0, 2.0 * math.pi)) < 0.35
    beats = probe.of("bond")
    assert beats
    assert {event["id"] for event in beats if event["active"]} == {"controller_server"}
    change(probe, DEACTIVATE)
    first = probe.order(follow=PATH)
    taken = probe.wait(lambda e: e["topic"] == "taken", first)
    assert not probe.events[taken]["accepted"]
    assert not probe.of("bond")[-1]["active"]
    change(probe, ACTIVATE)
    first = probe.order(follow=PATH[::-1])
    probe.wait(is_at_speed, first)
    change(probe, DEACTIVATE)
    change(probe, CLEANUP)
    change(probe, CONFIGURE)
    change(probe, SHUTDOWN)
    assert [event["count"] for event in probe.of("collisions")] == [0]


def test_cancelled_replaced_or_deactivated_on_the_way_it_stands_in_two_periods(ros2: Ros) -> None:
    probe = with_controller(ros2, speed="1")
    at = under_way(probe)
    probe.order(cancel=True)
    cancelling = probe.wait(lambda e: e["topic"] == "cancelling", at)
    assert ended(probe, at)["status"] == CANCELED
    stands_in_two_periods(probe, cancelling)

    at = under_way(probe)
    probe.order(cancel=True)
    probe.order(follow=PATH)  # in the same instant
    end = ended(probe, at)
    assert end["status"] == CANCELED
    probe.wait(lambda e: e["topic"] == "feedback" and e["number"] > end["number"] and e["speed"] > 0.4, at)
    assert [e["number"] for e in probe.of("ended", at)] == [end["number"]], "the newer goal is driven to"

    first = probe.order(follow=[])  # a planner that has found nothing
    taken = probe.wait(lambda e: e["topic"] == "taken", first)
    ends = [probe.events[probe.wait(lambda e: e["topic"] == "ended", first)]]
    ends.append(probe.events[probe.wait(lambda e: e["topic"] == "ended" and e not in ends, first)])
    assert sorted((end["status"], end["code"]) for end in ends) == [(ABORTED, 0), (ABORTED, 103)]
    stands_in_two_periods(probe, taken)

    under_way(probe)
    first = probe.count()
    inactive = change(probe, DEACTIVATE)
    assert ended(probe, first)["status"] == ABORTED
    stands_in_two_periods(probe, inactive)
    assert [event["count"] for event in probe.of("collisions")] == [0]


def test_a_path_in_the_place_of_another_is_driven_on_without_a_stop(ros2: Ros) -> None:
    """Each second, as a behaviour tree plans anew, and whatever it clears; a limit of the speed holds from then on."""
    probe = with_controller(ros2, speed="1")
    first = under_way(probe)
    for _ in range(4):
        at = probe.order(follow=PATH)
        end = ended(probe, at, 10.0)
        assert (end["status"], end["code"]) == (ABORTED, 0)
        probe.wait(lambda e: e["topic"] == "cleared", probe.order(clear=True))
        time.sleep(0.7)
    assert min(event["v"] for event in probe.of("odom", first)) > 0.1
    at = probe.order(limit=50.0, percentage=True)
    time.sleep(2.0)
    slow = [event["v"] for event in probe.of("cmd_vel", at)]
    assert max(slow[5:]) == pytest.approx(0.3, abs=0.01)


def test_goals_that_cannot_be_end_with_nav2s_error_codes(ros2: Ros) -> None:
    probe = with_controller(ros2, "progress_checker.movement_time_allowance:=3.0", speed="4")
    beside = [[TASK.start[0], TASK.start[1]], [-40.0, -40.0]]
    for order, code, words in (
        ({"follow": PATH, "controller_id": "MPPI"}, 101, "MPPI"),
        ({"follow": PATH, "goal_checker_id": "strict"}, 100, "strict"),
        ({"follow": PATH, "progress_checker_id": "slow"}, 100, "slow"),
        ({"follow": []}, 103, "no poses"),
        ({"follow": [[0.0, math.nan]]}, 103, "not finite"),
        ({"follow": PATH, "frame": "camera"}, 102, "camera"),
        ({"follow": beside}, 105, "less than 0.5 m in 3 s"),
    ):
        end = ended(probe, probe.order(**order))
        assert (end["status"], end["code"]) == (ABORTED, code), order
        assert words in end["message"]
    end = ended(probe, probe.order(follow=PATH))
    assert end["code"] in (0, 105)  # from where it has come to it may have to be planned anew
    assert [event["count"] for event in probe.of("collisions")] == [0]


def test_sensors_and_transforms_that_stop_end_a_goal_with_their_codes(ros2: Ros) -> None:
    """Faults of the runtime's table, through the action."""
    ros2.node("sim", "--scenario", "complex", "--tf")
    ros2.node("controller", "--robot", "diffbot", "costmap_update_timeout:=1.0", scan="relayed/scan")
    relay = ros2.probe(relay=True)
    probe = ready(active(ros2))
    for fault in ("drop", "freeze", "nan", "late"):
        at = under_way(probe)
        relay.order(scans=fault)
        end = ended(probe, at)
        assert (end["status"], end["code"]) == (ABORTED, 107), fault
        assert "scan" in end["message"]
        stands_from(probe, probe.count(), 0)
        relay.wait(is_idle, relay.order(scans="pass"))
    assert [event["count"] for event in probe.of("collisions")] == [0]


def test_without_transforms_a_goal_ends_with_the_error_of_tf(ros2: Ros) -> None:
    ros2.node("sim", "--scenario", "complex", "--speed", "2")
    ros2.node("controller", "--robot", "diffbot")
    status, probe = ros2.probe(), active(ros2)
    status.wait(lambda e: e["topic"] == "status" and e["reasons"] == "no_scan")  # where that is, is not known
    end = ended(probe, probe.order(follow=PATH))
    assert (end["status"], end["code"]) == (ABORTED, 102)
    assert "no transform from 'map' to 'odom'" in end["message"]


def test_the_navigator_is_an_action_too_and_turns_where_it_is_told_to(ros2: Ros) -> None:
    ros2.node("sim", "--speed", "2", "--tf")
    node = ros2.node(
        "drive", "--robot", "diffbot", "--guidance", "replan", "--localisation", "tf", "--goal-yaw"
    )
    status, probe = ros2.probe(), nav2_probe(ros2)
    task = task_set(SCENARIOS["clutter"], load_robot("diffbot"), "test", 1)[0]
    ready(probe, navigate=task.start, frame="map")
    first = probe.order(navigate=[*task.goal, -2.0], frame="map")
    end = ended(probe, first)
    assert (end["status"], end["code"]) == (SUCCEEDED, 0)
    feedback = [told for told in probe.of("feedback", first) if told["number"] == end["number"]]
    assert feedback[-1]["time_s"] > 5.0
    assert math.dist(feedback[-1]["at"][:2], task.goal) < 0.4
    yaw = compose(task.start, (0.0, 0.0, probe.of("odom")[-1]["yaw"]))[2]
    assert abs(math.remainder(yaw + 2.0, 2.0 * math.pi)) < 0.4
    x, y, _ = compose(inverse(task.start), (*task.goal, 0.0))
    home = [0.0, 0.0, 0.0]
    first = probe.order(navigate=home, frame="odom")
    at = probe.wait(is_at_speed, first)
    status.order(goal=(x, y), frame="odom")
    end = ended(probe, at)
    assert (end["status"], end["code"]) == (ABORTED, 0)
    assert "another goal" in end["message"]
    first = probe.order(navigate=home, frame="odom")
    at = probe.wait(is_at_speed, probe.wait(lambda e: e["topic"] == "taken", first))
    probe.order(cancel=True)
    cancelling = probe.wait(lambda e: e["topic"] == "cancelling", at)
    assert ended(probe, at)["status"] == CANCELED
    stands_from(probe, cancelling, 2 + 1 + 6)
    end = ended(probe, probe.order(navigate=home, frame="camera"))
    assert (end["status"], end["code"]) == (ABORTED, 9002)
    assert node.end() == 0
    assert [event["count"] for event in probe.of("collisions")] == [0]


def test_the_parameter_file_is_read(ros2: Ros) -> None:
    """As Nav2's users have it; its goal checker and no other."""
    shipped = SOURCE / "ros2" / "adrl_bringup" / "params" / "controller_server.yaml"
    file = ros2.folder / "nav2_params.yaml"
    file.write_text(shipped.read_text().replace("my_robot.toml", "diffbot"))
    ros2.node("sim", "--scenario", "complex", "--speed", "2", "--tf")
    adrl = [str(ros2.python), "-m", "adrl.cli", "ros2", "controller", "--policy", "nothing"]
    ros2.start("controller", [*adrl, "--ros-args", "-p", "use_sim_time:=true", "--params-file", str(file)])
    probe = ready(active(ros2))
    end = ended(probe, probe.order(follow=PATH, goal_checker_id="goal_checker"))
    assert (end["status"], end["code"]) == (ABORTED, 100)
    assert "known: general_goal_checker" in end["message"]
    probe.wait(is_at_speed, probe.order(follow=PATH, goal_checker_id="general_goal_checker"))
