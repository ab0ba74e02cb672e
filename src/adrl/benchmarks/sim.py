"""Environment steps a second of the batch simulator, and of other simulators in the same world in the same run."""

import json
import math
import os
import statistics
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from adrl.benchmarks.timing import rate_per_second, require_rounds
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.types import NOBODY, Array, RobotConfig, Task, World
from adrl.worlds.people import Crowd, Ground, anywhere, draw_people
from adrl.worlds.shapes import enclosure

SIZE_M = 10.0
WORLDS = 32
PEER_TIMEOUT_S = 120.0


def circles(rng: np.random.Generator, count: int) -> Array:
    """(count, 3) circles around a free middle: x, y, radius in metres."""
    angle, away = rng.uniform(0.0, 2.0 * math.pi, count), rng.uniform(1.5, 4.5, count)
    x, y = 0.5 * SIZE_M + away * np.cos(angle), 0.5 * SIZE_M + away * np.sin(angle)
    return np.stack([x, y, rng.uniform(0.15, 0.4, count)], axis=1)


def bench_sim(
    *,
    num_envs: int = 1024,
    num_threads: int = 0,
    num_beams: int = 180,
    num_obstacles: int = 40,
    num_people: int = 0,
    seconds: float = 1.0,
    rounds: int = 5,
    peers: Sequence[Path] = (),
) -> dict[str, Any]:
    """Median steps a second over the rounds; peers, and with people RVO2 from Python, are measured between them.

    A step is one robot's: motion, collision, noisy scan and guidance; a robot that crashes is reset within it.
    peers: interpreters in which irsim is installed. Raises ConfigError for one that cannot run it.
    """
    for name, value, least in (("num_envs", num_envs, 1), ("num_obstacles", num_obstacles, 0)):
        if value < least:
            raise ConfigError(f"{name} is {value}; give {least} or more")
    require_rounds(rounds, seconds)
    sim, step = _our_step(num_envs, num_threads, num_beams, num_obstacles, num_people)
    crowd = rvo_step(bench_task(np.random.default_rng(0), num_obstacles, num_people)) if num_people else None
    ours: list[float] = []
    of_crowd: list[float] = []
    theirs: dict[str, list[dict[str, Any]]] = {str(path): [] for path in peers}
    for _ in range(rounds):
        ours.append(rate_per_second(step, seconds))
        if crowd is not None:
            of_crowd.append(rate_per_second(crowd, seconds))
        for path in theirs:
            theirs[path].append(_peer(path, num_beams, num_obstacles, seconds))
    rate = statistics.median(ours)
    return {
        "schema_version": 1,
        "steps_per_second": rate,
        "steps_per_second_rounds": ours,
        "threads": sim.num_threads,
        "envs": num_envs,
        "beams": num_beams,
        "obstacles": num_obstacles + 4,
        "people": num_people,
        "peers": [_peer_row(runs, rate) for runs in (*theirs.values(), *_as_runs(of_crowd))],
    }


def _our_step(
    num_envs: int, num_threads: int, num_beams: int, num_obstacles: int, num_people: int
) -> tuple[NavSim, Any]:
    robot = RobotConfig()
    robot = replace(robot, lidar=replace(robot.lidar, num_beams=num_beams))
    rng = np.random.default_rng(0)
    tasks = [bench_task(rng, num_obstacles, num_people) for _ in range(WORLDS)]
    sim = NavSim(num_envs, robot, num_threads=num_threads)
    everyone = np.arange(num_envs)
    sim.reset(everyone, [tasks[i % WORLDS] for i in everyone], everyone.astype(np.uint64), rng)
    low, high = [0.0, -robot.max_yaw_rate_radps], [robot.max_speed_mps, robot.max_yaw_rate_radps]
    sim.b["command"][:] = rng.uniform(low, high, (num_envs, 2))

    def step() -> int:
        sim.native.step()
        sim.native.reset(sim.b["collided"])
        return num_envs

    step()
    return sim, step


def bench_task(rng: np.random.Generator, num_obstacles: int, num_people: int = 0) -> Task:
    """Start in the middle of a square room with so many circles and people, and a goal in its corner."""
    bounds = (0.0, 0.0, SIZE_M, SIZE_M)
    middle = 0.5 * SIZE_M
    world = World(bounds=bounds, circles=circles(rng, num_obstacles), segments=enclosure(bounds))
    goal = (SIZE_M - 0.5, SIZE_M - 0.5)
    start = (middle, middle, float(rng.uniform(-math.pi, math.pi)))
    people = NOBODY
    if num_people:
        crowd = Crowd(count=(num_people, num_people))
        people = draw_people(rng, crowd, Ground(world, RobotConfig(), crowd.radius_m[1]), anywhere, start)
    return Task(
        world=world,
        start=start,
        people=people,
        goal=goal,
        path=np.array([(middle, middle), goal]),
        shortest_m=math.dist((middle, middle), goal),
        time_limit_s=math.inf,
    )


