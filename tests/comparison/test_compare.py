"""adrl compare: the order of its jobs, its numbers, and what it does when it is stopped and asked again."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from adrl.agents import checkpoint
from adrl.agents.config import Td3Config, TrainConfig
from adrl.agents.methods import METHODS
from adrl.baselines import SB3_METHODS
from adrl.comparison.compare import claim, compare, require_same
from adrl.comparison.config import DRIVING, CompareConfig, differences, from_document
from adrl.comparison.jobs import Job, all_jobs, run_job
from adrl.comparison.pool import cache_path, log_path, run_all
from adrl.comparison.results import Evaluated, markdown, method_rows, read_runs
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.errors import AdrlError, ConfigError, UnknownName
from adrl.evaluation.metrics import SAMPLES, Episodes
from adrl.evaluation.results import read_episodes
from adrl.evaluation.statistics import probability_of_improvement, seed_iqm, seed_mean
from adrl.export.onnx_graph import to_onnx
from adrl.runs import train
from adrl.types import LidarConfig, RobotConfig
from small_run import contents, run_cli
from waiting import wait_until

SIZES = (
    *("--steps", "2048", "--demonstration-steps", "1024", "--task-pool", "8", "--num-envs", "32"),
    *("--pretrain-updates", "8", "--critic-warmup-updates", "8", "--start-steps", "512"),
    *("--td3.widths", "16", "16", "--log-interval-steps", "1024", "--eval-interval-steps", "1024"),
    *("--validation-episodes", "2", "--episodes", "6"),
)
BUDGET = TrainConfig(steps=1000)
GIVE_UP_S = 250.0
"""No law: a busy machine takes its time, and the runner ends a test after 300 s."""
METRICS = ("success", "collision", "timeout")


class TestConfig:
    def test_jobs_are_seed_major_behind_the_reference(self) -> None:
        """All methods with one seed before any with the next: a slow hour hits them alike."""
        config = CompareConfig(methods="adrl,td3", seeds=3, learner=replace(BUDGET, seed=5))
        reference, *jobs = all_jobs(config)
        assert (reference.name, reference.seed) == ("astar-dwa", None)
        assert [job.name for job in jobs] == [f"{m}-s{s}" for s in (5, 6, 7) for m in ("adrl", "td3")]

    def test_methods_and_guidance_are_listed_once(self) -> None:
        assert CompareConfig(methods="td3, adrl,td3").method_names == ("td3", "adrl")
        assert CompareConfig(methods="all").method_names == tuple(METHODS)
        assert CompareConfig(methods="sb3-td3,all").method_names == ("sb3-td3", *METHODS)
        assert CompareConfig(eval_guidance="map,goal,map").guidance_names == ("map", "goal")
        assert CompareConfig(guidance="map").guidance_names == ("map",)
        placed = CompareConfig(guidance="map,goal@clutter", scenario="clutter,complex", robot="any")
        assert placed.guidance_names == ("map", "goal")

    def test_all_methods_share_the_options_of_the_run(self) -> None:
        config = CompareConfig(methods="all", scenario="complex", guidance="map", num_envs=8, learner=BUDGET)
        for method in (*METHODS, *SB3_METHODS):
            run = config.run(method, 4, Path("here"))
            assert (run.scenario, run.guidance, run.num_envs, run.learner.steps) == (
                "complex",
                "map",
                8,
                1000,
            )
            assert (run.learner.seed, run.out, run.resume) == (4, Path("here"), True)
            assert run.method == (method if method in METHODS else "td3")

    @pytest.mark.parametrize("given", [{"expert": "slow:0.5"}, {"dataset": Path("drives")}])
    @pytest.mark.parametrize("literal", [False, True])
    def test_one_expert_for_all_whom_it_concerns(self, given: dict[str, Any], literal: bool) -> None:
        """S of rl-reward, which does not imitate, is measured against it, too; td3 and SB3 know of none."""
        config = CompareConfig(methods="all", paper_literal=literal, learner=BUDGET, **given)
        ((option, value),) = given.items()
        left = {"expert": "perfect", "dataset": None}[option]
        for method in (*METHODS, *SB3_METHODS):
            run = config.run(method, 0, Path("here"))
            learner = run.resolved()
            concerned = learner.schedule.imitates or learner.needs_probe
            assert getattr(run, option) == (value if concerned else left), method
        expected = left if literal else value  # S as printed has no bounds to measure
        assert getattr(config.run("rl-reward", 0, Path("here")), option) == expected
        assert getattr(config.run("td3", 0, Path("here")), option) == left

    def test_rounds_of_demonstrations_are_for_those_who_imitate(self) -> None:
        config = CompareConfig(methods="all,sb3-sac", demonstration_rounds=3, learner=BUDGET)
        for method in config.method_names:
            run = config.run(method, 0, Path("here"))
            assert run.demonstration_rounds == (3 if run.resolved().schedule.imitates else 0), method
        assert config.run("adrl", 0, Path("here")).demonstration_rounds == 3
        assert config.run("td3", 0, Path("here")).demonstration_rounds == 0

    @pytest.mark.parametrize(
        ("options", "error"),
        [
            ({"methods": "adlr"}, UnknownName),
            ({"methods": " , "}, ConfigError),
            ({"guidance": ","}, ConfigError),
            ({"eval_guidance": ","}, ConfigError),
            ({"routes": -1}, ConfigError),
            ({"eval_guidance": "gaol"}, UnknownName),
            ({"guidance": "gaol", "eval_guidance": "map"}, UnknownName),
            ({"guidance": "map,gaol"}, UnknownName),
            ({"seeds": 0}, ConfigError),
            ({"episodes": 0}, ConfigError),
            ({"workers": -1}, ConfigError),
            ({"env": "gazebo", "methods": "td3,sb3-sac"}, ConfigError),
        ],
    )
    def test_bad_options_are_refused(self, options: dict[str, Any], error: type[AdrlError]) -> None:
        with pytest.raises(error):
            CompareConfig(**options)

    def test_a_run_without_an_end_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match="--max-seconds"):
            compare(CompareConfig(out=tmp_path / "out"))
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize(
        "config",
        [
            CompareConfig(),
            CompareConfig(
                methods="td3",
                map=Path("map.yaml"),
                robot=RobotConfig(
                    name="box",
                    radius_m=None,
                    footprint_m=((-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1)),
                    lidar=LidarConfig(num_beams=7),
                ),
                learner=TrainConfig(max_seconds=1.5, td3=Td3Config(widths=(8,)), exploration_std=(0.1, 0.2)),
            ),
        ],
    )
    def test_what_a_worker_reads_is_what_was_asked_for(self, config: CompareConfig) -> None:
        assert from_document(json.loads(json.dumps(config.document()))) == config

    def test_settings_leave_out_what_may_be_added(self) -> None:
        config = CompareConfig(methods="td3", seeds=2, learner=BUDGET)
        more = replace(config, methods="all", seeds=4, workers=1, learner=replace(BUDGET, seed=9))
        assert differences(config.settings(), more.settings()) == []
        assert differences(config.settings(), replace(config, scenario="clutter").settings()) == []
        other = replace(config, episodes=7, learner=replace(BUDGET, td3=Td3Config(gamma=0.9)))
        lines = differences(config.settings(), other.settings())
        assert lines == ["learner.td3.gamma: 0.98 there, 0.9 here", "episodes: 500 there, 7 here"]


def fake_runs(method: str, successes: list[float], seconds: list[float]) -> list[Evaluated]:
    summary = {"guidance": "goal", **dict.fromkeys(("collision", "timeout"), 0.0), "spl": 0.5}
    summary |= {"distance_m": None, "time_s": 4.0, "optimality": 1.1}
    summary |= {"train_seconds": 60.0, "env_steps": 10, "gradient_updates": 20}
    return [
        Evaluated(method, seed, summary | {"success": success}, to_90, {})
        for seed, (success, to_90) in enumerate(zip(successes, seconds, strict=True))
    ]


class TestRows:
    def test_the_seed_is_the_unit(self) -> None:
        ours, theirs = [0.9, 0.95, 1.0, 0.7], [0.8, 0.9, 0.95, 0.1]
        endless = [np.inf] * 4
        rows = method_rows(
            fake_runs("adrl", ours, [10.0, 30.0, 20.0, np.inf]) + fake_runs("td3", theirs, endless)
        )
        first, second = rows
        for row, scores in ((first, ours), (second, theirs)):
            for name, interval in (("success", seed_mean(scores)), ("success_iqm", seed_iqm(scores))):
                assert [row[name + end] for end in ("", "_low", "_high")] == list(interval)
            assert (row["seeds"], row["success_worst"]) == (4, min(scores))
        expected = probability_of_improvement(ours, theirs)
        assert [second["improvement" + end] for end in ("", "_low", "_high")] == list(expected)
        assert first["improvement"] is None, "a method is not compared with itself"
        assert (first["seconds_to_90"], first["seeds_to_90"]) == (25.0, 3)
        assert (second["seconds_to_90"], second["seeds_to_90"]) == (None, 0)
        assert second["distance_m"] is None
        json.dumps(rows, allow_nan=False)

    def test_never_reaching_90_and_never_measuring_it_look_different(self) -> None:
        never = method_rows(fake_runs("td3", [0.1, 0.2], [np.inf, np.inf]))
        unknown = method_rows(fake_runs("td3", [0.1, 0.2], [np.nan, np.nan]))
        assert " >budget " in markdown(never, "title")
        assert ">budget" not in markdown(unknown, "title")

    def test_among_people_a_method_is_told_by_what_they_had_of_it(self, tmp_path: Path) -> None:
        config = CompareConfig(
            methods="td3", policies="orca", scenario="crowd", episodes=3, out=tmp_path / "out", learner=BUDGET
        )
        jobs = all_jobs(config)[:2]
        for job in jobs:
            run_job(config, job, 0.0)
        rows = method_rows(read_runs([config.out / job.name for job in jobs]))
        for row, job in zip(rows, jobs, strict=True):
            episodes = read_episodes(config.out / job.name / "episodes.parquet")
            assert row["at_fault"] == np.mean(np.asarray(episodes.at_fault))
            assert row["near_person_s"] == pytest.approx(np.mean(np.asarray(episodes.near_person_s)))
            assert row["lost_s"] == pytest.approx(np.mean(np.asarray(episodes.lost_s)[episodes.success]))
        assert "| at fault % |" in markdown(rows, "title")
        alone = method_rows(fake_runs("td3", [0.1, 0.2], [np.inf, np.inf]))
        assert "at_fault" not in alone[0]
        assert "at fault" not in markdown(alone, "title")


def start(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "adrl.cli", "compare", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True)


def workers_of(pid: int) -> list[int]:
    """Processes that this one started and that run."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody waited for is a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
    except FileNotFoundError:
        return True


