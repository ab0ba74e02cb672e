"""Imitation's release: maturity S (eqs 2, 13), expert reliance alpha (eq 3), cloning weight lambda (eq 5).

In the corrected forms alpha and lambda follow S, not the raw Q, so that neither depends on the scale of the reward.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, NamedTuple, Self, get_args

import tyro

from adrl.errors import ConfigError, UnknownName
from adrl.ranges import Range, check_ranges
from adrl.types import Form, require_forms

Driver = Literal["value", "return", "progress", "clock"]
Rise = Literal["steady", "arrivals"]
EQUATIONS = ("eq2", "eq3", "eq5", "eq13")
"""The equations that have two forms."""
MOST_EXPONENT = 35.0
"""exp() is cut here in the literal eqs 3 and 5: float32 goes up to exp(88), and Adam squares the gradient."""
NEVER = 1e9
"""Updates that no run has."""
PATIENCE_UPDATES = {"goal": 4000.0, "replan": 4000.0, "map": NEVER}
"""patience_updates of each guidance. A policy that is shown the map's waypoints can earn what the expert does: there
Q_max stays the expert's."""
LAMBDA_FLOOR = {"goal": 0.0, "replan": 0.0, "map": 0.1}
"""lambda_floor of each guidance. Shown the map's waypoints, a policy can do what the expert does. With the goal alone
it cannot follow the detours of an expert that knows the map, and what is left of the pull to them costs success."""
LEAST_REACH = 0.25
"""Q_max comes no nearer to Q_min than this share of the way to the expert's return: a critic that settles lower has
not learnt, and its noise is no maturity. It also bounds the gain of the loop from S through the weights to S."""
PROGRESS_GAIN, SETBACK_GAIN = 1.2e-3, 4e-3
"""K_P and K_D of the driver progress, a gradient update. Zhao et al. have 3e-5 and 1e-4 an environment step, of a
weight that begins at 0.4; an update is 16 steps."""
TARGET_SCORE = 1.05
"""R_target of the driver progress, in returns of the expert: Zhao et al."""
ARRIVALS = 20.0
"""Episodes over which the share that arrives is averaged."""
MOST_COLD = 0.9
"""A cold critic that promises more than this share of what the expert earns counts as one that promises so much."""


