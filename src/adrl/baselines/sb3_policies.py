"""Networks of Stable-Baselines3 that differ from the library's own: all actors of one form, critics with LayerNorm."""

from itertools import pairwise
from typing import Any

from stable_baselines3.common.policies import ActorCriticPolicy, ContinuousCritic
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn


class TanhMeanPolicy(ActorCriticPolicy):
    """The library's policy for PPO with tanh on the mean action, as TD3's and SAC's actors have it.

    The library's own mean is unbounded and cut off by the environment. So all actors have one form, and what drives a
    robot is the same network.
    """

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = nn.Sequential(self.action_net, nn.Tanh())


class NormedTd3Policy(TD3Policy):
    """The library's policy for TD3, LayerNorm in the critics."""

    def make_critic(self, features_extractor: Any = None) -> ContinuousCritic:
        """The library's critics with LayerNorm."""
        return _normed_critic(super().make_critic(features_extractor))


class NormedSacPolicy(SACPolicy):
    """The library's policy for SAC, LayerNorm in the critics."""

    def make_critic(self, features_extractor: Any = None) -> ContinuousCritic:
        """The library's critics with LayerNorm."""
        return _normed_critic(super().make_critic(features_extractor))


class NormedTanhMeanPolicy(TanhMeanPolicy):
    """TanhMeanPolicy, LayerNorm in the value network."""

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        self.mlp_extractor.value_net = _normed(self.mlp_extractor.value_net)


def _normed_critic(critic: ContinuousCritic) -> ContinuousCritic:
    for index, network in enumerate(critic.q_networks):
        critic.q_networks[index] = _normed(network)
        critic.add_module(f"qf{index}", critic.q_networks[index])
    return critic


def _normed(network: nn.Module) -> nn.Sequential:
    """The same layers, with LayerNorm between each linear one and its activation."""
    layers = list(network.children())
    normed = layers[:1]
    for before, layer in pairwise(layers):
        if isinstance(before, nn.Linear):
            normed.append(nn.LayerNorm(before.out_features))
        normed.append(layer)
    return nn.Sequential(*normed)
