"""Running a trained policy on a robot: numpy and the core only."""

from adrl.deploy.messages import Command, Odometry, Pose, Reason, Scan, Status, Twist
from adrl.deploy.navigator import Navigator
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.deploy.policy import MlpPolicy, load_policy
from adrl.deploy.supervisor import Supervisor, SupervisorConfig

__all__ = [
    "Command",
    "MlpPolicy",
    "Navigator",
    "Odometry",
    "Pose",
    "Reason",
    "ResolvedPolicy",
    "Scan",
    "Status",
    "Supervisor",
    "SupervisorConfig",
    "Twist",
    "find_policy",
    "load_policy",
]
