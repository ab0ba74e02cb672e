"""Pictures of a robot in its world, from above."""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from adrl import _core
from adrl.errors import MissingExtra
from adrl.geometry import compose, in_world_frame
from adrl.types import Array, World

if TYPE_CHECKING:
    from adrl.envs.nav_sim import NavSim

SIZE_PX = 480
SOLID = (70, 74, 82)
FREE = (250, 250, 248)
SCAN = (120, 180, 230)
PATH = (170, 170, 170)
ROBOT = (0, 114, 178)
GOAL = (0, 158, 115)
WAYPOINT = (204, 121, 167)
DISC = (213, 94, 0)


class View:
    """Maps metres to pixels: the world's bounds, centred, x to the right and y up."""

    def __init__(self, world: World, size_px: int = SIZE_PX, margin_px: int = 8) -> None:
        x_min, y_min, x_max, y_max = world.bounds
        self.scale = (size_px - 2 * margin_px) / max(x_max - x_min, y_max - y_min)
        self._left = 0.5 * (size_px - self.scale * (x_min + x_max))
        self._bottom = 0.5 * (size_px + self.scale * (y_min + y_max))
        self.size_px = size_px

    def pixels(self, points: Any) -> list[tuple[float, float]]:
        """(P, 2) metres -> P pixels."""
        array = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        return [(self._left + self.scale * x, self._bottom - self.scale * y) for x, y in array]

    def disc(self, x: float, y: float, radius: float) -> tuple[float, float, float, float]:
        """Bounding box in pixels."""
        (cx, cy) = self.pixels((x, y))[0]
        r = max(self.scale * radius, 1.5)
        return (cx - r, cy - r, cx + r, cy + r)

    def metres(self) -> Array:
        """(size, size, 2) centres of all pixels in metres."""
        centres = np.arange(self.size_px, dtype=np.float64) + 0.5
        x, y = (centres - self._left) / self.scale, (self._bottom - centres) / self.scale
        return np.stack(np.meshgrid(x, y), axis=-1)


def has_window() -> bool:
    """Whether pygame is there to show one."""
    return find_spec("pygame") is not None


class Renderer:
    """Draws robots of a NavSim. Keeps the last world's picture, which does not change during an episode."""

    def __init__(self) -> None:
        self._world: World | None = None
        self._background: Image.Image | None = None
        self._window: Any = None

    def __reduce__(self) -> tuple[type["Renderer"], tuple[()]]:
        return Renderer, ()  # a copy draws by itself, in no window yet

    def draw(self, sim: "NavSim", index: int) -> NDArray[np.uint8]:
        """(H, W, 3) picture of robot `index` with its scan, path and goal; empty before the first reset."""
        task = sim.tasks[index]
        if task is None:
            return np.full((SIZE_PX, SIZE_PX, 3), 255, dtype=np.uint8)
        if task.world is not self._world or self._background is None:
            self._world, self._background = task.world, background(task.world)
        view = View(task.world)
        image = self._background.copy()
        draw = ImageDraw.Draw(image)
        x, y, theta = sim.b["pose"][index]
        for disc_x, disc_y, radius in sim.moving(index):
            draw.ellipse(view.disc(disc_x, disc_y, radius), fill=DISC)
        draw.point([p for hit in view.pixels(_hits(sim, index)) for p in hit], fill=SCAN)
        draw.line(view.pixels(sim.paths[index]), fill=PATH, width=2)
        draw.ellipse(view.disc(task.goal[0], task.goal[1], task.goal_tolerance_m), outline=GOAL, width=3)
        kind = sim.kinds[sim.b["kind"][index]]
        if kind.guidance != "goal":
            waypoint_x, waypoint_y = sim.b["waypoint"][index]
            draw.ellipse(view.disc(waypoint_x, waypoint_y, 0.08), fill=WAYPOINT)
        robot = kind.robot
        if robot.radius_m is not None:
            draw.ellipse(view.disc(x, y, robot.radius_m), fill=ROBOT)
        else:
            draw.polygon(view.pixels(in_world_frame(np.array([x, y, theta]), robot.polygon)), fill=ROBOT)
        nose = 1.2 * robot.circumscribed_radius_m
        draw.line(
            view.pixels([(x, y), (x + nose * np.cos(theta), y + nose * np.sin(theta))]),
            fill=(0, 0, 0),
            width=2,
        )
        return np.asarray(image)

    def show(self, sim: "NavSim", index: int, fps: int) -> None:
        """Draw in a window. Raises MissingExtra without pygame."""
        try:
            import pygame
        except ImportError:
            raise MissingExtra.named("render", "render_mode 'human'") from None
        picture = self.draw(sim, index)
        if self._window is None:
            pygame.display.init()
            self._window = pygame.display.set_mode((SIZE_PX, SIZE_PX))
            pygame.display.set_caption("adrl/Nav-v0")
            self._clock = pygame.time.Clock()
        self._window.blit(pygame.surfarray.make_surface(picture.swapaxes(0, 1)), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Close the window, if any."""
        if self._window is not None:
            import pygame

            pygame.display.quit()
            self._window = None


def background(world: World) -> Image.Image:
    """What stands still."""
    view = View(world)
    image = Image.new("RGB", (SIZE_PX, SIZE_PX), FREE)
    if world.grid is not None:
        solid = _core.clearance(
            world.native,
            np.concatenate([view.metres().reshape(-1, 2), np.zeros((SIZE_PX**2, 1))], axis=1),
            1e-6,
            np.empty((0, 2)),
            0.01,
        )
        pixels = np.where((solid <= 0.0)[:, None], SOLID, FREE).astype(np.uint8)
        image = Image.fromarray(pixels.reshape(SIZE_PX, SIZE_PX, 3))
    draw = ImageDraw.Draw(image)
    for x, y, radius in world.circles:
        draw.ellipse(view.disc(x, y, radius), fill=SOLID)
    for corners in world.polygons:
        draw.polygon(view.pixels(corners), fill=SOLID)
    for segment in world.segments:
        draw.line(view.pixels(segment), fill=SOLID, width=3)
    return image


def _hits(sim: "NavSim", index: int) -> Array:
    """(H, 2) points where beams end on something."""
    lidar = sim.kinds[sim.b["kind"][index]].robot.lidar
    ranges = sim.b["ranges"][index, : lidar.num_beams].astype(np.float64)
    x, y, heading = compose(sim.b["pose"][index], lidar.mount)
    angles = heading + lidar.angles_rad
    points = np.array([x, y]) + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return points[ranges < lidar.max_range_m]
