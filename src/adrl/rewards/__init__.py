"""The reward: six terms (eqs 7-12), their weights (eqs 13-16) and the sum (eq 17)."""

from adrl.rewards.config import RewardConfig
from adrl.rewards.features import FEATURES, features
from adrl.rewards.matrix import reward
from adrl.rewards.terms import REWARD_TERMS, Step, terms
from adrl.rewards.weights import weights

__all__ = ["FEATURES", "REWARD_TERMS", "RewardConfig", "Step", "features", "reward", "terms", "weights"]
