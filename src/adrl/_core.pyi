"""The C++ core. Arrays must be C-contiguous and of the dtype given: the bindings check and never convert."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

class Crowd:
    """Who walks in a task; see adrl.types.People. walkers (P, 6): radius, speed, share, reaction_s, group, 1 for who is
    blind; person i walks the way points (W, 2) from way_offsets[i] to way_offsets[i + 1]."""
    def __init__(self, walkers: F64, way_points: F64, way_offsets: I32, legs: bool) -> None: ...

class World:
    def __init__(
        self,
        circles: F64,
        polygon_corners: F64,
        polygon_offsets: I32,
        segments: F64,
        discs: F64,
        solid: U8,
        resolution_m: float,
        origin: tuple[float, float, float],
    ) -> None: ...

def raycast(world: World, poses: F64, angles_rad: F64, max_range_m: float, time_s: float = 0.0) -> F32:
    """(N, 3) sensor poses, (K,) angles -> (N, K) ranges. 0 inside an obstacle, max_range_m when nothing is hit."""

def seen(world: World, crowd: Crowd | None, people: F64, time_s: float) -> F64:
    """(M, 3) x, y and radius of what a LiDAR sees of the discs and of people (P, PERSON_NUMBERS): bodies, or two legs
    of each."""

def clearance(
    world: World, poses: F64, radius_m: float, footprint: F64, limit_m: float, time_s: float = 0.0
) -> F64:
    """(N, 3) robot poses -> (N,) distance from the footprint's edge to the nearest obstacle, at most limit_m;
    0 or less when they overlap. footprint (V, 2) convex polygon, or (0, 2) for the disc of radius_m."""

def clearance_field(
    world: World,
    origin_x_m: float,
    origin_y_m: float,
    width: int,
    height: int,
    resolution_m: float,
    limit_m: float,
) -> F32:
    """(height, width) distance from each cell's centre to the nearest static obstacle, at most limit_m."""

def distance_field(solid: U8, resolution_m: float) -> F32:
    """(H, W) Euclidean distance from each cell's centre to the centre of the nearest solid cell; 0 in solid cells,
    infinity when there is none."""

def astar(blocked: U8, start: tuple[int, int], goal: tuple[int, int]) -> tuple[I32, float]:
    """(H, W) blocked cells, start and goal (row, column) -> ((P, 2) cells, octile length in cells). Diagonal moves
    need both neighbours free. An empty path and infinity when there is none."""

def shorten_path(blocked: U8, cells: I32) -> F64:
    """(P, 2) cells -> (Q, 2) corner cells (row, column) joined by straight lines that cross no blocked cell."""

def integrate(poses: F64, twists: F64, dt_s: float) -> F64:
    """Exact arcs: (N, 3) poses, (N, 2) twists -> (N, 3) poses."""

class SectorTable:
    """Which beams of one LiDAR point into which of S sectors: beams those of the first sector, then of the next; first
    (S + 1) where each sector's begin. A sector without beams reads max_range_m."""
    def __init__(self, beams: I32, first: I32, num_beams: int, max_range_m: float) -> None: ...

class Sectors:
    """Scans by sectors, of robots of several kinds."""
    def __init__(self, kinds: Sequence[SectorTable]) -> None: ...
    def nearest(self, kind: I64, ranges: F32, out: F32) -> None:
        """(N,) kinds of the rows, (N, K) ranges, K at least each one's beams -> out (N, S): the nearest in each."""

class MotionCue:
    """Compares two scans of a fan of beams; see adrl.motion. Stateless: any number of robots share one."""
    def __init__(
        self,
        num_beams: int,
        angle_min_rad: float,
        angle_increment_rad: float,
        mount: tuple[float, float, float],
        max_range_m: float,
        num_sectors: int,
        margin_m: float,
        scale_m: float,
    ) -> None: ...
    def compute(self, ranges: F32, poses: F64, past_ranges: F32, past_poses: F64, out: F32) -> None:
        """(N, K) ranges and (N, 3) robot poses, now and in the past -> out (N, num_sectors)."""

