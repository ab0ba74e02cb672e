"""A drive as pages ask for it, without a browser."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl.errors import ConfigError
from adrl.imitation import Source, load_minari
from adrl.observation import EncoderConfig
from adrl.types import World
from adrl.view import pace as pace_module
from adrl.view.choices import Offer
from adrl.view.drive import Drive
from adrl.view.lane import TIME, X, Y
from adrl.view.messages import Choose, Message, decode
from adrl.view.pace import Pace
from adrl.worlds import load_robot
from map_files import write_map

TURN_S = 0.05


class Desk:
    """A drive, and somebody who turns its crank."""

    def __init__(self, tmp_path: Path, **choice: Any) -> None:
        chosen = {"policies": ("default",), "place": "clutter"} | choice
        self.drive = Drive(Offer(), Choose(**chosen), tmp_path / "demonstrations")
        self.now_s = 100.0
        self.frame = self.ask(do="pace", playing=True, speed=20.0)

    def ask(self, **message: Any) -> dict[str, Any]:
        """Ask for something in a turn."""
        return self.turns(1, decode(json.dumps(message)))

    def turns(self, count: int, *asked: Message) -> dict[str, Any]:
        """So many turns, the last one's frame."""
        for _ in range(count):
            self.now_s += TURN_S
            self.frame = self.drive.turn(list(asked), self.now_s)
            json.dumps(self.frame, allow_nan=False)  # what a page can read
            asked = ()
        return self.frame

    def until(self, condition: str, most: int = 600) -> dict[str, Any]:
        """Turns until the first lane's status is that."""
        for _ in range(most):
            lane = self.turns(1)["lanes"][0]
            if condition == ("reached" if lane["arrived"] else lane["status"]):
                return lane
        raise AssertionError(f"never {condition}: {self.frame}")


def test_the_shipped_policy_drives_to_the_goal(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    lane = desk.until("reached")
    assert math.dist(lane["pose"][:2], lane["goal"]) < 0.5
    setup = desk.drive.setup()
    json.dumps(setup, allow_nan=False)
    rows = setup["lanes"][0]["rows"]
    times = [row[TIME] for row in rows]
    assert times[0] == 0.0
    assert times == sorted(set(times))
    assert [rows[-1][X], rows[-1][Y]] == lane["pose"][:2]
    shares = np.array([row[-len(setup["lanes"][0]["terms"]) :] for row in rows[1:]])
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-3)  # eq 16


