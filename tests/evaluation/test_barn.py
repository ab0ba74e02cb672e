"""The benchmark's score, known by hand, and what adrl barn makes of a set of runs."""

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from adrl.commands.barn import BarnDrives
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.envs import NavSim, Setting
from adrl.errors import CheckpointError, ConfigError
from adrl.evaluation.barn import (
    BarnRuns,
    BenchmarkClock,
    SpeedLimited,
    reference_table,
    scores,
    warning,
    world_table,
)
from adrl.evaluation.kept import KeptEpisodes
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.onboard import Onboard
from adrl.evaluation.rollout import rollout
from adrl.observation import ObservationEncoder, to_action, to_twist
from adrl.runs import Run, RunConfig
from adrl.worlds import ROBOTS, BarnScenario
from adrl.worlds.barn import GOAL, START, BarnWorld, benchmark_path, field_task, field_world
from small_run import finished_run, run_cli

JACKAL = ROBOTS["jackal"]


def a_world(number: int, cells: list[tuple[float, float]]) -> BarnWorld:
    world = field_world(np.zeros((30, 30), dtype=bool))
    return BarnWorld(number=number, world=world, path=benchmark_path(np.array(cells)))


@pytest.mark.parametrize(
    ("success", "time_s", "score"),
    [
        (True, 5.0, 0.5),  # as fast as the optimum: no more than at half its speed
        (True, 10.0, 0.5),
        (True, 20.0, 0.25),
        (True, 40.0, 0.125),
        (True, 99.0, 0.125),
        (False, 12.0, 0.0),
    ],
)
def test_scores_known_by_hand(success: bool, time_s: float, score: float) -> None:
    assert scores([success], [time_s], [5.0]).tolist() == [score]


@given(time_s=st.floats(0.1, 100.0), longer_s=st.floats(0.0, 50.0), optimal_s=st.floats(4.0, 9.0))
def test_no_one_gains_by_being_late(time_s: float, longer_s: float, optimal_s: float) -> None:
    early, late = scores([True, True], [time_s, time_s + longer_s], [optimal_s, optimal_s])
    assert 0.125 <= late <= early <= 0.5


def test_the_clock_starts_in_the_period_in_which_the_robot_has_moved_a_tenth_of_a_metre(
    make_episodes: Callable[..., Episodes],
) -> None:
    """Two robots, driven by hand: one waits half a second, one never moves."""
    world, clock = field_world(np.zeros((30, 30), dtype=bool)), BenchmarkClock()
    task = field_task(world, JACKAL)
    sim = NavSim(2, JACKAL)
    sim.reset(np.arange(2), [task, task], np.zeros(2, np.uint64), np.random.default_rng(0))
    numbers, moved_s = np.array([7, 3]), None
    for period in range(30):
        speed = 0.0 if period < 5 else 0.5
        sim.step(to_action(np.array([(speed, 0.0), (0.0, 0.0)]), JACKAL))
        clock(sim, numbers, np.array([True, True]))
        if moved_s is None and sim.b["travelled"][0] >= 0.1:
            moved_s = float(sim.b["time"][0])
    assert moved_s is not None
    episodes = dataclasses.replace(make_episodes(2), task=numbers)
    timed = clock.timed(episodes)
    assert timed.time_s[0] == pytest.approx(episodes.time_s[0] - (moved_s - 0.1))
    assert 0.4 < episodes.time_s[0] - timed.time_s[0] < 1.2
    assert timed.time_s[1] == episodes.time_s[1]


def test_kept_parts_are_read_again_trial_by_trial_and_not_under_other_settings(
    make_episodes: Callable[..., Episodes], tmp_path: Path
) -> None:
    parts = {name: make_episodes(3, seed=i) for i, name in enumerate(("a", "b"))}
    with KeptEpisodes(tmp_path / "out", {"seed": 0}) as kept:
        assert not kept.has("a")
        kept.keep("a", parts["a"])
    with KeptEpisodes(tmp_path / "out", {"seed": 0}) as kept:
        assert kept.has("a")
        assert not kept.has("b")
        kept.keep("b", parts["b"])
        both = kept.by_trial(["a", "b"])
    expected = [parts[name].time_s[trial] for trial in range(3) for name in ("a", "b")]
    assert both.time_s.tolist() == expected
    with (
        pytest.raises(ConfigError, match=r"other settings \(seed\)"),
        KeptEpisodes(tmp_path / "out", {"seed": 1}),
    ):
        pass
    (tmp_path / "out" / "parts" / "a.parquet").write_bytes(b"no table")
    with (
        KeptEpisodes(tmp_path / "out", {"seed": 0}) as kept,
        pytest.raises(CheckpointError, match=r"a\.parquet"),
    ):
        kept.has("a")


