"""Robots, scenarios, maps and Gazebo worlds.

A scenario draws tasks: SCENARIOS holds those that make a new world for every task, MapScenario and
SdfScenario work in a given one, BarnScenario in the given ones of a benchmark. task_set() gives the fixed
tasks of a split.
"""

from adrl.errors import ConfigError
from adrl.registry import look_up
from adrl.types import Scenario
from adrl.worlds.barn import BarnScenario, load_barn
from adrl.worlds.cellular import Cellular
from adrl.worlds.clutter import Clutter
from adrl.worlds.complex import Complex
from adrl.worlds.crowd import Passage, Square, TwoRooms, crowd_walks, opposing_flows, through_the_door
from adrl.worlds.dynabarn import DynaBarn
from adrl.worlds.dynamic import Dynamic
from adrl.worlds.families import LidarFamily, RobotFamily
from adrl.worlds.hall import Hall
from adrl.worlds.map_scenario import MapScenario
from adrl.worlds.people import Crowd, Peopled
from adrl.worlds.robot_files import robot_from_fields
from adrl.worlds.robots import FAMILIES, ROBOTS, load_robot, load_robots
from adrl.worlds.rooms import Rooms
from adrl.worlds.ros_map import load_map
from adrl.worlds.sdf import load_sdf
from adrl.worlds.sdf_scenario import SdfScenario
from adrl.worlds.tasks import single_task, task_set

SCENARIOS: dict[str, Scenario] = {
    "clutter": Clutter(),
    "complex": Complex(),
    "hall": Hall(),
    "dynamic": Dynamic(),
    "rooms": Rooms(),
    "cellular": Cellular(),
    "dynabarn": DynaBarn(),
    "crowd": Peopled(Square(), Crowd(count=(6, 20)), crowd_walks),
    "corridor": Peopled(Passage(), Crowd(count=(4, 10), standing=0.0), opposing_flows),
    "doorway": Peopled(TwoRooms(), Crowd(count=(3, 8)), through_the_door),
    "office": Peopled(Rooms(), Crowd(count=(6, 12)), name="office"),
}

__all__ = [
    "FAMILIES",
    "ROBOTS",
    "SCENARIOS",
    "BarnScenario",
    "Crowd",
    "LidarFamily",
    "MapScenario",
    "Peopled",
    "RobotFamily",
    "SdfScenario",
    "get_scenario",
    "load_barn",
    "load_map",
    "load_robot",
    "load_robots",
    "load_sdf",
    "robot_from_fields",
    "single_task",
    "task_set",
]


def get_scenario(scenario: str | Scenario) -> Scenario:
    """A scenario by name (SCENARIOS, or an entry point of group "adrl.scenarios"), or the object itself.

    Raises UnknownName, and ConfigError for an object without name and task(rng, robot).
    """
    found = look_up("scenario", scenario, SCENARIOS) if isinstance(scenario, str) else scenario
    if not (isinstance(getattr(found, "name", None), str) and callable(getattr(found, "task", None))):
        raise ConfigError(f"scenario {scenario!r} has no name and task(rng, robot); see adrl.types.Scenario")
    return found
