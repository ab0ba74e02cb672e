"""Laws of the jump-start curriculum, and of what a guide drives."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl.agents.config import Guide, TrainConfig
from adrl.agents.exploration import Acting, Explorer
from adrl.agents.jump_start import AVERAGED, STAGES, TOLERANCE, WINDOW, JumpStart
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import CheckpointError

ONE = np.ones(1)
"""A step is a reference period."""


def says(value: float) -> MlpPolicy:
    """A policy with one action, whatever it sees."""
    layer = np.zeros((3, 2), np.float32), np.full(2, np.arctanh(value), np.float32)
    return MlpPolicy([layer], PolicyConfig(input_size=3, widths=()))


def all_end(jump: JumpStart, succeed: int) -> JumpStart:
    """After an episode of every robot, the first `succeed` of which reach the goal."""
    rows = np.arange(len(jump.awaited))
    return jump.after(rows >= 0, rows < succeed)


def windows_of(jump: JumpStart, *success: float) -> JumpStart:
    """After windows of 100 robots with these shares of success, in each of which episodes of before end in failure."""
    for share in success:
        jump = all_end(jump, round(100 * share))
        if jump.stage:
            assert all_end(jump, 0) == jump._replace(awaited=[1] * 100)
            jump = all_end(jump, 0)
    return jump


def test_success_of_episodes_that_began_before_the_window_does_not_count():
    """Robots all begin together; after a window each has one to end that began under another h."""
    jump = JumpStart.start(100, 64)
    for _ in range(AVERAGED):
        jump = all_end(all_end(jump, 64), 0)
    assert (jump.average, jump.best, jump.stage) == (1.0, 1.0, STAGES)
    later = all_end(all_end(jump, 64), 64)
    assert (later.stage, later.succeeded) == (STAGES - 1, 0), (
        "a window passed, and none of the next has ended"
    )


@pytest.mark.parametrize("fast", [1, 32, 63])
def test_short_episodes_count_no_more_than_long_ones(fast: int):
    """`fast` robots fail after a step, again and again; the others reach the goal after 40."""
    jump = JumpStart.start(100, 64)
    rows = np.arange(64)
    for step in range(1, 1000):
        jump = jump.after((rows < fast) | (step % 40 == 0), rows >= fast)
    assert jump.windows == AVERAGED
    assert jump.average == pytest.approx(1.0 - fast / 64)


@given(
    st.integers(1, 400),
    st.integers(1, 70),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.integers(0, 1000),
)
def test_the_guide_drives_ever_fewer_steps(
    horizon: int, robots: int, ends: float, succeeds: float, seed: int
):
    rng = np.random.default_rng(seed)
    jump = JumpStart.start(horizon, robots)
    assert jump.guided_steps(ONE) == horizon
    for _ in range(200):
        step = rng.random(robots) < ends, rng.random(robots) < succeeds
        following = jump.after(*step)
        assert following.guided_steps(ONE) <= jump.guided_steps(ONE)
        assert following.best >= jump.best
        assert following == JumpStart(**json.loads(json.dumps(jump._asdict()))).after(*step)
        jump = following


@given(st.integers(1, 400), st.integers(0, STAGES), st.lists(st.floats(0.1, 3.0), min_size=1, max_size=5))
def test_the_guide_drives_every_robot_for_the_same_time(horizon: int, stage: int, periods: list[float]):
    jump = JumpStart.start(horizon, 4)._replace(stage=stage)
    of_steps = np.array(periods)
    guided = jump.guided_steps(of_steps)
    assert (abs(guided * of_steps - horizon * stage / STAGES) <= 0.5 * of_steps + 1e-5 * of_steps).all()
    own = JumpStart.start(horizon * of_steps[0], 4)._replace(stage=stage)
    assert own.guided_steps(of_steps[:1]) == round(horizon * stage / STAGES)


@given(st.integers(1, 200))
def test_a_window_has_as_many_episodes_of_each_robot_and_enough(robots: int):
    jump = JumpStart.start(100, robots)
    assert len(set(jump.awaited)) == 1
    assert WINDOW <= sum(jump.awaited) < WINDOW + robots
    for _ in range(jump.awaited[0] - 1):
        jump = all_end(jump, robots)
    assert jump.windows == 0
    assert all_end(jump, robots).windows == 1


@given(st.floats(0.01, 1.0))
def test_equal_success_passes_every_stage_once_there_is_a_mark(share: float):
    mark = windows_of(JumpStart.start(100, 100), *[share] * AVERAGED)
    assert (mark.stage, mark.best) == (STAGES, pytest.approx(round(100 * share) / 100))
    for stage in reversed(range(STAGES)):
        mark = windows_of(mark, share)
        assert (mark.stage, mark.guided_steps(ONE)) == (stage, 10 * stage)
    assert all_end(mark, 0) == mark


def test_who_never_succeeds_keeps_the_guide_and_so_does_who_no_longer_does():
    jump = windows_of(JumpStart.start(100, 100), *[0.0] * 30)
    assert (jump.stage, jump.best) == (STAGES, 0.0)
    assert windows_of(jump, 0.02, *[0.0] * 30).stage == STAGES


def test_less_success_than_ever_passes_no_stage():
    jump = windows_of(JumpStart.start(100, 100), *[0.9] * AVERAGED)
    less = 0.9 - TOLERANCE - 0.01
    assert windows_of(jump, *[less] * 30).stage == STAGES
    assert windows_of(jump, *[less] * 30, 0.9).stage == STAGES - 1


@given(st.integers(0, AVERAGED + STAGES - 1))
def test_a_lucky_window_does_not_block_for_ever(lucky: int):
    """At whatever time: 100 % where 90 % are usual."""
    shares = [0.9] * (AVERAGED + STAGES + 1)
    shares[lucky] = 1.0
    assert windows_of(JumpStart.start(100, 100), *shares).stage == 0


@pytest.mark.parametrize("success", [0.3, 0.6, 0.9])
def test_chance_does_not_block(success: float):
    """A policy of constant success, with episodes that succeed by chance, is left to itself in the end."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        jump, windows = JumpStart.start(100, 64), 0
        while jump.stage and windows < 200:
            jump, windows = all_end(all_end(jump, rng.binomial(64, success)), 0), windows + 1
        assert jump.stage == 0


