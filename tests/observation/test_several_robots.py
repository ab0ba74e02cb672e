"""One encoder of several robots tells each row what its own robot's encoder tells it, to the byte."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl import _core
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig, Mirror, ObservationEncoder, Senses, to_action, to_twist
from adrl.observation.motion import ScanHistory
from adrl.types import RobotConfig, RobotRows
from adrl.worlds import ROBOTS
from random_robots import robots

STEPS = 2


class Reach:
    """A component from outside, which knows one robot: how far its beams see, of its reach."""

    name: ClassVar = "reach"
    size, limit = 1, 1.0

    def __init__(self, robot: RobotConfig, config: EncoderConfig) -> None:
        self._lidar = robot.lidar

    def write(self, senses: Senses, out: np.ndarray) -> None:
        assert senses.ranges.shape[1] == self._lidar.num_beams
        assert senses.history is not None
        oldest = senses.history.ends()[2]
        out[:, 0] = (senses.ranges + oldest).mean(axis=1) / (2.0 * self._lidar.max_range_m)

    def mirror(self) -> Mirror | None:
        return Mirror(np.arange(1), np.ones(1, np.float32))


CONFIG = EncoderConfig(history_steps=STEPS, extra_components=(Reach,))


def sensed(rng: np.random.Generator, kinds: list[RobotConfig], kind: np.ndarray) -> list[tuple[Any, ...]]:
    """What a row a kind[i] senses, each as wide as its own robot's beams."""
    rows = []
    for robot in (kinds[k] for k in kind):
        scans = rng.uniform(0.0, 1.2, (STEPS + 1, 1, robot.lidar.num_beams)) * robot.lidar.max_range_m
        scans = np.minimum(scans, robot.lidar.max_range_m).astype(np.float32)
        poses = np.cumsum(rng.normal(0.0, 0.1, (STEPS + 1, 1, 3)), axis=0)
        told = rng.normal(size=(1, 2)), rng.normal(size=(1, 2)), rng.uniform(-1, 1, (1, 2)).astype(np.float32)
        rows.append((scans, poses, *told))
    return rows


def remembered(scans: np.ndarray, poses: np.ndarray) -> ScanHistory:
    history = ScanHistory(scans.shape[1], scans.shape[2], STEPS)
    history.begin(np.arange(scans.shape[1]), scans[0], poses[0])
    for ranges, pose in zip(scans[1:], poses[1:], strict=True):
        history.add(ranges, pose)
    return history


@settings(max_examples=40)
@given(st.lists(robots(), min_size=1, max_size=4), st.integers(0, 2**32 - 1))
def test_a_row_reads_what_it_reads_alone(kinds: list[RobotConfig], seed: int) -> None:
    rng = np.random.default_rng(seed)
    kind = rng.integers(len(kinds), size=7)
    rows = sensed(rng, kinds, kind)
    alone = [
        ObservationEncoder(kinds[k], CONFIG).encode(scans[-1], *told, history=remembered(scans, poses))
        for k, (scans, poses, *told) in zip(kind, rows, strict=True)
    ]
    widest = max(robot.lidar.num_beams for robot in kinds)
    scans = [
        np.pad(
            scan, ((0, 0), (0, 0), (0, widest - scan.shape[2])), constant_values=kinds[k].lidar.max_range_m
        )
        for k, (scan, *_) in zip(kind, rows, strict=True)
    ]
    history = remembered(np.concatenate(scans, axis=1), np.concatenate([row[1] for row in rows], axis=1))
    told = [np.concatenate(column) for column in list(zip(*rows, strict=True))[2:]]
    newest = np.concatenate([scan[-1] for scan in scans])
    together = ObservationEncoder(kinds, CONFIG).encode(newest, *told, history=history, kind=kind)
    assert together.tobytes() == np.concatenate(alone).tobytes()
    assert np.abs(together[:, : CONFIG.num_sectors]).max() <= 1.0