def test_settings_that_are_damaged_are_named_with_what_to_do(tmp_path: Path) -> None:
    file = tmp_path / "asked.json"
    for content in ("{", "[]"):
        file.write_text(content)
        with (
            pytest.raises(CheckpointError, match=r"asked\.json is .*give another folder"),
            KeptEpisodes(tmp_path, {"seed": 0}),
        ):
            pass
        assert [path.name for path in tmp_path.iterdir()] == [file.name], "no lock stays"


def test_rows_are_means_over_trials_and_intervals_over_worlds(
    make_episodes: Callable[..., Episodes],
) -> None:
    worlds = [a_world(3, [(15, 0), (15, 29)]), a_world(8, [(5, 0), (25, 29)]), a_world(40, [(9, 0)])]
    episodes = make_episodes(12, seed=4)
    runs = BarnRuns(worlds=worlds, episodes=episodes, trained_on=np.zeros(3, dtype=bool))
    assert runs.trials == 4
    summary = runs.summary()
    for i, row in enumerate(summary["per_world"]):
        mine = episodes.select(np.arange(i, 12, 3))
        expected = scores(mine.success, mine.time_s, np.full(4, worlds[i].optimal_time_s))
        assert row["world"] == worlds[i].number
        assert row["score"] == pytest.approx(expected.mean())
        assert row["success"] == mine.success.mean()
        assert row["time_s"] == (
            pytest.approx(mine.time_s[mine.success].mean()) if mine.success.any() else None
        )
    assert summary["score"] == pytest.approx(np.mean([row["score"] for row in summary["per_world"]]))
    assert summary["score_low"] <= summary["score"] <= summary["score_high"]
    table = runs.to_table()
    assert table["world"].to_pylist() == [3, 8, 40] * 4
    assert table["trial"].to_pylist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    # More trials of the same worlds, all alike, leave the interval over worlds as it is.
    twice = dataclasses.replace(runs, episodes=episodes.select(np.tile(np.arange(12), 2))).summary()
    assert twice["score_low"] == pytest.approx(summary["score_low"])


def test_worlds_of_training_are_marked_and_scored_apart(make_episodes: Callable[..., Episodes]) -> None:
    worlds = [a_world(number, [(15, 0)]) for number in (3, 8, 40)]
    episodes, seen = make_episodes(12, seed=4), np.array([False, True, False])
    runs = BarnRuns(worlds=worlds, episodes=episodes, trained_on=seen)
    summary = runs.summary()
    rows = summary["per_world"]
    assert [row["trained_on"] for row in rows] == seen.tolist()
    assert runs.to_table()["trained_on"].to_pylist() == seen.tolist() * 4
    for name in ("success", "score"):
        assert summary["unseen"][name] == pytest.approx(0.5 * (rows[0][name] + rows[2][name]))
        assert summary["trained_on"][name] == pytest.approx(rows[1][name])
    assert (summary["unseen"]["worlds"], summary["trained_on"]["worlds"], summary["worlds"]) == (2, 1, 3)
    for mask, part in ((np.zeros(3, dtype=bool), "unseen"), (np.ones(3, dtype=bool), "trained_on")):
        alone = dataclasses.replace(runs, trained_on=mask).summary()
        assert alone[part]["score_low"] == alone["score_low"]
        assert alone["unseen" if part == "trained_on" else "trained_on"] is None


def test_a_score_that_is_not_held_out_comes_with_a_warning(make_episodes: Callable[..., Episodes]) -> None:
    worlds = [a_world(number, [(15, 0)]) for number in (3, 8, 40)]

    def told(*trained_on: bool, known: bool = True) -> str | None:
        runs = BarnRuns(worlds=worlds, episodes=make_episodes(6), trained_on=np.array(trained_on))
        about = {"policy": "mine", "guidance": "goal", "v_max_mps": 2.0, "trained_on_known": known}
        console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
        console.print(reference_table(about | runs.summary()))
        text = console.export_text()
        assert ("never trained on" in text) == (not all(trained_on))
        assert ("TRAINED ON" in text) == any(trained_on)
        return warning(about | runs.summary())

    assert told(False, False, False) is None
    assert "trained on 1 of these 3 worlds; only the others'" in str(told(False, True, False))
    assert "Not a held-out score: mine was trained on every one" in str(told(True, True, True))
    assert "Not a held-out score: the run of mine does not say" in str(told(True, True, True, known=False))


