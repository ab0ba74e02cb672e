"""The command line end to end, with small sizes."""

import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
import time
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adrl import registry
from adrl.agents.methods import METHODS
from adrl.baselines import SB3_METHODS
from adrl.baselines.planners import PLANNERS
from adrl.cli import COMMANDS, main
from adrl.commands.barn import BarnOptions
from adrl.commands.bench import (
    ActOptions,
    GazeboOptions,
    LearnOptions,
    Nav2Options,
    PlanOptions,
    Ros2Options,
    SimOptions,
)
from adrl.commands.calibrate import CalibrateOptions
from adrl.commands.collect import CollectOptions
from adrl.commands.compare import COMMON as COMPARE_COMMON
from adrl.commands.demo import DemoOptions
from adrl.commands.evaluate import EvaluateOptions
from adrl.commands.export import ExportOptions
from adrl.commands.gazebo import EvaluateOptions as GazeboEvaluateOptions
from adrl.commands.gazebo import ExportOptions as GazeboExportOptions
from adrl.commands.gazebo import FilmOptions, TransferOptions
from adrl.commands.gazebo_barn import GazeboBarnOptions
from adrl.commands.list import ListOptions
from adrl.commands.regret import RegretOptions
from adrl.commands.report import ReportOptions
from adrl.commands.reproduce import ReproduceOptions
from adrl.commands.robot import RobotOptions
from adrl.commands.run_options import parse_run
from adrl.commands.train import COMMON as TRAIN_COMMON
from adrl.commands.view import ViewOptions
from adrl.comparison.config import CompareConfig
from adrl.deploy.policy import SHIPPED
from adrl.evaluation.results import read_episodes
from adrl.evaluation.rollout import Rollout, rollout
from adrl.imitation.experts import EXPERTS
from adrl.integrations.ros.config import ControllerConfig, DriveConfig, SimConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards.weights import EXTRA_TERMS
from adrl.runs import RunConfig
from adrl.simulators import SIMULATORS
from adrl.types import GUIDANCE
from adrl.worlds import FAMILIES, ROBOTS, SCENARIOS
from small_run import TRAIN, finished_run, run_cli

OPTIONS: dict[str, Any] = {
    "demo": DemoOptions,
    "robot": RobotOptions,
    "view": ViewOptions,
    "train": RunConfig,
    "evaluate": EvaluateOptions,
    "collect": CollectOptions,
    "barn": BarnOptions,
    "compare": CompareConfig,
    "export": ExportOptions,
    "report": ReportOptions,
    "list": ListOptions,
    "gazebo evaluate": GazeboEvaluateOptions,
    "gazebo transfer": TransferOptions,
    "gazebo barn": GazeboBarnOptions,
    "gazebo film": FilmOptions,
    "gazebo export": GazeboExportOptions,
    "calibrate": CalibrateOptions,
    "regret": RegretOptions,
    "reproduce": ReproduceOptions,
    "bench sim": SimOptions,
    "bench plan": PlanOptions,
    "bench act": ActOptions,
    "bench learn": LearnOptions,
    "bench gazebo": GazeboOptions,
    "bench ros2": Ros2Options,
    "bench nav2": Nav2Options,
    "ros1 drive": DriveConfig,
    "ros1 sim": SimConfig,
    "ros2 controller": ControllerConfig,
    "ros2 drive": DriveConfig,
    "ros2 sim": SimConfig,
}
UNITS = {"m": r"\bm\b", "seconds": r"\bs\b", "start": r"\(m\).*\(rad\)", "goal": r"\(m\)"}
"""What the help of an option whose name ends so must say."""
SUPPRESSED = {
    "compare": {"method", "resume", "shares-compiled"},
    "export": {"policy"},
    "report": {"folder"},
    "calibrate": {"drives"},
    "robot": {"robot"},
    "view": {"run"},
}
"""Options that a command sets itself, or that are given without their name."""
METRICS = ("success", "collision", "timeout", "distance_m", "time_s", "optimality", "spl")
ABOUT = ("policy", "method", "robot", "scenario", "guidance", "split", "episodes")
TRAINING = ("train_seconds", "env_steps", "gradient_updates")