@dataclass(frozen=True, kw_only=True)
class ScheduleConfig:
    """Constants and forms of eqs 2, 3, 5 and 13. Times count gradient updates."""

    driver: tyro.conf.Suppress[Driver] = "value"
    """What S follows: the critic's value as in the paper, or, as controls, the discounted return of the training
    episodes against the same bounds, or the clock. progress: that return moves S, see adapted."""
    clock_updates: Annotated[float, Range(0.001, 1e9)] = 6000.0
    """Updates after the warm-up until S = 1, for the driver clock; 0.001 to 1e+09."""
    alpha_min: Annotated[float, Range(0.0, 1.0)] = 0.05
    """Share of expert rows in a batch that is never released; 0 to 1."""
    alpha_max: Annotated[float, Range(0.0, 1.0)] = 0.5
    """Share of expert rows at S = 0. Near 1 learning is offline: the critic never sees its mistakes; 0 to 1."""
    k_alpha: Annotated[float, Range(0.0, 1e6)] = 40.0
    """k_alpha of eq 3: how sharply alpha falls with S; 0 to 1e+06."""
    b_alpha: Annotated[float, Range(0.0, 1e6)] = 4.0
    """b_alpha of eq 3: alpha is half released at S = b_alpha / k_alpha; 0 to 1e+06."""
    lambda_max: Annotated[float, Range(0.0, 1e6)] = 1.0
    """lambda_max of eq 5: weight of cloning beside the normalised Q at S = 0; 0 to 1e+06."""
    k_q: Annotated[float, Range(0.0, 1e6)] = 10.0
    """k_q of eq 5: what is released of lambda falls by exp(-k_q) from S = 0 to S = 1; 0 to 1e+06."""
    lambda_floor: Annotated[float, Range(0.0, 1.0)] | None = None
    """Share of lambda_max that is never released: the weak regulariser of the autonomy phase. None: 0.1 with guidance
    map alone, where a policy would unlearn what its own noise spares it in training; 0 with any other, and where no
    guidance is known, as the expert knows a map that the policy does not (docs/decisions.md); 0 to 1."""
    warmup_updates: Annotated[int, Range(0, 1_000_000_000)] = 0
    """Updates during which S stays 0: the critic starts cold and its values mean nothing yet; 0 to 1e+09."""
    smoothing_updates: Annotated[float, Range(0.001, 1e9)] = 200.0
    """Time constant of the exponential moving average over measured maturities; 0.001 to 1e+09."""
    rise_updates: Annotated[float, Range(0.001, 1e9)] = 2500.0
    """Updates that S takes at the least from 0 to 1; 0.001 to 1e+09."""
    rise: tyro.conf.Suppress[Rise] = "steady"
    """How fast S may rise. steady: as rise_updates says. arrivals: times the share of the training episodes that have
    arrived lately. Where an expert errs, what it earns can be less than a critic promises that has learnt to hit
    nothing and arrives nowhere: without an arrival nothing is released."""
    fall_updates: ClassVar[float] = 30000.0
    """Updates that S takes at the least from 1 to 0. Far more than rise_updates: the ratchet."""
    patience_updates: Annotated[float, Range(0.001, 1e9)] | None = None
    """Time constant with which Q_max comes down from the expert's return towards where the critic is, if that is lower:
    an expert that knows the map earns what a policy without one never will. None: 4000, and 1e9, which is never,
    where guidance map shows the policy the way; 0.001 to 1e+09."""
    interval_updates: Annotated[int, Range(1, 1_000_000_000)] = 100
    """Updates between two measurements; 1 to 1e+09."""
    eq2: Form = "corrected"
    """The statistic of the critic. Literal: mean Q over the mixed batch, which depends on alpha itself."""
    eq3: Form = "corrected"
    """alpha. Literal: a sigmoid of that raw Q."""
    eq5: Form = "corrected"
    """lambda. Literal: an exponential of that raw Q, above lambda_max where it is negative."""
    eq13: Form = "corrected"
    """S. Literal: between the running extremes of the statistic, neither averaged nor limited in its rate."""

    def __post_init__(self) -> None:
        require_forms(self, *EQUATIONS)
        if self.driver not in get_args(Driver):
            raise ConfigError(
                f"schedule.driver is {self.driver!r}; give one of {', '.join(get_args(Driver))}"
            )
        if self.rise not in get_args(Rise):
            raise ConfigError(f"schedule.rise is {self.rise!r}; give one of {', '.join(get_args(Rise))}")
        check_ranges(self, "schedule.")
        if self.alpha_min > self.alpha_max:
            raise ConfigError(
                f"schedule: alpha_min {self.alpha_min}, alpha_max {self.alpha_max}; give 0 <= min <= max <= 1"
            )

    @property
    def imitates(self) -> bool:
        """Whether the expert is used at all; if not, training is what it is without demonstrations."""
        return self.alpha_max > 0.0 or self.lambda_max > 0.0

    @property
    def releases(self) -> bool:
        """Whether alpha or lambda follows S."""
        cloning = self.lambda_max > 0.0 and self.k_q > 0.0 and self.lambda_floor != 1.0
        return cloning or self.alpha_min < self.alpha_max

    @property
    def needs_probe(self) -> bool:
        """Whether S is measured on the probe's states, or against what is earned from them."""
        all_literal = self.driver == "value" and self.eq2 == self.eq13 == "literal"
        return self.driver != "clock" and not all_literal

    @property
    def follows_return(self) -> bool:
        """Whether S follows what the training episodes earn."""
        return self.driver in ("return", "progress")

    def literal(self) -> Self:
        """The same constants with every equation as printed."""
        return replace(self, **dict.fromkeys(EQUATIONS, "literal"))

    @property
    def expert_in_reach(self) -> bool:
        """Whether Q_max stays the expert's return, and Q_min the value of the first statistic."""
        return self.patience_updates is not None and self.patience_updates >= NEVER

    def under(self, guidance: str) -> Self:
        """With the patience and the floor of a guidance, where none is given. Raises UnknownName."""
        if guidance not in PATIENCE_UPDATES:
            raise UnknownName("guidance", guidance, tuple(PATIENCE_UPDATES))
        own = {"patience_updates": PATIENCE_UPDATES[guidance], "lambda_floor": LAMBDA_FLOOR[guidance]}
        return replace(self, **{name: value for name, value in own.items() if getattr(self, name) is None})