def rvo_step(task: Task) -> Callable[[], int]:
    """A step of the same people and robot in RVO2, by pyrvo: 0.1 s, their headings set from Python as its users do.

    Nothing is sensed. Raises ConfigError without pyrvo.
    """
    try:
        import pyrvo
    except ImportError as error:
        raise ConfigError("--people is measured against pyrvo; pip install pyrvo") from error
    rvo, people = pyrvo.RVOSimulator(), task.people  # pyright: ignore[reportAttributeAccessIssue]  its stubs lack it
    rvo.set_time_step(0.1)
    for route, radius, speed in zip(people.routes, people.radius_m, people.speed_mps, strict=True):
        rvo.add_agent(tuple(route[0]), 5.0, 10, 3.0, 1.0, float(radius), 1.25 * float(speed))
    rvo.add_agent(task.start[:2], 5.0, 10, 3.0, 1.0, 0.2, 0.6)
    x, y = SIZE_M, SIZE_M
    rvo.add_obstacle([(0.0, 0.0), (0.0, y), (x, y), (x, 0.0)])
    rvo.process_obstacles()
    goals = [
        (float(route[-1][0]), float(route[-1][1]), float(speed))
        for route, speed in zip(people.routes, people.speed_mps, strict=True)
    ]
    goals.append((*task.goal, 0.6))

    def step() -> int:
        for k, (goal_x, goal_y, speed) in enumerate(goals):
            at = rvo.get_agent_position(k)
            ahead_x, ahead_y = goal_x - at.x, goal_y - at.y
            scale = speed / max(math.hypot(ahead_x, ahead_y), 1e-6)
            rvo.set_agent_pref_velocity(k, (scale * ahead_x, scale * ahead_y))
        rvo.do_step()
        return 1

    return step


def _as_runs(rates: Sequence[float]) -> list[list[dict[str, Any]]]:
    """Those of pyrvo, as peers answer; none without any."""
    if not rates:
        return []
    return [[{"name": "pyrvo", "version": version("pyrvo"), "steps_per_second": rate} for rate in rates]]


def _peer_row(runs: list[dict[str, Any]], ours: float) -> dict[str, Any]:
    rate = statistics.median(run["steps_per_second"] for run in runs)
    return {
        "name": runs[0]["name"],
        "version": runs[0]["version"],
        "steps_per_second": rate,
        "ratio": ours / rate,
    }


# Runs in the peer's interpreter, which knows nothing of ADRL. Reads the world as JSON, answers in JSON.
_PEER_PROGRAM = """
import json, os, sys, tempfile, time
from importlib.metadata import PackageNotFoundError, version
spec = json.load(sys.stdin)
robot = {
    "kinematics": {"name": "diff"},
    "shape": {"name": "circle", "radius": 0.2},
    "state": [5.0, 5.0, 0.0],
    "goal": [9.5, 9.5, 0.0],
    "vel_max": [0.6, 1.5],
    "sensors": [{"name": "lidar2d", "range_min": 0, "range_max": 6, "angle_range": 6.28318, "number": spec["beams"]}],
}
obstacles = [{"shape": {"name": "circle", "radius": r}, "state": [x, y, 0.0]} for x, y, r in spec["circles"]]
walls = [[[0, 0], [10, 0]], [[10, 0], [10, 10]], [[10, 10], [0, 10]], [[0, 10], [0, 0]]]
obstacles += [{"shape": {"name": "linestring", "vertices": wall}, "state": [0, 0, 0]} for wall in walls]
world = {"height": 10, "width": 10, "step_time": 0.1, "sample_time": 0.1, "collision_mode": "unobstructed"}
import numpy as np, yaml
with tempfile.NamedTemporaryFile("w", suffix=".yaml", delete=False) as file:
    yaml.safe_dump({"world": world, "robot": [robot], "obstacle": obstacles}, file)
import irsim
env = irsim.make(file.name, display=False, log_level="ERROR")
os.unlink(file.name)
action = np.array([[0.3], [1.4]])
for _ in range(5):
    env.step(action)
done, begin = 0, time.perf_counter()
while time.perf_counter() - begin < spec["seconds"]:
    env.step(action)
    env.get_lidar_scan()
    done += 1
rate = done / (time.perf_counter() - begin)
for name in ("irsim-x", "ir-sim"):
    try:
        found = version(name)
        break
    except PackageNotFoundError:
        continue
print("ADRL " + json.dumps({"name": name, "version": found, "steps_per_second": rate}))
"""


def _peer(python: str, num_beams: int, num_obstacles: int, seconds: float) -> dict[str, Any]:
    spec = {
        "beams": num_beams,
        "circles": circles(np.random.default_rng(0), num_obstacles).tolist(),
        "seconds": seconds,
    }
    try:
        ran = subprocess.run(
            [python, "-c", _PEER_PROGRAM],
            input=json.dumps(spec),
            capture_output=True,
            text=True,
            timeout=PEER_TIMEOUT_S,
            env=os.environ | {"MPLBACKEND": "Agg"},
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigError(f"--peer-python {python}: {error}") from None
    answers = [line for line in ran.stdout.splitlines() if line.startswith("ADRL ")]
    if ran.returncode != 0 or not answers:
        reason = (ran.stderr.strip().splitlines() or ["no output"])[-1]
        raise ConfigError(
            f"--peer-python {python}: could not run irsim: {reason}; install ir-sim or irsim-x there"
        )
    return json.loads(answers[-1].removeprefix("ADRL "))
