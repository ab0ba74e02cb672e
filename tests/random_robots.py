"""Robots drawn at random, as different as robots of one batch may be."""

import math

import numpy as np
from hypothesis import strategies as st

from adrl.types import LidarConfig, RobotConfig


@st.composite
def robots(draw: st.DrawFn) -> RobotConfig:
    """Disc or rectangle off its origin; slow or fast; forward only or both ways; any LiDAR; 5 to 20 Hz."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return random_robot(rng)


def random_robot(rng: np.random.Generator) -> RobotConfig:
    """One of them."""
    front, back, half = rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.3)
    corners = ((front, half), (-back, half), (-back, -half), (front, -half))
    disc, radius = bool(rng.integers(2)), rng.uniform(0.1, 0.4)
    speed, circle = rng.uniform(0.2, 2.0), bool(rng.integers(2))
    return RobotConfig(
        name=f"random-{rng.integers(1 << 30)}",
        radius_m=radius if disc else None,
        footprint_m=None if disc else corners,
        max_speed_mps=speed,
        min_speed_mps=-speed * rng.uniform() * rng.integers(2),
        max_yaw_rate_radps=rng.uniform(0.5, 3.0),
        max_acceleration_mps2=rng.uniform(0.5, 4.0),
        lag_s=rng.uniform(0.0, 0.3),
        latency_s=rng.uniform(0.0, 0.2),
        odometry_drift=0.05,
        control_period_s=rng.uniform(0.05, 0.2),
        lidar=LidarConfig(
            num_beams=int(rng.integers(3, 400)),
            fov_rad=math.tau if circle else rng.uniform(1.5, 6.0),
            max_range_m=rng.uniform(3.0, 30.0),
            mount_x_m=rng.uniform(-0.05, 0.05),
            mount_y_m=rng.uniform(-0.05, 0.05),
            mount_yaw_rad=rng.uniform(-0.5, 0.5),
        ),
    )
