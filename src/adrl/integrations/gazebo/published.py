"""A world file that Gazebo opens as it was published, with one robot put in."""

import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from adrl.errors import WorldError
from adrl.geometry import Pose
from adrl.integrations.gazebo.skid_steer import SkidSteer, skid_steered_model
from adrl.types import RobotConfig, World
from adrl.worlds.sdf.document import numbers, root_of
from adrl.worlds.sdf_write import add

NOT_OPENED = ("plugin", "include")
"""What a file may not bring along: code that Gazebo would run, and models that do not stand in it."""
NOT_THE_WORLD = ("state", "gui")
"""Where all was when the file was saved, which undoes what is put in, and how it was looked at."""
STEP_S = 0.001
"""Gazebo's, where a file says none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Published:
    """The file, the same world as load_sdf reads it, and the robot that drives there. Raises WorldError."""

    file: Path
    world: World
    base: SkidSteer
    start: Pose
    """Where the robot stands when the world is opened: not in an obstacle, as the origin may be."""

    def __post_init__(self) -> None:
        for tag in NOT_OPENED:
            if self._opened.find(f".//{tag}") is not None:
                raise WorldError(f"world {self.file} has a <{tag}>, which Gazebo would load; take it out")

    @cached_property
    def _opened(self) -> Element:
        """<world>."""
        try:
            return root_of(self.file, "world")
        except WorldError as error:
            raise WorldError(f"world {self.file} {error}") from None

    @property
    def step_s(self) -> float:
        """Of the file's physics."""
        physics = self._opened.find("physics")
        if physics is None:
            return STEP_S
        return numbers(physics, "max_step_size", 1, f"world {self.file}", (STEP_S,))[0]

    def with_robot(self, robot: RobotConfig, plugin: Element) -> Element:
        """The document with robot_0 at the start and the plugin."""
        world = copy.deepcopy(self._opened)
        for child in [child for child in world if child.tag in NOT_THE_WORLD]:
            world.remove(child)
        _gather(world)
        world.append(skid_steered_model(robot, self.base, "robot_0", self.start))
        world.append(plugin)
        root = Element("sdf", version="1.6")
        root.append(world)
        return root


def _gather(world: Element) -> None:
    """Bodies that stand still, each in a model of its own, into one model, where they were.

    It is the same to robot and rays, and a step takes Gazebo a seventh of the time with 300 cylinders.
    """
    whole = Element("model", name="standing")
    add(whole, "static", "true")
    link = SubElement(whole, "link", name="link")
    for model in list(world.iterfind("model")):
        body = _lone_body(model)
        if body is None:
            continue
        world.remove(model)
        body.set("name", f"collision_{len(link)}")
        add(body, "pose", model.findtext("pose") or "0 0 0 0 0 0")
        link.append(body)
    if len(link):
        world.append(whole)


def _lone_body(model: Element) -> Element | None:
    """The collision of a model that stands still and has just this one, placed by the model's pose alone."""
    links = model.findall("link")
    bodies = links[0].findall("collision") if len(links) == 1 else []
    stands = model.findtext("static", "").strip() in ("1", "true")
    if not stands or len(bodies) != 1 or model.find("model") is not None:
        return None
    placed = [model.find("pose[@relative_to]"), links[0].find("pose"), bodies[0].find("pose")]
    return bodies[0] if placed == [None, None, None] else None
