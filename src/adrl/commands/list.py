"""adrl list."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint

from adrl.agents.methods import METHODS
from adrl.baselines import SB3_METHODS
from adrl.baselines.planners import PLANNERS
from adrl.commands.options import parse
from adrl.deploy.policy import SHIPPED
from adrl.imitation.experts import EXPERTS
from adrl.registry import offered
from adrl.rewards.weights import EXTRA_TERMS
from adrl.simulators import SIMULATORS
from adrl.types import GUIDANCE, RobotConfig
from adrl.worlds import FAMILIES, ROBOTS, SCENARIOS, RobotFamily


@dataclass(frozen=True, kw_only=True)
class ListOptions:
    """No options."""


def main(arguments: Sequence[str]) -> int:
    """Print every registry, and what installed packages offer in it."""
    parse(ListOptions, arguments, "list", "List all that has a name, with what installed packages offer.")
    _section("robots", {name: _numbers(robot) for name, robot in ROBOTS.items()}, "robot")
    families = {name: f"{_shapes(family)}; adrl robot {name} draws some" for name, family in FAMILIES.items()}
    _section("families of robots", families)
    _section("scenarios", _first_lines(SCENARIOS), "scenario")
    _section("methods", _first_lines(METHODS), "method")
    _section("experts", _first_lines(EXPERTS), "expert")
    baselines = {name: f"{baseline}, in adrl compare" for name, baseline in SB3_METHODS.items()}
    _section("baselines", baselines)
    _section("reward terms", dict.fromkeys(EXTRA_TERMS, "for --reward.extra-terms"), "reward term")
    _section("guidance", dict.fromkeys(GUIDANCE, ""))
    _section("planners", _first_lines(PLANNERS))
    _section("policies", SHIPPED, "policy")
    _section("observation components of other packages", {}, "observation component")
    _section("simulators", dict.fromkeys(SIMULATORS, ""), "simulator")
    return 0


def _section(title: str, ours: Mapping[str, str], kind: str | None = None) -> None:
    """Our names, then those that entry points of the kind add."""
    others = offered(kind) if kind is not None else {}
    entries = {name: f"plug-in of {_package(point)}" for name, point in others.items()} | dict(ours)
    if entries:
        print(f"{title}:")
    for name in [*ours, *(other for other in others if other not in ours)]:
        print(f"  {name:<20} {entries[name]}".rstrip())


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value


def _numbers(robot: RobotConfig) -> str:
    lidar = robot.lidar
    shape = f"disc of {robot.radius_m} m" if robot.radius_m is not None else f"{len(robot.polygon)} corners"
    return (
        f"{shape}, {robot.max_speed_mps} m/s, {robot.max_yaw_rate_radps} rad/s, "
        f"{lidar.num_beams} beams to {lidar.max_range_m} m"
    )


def _shapes(family: RobotFamily) -> str:
    (slow, fast), (low, high) = family.max_speed_mps, family.lidar.max_range_m
    return f"discs and rectangles, {slow:g} to {fast:g} m/s, LiDARs of {low:g} to {high:g} m"


def _first_lines(documented: Mapping[str, object]) -> dict[str, str]:
    return {name: (entry.__doc__ or "").strip().partition("\n")[0] for name, entry in documented.items()}