class MaturityState(NamedTuple):
    """What the maturity remembers. Plain numbers, so a checkpoint holds it as JSON."""

    maturity: float = 0.0
    """S(t) in [0, 1]."""
    average: float = 0.0
    """Moving average of the measured maturities, before the rate limit."""
    updates: int = 0
    """Gradient updates since the critic began to learn."""
    statistic: float | None = None
    """Q(t), the last value measured (eq 2); None before the first."""
    lowest: float | None = None
    """Q_min of the literal eq 13, the least statistic so far."""
    highest: float | None = None
    """Q_max of the literal eq 13."""
    cold: float | None = None
    """The first statistic, of a critic that has just begun to learn."""
    cold_share: float | None = None
    """Where it lay on the way from chance's return to the expert's, under the weights of then."""
    reach: float = 1.0
    """Where Q_max lies: a share of the way from Q_min to the expert's return."""
    arriving: float = 0.0
    """Share of the latest training episodes that arrived, a moving average over episodes; 0 for rise steady."""


class Bounds(NamedTuple):
    """What chance and the expert earn from the probe's states, in the reward's units, under today's weights."""

    low: float
    """Mean discounted return of a random policy."""
    high: float
    """The same of the demonstrations."""


def alpha(state: MaturityState, config: ScheduleConfig) -> float:
    """alpha = alpha_min + (alpha_max - alpha_min) sigma(b_alpha - k_alpha S) (eq 3): expert rows' share.

    Literal: sigma(b_alpha - k_alpha Q). A share that is fixed is fixed in either form.
    """
    if config.alpha_min == config.alpha_max:
        return config.alpha_max
    if config.eq3 == "literal":
        return _sigmoid(config.b_alpha - config.k_alpha * (state.statistic or 0.0))
    released = _sigmoid(config.b_alpha - config.k_alpha * state.maturity)
    return config.alpha_min + (config.alpha_max - config.alpha_min) * released


def lambda_bc(state: MaturityState, config: ScheduleConfig) -> float:
    """lambda = lambda_max (f + (1 - f) exp(-k_q S)) (eq 5): weight of cloning in the actor's objective (eq 6).

    f is lambda_floor. Literal: lambda_max exp(-k_q Q), cut at exp(MOST_EXPONENT). For the driver progress
    lambda_max (1 - S).
    """
    if config.driver == "progress":
        return config.lambda_max * (1.0 - state.maturity)
    if config.eq5 == "literal":
        return config.lambda_max * math.exp(min(-config.k_q * (state.statistic or 0.0), MOST_EXPONENT))
    released = 1.0 - math.exp(-config.k_q * state.maturity)
    floor = LAMBDA_FLOOR["goal"] if config.lambda_floor is None else config.lambda_floor
    return config.lambda_max * (1.0 - (1.0 - floor) * released)


def _sigmoid(x: float) -> float:
    return 1.0 / (1.0 + math.exp(min(-x, MOST_EXPONENT)))


def measured_maturity(statistic: float, bounds: Bounds) -> float:
    """clip((Q - Q_min) / (Q_max - Q_min), 0, 1) (eq 13). 0 where the expert is no better than chance."""
    span = bounds.high - bounds.low
    if span <= 1e-6:
        return 0.0
    return min(max((statistic - bounds.low) / span, 0.0), 1.0)


def bounds_in_use(state: MaturityState, bounds: Bounds, config: ScheduleConfig) -> Bounds:
    """Q_min and Q_max that S is measured between. bounds: of the probe."""
    if state.lowest is not None and state.highest is not None:
        return Bounds(state.lowest, state.highest)
    if state.cold is None or state.cold_share is None:
        return bounds
    if config.expert_in_reach:  # S of a share stayed higher there, and driving was worse: docs/decisions.md
        return Bounds(max(bounds.low, state.cold), bounds.high)
    low = bounds.low + state.cold_share * (bounds.high - bounds.low)
    return Bounds(low, low + state.reach * (bounds.high - low))


