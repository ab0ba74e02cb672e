"""A* and model predictive path integral control."""

from adrl.baselines.classical import ClassicalPolicy, WithoutForesight
from adrl.planning.local_control import mppi_config


class AStarMppiPolicy(ClassicalPolicy):
    """A* and model predictive path integral control; with the true map discs are foreseen."""

    name = "astar-mppi"
    controller = staticmethod(mppi_config)


class AStarMppiStaticPolicy(WithoutForesight, AStarMppiPolicy):
    """The same, discs not foreseen; with the true map alone."""

    name = "astar-mppi-static"
