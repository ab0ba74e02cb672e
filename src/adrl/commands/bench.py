"""adrl bench."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from adrl import files
from adrl.benchmarks import fault_drives
from adrl.benchmarks.act import bench_act, bench_runtime
from adrl.benchmarks.faults import FAULTS
from adrl.benchmarks.mixed import bench_mixed
from adrl.benchmarks.plan import bench_car_paths, bench_controllers, bench_map, bench_replan
from adrl.benchmarks.sim import bench_sim
from adrl.commands.options import Runner, parse, subcommand
from adrl.deploy.policy import DEFAULT, load_policy, resolve_policy
from adrl.outputs import require_file
from adrl.worlds import load_robot
from adrl.worlds.ros_map import Unknown


@dataclass(frozen=True, kw_only=True)
class SimOptions:
    """The simulator."""

    envs: int = 1024
    """Robots stepped at once."""
    threads: int = 0
    """Threads; 0 takes one per core."""
    beams: int = 180
    """Beams of each robot's LiDAR."""
    obstacles: int = 40
    """Circles in each world, besides its four walls."""
    robots: int = 1
    """Above 1: also so many different robots side by side, against the same robots a kind a batch."""
    people: int = 0
    """People about each robot; with some, RVO2 from Python (pyrvo) is measured with the same ones."""
    seconds: float = 1.0
    """Length of a round, s."""
    rounds: int = 5
    """Rounds; the median is reported, and peers take turns with ours."""
    peer_python: tuple[Path, ...] = ()
    """Interpreters with ir-sim or irsim-x to measure in the same world; one environment each."""
    json: Path | None = None
    """File for the results."""


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """The planners."""

    robot: str = "diffbot"
    """Whose local controllers decide: a robot's name (adrl list), or a TOML file."""
    map: Path | None = None
    """ROS map to plan across, besides the decisions on complex."""
    unknown: Unknown = "solid"
    """What cells of the map are that nothing has looked at: solid or free."""
    envs: int = 512
    """Robots that decide at once."""
    threads: int = 0
    """Threads; 0 takes one per core."""
    seconds: float = 1.0
    """Length of a round, s."""
    rounds: int = 5
    """Rounds; the median is reported."""
    json: Path | None = None
    """File for the results."""


@dataclass(frozen=True, kw_only=True)
class ActOptions:
    """One robot, on one core."""

    policy: str = DEFAULT
    """a shipped policy (adrl list), or a run folder."""
    steps: int = 5000
    """Control steps to time, of each guidance."""
    json: Path | None = None
    """File for the results."""


@dataclass(frozen=True, kw_only=True)
class FaultOptions:
    """Robots behind their supervisors, driving while something is wrong."""

    fault: tuple[str, ...] = ()
    """Only the faults whose names hold one of these; all when none is given."""
    robot: tuple[str, ...] = fault_drives.ROBOT_NAMES
    """Robots by name (adrl list), or TOML files."""
    scenario: tuple[str, ...] = fault_drives.SCENARIOS
    """Scenarios by name (adrl list)."""
    tasks: int = 1
    """Test tasks of each scenario."""
    first: int = 0
    """Number of the first task."""
    json: Path | None = None
    """File for the results."""


@dataclass(frozen=True, kw_only=True)
class LearnOptions:
    """The learner, on one core."""

    widths: tuple[int, ...] = (128, 256)
    """Units of each of the two hidden layers; one measurement each."""
    seconds: float = 2.0
    """Length of a round, s."""
    rounds: int = 5
    """Rounds; the median is reported, and ours, Stable-Baselines3's and the matrix product take turns."""
    json: Path | None = None
    """File for the results."""


@dataclass(frozen=True, kw_only=True)
class GazeboOptions:
    """Gazebo in lock-step, and our side of the connection, on one core."""

    robot: str = "diffbot"
    """A robot's name (adrl list) or a TOML file."""
    envs: int = 1
    """Robots driven side by side."""
    physics_step_s: float = 0.004
    """Step of Gazebo's physics, s."""
    steps: int = 500
    """Control periods of a round."""
    rounds: int = 5
    """Rounds; the median is reported."""
    json: Path | None = None
    """File for the results."""


@dataclass(frozen=True, kw_only=True)
class Ros2Options:
    """A node of ROS 2, and a simulated robot in real time beside it."""

    policy: str = DEFAULT
    """a shipped policy (adrl list), or a run folder."""
    scans: int = 600
    """Scans to time, ten a second with the default policy."""
    quota: float = 0.0
    """Of one core, what the node may use, as 0.2: a slow computer. 0 for all; a quota needs root and cgroups."""
    json: Path | None = None
    """File for the results."""


@dataclass(frozen=True, kw_only=True)
class Nav2Options:
    """Our controller in the place of Nav2's, and paths of another planner."""

    policy: str = DEFAULT
    """a shipped policy (adrl list), or a run folder."""
    paths: int = 200
    """Test tasks whose paths are followed, one after the other."""
    robot: str = "diffbot"
    """A robot's name (adrl list) or a TOML file."""
    scenario: str = "complex"
    """A scenario's name (adrl list)."""
    speed: float = 1.0
    """Times as fast as real time."""
    json: Path | None = None
    """File for the results."""


def _gather(arguments: Sequence[str], option: str) -> list[str]:
    """The arguments with all values of a repeated option behind one: --x A --x B is --x A B."""
    rest: list[str] = []
    values: list[str] = []
    taking = False
    for argument in arguments:
        if argument.startswith("-"):
            name, equals, value = argument.partition("=")
            taking = name == option and not equals
            if name == option:
                values += [value] if equals else []
                continue
        (values if taking else rest).append(argument)
    return [*rest, option, *values] if values else rest


