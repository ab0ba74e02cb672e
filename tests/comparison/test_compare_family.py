"""adrl compare with the robots of a family: every method and planner drives the same robots."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from adrl.agents.config import TrainConfig
from adrl.comparison.compare import compare
from adrl.comparison.config import CompareConfig, from_document
from adrl.comparison.jobs import EPISODES_FILE, Job, run_job
from adrl.comparison.results import markdown, method_rows, read_runs
from adrl.errors import ConfigError
from adrl.report.source import read_source
from adrl.worlds import RobotFamily
from small_run import run_cli

BUDGET = TrainConfig(steps=1000)
SMALL = RobotFamily(name="small", radius_m=(0.1, 0.2), disc_share=1.0, max_speed_mps=(0.8, 1.5))


def config_of(out: Path, **options) -> CompareConfig:
    given = {"methods": "td3", "robot": SMALL, "robots": 3, "episodes": 2, "learner": BUDGET}
    return CompareConfig(**given | options, out=out)


def test_a_family_is_told_as_its_ranges_and_comes_back_whole(tmp_path: Path):
    config = config_of(tmp_path)
    assert from_document(config.document()) == config
    assert config.settings()["robot"]["max_speed_mps"] == [0.8, 1.5]
    assert (config.settings()["robots"], config.settings()["episodes"]) == (3, 2)
    assert "robot small" in config.title()
    assert config.title().endswith("2 test tasks of each of 3 robots")


def test_settings_of_one_robot_are_as_before():
    alone = CompareConfig(learner=BUDGET).settings()
    assert alone["episodes"] == 500
    assert alone["robots"] is None
    of_family = CompareConfig(robot="any", learner=BUDGET).settings()
    assert (of_family["robots"], of_family["episodes"]) == (100, 20)


def test_planners_drive_the_same_robots_and_the_table_has_their_worst_decile(tmp_path: Path):
    config = config_of(tmp_path / "out", policies="astar-pursuit")
    jobs = [Job("astar-dwa", None), Job("astar-pursuit", None)]
    for job in jobs:
        run_job(config, job, 0.0)
    tables = [pq.read_table(config.out / job.name / EPISODES_FILE) for job in jobs]
    np.testing.assert_array_equal(*(table["shortest_m"].to_numpy() for table in tables))
    assert len(tables[0]) == 6
    rows = method_rows(read_runs([config.out / job.name for job in jobs]))
    for row in rows:
        summary = json.loads((config.out / row["method"] / "map" / "summary.json").read_text())
        assert row["worst_decile"] == summary["worst_decile"]
        assert row["success"] == summary["success"]
    text = markdown(rows, config.title())
    assert "decile %" in text
    assert "decile: success that nine of ten robots reach" in text


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"routes": 2}, "routes keeps those of one robot, and robot is small"),
        ({"robot": "jackal"}, "robots draws robots of a family, and robot is jackal"),
        ({"methods": "sb3-td3"}, "sb3-td3 has one discount for all steps"),
        ({"robots": 0}, "robots is 0; give 1 or more"),
    ],
    ids=["routes", "robots", "sb3", "none"],
)
def test_a_refusal_is_one_line(tmp_path: Path, options: dict, told: str):
    with pytest.raises(ConfigError, match=told) as caught:
        config_of(tmp_path, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.integration
def test_trainings_of_two_seeds_are_compared_and_reported(tmp_path: Path):
    sizes = {"num_envs": 16, "task_pool": 4, "validation_episodes": 2, "workers": 1}
    learner = TrainConfig(steps=1024, start_steps=256, critic_warmup_updates=8, eval_interval_steps=1024)
    config = config_of(tmp_path / "out", seeds=2, learner=learner, **sizes)
    result = compare(config)
    assert not result.failed
    trained, planner = result.rows
    assert (trained["method"], trained["seeds"], planner["method"]) == ("td3", 2, "astar-dwa")
    assert trained["worst_decile"] <= trained["success"] + 1e-9
    assert read_source(config.out).facts["evaluated on"] == "2 test tasks of each of 3 robots"
    assert run_cli("report", config.out) == 0
