"""The classical planners, by name. A new one is a file beside this and a line here."""

from collections.abc import Callable
from typing import Any

from adrl.baselines.astar_dwa import AStarDwaPolicy, AStarDwaStaticPolicy
from adrl.baselines.astar_mppi import AStarMppiPolicy, AStarMppiStaticPolicy
from adrl.baselines.astar_pursuit import AStarPursuitPolicy, AStarPursuitStaticPolicy
from adrl.baselines.orca import OrcaPolicy

PLANNER = "astar-dwa"
"""The reference of comparisons."""
PLANNERS: dict[str, Callable[[], Any]] = {
    policy.name: policy
    for policy in (
        AStarDwaPolicy,
        AStarDwaStaticPolicy,
        AStarMppiPolicy,
        AStarMppiStaticPolicy,
        AStarPursuitPolicy,
        AStarPursuitStaticPolicy,
        OrcaPolicy,
    )
}
"""name -> what makes it: a policy as adrl.types.Policy has it, or one with act_in(simulator), which knows the world."""
