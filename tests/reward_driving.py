"""A slow, obvious robot for reward tests: a disc among one round obstacle, exact arcs, no inertia."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from adrl.rewards import Step
from adrl.types import RobotConfig
from adrl.worlds import robots as registry

WINDOW = 5


@dataclass
class Driver:
    """Drives one robot and records what each step did."""

    max_speed_mps: float
    max_yaw_rate_radps: float
    dt_s: float
    obstacle: tuple[float, float, float]  # x, y, radius
    goal: tuple[float, float]
    radius_m: float
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rows: list[dict[str, float]] = field(default_factory=list)
    ended: bool = False

    def __post_init__(self) -> None:
        self._moved = [self.max_speed_mps * self.dt_s] * WINDOW
        self.start = self._state()

    def clearance(self) -> float:
        x, y, radius = self.obstacle
        return math.hypot(x - self.pose[0], y - self.pose[1]) - radius - self.radius_m

    def distance(self) -> float:
        return math.hypot(self.goal[0] - self.pose[0], self.goal[1] - self.pose[1])

    def bearing(self, point: tuple[float, float]) -> float:
        angle = math.atan2(point[1] - self.pose[1], point[0] - self.pose[0]) - self.pose[2]
        return math.remainder(angle, 2.0 * math.pi)

    def step(self, speed: float, yaw_rate: float) -> None:
        """speed and yaw rate as fractions of the robot's limits."""
        if self.ended:
            return
        before = self.distance(), self.bearing(self.goal), self.pose
        v, w = speed * self.max_speed_mps, yaw_rate * self.max_yaw_rate_radps
        x, y, yaw = self.pose
        turn = w * self.dt_s
        chord = v * self.dt_s * (math.sin(turn / 2) / (turn / 2) if turn else 1.0)
        self.pose = x + chord * math.cos(yaw + turn / 2), y + chord * math.sin(yaw + turn / 2), yaw + turn
        self._moved = [*self._moved[1:], math.dist(self.pose[:2], before[2][:2])]
        collided, reached = self.clearance() <= 0.0, self.distance() < 0.3
        self.ended = collided or reached
        self.rows.append(
            self._state()
            | {
                "reached": reached,
                "collided": collided,
                "speed_mps": v,
                "yaw_rate_radps": w,
                "previous_distance_m": before[0],
                "previous_heading_error_rad": before[1],
                "displacement_m": math.dist(self.pose[:2], before[2][:2]),
                "turn_rad": turn,
            }
        )

    def face(self, bearing: float) -> None:
        """Turn on the spot until `bearing` (rad, relative to the heading) is straight ahead."""
        limit = self.max_yaw_rate_radps * self.dt_s
        while abs(bearing) > 1e-9 and not self.ended:
            part = max(-limit, min(limit, bearing))
            self.step(0.0, part / limit)
            bearing -= part

    def go_to(self, point: tuple[float, float], within_m: float = 0.1) -> None:
        """Turn to a point, then drive there at full speed, steering back to it."""
        self.face(self.bearing(point))
        while math.dist(self.pose[:2], point) > within_m and not self.ended:
            turn = self.bearing(point) / (self.max_yaw_rate_radps * self.dt_s)
            self.step(1.0, max(-1.0, min(1.0, turn)))

    def orbit(self, centre: tuple[float, float], steps: int) -> None:
        """Circle a point to the left at full speed, or the fastest that stays on the circle."""
        radius = math.dist(self.pose[:2], centre)
        speed = min(1.0, self.max_yaw_rate_radps * radius / self.max_speed_mps)
        yaw_rate = min(1.0, self.max_speed_mps / radius / self.max_yaw_rate_radps)
        self.face(math.remainder(self.bearing(centre) - math.pi / 2, 2 * math.pi))
        for _ in range(steps):
            self.step(speed, yaw_rate)

    def drive(self, speed: float, yaw_rate: float, steps: int) -> None:
        for _ in range(steps):
            self.step(speed, yaw_rate)

    def steps(self) -> tuple[Step, Step]:
        """The states before each step and the steps, both with arrays of (T,)."""
        states = [self.start, *self.rows[:-1]]
        return self._stack(states), self._stack(self.rows)

    def _state(self) -> dict[str, float]:
        return {
            "reached": False,
            "collided": False,
            "speed_mps": 0.0,
            "yaw_rate_radps": 0.0,
            "distance_m": self.distance(),
            "previous_distance_m": self.distance(),
            "heading_error_rad": self.bearing(self.goal),
            "previous_heading_error_rad": self.bearing(self.goal),
            "clearance_m": self.clearance(),
            "mean_displacement_m": sum(self._moved) / WINDOW,
            "timed_out": False,
            "displacement_m": 0.0,
            "turn_rad": 0.0,
            "coordinate_distance_m": math.dist(self.obstacle[:2], self.pose[:2]),
        }

    def _stack(self, rows: list[dict[str, float]]) -> Step:
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        limits = {
            "max_speed_mps": self.max_speed_mps,
            "max_yaw_rate_radps": self.max_yaw_rate_radps,
            "dt_s": self.dt_s,
            "contact_m": self.radius_m,
        }
        return Step(**columns, **limits)  # pyright: ignore[reportArgumentType]


ROBOTS = registry.ROBOTS | {
    "slow turner": RobotConfig(max_speed_mps=1.0, max_yaw_rate_radps=0.5),
    "quick control": RobotConfig(control_period_s=0.05),
    "slow control": RobotConfig(control_period_s=0.2),
}
"""Each is taken for its circumscribed disc."""
FOR_EVER = 2500  # steps: 0.99^2500 < 1e-10


def behaviours(robot: str, gap_m: float) -> Iterator[tuple[str, Driver]]:
    """Every behaviour from the same start: gap_m in front of a pillar, the goal 6 m behind it."""
    config = ROBOTS[robot]
    radius_m = config.circumscribed_radius_m
    pillar = (radius_m + gap_m + 0.3, 0.0, 0.3)
    goal = (pillar[0] + 6.0, 0.0)
    limits = config.max_speed_mps, config.max_yaw_rate_radps, config.control_period_s

    def driver() -> Driver:
        return Driver(*limits, pillar, goal, radius_m)

    d = driver()
    for point in ((-0.3, 0.8), (pillar[0], 1.2), goal):
        d.go_to(point)
    yield "reach", d
    d = driver()
    d.drive(1.0, 0.0, FOR_EVER)
    yield "crash", d
    d = driver()
    d.drive(0.0, 0.0, FOR_EVER)
    yield "stand", d
    d = driver()
    d.drive(0.0, 1.0, FOR_EVER)
    yield "spin", d
    d = driver()
    d.face(math.pi / 2)
    d.orbit((pillar[0], pillar[1]), FOR_EVER)
    yield "orbit the pillar", d
    d = driver()
    d.go_to((-2.0, 0.0))
    d.orbit((-2.0, 0.9), FOR_EVER)
    yield "circle", d
    d = driver()
    d.go_to((-0.3, 0.8))
    d.go_to((pillar[0], 1.2))
    d.go_to((goal[0] - 1.0, 0.0))
    d.orbit(goal, FOR_EVER)
    yield "orbit the goal", d
    d = driver()
    while len(d.rows) < FOR_EVER:
        d.face(0.3)
        d.face(-0.3)
    yield "wiggle", d
    d = driver()
    while len(d.rows) < FOR_EVER:
        d.go_to((-2.0, 0.0))
        d.go_to((-0.01, 0.0))
    yield "shuttle", d
