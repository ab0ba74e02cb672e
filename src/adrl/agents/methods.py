"""Training methods: each is a delta of a few lines on the learner's configuration.

All share networks, budget, demonstrations and evaluation. A method that does not imitate has neither rows of the
expert's nor cloning before the first step; what S is measured against (eq 13) is still the expert's return.
"""

from collections.abc import Callable
from dataclasses import replace

from adrl.agents.config import Guide, TrainConfig
from adrl.errors import ConfigError
from adrl.registry import look_up

Method = Callable[[TrainConfig], TrainConfig]

FOR_EVER = 2**31
FIXED_LAMBDA = 0.3
"""Cloning weight of the controls that never release it; with 1 they learn later."""


def adrl(config: TrainConfig) -> TrainConfig:
    """The paper's method: expert share, cloning weight and reward weights all follow the critic's maturity."""
    return config


def adrl_literal(config: TrainConfig) -> TrainConfig:
    """ADRL with every equation as the paper prints it."""
    return config.literal()


def adrl_clock(config: TrainConfig) -> TrainConfig:
    """Control: ADRL's release curve, driven by the clock instead of the critic."""
    return replace(config, schedule=replace(config.schedule, driver="clock"))


def adrl_return(config: TrainConfig) -> TrainConfig:
    """Control: ADRL's release curve, driven by the return of the training episodes instead of the critic."""
    return replace(config, schedule=replace(config.schedule, driver="return"))


def adrl_alpha(config: TrainConfig) -> TrainConfig:
    """ADRL with the expert share (eqs 3, 4) alone: nothing is cloned."""
    return replace(config, schedule=replace(config.schedule, lambda_max=0.0))


def adrl_lambda(config: TrainConfig) -> TrainConfig:
    """ADRL with the cloning weight (eqs 5, 6) alone: the critic never sees the expert's rows after pretraining."""
    return replace(config, schedule=replace(config.schedule, alpha_min=0.0, alpha_max=0.0))


def rl_reward(config: TrainConfig) -> TrainConfig:
    """The paper's ablation: TD3 with the dynamic reward, without imitation."""
    return replace(config, schedule=replace(config.schedule, alpha_min=0.0, alpha_max=0.0, lambda_max=0.0))


def rl_bc(config: TrainConfig) -> TrainConfig:
    """The paper's ablation: TD3 on the static reward with a cloning weight that stays."""
    return replace(_fixed(config, alpha=0.0, lambda_bc=FIXED_LAMBDA), dynamic_reward=False)


def td3(config: TrainConfig) -> TrainConfig:
    """TD3 on the static reward, without imitation."""
    return replace(rl_reward(config), dynamic_reward=False)


def td3bc(config: TrainConfig) -> TrainConfig:
    """TD3+BC (Fujimoto and Gu 2021): fixed weight 1 / 2.5 of cloning beside the normalised Q, half of each batch D2.

    That weight is of the mean over the action's two numbers, ours of their sum: 0.2.
    """
    return replace(_fixed(config, alpha=0.5, lambda_bc=0.2), dynamic_reward=False)


def bc(config: TrainConfig) -> TrainConfig:
    """Behaviour cloning alone: the actor never climbs the critic."""
    return replace(td3bc(config), critic_warmup_updates=FOR_EVER)


def rlpd(config: TrainConfig) -> TrainConfig:
    """After RLPD (Ball et al. 2023): half of each batch from D2, LayerNorm critics, nothing is cloned."""
    return replace(
        _fixed(config, alpha=0.5, lambda_bc=0.0),
        dynamic_reward=False,
        td3=replace(config.td3, critic_layer_norm=True),
    )


def q_filter(config: TrainConfig) -> TrainConfig:
    """After Nair et al. 2018: a fixed cloning weight, only where the critic prefers the expert's action."""
    return replace(
        _fixed(config, alpha=0.25, lambda_bc=FIXED_LAMBDA),
        dynamic_reward=False,
        td3=replace(config.td3, row_weights="q-filter"),
    )


def adrl_arrivals(config: TrainConfig) -> TrainConfig:
    """ADRL whose S rises the slower the fewer training episodes arrive, and not at all where none does."""
    return replace(config, schedule=replace(config.schedule, rise="arrivals"))


def adrl_state(config: TrainConfig) -> TrainConfig:
    """ADRL whose cloning weight is released state by state, where the critics hold the actor to be the better one.

    lambda(s) = lambda_max + S(s) (lambda(t) - lambda_max): the weight of eq 5 where S(s), eq 13 by state, is 1, and the
    full one where the critics prefer the expert's action. See losses.state_maturity.
    """
    return replace(config, td3=replace(config.td3, row_weights="state"))


