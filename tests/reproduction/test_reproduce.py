"""adrl reproduce: real runs of seconds, kept results, and nothing done twice."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adrl.agents.config import Td3Config, TrainConfig
from adrl.baselines.tuned import TUNED
from adrl.commands import reproduce as commands
from adrl.comparison.config import CompareConfig
from adrl.errors import ConfigError, UnknownName
from adrl.reproduction import calls
from adrl.reproduction import results as kept
from adrl.reproduction.calls import Call
from adrl.reproduction.experiments import GAZEBO_METHODS, chosen, preset
from adrl.reproduction.reported import METHODS
from adrl.reproduction.reproduce import reproduce
from adrl.reproduction.tables import write_report
from small_run import contents, run_cli

DATA = (".parquet", "run.json")
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
    assert list(configs) == ["clutter", "hall", "complex", "complex-jackal", "gazebo"]
    in_gazebo = configs.pop("gazebo")
    assert (in_gazebo.env, in_gazebo.load().name) == ("gazebo", "hall")
    assert in_gazebo.method_names == tuple(GAZEBO_METHODS.split(","))
    assert in_gazebo.seeds == min(seeds, 5)
    for place, config in configs.items():
        assert config.load().name == place.partition("-")[0]
        assert config.method_names == METHODS
        assert (config.seeds, config.env) == (seeds, "native")
        fast = place == "complex-jackal"
        assert config.robot == ("jackal" if fast else "diffbot")
        assert config.guidance == ("map" if fast else "goal"), "the replanner is off in training"
        assert config.guidance_names == (config.guidance, "replan"), "each method without it and with it"
        steps = config.learner.steps
        assert steps is not None
        rollout = config.num_envs * TUNED["PPO"].get("n_steps", 32)
        assert steps % rollout == 0, "PPO ends where the others do"


def test_a_place_without_its_simulator_is_left_out_or_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ADRL_GAZEBO", str(tmp_path))
    every = preset("quick")
    assert list(chosen("", every)) == ["clutter", "hall", "complex", "complex-jackal"]
    assert list(chosen("complex, hall,complex", every)) == ["complex", "hall"]
    with pytest.raises(ConfigError, match="scripts/gazebo-chroot"):
        chosen("hall,gazebo", every)
    with pytest.raises(UnknownName, match="did you mean 'hall'"):
        chosen("hal", every)


def test_the_places_that_are_not_run_are_missing_in_the_results(tmp_path: Path) -> None:
    """A part of them is a part of the whole: a later call for another part keeps it."""
    comparisons = preset("quick")
    results = tmp_path / "results"
    reproduce(comparisons, tmp_path / "out", results, name="quick", only=())
    about = kept.read_about(results)
    assert list(about["scenarios"]) == list(comparisons)
    assert about["scenarios"]["gazebo"]["env"] == "gazebo"
    assert about["scenarios"]["complex-jackal"]["scenario"] == "complex"


def test_one_preset_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options in ((), ("--quick", "--full")):
        assert run_cli("reproduce", *options, "--out", tmp_path / "out") == 2
        assert "one of --quick and --full" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_call_is_recorded_while_its_jobs_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """The record is there before the end, so that a kill leaves it; a call that runs nothing leaves none."""
    clock = [100.0]
    monkeypatch.setattr(calls.time, "monotonic", lambda: clock[0])
    written: list[dict[str, Any]] = []

    def wait(seconds: float, ended: int, running: int) -> None:
        clock[0] += seconds
        call.tell(ended, running)

    call = Call(written.append, cores=2)
    wait(5.0, 0, 0)
    call.close()
    assert written == [], "nothing ran"
    wait(1.0, 0, 2)
    assert [(r["wall_s"], r["jobs"]) for r in written] == [(6.0, 0)]
    wait(4.0, 0, 2)
    assert len(written) == 1, "not at every look"
    wait(2.0, 1, 2)
    assert (written[-1]["wall_s"], written[-1]["jobs"]) == (12.0, 1), "a job has ended"
    wait(calls.INTERVAL_S, 1, 1)
    assert written[-1]["wall_s"] == 12.0 + calls.INTERVAL_S, "a long job"
    clock[0] += 3.0
    call.close()
    assert written[-1]["wall_s"] == 15.0 + calls.INTERVAL_S
    assert written[-1]["cores"] == 2
    assert {"python", "jax", "numpy", "adrl"} <= written[-1]["versions"].keys()


def test_the_commit_is_that_of_the_packages_own_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Named when files differ from it; a package that lies untracked in another's repository has none."""

    def git(*arguments: str) -> str:
        identity = ("-c", "user.name=nobody", "-c", "user.email=nobody@localhost")
        done = subprocess.run(
            ["git", *identity, *arguments], cwd=tmp_path, check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    package = tmp_path / "adrl" / "__init__.py"
    package.parent.mkdir()
    package.write_text("")
    monkeypatch.setattr(calls.adrl, "__file__", str(package))
    assert calls.commit() is None, "no repository"
    git("init", "--quiet")
    (tmp_path / "other").write_text("")
    git("add", "other")
    git("commit", "--quiet", "-m", "first")
    assert calls.commit() is None, "not of this repository"
    git("add", "adrl")
    git("commit", "--quiet", "-m", "second")
    assert calls.commit() == git("rev-parse", "HEAD")
    package.write_text("changed = True\n")
    assert calls.commit() == git("rev-parse", "HEAD") + "-dirty"


@pytest.mark.usefixtures("hasty_compiler")
@pytest.mark.slow
@pytest.mark.integration
def test_what_is_kept_is_what_was_run(tmp_path: Path) -> None:
    """Two scenarios, an imitating method, a baseline of others, three planners; a second call repeats no run."""
    comparisons = {name: tiny(name, "adrl,sb3-ppo") for name in ("clutter", "complex")}
    told: list[tuple[int, int, int]] = []
    out = tmp_path / "results"
    failed = reproduce(comparisons, tmp_path, out, name="quick", on_change=lambda *state: told.append(state))
    assert failed == {}
    assert told[-1] == (10, 0, 10)
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

    (call,) = results.about["calls"]
    assert call["jobs"] == 10
    assert call["wall_s"] > sum(curve["wall_s"][-1] for curve in results.curves.values()) / call["cores"]

    before = contents(out)
    about = (out / "about.json").read_bytes()
    tables = (out / "tables.json").read_bytes()
    reproduce(comparisons, tmp_path, out, name="quick")
    write_report(out)
    after = contents(out)
    assert {path: after[path] for path in before if path.endswith(DATA)} == {
        path: before[path] for path in before if path.endswith(DATA)
    }
    assert (out / "tables.json").read_bytes() == tables, "equal results, equal tables"
    assert (out / "about.json").read_bytes() == about, "a call that runs nothing leaves no record"


@pytest.mark.usefixtures("hasty_compiler")
@pytest.mark.slow
@pytest.mark.integration
def test_the_kept_files_alone_suffice_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On another machine, without the folder of the runs, only what is missing is run, and the tables are whole."""
    results, (first, second) = tmp_path / "results", (tmp_path / "first", tmp_path / "second")
    one = tiny("clutter", "td3,sb3-ppo")
    two = replace(one, seeds=2)
    monkeypatch.setattr(commands, "preset", lambda _: {"clutter": two})
    assert run_cli("reproduce", "--quick", "--results", results, "--tables-only") == 2, "nothing has ended"

    assert reproduce({"clutter": one}, first, results, name="quick") == {}
    shutil.rmtree(first)
    ended = {job: contents(results / "clutter" / job) for job in ("astar-dwa", "td3-s0", "sb3-ppo-s0")}

    assert run_cli("reproduce", "--quick", "--out", second, "--results", results) == 0
    assert {path.parent.name for path in second.glob("clutter/*/summary.json")} == {"td3-s1", "sb3-ppo-s1"}
    assert {job: contents(results / "clutter" / job) for job in ended} == ended
    whole = kept.load(results)
    assert [call["jobs"] for call in whole.about["calls"]] == [5, 2], "that of the call before stays"
    assert whole.missing == {"clutter": []}
    assert [whole.seeds("clutter", method) for method in ("td3", "sb3-ppo")] == [2, 2]
    assert "not in it yet" not in (results / "README.md").read_text()

    page = (results / "README.md").read_bytes()
    shutil.rmtree(second)
    (results / "README.md").unlink()
    assert run_cli("reproduce", "--quick", "--out", second, "--results", results, "--tables-only") == 0
    assert (results / "README.md").read_bytes() == page
    assert not second.exists(), "nothing was run"
    other = {"clutter": replace(two, episodes=5)}
    with pytest.raises(ConfigError, match="episodes: 4 there, 5 here"):
        reproduce(other, second, results, name="quick")
