"""Measures what cards and pages tell: a file a row, in a folder of docs/results.

    python docs/measure.py default                                   a shipped policy, in policies/NAME
    python docs/measure.py default --elsewhere 30 --episodes 200     smaller, with wider intervals
    python docs/measure.py classical-still --episodes 200            planners, still worlds; classical-moving: discs
    python docs/measure.py people --episodes 200                     what drives among people
    python docs/measure.py planners --episodes 200                   the planner that demonstrates for each robot
    python docs/measure.py barn --worlds DIR                         in the BARN benchmark's worlds
    python docs/measure.py faults                                    drives with faults, in faults*.json

Each row is what `adrl evaluate`, or `adrl barn`, prints, with its command. Rows that were measured as they would be
today stay: with the same command, weights, and DRIVING of adrl.comparison.config. The others are driven. Then: make
tables.
"""

import json
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import tyro

from adrl import files
from adrl.baselines.planners import PLANNERS
from adrl.benchmarks.faults import FAULTS
from adrl.cli import main as adrl
from adrl.comparison.config import DRIVING
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.envs import NavVectorEnv
from adrl.imitation.best_planner import best_planner
from adrl.worlds import ROBOTS, load_robot
from adrl.worlds.place import Place

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results"
MAPS = tuple(
    f"tests/data/maps/{name}.yaml" for name in ("willow/willow-full", "depot/depot", "turtlebot3_world/map")
)
EVALUATE, BARN = ("evaluate",), ("barn", "--worlds", "DIR")
CARS = "docs/policies/cars.toml"
FORESEEING = ("astar-dwa", "astar-mppi", "astar-pursuit")
"""Planners that know where moving discs will be; those whose name goes on with -static do not."""
DEMONSTRATED = tuple(
    f"docs/results/planners/{name}.toml"
    for name in (
        "cart",
        "cart-forward",
        "rectangle",
        "rectangle-lag",
        "disc-lag",
        "rectangle-fast",
        "disc-fast",
    )
)
"""Robots of the page of planners."""
FAULT_DRIVES = {
    "faults.json": ["--scenario", "clutter", "rooms"],
    "faults-jackal.json": [
        *("--robot", "jackal", "--scenario", "rooms", "--first", "1", "--tasks", "10", "--fault", "none"),
        *("scan lost, 50 %", "scan late by 2, unsaid, for 2 s", "odometry late by 2, unsaid", "specks"),
    ],
}
"""Of the page of drives with faults, file by file."""
NAMED = ("diffbot", "turtlebot3_burger", "turtlebot3_waffle", "jackal")


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to measure, and how much of it."""

    what: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name, classical-still, classical-moving, people, planners or barn: the folder's name; or
    faults."""
    robots: int = 1000
    """Robots of its family on complex with the map, with 20 tasks each."""
    elsewhere: int = 100
    """The same in other places and with other guidance."""
    episodes: int = 500
    """Tasks of one robot."""
    worlds: Path = Path("DIR")
    """For barn: folder of the benchmark's worlds, as adrl barn takes it."""


def of_policy(policy: ResolvedPolicy, options: Options) -> list[list[str]]:
    """The options of `adrl evaluate` that make a row each, but for --policy."""
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


def still(options: Options) -> list[list[str]]:
    """Planners in still worlds, with the map and without."""
    rows = (
        f"{planner} --robot {robot} --scenario {place} --guidance {guidance} --episodes {options.episodes}"
        for robot in ("jackal", "diffbot")
        for place in ("complex", "rooms", "clutter")
        for guidance in ("map", "replan")
        for planner in FORESEEING
    )
    return [["--policy", *row.split()] for row in rows]


def moving(options: Options) -> list[list[str]]:
    """Planners among moving discs, those that know where the discs will be and those that do not."""
    rows = (
        f"{planner}{ending} --robot {robot} --scenario dynamic --guidance map --episodes {options.episodes}"
        for robot in ("jackal", "diffbot")
        for planner in FORESEEING
        for ending in ("", "-static")
    )
    return [["--policy", *row.split()] for row in rows]


def planners(options: Options) -> list[list[str]]:
    """The planner that demonstrates for a robot, on tasks that its choice has not seen; and A*+DWA where that is
    another."""
    still = {f"--scenario {name}": Place(scenario=name) for name in ("complex", "rooms")}
    cells = [(robot, *place) for robot in (*DEMONSTRATED, "jackal") for place in still.items()]
    cells += [(robot, f"--map {MAPS[0]}", Place(map=Path(MAPS[0]))) for robot in DEMONSTRATED[2:5]]
    rows = (
        f"{planner} --robot {robot} {where} --guidance map --split validation --episodes {options.episodes}"
        for robot, where, place in cells
        for planner in dict.fromkeys((demonstrator(robot, place), "astar-dwa"))
    )
    return [["--policy", *row.split()] for row in rows]


