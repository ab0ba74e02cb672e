"""Where a LiDAR sits on its robot, by the transforms of a recording."""

from dataclasses import dataclass

import numpy as np

from adrl.bags.odometry import OdometryTable
from adrl.bags.reader import Bag
from adrl.bags.transforms import Chain, Transforms
from adrl.errors import DatasetError
from adrl.geometry import Pose, level_mount

STILL_M, STILL_RAD = 0.02, 0.02
"""A mount that moves by more on the robot is none."""


@dataclass(frozen=True, kw_only=True)
class Mount:
    """A LiDAR on its robot."""

    pose: Pose
    """In the robot's frame."""
    upside_down: bool
    where: str
    """Who says it, for people: /tf, the topic and the chain of frames."""


def read_mount(
    bag: Bag, topic: str, transforms: Transforms, frame: str, odometry: OdometryTable
) -> Mount | None:
    """Where the frame of a topic's scans is on the robot; None where no transforms relate the two.

    Raises DatasetError for a LiDAR that moves on the robot, or is tilted.
    """
    chain = _from_base(transforms, frame, odometry)
    if chain is None:
        return None
    place, turn = chain.at(chain.times_s)
    where = f"/tf says that the LiDAR of {topic} ({chain})"
    if np.ptp(place, axis=0).max() > STILL_M or (turn[0].inv() * turn).magnitude().max() > STILL_RAD:
        raise DatasetError(
            f"{bag.path}: {where} moves on the robot; record one that is fixed, or leave out who moves it"
        )
    try:
        pose, upside_down = level_mount(place[-1], turn[-1].as_matrix())
    except ValueError as error:
        raise DatasetError(f"{bag.path}: {where} {error}: mend the transform, or mount it level") from None
    return Mount(pose=pose, upside_down=upside_down, where=where)


def _from_base(transforms: Transforms, frame: str, odometry: OdometryTable) -> Chain | None:
    """The LiDAR in the robot's frame; where odometry does not name that, it is the first below the odometry's."""
    if odometry.base:
        return transforms.chain(odometry.base, frame)
    chain = transforms.chain(odometry.frame, frame)
    return transforms.chain(chain.frames[1], frame) if chain is not None and len(chain.frames) > 1 else None
