"""map: tasks on a map of ROS map_server."""

import os
from pathlib import Path

from adrl.worlds.fixed import FixedWorld
from adrl.worlds.ros_map import Unknown, load_map


class MapScenario(FixedWorld):
    """Start and goal on cells the map shows free. Raises as load_map does."""

    if_tiny = "if the map has wider ones, correct resolution, negate or mode in its YAML file"

    def __init__(self, path: str | os.PathLike[str], unknown: Unknown = "solid") -> None:
        super().__init__(f"map:{Path(path).stem}", load_map(path, unknown))
