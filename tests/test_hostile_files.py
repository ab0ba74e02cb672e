"""Small files that made a parser run out of stack, memory or time: one line each on the real command line, at once."""

import math
from pathlib import Path

import numpy as np
import pytest

from map_files import write_map
from refusals import Adrl

PLANNER = ("evaluate", "--policy", "astar-dwa", "--episodes", "3")


def aliases() -> str:
    """Nine times nine levels of lists, each of the one before."""
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    return "\n".join(levels)


@pytest.mark.parametrize(
    ("lines", "says"), [(aliases(), "20000 values"), ("x: " + "[" * 3000 + "]" * 3000, "nested more than 32")]
)
def test_maps(adrl: Adrl, lines: str, says: str) -> None:
    path = write_map(adrl.folder, np.full((40, 40), 254))
    path.write_text(path.read_text() + lines + "\n")
    adrl.refuses(*PLANNER, "--map", path.name, says=(path.name, says))


def corners(count: int) -> str:
    angles = [2.0 * math.pi * i / count for i in range(count)]
    return f"footprint_m = {[[round(0.3 * math.cos(a), 4), round(0.3 * math.sin(a), 4)] for a in angles]}\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("control_period_s = 1e-9\n", ("control_period_s is 1e-09", "give 0.005 to 2")),
        (corners(17), ("footprint_m", "17", "16")),
        ("max_speed_mps = 1" + "0" * 5000 + "\n", ("max_speed_mps", "give")),
    ],
    ids=["period", "corners", "digits"],
)
def test_robots(adrl: Adrl, text: str, says: tuple[str, ...]) -> None:
    (adrl.folder / "cart.toml").write_text(text)
    adrl.refuses(*PLANNER, "--scenario", "clutter", "--robot", "cart.toml", says=("cart.toml", *says))


def test_worlds(adrl: Adrl) -> None:
    text = '<?xml version="1.0" encoding="x"?><sdf version="1.6"><world name="w"/></sdf>'
    (adrl.folder / "w.sdf").write_text(text)
    adrl.refuses(*PLANNER, "--world", "w.sdf", says=("w.sdf", "encoding"))


@pytest.mark.parametrize(
    "content", ["[" * 100_000, '{"input_size": ' + "1" * 5000 + "}", '{"maturity": 1e400}', "[]", "\x00"]
)
@pytest.mark.parametrize("command", ["evaluate", "export", "report"])
def test_runs(adrl: Adrl, command: str, content: str) -> None:
    run = adrl.folder / "run"
    run.mkdir()
    (run / "config.json").write_text(content)
    (run / "policy.safetensors").write_bytes(b"\x02\0\0\0\0\0\0\0{}")
    arguments = {
        "evaluate": ("--policy", run, "--scenario", "clutter", "--episodes", 3),
        "export": (run, "--safetensors"),
        "report": (run,),
    }[command]
    says = ("run/config.json",) if command == "report" else ("run/config.json", "not a run's config.json")
    message = adrl.refuses(command, *arguments, says=says)
    assert len(message) < 400


def test_devices_and_pipes_are_no_policies(adrl: Adrl) -> None:
    run = adrl.folder / "run"
    run.mkdir()
    for device in ("/dev/zero", "/dev/null"):
        (run / "config.json").unlink(missing_ok=True)
        (run / "config.json").symlink_to(Path(device))
        adrl.refuses("evaluate", "--policy", run, says=("config.json", "ordinary file"))