def demonstrator(robot: str, place: Place) -> str:
    """The planner that adrl train and adrl collect choose."""
    env = NavVectorEnv(1, scenario=place.load(), robot=load_robot(robot))
    return f"astar-{best_planner(env).controller}"


def people(options: Options) -> list[list[str]]:
    """Planners and shipped policies among people, among DynaBARN's kind of cylinders, and on a map with people."""
    drives = f"--episodes {options.episodes}"
    with_map = ("astar-mppi --guidance map", "astar-mppi-static --guidance map", "astar-dwa --guidance map")
    policies = ("default --guidance map", "diffbot --guidance map")
    own_map = ("astar-mppi --guidance replan", "astar-dwa --guidance replan", "default --guidance replan")
    crowds = [
        f"{who} --robot diffbot --scenario {place} {drives}"
        for place in ("crowd --people 12", "corridor", "doorway")
        for who in (*with_map, "orca --guidance map", *policies, *own_map)
    ]
    barn = [
        f"{who} --robot jackal_dynabarn --scenario dynabarn {drives}"
        for who in (*with_map, policies[0], own_map[1])
    ]
    on_map = [
        f"{who} --robot diffbot --map {MAPS[0]} --people 40 --episodes 100"
        for who in (policies[1], policies[0], with_map[0])
    ]
    return [["--policy", *row.split()] for row in (*crowds, *barn, *on_map)]


def barn(_: Options) -> list[list[str]]:
    """The shipped policy in the benchmark's worlds, and the planner, which knows the map."""
    rows = (
        f"{who} --v-max {v_max}" for who in ("jackal", "astar-dwa --trials 2") for v_max in ("2", "1", "0.5")
    )
    return [["--policy", *row.split()] for row in rows]


PAGES: dict[str, Callable[[Options], list[list[str]]]] = {
    "classical-still": still,
    "classical-moving": moving,
    "barn": barn,
    "people": people,
    "planners": planners,
}


def main() -> int:
    """Measure what is not there; fails where a row could not be driven."""
    options = tyro.cli(Options, description=__doc__)
    if options.what == "faults":
        return max(measure_faults(RESULTS / name, row) for name, row in FAULT_DRIVES.items())
    if options.what in PAGES:
        folder, rows = RESULTS / options.what, PAGES[options.what](options)
    else:
        folder = RESULTS / "policies" / options.what
        rows = [["--policy", options.what, *row] for row in of_policy(find_policy(options.what), options)]
    paths = [folder / f"{number:02}.json" for number in range(len(rows))]
    for old in set(folder.glob("*.json")) - set(paths):
        old.unlink()
    drive = BARN if options.what == "barn" else EVALUATE
    codes = [measure(path, row, drive, options.worlds) for path, row in zip(paths, rows, strict=True)]
    return max(codes)


def measure(
    path: Path, row: list[str], drive: Sequence[str] = EVALUATE, worlds: Path = Options.worlds
) -> int:
    """Have the file of a row, measured today or as it would be. Returns the exit code of the command that drives, 0 if
    it is there."""
    words = [*drive, *row]
    command = " ".join(["adrl", *words])
    weights = find_policy(row[1], PLANNERS).fingerprint
    if path.exists():
        known = json.loads(path.read_text(encoding="utf-8"))
        told = (known.get("command"), known["policy_fingerprint"], known.get("driving"))
        if told == (command, weights, DRIVING):
            return 0
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    driven = [str(worlds) if word == "DIR" else word for word in words]  # no file tells where they lie
    if code := adrl([*driven, "--json", str(path)]):
        return code
    summary = json.loads(path.read_text(encoding="utf-8"))
    files.write_json(path, {"command": command, "driving": DRIVING} | summary)
    return 0


def measure_faults(path: Path, row: list[str]) -> int:
    """Drive robots with faults, and keep of each fault how its drives ended, and in how many each reason was given.
    Returns the exit code of `adrl bench faults`."""
    words = ["bench", "faults", *row]
    with TemporaryDirectory() as folder:
        whole = Path(folder) / "faults.json"
        if code := adrl([*words, "--json", str(whole)]):
            return code
        driven = json.loads(whole.read_text(encoding="utf-8"))
    ends = {row["fault"]: {} for row in driven["faults"]}
    for drive in driven["each"]:
        ends[drive["fault"]][f"{drive['robot']} {drive['scenario']} {drive['task']}"] = drive["outcome"]
    reasons = {row["fault"]: row["reasons"] for row in driven["faults"]}
    about = {"command": shlex.join(["adrl", *words]), "driving": DRIVING}
    about |= {"policies": {name: find_policy(name).fingerprint for name in ("diffbot", "jackal")}}
    rows = [{"fault": name, "ends": ends[name], "reasons": reasons[name]} for name in FAULTS if name in ends]
    files.write_json(path, about | {"faults": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
