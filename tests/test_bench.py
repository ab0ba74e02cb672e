"""The benchmarks return what they promise. Tiny sizes: the numbers mean nothing here."""

import dataclasses
import json
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import label

from adrl.benchmarks.act import bench_act
from adrl.benchmarks.learn import bench_learn, flops_per_update
from adrl.benchmarks.plan import (
    SIDE,
    _query,
    bench_car_paths,
    bench_controllers,
    bench_map,
    bench_replan,
    rate_key,
)
from adrl.benchmarks.sim import bench_sim
from adrl.benchmarks.timing import median_seconds, rate_per_second
from adrl.commands.bench import _gather
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.planning.local_control import CONTROLLERS
from adrl.planning.replanner import Replanner
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import GUIDANCE, RobotConfig
from adrl.worlds import load_robot
from map_files import write_map
from small_run import run_cli

SIM_KEYS = {"steps_per_second", "threads", "envs", "beams", "obstacles", "people", "peers"}


def test_rates_count_the_work_of_every_round() -> None:
    calls: list[int] = []

    def work() -> int:
        calls.append(1)
        return 7

    rate = rate_per_second(work, 0.01)
    assert 0.0 < rate <= 7 * len(calls) / 0.01
    assert median_seconds(work, 3) >= 0.0


def test_sim(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sizes = ("--envs", 8, "--beams", 12, "--obstacles", 5, "--seconds", 0.02, "--rounds", 3, "--threads", 1)
    assert run_cli("bench", "sim", *sizes, "--json", tmp_path / "sim.json") == 0
    results = json.loads((tmp_path / "sim.json").read_text())
    assert json.loads(capsys.readouterr().out) == results
    assert results.keys() >= SIM_KEYS
    # Five circles and the four walls around them.
    assert [results[name] for name in ("threads", "envs", "beams", "obstacles")] == [1, 8, 12, 9]
    rounds = results["steps_per_second_rounds"]
    assert len(rounds) == 3
    assert results["steps_per_second"] == sorted(rounds)[1] > 0.0
    assert results["peers"] == []
    assert "mixed" not in results


def test_robots_of_many_kinds_against_one_kind_a_batch(tmp_path: Path) -> None:
    sizes = ("--envs", 8, "--beams", 12, "--obstacles", 5, "--seconds", 0.02, "--rounds", 2, "--threads", 1)
    assert run_cli("bench", "sim", *sizes, "--robots", 3, "--json", tmp_path / "sim.json") == 0
    mixed = json.loads((tmp_path / "sim.json").read_text())["mixed"]
    assert mixed["robots"] == 3
    for part in ("simulator", "environment"):
        assert mixed[part]["steps_per_second"] > 0.0
        assert mixed[part]["ratio"] > 0.0
    assert mixed["environment"]["steps_per_second"] < mixed["simulator"]["steps_per_second"]
    assert run_cli("bench", "sim", *sizes, "--robots", 0) == 2


def test_sim_among_people_is_measured_against_rvo2(tmp_path: Path) -> None:
    pytest.importorskip("pyrvo")
    sizes = ("--envs", 4, "--beams", 12, "--obstacles", 0, "--people", 12, "--seconds", 0.02, "--rounds", 1)
    assert run_cli("bench", "sim", *sizes, "--threads", 1, "--json", tmp_path / "sim.json") == 0
    results = json.loads((tmp_path / "sim.json").read_text())
    assert results["people"] == 12
    (peer,) = results["peers"]
    assert peer["name"] == "pyrvo"
    assert peer["ratio"] == pytest.approx(results["steps_per_second"] / peer["steps_per_second"])


def test_plan(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[254] * 120] * 120, resolution=0.1)
    results = bench_controllers(robot=load_robot("jackal"), num_envs=4, num_threads=1, seconds=0.02, rounds=1)
    assert (results["robot"], results["envs"], results["threads"]) == ("jackal", 4, 1)
    assert {"decisions_per_second", "mppi_decisions_per_second"} <= results.keys()
    for controller in CONTROLLERS:
        assert results[rate_key(controller)] > 0.0
    across = bench_map(path, rounds=1)
    assert (across["map"], across["cells"], across["queries"]) == ("map.yaml", [120, 120], 50)
    assert 0.0 < across["median_ms"] <= across["p95_ms"]