def test_one_world_has_no_interval(make_episodes: Callable[..., Episodes]) -> None:
    seen = np.zeros(1, dtype=bool)
    summary = BarnRuns(worlds=[a_world(1, [(9, 0)])], episodes=make_episodes(4), trained_on=seen).summary()
    assert summary["score_low"] is None
    assert summary["score_high"] is None


def test_tables_name_every_world_the_speed_and_the_references(make_episodes: Callable[..., Episodes]) -> None:
    worlds = [a_world(7, [(9, 0)]), a_world(191, [(12, 3)])]
    episodes = make_episodes(6, success_probability=0.0)
    runs = BarnRuns(worlds=worlds, episodes=episodes, trained_on=np.zeros(2, dtype=bool))
    summary = {"policy": "mine", "guidance": "replan", "v_max_mps": 1.5} | runs.summary()
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(world_table(summary))
    console.print(reference_table(summary))
    text = console.export_text()
    for word in ("mine", "guidance replan", "v_max 1.5 m/s", "191", "0.489", "0.372", "0.159", "65.0"):
        assert word in text


@given(v_max=st.floats(0.05, 2.0), low=st.sampled_from([0.0, -0.5]))
def test_a_limited_policy_never_commands_more(v_max: float, low: float) -> None:
    robot = dataclasses.replace(JACKAL, min_speed_mps=low)
    rng = np.random.default_rng(0)
    layer = (rng.standard_normal((3, 2)).astype(np.float32), np.zeros(2, np.float32))
    policy = MlpPolicy([layer], PolicyConfig(input_size=3, widths=()))
    observation = rng.standard_normal((64, 3)).astype(np.float32)
    free, limited = policy.act(observation), SpeedLimited(policy, robot, v_max).act(observation)
    speed, own = to_twist(limited, robot)[:, 0], to_twist(free, robot)[:, 0]
    np.testing.assert_allclose(speed, np.minimum(own, v_max), atol=1e-5)
    np.testing.assert_array_equal(limited[:, 1], free[:, 1])


@pytest.mark.parametrize("v_max", [0.5, None])
def test_the_limit_is_in_metres_a_second_where_a_policy_takes_its_robot_for_a_slower_one(
    v_max: float | None, tmp_path: Path
) -> None:
    """`default` asks for no more than the Jackal stops from within 0.3 m."""
    free = find_policy("default")
    known = free.taken_as(JACKAL)
    assert 0.5 < known.max_speed_mps < JACKAL.max_speed_mps
    limited = BarnDrives(worlds=tmp_path, policy="default", v_max=v_max).driver()[0]
    observation = (
        np.random.default_rng(0).uniform(-1.0, 1.0, (64, free.policy.config.input_size)).astype(np.float32)
    )
    speed, own = (to_twist(of.policy.act(observation), known)[:, 0] for of in (limited, free))
    assert own.max() > 0.5
    np.testing.assert_allclose(speed, np.minimum(own, v_max or np.inf), atol=1e-5)


@pytest.mark.parametrize("v_max", [0.0, -1.0, 2.5, float("nan")])
def test_a_limit_that_limits_nothing_is_refused(v_max: float) -> None:
    policy = MlpPolicy(
        [(np.zeros((3, 2), np.float32), np.zeros(2, np.float32))], PolicyConfig(input_size=3, widths=())
    )
    with pytest.raises(ConfigError, match="v_max"):
        SpeedLimited(policy, JACKAL, v_max)


@pytest.fixture
def two_worlds(barn: Path, tmp_path: Path) -> Path:
    for number in (18, 67):
        shutil.copy(barn / "worlds" / f"world_{number}.world", tmp_path)
        shutil.copy(barn / "paths" / f"path_{number}.npy", tmp_path)
    return tmp_path


