"""Gymnasium environments over the batch simulator: adrl/Nav-v0, alone and as a vector."""

from adrl.envs.kinds import Kind
from adrl.envs.mixture import Mixture
from adrl.envs.nav_env import NavEnv
from adrl.envs.nav_sim import Body, NavSim
from adrl.envs.randomization import MILD, NOMINAL, Randomization
from adrl.envs.setting import Setting, simulate
from adrl.envs.steps import Outcome
from adrl.envs.vector_env import NavVectorEnv, make_nav_vec

__all__ = [
    "MILD",
    "NOMINAL",
    "Body",
    "Kind",
    "Mixture",
    "NavEnv",
    "NavSim",
    "NavVectorEnv",
    "Outcome",
    "Randomization",
    "Setting",
    "make_nav_vec",
    "simulate",
]