class MotionCues:
    """The same for robots of several kinds."""
    def __init__(self, kinds: Sequence[MotionCue]) -> None: ...
    def compute(
        self, kind: I64, ranges: F32, poses: F64, past_ranges: F32, past_poses: F64, out: F32
    ) -> None:
        """kind (N,) of the rows; K at least each one's beams."""

class NearestTracks:
    """Which clusters of hits of a fan of beams move; see adrl.observation.tracks. Stateless, as MotionCue."""
    def __init__(
        self,
        num_beams: int,
        angle_min_rad: float,
        angle_increment_rad: float,
        mount: tuple[float, float, float],
        max_range_m: float,
        period_s: float,
        num_tracks: int,
    ) -> None: ...

class NearestTracksOfKinds:
    """For robots of several kinds."""
    def __init__(self, kinds: Sequence[NearestTracks]) -> None: ...
    def compute(self, kind: I64, ranges: F32, poses: F64, newest: int, count: int, out: F32) -> None:
        """kind (N,) of the rows; rings of scans (S, N, K) and robot poses (S, N, 3), of which the last `count` up to
        `newest` are followed -> out (N, T, 5): place x, y, m, velocity, m/s, in the robot's frame, and age, s, of the
        nearest that move; zeros where there are no more."""

class Tracker:
    """Follows what moves from scan to scan of one LiDAR, whatever its beams and the time between."""
    def __init__(self) -> None: ...
    def forget(self) -> None: ...
    def take(
        self,
        stamp_s: float,
        sensor: tuple[float, float, float],
        angle_min_rad: float,
        angle_increment_rad: float,
        seen: F64,
        beams: I32,
        points: F64,
    ) -> tuple[F64, F64]:
        """seen (K,): metres that each beam has passed, 0 where it tells nothing; beams (H,) that have hit something,
        rising; points (H, 2) where, in the frame of the sensor's pose -> (H, 2) velocities, 0 of what stands; (H,)
        metres across of what was ever seen to move, infinity of the rest. A scan that is no newer than the last begins
        anew."""

NUM_PARAMS: int
"""Columns of BatchSim's params: speed gain, yaw gain, acceleration, yaw acceleration, lag_s, latency_s, range noise,
dropout probability, relative odometry error of speed and of yaw rate."""
MEMORY_SIZE: int
MAX_PEOPLE: int
PERSON_NUMBERS: int
"""Of a person in BatchSim's people: x, y, vx, vy, heading, metres walked, index of the way point headed for, 1 or -1 on
the way back, seconds until the next decision, seconds held up."""
MAX_LATENCY_PERIODS: int
MAX_CORNERS: int
"""Corners of a footprint."""

class Task:
    """A world with a start, a goal and a path (P, 2) between them."""
    def __init__(
        self,
        world: World,
        start: tuple[float, float, float],
        goal: tuple[float, float],
        goal_tolerance_m: float,
        path: F64,
        crowd: Crowd | None = None,
    ) -> None: ...

class Robot:
    """What a robot of a BatchSim is. footprint (V, 2) convex polygon, or (0, 2) for a disc;
    speed_limits: greatest speed, least speed, greatest yaw rate; mount: the LiDAR's pose on the robot."""
    def __init__(
        self,
        radius_m: float,
        footprint: F64,
        speed_limits: tuple[float, float, float],
        num_beams: int,
        angle_min_rad: float,
        angle_increment_rad: float,
        mount: tuple[float, float, float],
        max_range_m: float,
        dt_s: float,
        min_turning_radius_m: float = 0.0,
    ) -> None: ...

class DwaConfig:
    """The dynamic window approach; see dwa.hpp for the meaning of its constants."""

    lookahead_m: float
    horizon_s: float
    margin_m: float
    comfort_m: float
    comfort_weight: float
    heading_weight: float
    hit_weight: float

class PursuitConfig:
    """Regulated pure pursuit; see pure_pursuit.hpp for the meaning of its constants."""

    lookahead_time: float
    min_lookahead_dist: float
    max_lookahead_dist: float
    rotate_to_heading_min_angle: float
    regulated_linear_scaling_min_radius: float
    regulated_linear_scaling_min_speed: float
    cost_scaling_dist: float
    cost_scaling_gain: float
    max_allowed_time_to_collision: float
    margin_m: float