@pytest.mark.usefixtures("hasty_compiler")
@pytest.mark.slow
@pytest.mark.integration
def test_a_stopped_comparison_leaves_checkpoints(tmp_path: Path) -> None:
    """Workers that train write one before they end, and none outlives the comparison."""
    out = tmp_path / "out"
    process = start("--methods", "adrl", "--seeds", 1, *SIZES, "--steps", 10_000_000, "--out", out)
    log = out / "runs" / "adrl-s0" / "metrics.jsonl"
    wait_until(lambda: log.exists() and log.stat().st_size > 0, GIVE_UP_S)
    workers = workers_of(process.pid)
    os.kill(process.pid, signal.SIGINT)
    assert process.wait(timeout=GIVE_UP_S) == 1
    assert workers
    assert all(map(gone, workers))
    assert checkpoint.exists(out / "runs" / "adrl-s0")
    assert "--resume goes on" in (out / "logs" / "adrl-s0.log").read_text()


@pytest.mark.usefixtures("hasty_compiler")
@pytest.mark.slow
@pytest.mark.integration
def test_a_killed_comparison_goes_on_without_repeating_anything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    options = ("--methods", "adrl,td3", "--seeds", 2, *SIZES, "--out", out)
    process = start(*options)
    wait_until(lambda: len(list(out.glob("*-s*/summary.json"))) >= 1, GIVE_UP_S)
    wait_until(lambda: bool(workers_of(process.pid)), GIVE_UP_S)
    workers = workers_of(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    wait_until(lambda: all(map(gone, workers)), GIVE_UP_S)  # a compilation in the way takes its time

    finished = [path.parent for path in out.glob("*/summary.json")]
    before = {folder: contents(folder) for folder in finished}
    assert 1 <= len(finished) < 5, "nothing was left to do"
    assert run_cli("compare", *options) == 0
    assert {folder: contents(folder) for folder in finished} == before
    names = {"adrl-s0", "td3-s0", "adrl-s1", "td3-s1", "astar-dwa"}
    assert {path.parent.name for path in out.glob("*/summary.json")} == names
    assert not list(out.rglob("*.tmp"))
    assert not (out / "cache").exists(), "compiled programs are the job's alone"

    whole = contents(out)
    assert run_cli("compare", *options, "--episodes", 5) == 2
    error = capsys.readouterr().err
    assert "episodes: 6 there, 5 here" in error
    assert contents(out) == whole, "a refusal touches nothing"
    check_results(out)
    assert json.loads((out / "results.json").read_text())["missing"] == []

    # On another machine: the small files alone, without the training runs.
    for folder in ("runs", "logs", "td3-s1"):
        shutil.rmtree(out / folder)
    kept = {path: contents(path) for path in out.glob("*/") if (path / "summary.json").exists()}
    assert run_cli("compare", *options) == 0
    assert [path.name for path in (out / "runs").iterdir()] == ["td3-s1"], "nothing else was trained"
    assert {path: contents(path) for path in kept} == kept
    check_results(out)
    assert json.loads((out / "results.json").read_text())["missing"] == []


def check_results(out: Path) -> None:
    """The tables hold what the episodes of each seed give."""
    rows = {row["method"]: row for row in json.loads((out / "results.json").read_text())["rows"]}
    table = pq.ParquetFile(out / "episodes.parquet").read()
    assert table.column_names[:3] == ["method", "seed", "guidance"]
    whose = np.array(table.column("method").to_pylist())
    seeds = np.array([-1 if seed is None else seed for seed in table.column("seed").to_pylist()])
    tasks = []
    for method in ("adrl", "td3"):
        runs = [Episodes.from_table(table.filter((whose == method) & (seeds == seed))) for seed in (0, 1)]
        tasks += [run.goal_xy_m for run in runs]
        for name in METRICS:
            expected = seed_mean([getattr(run, name).mean() for run in runs])
            assert [rows[method][name + end] for end in ("", "_low", "_high")] == pytest.approx(
                list(expected)
            )
        assert rows[method]["spl"] == pytest.approx(np.mean([SAMPLES["spl"](run).mean() for run in runs]))
        text = next(x for x in (out / "table.md").read_text().splitlines() if x.startswith(f"| {method} "))
        assert f"{100 * rows[method]['success']:.1f}" in text
        assert rows[method]["env_steps"] == 2048
    reference = Episodes.from_table(table.filter(whose == "astar-dwa"))
    assert rows["astar-dwa"]["success"] == reference.success.mean()
    assert all(np.array_equal(goals, reference.goal_xy_m) for goals in tasks), "all drive the same tasks"


@pytest.mark.usefixtures("hasty_compiler")
@pytest.mark.slow
@pytest.mark.integration
def test_a_failed_job_is_named_and_the_others_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, missing = tmp_path / "out", tmp_path / "no-such-dataset"
    options = ("--methods", "adrl,td3", "--seeds", 1, *SIZES, "--dataset", missing, "--out", out)
    assert run_cli("compare", *options) == 1
    shown = capsys.readouterr().err.replace("\n", "")
    assert "failed: adrl-s0" in shown
    assert str(missing) in (out / "logs" / "adrl-s0.log").read_text()
    results = json.loads((out / "results.json").read_text())
    assert [row["method"] for row in results["rows"]] == ["td3", "astar-dwa"]
    assert results["missing"] == ["adrl-s0"]
    assert "adrl-s0" in (out / "table.md").read_text()
    assert not (out / "cache").exists()


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.gazebo
def test_trainings_in_gazebo_are_compared(tmp_path: Path) -> None:
    """They keep no state: one without a result is begun anew, and what has ended is not run again."""
    out = tmp_path / "out"
    options = ("--env", "gazebo", "--methods", "td3", "--seeds", 1, *SIZES, "--num-envs", 4, "--out", out)
    assert run_cli("compare", *options, "--workers", 1) == 0
    about = json.loads((out / "td3-s0" / "config.json").read_text())
    assert about["environment"]["simulator"] == "gazebo"
    finished = contents(out / "td3-s0")
    assert run_cli("compare", *options, "--workers", 1) == 0
    assert contents(out / "td3-s0") == finished
    shutil.rmtree(out / "td3-s0")
    assert run_cli("compare", *options, "--workers", 1) == 0
    assert json.loads((out / "td3-s0" / "summary.json").read_text())["method"] == "td3"


class TestPoliciesOfOnesOwn:
    """Rows of policies that are not trained here."""

    def test_a_planner_also_drives_without_the_map_where_that_is_asked_for(self, tmp_path: Path) -> None:
        config = CompareConfig(
            methods="td3", policies="default,astar-pursuit", episodes=2, out=tmp_path / "out", learner=BUDGET
        )
        asked = replace(config, guidance="goal", eval_guidance="goal,replan")
        for job in all_jobs(asked)[:3]:
            run_job(asked, job, 0.0)
        runs = read_runs([asked.out / name for name in ("astar-dwa", "default", "astar-pursuit")])
        driven = [(run.method, run.summary["guidance"]) for run in runs]
        planners = [
            (name, guidance) for name in ("astar-dwa", "astar-pursuit") for guidance in ("map", "replan")
        ]
        own = ("default", find_policy("default", {}).guidance)
        assert driven == [*planners[:2], own, *planners[2:]], "a policy drives as it says"

    def test_they_are_rows_beside_the_planner(self, tmp_path: Path) -> None:
        onnx = tmp_path / "mine.onnx"
        onnx.write_bytes(to_onnx(load_policy(resolve_policy("diffbot"))))
        config = CompareConfig(
            methods="td3", policies=f"default, {onnx}", episodes=2, out=tmp_path / "out", learner=BUDGET
        )
        jobs = [job for job in all_jobs(config) if job.seed is None]
        assert [job.method for job in jobs] == ["astar-dwa", "default", str(onnx)]
        assert len({job.name for job in jobs}) == 3
        for job in jobs:
            run_job(config, job, 0.0)
        rows = method_rows(read_runs([config.out / job.name for job in jobs]))
        assert [row["method"] for row in rows] == ["astar-dwa", "default", "mine.onnx"]
        assert rows[1]["success"] == rows[2]["success"]
        assert [row["seeds"] for row in rows] == [None] * 3
        table = markdown(rows, config.title())
        assert "mine.onnx | map, as it is" in table
        assert "astar-dwa | map, planner" in table

    def test_another_policy_under_the_same_name_is_not_mixed_in(self, tmp_path: Path) -> None:
        claim(CompareConfig(methods="td3", learner=BUDGET, policies="default"), tmp_path)
        claim(CompareConfig(methods="adrl", learner=BUDGET, policies="jackal"), tmp_path)
        path = tmp_path / "settings.json"
        path.write_text(path.read_text().replace('"policy_fingerprint": "', '"policy_fingerprint": "0'))
        with pytest.raises(ConfigError, match="policy_fingerprint"):
            claim(CompareConfig(methods="td3", learner=BUDGET, policies="default"), tmp_path)

    def test_no_two_jobs_share_a_folder(self) -> None:
        called = ["a/b", "a-b", "a//b", "a b", "my:obj", "td3-s0", "./td3-s0", "default", "astar-dwa"]
        jobs = [*(Job(policy, None) for policy in called), Job("td3", 0), Job("a/b", None)]
        assert len({job.name for job in jobs}) == len(set(jobs)) == len(called) + 1
        assert [Job(name, None).name for name in ("default", "a-b")] == ["default", "a-b"]

    def test_names_are_told_apart(self, tmp_path: Path) -> None:
        for folder in ("a", "b"):
            (tmp_path / folder).mkdir()
            (tmp_path / folder / "mine.onnx").write_bytes(to_onnx(load_policy(resolve_policy("diffbot"))))
        config = CompareConfig(policies=f"{tmp_path}/a/mine.onnx,{tmp_path}/b/mine.onnx")
        with pytest.raises(ConfigError, match=r"both called mine\.onnx"):
            config.method_settings()
        with pytest.raises(UnknownName, match="did you mean 'default'"):
            CompareConfig(policies="defaut").method_settings()


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ConfigError, match="something else"):
        compare(CompareConfig(learner=BUDGET, out=tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def no_work(config: CompareConfig, jobs: Any, tell: Any) -> list[Any]:
    return []


def test_methods_may_be_added_but_not_become_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A new version's method of the same name is another method: its results do not mix with the old ones."""
    monkeypatch.setattr("adrl.comparison.compare.run_all", no_work)
    config = CompareConfig(methods="adrl,td3bc", learner=BUDGET, out=tmp_path / "out")
    compare(config)
    settings = tmp_path / "out" / "settings.json"
    stored = json.loads(settings.read_text())["methods"]
    assert stored["td3bc"]["schedule"]["lambda_max"] == 0.2
    assert "seed" not in stored["adrl"]
    more = replace(config, methods="td3,adrl", learner=replace(BUDGET, seed=3))
    compare(more)
    assert list(json.loads(settings.read_text())["methods"]) == ["adrl", "td3bc", "td3"]

    whole = contents(tmp_path)
    monkeypatch.setitem(METHODS, "td3bc", lambda learner: replace(METHODS["bc"](learner), failure_share=0.3))
    with pytest.raises(ConfigError, match=r"td3bc\.failure_share: 0\.03 there, 0\.3 here"):
        compare(config)
    assert contents(tmp_path) == whole, "a refusal touches nothing"
    compare(more)  # whoever does not ask for it goes on


def test_results_that_were_driven_otherwise_are_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seeds on both sides of a change of planners or waypoints do not compare, whatever the options."""
    monkeypatch.setattr("adrl.comparison.compare.run_all", no_work)
    config = CompareConfig(methods="adrl,td3", learner=BUDGET, out=tmp_path / "out")
    compare(config)
    path = tmp_path / "out" / "settings.json"
    content = json.loads(path.read_text())
    assert content["driving"] == DRIVING
    compare(config)
    without = {name: value for name, value in content.items() if name != "driving"}
    for before, number in ((without, 1), (content | {"driving": DRIVING + 1}, DRIVING + 1)):
        path.write_text(json.dumps(before))
        whole = contents(tmp_path)
        for asked in (config, replace(config, methods="rl-bc"), replace(config, seeds=20)):
            with pytest.raises(ConfigError, match=rf"driving {number} there.*--out") as refused:
                compare(asked)
            assert "\n" not in str(refused.value)
            assert contents(tmp_path) == whole, "a refusal touches nothing"
        require_same(config, config.out)  # tables of what is complete
        with pytest.raises(ConfigError, match="episodes"):
            require_same(replace(config, episodes=7), config.out)


@pytest.mark.parametrize("expert", ["slow:0.5", "few:2"])
def test_s_of_every_method_has_the_bounds_of_the_same_expert(
    expert: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eq 13 of a method that does not imitate: what the comparison's expert earns, or its drives where they are all."""
    told: dict[str, Any] = {}
    monkeypatch.setattr("adrl.agents.train.train", lambda *_, **given: told.update(given))
    config = CompareConfig(
        methods="adrl,rl-reward",
        expert=expert,
        num_envs=8,
        task_pool=4,
        demonstration_steps=64,
        learner=BUDGET,
    )
    bounds = []
    for method in config.method_names:
        run = config.run(method, 0, tmp_path / method)
        train(run)
        learner = run.resolved()
        bounds.append(told["probe"].bounds(0.5, learner.td3.gamma, learner.reward))
        assert (told["demonstrations"] is not None) is learner.schedule.imitates, "they are not learned from"
    assert bounds[0] == bounds[1]


def workers_run(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    """Have the processes of jobs run this instead."""
    real = subprocess.Popen

    def popen(command: list[str], **options: Any) -> Any:
        return real([command[0], "-c", code], **options)

    monkeypatch.setattr(subprocess, "Popen", popen)


def test_each_job_compiles_into_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Empty at its start, also where a killed comparison left something, and gone at its end."""
    config = CompareConfig(methods="td3", seeds=2, learner=BUDGET, out=tmp_path / "out", workers=1)
    jobs = all_jobs(config)
    for job in jobs:
        cache_path(config, job).mkdir(parents=True)
        (cache_path(config, job) / "old").touch()
    looks_and_writes = (
        "import os, pathlib; folder = pathlib.Path(os.environ['JAX_COMPILATION_CACHE_DIR']); "
        "print(folder.exists(), folder); folder.mkdir(parents=True); (folder / 'new').touch()"
    )
    workers_run(monkeypatch, looks_and_writes)
    assert run_all(config, jobs, lambda ended, running: None) == jobs, "none wrote a result"
    for job in jobs:
        assert log_path(config, job).read_text() == f"False {cache_path(config, job)}\n"
    assert not (tmp_path / "out" / "cache").exists()


def test_jobs_that_share_compiled_programs_find_those_of_the_jobs_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing of an earlier comparison, and nothing is left."""
    config = CompareConfig(
        methods="td3", seeds=2, learner=BUDGET, out=tmp_path / "out", workers=1, shares_compiled=True
    )
    (tmp_path / "out" / "cache").mkdir(parents=True)
    (tmp_path / "out" / "cache" / "old").touch()
    looks_and_writes = (
        "import os, pathlib; folder = pathlib.Path(os.environ['JAX_COMPILATION_CACHE_DIR']); "
        "folder.mkdir(parents=True, exist_ok=True); print(len(list(folder.iterdir()))); "
        "(folder / str(os.getpid())).touch()"
    )
    workers_run(monkeypatch, looks_and_writes)
    jobs = all_jobs(config)
    run_all(config, jobs, lambda ended, running: None)
    assert [int(log_path(config, job).read_text()) for job in jobs] == list(range(len(jobs)))
    assert not (tmp_path / "out" / "cache").exists()
