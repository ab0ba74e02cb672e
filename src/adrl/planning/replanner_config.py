"""Constants of the replanner, section III-C of the paper."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

from adrl import _core
from adrl.errors import ConfigError
from adrl.ranges import Range, check_ranges
from adrl.types import Form, RobotConfig, require_forms

EQUATIONS = ("eq18", "eq20", "eq21")
"""The equations that have two forms."""


@dataclass(frozen=True, kw_only=True)
class ReplannerConfig:
    """Constants of eqs 18 to 23. The defaults suit robots of 0.2 to 2 m/s: speeds are fractions of the robot's own."""

    eq18: Form = "corrected"
    """The trigger. literal: cumulative displacement and change of obstacle distance. See `stagnant`."""
    eq20: Form = "corrected"
    """Maturity S. corrected: thresholds shrink with it, fewer interventions, as the text says; literal: they grow."""
    eq21: Form = "corrected"
    """Choice of the waypoint, eqs 21 and 23. literal: the density D and its sum over cells as printed."""
    window_s: Annotated[float, Range(0.01, 60.0)] = 2.0
    """n steps of eq 18 as a time in s; 0.01 to 60."""
    displacement_fraction: Annotated[float, Range(0.001, 10.0)] = 0.25
    """d_m0 of eq 19 as a fraction of the longest way the robot can go in the window; 0.001 to 10."""
    speed_fraction: Annotated[float, Range(0.001, 10.0)] = 0.5
    """v_min as a fraction of the greatest speed; 0.001 to 10."""
    obstacle_change_m: Annotated[float, Range(0.001, 100.0)] = 0.3
    """delta: change in m of the nearest obstacle's distance below which the surroundings count as unchanged; 0.001 to
    100."""
    environment_gain: ClassVar[float] = 0.5
    """alpha of eq 19: thresholds grow by this share at contact with an obstacle."""
    maturity_gain: Annotated[float, Range(0.0, 1e6)] = 0.2
    """beta of eq 20; 0 to 1e+06."""
    safe_clearance_m: ClassVar[float] = 0.3
    """Clearance in m below which an obstacle is a threat: T_obs rises from 0 here to 1 at contact."""
    conflict_m: ClassVar[float] = 2.0
    """A slow robot that drives straight at the goal triggers only with a known obstacle this near on its way, m."""
    foresight_m: Annotated[float, Range(0.0, 1000.0)] = 8.0
    """A robot that heads for the goal plans at once when it knows of an obstacle this near on the straight way, m; 0
    to 1000.

    0: only when it is stagnant, which is eq 18 alone; so does the literal form.
    """
    replan_interval_s: Annotated[float, Range(0.001, 3600.0)] = 1.0
    """A robot on a route plans anew after so many s, and sooner at its waypoint or when the way to that is blocked;
    0.001 to 3600."""
    arrival_m: ClassVar[float] = 0.4
    """Distance in m from the waypoint at which the next one is wanted."""
    min_interval_m: ClassVar[float] = 0.3
    """Least distance of a waypoint along the route, m."""
    lookahead_m: Annotated[float, Range(0.001, 1000.0)] = 1.5
    """Greatest distance of a waypoint along the route, m; 0.001 to 1000."""
    near: bool | None = None
    """Show the policy waypoints where they are and the goal no farther than guidance map shows one, for a policy that
    has seen no point farther away. Left out: for a family that is trained with map alone."""
    margin_m: Annotated[float, Range(0.001, 10.0)] = 0.05
    """Clearance in m that routes keep beyond the robot's radius; 0.001 to 10."""
    comfort_m: Annotated[float, Range(0.001, 10.0)] = 0.3
    """Clearance in m beyond that at which obstacles cease to cost: O of eq 21 falls from 1 to 0 over it; 0.001 to
    10."""
    near_goal_m: ClassVar[float] = 3.0
    """Distance in m below which the goal counts as near: T_goal rises from 0 here to 1 at the goal."""
    k_obstacle: ClassVar[float] = 0.6
    """k_1 of eq 21: share of the obstacle density; the three are divided by their sum."""
    k_proximity: ClassVar[float] = 0.1
    """k_2 of eq 21: share of the distance to the goal."""
    k_turn: ClassVar[float] = 0.3
    """k_3 of eq 21: share of the curvature."""
    density_weight: Annotated[float, Range(0.0, _core.MAX_DENSITY_WEIGHT)] = 0.3
    """Metres that a metre at density 1 costs more: Cost_obs of eq 22 is this times the integral of the density; 0 to
    100."""
    turn_cost_m: ClassVar[float] = 0.1
    """lambda of eq 22: m that a radian of turning costs. Counts with `headings`."""
    headings: bool = False
    """Search over cells and headings: turning is part of the route's cost, as eq 22 has it. About twice as slow."""
    cells: Annotated[int, Range(40, 2048)] = 400
    """Cells on a side of the window that is mapped about the robot; 40 to 2048."""
    resolution_m: Annotated[float, Range(0.005, 1.0)] = 0.05
    """Side of a cell in m. Gaps down to the robot's width, twice the margin and two cells can be planned through;
    0.005 to 1."""
    range_m: Annotated[float, Range(0.1, 1000.0)] = 8.0
    """Hits farther away, m, are not mapped; 0.1 to 1000."""
    forget_s: ClassVar[float] = 1.0
    """Time in s of being seen through after which a mapped obstacle is forgotten."""

    def __post_init__(self) -> None:
        require_forms(self, *EQUATIONS)
        check_ranges(self, "replanner.")
        if self.lookahead_m < self.min_interval_m:
            raise ConfigError(
                f"replanner.lookahead_m is {self.lookahead_m}; give {self.min_interval_m} or more"
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
