"""Measures a shipped policy for its card: a file a row, in docs/results/policies/NAME.

    python docs/measure_policy.py default
    python docs/measure_policy.py default --elsewhere 30 --episodes 200     smaller, with wider intervals

Each row is what `adrl evaluate` prints, with its command. Rows that were measured with the policy's present weights
stay; the others are driven. Then: make tables.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from adrl import files
from adrl.cli import main as adrl
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.worlds import ROBOTS

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results" / "policies"
MAPS = tuple(
    f"tests/data/maps/{name}.yaml" for name in ("willow/willow-full", "depot/depot", "turtlebot3_world/map")
)
CARS = "docs/policies/cars.toml"
NAMED = ("diffbot", "turtlebot3_burger", "turtlebot3_waffle", "jackal")


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to measure, and how much of it."""

    policy: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name."""
    robots: int = 1000
    """Robots of its family on complex with the map, with 20 tasks each."""
    elsewhere: int = 100
    """The same in other places and with other guidance."""
    episodes: int = 500
    """Tasks of one robot."""


def rows(policy: ResolvedPolicy, options: Options) -> list[list[str]]:
    """The options of `adrl evaluate` that make a row each."""
    drives = ["--episodes", str(options.episodes)]
    if policy.family is None:
        own = [["--scenario", place] for place in ("complex", "clutter", "rooms", "dynamic")]
        return [
            *([*place, "--guidance", guidance, *drives] for place in own for guidance in ("map", "replan")),
            *(["--map", place, "--guidance", "map", *drives] for place in MAPS),
            *(
                ["--scenario", "complex", "--robot", name, "--guidance", "map", *drives]
                for name in NAMED
                if policy.robot != ROBOTS[name]
            ),
        ]
    placed = (
        ("complex", "map", options.robots),
        ("complex", "replan", options.elsewhere),
        ("clutter", "map", options.elsewhere),
        ("clutter", "replan", options.elsewhere),
        ("clutter", "goal", options.elsewhere),
        ("rooms", "map", options.elsewhere),
        ("dynamic", "map", options.elsewhere),
    )
    several = ["--episodes", "20", "--robots"]
    family = ["--robot", policy.family.name, *several]
    return [
        *(
            ["--scenario", place, "--guidance", guidance, *family, str(many)]
            for place, guidance, many in placed
        ),
        ["--scenario", "complex", "--guidance", "map", "--robot", CARS, *several, str(options.elsewhere)],
        *(["--scenario", "complex", "--robot", name, "--guidance", "map", *drives] for name in NAMED),
        ["--scenario", "dynamic", "--robot", "diffbot", "--guidance", "map", *drives],
        *(
            ["--map", place, "--robot", name, "--guidance", "map", *drives]
            for place in MAPS
            for name in NAMED
        ),
    ]


def main() -> int:
    """Measure what is not there; a row that has no task, as a robot that does not fit, is left out."""
    options = tyro.cli(Options, description=__doc__)
    policy = find_policy(options.policy)
    folder = RESULTS / options.policy
    for number, words in enumerate(rows(policy, options)):
        command = ["evaluate", "--policy", options.policy, *words]
        path = folder / f"{number:02}.json"
        if path.exists():
            known = json.loads(path.read_text(encoding="utf-8"))
            if (known["command"], known["policy_fingerprint"]) == (
                " ".join(["adrl", *command]),
                policy.fingerprint,
            ):
                continue
        path.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        if adrl([*command, "--json", str(path)]) == 0:
            summary = json.loads(path.read_text(encoding="utf-8"))
            files.write_json(path, {"command": " ".join(["adrl", *command])} | summary)
    return 0


if __name__ == "__main__":
    sys.exit(main())
