"""What was tuned is what is used."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

from adrl.baselines import SB3_METHODS
from adrl.baselines.tuned import TUNED

DOCS = Path(__file__).resolve().parents[2] / "docs"
STUDIES = json.loads((DOCS / "results" / "tuning.json").read_text())["studies"]


@pytest.mark.parametrize("method", STUDIES)
def test_the_constants_are_the_best_trials(method: str) -> None:
    study = STUDIES[method]
    best = max(study["trials"], key=lambda entry: entry["value"])
    assert study["best"] == best
    used = TUNED[SB3_METHODS[method].algorithm]
    rounded = {
        name: pytest.approx(value, rel=0.01) if isinstance(value, float) else value
        for name, value in best["params"].items()
    }
    assert used == rounded


def test_nothing_else_is_tuned() -> None:
    tuned = {SB3_METHODS[method].algorithm for method in STUDIES}
    assert all(TUNED[algorithm] == {} for algorithm in TUNED.keys() - tuned)


@pytest.mark.skipif(importlib.util.find_spec("optuna") is None, reason="Optuna is not installed")
def test_a_study_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials of before are neither repeated nor forgotten; other settings start afresh."""
    spec = importlib.util.spec_from_file_location("tune_baselines", DOCS / "tune_baselines.py")
    assert spec is not None
    assert spec.loader is not None
    script: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    tried: list[dict[str, Any]] = []

    def objective(options: Any, constants: dict[str, Any]) -> float:
        tried.append(constants)
        return constants["learning_rate"]

    monkeypatch.setattr(script, "objective", objective)
    path = tmp_path / "tuning.json"
    script.tune(script.Options(method="sb3-ppo", trials=3), path)
    first = json.loads(path.read_text())["studies"]["sb3-ppo"]["trials"]
    assert first[0]["params"] == script.FIRST["sb3-ppo"]
    best = script.tune(script.Options(method="sb3-ppo", trials=5), path)
    trials = json.loads(path.read_text())["studies"]["sb3-ppo"]["trials"]
    assert (trials[:3], len(trials), len(tried)) == (first, 5, 5)
    assert best["value"] == max(entry["value"] for entry in trials)
    script.tune(script.Options(method="sb3-sac", trials=1), path)
    script.tune(script.Options(method="sb3-ppo", trials=1, steps=8), path)
    studies = json.loads(path.read_text())["studies"]
    assert [len(studies[name]["trials"]) for name in ("sb3-ppo", "sb3-sac")] == [1, 1]