class MppiConfig:
    """Model predictive path integral control; see mppi.hpp for the meaning of its constants."""

    batch_size: int
    time_steps: int
    model_dt: float
    temperature: float
    gamma: float
    vx_std: float
    wz_std: float
    noise_correlation: float
    collision_cost: float
    collision_margin_m: float
    inflation_m: float
    repulsion_weight: float
    path_align_weight: float
    path_follow_weight: float
    path_follow_offset_m: float
    path_angle_weight: float
    max_angle_to_furthest: float
    goal_weight: float
    goal_threshold_m: float
    prefer_forward_weight: float

MPPI_MOST: tuple[int, int]
"""Greatest batch_size and time_steps."""

class OrcaConfig:
    """Optimal reciprocal collision avoidance of a robot that is told all velocities; see orca_control.hpp for the
    meaning of its constants."""

    lookahead_m: float
    share: float
    horizon_s: float
    wall_horizon_s: float
    space_m: float
    turn_s: float

def mppi_noise(config: MppiConfig) -> F32:
    """(time_steps, 2, batch_size) noise of its samples, in units of its standard deviations."""

ControllerConfig = DwaConfig | PursuitConfig | MppiConfig | OrcaConfig

def control_memory(controller: ControllerConfig) -> int:
    """M: numbers that such a controller remembers of a robot."""

class LocalControl:
    """Local controllers of N robots; see local_control.hpp. response: greatest acceleration and yaw acceleration,
    lag_s. foresee: in a known world moving discs are where they will be; otherwise they stand where they are.
    kinds: robots, each with its response and what drives it. buffers: kind (N) i64, memory (N, M), M the most that one
    of the kinds remembers, zeros for robots that have just started. For simulators of at most num_threads threads."""
    def __init__(
        self,
        num_robots: int,
        num_threads: int,
        kinds: Sequence[tuple[Robot, tuple[float, float, float], ControllerConfig]],
        foresee: bool,
        buffers: dict[str, NDArray[Any]],
    ) -> None: ...
    recovers: bool

class SimConfig:
    clearance_limit_m: float
    """Clearances are reported up to this."""
    lookahead_m: float
    """Of the waypoint along the path; 0 leaves the waypoint at the goal."""
    search_m: float
    """Robots are looked for so far ahead of where they were on their paths."""
    waypoint_is_given: bool
    """The simulator leaves the waypoints alone: a replanner writes them."""

class PathGuide:
    """Leads one robot along a path (P, 2) as BatchSim leads its own; remembers how far it has come."""
    def __init__(self, world: World, robot: Robot, config: SimConfig, path: F64) -> None: ...
    def follow(self, x_m: float, y_m: float) -> tuple[tuple[float, float], float]:
        """The waypoint (x, y) for a robot at (x_m, y_m), and the metres left to the path's end."""
    def ahead(self) -> F64:
        """(P, 2) points of the path PATH_POINTS_M ahead of where the robot was then; new, the path's end beyond it."""

class BatchSim:
    """N robots stepped at once, of several kinds. buffers: arrays owned by the caller, row i for robot i: kind (N) i64
    which of the kinds it is, command (N, 2), active (N) u8, seed (N) u64, params (N, NUM_PARAMS), ranges (N, K) f32,
    K the most beams of a kind, pose (N, 3), odometry (N, 3), twist (N, 2), clearance (N), least_clearance (N),
    waypoint (N, 2), route_left (N), time (N), travelled (N), reached (N) u8, collided (N) u8, at_fault (N) u8,
    memory (N, MEMORY_SIZE), people (N, MAX_PEOPLE, PERSON_NUMBERS), and, for those who want it, path_ahead (N, P, 2):
    points of the path PATH_POINTS_M ahead, all of them the goal for robots that are led to the goal alone.
    A robot's greatest range stands in the columns of ranges beyond its own beams. All that changes is in them: copied
    and put back, they continue to the same bytes."""
    def __init__(
        self,
        num_envs: int,
        num_threads: int,
        kinds: Sequence[tuple[Robot, SimConfig]],
        buffers: dict[str, NDArray[Any]],
    ) -> None: ...
    @property
    def num_threads(self) -> int: ...
    def set_task(self, index: int, task: Task) -> None: ...
    def set_path(self, index: int, task: Task) -> None:
        """Another path in a task of the same place and goal; the robot is led along it from its begin, at once."""
    def reset(self, mask: U8) -> None:
        """Put the robots of the mask (N) at their tasks' starts, at rest, and sense."""
    def step(self) -> None:
        """Move every active robot by one control period and sense."""
    def follow(self, before: F64) -> None:
        """For robots that something else moved from the poses before (N, 3) to those in the buffers: whether the active
        ones have arrived, their clearance and guidance."""
    def plan(self, mask: U8, control: LocalControl, out: F64) -> None:
        """Write a command (v, w) for every active robot of the mask (N), along its path in its known world, into out
        (N, 2)."""