@pytest.mark.integration
def test_the_command_writes_what_it_prints(two_worlds: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = two_worlds / "out"
    arguments = ("barn", "--worlds", two_worlds, "--policy", "astar-dwa", "--v-max", 0.5, "--trials", 2)
    assert run_cli(*arguments, "--json", "-", "--out", out) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == json.loads((out / "summary.json").read_text())
    assert summary["v_max_mps"] == 0.5
    assert (summary["worlds"], summary["trials"], summary["episodes"]) == (2, 2, 4)
    assert [(row["world"], row["trained_on"]) for row in summary["per_world"]] == [(18, False), (67, False)]
    assert summary["held_out"] == 0
    table = pq.read_table(out / "episodes.parquet")
    assert table["score"].to_numpy().mean() == pytest.approx(summary["score"])
    # Success comes after 9 m and a little more: 18 s at 0.5 m/s, where 11 m at 2 m/s are 5.5 s.
    assert 0.27 < summary["score"] < 5.8 / 18.0


def run_folder_of(config: RunConfig, out: Path) -> Path:
    """What training with this configuration would leave, its weights zero."""
    about = Run.of(dataclasses.replace(config, robot=JACKAL, out=out)).about_policy()
    size = ObservationEncoder(JACKAL, config.encoder).size
    layers = [(np.zeros((a, b), np.float32), np.zeros(b, np.float32)) for a, b in ((size, 1), (1, 2))]
    MlpPolicy(layers, dataclasses.replace(about, input_size=size, widths=(1,))).save(out)
    return out


def scored(worlds: Path, run: Path, *more: object) -> dict[str, Any]:
    arguments = ("barn", "--worlds", worlds, "--policy", run, "--trials", 1, "--json", worlds / "s.json")
    assert run_cli(*arguments, *more) == 0
    return json.loads((worlds / "s.json").read_text())


@pytest.mark.integration
def test_the_command_tells_worlds_of_training_wherever_they_lie(
    two_worlds: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    base = tmp_path_factory.mktemp("runs")
    half = run_folder_of(RunConfig(barn=two_worlds, barn_held_out=1), base / "half")
    (left_out,) = BarnScenario(two_worlds, 1).split("test")
    moved = base / "elsewhere"
    moved.mkdir()
    for number in (18, 67):
        shutil.copy(two_worlds / f"world_{number}.world", moved / f"world_{number + 1}.world")
        shutil.copy(two_worlds / f"path_{number}.npy", moved / f"path_{number + 1}.npy")
    summary = scored(moved, half)
    assert {row["world"]: row["trained_on"] for row in summary["per_world"]} == {
        number + 1: number != left_out.number for number in (18, 67)
    }
    assert "trained on 1 of these 2 worlds" in capsys.readouterr().err
    held_out = scored(two_worlds, half, "--held-out", 1)
    assert (held_out["held_out"], held_out["unseen"]["worlds"], held_out["trained_on"]) == (1, 1, None)
    assert "held-out score" not in capsys.readouterr().err
    every = scored(moved, run_folder_of(RunConfig(barn=two_worlds), base / "all"))
    assert every["unseen"] is None
    assert "Not a held-out score" in capsys.readouterr().err


@pytest.mark.integration
def test_the_shipped_policy_has_seen_no_world_of_the_benchmark_and_arrives(two_worlds: Path) -> None:
    summary = scored(two_worlds, Path("jackal"))
    assert (summary["unseen"]["worlds"], summary["trained_on"]) == (2, None)
    assert summary["success"] == 1.0


@pytest.mark.integration
def test_only_the_jackal_is_scored(two_worlds: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    diffbot = finished_run(tmp_path_factory)
    assert run_cli("barn", "--worlds", two_worlds, "--policy", diffbot) == 2
    assert run_cli("barn", "--worlds", two_worlds, "--policy", "diffbot") == 2
    assert run_cli("barn", "--worlds", two_worlds, "--policy", "astar-dwa", "--trials", 0) == 2
    assert run_cli("barn", "--worlds", two_worlds, "--policy", "astar-dwa", "--v-max", 2.5) == 2
    assert run_cli("barn", "--worlds", two_worlds / "nothing", "--policy", "astar-dwa") == 2


def test_a_policy_onboard_drives_by_its_own_scans_and_is_refused_a_map() -> None:
    """The map of the task is another world: who looked behind the sensors would follow it into a wall."""
    filled = np.zeros((30, 30), dtype=bool)
    filled[12, 4:26] = True
    world = field_world(filled)
    policy = find_policy("jackal")
    robot = policy.driven(None)
    task = dataclasses.replace(field_task(world, robot), path=np.array([START[:2], GOAL]))
    onboard = Onboard(policy, robot, "replan")
    setting = Setting(robot=robot, guidance="replan", plans_itself=True)
    assert rollout(onboard, [task, task], setting).episodes.success.all()
    with pytest.raises(ConfigError, match="no map"):
        Onboard(policy, robot, "map")
