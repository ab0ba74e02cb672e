"""Observations as they were measured: for policies that bring their own encoder, or want none."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from adrl.observation.motion import ScanHistory
from adrl.types import Array

F32 = NDArray[np.float32]


@runtime_checkable
class Encoder(Protocol):
    """Makes the observations of a policy of one's own: its attribute `encoder`."""

    @property
    def history_steps(self) -> int:
        """Control periods between the newest scan of the history and the oldest; 0 for no history."""
        ...

    def encode(
        self, ranges: F32, goal: Array, twist: Array, last_action: F32, history: ScanHistory | None = None
    ) -> NDArray[np.floating]:
        """(N, D) observations of N robots.

        ranges (N, K) metres; goal (N, 2) metres, in the robot's frame: the point that the guidance gives; twist (N, 2)
        m/s and rad/s; last_action (N, 2) in [-1, 1]; history of the scans where history_steps asks for one.
        """
        ...


class Measured(NamedTuple):
    """The columns of Measurements, a row a robot."""

    ranges: NDArray[np.floating]
    """(N, K) m"""
    goal: NDArray[np.floating]
    """(N, 2) m, in the robot's frame"""
    twist: NDArray[np.floating]
    """(N, 2) m/s and rad/s"""
    last_action: NDArray[np.floating]
    """(N, 2) in [-1, 1]"""
    past_ranges: NDArray[np.floating]
    """(N, K) m, of history_steps control periods ago; (N, 0) without a history"""
    pose: NDArray[np.floating]
    """(N, 3) x, y, yaw by odometry at the newest scan; (N, 0) without a history"""
    past_pose: NDArray[np.floating]
    """(N, 3) at the past scan; (N, 0) without a history"""


class Measurements:
    """An Encoder that encodes nothing: ranges, goal, twist and last action side by side, in metres and seconds.

    With a history also the past scan and both poses, in double precision.
    """

    def __init__(self, history_steps: int = 0) -> None:
        self.history_steps = history_steps

    def encode(
        self, ranges: F32, goal: Array, twist: Array, last_action: F32, history: ScanHistory | None = None
    ) -> NDArray[np.floating]:
        """(N, K + 6) float32; (N, 2 K + 12) float64 with a history. split() takes it apart."""
        parts = [ranges, goal, twist, last_action]
        if history is None:
            return np.concatenate(parts, axis=1, dtype=np.float32)
        _, pose, past_ranges, past_pose = history.ends()
        return np.concatenate([*parts, past_ranges, pose, past_pose], axis=1, dtype=np.float64)

    def split(self, observation: NDArray[np.floating]) -> Measured:
        """The columns of (N, D) observations."""
        width = observation.shape[1]
        scans, poses = (2, 3) if self.history_steps > 0 else (1, 0)
        beams = (width - 6 - 2 * poses) // scans
        sizes = (beams, 2, 2, 2, beams * (scans - 1), poses, poses)
        return Measured(*np.split(observation, np.cumsum(sizes)[:-1], axis=1))