class Braking:
    """How a base responds to commands and comes to rest; see braking.hpp. response: greatest acceleration and yaw
    acceleration, lag_s. orders (S, 3): speed, yaw rate and seconds of each command, executed one after the other."""
    def __init__(
        self,
        radius_m: float,
        footprint: F64,
        response: tuple[float, float, float],
        dt_s: float,
        min_turning_radius_m: float = 0.0,
    ) -> None: ...
    def roll(
        self, pose: tuple[float, float, float], twist: tuple[float, float], orders: F64
    ) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Pose and twist after the orders."""
    def stays_clear(self, twist: tuple[float, float], orders: F64, hits: F64, moving: F64) -> bool:
        """Whether the robot, at the origin, executes the orders and then brakes without coming nearer to a hit (x, y,
        margin), rows of (M, 3), than its margin, or than it is where that is less. Hits inside it are passed over.
        Nor may it come nearer by its own motion to what moves, rows of (K, 6): a hit, its velocity, and the seconds
        since it was there."""

Fan = tuple[float, float, float]
"""First angle (rad), angle from beam to beam (rad), greatest range (m)."""

def misfits(
    seen: F64, seen_fan: Fan, surface: F64, surface_fan: Fan, motions: F64, scale_m: float, stride: int = 1
) -> F64:
    """(M, 2) for each pose (M, 3) of the sensor of `seen` in the frame of that of `surface`: how badly what one scan
    hit lies on what the other hit, 0 to 1, and how many points were compared; see misfit.hpp. Ranges: infinity for
    nothing within reach, NaN for a beam that tells nothing."""

class Evidence:
    """Of the robots' own maps, -63 to 63, a hit to 126. A cell holds twice its evidence, less one ever since it was
    once as surely free as can be. Above 0 it is solid, at 0 nothing is known of it."""

    hit: int
    miss: int
    low: int
    high: int

class RouteCosts:
    """Eq 22 in metres; see route_planner.hpp. The three k sum to 1."""

    inflation_m: float
    comfort_m: float
    near_goal_m: float
    weight: float
    k_obstacle: float
    k_goal: float
    k_turn: float
    turn_m: float
    headings: bool

class WaypointRules:
    """Which point of a route to head for, eqs 21 and 23; see waypoint.hpp."""

    min_interval_m: float
    max_distance_m: float
    corridor_m: float
    literal: bool

class ReplannerSetup:
    """What robots of one kind have. beams: their number, the first one's angle and the increment; mount: the LiDAR's
    pose on the robot; reach_m: hits farther away are not mapped; body_radius_m: of the disc under the robot that is
    surely free; car: the robot where it is one, whose routes keep car_margin_m."""
    def __init__(
        self,
        *,
        height: int,
        width: int,
        resolution_m: float,
        evidence: Evidence,
        beams: tuple[int, float, float],
        mount: tuple[float, float, float],
        max_range_m: float,
        reach_m: float,
        body_radius_m: float,
        costs: RouteCosts,
        waypoint: WaypointRules,
        car: Robot | None = None,
        car_margin_m: float = 0.0,
    ) -> None: ...

class Replanner:
    """Maps and routes of N robots, of several kinds: setups that differ in the robot alone.

    buffers: arrays owned by the caller, row i for robot i: kind (N) i64 which of the setups is its, log_odds
    (N, height, width) i8, origin (N, 2) i64 lattice row and column of the window's cell (0, 0), parity (N) u8,
    waypoint (N, 2), route (N) metres of route, found (N) u8: 0 no route, 1 to the goal, 2 to the nearest cell or the
    border, 3 through what is solid but no wall, as all else is shut off. All that changes is in them.
    mask (N) u8 picks the robots of a call; pose (N, 3) and points (N, 2) are in
    one frame, the odometry's."""
    def __init__(
        self,
        num_robots: int,
        num_threads: int,
        setups: Sequence[ReplannerSetup],
        buffers: dict[str, NDArray[Any]],
    ) -> None: ...
    def restart(self, mask: U8, pose: F64) -> None:
        """Forget everything; the windows are about the robots."""
    def observe(self, mask: U8, pose: F64, ranges: F32) -> None:
        """Enter scans (N, K), K the most beams of a kind."""
    def plan(self, mask: U8, pose: F64, goal: F64) -> None:
        """Write waypoint, route and found on the way to goals (N, 2). found 0 leaves the other two as they were."""
    def plan_routes(self, mask: U8, pose: F64, goal: F64, corners: F64, counts: NDArray[np.int32]) -> None:
        """The same, and the routes pulled taut into corners (N, ROUTE_CORNERS, 2), counts (N) of them."""
    def drive(
        self,
        control: LocalControl,
        mask: U8,
        pose: F64,
        twist: F64,
        corners: F64,
        counts: NDArray[np.int32],
        along: F64,
        out: F64,
    ) -> None:
        """Commands (v, w) into out (N, 2) along such routes among what is mapped. along (N): how far along each its
        robot has come; 0 for a new one."""
    def ahead(
        self, mask: U8, pose: F64, corners: F64, counts: NDArray[np.int32], along: F64, out: F64
    ) -> None:
        """Points PATH_POINTS_M ahead along such routes into out (N, P, 2). along as in drive()."""
    def see(self, mask: U8, pose: F64, point: F64, distance_m: float, known: bool, out: U8) -> None:
        """Write into out (N) whether nothing solid is in a robot's way straight to a point (N, 2), for at most
        distance_m of it; known: and all of the line has been seen."""

