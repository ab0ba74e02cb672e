"""Each reader of ours, and valid files for it: for test_mutated_files.py and scripts/soak."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import nav2_files
import urdf_files
from adrl.agents import checkpoint
from adrl.comparison import results as compared
from adrl.deploy.onnx_policy import OnnxPolicy
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.descriptions import (
    Reading,
    given_fields,
    read_nav2,
    read_recorded_robot,
    read_urdf,
    robot_of,
    robot_text,
    settle,
)
from adrl.envs import NavVectorEnv
from adrl.errors import FileError
from adrl.evaluation.trace_file import read_traces
from adrl.imitation import Source, collect, load_minari, recorded_worlds, save_minari
from adrl.report.html import page
from adrl.report.metrics_log import read_metrics
from adrl.report.source import read_source
from adrl.reproduction import results as kept
from adrl.reproduction.numbers import table_rows
from adrl.reproduction.run import run_lines
from adrl.runs import rounds
from adrl.types import RobotConfig
from adrl.worlds import MapScenario, load_robot, load_sdf
from adrl.worlds.place import Place
from adrl.worlds.robot_files import robot_toml
from bag_corridor import corridor_bag
from map_files import write_map
from small_run import run_cli

KEPT = Path(__file__).parents[1] / "docs" / "results" / "reproduce"


def read_run(folder: Path) -> None:
    policy = find_policy(folder)
    try:
        Place.of(policy.policy.config.extra.get("settings", {}))
    except FileError:
        return


def read_report(folder: Path) -> None:
    page(read_source(folder), "")


def read_dataset(folder: Path) -> None:
    recorded_worlds(folder)
    load_minari(folder)


def read_comparison(folder: Path) -> None:
    compared.markdown(compared.method_rows(compared.read_runs(sorted(folder.glob("*-s*")))), "title")


def read_reproduction(folder: Path) -> None:
    results = kept.load(folder)
    run_lines(results)
    for scenario in results.scenarios:
        table_rows(results, scenario)


def described(reading: Reading) -> None:
    """As far as adrl robot goes with it."""
    settled = settle([*given_fields(["lidar.num_beams=90"]), *reading.findings])
    chosen = dict(settled.chosen)
    for name in settled.missing:
        (chosen[name],) = given_fields(
            [f"{name}=0.0" if "min_speed" in name or "mount" in name else f"{name}=1"]
        )
    robot_text(robot_of("cart", chosen), chosen, Path("cart.toml"))


def read_onnx(path: Path) -> None:
    """The metadata alone: a model's other parts are ONNX Runtime's."""
    text = path.read_bytes().decode("utf-8", errors="replace")
    lines = dict(zip(("robot", "encoder", "maturity"), text.split("\n"), strict=False))
    names = ("ranges", "goal", "twist", "last_action")
    session = SimpleNamespace(
        get_inputs=lambda: [SimpleNamespace(name=name, shape=(1, 180)) for name in names],
        get_modelmeta=lambda: SimpleNamespace(
            custom_metadata_map={"guidance": "goal", "method": "adrl", **lines}
        ),
    )
    OnnxPolicy(session, str(path), "")


ROUND, ABOUT = "checkpoint/rounds/01.safetensors", {"seed": 0}

READERS: dict[str, tuple[str, str, Callable[[Path], object]]] = {
    "policy": ("policy", "config.json", read_run),
    "weights": ("policy", "policy.safetensors", load_policy),
    "onnx": ("onnx", "metadata", lambda folder: read_onnx(folder / "metadata")),
    "checkpoint": ("run", "checkpoint/000000000064/state.json", checkpoint.load),
    "checkpoint part": ("run", "checkpoint/000000000064/a.safetensors", checkpoint.load),
    "round": ("run", ROUND, lambda folder: rounds.load(folder / ROUND, ABOUT)),
    "metrics": ("run", "metrics.jsonl", lambda folder: read_metrics(folder / "metrics.jsonl")),
    "report of a run": ("run", "metrics.jsonl", read_report),
    "summary": ("evaluation", "summary.json", read_report),
    "episodes": ("evaluation", "episodes.parquet", read_report),
    "traces": ("evaluation", "traces.safetensors", lambda folder: read_traces(folder / "traces.safetensors")),
    "report of traces": ("evaluation", "traces.safetensors", read_report),
    "dataset": ("dataset", "data/metadata.json", read_dataset),
    "reproduction": ("reproduction", "about.json", read_reproduction),
    "kept run": ("reproduction", "clutter/adrl-s0/run.json", read_reproduction),
    "kept curve": ("reproduction", "clutter/adrl-s0/curve.parquet", read_reproduction),
    "kept episodes": ("reproduction", "clutter/adrl-s0/episodes.parquet", read_reproduction),
    "comparison": ("comparison", "adrl-s0/summary.json", read_comparison),
    "comparison's results": ("comparison", "results.json", read_report),
    "comparison's settings": ("comparison", "settings.json", read_report),
    "nav2": ("nav2", "nav2.yaml", lambda folder: described(read_nav2([folder / "nav2.yaml"]))),
    "urdf": ("urdf", "cart.urdf", lambda folder: described(read_urdf(folder / "cart.urdf"))),
    "bag": ("bag", "bag.mcap", lambda folder: described(read_recorded_robot(folder))),
    "robot": ("robot", "cart.toml", lambda folder: load_robot(folder / "cart.toml")),
    "map": ("map", "map.yaml", lambda folder: MapScenario(folder / "map.yaml")),
    "world": ("world", "w.sdf", lambda folder: load_sdf(folder / "w.sdf")),
}
"""Folder of the valid files, the file that is mutated, and what reads the folder."""


def write_comparison(folder: Path, summary: dict[str, object]) -> None:
    """As adrl compare leaves it, of one training."""
    job = folder / "adrl-s0"
    job.mkdir(parents=True)
    evaluation = summary | {"train_seconds": 1.0, "env_steps": 64, "gradient_updates": 2}
    result = {"method": "adrl", "seed": 0, "evaluations": [evaluation]}
    (job / "summary.json").write_text(json.dumps(result))
    (job / "metrics.jsonl").write_text('{"wall_s": 1.0, "env_steps": 64, "success": 0.5}\n')
    rows = compared.method_rows(compared.read_runs([job]))
    (folder / "results.json").write_text(json.dumps({"rows": rows, "missing": ["td3-s0"]}))
    shared = {"scenario": "clutter", "robot": {"name": "diffbot"}, "guidance": "map", "episodes": 2}
    shared |= {"split": "test", "learner": {"steps": 64, "max_seconds": None}}
    (folder / "settings.json").write_text(json.dumps({"settings": shared, "methods": {}}))


WORLD = """<?xml version="1.0"?>
<sdf version="1.7"><world name="w">
<model name="m"><static>true</static><pose>1 2 0 0 0 0.3</pose><link name="l"><pose>0.5 0 0.2 0 0 0</pose>
<collision name="a"><geometry><box><size>1 2 3</size></box></geometry></collision>
<collision name="b"><pose relative_to="l">2 0 0 0 0 0</pose>
<geometry><cylinder><radius>0.4</radius><length>2</length></cylinder></geometry></collision>
<collision name="c"><geometry><sphere><radius>0.4</radius></sphere></geometry></collision>
</link></model>
<model name="n"><static>1</static><link name="l"><collision name="a"><geometry><polyline><height>1</height>
<point>0 3</point><point>1 3</point><point>1 4</point></polyline></geometry></collision></link></model>
</world></sdf>
"""


def write_valid(top: Path) -> None:
    """A folder of each kind, as it is written."""
    shutil.copytree(resolve_policy("diffbot"), top / "policy")
    config = json.loads((top / "policy" / "config.json").read_text())
    (top / "onnx").mkdir()
    lines = (json.dumps(config["robot"]), json.dumps(config["encoder"]), "0.5")
    (top / "onnx" / "metadata").write_text("\n".join(lines))
    state = {"config": {"seed": 0}, "env_steps": 64, "returns": [0.5], "rng": {"state": 2**127}}
    checkpoint.save(top / "run", 64, state, {"a": {"x": np.arange(6.0)}, "b": {"y": np.eye(2)}})
    row = {"wall_s": 1.0, "env_steps": 64, "success": None, "S": 0.5, "weight/a": 1.0, "q_mean": -3.0}
    log = "".join(json.dumps(row | {"wall_s": float(i)}) + "\n" for i in range(4))
    (top / "run" / "metrics.jsonl").write_text(log)
    place = write_map(top, np.pad(np.full((60, 60), 254), 1))
    evaluate = ("evaluate", "--policy", "astar-dwa", "--episodes", 2, "--out", top / "evaluation")
    assert run_cli(*evaluate, "--map", place) == 0
    write_comparison(top / "comparison", json.loads((top / "evaluation" / "summary.json").read_text()))
    env = NavVectorEnv(4, task_pool=4)
    shown = collect(env, 64, seed=0)
    save_minari(shown, top / "dataset", Source.of(env))
    rounds.save(top / "run" / ROUND, rounds.Round(shown, {"0": np.arange(6.0)}, 1.0), ABOUT)
    for name in ("about.json", "clutter/settings.json", "clutter/adrl-s0", "clutter/astar-dwa"):
        (top / "reproduction" / name).parent.mkdir(parents=True, exist_ok=True)
        copy = shutil.copytree if (KEPT / name).is_dir() else shutil.copy
        copy(KEPT / name, top / "reproduction" / name)
    for name in ("robot", "map", "world"):
        (top / name).mkdir()
    footprint = ((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2))
    robot = RobotConfig(radius_m=None, footprint_m=footprint)
    (top / "robot" / "cart.toml").write_text(robot_toml(robot))
    write_map(top / "map", np.pad(np.full((30, 30), 254), 1))
    for name in ("nav2", "urdf"):
        (top / name).mkdir()
    nav2_files.write(top / "nav2" / "nav2.yaml", nav2_files.parameters(robot))
    (top / "urdf" / "cart.urdf").write_text(urdf_files.urdf())
    corridor_bag(top / "bag")
    (top / "world" / "w.sdf").write_text(WORLD)
