"""The tracker is its slow twin, whatever the LiDAR, the time between scans and the robot's own motion."""

import dataclasses
import math

import numpy as np
import pytest

from adrl.deploy.lidar import beam_angles
from adrl.deploy.messages import Scan
from adrl.deploy.tracks import Tracks
from adrl.evaluation.supervised import as_scan
from adrl.geometry import compose, in_world_frame
from adrl.types import LidarConfig
from adrl.worlds import ROBOTS, get_scenario, task_set
from adrl.worlds.people import among_people
from deploy.test_among_people import among
from deploy.tracks_twin import SlowTracks

DIFFBOT = ROBOTS["diffbot"]
LIDARS = {
    "all round": DIFFBOT.lidar,
    "a fan, turned": LidarConfig(num_beams=91, fov_rad=4.0, mount_x_m=0.1, mount_yaw_rad=2.5),
}


@pytest.mark.parametrize("legs", [False, True])
@pytest.mark.parametrize("lidar", LIDARS.values(), ids=LIDARS)
def test_the_kernel_is_its_slow_twin(lidar: LidarConfig, legs: bool) -> None:
    robot = dataclasses.replace(DIFFBOT, lidar=lidar)
    tasks = task_set(among_people(get_scenario("crowd"), 12, None, legs=legs), robot, "train", 3)
    sim, rng = among(tasks, robot), np.random.default_rng(0)
    slow, fast = [SlowTracks() for _ in tasks], [Tracks() for _ in tasks]
    moving = 0
    now_s = 0.0
    for k in range(40):
        now_s = (
            0.0 if k == 30 else now_s + float(rng.choice([0.1, 0.1, 0.13, 0.3]))
        )  # the clock goes back once
        for i in range(len(tasks)):
            scan, sensor = (
                as_scan(sim.b["ranges"][i], lidar, now_s),
                compose(sim.b["odometry"][i], lidar.mount),
            )
            if k % 5 == 1:
                scan = _damaged(scan, rng)
            hit = (scan.ranges > 0.0) & (scan.ranges < lidar.max_range_m)
            angles, away = beam_angles(scan)[hit], scan.ranges[hit]
            local = np.column_stack([away * np.cos(angles), away * np.sin(angles)])
            points = in_world_frame(np.array(sensor), local)
            velocities, breadths = fast[i].take(scan, sensor, hit, points)
            expected_velocities, expected_breadths = slow[i].take(scan, sensor, hit, points)
            np.testing.assert_allclose(velocities, expected_velocities, atol=1e-9)
            np.testing.assert_allclose(breadths, expected_breadths, atol=1e-9)
            moving += int(np.isfinite(breadths).sum())
        sim.b["command"][:] = rng.uniform([0.0, -1.5], [0.6, 1.5], (len(tasks), 2))
        sim.native.step()
    assert moving > 500


def _damaged(scan: Scan, rng: np.random.Generator) -> Scan:
    """With beams that tell nothing."""
    return dataclasses.replace(
        scan, ranges=np.where(rng.random(len(scan.ranges)) < 0.1, math.nan, scan.ranges)
    )
