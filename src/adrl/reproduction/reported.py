"""What the paper reports, section IV: Table I as printed, and what it says of its figures, which hold no numbers."""

from typing import Any

from adrl.planning.local_control import TITLES

SOURCE = (
    '"Behavior Cloning-Enhanced Deep Reinforcement Learning for Robot Navigation via Dynamic Reward and Adaptive '
    'Replanning", Table I: five methods in complex environments'
)

TABLE_I: dict[str, dict[str, float]] = {
    "astar-dwa": {"distance_m": 21.42, "time_s": 44.33, "success": 0.92, "optimality": 1.02},
    "td3bc": {"distance_m": 21.84, "time_s": 42.41, "success": 0.83, "optimality": 1.04},
    "sb3-sac": {"distance_m": 22.68, "time_s": 41.73, "success": 0.82, "optimality": 1.08},
    "sb3-ppo": {"distance_m": 22.46, "time_s": 41.55, "success": 0.86, "optimality": 1.07},
    "adrl": {"distance_m": 21.41, "time_s": 39.62, "success": 0.97, "optimality": 1.02},
}
"""Our method's name -> the paper's row: Av.D(m), Av.T(s), Succ.rate and Optimality under the names of our results."""

LABELS: dict[str, str] = {
    "adrl": "ADRL",
    "td3": "Baseline (TD3)",
    "rl-reward": "RL-Reward",
    "rl-bc": "RL-BC",
    "td3bc": "TD3+BC",
    "sb3-sac": "SAC",
    "sb3-ppo": "PPO",
    **{f"astar-{name}": title for name, title in TITLES.items()},
}
"""Our method's name -> the paper's."""

OWN_MAP = " on its own map"
"""Ends the name of a planner that is driven on a map of its own scans."""


def label(name: str) -> str:
    """What a method, or a planner on its own map, is called in tables; its own name where the paper has none."""
    method = name.removesuffix(OWN_MAP)
    return LABELS.get(method, method) + name[len(method) :]


OURS, PLANNER = "adrl", "astar-dwa"
CLASSICAL = ("astar-mppi", "astar-pursuit")
"""Planners beside the paper's."""
ABLATIONS = ("adrl", "rl-bc", "rl-reward", "td3")
"""The methods of Fig. 4."""
RIVALS = ("adrl", "td3bc", "sb3-sac", "sb3-ppo")
"""The methods of Figs 5 and 6."""
METHODS = tuple(dict.fromkeys((*ABLATIONS, *RIVALS)))
"""All that are trained."""


def reported() -> dict[str, Any]:
    """Table I with its source, as JSON has it."""
    return {"source": SOURCE, "rows": TABLE_I}
