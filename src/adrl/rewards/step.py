"""What a step did: the quantities that reward terms and features are functions of."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import overload

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Mask = NDArray[np.bool_]


@overload
def reference_period_s(max_speed_mps: float) -> float: ...
@overload
def reference_period_s(max_speed_mps: Array) -> Array: ...
def reference_period_s(max_speed_mps: Array | float) -> Array | float:
    """The step the paper's numbers and the discount are for: 0.1 s, or longer for a robot that is slow.

    50 of them, the horizon of gamma = 0.98, are 5 s and at least 3 m of driving: enough to get round an
    obstacle. Robots with other control periods are paid, and discounted, in proportion.
    """
    if isinstance(max_speed_mps, np.ndarray):
        return np.maximum(0.1, 0.06 / max_speed_mps)
    return max(0.1, 0.06 / max_speed_mps)


def step_discounts(gamma: float, periods: Array) -> NDArray[np.float64]:
    """(N,) discounts of steps of so many reference periods each: gamma^periods."""
    return np.array([gamma**number for number in np.asarray(periods, dtype=np.float64).tolist()])


@dataclass(frozen=True, kw_only=True)
class Step:
    """What one control period did to N robots. Arrays are (N,); distances are to the policy's goal.

    Both distances and both heading errors of a step are measured to the same goal point, also when guidance
    moves the point after the step: only then do the differences of eq 10 add up along a path.
    """

    reached: Mask
    """The robot is within the goal tolerance."""
    collided: Mask
    """The footprint touches an obstacle."""
    timed_out: Mask
    """The time is up, and the robot neither arrived nor collided."""
    speed_mps: Array
    """Executed forward speed at the end of the step."""
    yaw_rate_radps: Array
    """Executed yaw rate at the end of the step."""
    distance_m: Array
    previous_distance_m: Array
    heading_error_rad: Array
    """Signed angle from the heading to the goal, in (-pi, pi]."""
    previous_heading_error_rad: Array
    clearance_m: Array
    """From the footprint's edge to the nearest obstacle."""
    mean_displacement_m: Array
    """Mean length of the last five steps."""
    displacement_m: Array
    """Length of this step, from its start to its end in a straight line."""
    turn_rad: Array
    """Signed change of the heading in this step."""
    coordinate_distance_m: Array
    """From the robot's centre to the nearest obstacle's middle; infinite where eq 8 does not ask for it."""
    contact_m: Array | float
    """d_r of eq 8: radius of the robot's disc. This and what follows may differ from robot to robot."""
    max_speed_mps: Array | float
    max_yaw_rate_radps: Array | float
    dt_s: Array | float
    quantities: Mapping[str, Array] = field(default_factory=dict)
    """What extra terms asked for, by name; (N,) each. See RewardTerm."""

    @property
    def periods(self) -> Array | float:
        """Length of the step in reference periods: what is paid for time is paid in proportion."""
        return self.dt_s / reference_period_s(self.max_speed_mps)

    @property
    def max_step_m(self) -> Array | float:
        """v_max dt, the longest step the robot can make."""
        return self.max_speed_mps * self.dt_s
