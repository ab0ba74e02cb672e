"""The reward: the terms (eqs 7-12), their weights (eqs 13-16) and the sum (eq 17)."""

from adrl.rewards.config import RewardConfig, RewardTerm
from adrl.rewards.features import FEATURES, features
from adrl.rewards.matrix import reward
from adrl.rewards.step import Step
from adrl.rewards.terms import REWARD_TERMS, reward_terms, terms
from adrl.rewards.weights import weights

__all__ = [
    "FEATURES",
    "REWARD_TERMS",
    "RewardConfig",
    "RewardTerm",
    "Step",
    "features",
    "reward",
    "reward_terms",
    "terms",
    "weights",
]
