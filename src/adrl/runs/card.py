"""A policy's model card: what it saw, how good it is where, and what it must not be used for."""

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from adrl.deploy.policy import PolicyConfig
from adrl.errors import ConfigError
from adrl.registry import listed
from adrl.report.markdown import cell, table
from adrl.runs import RunConfig
from adrl.runs.record import TEACHERS
from adrl.types import GUIDANCE

MOVING = frozenset({"dynamic", "dynabarn", "crowd", "corridor", "doorway", "office"})
"""Places where something moves."""
GOOD = 0.95
"""Success that a policy is good for, at least."""
FAMILY_NUMBERS = {
    "max_speed_mps": "m/s",
    "radius_m": "m, discs",
    "length_m": "m long, rectangles",
    "width_m": "m wide, rectangles",
    "braking_s": "s to stop",
    "control_period_s": "s, control period",
}
LIDAR_NUMBERS = {"num_beams": "beams", "fov_rad": "rad, field of view", "max_range_m": "m, range"}


def card(config: PolicyConfig, fingerprint: str, measured: Sequence[Mapping[str, Any]]) -> list[str]:
    """The card in Markdown, from the policy's config.json and summaries of `adrl evaluate --json` with the `command`
    of each beside. Raises ConfigError for a summary of other weights."""
    for summary in measured:
        if summary["policy_fingerprint"] != fingerprint:
            raise ConfigError(
                f"{summary['command']}: was measured with other weights ({summary['policy_fingerprint']}, and the "
                f"policy's are {fingerprint}); run python docs/measure.py {summary['policy']}"
            )
    return [
        *("## What it saw", ""),
        *table(("", ""), [*_saw(config), ("weights", f"`{fingerprint}`")]),
        *("## How good it is where", ""),
        *_good(measured),
        *("## What it must not be used for", ""),
        *(f"- {line}" for line in _must_not(config, measured)),
        "",
    ]


def _guidances(config: PolicyConfig) -> Sequence[str]:
    return config.table("environment").get("guidances") or (config.guidance,)


def _places(config: PolicyConfig) -> Sequence[str]:
    return listed(str(config.extra.get("scenario", "")))


def _saw(config: PolicyConfig) -> Iterator[tuple[str, str]]:
    yield "robots", "; ".join(_robots(config))
    yield "places", ", ".join(_places(config))
    yield "guidance", ", ".join(f"`{name}`" for name in _guidances(config))
    steps, tracks = config.encoder.get("history_steps", 0), config.encoder.get("num_tracks", 0)
    by = ([f"motion cues over {steps} periods"] if steps else []) + ([f"{tracks} tracks"] if tracks else [])
    yield "way", "the waypoint and the path ahead" if config.encoder.get("path") else "the waypoint"
    yield "moving obstacles", f"seen by {' and '.join(by)}" if by else "not seen as moving"
    environment = config.table("environment")
    by = environment.get("planner")
    yield "method", f"`{config.method}`{f', shown by {by}' if by else ''}"
    numbers = [
        f"{config.extra[name]:,.0f} {unit}"
        for name, unit in (
            ("env_steps", "environment steps"),
            ("gradient_updates", "updates"),
            ("train_seconds", "s"),
        )
        if config.extra.get(name) is not None
    ]
    yield "training", ", ".join(numbers)
    yield "command", f"`{train_command(config.table('settings'))}`"
    folders = listed(config.table("settings").get("teachers", ""))
    for folder, teacher in zip(folders, config.extra.get(TEACHERS, ()), strict=True):
        taught = ", ".join(f"`{name}`" for name in teacher["taught"])
        seconds = teacher["train_seconds"]
        yield (
            f"teacher of {taught}",
            "" if seconds is None else f"another policy, trained for {seconds:,.0f} s",
        )
        yield "its command", f"`{train_command(teacher['settings'])} {shlex.join(['--out', folder])}`"


def _robots(config: PolicyConfig) -> Iterator[str]:
    if not config.family:
        robot = config.robot
        yield f"`{robot['name']}`, {robot['max_speed_mps']:g} m/s"
        return
    yield f"family `{config.family['name']}`"
    for numbers, holder in ((FAMILY_NUMBERS, config.family), (LIDAR_NUMBERS, config.family["lidar"])):
        for name, unit in numbers.items():
            low, high = holder[name]
            yield f"{low:.4g} to {high:.4g} {unit}"


def train_command(settings: Mapping[str, Any]) -> str:
    """What trains with these settings, as they stand in a run's config.json; options with today's defaults are left
    out."""
    known = json.loads(json.dumps(asdict(RunConfig()), default=str))
    return shlex.join(["adrl", "train", *_options(settings, known, "")])


def _options(given: Mapping[str, Any], known: Mapping[str, Any], prefix: str) -> Iterator[str]:
    for name, value in given.items():
        if name not in known or value is None or value == known[name] or name in ("out", "resume"):
            continue
        if isinstance(value, Mapping):
            yield from _options(value, known[name], "" if name == "learner" else f"{prefix}{name}.")
            continue
        option = f"{prefix}{name}".replace("_", "-")
        if isinstance(known[name], bool):  # a flag; one that may be left to the run has a value
            yield f"--{option}" if value else f"--{prefix}no-{name.replace('_', '-')}"
        else:
            yield f"--{option}"
            yield from map(str, value if isinstance(value, list) else (value,))


def _good(measured: Sequence[Mapping[str, Any]]) -> list[str]:
    """A row an evaluation, in brackets 95 % intervals."""
    if not measured:
        return ["Not measured yet.", ""]
    headings = ("`adrl evaluate` with", "drives", "success, %", "collision, %", "Av.T, s", "path / shortest")
    of_family = any("worst_decile" in summary for summary in measured)
    rows = [
        [
            f"`{_tail(summary)}`",
            str(summary["episodes"]),
            cell(summary, "success", 1, 100.0),
            cell(summary, "collision", 1, 100.0),
            cell(summary, "time_s", 1),
            cell(summary, "optimality", 2),
            *(
                [cell(summary, "worst_decile", 1, 100.0) if "worst_decile" in summary else ""]
                if of_family
                else []
            ),
        ]
        for summary in measured
    ]
    note = "In brackets 95 % intervals; Av.T and path / shortest over successes."
    return [*table((*headings, *(["worst decile, %"] if of_family else [])), rows), note, ""]


def _tail(summary: Mapping[str, Any]) -> str:
    """The command without what all of them begin with."""
    return str(summary["command"]).removeprefix(f"adrl evaluate --policy {summary['policy']} ")


def _must_not(config: PolicyConfig, measured: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield "As a safety device: the robot's own emergency stop and speed limits stay in charge."
    if config.family:
        yield "Robots outside of its family. `adrl robot my.toml` names what lies outside, and so does what drives."
    else:
        yield (
            f"Robots unlike `{config.robot['name']}` without a measurement: commands that drive warn of another robot. "
            "Fine-tune it, or train your own."
        )
    unknown = [name for name in GUIDANCE if name not in _guidances(config)]
    # Waypoints are waypoints: of a map, or of the replanner's.
    unknown = [name for name in unknown if name == "goal" or not {"map", "replan"} & set(_guidances(config))]
    if unknown:
        yield f"Guidance {' and '.join(f'`{name}`' for name in unknown)}: it was not trained with it."
    if not MOVING & set(_places(config)):
        yield "People and other moving obstacles: nothing moved where it was trained."
    weak = [summary for summary in measured if summary["success"] < GOOD]
    for summary in weak:
        yield f"`{_tail(summary)}`: it arrives in {100.0 * summary['success']:.1f} % only."