def test_the_paths_of_a_car_are_timed() -> None:
    car = dataclasses.replace(load_robot("diffbot"), min_speed_mps=-0.3, min_turning_radius_m=0.5)
    found = bench_car_paths(car, queries=3)
    assert 0.0 < found["p50_ms"] <= found["p95_ms"]


def test_plan_across_a_turned_map(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[254] * 160] * 80, resolution=0.1, origin=[3.0, -2.0, 2.0])
    assert bench_map(path, rounds=1)["median_ms"] > 0.0


def product_flops(sizes: Sequence[int], rows: int) -> list[float]:
    return [2.0 * rows * sizes[i] * sizes[i + 1] for i in range(len(sizes) - 1)]


def test_flops_are_those_of_the_products_one_by_one() -> None:
    """A network of one width, product by product, for a batch of 256 and a cloning batch of 128."""
    a1, a2, a3 = product_flops((44, 32, 32, 2), 256)
    c1, c2, c3 = product_flops((46, 32, 32, 1), 256)
    targets = (a1 + a2 + a3) + 2 * (c1 + c2 + c3)
    critics = 2 * (
        (c1 + c2 + c3) + (c1 + c2 + c3) + (c2 + c3)
    )  # forward, weights, inputs but the first layer's
    climbing = (a1 + a2 + a3) + (c1 + c2 + c3) + (c1 + c2 + c3) + (a1 + a2 + a3) + (a2 + a3)
    cloning = 0.5 * ((a1 + a2 + a3) + (a1 + a2 + a3) + (a2 + a3))
    assert flops_per_update(32) == targets + critics + 0.5 * (climbing + cloning)


@pytest.mark.slow
def test_learn(capfd: pytest.CaptureFixture[str]) -> None:
    here = os.sched_getaffinity(0)
    assert run_cli("bench", "learn", "--widths", 8, "--seconds", 0.05, "--rounds", 3) == 0
    assert os.sched_getaffinity(0) == here, "only its own processes are bound"
    results = json.loads(capfd.readouterr().out)
    assert {"batch_size", "observation_size"} <= results.keys()
    assert results["matmul_gflops"] > 0.0
    (width,) = results["widths"]
    rounds = width["adrl"]["updates_per_second_rounds"]
    assert len(rounds) == 3
    assert width["adrl"]["updates_per_second"] == sorted(rounds)[1] > 0.0
    assert 0.0 < width["adrl"]["core_share"] <= 1.05
    assert width["peak_share"] * results["matmul_gflops"] == pytest.approx(width["gflops"])
    if results["peer"] is not None:
        theirs = width["sb3-td3"]["updates_per_second"]
        assert width["ratio"] == pytest.approx(width["adrl"]["updates_per_second"] / theirs)
    if len(here) > 1:
        two = results["two_learners"]
        assert two["ratio"] == pytest.approx(two["two"] / two["one"])


@pytest.mark.parametrize("widths", [(), (0,)])
def test_learn_needs_widths(widths: tuple[int, ...]) -> None:
    with pytest.raises(ConfigError, match="width"):
        bench_learn(widths=widths)


class Clock:
    """Shows 0, 1, 1 + 2, 1 + 2 + 3, ... s: between call k and the next lie k seconds."""

    def __init__(self) -> None:
        self.calls = 0

    def perf_counter(self) -> float:
        self.calls += 1
        return 0.5 * self.calls * (self.calls - 1)


