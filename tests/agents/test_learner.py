"""Laws of the learner: whose rows it learns from, when, and that its updates own what they read."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import resume_run
from adrl.agents.backend import jax
from adrl.agents.learner import Learner
from adrl.agents.methods import method_config
from adrl.deploy.policy import PolicyConfig
from adrl.errors import ConfigError
from adrl.imitation.probe import Probe, record_probe
from adrl.imitation.schedule import MaturityState, ScheduleConfig, alpha
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
        learner.replay.add(observation, action, terms, features, successor, ended, ~ended, 0.5)


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
    assert learner.lambda_bc == pytest.approx(schedule.lambda_max * np.exp(-schedule.k_q))


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
