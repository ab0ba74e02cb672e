"""What fine-tuning leaves: never worse than what it began with, by validation."""

import json

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from adrl.agents.best import Best
from adrl.agents.interface import Validation
from adrl.deploy.policy import MlpPolicy, PolicyConfig

ABOUT = PolicyConfig(input_size=1, widths=())


def numbered(number: int) -> MlpPolicy:
    """A policy that can be told from others."""
    layer = np.full((1, 2), number, np.float32), np.zeros(2, np.float32)
    return MlpPolicy([layer], PolicyConfig(input_size=1, widths=(), maturity=number / 100))


def validation(success: float, seconds: float) -> Validation:
    return Validation(
        success=success, seconds=seconds, start=np.zeros((1, 1), np.float32), discounted_return=0.0
    )


def number_of(policy: MlpPolicy) -> int:
    return int(policy.layers[0][0][0, 0])


Scores = st.lists(
    st.tuples(st.sampled_from([0.9, 0.99, 1.0]), st.sampled_from([10.0, 11.0, 12.0])), min_size=1, max_size=20
)


@given(Scores)
def test_the_best_is_kept_the_first_of_equal_ones_and_the_start_is_told(scores: list[tuple[float, float]]):
    best = Best.of(numbered(0), validation(*scores[0]))
    for number, score in enumerate(scores[1:], 1):
        best.offer(numbered(number), 100 * number, validation(*score))
        about = json.loads(json.dumps(best.numbers()))
        best = Best.restored(about, best.arrays(), ABOUT)
    expected = min(range(len(scores)), key=lambda i: (-scores[i][0], scores[i][1], i))
    left = best.policy_with(ABOUT)
    assert number_of(left) == expected
    assert left.config.maturity == expected / 100
    told = left.config.extra["validated"]
    assert (told["start"]["success"], told["start"]["seconds"]) == scores[0]
    assert tuple(told["kept"].values()) == (100 * expected, *scores[expected])
