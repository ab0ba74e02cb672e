"""A*+DWA: a global path, followed by the dynamic window approach."""

from adrl.baselines.classical import ClassicalPolicy, WithoutForesight
from adrl.planning.local_control import dwa_config


class AStarDwaPolicy(ClassicalPolicy):
    """A* and the dynamic window approach; with the true map discs are foreseen."""

    name = "astar-dwa"
    controller = staticmethod(dwa_config)


class AStarDwaStaticPolicy(WithoutForesight, AStarDwaPolicy):
    """The same, discs not foreseen; with the true map alone."""

    name = "astar-dwa-static"