def test_replanning_is_timed_once_a_query(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain and headings take turns: 1, 5, 9, 13 s and 3, 7, 11, 15 s."""
    monkeypatch.setattr("adrl.benchmarks.plan.time", Clock())
    results = bench_replan(queries=4)
    assert (results["cells"], results["queries"]) == ([400, 400], 4)
    assert results["plain"] == pytest.approx({"p50_ms": 7e3, "p99_ms": 13e3 - 0.03 * 4e3})
    assert results["headings"] == pytest.approx({"p50_ms": 9e3, "p99_ms": 15e3 - 0.03 * 4e3})


@pytest.mark.parametrize("k", range(6))
def test_replanning_is_timed_on_windows_that_have_a_route(k: int) -> None:
    """Clutter and mazes by turns; every third goal is shut in, and the route ends beside it or at the border."""
    window, pose, goal = _query(np.random.default_rng(k), k)
    replanner = Replanner(1, RobotConfig(), ReplannerConfig(cells=SIDE))
    replanner.b["log_odds"][0] = window
    replanner.native.plan(np.ones(1, np.uint8), pose, goal)
    cell = tuple(np.floor(goal[0, ::-1] / 0.05).astype(int))
    labels = np.empty(window.shape, np.int32)
    label(window <= 0, output=labels)
    start = tuple(np.floor(pose[0, 1::-1] / 0.05).astype(int))
    assert window[start] <= 0
    if k % 3 == 0:
        assert labels[cell] != labels[start] or labels[cell] == 0
        assert replanner.b["found"][0] != 1
    else:
        assert replanner.b["found"][0] > 0


@pytest.mark.parametrize("history_steps", [0, 3])
def test_a_policy_step_is_timed_without_the_warm_up(
    history_steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each step looks at the clock when it begins, and those after the warm-up once more; also with motion cues."""
    encoder = EncoderConfig(history_steps=history_steps)
    size = ObservationEncoder(RobotConfig(), encoder).size
    config = PolicyConfig(
        input_size=size,
        widths=(4,),
        robot=dataclasses.asdict(RobotConfig()),
        encoder=dataclasses.asdict(encoder),
    )
    layers = [(np.zeros((i, o), np.float32), np.zeros(o, np.float32)) for i, o in ((size, 4), (4, 2))]
    clock = Clock()
    monkeypatch.setattr("adrl.benchmarks.act.time", clock)
    step = bench_act(MlpPolicy(layers, config), steps=20)
    assert clock.calls == 60
    lasted = np.arange(21, 60, 2)  # s, of the steps after 20 of warm-up
    assert step["p50_ms"] == pytest.approx(1e3 * np.median(lasted))
    assert step["p99_ms"] == pytest.approx(1e3 * np.percentile(lasted, 99))


def test_the_runtime_is_timed_for_every_guidance(tmp_path: Path) -> None:
    assert run_cli("bench", "act", "--steps", 12, "--json", tmp_path / "act.json") == 0
    results = json.loads((tmp_path / "act.json").read_text())
    assert results["policy_step"]["steps"] == results["runtime"]["steps"] == 12
    for guidance in GUIDANCE:
        assert 0.0 < results["runtime"][guidance]["p50_ms"] <= results["runtime"][guidance]["p99_ms"]


@pytest.mark.parametrize("seconds", [math.nan, math.inf, 0.0, -1.0])
def test_a_round_needs_a_length(seconds: float) -> None:
    with pytest.raises(ConfigError, match="seconds"):
        bench_sim(num_envs=4, seconds=seconds)
    with pytest.raises(ConfigError, match="seconds"):
        bench_controllers(num_envs=4, seconds=seconds)


def test_a_repeated_option_keeps_all_its_values():
    given = [
        "--envs",
        "8",
        "--peer-python",
        "a",
        "--seconds",
        "0.1",
        "--peer-python=b",
        "--peer-python",
        "c",
        "d",
    ]
    assert _gather(given, "--peer-python") == [
        "--envs",
        "8",
        "--seconds",
        "0.1",
        "--peer-python",
        "a",
        "b",
        "c",
        "d",
    ]
    assert _gather(["--envs", "8"], "--peer-python") == ["--envs", "8"]


def test_a_dash_for_json_prints_and_writes_no_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_cli("bench", "sim", "--envs", 2, "--seconds", 0.01, "--rounds", 1, "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["envs"] == 2
    assert list(tmp_path.iterdir()) == []
