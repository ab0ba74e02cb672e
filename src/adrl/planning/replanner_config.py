"""Constants of the replanner, section III-C of the paper."""

import math
from dataclasses import dataclass, replace
from typing import Self

from adrl import _core
from adrl.errors import ConfigError
from adrl.types import Form, RobotConfig, require_forms

EQUATIONS = ("eq18", "eq20", "eq21")
"""The equations that have two forms."""
_ZERO_ALLOWED = (
    "environment_gain",
    "maturity_gain",
    "k_obstacle",
    "k_proximity",
    "k_turn",
    "density_weight",
    "turn_cost_m",
    "foresight_m",
)


@dataclass(frozen=True, kw_only=True)
class ReplannerConfig:
    """Constants of eqs 18 to 23. The defaults suit robots of 0.2 to 2 m/s: speeds are fractions of the robot's own."""

    eq18: Form = "corrected"
    """The trigger. literal: cumulative displacement and change of obstacle distance. See `stagnant`."""
    eq20: Form = "corrected"
    """Maturity S. corrected: thresholds shrink with it, fewer interventions, as the text says; literal: they grow."""
    eq21: Form = "corrected"
    """Choice of the waypoint, eqs 21 and 23. literal: the density D and its sum over cells as printed."""
    window_s: float = 2.0
    """n steps of eq 18 as a time in s."""
    displacement_fraction: float = 0.25
    """d_m0 of eq 19 as a fraction of the longest way the robot can go in the window."""
    speed_fraction: float = 0.5
    """v_min as a fraction of the greatest speed."""
    obstacle_change_m: float = 0.3
    """delta: change in m of the nearest obstacle's distance below which the surroundings count as unchanged."""
    environment_gain: float = 0.5
    """alpha of eq 19: thresholds grow by this share at contact with an obstacle."""
    maturity_gain: float = 0.2
    """beta of eq 20."""
    safe_clearance_m: float = 0.3
    """Clearance in m below which an obstacle is a threat: T_obs rises from 0 here to 1 at contact."""
    conflict_m: float = 2.0
    """A slow robot that drives straight at the goal triggers only with a known obstacle this near on its way, m."""
    foresight_m: float = 8.0
    """A robot that heads for the goal plans at once when it knows of an obstacle this near on the straight way, m.

    0: only when it is stagnant, which is eq 18 alone; so does the literal form.
    """
    replan_interval_s: float = 1.0
    """A robot on a route plans anew after so many s, and sooner at its waypoint or when the way to that is blocked."""
    arrival_m: float = 0.4
    """Distance in m from the waypoint at which the next one is wanted."""
    min_interval_m: float = 0.3
    """Least distance of a waypoint along the route, m."""
    lookahead_m: float = 1.5
    """Greatest distance of a waypoint along the route, m."""
    margin_m: float = 0.05
    """Clearance in m that routes keep beyond the robot's radius."""
    comfort_m: float = 0.3
    """Clearance in m beyond that at which obstacles cease to cost: O of eq 21 falls from 1 to 0 over it."""
    near_goal_m: float = 3.0
    """Distance in m below which the goal counts as near: T_goal rises from 0 here to 1 at the goal."""
    k_obstacle: float = 0.6
    """k_1 of eq 21: share of the obstacle density; the three are divided by their sum."""
    k_proximity: float = 0.1
    """k_2 of eq 21: share of the distance to the goal."""
    k_turn: float = 0.3
    """k_3 of eq 21: share of the curvature."""
    density_weight: float = 0.3
    """Metres that a metre at density 1 costs more: Cost_obs of eq 22 is this times the integral of the density."""
    turn_cost_m: float = 0.1
    """lambda of eq 22: m that a radian of turning costs. Counts with `headings`."""
    headings: bool = False
    """Search over cells and headings: turning is part of the route's cost, as eq 22 has it. About twice as slow."""
    cells: int = 400
    """Cells on a side of the window that is mapped about the robot."""
    resolution_m: float = 0.05
    """Side of a cell in m. Gaps down to the robot's width, twice the margin and two cells can be planned through."""
    range_m: float = 8.0
    """Hits farther away, m, are not mapped."""
    forget_s: float = 1.0
    """Time in s of being seen through after which a mapped obstacle is forgotten."""

    def __post_init__(self) -> None:
        require_forms(self, *EQUATIONS)
        for name in set(self.__dataclass_fields__) - {"headings", *EQUATIONS}:
            value = getattr(self, name)
            low = 0.0 if name in _ZERO_ALLOWED else math.ulp(0.0)
            if not (math.isfinite(value) and value >= low):
                wanted = "0 or more" if name in _ZERO_ALLOWED else "a positive number"
                raise ConfigError(f"replanner.{name} is {value}; give {wanted}")
        for name, most in (
            ("density_weight", _core.MAX_DENSITY_WEIGHT),
            ("turn_cost_m", _core.MAX_TURN_COST_M),
        ):
            if getattr(self, name) > most:
                raise ConfigError(f"replanner.{name} is {getattr(self, name)}; give 0 to {most:g}")
        if not 40 <= self.cells <= 4096:
            raise ConfigError(f"replanner.cells is {self.cells}; give 40 to 4096")
        if self.k_obstacle + self.k_proximity + self.k_turn <= 0.0:
            raise ConfigError(
                "replanner.k_obstacle, k_proximity and k_turn are all 0; give one a positive number"
            )
        if self.min_interval_m > self.lookahead_m:
            raise ConfigError(
                f"replanner.min_interval_m is {self.min_interval_m}, beyond lookahead_m {self.lookahead_m}"
            )

    def literal(self) -> Self:
        """The same constants with every equation as printed, eq 22 with its kinematic cost."""
        return replace(self, headings=True, **dict.fromkeys(EQUATIONS, "literal"))

    def steps(self, duration_s: float, robot: RobotConfig) -> int:
        """A duration in control periods, at least one."""
        return max(1, round(duration_s / robot.control_period_s))

    def route_costs(self, robot: RobotConfig) -> "_core.RouteCosts":
        """Eq 22 for a robot, taken for its circumscribed disc, as the core wants it.

        Raises ConfigError for clearances of too many cells.
        """
        costs = _core.RouteCosts()
        costs.inflation_m = robot.circumscribed_radius_m + self.margin_m
        most_m = _core.MAX_CLEARANCE_CELLS * self.resolution_m
        if costs.inflation_m + self.comfort_m > most_m:
            raise ConfigError(
                f"replanner: robot {robot.name!r} with margin_m and comfort_m needs "
                f"{costs.inflation_m + self.comfort_m:.2f} m of clearance, more than the {most_m:.2f} m of "
                f"{_core.MAX_CLEARANCE_CELLS} cells; lower comfort_m or raise replanner.resolution_m"
            )
        costs.comfort_m, costs.near_goal_m, costs.weight = (
            self.comfort_m,
            self.near_goal_m,
            self.density_weight,
        )
        total = self.k_obstacle + self.k_proximity + self.k_turn
        costs.k_obstacle = self.k_obstacle / total
        costs.k_goal = self.k_proximity / total
        costs.k_turn = self.k_turn / total
        costs.turn_m, costs.headings = self.turn_cost_m, self.headings
        return costs