def adrl(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """adrl in a process of its own."""
    command = [sys.executable, "-m", "adrl.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=280, **options)


def explained(help_text: str) -> dict[str, str]:
    """What help says of each option, without its kind of value and its default."""
    options: dict[str, str] = {}
    name = ""
    for line in help_text.splitlines():
        content = re.sub(r"^-[a-z]( \S+)?, ", "", line.strip("│| "))  # the short form, as -h
        if re.match(r"--[a-z]", content):
            name = re.findall(r"--([\w.-]+)", content)[0]
            options[name] = re.sub(r"^(--[\w.-]+(, )?)+", "", content)
        elif content and name:
            options[name] += " " + content
        else:
            name = ""
    kind = r"^\s*((\{[^}]*\}|[A-Z]{3,}|\[[A-Z]{3,}|\.\.\.\]\])[|\s]*)*"
    return {
        name: re.sub(kind, "", re.sub(r"\((default|required).*", "", text)).strip()
        for name, text in options.items()
    }


@pytest.fixture
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_run(tmp_path_factory)


class TestHelp:
    def test_every_command_is_covered_here(self) -> None:
        assert {command.split()[0] for command in OPTIONS} == set(COMMANDS)

    @pytest.mark.parametrize("command", [*OPTIONS, "bench"])
    def test_help_exits_with_0(self, command: str, capsys: pytest.CaptureFixture[str]) -> None:
        assert run_cli(*command.split(), "--help") == 0
        assert f"usage: adrl {command}" in capsys.readouterr().out

    @pytest.mark.parametrize("command", OPTIONS)
    def test_every_option_is_explained_with_its_unit(
        self, command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("COLUMNS", "80")  # one column of boxes
        run_cli(*command.split(), "--help")
        shown = explained(capsys.readouterr().out)
        fields = {field.name.replace("_", "-") for field in dataclasses.fields(OPTIONS[command])}
        assert fields - {"learner", "encoder", "replanner"} - SUPPRESSED.get(command, set()) <= shown.keys()
        for name, text in shown.items():
            assert len(text) >= 10, f"adrl {command} --{name} is not explained"
            for ending, unit in UNITS.items():
                if name == ending or name.endswith(f"-{ending}"):
                    assert re.search(unit, text, re.DOTALL), f"adrl {command} --{name} names no unit: {text}"

    @pytest.mark.parametrize(("command", "common"), [("train", TRAIN_COMMON), ("compare", COMPARE_COMMON)])
    def test_the_common_options_come_first_and_the_others_in_groups(
        self,
        command: str,
        common: tuple[str, ...],
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setenv("COLUMNS", "80")  # one column of boxes
        assert run_cli(command, "--help") == 0
        lines = capsys.readouterr().out
        shown = re.findall(r"^\W{1,2}--([a-z][a-z-]*)|^\W{1,3}(\w+) options\W*$", lines, re.MULTILINE)
        first_group = next(i for i, (_, group) in enumerate(shown) if group)
        assert [name for name, _ in shown[:first_group]] == [name.replace("_", "-") for name in common]
        assert {"place", "expert", "learning", "records", "td3", "replanner"} <= {group for _, group in shown}

    def test_every_option_reaches_the_run(self) -> None:
        """Of the command's own, of the groups, of the learner and of its parts."""
        given = ("--seeds", "3", "--num-envs", "7", "--steps", "9")
        given += ("--td3.gamma", "0.9", "--exploration-std", "0", "1")
        config = parse_run(CompareConfig, given, "compare", "", COMPARE_COMMON)
        learner = config.learner
        assert (config.seeds, config.num_envs, learner.exploration_std) == (3, 7, (0.0, 1.0))
        assert (learner.steps, learner.td3.gamma) == (9, 0.9)
        assert learner.eval_interval_steps == CompareConfig().learner.eval_interval_steps
        assert parse_run(RunConfig, (), "train", "", TRAIN_COMMON) == RunConfig()
        assert parse_run(CompareConfig, (), "compare", "", COMPARE_COMMON) == CompareConfig()

    def test_alone_it_exits_with_2(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main([]) == 2
        assert main(["bench"]) == 2
        shown = capsys.readouterr().out
        assert all(f"  {name}  " in shown for name in COMMANDS)
        assert all(f"  {what} " in shown for what in ("sim", "plan", "act", "learn", "gazebo", "ros2"))

    def test_help_imports_no_heavy_module(self) -> None:
        program = (
            "import sys; from adrl.cli import main; code = main(['--help']); "
            "heavy = {'jax', 'gymnasium', 'numpy', 'tyro', 'matplotlib', 'scipy'} & set(sys.modules); "
            "sys.exit(code or ' '.join(heavy) or 0)"
        )
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr) == (0, "")

    def test_list_names_every_registry_entry(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["list"]) == 0
        named = {line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  ")}
        assert named == {
            *(
                *ROBOTS,
                *FAMILIES,
                *SCENARIOS,
                *METHODS,
                *SB3_METHODS,
                *EXPERTS,
                *EXTRA_TERMS,
                *GUIDANCE,
                *SIMULATORS,
                *PLANNERS,
                *SHIPPED,
            )
        }

    def test_list_names_what_installed_packages_offer(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        kinds = ("robots", "scenarios", "methods", "reward_terms", "policies")
        points = [EntryPoint(f"my-{kind}", f"nowhere:{kind}", f"adrl.{kind}") for kind in kinds]
        monkeypatch.setattr(
            registry, "entry_points", lambda *, group: [point for point in points if point.group == group]
        )
        assert main(["list"]) == 0
        shown = capsys.readouterr().out.splitlines()
        for kind in kinds:
            assert f"  my-{kind:<17} plug-in of nowhere:{kind}" in shown

    def test_version(self, capsys: pytest.CaptureFixture[str]) -> None:
        from adrl import __version__

        assert main(["--version"]) == 0
        assert capsys.readouterr().out.strip() == __version__


class TestTrain:
    def test_the_run_folder_is_complete(self, run: Path) -> None:
        files = {"config.json", "versions.json", "metrics.jsonl", "policy.safetensors", "checkpoint", "tb"}
        assert {path.name for path in run.iterdir()} == files
        assert [path.name for path in (run / "checkpoint").iterdir()] == ["000000004096"]
        assert list((run / "tb").iterdir())
        config = json.loads((run / "config.json").read_text())
        assert (config["method"], config["scenario"], config["env_steps"]) == ("adrl", "clutter", 4096)
        assert config["settings"]["learner"]["steps"] == 4096
        versions = json.loads((run / "versions.json").read_text())
        assert {"python", "adrl", "numpy", "jax"} <= versions.keys()
        assert versions["planner"].startswith("A*+DWA: ")
        assert json.loads((run / "config.json").read_text())["environment"]["planner"] == "dwa"

    def test_metrics_come_at_every_interval(self, run: Path) -> None:
        rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
        assert [row["env_steps"] for row in rows] == [1024, 2048, 3072, 4096]
        keys = ("wall_s", "updates", "episode", "S", "alpha", "lambda_bc", "q_mean", "return_mean")
        assert all({*keys, "expert_fraction", "success"} <= row.keys() for row in rows)

    def test_the_same_command_gives_the_same_bytes(
        self, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        again, other = tmp_path / "again", tmp_path / "other"
        assert run_cli(*TRAIN, "--out", again) == 0
        assert capsys.readouterr().out.splitlines()[-1] == str(again)
        assert run_cli(*TRAIN, "--seed", 1, "--out", other) == 0
        policies = [(folder / "policy.safetensors").read_bytes() for folder in (run, again, other)]
        assert policies[0] == policies[1] != policies[2]

    def test_evaluations_during_training_are_logged(self, tmp_path: Path) -> None:
        options = ("--eval-interval-steps", 2048, "--validation-episodes", 2)
        assert run_cli(*TRAIN, *options, "--out", tmp_path / "run") == 0
        lines = (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()
        success = {row["env_steps"]: row["success"] for row in map(json.loads, lines)}
        assert success[1024] is None
        assert success[2048] in (0.0, 0.5, 1.0)

    def test_max_seconds_ends_a_run(self, tmp_path: Path) -> None:
        arguments = [*TRAIN, "--steps", "None", "--max-seconds", "2", "--out", str(tmp_path / "run")]
        done = adrl(*arguments)
        # On a busy machine set-up alone takes so long, which is said instead of a policy of noise.
        if done.returncode == 2:
            assert "set-up took" in done.stderr
            seconds = re.findall(r"give --max-seconds (\d+)", done.stderr)[0]
            arguments[arguments.index("--max-seconds") + 1] = seconds
            done = adrl(*arguments)
        assert done.returncode == 0, done.stderr
        config = json.loads((tmp_path / "run" / "config.json").read_text())
        assert config["train_seconds"] >= 2.0

    def test_training_on_a_collected_dataset(self, run: Path, tmp_path: Path) -> None:
        data, out = tmp_path / "walks-v0", tmp_path / "run"
        assert run_cli("collect", "--out", data, "--steps", 2048, "--num-envs", 32) == 0
        assert run_cli(*TRAIN, "--dataset", data, "--out", out) == 0
        config = json.loads((out / "config.json").read_text())
        assert config["settings"]["dataset"] == str(data)
        assert config["env_steps"] == 4096
        assert config["settings"]["expert"] == "perfect"
        told = [json.loads((folder / "config.json").read_text())["environment"] for folder in (run, out)]
        assert ["planner" in environment for environment in told] == [True, False], "it is the dataset's"

    @pytest.mark.parametrize("expert", ["slow:0.5", "few:2"])
    def test_training_from_an_imperfect_expert(self, run: Path, tmp_path: Path, expert: str) -> None:
        """It is another policy, the run says whose it is, and going on takes the same expert."""
        out = tmp_path / "run"
        assert run_cli(*TRAIN, "--expert", expert, "--out", out) == 0
        assert json.loads((out / "config.json").read_text())["settings"]["expert"] == expert
        policies = [(folder / "policy.safetensors").read_bytes() for folder in (run, out)]
        assert policies[0] != policies[1]
        more = (*TRAIN, "--steps", 5120, "--resume", "--out", out)
        assert run_cli(*more) == 2, "other demonstrations"
        assert run_cli(*more, "--expert", expert) == 0


class TestEvaluate:
    def evaluate(self, policy: object, folder: Path, *options: object) -> dict[str, Any]:
        file = folder / "summary-copy.json"
        arguments = ("--policy", policy, "--episodes", 8, "--json", file, "--out", folder)
        assert run_cli("evaluate", *arguments, *options) == 0
        assert file.read_bytes() == (folder / "summary.json").read_bytes()
        return json.loads(file.read_text())

    def test_the_summary_has_every_key(self, run: Path, tmp_path: Path) -> None:
        summary = self.evaluate(run, tmp_path)
        wide = {name + suffix for name in METRICS for suffix in ("", "_low", "_high")}
        assert {"schema_version", *ABOUT, *TRAINING, *wide} <= summary.keys()
        assert (summary["episodes"], summary["method"], summary["env_steps"]) == (8, "adrl", 4096)
        assert summary["success"] + summary["collision"] + summary["timeout"] == pytest.approx(1.0)
        for name in METRICS:
            if summary[f"{name}_low"] is not None:
                assert summary[f"{name}_low"] <= summary[name] <= summary[f"{name}_high"]
        assert len(read_episodes(tmp_path / "episodes.parquet")) == 8

    def test_the_seed_changes_the_noise_and_not_the_tasks(self, run: Path, tmp_path: Path) -> None:
        episodes = []
        for folder, seed in (("a", 0), ("b", 0), ("c", 1)):
            self.evaluate(run, tmp_path / folder, "--seed", seed)
            episodes.append(read_episodes(tmp_path / folder / "episodes.parquet"))
        first, same, other = episodes
        for name in ("task", "start_xy_m", "goal_xy_m", "shortest_m"):
            assert np.array_equal(getattr(first, name), getattr(other, name))
        assert np.array_equal(first.final_pose, same.final_pose)
        assert not np.array_equal(first.final_pose, other.final_pose)

    def test_paper_literal_sets_the_replanners_equations(
        self, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        used: list[ReplannerConfig] = []

        def spy(*arguments: Any, **options: Any) -> Rollout:
            used.append(arguments[2].replanner)
            return rollout(*arguments, **options)

        monkeypatch.setattr("adrl.evaluation.evaluate.rollout", spy)
        corrected = self.evaluate(run, tmp_path, "--guidance", "replan")
        printed = self.evaluate(run, tmp_path, "--guidance", "replan", "--paper-literal")
        plain, literal = used
        assert (literal.eq18, literal.eq20, literal.eq21) == ("literal",) * 3
        assert plain != literal == plain.literal()
        assert (corrected["paper_literal"], printed["paper_literal"]) == (False, True)
        assert printed["trained_paper_literal"] is False

    def test_paper_literal_without_the_replanner_is_refused(
        self, run: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run_cli("evaluate", "--policy", run, "--guidance", "goal", "--paper-literal") != 0
        assert "guidance is goal; give replan" in " ".join(capsys.readouterr().err.split())

    def test_json_to_standard_output_is_json_alone(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run_cli("evaluate", "--policy", "astar-dwa", "--episodes", 4, "--json", "-") == 0
        summary = json.loads(capsys.readouterr().out)
        assert (summary["policy"], summary["guidance"], summary["train_seconds"]) == (
            "astar-dwa",
            "map",
            None,
        )


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_run_says_how_to_go_on(tmp_path: Path, number: int) -> None:
    """A checkpoint at the signal, however long the interval is; a file gets plain lines."""
    out = tmp_path / "run"
    command = [sys.executable, "-m", "adrl.cli", *TRAIN, "--out", str(out)]
    endless = [*command, "--steps", "10000000", "--checkpoint-interval-steps", "None"]
    with subprocess.Popen(endless, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        lines = []
        for line in process.stderr:
            lines.append(line)
            if ", training, " in line:
                process.send_signal(number)
                break
        lines += process.stderr.readlines()
        assert process.stdout is not None
        assert process.stdout.read() == ""
    assert process.returncode == 1
    assert "\r" not in "".join(lines)
    assert re.search(r"^adrl: stopped after \d+ environment steps; the same command with --resume", lines[-1])
    (saved,) = (out / "checkpoint").iterdir()
    assert int(saved.name) == int(re.findall(r"after (\d+)", lines[-1])[0])
    again = adrl(*endless[3:], "--steps", int(saved.name) + 320, "--resume")
    assert again.returncode == 0, again.stderr


@pytest.mark.slow
@pytest.mark.integration
def test_a_killed_run_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    """Killed by SIGKILL at two random moments, then resumed: the policy of a run never killed."""
    long = (*TRAIN, "--steps", "8192", "--checkpoint-interval-steps", "512")
    whole = adrl(*long, "--out", tmp_path / "whole")
    assert whole.returncode == 0, whole.stderr
    out, rng = tmp_path / "killed", np.random.default_rng()
    command = [sys.executable, "-m", "adrl.cli", *long, "--out", str(out), "--resume"]
    for least in (rng.integers(0, 3000), rng.integers(3000, 6000)):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while process.poll() is None and not any(
            int(path.name) > least for path in (out / "checkpoint").glob("0*")
        ):
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.1))
        os.kill(process.pid, signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, "it ended before it could be killed"
        assert not (out / "policy.safetensors").exists()
    resumed = adrl(*long, "--out", out, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert (out / "policy.safetensors").read_bytes() == (
        tmp_path / "whole" / "policy.safetensors"
    ).read_bytes()
