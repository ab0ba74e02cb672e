"""A* and regulated pure pursuit."""

from adrl.baselines.classical import ClassicalPolicy, WithoutForesight
from adrl.planning.local_control import pursuit_config


class AStarPursuitPolicy(ClassicalPolicy):
    """A* and regulated pure pursuit; with the true map discs are foreseen."""

    name = "astar-pursuit"
    controller = staticmethod(pursuit_config)


class AStarPursuitStaticPolicy(WithoutForesight, AStarPursuitPolicy):
    """The same, discs not foreseen; with the true map alone."""

    name = "astar-pursuit-static"
