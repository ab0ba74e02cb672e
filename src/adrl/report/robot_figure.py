"""A robot from above: footprint, LiDAR, what it sees, and how far it goes before it stands."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Polygon, Wedge

from adrl.report.figures import INK, PALETTE, SOLID, blank_figure
from adrl.types import RobotConfig

SEEN, BLIND, STOPPED, CURVE = PALETTE[4], PALETTE[1], PALETTE[2], PALETTE[3]
VIEW = 3.0
"""Times the radius about the origin that the picture shows, at least."""
MOST_RAYS = 72


@dataclass(frozen=True, kw_only=True)
class Derived:
    """What follows from a robot's numbers."""

    gap_m: float
    """Width of the narrowest gap that it passes straight ahead."""
    turning_width_m: float
    """Diameter of what it sweeps when it turns on the spot; a car on its tightest curve."""
    blind_rad: float
    """Angle about the LiDAR that no beam looks into."""


def derived(robot: RobotConfig) -> Derived:
    """What follows from its footprint and its view."""
    corners = robot.polygon
    width = 2.0 * robot.circumscribed_radius_m if robot.radius_m is not None else float(np.ptp(corners[:, 1]))
    return Derived(
        gap_m=width,
        turning_width_m=2.0 * _outer_radius_m(robot),
        blind_rad=max(0.0, 2.0 * math.pi - robot.lidar.fov_rad),
    )


def _outer_radius_m(robot: RobotConfig) -> float:
    """Of what the footprint covers on its tightest curve, about that curve's middle."""
    if robot.radius_m is not None:
        return robot.min_turning_radius_m + robot.radius_m
    return float(
        np.hypot(robot.polygon[:, 0], np.abs(robot.polygon[:, 1]) + robot.min_turning_radius_m).max()
    )


def robot_figure(robot: RobotConfig) -> Figure:
    """One picture, in metres, x ahead to the right."""
    lidar, numbers = robot.lidar, derived(robot)
    figure = blank_figure(6.4, 6.0)
    axes = figure.subplots()
    reach = max(VIEW * robot.circumscribed_radius_m, 1.2 * robot.stop_distance_m)
    reach = max(reach, 1.2 * math.hypot(lidar.mount_x_m, lidar.mount_y_m), 1.2 * robot.min_turning_radius_m)
    _panel(axes, robot, reach)
    axes.set(xlabel="x, m", ylabel="y, m")
    axes.set_title(robot.name, loc="left")
    labels = {
        "footprint, + its origin": Patch(facecolor=SOLID, edgecolor=INK),
        f"LiDAR, {lidar.num_beams} beams to {lidar.max_range_m:g} m": Patch(facecolor=SEEN, alpha=0.3),
        f"stopped from {robot.max_speed_mps:g} m/s": Patch(fill=False, edgecolor=STOPPED, linestyle="--"),
    }
    if robot.is_car:
        label = f"tightest curve, {robot.min_turning_radius_m:g} m"
        labels[label] = Patch(fill=False, edgecolor=CURVE)
    if numbers.blind_rad > lidar.angle_increment_rad:
        labels[f"blind, {math.degrees(numbers.blind_rad):.0f} degrees"] = _blind_patch()
    figure.legend(
        list(labels.values()), list(labels), loc="outside lower center", ncols=2, frameon=False, fontsize=9
    )
    return figure


def family_figure(robots: Sequence[RobotConfig]) -> Figure:
    """Several robots in one picture, all in the same scale."""
    columns = min(4, len(robots))
    rows = -(-len(robots) // columns)
    figure = blank_figure(3.0 * columns, 3.1 * rows)
    panels = np.ravel(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False))
    reach = 1.1 * max(robot.circumscribed_radius_m + robot.stop_distance_m for robot in robots)
    for axes, robot in zip(panels, robots, strict=False):
        _panel(axes, robot, reach)
        axes.set_title(f"{robot.name}\n{robot.max_speed_mps:.2g} m/s", loc="left", fontsize=9)
    for axes in panels[len(robots) :]:
        axes.set_axis_off()
    figure.supxlabel("x, m; dashed: where it stands after a stop from full speed", fontsize=9)
    figure.supylabel("y, m", fontsize=9)
    return figure


