"""adrl collect."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from adrl.bags.reader import COMMAND_TOPIC, ODOMETRY_TOPIC, POSE_TOPIC, SCAN_TOPIC
from adrl.commands.options import given, load_place, parse, refuse, tell_guidance
from adrl.commands.progress import console
from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError
from adrl.imitation import (
    BagSummary,
    BagTopics,
    Source,
    collect,
    read_demonstrations,
    require_minari,
    save_minari,
)
from adrl.imitation.best_planner import planner_of
from adrl.imitation.experts import PERFECT, find_expert
from adrl.observation import EncoderConfig
from adrl.outputs import require_folder
from adrl.worlds import load_robot
from adrl.worlds.place import Place


@dataclass(frozen=True, kw_only=True)
class CollectOptions(Place):
    """What to record, or where it was recorded."""

    out: Path
    """Folder of the new Minari dataset."""
    robot: str = "diffbot"
    """A robot's name (adrl list) or a TOML file; with --bag, the robot that drove."""
    guidance: Literal["goal", "replan", "map"] | None = None
    """What the observations show: the final goal (replan: its own waypoint when blocked), or one on the A* path. Left
    out: map with --map or --world, else goal, as adrl train has it."""
    expert: str = PERFECT
    """Who drives: NAME or NAME:NUMBER, as slow:0.5 (adrl list)."""
    steps: int = 20_000
    """Environment steps to record; of the expert few its drives, whatever they take."""
    seed: int = 0
    """Of tasks, noise and robots."""
    num_envs: int = 64
    """Robots driven side by side."""
    bag: tuple[Path, ...] = ()
    """ROS 1 bags or folders of ROS 2 bags of a robot that somebody drove, instead of an expert in the simulator (extra
    bags)."""
    scan_topic: str = SCAN_TOPIC
    """Topic of the bags' scans, LaserScan."""
    odometry_topic: str = ODOMETRY_TOPIC
    """Topic of their odometry."""
    command_topic: str = COMMAND_TOPIC
    """Topic of their commands, Twist or TwistStamped."""
    goal_topic: str | None = None
    """Topic of their goals, PoseStamped. Left out: /goal_pose or /move_base_simple/goal; in a bag without either, goals
    are where the robot came to stand."""
    pose_topic: str = POSE_TOPIC
    """Topic of where the robot is on the map, PoseWithCovarianceStamped: for goals on the map in a bag without /tf."""
    zero_is_free: bool = False
    """The bags' LiDAR reports 0 where nothing comes back, as the LDS-01 does."""
    nan_is_free: bool = False
    """The bags' LiDAR reports NaN where nothing comes back."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """As adrl train takes it: demonstrations fit a policy of the same encoder."""


OF_BAGS = (
    "bag",
    "scan_topic",
    "odometry_topic",
    "command_topic",
    "goal_topic",
    "pose_topic",
    "zero_is_free",
    "nan_is_free",
)
OF_BOTH = ("out", "robot", "encoder")


def main(arguments: Sequence[str]) -> int:
    """Record demonstrations, or read them."""
    options = parse(
        CollectOptions,
        arguments,
        "collect",
        "Record demonstrations as a Minari dataset: of an expert in the simulator, or from bags of your robot.",
    )
    require_minari()
    require_folder("--out", options.out)
    _refuse_others(options)
    return _from_bags(options) if options.bag else _from_simulator(options)


def _refuse_others(options: CollectOptions) -> None:
    """Raises ConfigError for an option that would do nothing."""
    if options.bag:
        refuse(
            options,
            given(options).keys() - {*OF_BAGS, *OF_BOTH},
            "is for the simulator, and --bag reads what was driven; leave one out",
        )
    else:
        refuse(options, OF_BAGS, "is for bags; give --bag too")


def _from_simulator(options: CollectOptions) -> int:
    if options.seed < 0:
        raise ConfigError(f"seed is {options.seed}; give 0 or more")
    tell_guidance(options, options.guidance)
    env = NavVectorEnv(
        options.num_envs,
        scenario=load_place(options),
        robot=load_robot(options.robot),
        guidance=options.guidance or options.default_guidance,
        encoder=options.encoder,
        task_priority=0.0,
    )
    planner = planner_of(find_expert(options.expert), env)
    console().print(str(planner))
    env.expert = planner.controller
    demonstrations = collect(env, options.steps, expert=options.expert, seed=options.seed)
    save_minari(demonstrations, options.out, Source.of(env, expert=options.expert, seed=options.seed))
    console().print(f"{len(demonstrations)} steps, {int(demonstrations.success.sum())} arrivals")
    if int(demonstrations.ended.sum()) == options.num_envs and not demonstrations.terminated.any():
        length = len(demonstrations) // options.num_envs
        console().print(
            f"all {options.num_envs} episodes were cut off after {length} steps, and nothing shows how to arrive; give "
            "more --steps, or fewer --num-envs"
        )
    print(options.out)
    return 0


def _from_bags(options: CollectOptions) -> int:
    robot = load_robot(options.robot)
    topics = BagTopics(
        scan=options.scan_topic,
        odometry=options.odometry_topic,
        command=options.command_topic,
        goal=options.goal_topic,
        pose=options.pose_topic,
    )
    demonstrations, summaries = read_demonstrations(
        options.bag,
        robot,
        encoder=options.encoder,
        topics=topics,
        zero_is_free=options.zero_is_free,
        nan_is_free=options.nan_is_free,
    )
    source = Source(
        robot=robot,
        encoder=options.encoder,
        guidance="goal",
        scenario="bags",
        demonstrator="whoever drove the robot",
        extra={"bags": {str(path): asdict(s) for path, s in zip(options.bag, summaries, strict=True)}},
    )
    save_minari(demonstrations, options.out, source)
    for path, summary in zip(options.bag, summaries, strict=True):
        console().print(_told(path, summary))
    print(options.out)
    return 0


def _told(path: Path, summary: BagSummary) -> str:
    """A line about a bag."""
    text = (
        f"{path}: {summary.episodes} episodes, {summary.arrivals} arrivals, {summary.used_s:.0f} of "
        f"{summary.recorded_s:.0f} s"
    )
    if not summary.goals_from_topic:
        text += "; no topic of goals: they are where the robot came to stand"
    if summary.clipped > 0.0:
        text += f"; {100.0 * summary.clipped:.1f} % of the commands are beyond the robot's speeds and were clipped"
    return "\n".join([text, *(f"  {note}" for note in summary.notes)])
