"""Laws of the learner: whose rows it learns from, when, and that its updates own what they read."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import resume_run
from adrl.agents.backend import jax
from adrl.agents.config import Guide
from adrl.agents.learner import Learner
from adrl.agents.methods import method_config
from adrl.agents.networks import critic_sizes
from adrl.deploy.policy import PolicyConfig
from adrl.errors import ConfigError
from adrl.imitation.probe import Probe, record_probe
from adrl.imitation.schedule import MaturityState, ScheduleConfig, alpha, lambda_bc
from adrl.types import Form
from probe_envs import Walk

CONFIG = resume_run.config(1)
POLICY = PolicyConfig(input_size=2, widths=CONFIG.td3.widths)


def make(*, expert: bool = True, probe: Probe | None = None, **changes: object) -> Learner:
    config = replace(CONFIG, **changes)  # pyright: ignore[reportArgumentType]
    demonstrations = resume_run.demonstrations() if expert else None
    probe = probe or record_probe(Walk(4), seed=7, max_steps=20)
    return Learner(config, 4, 2, demonstrations, probe, np.random.default_rng(0))


def fill(learner: Learner, steps: int, seed: int) -> None:
    """Write noise into the online ring."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        ended = rng.random(4) < 0.1
        observation, successor = rng.normal(size=(2, 4, 2)).astype(np.float32)
        action = rng.uniform(-1, 1, (4, 2)).astype(np.float32)
        terms = rng.normal(size=(4, 6)).astype(np.float32)
        features = rng.random((4, 3), dtype=np.float32)
        learner.replay.add(observation, action, terms, features, successor, ended, ~ended, 0.5, np.ones(4))


def parameters(learner: Learner) -> list[np.ndarray]:
    return [np.array(leaf) for leaf in jax.tree.leaves(learner.state)]


def test_the_ring_may_be_written_while_an_update_runs():
    """JAX on CPU may alias what it is given; an update that read the ring itself would see later steps."""
    hurried, patient = make(pretrain_updates=0), make(pretrain_updates=0)
    for learner in (hurried, patient):
        fill(learner, 75, 0)
    for seed in range(1, 60):
        for learner in (hurried, patient):
            learner.update()
            if learner is patient:
                jax.block_until_ready(learner.state)
            fill(learner, 75, seed)
    for a, b in zip(parameters(hurried), parameters(patient), strict=True):
        assert_array_equal(a, b)


def test_pretraining_needs_no_online_data_and_clones_the_expert():
    learner = make(pretrain_updates=600)
    while learner.pretraining:
        learner.update()
    assert learner.updates == learner.pretrain_updates == 600
    observation = resume_run.demonstrations().observation
    actions = learner.policy(POLICY, averaged=False).act(observation)
    np.testing.assert_allclose(actions, 0.5, atol=0.1)  # what Walk's expert does everywhere


@pytest.mark.parametrize("guide", ["proposal", "jump-start"])
def test_a_guide_is_the_clone_that_pretraining_leaves_and_stays_so(guide: Guide):
    released = replace(CONFIG.schedule, lambda_max=0.0)
    learner = make(pretrain_updates=600, critic_warmup_updates=0, guide=guide, schedule=released)
    fill(learner, 40, 0)
    observation = resume_run.demonstrations().observation
    while learner.pretraining:
        learner.update()
        guide_so_far = learner.acting(POLICY).guide
        assert guide_so_far is not None
        assert_array_equal(guide_so_far.act(observation), learner.policy(POLICY).act(observation))
    clone = learner.policy(POLICY).act(observation)
    acting = learner.acting(POLICY)
    for _ in range(5):
        acting = learner.acting(POLICY)
        assert acting.guide is not None
        assert_array_equal(acting.guide.act(observation), clone)
        learner.update()
    assert np.abs(learner.policy(POLICY).act(observation) - clone).max() > 1e-4
    if guide == "proposal":
        assert acting.choose is not None
        actor = acting.actor.act(observation)
        chosen = acting.choose(observation, actor, clone)
        assert ((chosen == actor) | (chosen == clone)).all()


def test_expert_rows_follow_alpha_of_the_maturity():
    schedule = ScheduleConfig(warmup_updates=8, interval_updates=4, rise_updates=8, smoothing_updates=1.0)
    learner = make(pretrain_updates=0, schedule=schedule)
    fill(learner, 40, 0)
    assert learner.maturity == 0.0
    assert learner.expert_rows == round(alpha(MaturityState(), schedule) * 16)
    learner.online_updates += 4
    learner.mature()  # what a cold critic says
    # A critic that promises more than the demonstrations ever earned counts as mature.
    learner.state = learner.state._replace(target_critics=learner.state.target_critics.at[:].set(1.0))
    for _ in range(12):
        learner.online_updates += 4
        learner.mature()
    assert learner.maturity == 1.0
    assert learner.expert_rows == round(alpha(MaturityState(maturity=1.0), schedule) * 16)
    assert learner.lambda_bc == pytest.approx(lambda_bc(MaturityState(maturity=1.0), schedule))


