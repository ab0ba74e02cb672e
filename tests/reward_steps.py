"""One step of one robot, as the reward sees it: tests change what matters to them."""

import math
from typing import Any, cast

import numpy as np

from adrl.rewards import REWARD_TERMS, RewardConfig, Step, terms

CONFIG = RewardConfig(safe_clearance_m=0.3)
COLUMN = {name: i for i, name in enumerate(REWARD_TERMS)}


def a_step(**changes: object) -> Step:
    values: dict[str, object] = dict(
        reached=False,
        collided=False,
        speed_mps=0.6,
        yaw_rate_radps=0.0,
        distance_m=4.0,
        previous_distance_m=4.0,
        heading_error_rad=0.0,
        previous_heading_error_rad=0.0,
        clearance_m=1.0,
        mean_displacement_m=0.06,
        timed_out=False,
        displacement_m=0.06,
        turn_rad=0.0,
        coordinate_distance_m=math.inf,
    )
    arrays: Any = {name: np.atleast_1d(cast(Any, v)) for name, v in (values | changes).items()}
    return Step(**arrays, contact_m=0.2, max_speed_mps=0.6, max_yaw_rate_radps=1.5, dt_s=0.1)


def term(name: str, config: RewardConfig = CONFIG, **changes: object) -> float:
    return float(terms(a_step(**changes), config)[0, COLUMN[name]])
