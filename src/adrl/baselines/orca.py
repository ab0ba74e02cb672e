"""ORCA: the crowd's own rule as the robot's controller."""

from adrl.baselines.classical import ClassicalPolicy
from adrl.planning.local_control import orca_config


class OrcaPolicy(ClassicalPolicy):
    """Optimal reciprocal collision avoidance along the A* path; told the true velocities of all that moves."""

    name = "orca"
    controller = staticmethod(orca_config)
    guidances = ("map",)