def _sim(arguments: Sequence[str]) -> int:
    arguments = _gather(arguments, "--peer-python")
    options = parse(SimOptions, arguments, "bench sim", "Environment steps a second.")
    require_file("--json", options.json)
    results = bench_sim(
        num_envs=options.envs,
        num_threads=options.threads,
        num_beams=options.beams,
        num_obstacles=options.obstacles,
        num_people=options.people,
        seconds=options.seconds,
        rounds=options.rounds,
        peers=options.peer_python,
    )
    if options.robots != 1:
        results["mixed"] = bench_mixed(
            num_robots=options.robots,
            num_envs=options.envs,
            num_threads=options.threads,
            num_beams=options.beams,
            num_obstacles=options.obstacles,
            seconds=options.seconds,
            rounds=options.rounds,
        )
    return _report(results, options.json)


def _plan(arguments: Sequence[str]) -> int:
    options = parse(
        PlanOptions,
        arguments,
        "bench plan",
        "Local controllers' decisions a second, and planning across a map.",
    )
    require_file("--json", options.json)
    robot = load_robot(options.robot)
    results = bench_controllers(
        robot=robot,
        num_envs=options.envs,
        num_threads=options.threads,
        seconds=options.seconds,
        rounds=options.rounds,
    )
    if robot.is_car:
        results["car_path"] = bench_car_paths(robot)
    results["replan"] = bench_replan()
    results["policy_step"] = bench_act(load_policy(resolve_policy(DEFAULT)))
    if options.map is not None:
        results["map"] = bench_map(options.map, options.unknown)
    return _report(results, options.json)


def _act(arguments: Sequence[str]) -> int:
    options = parse(ActOptions, arguments, "bench act", "A robot's step from scan to command.")
    require_file("--json", options.json)
    policy = load_policy(resolve_policy(options.policy))
    results = {
        "schema_version": 1,
        "policy_step": bench_act(policy, steps=options.steps),
        "runtime": bench_runtime(policy, steps=options.steps),
    }
    return _report(results, options.json)


def _faults(arguments: Sequence[str]) -> int:
    options = parse(FaultOptions, arguments, "bench faults", "Drives with faults, and how they end.")
    require_file("--json", options.json)
    names = [name for name in FAULTS if any(part in name for part in options.fault or ("",))]
    drives = fault_drives.fault_drives(
        names, robots=options.robot, scenarios=options.scenario, tasks=options.tasks, first=options.first
    )
    results = {
        "schema_version": 1,
        "drives": len(drives),
        "faults": fault_drives.table(drives),
        "each": [asdict(drive) for drive in drives],
    }
    return _report(results, options.json)


def _learn(arguments: Sequence[str]) -> int:
    from adrl.benchmarks.learn import bench_learn

    options = parse(LearnOptions, arguments, "bench learn", "Gradient updates a second.")
    require_file("--json", options.json)
    results = bench_learn(widths=options.widths, seconds=options.seconds, rounds=options.rounds)
    return _report(results, options.json)


def _gazebo(arguments: Sequence[str]) -> int:
    from adrl.benchmarks.gazebo import bench_gazebo

    options = parse(GazeboOptions, arguments, "bench gazebo", "Control steps a second in Gazebo.")
    require_file("--json", options.json)
    results = bench_gazebo(
        options.robot,
        num_envs=options.envs,
        physics_step_s=options.physics_step_s,
        steps=options.steps,
        rounds=options.rounds,
    )
    return _report(results, options.json)


def _ros2(arguments: Sequence[str]) -> int:
    from adrl.benchmarks.ros2 import bench_ros2

    options = parse(Ros2Options, arguments, "bench ros2", "From scan to command over DDS, and what it costs.")
    require_file("--json", options.json)
    return _report(bench_ros2(options.policy, scans=options.scans, quota=options.quota), options.json)


def _nav2(arguments: Sequence[str]) -> int:
    from adrl.benchmarks.nav2 import bench_nav2

    options = parse(Nav2Options, arguments, "bench nav2", "Paths of another planner through our controller.")
    require_file("--json", options.json)
    results = bench_nav2(
        options.policy,
        paths=options.paths,
        robot=options.robot,
        scenario=options.scenario,
        speed=options.speed,
    )
    return _report(results, options.json)


def _report(results: dict[str, Any], path: Path | None) -> int:
    if path is not None and str(path) != "-":
        files.write_json(path, results)
    print(files.to_json(results))
    return 0


WHAT: dict[str, tuple[str, Runner]] = {
    "sim": (
        "environment steps a second, beside ir-sim and irsim-x where they are installed",
        _sim,
    ),
    "plan": (
        "local controllers' decisions a second, replanning, a policy's step, and planning across a map",
        _plan,
    ),
    "act": (
        "a robot's step from scan to command, the policy alone and the runtime with its supervisor",
        _act,
    ),
    "faults": (
        "drives with faults of scans, odometry, commands and clocks, and how they end",
        _faults,
    ),
    "learn": (
        "gradient updates a second on one core, beside Stable-Baselines3's TD3 where it is installed",
        _learn,
    ),
    "gazebo": (
        "control steps a second of robots in Gazebo, where it is set up",
        _gazebo,
    ),
    "ros2": (
        "a node of ROS 2 from scan to command over DDS, and its processor time; in .venv-ros2",
        _ros2,
    ),
    "nav2": (
        "how paths of another planner end through our controller for Nav2; in .venv-ros2",
        _nav2,
    ),
}


def main(arguments: Sequence[str]) -> int:
    """Measure and print."""
    return subcommand("bench", "benchmark", WHAT, arguments)
