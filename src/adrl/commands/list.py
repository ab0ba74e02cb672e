"""adrl list."""

from collections.abc import Sequence
from dataclasses import dataclass

from adrl.agents.methods import METHODS
from adrl.api import PLANNER
from adrl.baselines import SB3_METHODS
from adrl.commands.options import parse
from adrl.deploy.policy import SHIPPED
from adrl.types import GUIDANCE
from adrl.worlds import ROBOTS, SCENARIOS


@dataclass(frozen=True, kw_only=True)
class ListOptions:
    """No options."""


def main(arguments: Sequence[str]) -> int:
    """Print every registry."""
    parse(ListOptions, arguments, "list", "List robots, scenarios, methods, guidance and policies.")
    print("robots:")
    for name, robot in ROBOTS.items():
        shape = (
            f"disc of {robot.radius_m} m" if robot.radius_m is not None else f"{len(robot.polygon)} corners"
        )
        lidar = robot.lidar
        print(
            f"  {name:<20} {shape}, {robot.max_speed_mps} m/s, {robot.max_yaw_rate_radps} rad/s, "
            f"{lidar.num_beams} beams to {lidar.max_range_m} m"
        )
    for title, entries in (
        ("scenarios", {name: _first_line(scenario) for name, scenario in SCENARIOS.items()}),
        ("methods", {name: _first_line(method) for name, method in METHODS.items()}),
        (
            "baselines",
            {name: f"{a} of Stable-Baselines3, in adrl compare" for name, a in SB3_METHODS.items()},
        ),
        ("guidance", dict.fromkeys(GUIDANCE, "")),
        ("policies", {PLANNER: "A*+DWA with the true map"} | SHIPPED),
    ):
        print(f"{title}:")
        for name, text in entries.items():
            print(f"  {name:<20} {text}".rstrip())
    return 0


def _first_line(documented: object) -> str:
    return (documented.__doc__ or "").strip().splitlines()[0]
