"""Gymnasium environments of robots in Gazebo: adrl/Gazebo-v0, alone and as a vector."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gymnasium.vector import AutoresetMode

from adrl.envs import NavEnv, NavVectorEnv
from adrl.integrations.gazebo.simulator import Gazebo
from adrl.types import RobotConfig, Scenario
from adrl.worlds import get_scenario, load_robot, robot_from_fields
from adrl.worlds.place import Place

Robot = str | RobotConfig | Mapping[str, Any]


class GazeboVectorEnv(NavVectorEnv):
    """NavVectorEnv with robots that Gazebo moves. Close it: Gazebo runs until then."""

    def __init__(
        self,
        num_envs: int = 1,
        *,
        world: str | Path | Scenario = "clutter",
        robot: Robot = "diffbot",
        **kwargs: Any,
    ) -> None:
        """world: a scenario's name, the file of a Gazebo world or of a ROS map (.yaml), or a scenario.

        kwargs: of NavVectorEnv, but scenario, randomize and body. Raises MissingExtra where Gazebo is not set up.
        """
        place, config = _place(world), _config(robot)
        self._gazebo = Gazebo(config, num_envs)
        try:
            super().__init__(
                num_envs,
                scenario=place,
                robot=config,
                randomize=False,
                body=self._gazebo,
                **kwargs,
            )
        except BaseException:
            self._gazebo.close()
            raise

    def close_extras(self, **kwargs: Any) -> None:
        """End Gazebo."""
        self._gazebo.close()


class GazeboEnv(NavEnv):
    """NavEnv with a robot that Gazebo moves. Close it: Gazebo runs until then."""

    def __init__(
        self,
        render_mode: str | None = None,
        *,
        world: str | Path | Scenario = "clutter",
        robot: Robot = "diffbot",
        **kwargs: Any,
    ) -> None:
        """As GazeboVectorEnv."""
        place, config = _place(world), _config(robot)
        self._gazebo = Gazebo(config)
        try:
            super().__init__(
                render_mode, scenario=place, robot=config, randomize=False, body=self._gazebo, **kwargs
            )
        except BaseException:
            self._gazebo.close()
            raise

    def close(self) -> None:
        """End Gazebo."""
        super().close()
        self._gazebo.close()


def make_gazebo_vec(
    num_envs: int = 1, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, **options: Any
) -> GazeboVectorEnv:
    """What gymnasium.make_vec makes, as make_nav_vec does."""
    return GazeboVectorEnv(num_envs, autoreset_mode=autoreset_mode, **options)


def _place(world: str | Path | Scenario) -> Scenario:
    if not isinstance(world, str | Path):
        return get_scenario(world)
    suffix = Path(world).suffix
    if suffix in (".yaml", ".yml"):
        return Place(map=Path(world)).load()
    if suffix in (".world", ".sdf"):
        return Place(world=Path(world)).load()
    return get_scenario(str(world))


def _config(robot: Robot) -> RobotConfig:
    return robot_from_fields(robot) if isinstance(robot, Mapping) else load_robot(robot)