def explorer(guide: Guide, horizon: int) -> Explorer:
    return Explorer(TrainConfig(guide=guide, exploration_std=(0.0, 0.0)), 4, horizon)


def test_the_guide_drives_the_first_steps_of_each_episode():
    acting = Acting(says(0.25), says(0.75))
    steps = np.array([0, 9, 10, 11], np.float32)
    observation, rng = np.zeros((4, 3), np.float32), np.random.default_rng(0)
    action = explorer("jump-start", 10).act(acting, observation, steps, np.ones(4), rng)
    assert_allclose(action[:, 0], [0.75, 0.75, 0.25, 0.25], rtol=1e-6)
    assert_allclose(
        explorer("jump-start", 0).act(acting, observation, steps, np.ones(4), rng),
        np.full((4, 2), 0.25),
        rtol=1e-6,
    )


def test_a_proposal_is_weighed_against_what_the_actor_would_do():
    chosen = Acting(says(0.25), says(0.75), lambda observation, first, second: second - first)
    action = explorer("proposal", 10).act(
        chosen, np.zeros((4, 3), np.float32), np.zeros(4, np.float32), np.ones(4), np.random.default_rng(0)
    )
    assert_allclose(action, np.full((4, 2), 0.5), rtol=1e-6)


def test_a_curriculum_goes_on_from_its_numbers():
    first, second = explorer("jump-start", 50), explorer("jump-start", 50)
    first.count(np.array([True, False, True, False]), np.array([True, True, False, False]))
    assert first.numbers() != second.numbers()
    second.restore(json.loads(json.dumps(first.numbers())))
    assert first.numbers() == second.numbers()
    assert explorer("proposal", 50).numbers() == {}
    with pytest.raises(CheckpointError, match="of 3 robots, not 4"):
        second.restore(JumpStart.start(50, 3)._asdict())
    assert first.numbers() == second.numbers()
