"""adrl robot."""

import math
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from adrl import files
from adrl.commands.options import parse
from adrl.commands.progress import console
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import DEFAULT
from adrl.descriptions import (
    Finding,
    Settled,
    Standing,
    given_fields,
    read_nav2,
    read_recorded_robot,
    read_urdf,
    robot_of,
    robot_text,
    settle,
)
from adrl.descriptions.findings import SHAPE, example, shown, span_text, unit
from adrl.errors import ConfigError
from adrl.outputs import require_file
from adrl.types import RobotConfig
from adrl.worlds.families import RobotFamily
from adrl.worlds.robots import FAMILIES, load_robots

PICTURES = (".png", ".svg", ".pdf")
DRAWN = 12
"""Robots in the picture of a family."""


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """A robot to draw, or what to make one of."""

    robot: Annotated[str | None, tyro.conf.Positional] = None
    """The robot to draw: a name (adrl list), a TOML file, or one of a family, as any:test:17; of a family, some of its
    robots."""
    from_nav2: tuple[Path, ...] = ()
    """Parameter files of Nav2, or of move_base."""
    from_urdf: Path | None = None
    """A URDF (extra urdf)."""
    from_bag: Path | None = None
    """A ROS 1 or ROS 2 bag of a drive (extra bags)."""
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME=VALUE of a field, whatever the sources say, such as --set max_speed_mps=0.5; may be given again."""
    scan_topic: str | None = None
    """Topic of the LiDAR that is meant, where there are several."""
    lidar: str | None = None
    """Link of the LiDAR in the URDF, where several or none are marked as one."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Where to: a picture of a robot that is drawn (PNG, SVG or PDF; ROBOT.png when left out), the TOML file of one
    that is made (standard output when left out)."""


def main(arguments: Sequence[str]) -> int:
    """Draw a robot, or make one."""
    options = parse(
        RobotOptions,
        arguments,
        "robot",
        "Draw a robot and its LiDAR, or write the robot file from Nav2 parameters, a URDF, a bag, or several of them.",
    )
    sources = [
        *options.from_nav2,
        *(path for path in (options.from_urdf, options.from_bag) if path is not None),
    ]
    if options.robot is not None:
        _refuse_others(options)
        return _draw(options.robot, options.out)
    if not sources:
        raise ConfigError("give a robot to draw, or --from-nav2, --from-urdf or --from-bag")
    require_file("--out", options.out)
    if options.out is not None and options.out.suffix != ".toml":
        raise ConfigError(f"--out {options.out} is to be the robot's file; give a name that ends in .toml")
    return _make(options, sources)


def _refuse_others(options: RobotOptions) -> None:
    """Raises ConfigError for an option that would do nothing."""
    for field in fields(options):
        if field.name not in ("robot", "out") and getattr(options, field.name) != field.default:
            raise ConfigError(
                f"--{field.name.replace('_', '-')} makes a robot, and {options.robot!r} is one to draw; leave one out"
            )


def _make(options: RobotOptions, sources: list[Path]) -> int:
    if options.lidar is not None and options.from_urdf is None:
        raise ConfigError("--lidar is a link of a URDF; give --from-urdf too")
    findings, notes = given_fields(options.set), list[str]()
    if options.from_nav2:
        reading = read_nav2(options.from_nav2, options.scan_topic)
        findings, notes = findings + reading.findings, notes + reading.notes
    if options.from_urdf is not None:
        base = next(
            (f.value for f in findings if f.field == "base_frame" and f.standing is Standing.SAID), None
        )
        reading = read_urdf(options.from_urdf, options.lidar, base)
        findings, notes = findings + reading.findings, notes + reading.notes
    if options.from_bag is not None:
        likely = [finding.value for finding in findings if finding.field == "scan_topic"]
        reading = read_recorded_robot(options.from_bag, options.scan_topic, likely)
        findings, notes = findings + reading.findings, notes + reading.notes
    findings = _with_topic(findings, options.scan_topic, sources)
    for note in notes:
        console().print(note, markup=False, highlight=False, soft_wrap=True)
    settled = settle(findings)
    if not settled.faults and settled.missing and sys.stdin.isatty():
        settled = settle([*findings, *_ask(settled.missing)])
    wrong = [*settled.faults, *(_missing(name, sources) for name in settled.missing)]
    for line in wrong:
        print(f"adrl: error: {line}", file=sys.stderr)
    if wrong:
        return 2
    return _write(settled, (options.out or sources[0]).stem, options.out)


def _with_topic(findings: list[Finding], topic: str | None, sources: list[Path]) -> list[Finding]:
    """With the topic of the scans that was given. Raises ConfigError where no source has it."""
    if topic is None:
        return findings
    topic = f"/{topic.strip('/')}"
    if topic not in [finding.value for finding in findings if finding.field == "scan_topic"]:
        raise ConfigError(
            f"--scan-topic {topic} is the topic of a LiDAR in none of {', '.join(map(str, sources))}"
        )
    given = Finding(field="scan_topic", value=topic, place="--scan-topic", standing=Standing.GIVEN)
    return [given, *findings]


def _write(settled: Settled, name: str, out: Path | None) -> int:
    robot = robot_of(name, settled.chosen)
    text = robot_text(robot, settled.chosen, out)
    if out is None:
        print(text, end="")
    else:
        files.atomic_write_text(out, text)
        print(out)
        command = text.partition("\n")[0].removeprefix("# ")
        measure = shlex.join(
            ["adrl", "evaluate", "--policy", DEFAULT, "--robot", str(out), "--map", "MAP.yaml"]
        )
        for line in (
            *_covered(robot, FAMILIES["any"]),
            f"how well it is driven on your map: {measure}",
            f"to drive it: {command}",
        ):
            console().print(line, markup=False, highlight=False, soft_wrap=True)
    return 0


def _missing(name: str, sources: list[Path]) -> str:
    """What to give for a field that no source says."""
    none = f"is in none of {', '.join(map(str, sources))}" if len(sources) > 1 else f"is not in {sources[0]}"
    give = f"give --set {name}=NUMBER ({span_text(name)})"
    if name == SHAPE[0]:
        return f"{' or '.join(SHAPE)} {none}; {give}, or --set {SHAPE[1]}={example(SHAPE[1])}"
    return f"{name} {none}; {give}"


def _ask(missing: Sequence[str]) -> list[Finding]:
    """The user's answers; those that are none are asked for again. At the end of the input, what is there so far."""
    answers: list[Finding] = []
    for name in missing:
        what = f"{name} ({span_text(name)})"
        if name == SHAPE[0]:
            what = f"{what}, or {SHAPE[1]} as [[x, y], ...] in m"
        while True:
            try:
                print(f"{what}: ", end="", file=sys.stderr, flush=True)
                text = input().strip()
            except EOFError:
                return answers
            try:
                asked = SHAPE[1] if name == SHAPE[0] and text.startswith("[") else name
                answers += given_fields([f"{asked}={text}"])
                break
            except ConfigError as error:
                print(str(error).removeprefix("--set "), file=sys.stderr)
    return answers


