"""The paper's equations as printed, each by a hand-computed example beside what the corrected form says."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError
from adrl.rewards import RewardConfig, reward, terms, weights
from adrl.types import World
from adrl.worlds.shapes import box
from reward_steps import COLUMN, CONFIG, a_step, term

LITERAL = CONFIG.literal()


def test_literal_is_every_equation_and_nothing_else():
    assert {
        LITERAL.eq8,
        LITERAL.eq9,
        LITERAL.eq10,
        LITERAL.eq11,
        LITERAL.eq14,
        LITERAL.eq16,
        LITERAL.eq17,
    } == {"literal"}
    assert LITERAL.scale == CONFIG.scale
    with pytest.raises(ConfigError, match="eq9"):
        RewardConfig(eq9="printed")  # pyright: ignore[reportArgumentType]


def test_eq_8_sees_points_not_shapes_and_punishes_timeouts():
    """A robot of 0.2 m that touches a box of 1 m at 0.7 m from its middle has not failed."""
    touch: dict[str, object] = {"collided": True, "coordinate_distance_m": 0.7}
    assert (term("failure", LITERAL, **touch), term("failure", CONFIG, **touch)) == (0.0, -200.0)
    near: dict[str, object] = {"collided": True, "coordinate_distance_m": 0.19}
    assert (term("failure", LITERAL, **near), term("failure", CONFIG, **near)) == (-200.0, -200.0)
    late: dict[str, object] = {"timed_out": True}
    assert (term("failure", LITERAL, **late), term("failure", CONFIG, **late)) == (-200.0, 0.0)


def test_eq_9_pays_for_circles():
    """Full speed at half the yaw rate: 1 - 0.8 / 2 = 0.6 a step for ever, against -0.4."""
    circle: dict[str, object] = {"speed_mps": 0.6, "yaw_rate_radps": 0.75}
    assert_allclose(term("motion", LITERAL, **circle), 0.6, rtol=1e-6)
    assert_allclose(term("motion", CONFIG, **circle), -0.4, rtol=1e-6)


def test_eq_10_pays_for_driving_away_and_turning():
    """0.06 m away from the goal behind (heading error pi), turning 0.1 rad: 0.06 + 0.05 exp(-2 pi)."""
    away: dict[str, object] = {
        "distance_m": 4.06,
        "displacement_m": 0.06,
        "turn_rad": -0.1,
        "heading_error_rad": math.pi,
        "previous_heading_error_rad": math.pi - 0.1,
    }
    assert_allclose(term("approach", LITERAL, **away), 0.06 + 0.05 * math.exp(-2 * math.pi), rtol=1e-5)
    assert term("approach", CONFIG, **away) < -0.9
    straight: dict[str, object] = {"distance_m": 3.94, "displacement_m": 0.06}
    assert_allclose(term("approach", LITERAL, **straight), 0.06, rtol=1e-5)


def test_eq_11_rewards_nearness_and_explodes_at_the_safe_distance():
    """c_safe = 0.3: -5 / (0.05 - 0.3) = 20 at 0.05 m, 500 at 0.29 m, 0 beyond."""
    assert_allclose(term("obstacle", LITERAL, clearance_m=0.05), 20.0, rtol=1e-6)
    assert_allclose(term("obstacle", LITERAL, clearance_m=0.29), 500.0, rtol=1e-4)
    assert term("obstacle", LITERAL, clearance_m=0.31) == 0.0
    assert_allclose(term("obstacle", LITERAL, clearance_m=0.3 - 1e-9), 5000.0, rtol=1e-5)
    assert term("obstacle", CONFIG, clearance_m=0.05) < 0.0


@pytest.mark.parametrize("config", [LITERAL, CONFIG])
def test_eq_12_is_about_the_mean_of_five_displacements(config: RewardConfig):
    """d_m = 0.15 * 0.06 m. An episode starts as if at full speed: of five standing steps the first four have a mean of
    0.048, 0.036, 0.024 and 0.012 m, the fifth of 0."""
    env = NavVectorEnv(1, scenario="clutter", reward_config=config, randomize=False, seed=3)
    env.reset(seed=3)
    stand, drive = np.array([[-1.0, 0.0]], np.float32), np.array([[1.0, 0.0]], np.float32)
    moved, paid = [0.06] * 5, []
    for action in [stand] * 6 + [drive] * 3 + [stand] * 12:
        before = env.sim.b["pose"][0, :2].copy()
        *_, info = env.step(action)
        moved.append(math.dist(env.sim.b["pose"][0, :2], before))
        paid.append(info["reward_terms"][0, COLUMN["stagnation"]])
    assert paid[:6] == [0.0, 0.0, 0.0, 0.0, -3.0, -3.0]
    means = [sum(moved[t + 1 : t + 6]) / 5 for t in range(len(paid))]
    assert paid == [-3.0 if mean < 0.009 else 0.0 for mean in means]
    assert 0.0 in paid[6:]
    assert paid[-1] == -3.0


def test_eq_14_gives_no_direction_far_from_the_goal():
    """T = (0.5, 0.25, 1), S = 0.5: 0.6 * 0.5 * 0.25 * 0.5 + 0.05 = 0.0875 against 0.2."""
    features = np.array([0.5, 0.25, 1.0])
    literal, corrected = weights(features, 0.5, RewardConfig(eq14="literal")), weights(features, 0.5, CONFIG)
    assert_allclose(literal[3] / literal[5], 0.0875 / 0.45)
    assert_allclose(corrected[3] / corrected[5], 0.2 / 0.45)
    far = weights(np.array([0.0, 0.0, 0.0]), 0.0, RewardConfig(eq14="literal"))
    assert far[3] == 0.0


def test_eq_16_makes_a_crash_cheaper_where_an_obstacle_is_near():
    """Rows at T = 0, S = 0: 1, 1, 0.3, 0.6, 0.15, 0.05 sum to 3.1; standing at contact, 1, 1, 0.3, 0, 0.3, 0.85."""
    config = RewardConfig(eq16="literal")
    free = weights(np.array([0.0, 0.0, 0.0]), 0.0, config)
    assert_allclose(free, np.array([1.0, 1.0, 0.3, 0.6, 0.15, 0.05]) / 3.1)
    blocked = weights(np.array([1.0, 0.0, 1.0]), 0.0, config)
    assert_allclose(blocked, np.array([1.0, 1.0, 0.3, 0.0, 0.3, 0.85]) / 3.45)
    assert blocked[1] < free[1] < weights(np.array([0.0, 0.0, 0.0]), 0.0, CONFIG)[1] == 1.0


def test_weights_may_be_asked_for_many_maturities_at_once():
    features, maturity = np.full((3, 3), 0.5), np.array([0.0, 0.5, 1.0])
    together = weights(features, maturity, CONFIG)
    for row, s in zip(together, maturity, strict=True):
        assert_allclose(row, weights(np.full(3, 0.5), float(s), CONFIG))


def test_the_literal_reward_prefers_circling_near_an_obstacle_to_arriving():
    """Circles at 0.25 m from an obstacle, S = 1: r_o alone is 100 a step; five seconds pay more than an arrival."""
    circling = a_step(
        speed_mps=0.6, yaw_rate_radps=0.75, displacement_m=0.06, turn_rad=0.075, clearance_m=0.25
    )
    features = np.array([[1.0 / 6.0, 0.0, 0.0]], np.float32)
    for_five_seconds = 50 * reward(terms(circling, LITERAL), features, 1.0, LITERAL)[0]
    arrival = terms(a_step(reached=True), LITERAL)
    assert arrival[0, COLUMN["success"]] == 200.0
    assert for_five_seconds > reward(arrival, features, 1.0, LITERAL)[0] > 0.0


def test_obstacles_have_coordinates_that_move_with_them():
    """A disc that runs 4 m at 0.5 m/s from the start of its round trip; the other obstacles stand."""
    world = World(
        bounds=(0.0, 0.0, 10.0, 10.0),
        circles=np.array([(1.0, 2.0, 0.5)]),
        polygons=(box(4.0, 5.0, 1.0, 2.0, 0.3),),
        segments=np.array([(0.0, 0.0, 10.0, 0.0)]),
        discs=np.array([(2.0, 8.0, 6.0, 8.0, 0.25, 0.5, 0.0, math.inf)]),
    )
    for time_s, x in ((0.0, 2.0), (3.0, 3.5), (8.0, 6.0), (10.0, 5.0), (16.0, 2.0)):
        expected = [(1.0, 2.0), (5.0, 0.0), (4.0, 5.0), (x, 8.0)]
        assert_allclose(world.coordinates(time_s), expected, atol=1e-9)


def test_a_timeout_ends_the_literal_episode_for_good():
    config = RewardConfig(eq8="literal")
    for reward_config, ends in ((config, "terminated"), (RewardConfig(), "truncated")):
        env = NavVectorEnv(4, scenario="clutter", reward_config=reward_config, randomize=False, seed=3)
        env.reset(seed=3)
        standing = np.tile(np.array([-1.0, 0.0], np.float32), (4, 1))
        _, _, terminated, truncated, info = env.step(standing)
        while not (terminated | truncated).any():
            _, _, terminated, truncated, info = env.step(standing)
        ended = {"terminated": terminated, "truncated": truncated}
        assert ended[ends].any()
        assert not ended["truncated" if ends == "terminated" else "terminated"].any()
        assert (info["reward_terms"][ended[ends], 1] == (-200.0 if ends == "terminated" else 0.0)).all()
