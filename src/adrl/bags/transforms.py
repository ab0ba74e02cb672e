"""Frames of a recording: where one is in another, by whatever chain of transforms relates them."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adrl.bags.reader import TRANSFORM_TOPICS, TRANSFORMS, Bag
from adrl.errors import DatasetError
from adrl.types import Array

# SciPy takes a while to import, and adrl.imitation is light.
if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def frame_name(name: str) -> str:
    """Without the slash that older ROS puts before it."""
    return name.strip("/")


class Transforms:
    """Links from frame to frame, as messages told them; between two messages, a frame is between the two poses."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], list[list[float]]] = {}
        """(parent, child) -> when and where the child was in the parent: seconds, x, y, z, and a quaternion."""

    @classmethod
    def of(cls, bag: Bag) -> "Transforms":
        """Those on /tf and /tf_static. Raises DatasetError for a link whose numbers are none."""
        transforms = cls()
        for topic in TRANSFORM_TOPICS:
            for seconds, message in bag.messages(topic, TRANSFORMS, optional=True):
                for link in message.transforms:
                    ends = (frame_name(link.header.frame_id), frame_name(link.child_frame_id))
                    place, turn = link.transform.translation, link.transform.rotation
                    try:
                        transforms.add(
                            *ends, seconds, (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
                        )
                    except ValueError as error:
                        raise DatasetError(
                            f"{bag.path}: {topic}: transform {ends[0]} -> {ends[1]} {error}; mend who sends it"
                        ) from None
        return transforms

    def add(
        self, parent: str, child: str, seconds: float, place: Sequence[float], turn: Sequence[float]
    ) -> None:
        """Where the child is in its parent: x, y, z, and the quaternion x, y, z, w.

        Raises ValueError for numbers that are not finite, and for a quaternion that is no rotation.
        """
        if not np.isfinite([*place, *turn]).all():
            raise ValueError("holds a number that is not finite")
        if not 0.5 < sum(part * part for part in turn) < 2.0:
            raise ValueError(f"has the rotation {tuple(turn)}, which is no unit quaternion")
        self._rows.setdefault((parent, child), []).append([seconds, *place, *turn])

    @property
    def frames(self) -> set[str]:
        """Those that any link names."""
        return {frame for link in self._rows for frame in link}

    def chain(self, target: str, source: str) -> "Chain | None":
        """The shortest way between two frames over any links, in either direction; None where there is none."""
        came_from: dict[str, str] = {target: target}
        waiting = deque([target])
        while waiting and source not in came_from:
            here = waiting.popleft()
            for parent, child in self._rows:
                for near, far in ((parent, child), (child, parent)):
                    if near == here and far not in came_from:
                        came_from[far] = here
                        waiting.append(far)
        if source not in came_from:
            return None
        frames = [source]
        while frames[-1] != target:
            frames.append(came_from[frames[-1]])
        frames.reverse()
        return Chain(frames=tuple(frames), links=tuple(map(self._link, frames[:-1], frames[1:])))

    def _link(self, frame: str, following: str) -> "Link":
        from scipy.spatial.transform import Rotation

        forward = (frame, following) in self._rows
        rows = np.array(self._rows[(frame, following) if forward else (following, frame)])
        times, last = np.unique(rows[::-1, 0], return_index=True)  # of equal times the last that was told
        rows = rows[::-1][last]
        return Link(
            times_s=times, translation=rows[:, 1:4], rotation=Rotation.from_quat(rows[:, 4:]), forward=forward
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Link:
    """A frame in its neighbour, at R times."""

    times_s: Array
    """(R,) ascending."""
    translation: Array
    """(R, 3)."""
    rotation: "Rotation"
    """R of them."""
    forward: bool
    """Whether it is the child in its parent; else what is meant is the parent in the child."""

    def at(self, times_s: Array) -> tuple[Array, "Rotation"]:
        """(T, 3) and T rotations, between the two nearest; before the first and after the last, those."""
        from scipy.spatial.transform import Rotation, Slerp

        translation = np.stack([np.interp(times_s, self.times_s, x) for x in self.translation.T], axis=1)
        if len(self.times_s) == 1:
            rotation = Rotation.identity(len(times_s)) * self.rotation
        else:
            rotation = Slerp(self.times_s, self.rotation)(np.clip(times_s, self.times_s[0], self.times_s[-1]))
        if self.forward:
            return translation, rotation
        back = rotation.inv()
        return -back.apply(translation), back


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain:
    """The last of some frames, in the first one."""

    frames: tuple[str, ...]
    links: tuple[Link, ...]

    def at(self, times_s: Array) -> tuple[Array, "Rotation"]:
        """(T, 3) metres and T rotations."""
        from scipy.spatial.transform import Rotation

        place, turn = np.zeros((len(times_s), 3)), Rotation.identity(len(times_s))
        for link in self.links:
            step, rotation = link.at(times_s)
            place, turn = place + turn.apply(step), turn * rotation
        return place, turn

    @property
    def times_s(self) -> Array:
        """(T,) when any of the links was told."""
        return np.unique(np.concatenate([np.zeros(1), *(link.times_s for link in self.links)]))

    def __str__(self) -> str:
        return " -> ".join(self.frames)
