"""adrl regret: real runs of seconds, killed and gone on with, and what its page says."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import ANY

import numpy as np
import pyarrow.parquet as pq
import pytest

from adrl.agents.config import Td3Config
from adrl.comparison.config import CompareConfig
from adrl.errors import CheckpointError, ConfigError
from adrl.regret.cells import CELLS
from adrl.regret.page import write_page
from adrl.regret.regret import CellScores, kept, missing, penalised_time_s, preset, regret, scores
from adrl.worlds import load_robot, task_set
from small_run import contents, run_cli
from waiting import wait_until

CELL_NAMES = ("slow-dense-clutter-diffbot", "narrow-shy-terminal-clutter-jackal")
HERE = Path(__file__).parent
GIVE_UP_S = 250.0


def tiny(out: Path, methods: str = "adrl,td3", seeds: int = 2) -> dict[str, CompareConfig]:
    """Two cells with sizes of seconds."""
    found = {}
    for name, config in preset(out, cells=",".join(CELL_NAMES), methods=methods, seeds=seeds).items():
        learner = replace(
            config.learner,
            steps=1024,
            start_steps=256,
            pretrain_updates=8,
            critic_warmup_updates=8,
            eval_interval_steps=1024,
            td3=Td3Config(widths=(16, 16)),
        )
        sizes = {"episodes": 6, "num_envs": 16, "task_pool": 4, "demonstration_steps": 512}
        found[name] = replace(config, validation_episodes=2, learner=learner, **sizes)
    return found


@pytest.mark.usefixtures("hasty_compiler")
@pytest.mark.slow
@pytest.mark.integration
def test_a_killed_one_goes_on_and_tells_what_the_episodes_give(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code = "from test_regret import *; import sys; regret(tiny(Path(sys.argv[1])))"
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(out)],
        cwd=HERE,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parent)])},
    )
    first = out / CELL_NAMES[0]
    wait_until(lambda: len(list(first.glob("*-s*/summary.json"))) >= 1, GIVE_UP_S)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()

    comparisons = tiny(out)
    finished = [path.parent for path in out.glob("*/*/summary.json")]
    before = {folder: contents(folder) for folder in finished}
    assert missing(comparisons), "nothing was left to do"
    write_page(comparisons, out)
    said = json.loads((out / "regret.json").read_text())
    assert said["missing"] == missing(comparisons)
    assert said["rows"] == [], "a part of a cell is compared with nothing"

    told = []
    assert regret(comparisons, lambda done, _, total: told.append((done, total))) == {}
    assert told[-1] == (10, 10)
    assert {folder: contents(folder) for folder in finished} == before
    assert missing(comparisons) == {}
    write_page(comparisons, out)
    check_page(comparisons, out)

    whole = contents(out)
    assert regret(comparisons) == {}
    assert {n: c for n, c in contents(out).items() if n.endswith("summary.json")} == {
        n: c for n, c in whole.items() if n.endswith("summary.json")
    }
    other = {name: replace(config, episodes=5) for name, config in comparisons.items()}
    for refused in (regret, scores):
        with pytest.raises(ConfigError, match="episodes: 6 there, 5 here"):
            refused(other)
    check_kept(comparisons, out, tmp_path / "copy")
    broken = out / CELL_NAMES[0] / "td3-s1" / "episodes.parquet"
    table = pq.read_table(broken)
    pq.write_table(table.slice(1), broken)
    with pytest.raises(CheckpointError, match="td3-s1: its episodes are of another evaluation"):
        scores(comparisons)
    pq.write_table(table.drop_columns(["success"]), broken)
    with pytest.raises(CheckpointError, match=r"td3-s1.*success"):
        scores(comparisons)


def check_kept(comparisons: dict[str, CompareConfig], out: Path, copy: Path) -> None:
    """Two files of each cell say as much as its runs, and no run is repeated."""
    for cell in CELL_NAMES:
        (copy / cell).mkdir(parents=True)
        for name in ("settings.json", "scores.json"):
            shutil.copy(out / cell / name, copy / cell)
    elsewhere = {cell: replace(config, out=copy / cell) for cell, config in comparisons.items()}
    before = contents(copy)
    assert missing(elsewhere) == {}
    assert regret(elsewhere) == {}
    assert contents(copy) == before
    write_page(elsewhere, copy)
    assert (copy / "regret.json").read_bytes() == (out / "regret.json").read_bytes()
    with pytest.raises(ConfigError, match="episodes: 6 there, 5 here"):
        scores({cell: replace(config, episodes=5) for cell, config in elsewhere.items()})
    more = {cell: replace(config, seeds=3) for cell, config in elsewhere.items()}
    assert len(missing(more)[CELL_NAMES[0]]) == 6, "what is asked beyond it is trained, with its partners"
    for cell in CELL_NAMES:
        check_kept_parts(comparisons[cell], elsewhere[cell])


def check_kept_parts(config: CompareConfig, elsewhere: CompareConfig) -> None:
    """Parts that are asked one after the other say together what the whole did."""
    file = config.out / "scores.json"
    whole = file.read_bytes()
    file.unlink()
    first, second = (replace(config, methods=method) for method in ("adrl", "td3"))
    for part in (first, second):
        assert regret({"cell": part}) == {}
        expected = kept(replace(elsewhere, methods=part.methods))
        assert expected is not None
        assert kept(part) == {**expected, "common_time_s": ANY}
    assert file.read_bytes() == whole
    # What tells of runs that are gone is not given up for another part.
    file.unlink()
    regret({"cell": first})
    before = file.read_bytes()
    gone = config.out / "adrl-s1"
    away = gone.rename(elsewhere.out / "adrl-s1")
    assert regret({"cell": second}) == {}
    assert file.read_bytes() == before
    away.rename(gone)
    assert regret({"cell": second}) == {}
    assert file.read_bytes() == whole


WHOLE = CellScores(
    schema_version=1,
    methods=["adrl", "td3"],
    seeds=2,
    success=[[0.5, 0.25], [0.75, 1.0]],
    time_s=[[9.0, 8.0], [7.0, 6.0]],
    common_time_s=[5.0, None],
)


def with_scores(tmp_path: Path, content: object) -> CompareConfig:
    config = tiny(tmp_path)[CELL_NAMES[0]]
    config.out.mkdir(exist_ok=True)
    (config.out / "scores.json").write_text(json.dumps(content))
    return config


def test_kept_scores_answer_for_any_part_of_them(tmp_path: Path) -> None:
    config = with_scores(tmp_path, WHOLE)
    assert kept(config) == WHOLE
    turned = kept(replace(config, methods="td3,adrl"))
    assert turned is not None
    assert turned["success"] == WHOLE["success"][::-1]
    assert turned["common_time_s"] == [None, 5.0]
    part = kept(replace(config, methods="td3", seeds=1))
    assert part is not None
    assert (part["methods"], part["success"], part["time_s"]) == (["td3"], [[0.75]], [[7.0]])
    assert part["common_time_s"] == [None], "the tasks that these runs alone solved are not known"
    assert kept(replace(config, methods="adrl,bc")) is None
    assert kept(replace(config, seeds=3)) is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"success": [[0.5]]}, "1 rows of success for 2 methods"),
        ({"success": [[0.5, 0.25], [0.5]]}, "not 2 seeds of each method in success"),
        ({"success": [[0.5, 0.25], [0.5, 1.5]]}, "success.*1.0"),
        ({"time_s": None}, "time_s"),
        ({"common_time_s": [None]}, "1 rows of common_time_s"),
        ({"schema_version": 2}, "schema_version"),
    ],
)
def test_scores_that_are_broken_are_refused(tmp_path: Path, change: dict[str, object], said: str) -> None:
    config = with_scores(tmp_path, WHOLE | change)
    with pytest.raises(CheckpointError, match=said):
        kept(config)


def check_page(comparisons: dict[str, CompareConfig], out: Path) -> None:
    """The JSON holds what the episodes give, worked out here another way."""
    said = json.loads((out / "regret.json").read_text())
    assert said["schema_version"] == 1
    assert (said["methods"], said["seeds"], said["claim"]) == (["adrl", "td3"], 2, False)
    regrets = {"adrl": [], "td3": []}
    for cell in CELL_NAMES:
        means = {}
        for method in regrets:
            runs = [pq.read_table(out / cell / f"{method}-s{seed}" / "episodes.parquet") for seed in (0, 1)]
            means[method] = np.mean([np.mean(run.column("success").to_pylist()) for run in runs])
        for method, found in regrets.items():
            found.append(max(means.values()) - means[method])
    for row in said["rows"]:
        assert row["regret_success"] == pytest.approx(np.mean(regrets[row["method"]]))
        assert row["regret_time"] >= 0.0
    assert len(said["cell_rows"]) == 4
    page = (out / "README.md").read_text()
    assert "2 of 10 seeds: fewer than 10 make no claim" in page
    assert all(cell in page for cell in CELL_NAMES)
    assert (out / "regret.png").stat().st_size > 1000


def test_a_task_that_was_not_solved_takes_its_time_limit() -> None:
    robot = load_robot("diffbot")
    tasks = task_set(comparison_scenario(), robot, "test", 3)
    columns = {
        "success": np.array([True, False, False]),
        "time_s": np.array([9.0, 2.0, tasks[2].time_limit_s]),
        "shortest_m": np.array([task.shortest_m - task.goal_tolerance_m for task in tasks]),
    }
    expected = [9.0, tasks[1].time_limit_s, tasks[2].time_limit_s]
    assert penalised_time_s(columns, robot) == pytest.approx(expected)


def comparison_scenario():
    return preset("out", cells=CELL_NAMES[0])[CELL_NAMES[0]].load()


def test_nothing_complete_says_nothing(tmp_path: Path) -> None:
    comparisons = tiny(tmp_path)
    assert scores(comparisons) is None
    assert missing(comparisons)[CELL_NAMES[0]] == ["adrl-s0", "td3-s0", "adrl-s1", "td3-s1"]
    many = tiny(tmp_path, "adrl,td3,bc", 4)
    write_page(many, tmp_path)
    assert "it has not been run" in (tmp_path / "README.md").read_text()
    done = tmp_path / CELL_NAMES[0] / "adrl-s0" / "summary.json"
    done.parent.mkdir(parents=True)
    done.write_text("{}")
    write_page(comparisons, tmp_path)
    page = (tmp_path / "README.md").read_text()
    assert (
        f"`{CELL_NAMES[0]}` is not in the tables: 3 of its 4 trainings are missing, td3-s0, adrl-s1, td3-s1."
        in page
    )
    assert f"`{CELL_NAMES[1]}` is not in the tables: it has not been run." in page
    write_page(many, tmp_path)
    page = (tmp_path / "README.md").read_text()
    assert (
        "11 of its 12 trainings are missing, td3-s0, bc-s0, adrl-s1, td3-s1, bc-s1, adrl-s2, td3-s2, bc-s2, ..."
        in page
    )


class TestCommand:
    def test_it_lists_its_cells(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        assert run_cli("regret", "--list", "--out", tmp_path / "out") == 0
        assert [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()] == list(CELLS)
        assert not (tmp_path / "out").exists()

    def test_fewer_seeds_are_warned_of(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        options = ("--tables-only", "--cells", CELL_NAMES[0], "--methods", "adrl,td3", "--seeds", 3)
        assert run_cli("regret", *options, "--out", tmp_path / "out") == 0
        assert "3 of 10 seeds: fewer than 10 make no claim" in capsys.readouterr().err
        assert run_cli("regret", *options[:-1], 10, "--out", tmp_path / "ten") == 0
        assert "WARNING" not in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("options", "says"),
        [
            (("--cells", "slow-dense-cluter-diffbot"), "did you mean 'slow-dense-clutter-diffbot'"),
            (("--methods", "adlr"), "did you mean 'adrl'"),
            (("--seeds", "0"), "seeds is 0"),
        ],
    )
    def test_bad_input_is_refused(
        self, options: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        assert run_cli("regret", *options, "--out", tmp_path / "out") == 2
        assert says in capsys.readouterr().err
        assert not (tmp_path / "out").exists()
