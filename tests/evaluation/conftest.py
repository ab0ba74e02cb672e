"""Episodes drawn at random."""

from collections.abc import Callable

import numpy as np
import pytest

from adrl.evaluation.metrics import Episodes

MakeEpisodes = Callable[..., Episodes]


@pytest.fixture(scope="session")
def make_episodes() -> MakeEpisodes:
    """make(count, seed, success_probability) -> Episodes of tasks 0 to count - 1."""

    def make(count: int, *, seed: int = 0, success_probability: float = 0.7) -> Episodes:
        rng = np.random.default_rng(seed)
        success = rng.random(count) < success_probability
        collision = ~success & (rng.random(count) < 0.5)
        shortest_m = rng.uniform(5.0, 11.0, count)
        distance_m = shortest_m * rng.uniform(0.97, 1.4, count)
        time_s = distance_m / rng.uniform(0.2, 0.6, count)
        return Episodes(
            task=np.arange(count, dtype=np.int32),
            success=success,
            collision=collision,
            timeout=~success & ~collision,
            distance_m=distance_m,
            time_s=time_s,
            shortest_m=shortest_m,
            least_clearance_m=np.where(collision, -0.01, rng.uniform(0.0, 0.5, count)),
            mean_speed_mps=distance_m / time_s,
            smoothness=rng.uniform(0.0, 2.0, count),
            start_xy_m=rng.uniform(0.0, 10.0, (count, 2)),
            goal_xy_m=rng.uniform(0.0, 10.0, (count, 2)),
            final_pose=rng.uniform(-3.0, 3.0, (count, 3)),
        )

    return make
