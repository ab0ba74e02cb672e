"""Laws of the corrected reward: what is worth more than what, for every maturity and robot."""

from functools import cache

import numpy as np
import pytest

from adrl.rewards import RewardConfig, features, reward, terms, weights
from adrl.rewards.step import reference_period_s
from reward_driving import FOR_EVER, ROBOTS, Driver, behaviours

CONFIG = RewardConfig()
CONFIGS = {"dense": CONFIG, "terminal": RewardConfig(extra_terms=("no-approach",))}
MARGINS = {"dense": 0.05, "terminal": 0.02}
"""By which arriving beats all but arriving; less where the way to it pays nothing."""
GAMMA = 0.98  # a reference period
MATURITIES = (0.0, 0.5, 1.0)
GAPS_M = (0.02, 0.1, 0.5)


def value(driver: Driver, maturity: float, config: RewardConfig) -> float:
    """Discounted value of what the driver did, each step weighed by the features of the state it left."""
    before, step = driver.steps()
    rewards = reward(terms(step, config), features(before, config), maturity, config)
    gamma = GAMMA ** (driver.dt_s / reference_period_s(driver.max_speed_mps))
    return float((gamma ** np.arange(len(rewards)) * rewards).sum())


@cache
def values(robot: str, gap_m: float, kind: str) -> dict[tuple[str, float], float]:
    drivers = dict(behaviours(robot, gap_m))
    assert drivers["reach"].rows[-1]["reached"]
    assert drivers["crash"].rows[-1]["collided"]
    for name in drivers.keys() - {"reach", "crash"}:
        assert len(drivers[name].rows) >= FOR_EVER, f"{name} was meant to go on for ever"
    return {
        (name, s): value(driver, s, CONFIGS[kind]) for name, driver in drivers.items() for s in MATURITIES
    }


@pytest.mark.parametrize("maturity", MATURITIES)
@pytest.mark.parametrize("gap_m", GAPS_M)
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("kind", CONFIGS)
def test_reaching_beats_idling_beats_crashing(kind: str, robot: str, gap_m: float, maturity: float):
    table = {name: v for (name, s), v in values(robot, gap_m, kind).items() if s == maturity}
    reach, crash = table.pop("reach"), table.pop("crash")
    best, worst = max(table.values()), min(table.values())
    assert reach > best + MARGINS[kind], table
    # A margin: a critic must see the difference. 0.3 is a fifteenth of a crash.
    assert worst > crash + 0.3, table


@pytest.mark.parametrize("maturity", MATURITIES)
def test_no_loop_pays(maturity: float):
    """Shaping <= price * progress in every state, so it sums to nothing above zero over any closed path.

    The price may depend on the distance to the goal alone: a function of the distance is again a potential.
    """
    progress, t_obs, t_goal, t_stop = np.meshgrid(
        np.linspace(-1, 1, 21),
        np.linspace(0, 1, 41),
        np.linspace(0, 1, 11),
        np.linspace(0, 1, 21),
        indexing="ij",
    )
    w = weights(np.stack([t_obs, t_goal, t_stop], axis=-1), maturity, CONFIG)
    open_space = np.stack([0 * t_goal, t_goal, 0 * t_goal], axis=-1)
    price = weights(open_space, maturity, CONFIG)[..., 3]
    shaping = w[..., 3] * progress - 5.0 * t_obs * w[..., 4] - 3.0 * (t_stop > 0) * w[..., 5]
    assert (shaping <= price * progress + 1e-9).all()


@pytest.mark.parametrize("maturity", MATURITIES)
def test_standing_at_its_worst_costs_less_than_a_crash(maturity: float):
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 21)] * 3), axis=-1)
    standing = np.zeros((*grid.shape[:-1], 6))
    standing[..., 2], standing[..., 4], standing[..., 5] = -1.0, -5.0 * grid[..., 0], -3.0
    for_ever = reward(standing, grid, maturity, CONFIG) / (1.0 - GAMMA)
    crash = -CONFIG.scale * CONFIG.failure_weight * CONFIG.failure_penalty
    assert for_ever.min() > crash + 0.3
