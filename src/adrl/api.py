"""The Python API: what the commands do, as functions. adrl.train, adrl.evaluate and adrl.load_policy are these."""

from adrl.agents.config import TrainConfig
from adrl.baselines.planners import PLANNER
from adrl.deploy.policy import DEFAULT, load_policy
from adrl.evaluation.evaluate import OWN_TASKS, Evaluation, evaluate, robot_of
from adrl.runs import RunConfig, train

__all__ = [
    "DEFAULT",
    "OWN_TASKS",
    "PLANNER",
    "Evaluation",
    "RunConfig",
    "TrainConfig",
    "evaluate",
    "load_policy",
    "robot_of",
    "train",
]