def rlpd_cloned(config: TrainConfig) -> TrainConfig:
    """RLPD that begins with the cloned actor, as ADRL does."""
    return replace(rlpd(config), guide="start")


def spread(config: TrainConfig) -> TrainConfig:
    """SPReD-P (Zhu et al. 2025): a q-filter whose rows weigh what the critics hold the expert likely to be better.

    The paper takes the spread of ten critics, ours are the two of every method. See losses.expert_is_better.
    """
    return replace(q_filter(config), td3=replace(config.td3, row_weights="spread"))


def adaptive_bc(config: TrainConfig) -> TrainConfig:
    """After adaptive BC (Zhao et al. 2022): a cloning weight that falls with the return and rises when it drops.

    It begins at that of TD3+BC, see schedule.adapted. The paper clones whatever is in a buffer that begins with a
    twentieth of the data; here it is the demonstrations, which are a twentieth of each batch. Two critics instead of a
    randomised ensemble.
    """
    schedule = replace(_fixed(config, alpha=0.05, lambda_bc=0.2).schedule, driver="progress", k_q=1.0)
    return replace(config, schedule=schedule, dynamic_reward=False)


def ibrl(config: TrainConfig) -> TrainConfig:
    """IBRL (Hu et al. 2023): a cloned policy proposes, the critics choose between it and the actor, also in the target.

    The paper's actor begins anew, ours with the clone, as in every method here that clones; its buffer begins with D2,
    here a quarter of each batch is D2 for ever; it chooses in evaluation too. Ours evaluates and exports the actor
    alone: a policy is one network.
    """
    return _guided(config, "proposal")


def jsrl(config: TrainConfig) -> TrainConfig:
    """JSRL (Uchendu et al. 2022): a cloned policy drives the first steps of each episode, fewer as success allows.

    See jump_start. The paper leaves open with what the actor begins, and which learner it has: here with the clone,
    and TD3, a quarter of each batch from D2. The guide is not part of the policy.
    """
    return _guided(config, "jump-start")


GUIDE_PRETRAINING = 20
"""Times the pretraining of the other methods: the guide stays as it is then."""


def _guided(config: TrainConfig, guide: Guide) -> TrainConfig:
    """TD3 with a guide, and demonstrations beside what it drives."""
    fixed = _fixed(config, alpha=0.25, lambda_bc=0.0)
    pretrain_updates = GUIDE_PRETRAINING * config.pretrain_updates
    return replace(fixed, dynamic_reward=False, guide=guide, pretrain_updates=pretrain_updates)


def _fixed(config: TrainConfig, *, alpha: float, lambda_bc: float) -> TrainConfig:
    """Imitation that is never released."""
    return replace(
        config,
        schedule=replace(config.schedule, alpha_min=alpha, alpha_max=alpha, lambda_max=lambda_bc, k_q=0.0),
    )


METHODS: dict[str, Method] = {
    "adrl": adrl,
    "adrl-literal": adrl_literal,
    "adrl-clock": adrl_clock,
    "adrl-return": adrl_return,
    "adrl-alpha": adrl_alpha,
    "adrl-lambda": adrl_lambda,
    "adrl-state": adrl_state,
    "adrl-arrivals": adrl_arrivals,
    "rl-reward": rl_reward,
    "rl-bc": rl_bc,
    "td3": td3,
    "td3bc": td3bc,
    "bc": bc,
    "rlpd": rlpd,
    "rlpd-cloned": rlpd_cloned,
    "q-filter": q_filter,
    "spread": spread,
    "adaptive-bc": adaptive_bc,
    "ibrl": ibrl,
    "jsrl": jsrl,
}


def method_name(method: str | Method) -> str:
    """What a method is called in folders and results: a function goes by its own name, as ours do."""
    return (
        method
        if isinstance(method, str)
        else getattr(method, "__name__", type(method).__name__).replace("_", "-")
    )


def method_config(method: str | Method, config: TrainConfig) -> TrainConfig:
    """The configuration of a method: by name (METHODS, or an entry point of group "adrl.methods"), or the function.

    Raises UnknownName with the nearest one, ConfigError for what is no method.
    """
    found = look_up("method", method, METHODS) if isinstance(method, str) else method
    learner = found(config) if callable(found) else None
    if not isinstance(learner, TrainConfig):
        raise ConfigError(f"method {method!r}: {found!r} makes no TrainConfig of a TrainConfig")
    return learner
