"""Observations as they were measured: for policies that bring their own encoder, or want none."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from adrl.observation.component import Senses
from adrl.observation.config import FOLLOWED_STEPS
from adrl.observation.motion import ScanHistory
from adrl.observation.path_ahead import PathAhead
from adrl.observation.tracks import Tracks
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
        m/s and rad/s; last_action (N, 2) in [-1, 1]; history of the scans where history_steps asks for one. An encoder
        with an attribute needs_path that is true is given `path` after these, (N, P, 2) metres in the robot's frame:
        the points of adrl.observation.path_ahead.
        """
        ...


def needs_path(encoder: Encoder) -> bool:
    """Whether an encoder takes points of the path, `path`, after the history: its attribute needs_path, if any."""
    return bool(getattr(encoder, "needs_path", False))


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
    tracks: NDArray[np.floating]
    """(N, 5 T) as adrl.observation.tracks has them; (N, 0) without"""
    path: NDArray[np.floating]
    """(N, 2 P) m, in the robot's frame: the points of adrl.observation.path_ahead; (N, 0) without"""
    past_ranges: NDArray[np.floating]
    """(N, K) m, of past_steps control periods ago; (N, 0) without"""
    pose: NDArray[np.floating]
    """(N, 3) x, y, yaw by odometry at the newest scan; (N, 0) without a past scan"""
    past_pose: NDArray[np.floating]
    """(N, 3) at the past scan; (N, 0) without"""


class Measurements:
    """An Encoder that encodes nothing: ranges, goal, twist and last action side by side, in metres and seconds.

    With past_steps also the scan of then and both poses, in double precision. Tracks, which take a memory to find, are
    told as an ObservationEncoder tells them.
    """

    def __init__(
        self, past_steps: int = 0, tracks: Tracks | None = None, *, needs_path: bool = False
    ) -> None:
        self._past_steps, self._tracks, self.needs_path = past_steps, tracks, needs_path
        self.history_steps = max(past_steps, FOLLOWED_STEPS if tracks is not None else 0)

    def encode(
        self,
        ranges: F32,
        goal: Array,
        twist: Array,
        last_action: F32,
        history: ScanHistory | None = None,
        path: Array | None = None,
    ) -> NDArray[np.floating]:
        """(N, K + 6) float32, tracks and path; (N, 2 K + 12) float64 with a past scan. split() takes it apart. Raises
        ValueError without the history that history_steps asks for, and without a path that is needed."""
        parts = [ranges, goal, twist, last_action]
        if self._tracks is not None:
            told = np.empty((len(ranges), self._tracks.size), np.float32)
            kind = np.zeros(len(ranges), np.intp)
            self._tracks.write(Senses(ranges, goal, twist, last_action, history, kind=kind), told)
            parts.append(told)
        if self.needs_path:
            if path is None:
                raise ValueError("measurements with points of the path need them; give path")
            parts.append(path.reshape(len(path), -1))
        if self._past_steps == 0:
            return np.concatenate(parts, axis=1, dtype=np.float32)
        if history is None:
            raise ValueError("measurements with a past scan need the history of the scans")
        _, pose, past_ranges, past_pose = history.ends(self._past_steps)
        return np.concatenate([*parts, past_ranges, pose, past_pose], axis=1, dtype=np.float64)

    def split(self, observation: NDArray[np.floating]) -> Measured:
        """The columns of (N, D) observations."""
        tracks = self._tracks.size if self._tracks is not None else 0
        scans, poses = (2, 3) if self._past_steps > 0 else (1, 0)
        path = PathAhead.size if self.needs_path else 0
        beams = (observation.shape[1] - 6 - tracks - path - 2 * poses) // scans
        sizes = (beams, 2, 2, 2, tracks, path, beams * (scans - 1), poses, poses)
        return Measured(*np.split(observation, np.cumsum(sizes)[:-1], axis=1))
