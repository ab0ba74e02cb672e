"""Robots moved and sensed by Gazebo instead of our simulator: a Body that NavSim takes."""

import math
import struct
import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError, WorldError
from adrl.integrations.gazebo.film import camera
from adrl.integrations.gazebo.model import controller, robot_model
from adrl.integrations.gazebo.published import Published
from adrl.integrations.gazebo.server import GazeboServer, plugin_file
from adrl.types import Array, RobotConfig, Task, World
from adrl.worlds.sdf_write import (
    Parts,
    add,
    document,
    model,
    models,
    parts,
    prism_shapes,
    to_bytes,
    unit_shapes,
)

PHYSICS_STEP_S = 0.004
SOLVER_ITERATIONS = 20
SPACING_M = 200.0
"""Between the worlds of two robots: no LiDAR of ours reaches that far."""
WARM_UP_PERIODS = 1000
"""Control periods after which a camera is given up."""
NUMBERS = 11
"""Doubles of a robot's state, see plugin/lockstep.cpp."""


class Gazebo:
    """One gzserver for robots of one kind, each in a world of its own, driven in lock-step.

    Give it to NavSim, rollout() or NavVectorEnv as their body. Use as a context, or close().
    """

    def __init__(
        self,
        robot: RobotConfig,
        num_envs: int = 1,
        *,
        physics_step_s: float = PHYSICS_STEP_S,
        seed: int = 0,
        film: World | None = None,
        published: Published | None = None,
    ) -> None:
        """num_envs: robots side by side. physics_step_s: about that, as the control period is a multiple of it.
        film: the only world of the only robot, filmed from above, which is slow; see frames(). published: a file
        that is the only world of the only robot, with the file's physics.

        Raises MissingExtra where Gazebo is not set up; ConfigError; WorldError when it does not start.
        """
        only = film if published is None else published.world
        if num_envs < 1 or (only is not None and num_envs != 1):
            raise ConfigError(
                f"num_envs is {num_envs}; give 1 or more, and 1 for a film or a published world"
            )
        if published is not None:
            physics_step_s = published.step_s
        if not 0.0 < physics_step_s <= robot.control_period_s:
            raise ConfigError(
                f"physics_step_s is {physics_step_s}; give at most the control period, {robot.control_period_s} s"
            )
        self.robot = robot
        self.num_envs = num_envs
        steps = max(1, round(robot.control_period_s / physics_step_s))
        if published is not None:
            plugin = _plugin(1, steps, _reach_m(robot), published.base.controller(robot))
            root = published.with_robot(robot, plugin)
        else:
            content = [_physics(robot.control_period_s / steps)]
            content += [robot_model(robot, f"robot_{i}", (i * SPACING_M, 0.0, 0.0)) for i in range(num_envs)]
            content.append(_plugin(num_envs, steps, _reach_m(robot), controller(robot)))
            if film is not None:
                # What is to be seen has to stand from the beginning.
                content += [*models(film, "_0"), camera(film)]
            root = document(content, ground=True)
        self._server = GazeboServer(root, seed=seed, rendered=film is not None)
        self._offset = np.arange(num_envs) * SPACING_M
        row = np.dtype([("numbers", "<f8", NUMBERS), ("ranges", "<f4", robot.lidar.num_beams)])
        self._reply = np.zeros(num_envs, dtype=row)
        self._commands = np.zeros((num_envs, 2), "<f8")
        self._active = np.zeros(num_envs, np.uint8)
        self._stock = np.zeros((num_envs, 3), dtype=np.int64)
        """Boxes, cylinders and discs that each slot has."""
        self._standing: list[World | None] = [only] * num_envs
        self._only = only
        self._warm_frames = 0
        if film is not None:
            self._stock[0, 2] = len(film.discs)
            try:
                self._arrange(0, Parts(np.empty((0, 5)), np.empty((0, 3)), []), film.discs)
                self._warm_camera()
            except BaseException:
                self.close()
                raise

    def __enter__(self) -> "Gazebo":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __getstate__(self) -> dict[str, Any]:
        raise ConfigError("robots in Gazebo cannot be copied; make a new environment")

    def close(self) -> None:
        """End Gazebo."""
        self._server.close()

    def frames(self) -> list[bytes]:
        """JPEG pictures of the film since the start, one each 1 / FRAMES_HZ s of simulated time."""
        return self._server.frames()[self._warm_frames :]

    def _warm_camera(self) -> None:
        """Let time pass until the camera works: Gazebo waits for it from its first picture on."""
        for _ in range(WARM_UP_PERIODS):
            self._warm_frames = len(self._server.frames())
            if self._warm_frames > 1:
                return
            time.sleep(0.02)
            self._exchange(b"S" + self._commands.tobytes() + self._active.tobytes())
        raise WorldError("Gazebo's camera takes no pictures; is the package libgl1-mesa-dri installed?")

    @property
    def process_id(self) -> int:
        """Of gzserver."""
        return self._server.process_id

    def reset(self, indices: NDArray[np.intp], tasks: Sequence[Task], b: Mapping[str, NDArray[Any]]) -> None:
        """Put the robots `indices` at the starts of their tasks, in the tasks' worlds, and sense into b.

        b: NavSim's arrays, of which seed is read, pose, odometry, twist and ranges are written. Gazebo has
        one source of noise for all robots: with more than one, a reset of one changes what the others will draw.
        """
        for i, task in zip(indices, tasks, strict=True):
            if len(task.people):
                raise ConfigError("nobody walks in Gazebo: leave --people out, or take our simulator")
            if self._standing[i] is not task.world:
                self._furnish(int(i), task.world)
                self._standing[i] = task.world
            x, y, yaw = task.start
            seed = int(b["seed"][i]) & 0xFFFFFFFF
            self._exchange(struct.pack("<cIIddd", b"R", i, seed, x + self._offset[i], y, yaw))
        self._take(indices, b)

    def step(self, b: Mapping[str, NDArray[Any]]) -> None:
        """Drive all active robots with b["command"] for a control period, and write what came of it into b."""
        n = len(b["active"])
        self._commands[:n], self._active[:n] = b["command"], b["active"]
        self._active[n:] = 0
        self._exchange(b"S" + self._commands.tobytes() + self._active.tobytes())
        rows = np.flatnonzero(b["active"])
        self._take(rows, b)
        numbers = self._reply["numbers"][rows]
        b["travelled"][rows] += numbers[:, 8]
        b["time"][rows] += numbers[:, 9]
        b["collided"][rows] = numbers[:, 10] > 0.0

    def _furnish(self, slot: int, world: World) -> None:
        """Let the world stand around a robot.

        Boxes and cylinders of the last world are given other sizes and places: Gazebo never quite forgets a model, and
        each reset would take longer than the last.
        """
        if self._only is not None:
            raise ConfigError("this Gazebo has one world; start another for tasks in another one")
        self._arrange(slot, parts(world), world.discs + self._offset[slot] * _DISC_X)

    def _arrange(self, slot: int, standing: Parts, discs: Array) -> None:
        need = np.array([len(standing.boxes), len(standing.cylinders), len(discs)])
        lack = np.maximum(need - self._stock[slot], 0)
        text = self._new_models(slot, lack, standing.prisms)
        self._stock[slot] += lack
        boxes = standing.boxes + self._offset[slot] * np.array([1.0, 0.0, 0.0, 0.0, 0.0])
        cylinders = standing.cylinders + self._offset[slot] * np.array([1.0, 0.0, 0.0])
        message = struct.pack("<cI4I", b"F", slot, *need, len(text))
        for table in (boxes, cylinders, discs):
            message += table.astype("<f8").tobytes()
        self._exchange(message + text)

    def _new_models(self, slot: int, lack: NDArray[np.int64], prisms: list[Array]) -> bytes:
        """SDF of boxes, cylinders and discs that a slot lacks, and of the prisms of this world; empty for none."""
        boxes, cylinders, discs = (int(number) for number in lack)
        had = self._stock[slot]
        new: list[Element] = []
        if boxes or cylinders:
            new.append(model(f"stock_{slot}_{had.sum()}", unit_shapes(boxes, cylinders), visible=False))
        for j in range(int(had[2]), int(had[2]) + discs):
            new.append(model(f"disc_{slot}_{j}", unit_shapes(0, 1), visible=False))
        if prisms:
            place = (float(self._offset[slot]), 0.0)
            new.append(model(f"prisms_{slot}", prism_shapes(prisms), place, visible=False))
        return to_bytes(document(new, ground=False)) if new else b""

    def _exchange(self, message: bytes) -> None:
        self._server.exchange(message, self._reply.view(np.uint8).data)

    def _take(self, rows: NDArray[np.intp], b: Mapping[str, NDArray[Any]]) -> None:
        """Copy the state of these robots."""
        numbers = self._reply["numbers"][rows]
        b["pose"][rows] = numbers[:, 0:3]
        b["odometry"][rows] = numbers[:, 3:6]
        b["pose"][rows, 0] -= self._offset[rows]
        b["odometry"][rows, 0] -= self._offset[rows]
        b["twist"][rows] = numbers[:, 6:8]
        # Gazebo says infinite where nothing is hit, and minus infinite below the least range.
        b["ranges"][rows] = np.clip(self._reply["ranges"][rows], 0.0, self.robot.lidar.max_range_m)


