"""The Python API: what the commands do, as functions. adrl.train, adrl.evaluate and adrl.load_policy are these."""

from adrl.agents.config import TrainConfig
from adrl.baselines.planners import PLANNER
from adrl.deploy.policy import DEFAULT, load_policy
from adrl.evaluation.evaluate import EPISODES, OWN_TASKS, Evaluation, evaluate, robot_of
from adrl.evaluation.family import ROBOTS, TASKS, FamilyEvaluation, evaluate_family
from adrl.runs import RunConfig, train

__all__ = [
    "DEFAULT",
    "EPISODES",
    "OWN_TASKS",
    "PLANNER",
    "ROBOTS",
    "TASKS",
    "Evaluation",
    "FamilyEvaluation",
    "RunConfig",
    "TrainConfig",
    "evaluate",
    "evaluate_family",
    "load_policy",
    "robot_of",
    "train",
]