def _panel(axes: Axes, robot: RobotConfig, reach: float) -> None:
    """The robot with what lies within `reach` of its origin."""
    _view(axes, robot, min(robot.lidar.max_range_m, 3.0 * reach))
    _body(axes, robot, 0.0, facecolor=SOLID, edgecolor=INK, linewidth=1.4, zorder=4)
    stopped = {"fill": False, "edgecolor": STOPPED, "linestyle": "--", "linewidth": 1.2, "zorder": 3}
    _body(axes, robot, robot.stop_distance_m, **stopped)
    if robot.is_car:
        _curves(axes, robot)
    size = 0.4 * robot.circumscribed_radius_m
    head = {"head_width": 0.25 * size, "length_includes_head": True, "zorder": 6, "color": INK}
    axes.arrow(0.0, 0.0, size, 0.0, **head)
    axes.plot(0.0, 0.0, "+", color=INK, markersize=10, zorder=6)
    x, y, yaw = robot.lidar.mount
    axes.plot(x, y, "o", color=PALETTE[0], markeredgecolor="white", markersize=8, zorder=7)
    ahead = (0.8 * size * math.cos(yaw), 0.8 * size * math.sin(yaw))
    axes.arrow(x, y, *ahead, **head | {"color": PALETTE[0], "zorder": 7})
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.grid(color="#E4E6EA", linewidth=0.6, zorder=0)


def _curves(axes: Axes, robot: RobotConfig) -> None:
    """A quarter of the tightest curve to each side, forward, and backward where it can."""
    radius = robot.min_turning_radius_m
    for side in (1.0, -1.0):
        for way in (1.0, -1.0) if robot.min_speed_mps < 0.0 else (1.0,):
            turn = np.linspace(0.0, 0.5 * math.pi, 40)
            x, y = way * radius * np.sin(turn), side * radius * (1.0 - np.cos(turn))
            axes.plot(x, y, color=CURVE, linewidth=1.2, zorder=3)


def _view(axes: Axes, robot: RobotConfig, reach: float) -> None:
    """What beams look into, and what none does."""
    lidar = robot.lidar
    at, half = (lidar.mount_x_m, lidar.mount_y_m), math.degrees(0.5 * lidar.fov_rad)
    ahead = math.degrees(lidar.mount_yaw_rad)
    axes.add_patch(Wedge(at, reach, ahead - half, ahead + half, facecolor=SEEN, alpha=0.25, zorder=1))
    step = max(1, lidar.num_beams // MOST_RAYS)
    for angle in lidar.mount_yaw_rad + lidar.angles_rad[::step]:
        end = (at[0] + reach * math.cos(angle), at[1] + reach * math.sin(angle))
        axes.plot([at[0], end[0]], [at[1], end[1]], color=SEEN, linewidth=0.5, zorder=1)
    if lidar.fov_rad + lidar.angle_increment_rad < 2.0 * math.pi:
        blind = _blind_patch()
        axes.add_patch(
            Wedge(
                at, 3.0 * reach, ahead + half, ahead - half + 360.0, fill=False, hatch="//",
                edgecolor=blind.get_edgecolor(), linewidth=0.0, zorder=1,
            )
        )  # fmt: skip


def _blind_patch() -> Patch:
    return Patch(fill=False, hatch="//", edgecolor=BLIND, linewidth=0.0)


def _body(axes: Axes, robot: RobotConfig, ahead_m: float, **style: object) -> None:
    """The footprint, moved straight ahead."""
    if robot.radius_m is not None:
        axes.add_patch(Circle((ahead_m, 0.0), robot.radius_m, **style))  # pyright: ignore[reportArgumentType]
    else:
        axes.add_patch(Polygon(robot.polygon + np.array((ahead_m, 0.0)), closed=True, **style))  # pyright: ignore[reportArgumentType]