@given(st.lists(robots(), min_size=1, max_size=4), st.integers(0, 2**32 - 1))
def test_actions_of_several_robots_are_those_of_each(kinds: list[RobotConfig], seed: int) -> None:
    rng = np.random.default_rng(seed)
    kind = rng.integers(len(kinds), size=6)
    rows = RobotRows.of(kinds)[kind]
    action = rng.uniform(-1.5, 1.5, (6, 2)).astype(np.float32)
    twist = to_twist(action, rows)
    for i, k in enumerate(kind):
        np.testing.assert_array_equal(twist[i : i + 1], to_twist(action[i : i + 1], kinds[k]))
        np.testing.assert_array_equal(
            to_action(twist, rows)[i : i + 1], to_action(twist[i : i + 1], kinds[k])
        )


def nearest_by_hand(robot: RobotConfig, ranges: np.ndarray, sectors: int) -> list[float]:
    """Sector by sector, beam by beam."""
    lidar, out = robot.lidar, []
    for s in range(sectors):
        middle = -np.pi + (s + 0.5) * 2.0 * np.pi / sectors
        away = (lidar.angles_rad + lidar.mount_yaw_rad - middle + np.pi) % (2.0 * np.pi) - np.pi
        inside = ranges[np.abs(away) <= np.pi / sectors + 1e-9]
        out.append(inside.min() if len(inside) else lidar.max_range_m)
    return out


@given(robots(), st.integers(4, 64), st.integers(0, 2**32 - 1))
def test_a_sector_holds_the_nearest_of_its_beams(robot: RobotConfig, sectors: int, seed: int) -> None:
    encoder = ObservationEncoder(robot, EncoderConfig(num_sectors=sectors))
    ranges = np.random.default_rng(seed).uniform(0.0, robot.lidar.max_range_m, (1, robot.lidar.num_beams))
    ranges = ranges.astype(np.float32)
    native = _core.Sectors([beams.native for beams in encoder.scan.beams])
    out = np.empty((1, sectors), np.float32)
    native.nearest(np.zeros(1, np.intp), ranges, out)
    np.testing.assert_array_equal(out[0], np.array(nearest_by_hand(robot, ranges[0], sectors), np.float32))
    padded = np.pad(ranges, ((0, 0), (0, 1)), constant_values=robot.lidar.max_range_m)
    np.testing.assert_array_equal(padded[:, encoder.beams_of_sectors].min(axis=2), out)


def test_there_is_a_mirror_where_every_robot_is_symmetric() -> None:
    diffbot, jackal = ROBOTS["diffbot"], ROBOTS["jackal"]
    turned = dataclasses.replace(diffbot, lidar=dataclasses.replace(diffbot.lidar, mount_yaw_rad=0.1))
    mirror, alone = (ObservationEncoder(robot).mirror for robot in ([diffbot, jackal], diffbot))
    assert mirror is not None
    assert alone is not None
    np.testing.assert_array_equal(mirror.order, alone.order)
    assert ObservationEncoder([diffbot, turned]).mirror is None
    assert ObservationEncoder([diffbot, jackal], CONFIG).mirror is not None


def test_several_robots_need_to_be_told_apart() -> None:
    encoder = ObservationEncoder([ROBOTS["diffbot"], ROBOTS["jackal"]])
    assert encoder.limit >= max(ObservationEncoder(robot).limit for robot in encoder.robots)
    beams = max(robot.lidar.num_beams for robot in encoder.robots)
    told = np.ones((1, beams), np.float32), np.ones((1, 2)), np.zeros((1, 2)), np.zeros((1, 2), np.float32)
    with pytest.raises(ValueError, match="which of them"):
        encoder.encode(*told)
    with pytest.raises(ValueError, match="row 0 is of kind 2"):
        encoder.encode(*told, kind=np.array([2]))
    with pytest.raises(ValueError, match="column for every beam"):
        encoder.encode(told[0][:, :10], *told[1:], kind=np.array([0]))


def test_a_component_is_as_long_for_every_robot() -> None:
    class Beams(Reach):
        def __init__(self, robot: RobotConfig, config: EncoderConfig) -> None:
            self.size = robot.lidar.num_beams

    fewer = dataclasses.replace(
        ROBOTS["diffbot"], lidar=dataclasses.replace(ROBOTS["diffbot"].lidar, num_beams=8)
    )
    with pytest.raises(ConfigError, match="'reach' has 8 to 180 numbers"):
        ObservationEncoder([ROBOTS["diffbot"], fewer], EncoderConfig(extra_components=(Beams,)))