def arrivals(state: MaturityState, arrived: Iterable[bool]) -> MaturityState:
    """Count training episodes that have ended, in their order. arrived: whether each reached its goal."""
    share = state.arriving
    for one in arrived:
        share += (one - share) / ARRIVALS
    return state._replace(arriving=share)


def update(
    state: MaturityState, statistic: float, bounds: Bounds, dt_updates: int, config: ScheduleConfig
) -> MaturityState:
    """One measurement of S, dt_updates after the last.

    statistic: Q(t) of eq 2. Corrected, the mean over fixed states of min_i Q'_i(s, pi(s)): a batch's mean would
    depend on alpha itself. For the driver `return` it is what training episodes earned from their states. bounds: of
    the probe; the literal eq 13 uses the running extremes instead.

    S moves the reward's weights, they move Q, and Q moves S. Four things break this loop: the bounds are formed
    under the same weights as Q, the average is slow against the critic, S falls far slower than it may rise
    (fall_updates), so it cannot swing, and Q_max does not come down all the way (LEAST_REACH). The literal form has
    none of them.
    """
    updates = state.updates + dt_updates
    if config.driver == "clock":
        share = (updates - config.warmup_updates) / config.clock_updates
        return MaturityState(min(max(share, 0.0), 1.0), updates=updates, statistic=statistic)
    if config.driver == "value" and config.eq13 == "literal":
        lowest = statistic if state.lowest is None else min(state.lowest, statistic)
        highest = statistic if state.highest is None else max(state.highest, statistic)
        measured = measured_maturity(statistic, Bounds(lowest, highest))
        return MaturityState(measured, measured, updates, statistic, lowest, highest)
    if config.driver == "progress":
        return adapted(state, statistic, bounds, dt_updates, config)
    # A critic that has hardly learnt promises more than chance earns: that is no maturity yet.
    if state.cold is None:
        share = min(measured_maturity(statistic, bounds), MOST_COLD)
        state = state._replace(cold=statistic, cold_share=share)
    if updates <= config.warmup_updates:
        return MaturityState(
            updates=updates,
            statistic=statistic,
            cold=state.cold,
            cold_share=state.cold_share,
            arriving=state.arriving,
        )
    to_expert = bounds_in_use(state._replace(reach=1.0), bounds, config)
    gain = 1.0 - math.exp(-dt_updates / config.smoothing_updates)
    average = state.average + gain * (measured_maturity(statistic, to_expert) - state.average)
    most, least = dt_updates / config.rise_updates, -dt_updates / config.fall_updates
    if config.rise == "arrivals":
        most *= state.arriving
    reach = state.reach
    if not config.expert_in_reach:
        lowered = 1.0 - math.exp(-dt_updates / (config.patience_updates or PATIENCE_UPDATES["goal"]))
        reach = max(reach + lowered * (average - reach), average, LEAST_REACH)
    change = min(max(average / reach - state.maturity, least), most)
    maturity = min(max(state.maturity + change, 0.0), 1.0)
    return state._replace(
        maturity=maturity, average=average, updates=updates, statistic=statistic, reach=reach
    )


def adapted(
    state: MaturityState, statistic: float, bounds: Bounds, dt_updates: int, config: ScheduleConfig
) -> MaturityState:
    """S += dt (K_P (R_target - R_avg) - K_D max(0, R_avg - R)): lambda_max (1 - S) is the weight of Zhao et al. 2022.

    It falls as long as the target is ahead, and rises where the return drops below its average. R: the statistic, what
    training episodes earned lately, as a share of the way from chance's return to the expert's; R_avg: its moving
    average, of before.
    """
    score = measured_maturity(statistic, bounds)
    average = score if state.statistic is None else state.average
    step = PROGRESS_GAIN * (TARGET_SCORE - average) - SETBACK_GAIN * max(average - score, 0.0)
    gain = 1.0 - math.exp(-dt_updates / config.smoothing_updates)
    return state._replace(
        maturity=min(max(state.maturity + dt_updates * step, 0.0), 1.0),
        average=average + gain * (score - average),
        updates=state.updates + dt_updates,
        statistic=statistic,
    )
