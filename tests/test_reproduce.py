"""adrl reproduce: real runs of seconds, kept results, and nothing done twice."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adrl.agents.config import Td3Config, TrainConfig
from adrl.baselines.tuned import TUNED
from adrl.comparison.config import CompareConfig
from adrl.comparison.reproduce import preset, reproduce
from adrl.report import reproduction as kept
from adrl.report.reported import METHODS
from adrl.report.reproduction_tables import write_report
from small_run import contents, run_cli

LEARNER = TrainConfig(
    steps=2048,
    start_steps=512,
    pretrain_updates=8,
    log_interval_steps=256,
    eval_interval_steps=1024,
    td3=Td3Config(widths=(16, 16)),
)


def tiny(scenario: str, methods: str) -> CompareConfig:
    """A preset's comparison with sizes of seconds."""
    return replace(
        preset("quick")[scenario],
        methods=methods,
        seeds=1,
        episodes=4,
        num_envs=32,
        task_pool=4,
        demonstration_steps=1024,
        validation_episodes=2,
        learner=LEARNER,
    )


@pytest.mark.parametrize(("name", "seeds"), [("quick", 2), ("full", 10)])
def test_presets_have_the_papers_methods_and_equal_budgets(name: str, seeds: int) -> None:
    configs = preset(name)
    assert list(configs) == ["clutter", "complex"]
    for scenario, config in configs.items():
        assert config.load().name == scenario
        assert config.method_names == METHODS
        assert config.seeds == seeds
        assert config.guidance_names == ("goal", "replan"), "each method without and with the replanner"
        assert config.guidance == "goal", "the replanner is off in training"
    (steps,) = {config.learner.steps for config in configs.values()}
    assert steps is not None
    rollout = configs["clutter"].num_envs * TUNED["PPO"].get("n_steps", 32)
    assert steps % rollout == 0, "PPO ends where the others do"


def test_one_preset_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options in ((), ("--quick", "--full")):
        assert run_cli("reproduce", *options, "--out", tmp_path / "out") == 2
        assert "one of --quick and --full" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.integration
def test_what_is_kept_is_what_was_run(tmp_path: Path) -> None:
    """Two scenarios, an imitating method and a baseline of others; a second call repeats no run."""
    comparisons = {name: tiny(name, "adrl,sb3-ppo") for name in ("clutter", "complex")}
    told: list[tuple[int, int, int]] = []
    out = tmp_path / "results"
    failed = reproduce(comparisons, tmp_path, out, name="quick", on_change=lambda *state: told.append(state))
    assert failed == {}
    assert told[-1] == (6, 0, 6)
    assert [state[0] for state in told] == sorted(state[0] for state in told), "the bar never goes back"
    results = kept.load(out)
    assert set(results.curves) == {(s, m, 0) for s in comparisons for m in ("adrl", "sb3-ppo")}
    for (scenario, method, _), curve in results.curves.items():
        assert curve["env_steps"][-1] == 2048
        assert np.isfinite(curve["q_mean"][-1])
        assert np.isfinite(curve["success"]).sum() == 2
        for guidance in ("goal", "replan"):
            (run,) = results.outcomes(scenario, method, guidance).values()
            assert results.values(scenario, method, guidance, "success") == [run["success"].mean()]
    job = tmp_path / "clutter" / "adrl-s0"
    log = [json.loads(line) for line in (job / "metrics.jsonl").read_text().splitlines()]
    curve = results.curves["clutter", "adrl", 0]
    np.testing.assert_allclose(curve["episode"], [row["episode"] for row in log])
    assert not list(tmp_path.glob("*/runs/*/checkpoint")), "checkpoints are not kept"
    write_report(out)
    assert (out / "fig7-routes-complex-replan.pdf").exists()

    before = {scenario: contents(tmp_path / scenario / "adrl-s0") for scenario in comparisons}
    tables = (out / "tables.json").read_bytes()
    reproduce(comparisons, tmp_path, out, name="quick")
    write_report(out)
    assert {scenario: contents(tmp_path / scenario / "adrl-s0") for scenario in comparisons} == before
    assert (out / "tables.json").read_bytes() == tables, "equal results, equal tables"
