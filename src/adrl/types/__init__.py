"""Shared value types: robots, worlds, tasks, policies. SI units, radians, frames as in ROS REP 103."""

from adrl.geometry import Array
from adrl.types.forms import FORMS, Form, require_forms
from adrl.types.people import MOST_PEOPLE, NOBODY, People
from adrl.types.polygons import outline
from adrl.types.protocols import ACTION_SIZE, GUIDANCE, SPLITS, Policy, Scenario
from adrl.types.robots import BEYOND_SPEED, SLIP_M, LidarConfig, RobotConfig, RobotRows
from adrl.types.saved import with_defaults, without_constants
from adrl.types.worlds import GOAL_TOLERANCE_M, OccupancyGrid, Task, World, disc_centres

__all__ = [
    "ACTION_SIZE",
    "BEYOND_SPEED",
    "FORMS",
    "GOAL_TOLERANCE_M",
    "GUIDANCE",
    "MOST_PEOPLE",
    "NOBODY",
    "SLIP_M",
    "SPLITS",
    "Array",
    "Form",
    "LidarConfig",
    "OccupancyGrid",
    "People",
    "Policy",
    "RobotConfig",
    "RobotRows",
    "Scenario",
    "Task",
    "World",
    "disc_centres",
    "outline",
    "require_forms",
    "with_defaults",
    "without_constants",
]