ROUTE_CORNERS: int
PATH_POINTS_M: list[float]
"""How far ahead along a path the points lie that a policy may be told."""
MAX_CLEARANCE_CELLS: int
"""What inflation_m and comfort_m may sum to, in cells; ValueError beyond it."""
MAX_DENSITY_WEIGHT: float
"""Greatest density_weight; ValueError beyond it."""
MAX_TURN_COST_M: float
"""Greatest turn_cost_m; ValueError beyond it."""

class RoutePlanner:
    """A* of eq 22 on windows (height, width) i8 of log-odds, with scratch of its own."""
    def __init__(self, height: int, width: int, resolution_m: float, costs: RouteCosts) -> None: ...
    def plan(
        self,
        log_odds: NDArray[np.int8],
        start: tuple[int, int],
        goal: tuple[int, int],
        heading_rad: float = 0.0,
    ) -> tuple[I32, float, bool]:
        """(P, 2) cells (row, column) from start to goal, their cost in metres, and whether the goal is reached; else
        the route ends at the border (goal outside of the window) or in the reachable cell nearest to the goal. Walls
        are what the default Evidence makes of them, and other solid cells are passed where all else is shut off."""

def reeds_shepp(start: tuple[float, float, float], goal: tuple[float, float, float], radius_m: float) -> F64:
    """(K, 2) pieces of the shortest curve of a car: metres, below 0 backward, and 1 for a turn to the left, 0, -1."""

class CarPlanner:
    """Hybrid A* on grids of one size; see car_planner.hpp."""
    def __init__(
        self, robot: Robot, margin_m: float, height: int, width: int, resolution_m: float
    ) -> None: ...
    def plan(
        self,
        clearance_m: F32,
        origin_m: tuple[float, float],
        start: tuple[float, float, float],
        goal: tuple[float, float],
    ) -> F64:
        """(P, 3) poses along the path; (0, 3) when there is none. clearance_m (H, W), at cells' centres."""
    @property
    def expanded(self) -> int:
        """Poses that the last search has left."""
