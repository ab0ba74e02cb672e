"""A report never shows an evaluation of a policy that has been trained for longer since."""

import json
import shutil
from pathlib import Path

import pytest

import adrl
from adrl.commands.view import _place_of
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.report.source import outdated, read_source
from small_run import run_cli


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A shipped policy as a run, with an evaluation of its own, one of the planner, and one of its on other tasks."""
    run = tmp_path / "run"
    shutil.copytree(resolve_policy("diffbot"), run)
    (run / "metrics.jsonl").write_text('{"wall_s": 1.0, "env_steps": 1, "success": 0.5}\n')
    config = json.loads((run / "config.json").read_text())
    config["settings"] = {"scenario": "clutter"}
    config["scenario"] = "clutter"
    (run / "config.json").write_text(json.dumps(config))
    adrl.evaluate(run, episodes=2, out=run / "evaluation", guidance="map", split="validation")
    adrl.evaluate(run, scenario="complex", episodes=1, out=run / "elsewhere")
    adrl.evaluate("astar-dwa", episodes=1, out=run / "planner")
    return run


def train_on(run: Path) -> None:
    policy = load_policy(run)
    weight, _ = policy.layers[0]
    weight += 0.001
    policy.save(run)


def test_only_its_own_evaluations_of_before_are_outdated(run: Path) -> None:
    assert outdated(run) == []
    train_on(run)
    assert [path.name for path in outdated(run)] == ["elsewhere", "evaluation"]
    source = read_source(str(run))
    assert [entry.label for entry in source.evaluations] == ["planner"]
    assert [name.partition(" ")[0] for name in source.missing] == ["elsewhere", "evaluation"]


def test_without_a_fingerprint_the_steps_of_training_tell(run: Path) -> None:
    path = run / "evaluation" / "summary.json"
    summary = json.loads(path.read_text())
    del summary["policy_fingerprint"]
    path.write_text(json.dumps(summary))
    assert outdated(run) == []
    path.write_text(json.dumps(summary | {"env_steps": 7}))
    assert [path.name for path in outdated(run)] == ["evaluation"]


@pytest.mark.integration
def test_the_command_makes_anew_what_it_can(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = (run / "planner" / "summary.json").read_bytes()
    train_on(run)
    assert run_cli("report", run) == 0
    summary = json.loads((run / "evaluation" / "summary.json").read_text())
    assert summary["policy_fingerprint"] == load_policy(run).fingerprint
    assert (summary["split"], summary["guidance"], summary["episodes"]) == ("validation", "map", 2)
    assert (run / "planner" / "summary.json").read_bytes() == kept
    assert [path.name for path in outdated(run)] == ["elsewhere"]
    said = "".join(capsys.readouterr().err.split())  # a long path is broken anywhere
    assert "elsewhereisleftout" in said


@pytest.mark.integration
def test_a_run_of_several_places_is_evaluated_in_each(run: Path) -> None:
    config = json.loads((run / "config.json").read_text())
    config["settings"]["scenario"] = config["scenario"] = "clutter,rooms"
    (run / "config.json").write_text(json.dumps(config))
    for name in ("evaluation", "elsewhere", "planner"):
        shutil.rmtree(run / name)
    assert run_cli("report", run, "--episodes", "2") == 0
    folders = {path.parent.name: json.loads(path.read_text()) for path in run.glob("*/summary.json")}
    assert {name: told["scenario"] for name, told in folders.items()} == {
        "evaluation-clutter": "clutter",
        "evaluation-rooms": "rooms",
    }
    page = (run / "report.html").read_text()
    assert all(name in page for name in folders)
    shutil.rmtree(run / "evaluation-rooms")
    assert run_cli("report", run, "--episodes", "2") == 0
    assert (run / "evaluation-rooms" / "summary.json").exists(), "a report that was killed goes on"
    train_on(run)
    assert run_cli("report", run) == 0
    assert outdated(run) == [], "all of them are made anew"
    assert _place_of(run).scenario == "clutter", "adrl view RUN begins in the first"


def test_a_report_of_what_is_evaluated_needs_no_map(run: Path) -> None:
    """It may have been moved."""
    config = json.loads((run / "config.json").read_text())
    config["settings"] = {"map": "gone.yaml"}
    (run / "config.json").write_text(json.dumps(config))
    assert run_cli("report", run) == 0