_DISC_X = np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def _physics(step_s: float) -> Element:
    physics = Element("physics", name="ode", type="ode")
    add(physics, "max_step_size", step_s)
    add(physics, "real_time_update_rate", 0.0)
    solver = SubElement(SubElement(physics, "ode"), "solver")
    add(solver, "type", "quick")
    SubElement(solver, "iters").text = str(SOLVER_ITERATIONS)
    return physics


def _reach_m(robot: RobotConfig) -> float:
    """Range of a beam below which the robot may touch what it sees within a control period; standing discs only."""
    lidar = robot.lidar
    if lidar.fov_rad < 2.0 * math.pi - 1e-9:
        return 1e9  # something may be where it does not look
    # Noise in the range, and what stands between two beams.
    slack = 5.0 * lidar.noise_std_m + 0.05
    mount = math.hypot(lidar.mount_x_m, lidar.mount_y_m)
    driven = robot.fastest_mps * robot.control_period_s
    return robot.circumscribed_radius_m + mount + driven + slack


def _plugin(robots: int, steps: int, reach_m: float, controller: Mapping[str, Sequence[float]]) -> Element:
    plugin = Element("plugin", name="adrl_lockstep", filename=plugin_file())
    for tag, number in (("port", 0), ("robots", robots), ("steps", steps)):
        SubElement(plugin, tag).text = str(number)
    add(plugin, "reach", reach_m)
    for tag, numbers in controller.items():
        add(plugin, tag, *numbers)
    return plugin