@pytest.mark.parametrize(
    ("eq2", "share", "mean"), [("literal", 0.25, -0.25), ("literal", 0.75, 3.25), ("corrected", 0.75, 3.0)]
)
def test_eq_2_as_printed_follows_alpha_and_on_the_probe_does_not(eq2: Form, share: float, mean: float):
    """A critic that says 10 v for v, the first number of the action, which is -0.2 online, 0.5 the expert's, 0.3 pi's.

    Of 16 rows alpha = 0.25 takes 4 of the expert's: (12 * -2 + 4 * 5) / 16 = -0.25. With alpha = 0.75 it is
    (4 * -2 + 12 * 5) / 16 = 3.25. On the probe it is 10 * 0.3.
    """
    schedule = ScheduleConfig(eq2=eq2, alpha_min=share, alpha_max=share, interval_updates=1)
    still = {"critic_learning_rate": 1e-12, "actor_learning_rate": 1e-12}
    td3 = replace(CONFIG.td3, critic_layer_norm=False, **still)
    learner = make(pretrain_updates=0, schedule=schedule, td3=td3)
    critic = says_ten_times_the_speed(critic_sizes(2, td3.widths))
    learner.state = learner.state._replace(
        critics=jax.numpy.tile(critic, 2),
        target_critics=jax.numpy.tile(critic, 2),
        actor=jax.numpy.zeros_like(learner.state.actor).at[-2].set(np.arctanh(0.3)),
    )
    nothing, action, ended = (
        np.zeros((4, 9), np.float32),
        np.full((4, 2), -0.2, np.float32),
        np.zeros(4, bool),
    )
    for _ in range(40):
        observation, terms, features = nothing[:, :2], nothing[:, :6], nothing[:, 6:]
        learner.replay.add(observation, action, terms, features, observation, ended, ended, 0.5, np.ones(4))
    learner.update()
    learner.mature()
    assert learner.row()["statistic"] == pytest.approx(mean, abs=1e-5)


def says_ten_times_the_speed(sizes: tuple[int, ...]) -> np.ndarray:
    """Parameters of a critic of (observation, action): 10 relu(v + 1) - 10 for the action's first number v >= -1."""
    layers = []
    for i, o in pairwise(sizes[:-1]):
        weight, bias = np.zeros((i, o)), np.zeros(o)
        weight[0 if layers else i - 2, 0] = 1.0
        bias[0] = 0.0 if layers else 1.0
        layers += [weight.ravel(), bias]
    last = np.zeros(sizes[-2])
    last[0] = 10.0
    return np.concatenate([*layers, last, [-10.0]]).astype(np.float32)


def test_a_method_that_does_not_imitate_uses_no_demonstrations_and_no_schedule():
    for expert in (True, False):
        learner = make(expert=expert, **vars(method_config("td3", CONFIG)))
        fill(learner, 40, 0)
        assert not learner.pretraining
        assert (learner.alpha, learner.lambda_bc, learner.expert_rows) == (0.0, 0.0, 0)
        learner.update()
        learner.mature()
        assert learner.reward_maturity == learner.maturity == CONFIG.static_maturity
        assert learner.updates == CONFIG.updates_per_iteration


@pytest.mark.parametrize(("method", "stored"), [("td3bc", CONFIG.static_maturity), ("adrl", 0.0)])
def test_demonstrations_are_stored_under_the_weights_of_the_start(method: str, stored: float):
    """By the literal eq 17 that S weighs them for ever: static weights are those of the online rows too."""
    learner = make(**vars(method_config(method, CONFIG)))
    batch = learner.replay.sample(np.random.default_rng(0), 1, 0, 16)
    assert_array_equal(batch.signals[..., -1], np.full_like(batch.signals[..., -1], stored))
    assert learner.reward_maturity == stored


def test_what_a_method_needs_is_asked_for():
    with pytest.raises(ConfigError, match="demonstrations"):
        make(expert=False)
    with pytest.raises(ConfigError, match="probe"):
        Learner(CONFIG, 4, 2, resume_run.demonstrations(), None, np.random.default_rng(0))


def test_the_return_driver_follows_the_training_episodes():
    """Returns at the expert's level make S rise whatever the critic says; chance's level keeps it at 0."""
    schedule = ScheduleConfig(
        driver="return", warmup_updates=0, interval_updates=4, rise_updates=8, smoothing_updates=1.0
    )
    for level, expected in (("high", 1.0), ("low", 0.0)):
        learner = make(pretrain_updates=0, schedule=schedule)
        learner.mature()
        learner.online_updates += 4
        learner.mature()
        value = getattr(learner.bounds, level)
        for _ in range(12):
            learner.online_updates += 4
            learner.mature([value, value])
        assert learner.maturity == pytest.approx(expected, abs=1e-6)


def test_while_the_critic_warms_up_it_does_not_move_the_actor():
    """Two critics that disagree about everything: cloning takes the actor the same way."""
    moved = []
    for sign in (1.0, -1.0):
        learner = make(pretrain_updates=0, critic_warmup_updates=100)
        fill(learner, 40, 0)
        learner.state = learner.state._replace(critics=sign * 50.0 * learner.state.critics)
        learner.update()
        moved.append(np.array(learner.state.actor))
    assert np.abs(moved[0] - np.array(make().state.actor)).max() > 1e-4
    np.testing.assert_allclose(moved[0], moved[1], atol=2e-4)
