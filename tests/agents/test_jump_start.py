"""Laws of the jump-start curriculum, and of what a guide drives."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl.agents.config import Guide, TrainConfig
from adrl.agents.exploration import Acting, Explorer
from adrl.agents.jump_start import STAGES, TOLERANCE, WINDOW, JumpStart
from adrl.deploy.policy import MlpPolicy, PolicyConfig


def says(value: float) -> MlpPolicy:
    """A policy with one action, whatever it sees."""
    layer = np.zeros((3, 2), np.float32), np.full(2, np.arctanh(value), np.float32)
    return MlpPolicy([layer], PolicyConfig(input_size=3, widths=()))


@given(st.integers(1, 400), st.lists(st.tuples(st.integers(0, 40), st.floats(0.0, 1.0)), max_size=60))
def test_the_guide_drives_ever_fewer_steps(horizon: int, steps: list[tuple[int, float]]):
    jump = JumpStart(horizon)
    assert jump.guided_steps == horizon
    for ended, share in steps:
        following = jump.after(ended, round(share * ended))
        assert following.guided_steps <= jump.guided_steps
        assert following.best >= jump.best
        jump = following


def test_a_stage_is_passed_by_as_much_success_as_ever_and_not_by_less():
    jump = JumpStart(100).after(WINDOW, round(0.9 * WINDOW))
    assert (jump.stage, jump.guided_steps) == (STAGES - 1, 90)
    worse = jump.after(WINDOW, round((jump.best - 3 * TOLERANCE) * WINDOW))
    assert worse.stage == jump.stage
    for _ in range(STAGES):
        jump = jump.after(WINDOW, WINDOW)
    assert (jump.stage, jump.guided_steps) == (0, 0)
    assert jump.after(WINDOW, 0) == jump


def explorer(guide: Guide, horizon: int) -> Explorer:
    return Explorer(TrainConfig(guide=guide, exploration_std=(0.0, 0.0)), 4, horizon)


def test_the_guide_drives_the_first_steps_of_each_episode():
    acting = Acting(says(0.25), says(0.75))
    steps = np.array([0, 9, 10, 11], np.float32)
    observation, rng = np.zeros((4, 3), np.float32), np.random.default_rng(0)
    action = explorer("jump-start", 10).act(acting, observation, steps, rng)
    assert_allclose(action[:, 0], [0.75, 0.75, 0.25, 0.25], rtol=1e-6)
    assert_allclose(
        explorer("jump-start", 0).act(acting, observation, steps, rng), np.full((4, 2), 0.25), rtol=1e-6
    )


def test_a_proposal_is_weighed_against_what_the_actor_would_do():
    chosen = Acting(says(0.25), says(0.75), lambda observation, first, second: second - first)
    action = explorer("proposal", 10).act(
        chosen, np.zeros((4, 3), np.float32), np.zeros(4, np.float32), np.random.default_rng(0)
    )
    assert_allclose(action, np.full((4, 2), 0.5), rtol=1e-6)


def test_a_curriculum_goes_on_from_its_numbers():
    first, second = explorer("jump-start", 50), explorer("jump-start", 50)
    first.count(WINDOW, WINDOW)
    assert first.numbers() != second.numbers()
    second.restore(first.numbers())
    assert first.numbers() == second.numbers()
    assert explorer("proposal", 50).numbers() == {}
