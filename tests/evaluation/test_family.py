"""Evaluation on the robots of a family: the robot is the unit, and each drives as it does alone."""

import json
import shlex
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_array_equal

from adrl.commands.evaluate import EvaluateOptions, again
from adrl.commands.options import parse
from adrl.errors import ConfigError, TaskError
from adrl.evaluation.evaluate import evaluate
from adrl.evaluation.family import evaluate_family
from adrl.evaluation.metrics import RATES
from adrl.evaluation.results import read_episodes
from adrl.evaluation.trace_file import read_traces
from adrl.types import RobotConfig, Task
from adrl.worlds import FAMILIES, RobotFamily, get_scenario, load_robot, task_set
from adrl.worlds.place import Place
from small_run import run_cli

SMALL = RobotFamily(name="small", radius_m=(0.1, 0.3), disc_share=1.0, max_speed_mps=(0.4, 1.5))


class Wary:
    """As fast as the nearest sector is far, turning to the goal."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        nearest = observation[:, :36].min(axis=1)
        return np.stack([2.0 * nearest - 1.0, observation[:, 37]], axis=1).astype(np.float32)


class Gaps:
    """Clutter with a gap that only small robots fit through."""

    name = "gaps"

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        if robot.circumscribed_radius_m > 0.2:
            raise TaskError(
                f"no place has the clearance that robot {robot.name!r} needs; take a smaller robot"
            )
        return get_scenario("clutter").task(rng, robot)


@pytest.fixture(scope="module")
def driven():
    return evaluate_family(Wary(), family=SMALL, robots=12, episodes=5, split="validation", traces=True)


def test_each_robot_drives_tasks_of_its_own_as_it_does_alone(driven):
    assert_array_equal(driven.episodes.task, np.arange(60))
    assert_array_equal(driven.whose, np.repeat(np.arange(12), 5))
    place = get_scenario("clutter")
    for number in (0, 7):
        robot = load_robot_of(number)
        tasks = task_set(place, robot, "validation", 5, first=5 * number)
        # The noise follows from the task's number, which evaluate() counts from 0.
        quiet = evaluate(Wary(), robot=robot, tasks=tasks)
        mine = driven.episodes.select(driven.whose == number)
        assert_array_equal(mine.shortest_m, quiet.rollout.episodes.shortest_m)


def load_robot_of(number: int) -> RobotConfig:
    return SMALL.draw("validation", number)


def test_the_summary_is_over_robots(driven):
    summary, robots = driven.summary, driven.robots
    assert (summary["robots"], summary["episodes"], summary["robot"]) == (12, 60, "small")
    for name in RATES:
        assert summary[name] == pytest.approx(robots[name].mean())
        assert summary[f"{name}_low"] <= summary[name] <= summary[f"{name}_high"]
    assert summary["worst_decile"] == np.sort(robots["success"])[1]
    worst = summary["worst_robot"]
    assert worst["success"] == robots["success"].min()
    split, number = worst["robot"].split(":")[1:]
    assert split == "validation"
    assert robots["success"][int(number)] == worst["success"]
    assert robots["max_speed_mps"][int(number)] == load_robot_of(int(number)).max_speed_mps
    assert worst["success_low"] < worst["success_high"]
    json.dumps(summary, allow_nan=False)


def test_files_hold_the_robots_and_who_drove_which_episode(driven, tmp_path: Path):
    driven.save(tmp_path)
    episodes = pq.read_table(tmp_path / "episodes.parquet")
    assert_array_equal(episodes["robot"].to_numpy(), driven.whose)
    assert_array_equal(read_episodes(tmp_path / "episodes.parquet").success, driven.episodes.success)
    robots = pq.read_table(tmp_path / "robots.parquet").to_pylist()
    assert [row["name"] for row in robots] == [f"small:validation:{n}" for n in range(12)]
    assert robots[3]["lidar.num_beams"] == load_robot_of(3).lidar.num_beams
    kept = read_traces(tmp_path / "traces.safetensors")
    assert len(kept.episodes) > 3
    for trace in kept.episodes:
        assert trace.robot == load_robot_of(trace.task // 5)
        assert trace.ranges.shape[1] == trace.robot.lidar.num_beams


def test_a_robot_without_a_task_is_left_out_and_named():
    told = evaluate_family(Wary(), family=SMALL, scenario=Gaps(), robots=12, episodes=2)
    large = [n for n in range(12) if SMALL.draw("test", n).circumscribed_radius_m > 0.2]
    assert 0 < len(large) < 12
    assert [*told.summary["robots_left_out"]] == [f"small:test:{n}" for n in large]
    assert told.summary["robots"] == 12 - len(large)
    assert {*told.robots["robot"]} == {*range(12)} - {*large}
    (line,) = told.summary["warnings"]
    assert line.startswith(
        f"{len(large)} of 12 robots have no task in gaps and are left out: small:test:{large[0]}"
    )
    assert "\n" not in line
    with pytest.raises(TaskError, match="none of 12 robots has a task: no place has the clearance"):
        evaluate_family(Wary(), family=RobotFamily(radius_m=0.4, disc_share=1.0), scenario=Gaps(), robots=12)  # pyright: ignore


def test_what_a_policy_was_not_trained_for_is_said_once():
    class Ours(Wary):
        robot = SMALL

    told = evaluate_family(Ours(), family="any", robots=6, episodes=1)
    (line,) = told.summary["warnings"]
    assert "of 6 robots are not such as it was trained for" in line
    assert told.summary["trained_for"] == "small"
    assert evaluate_family(Ours(), family=SMALL, robots=4, episodes=1).summary["warnings"] == []


REFUSED = {
    "no family": (["--robot", "jackal", "--robots", "3"], "--robots draws robots of a family"),
    "no robots": (["--robot", "any", "--robots", "0"], "robots is 0; give 1 or more"),
    "no tasks": (["--robot", "any", "--episodes", "0"], "episodes is 0; give 1 or more"),
    "a bag": (["--robot", "any", "--bag", "drive.bag"], "--bag is for one robot, and any is a family"),
    "a task": (
        ["--robot", "any", "--start", "0", "0", "0", "--goal", "1", "1"],
        "--start is for one robot, and any is a family; give one, as any:test:0",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_is_one_line(name: str, capsys: pytest.CaptureFixture[str]):
    arguments, message = REFUSED[name]
    assert run_cli("evaluate", "--policy", "default", *arguments) == 2
    *progress, error = capsys.readouterr().err.splitlines()
    assert error.startswith("adrl: error: ")
    assert message in error
    assert all("evaluating default" in line for line in progress)


GIVEN = [
    "--scenario office --people 3 --people-share 0.0 --legs --split validation --seed 4",
    "--map a.yaml --unknown free --guidance replan",
    "--world a.sdf --models m n --ignore 'tree_*' 'wall 2'",
    "--barn worlds --barn-held-out 10 --people 2",
    "",
]


@pytest.mark.parametrize("given", GIVEN)
def test_the_command_for_the_worst_robot_drives_it_in_the_same_place(given: str):
    """All of GIVEN together have every option of a place: one that is added is to be added here."""
    first = parse(EvaluateOptions, ["--robot", "any", *shlex.split(given)], "evaluate", "")
    robots = {"robot": [0, 7], "success": [1.0, 0.0], "collision": [0.0, 1.0]}
    adrl, command, *words = shlex.split(again({n: np.array(c) for n, c in robots.items()}, first))
    assert (adrl, command) == ("adrl", "evaluate")
    told = parse(EvaluateOptions, words, "evaluate", "")
    assert told == replace(first, robot=f"any:{first.split}:7")
    flags = " ".join(GIVEN).replace("-", "_")
    assert not [option.name for option in fields(Place) if f"__{option.name}" not in flags]


@pytest.mark.slow
@pytest.mark.integration
def test_the_command_names_the_worst_robot_and_the_report_replays_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "any"
    few = ("--robots", "6", "--episodes", "2")
    assert run_cli("evaluate", "--policy", "default", "--robot", "any", *few, "--out", out) == 0
    told = capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    assert summary["worst_robot"]["robot"] in told
    assert "and the worst of 6 robots" in told
    again = next(line for line in told.splitlines() if line.startswith("drive the worst again: adrl "))
    words = again.removeprefix("drive the worst again: adrl ").split()
    assert summary["worst_robot"]["robot"] in words
    assert run_cli(*words, "--episodes", "1") == 0
    assert load_robot(summary["worst_robot"]["robot"]) == FAMILIES["any"].draw(
        "test", int(summary["worst_robot"]["robot"].rpartition(":")[2])
    )
    assert (out / "robots.png").read_bytes().startswith(b"\x89PNG")
    assert run_cli("report", out) == 0
    page = (out / "report.html").read_text()
    assert "any:test:1" in page


def test_one_robot_is_no_family():
    with pytest.raises(
        ConfigError, match="'jackal' is one robot, and robots are drawn from a family; give any"
    ):
        evaluate_family(Wary(), family="jackal")


def test_what_takes_one_robot_refuses_a_family(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run_cli("collect", "--robot", "any", "--out", tmp_path / "drives") == 2
    assert (
        "is a family of robots, and this takes one: give one of it, such as any:test:0"
        in capsys.readouterr().err
    )