def test_frames_hold_each_period_once(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    told: list[float] = []
    for _ in range(30):
        told += [row[TIME] for row in desk.turns(1)["lanes"][0]["rows"]]
    assert told == sorted(set(told))
    assert len(told) > 10
    np.testing.assert_allclose(np.diff(told), 0.1, atol=1e-6)


def test_two_policies_have_the_same_task_and_noise(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("default", "default"))
    first, second = desk.turns(20)["lanes"]
    assert first["time_s"] > 0.0
    assert first["pose"] == second["pose"]
    assert first["ranges"] == second["ranges"]
    assert (
        Desk(tmp_path, policies=("default", "jackal"), robot="diffbot").turns(1)["lanes"][1]["goal"]
        == first["goal"]
    )


def test_a_clicked_goal_is_driven_to(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.until("reached")
    before = desk.turns(20)["lanes"][0]["time_s"]
    assert desk.turns(5)["lanes"][0]["time_s"] == before  # nothing moves it but a new goal
    start = desk.drive.setup()["lanes"][0]["rows"][0]
    desk.ask(do="goal", x=start[X], y=start[Y])
    lane = desk.until("reached")
    assert math.dist(lane["pose"][:2], (start[X], start[Y])) < 0.5
    assert lane["time_s"] > before


def test_a_goal_in_a_wall_is_told(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    world: World = desk.drive.lanes[0].task.world
    middle = world.polygons[0].mean(axis=0)
    desk.ask(do="goal", x=float(middle[0]), y=float(middle[1]))
    assert "inside an obstacle" in desk.until("failed")["message"]


def test_a_dropped_scan_stops_the_robot_and_says_so(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.until("driving")
    desk.ask(do="fault", name="scan dropped")
    lane = desk.until("stopped")
    assert "scan_stale" in lane["reasons"]
    assert desk.turns(5)["lanes"][0]["twist"] == [0.0, 0.0]
    assert desk.frame["fault"] == "scan dropped"
    desk.ask(do="fault", name="none")
    desk.until("driving")


def test_slipping_wheels_come_half_as_far_as_they_count(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.ask(do="fault", name="wheels slip")
    desk.turns(10)
    b = desk.drive.lanes[0].sim.b
    driven, counted = (
        math.dist(b[name][0, :2], desk.drive.lanes[0].task.start[:2]) for name in ("pose", "odometry")
    )
    assert driven > 0.05
    assert counted > 1.5 * driven


def test_an_obstacle_that_is_moved_is_where_it_is_seen_and_hit(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.ask(do="pace", playing=False, speed=1.0)
    before: World = desk.drive.lanes[0].task.world
    frame = desk.ask(do="move", kind="polygons", index=0, dx=0.5, dy=-0.25)
    after: World = desk.drive.lanes[0].task.world
    np.testing.assert_allclose(after.polygons[0], before.polygons[0] + [0.5, -0.25])
    assert len(frame["obstacles"]["polygons"]) == len(before.polygons)
    assert "obstacles" not in desk.turns(1)
    pose = desk.drive.lanes[0].sim.b["pose"][0]
    desk.ask(do="pillar", x=float(pose[0]), y=float(pose[1]))
    desk.ask(do="pace", playing=True, speed=20.0)
    assert desk.until("collision")
    desk.ask(do="restart")
    assert desk.drive.lanes[0].task.world is before


def test_a_person_who_is_added_sets_out_and_the_others_walk_on(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("default", "jackal"), robot="diffbot", place="crowd", people=6)
    desk.ask(do="pace", playing=False)
    before = desk.turns(1)["lanes"]
    x, y = before[0]["goal"]
    after = desk.ask(do="person", x=x, y=y)
    assert "errors" not in after
    for old, new in zip(before, after["lanes"], strict=True):
        assert new["people"][:18] == old["people"]
        np.testing.assert_allclose(new["people"][18:20], [x, y], atol=1e-3)
    desk.ask(do="pace", playing=True, speed=20.0)
    walked = desk.turns(3)["lanes"][0]["people"]
    assert math.dist(walked[18:20], (x, y)) > 0.1
    errors = desk.ask(do="person", x=-50.0, y=0.0)["errors"]
    assert "no person can walk from (-50.00, 0.00)" in errors[0]
    assert len(desk.ask(do="restart")["lanes"][0]["people"]) == 18


def test_time_stands_while_paused(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.ask(do="pace", playing=False, speed=5.0)
    stood = desk.frame["lanes"][0]["time_s"]
    assert desk.turns(10)["lanes"][0]["time_s"] == stood
    assert (desk.frame["playing"], desk.frame["speed"]) == (False, 5.0)
    desk.ask(do="pace", speed=3.0)
    assert (desk.frame["playing"], desk.frame["speed"]) == (False, 3.0)
    desk.ask(do="pace", playing=True)
    assert (desk.frame["playing"], desk.frame["speed"]) == (True, 3.0)


@settings(max_examples=20)
@given(speed=st.floats(0.1, 20.0), period_s=st.sampled_from([0.05, 0.1, 0.2]))
def test_time_goes_as_fast_as_asked(speed: float, period_s: float) -> None:
    pace, steps = Pace(), 0
    pace.set(True, speed)
    pace.begin(period_s)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pace_module, "BUDGET_S", math.inf)  # of the wall's clock: this machine may be busy
        for turn in range(201):
            steps += sum(1 for _ in pace.steps(10.0 + TURN_S * turn))
    assert abs(steps * period_s - 10.0 * speed) <= period_s + 1e-6


def test_a_page_that_was_away_has_missed_the_rest() -> None:
    pace = Pace()
    pace.begin(0.1)
    assert sum(1 for _ in pace.steps(0.0)) == 0
    assert sum(1 for _ in pace.steps(1000.0)) <= 2


def drive_by_hand(desk: Desk, turns: int) -> None:
    """Towards the goal, as a person steers who sees it."""
    for _ in range(turns):
        lane = desk.frame["lanes"][0]
        x, y, yaw = lane["pose"]
        off = math.remainder(math.atan2(lane["goal"][1] - y, lane["goal"][0] - x) - yaw, 2.0 * math.pi)
        desk.ask(do="hand", speed=max(0.0, math.cos(off)), turn=max(-1.0, min(1.0, 2.0 * off)))


def test_a_person_drives_and_the_supervisor_keeps_the_last_word(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("by hand",), task=3)
    assert desk.turns(10)["lanes"][0]["twist"] == [0.0, 0.0]
    drive_by_hand(desk, 10)
    assert desk.frame["lanes"][0]["time_s"] > 0.0
    pose = np.array(desk.frame["lanes"][0]["pose"])
    ahead = pose[:2] + 1.0 * np.array([math.cos(pose[2]), math.sin(pose[2])])
    desk.ask(do="pillar", x=float(ahead[0]), y=float(ahead[1]))
    for _ in range(40):  # straight at it
        desk.ask(do="hand", speed=1.0, turn=0.0)
    lane = desk.frame["lanes"][0]
    assert "obstacle" in lane["reasons"]
    assert lane["status"] != "collision"


def test_who_lets_go_stands(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("by hand",))
    desk.ask(do="pace", playing=True, speed=1.0)
    for _ in range(20):
        desk.ask(do="hand", speed=0.0, turn=1.0)
    assert desk.frame["lanes"][0]["twist"][1] > 0.0
    assert desk.turns(20)["lanes"][0]["twist"] == [0.0, 0.0]


def test_recorded_drives_are_a_dataset_that_training_takes(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("by hand",))
    assert "by hand" in Desk(tmp_path).ask(do="record", on=True)["errors"][0]
    assert "nothing" in desk.ask(do="save")["errors"][0]
    desk.ask(do="record", on=True)
    drive_by_hand(desk, 40)
    recorded = desk.frame["record"]
    assert recorded["steps"] > 50
    first = desk.ask(do="save")["record"]["saved"]
    assert first == [str(tmp_path / "demonstrations")]
    assert desk.frame["record"]["steps"] <= 20
    robot = load_robot("diffbot")
    expected = Source(robot=robot, encoder=EncoderConfig(), guidance="goal", scenario="clutter")
    read = load_minari(first[0], expected)
    assert len(read) >= recorded["steps"]
    assert (np.abs(read.action) > 0.0).any()
    np.testing.assert_array_equal(read.action, read.expert_action)
    drive_by_hand(desk, 10)
    assert desk.drive.close() == [first[0], f"{first[0]}-2"]  # what nobody saved is not lost


def test_an_arrival_while_recording_goes_on_to_the_next_task(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("by hand",))
    desk.ask(do="record", on=True)
    x, y, yaw = desk.frame["lanes"][0]["pose"]
    desk.ask(do="goal", x=x + 0.5 * math.cos(yaw), y=y + 0.5 * math.sin(yaw))
    for _ in range(40):
        desk.ask(do="hand", speed=1.0, turn=0.0)
        if desk.drive.choice.task == 1:
            break
    assert desk.drive.choice.task == 1
    assert desk.frame["record"]["on"]
    assert desk.frame["record"]["arrivals"] == 1


def test_recorded_steps_are_not_mixed_with_those_of_another_robot(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("by hand",))
    desk.ask(do="record", on=True)
    drive_by_hand(desk, 5)
    wrong = desk.ask(do="choose", policies=["by hand"], place="clutter", robot="jackal")
    assert "save them first" in wrong["errors"][0]
    assert wrong["record"]["steps"] > 0
    assert desk.drive.setup()["robot"] == "diffbot"


@pytest.mark.parametrize(
    ("choice", "word"),
    [
        ({"policies": ["nobody"]}, "nobody"),
        ({"policies": ["os:getcwd"]}, "is code"),
        ({"policies": ["astar-dwa"]}, "unknown policy"),
        ({"place": "nowhere"}, "nowhere"),
        ({"place": "none.yaml"}, "none.yaml"),
        ({"robot": "nothing.toml"}, "nothing.toml"),
        ({"guidance": "stars"}, "stars"),
    ],
)
def test_a_bad_choice_is_told_and_the_drive_goes_on(
    tmp_path: Path, choice: dict[str, Any], word: str
) -> None:
    desk = Desk(tmp_path)
    before = desk.turns(5)["lanes"][0]["time_s"]
    errors = desk.ask(do="choose", **({"policies": ["default"], "place": "clutter"} | choice))["errors"]
    assert word in errors[0]
    assert "\n" not in errors[0]
    assert desk.turns(5)["lanes"][0]["time_s"] > before


def test_a_map_is_a_place(tmp_path: Path) -> None:
    pixels = np.full((120, 120), 254)
    pixels[[0, -1], :] = pixels[:, [0, -1]] = 0
    path = write_map(tmp_path, pixels, resolution=0.05)
    desk = Desk(tmp_path)
    desk.ask(do="choose", policies=["default"], place=str(path))
    assert desk.drive.setup()["world"]["grid"]["size"] == [120, 120]
    assert desk.until("driving")


def test_the_own_map_is_shown_where_the_robot_believes_it(tmp_path: Path) -> None:
    desk = Desk(tmp_path, policies=("jackal",))
    maps = [lane["map"] for _ in range(12) for lane in desk.turns(1)["lanes"] if "map" in lane]
    assert maps[-1]["picture"].startswith("data:image/png")
    x, y, _ = maps[-1]["origin"]
    side = maps[-1]["size"][0] * maps[-1]["resolution_m"]
    pose = desk.frame["lanes"][0]["pose"]
    assert x < pose[0] < x + side
    assert y < pose[1] < y + side


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"do": "fly"}',
        '{"do": "goal", "x": 1}',
        '{"do": "goal", "x": NaN, "y": 0}',
        '{"do": "goal", "x": 1e9, "y": 0}',
        '{"do": "pace", "playing": true, "speed": 21}',
        '{"do": "pace", "playing": true, "speed": 0}',
        '{"do": "move", "kind": "robots", "index": 0, "dx": 0, "dy": 0}',
        '{"do": "hand", "speed": 2, "turn": 0}',
        '{"do": "restart", "now": true}',
        '{"do": "choose", "policies": [], "place": "clutter"}',
        "x" * 5000,
    ],
)
def test_what_is_no_message_is_refused_in_a_line(text: str) -> None:
    with pytest.raises(ConfigError) as refused:
        decode(text)
    assert "\n" not in str(refused.value)


def test_what_is_not_there_cannot_be_moved(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    assert "discs[0]" in desk.ask(do="move", kind="discs", index=0, dx=1.0, dy=0.0)["errors"][0]
    assert "unknown fault" in desk.ask(do="fault", name="rain")["errors"][0]


def test_people_walk_where_they_are_asked_for(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    assert desk.turns(1)["lanes"][0]["people"] == []
    desk.ask(do="choose", policies=["default"], place="clutter", people=5)
    before = desk.turns(1)["lanes"][0]["people"]
    assert len(before) == 3 * 5
    assert desk.turns(10)["lanes"][0]["people"] != before
    desk.ask(do="pillar", x=0.5, y=0.5)  # they walk on
    assert len(desk.turns(1)["lanes"][0]["people"]) == 3 * 5
