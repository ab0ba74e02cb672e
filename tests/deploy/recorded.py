"""Drives in the simulator, recorded as a robot would see them, and policies to drive with."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from adrl.deploy import MlpPolicy, Odometry, Scan, load_policy
from adrl.deploy.policy import PolicyConfig, resolve_policy
from adrl.envs import NavSim
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.observation.motion import F32
from adrl.types import Policy, RobotConfig, Task
from adrl.worlds import FAMILIES


def a_policy(
    robot: RobotConfig, *, history_steps: int = 0, num_tracks: int = 0, path: bool = False
) -> MlpPolicy:
    """The shipped policy of the diffbot for any robot; what it is told beside, it heeds at random."""
    shipped = load_policy(resolve_policy("diffbot"))
    encoder = EncoderConfig(history_steps=history_steps, num_tracks=num_tracks, path=path)
    layers = list(shipped.layers)
    more = ObservationEncoder(robot, encoder).size - len(layers[0][0])
    if more > 0:
        weight, bias = layers[0]
        heeds = np.random.default_rng(0).normal(0.0, 0.05, (more, weight.shape[1]))
        layers[0] = (np.concatenate([weight, heeds.astype(np.float32)]), bias)
    config = dataclasses.replace(
        shipped.config,
        input_size=len(layers[0][0]),
        robot=dataclasses.asdict(robot),
        encoder=dataclasses.asdict(encoder),
    )
    return MlpPolicy(layers, config)


def a_policy_of_a_family(*, history_steps: int = 0, path: bool = False) -> MlpPolicy:
    """For any robot of family any, at random."""
    encoder = EncoderConfig(history_steps=history_steps, path=path, body=True, reach_m=10.0)
    rng, size = np.random.default_rng(0), ObservationEncoder(RobotConfig(), encoder).size
    layers = [
        (
            rng.normal(0.0, 1.0 / np.sqrt(n), (n, m)).astype(np.float32),
            rng.normal(0.0, 0.1, m).astype(np.float32),
        )
        for n, m in ((size, 64), (64, 64), (64, 2))
    ]
    config = PolicyConfig(
        input_size=size,
        widths=(64, 64),
        family=dataclasses.asdict(FAMILIES["any"]),
        encoder=encoder.fields(),
        extra={"run": "of-a-family"},
    )
    return MlpPolicy(layers, config)


@dataclass(frozen=True)
class Moment:
    """One control period."""

    scan: Scan
    odometry: Odometry
    map_pose: tuple[float, float, float]
    action: F32
    """(2,) what the policy did in the simulator."""


def record(sim: NavSim, policy: Policy, task: Task, steps: int, seed: int = 0) -> list[Moment]:
    """Robot 0 of the simulator on a task, until it ends or for so many steps."""
    sim.reset(np.array([0]), [task], np.array([seed], np.uint64), np.random.default_rng(seed))
    lidar, period_s = sim.robot.lidar, sim.robot.control_period_s
    moments = []
    for k in range(steps):
        action = policy.act(sim.observe())
        scan = as_scan(sim.b["ranges"][0], lidar, k * period_s)
        x, y, yaw = map(float, sim.b["pose"][0])
        moments.append(Moment(scan, as_odometry(sim, 0, k * period_s), (x, y, yaw), action[0].copy()))
        outcome = sim.step(action)
        if outcome.reached[0] or outcome.collided[0]:
            break
    return moments