def _draw(name: str, out: Path | None) -> int:
    from adrl.report.figures import save
    from adrl.report.robot_figure import family_figure, robot_figure

    found = load_robots(name)
    out = out or Path(f"{Path(name).name.replace('.toml', '').replace(':', '-')}.png")
    require_file("--out", out)
    if out.suffix not in PICTURES:
        raise ConfigError(f"--out {out} is to be a picture; give a name that ends in {', '.join(PICTURES)}")
    if isinstance(found, RobotFamily):
        Console().print(_ranges(found))
        save(family_figure([found.draw("test", number) for number in range(DRAWN)]), out)
    else:
        Console().print(_table(found))
        for line in _covered(found, FAMILIES["any"]):
            print(line)
        save(robot_figure(found), out)
    print(out)
    return 0


def _numbers(config: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Names and values of a robot or a family, its LiDAR's last."""
    for field in fields(config):
        value = getattr(config, field.name)
        if field.name not in ("name", "lidar") and value is not None:
            ends = value if isinstance(value, tuple) else (value,)
            in_degrees = (
                " to ".join(f"{math.degrees(end):.0f}" for end in ends) if unit(field.name) == "rad" else ""
            )
            told = f"  ({in_degrees} degrees)" if in_degrees else ""
            yield f"{prefix}{field.name}", f"{shown(value)} {unit(field.name)}{told}".strip()
    if hasattr(config, "lidar"):
        yield from _numbers(config.lidar, "lidar.")


def _ranges(family: RobotFamily) -> Table:
    table = Table(title=f"family {family.name}", title_justify="left", show_header=False)
    for name, value in _numbers(family):
        table.add_row(name, value)
    return table


def _covered(robot: RobotConfig, family: RobotFamily) -> list[str]:
    """What a family says of a robot, and how fast the policy that is of this family drives it, if not at full speed."""
    outside = family.outside(robot)
    lines = [f"outside of family {family.name}: {line}" for line in outside]
    within_m = find_policy(DEFAULT).stop_within_m
    speed_mps = robot.slowed(within_m).max_speed_mps
    slow = (
        f"policy {DEFAULT} drives it at {speed_mps:.2g} m/s at most: it stops within {within_m:g} m then, and turns "
        f"within {2.0 * within_m:g} m"
    )
    return [
        *(lines or [f"family {family.name} covers it"]),
        *([slow] if speed_mps < robot.max_speed_mps else []),
    ]


def _table(robot: RobotConfig) -> Table:
    """Its numbers, then what follows from them."""
    from adrl.report.robot_figure import derived

    table = Table(title=robot.name, title_justify="left", show_header=False)
    for name, value in _numbers(robot):
        table.add_row(name, value)
    table.add_section()
    numbers = derived(robot)
    table.add_row("stops from full speed in", f"{robot.stop_time_s:.2f} s, {robot.stop_distance_m:.2f} m")
    table.add_row("narrowest gap, straight ahead", f"{numbers.gap_m:.2f} m")
    table.add_row("width that it turns in", f"{numbers.turning_width_m:.2f} m")
    if robot.is_car and robot.min_speed_mps == 0.0:
        table.add_row(
            "cannot back", "out of a dead end there is no way; min_speed_mps below 0 drives both ways"
        )
    table.add_row("blind angle of the LiDAR", f"{math.degrees(numbers.blind_rad):.0f} degrees")
    return table
