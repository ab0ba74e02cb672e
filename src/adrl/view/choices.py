"""What drives where: what the page offers, and what becomes of a choice."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.deploy.policy import SHIPPED
from adrl.errors import ConfigError
from adrl.registry import offered
from adrl.types import GUIDANCE, RobotConfig, Scenario, Task
from adrl.view.hand import BY_HAND, ByHand
from adrl.view.messages import Choose
from adrl.worlds import ROBOTS, SCENARIOS, load_robot, task_set
from adrl.worlds.place import Place

MAPS, WORLDS = (".yaml", ".yml"), (".sdf", ".world")
"""Endings of files of ROS maps and of Gazebo worlds."""


@dataclass(frozen=True, kw_only=True)
class Offer:
    """What the command was given, beside what has a name."""

    policies: tuple[str, ...] = ()
    robots: tuple[str, ...] = ()
    loaded: Mapping[str, ResolvedPolicy] = field(default_factory=dict)
    """Policies that are there already: name -> policy."""
    places: dict[str, Place] = field(default_factory=dict)
    """As the page calls each."""

    def content(self) -> dict[str, list[str]]:
        """The names that the page lists."""
        return {
            "policies": _once([*self.loaded, *self.policies, *SHIPPED, *offered("policy"), BY_HAND]),
            "robots": _once([*self.robots, *ROBOTS, *offered("robot")]),
            "places": _once([*self.places, *SCENARIOS, *offered("scenario")]),
            "guidance": list(GUIDANCE),
        }

    def policy(self, text: str) -> ResolvedPolicy:
        """By name; code is what the command names, and no page. Raises AdrlError."""
        if text in self.loaded:
            return self.loaded[text]
        if ":" in text and text not in self.policies:
            raise ConfigError(f"policy {text!r} is code; give it to the command: adrl view --policy {text}")
        return find_policy(text)

    def place(self, text: str) -> Place:
        """Raises ConfigError."""
        if text in self.places:
            return self.places[text]
        path = Path(text)
        if path.suffix in MAPS:
            return Place(map=path)
        if path.suffix in WORLDS:
            return Place(world=path)
        return Place(barn=path) if path.is_dir() else Place(scenario=text)


@dataclass(frozen=True, eq=False, kw_only=True)
class Chosen:
    """What a choice comes to: objects, nothing left to look up."""

    robot: RobotConfig
    policies: list[ResolvedPolicy]
    by_hand: list[ByHand]
    """Those among the policies."""
    guidance: str | None
    """None: each policy's own."""
    scenario: Scenario
    split: str
    """A person shows how to drive on tasks of train, and looks at policies on those of test."""
    task: Task


def resolve(choice: Choose, offer: Offer) -> Chosen:
    """Raises AdrlError."""
    found = [None if text == BY_HAND else offer.policy(text) for text in choice.policies]
    robot = load_robot(choice.robot) if choice.robot else _own_robot(found)
    hands: list[ByHand] = []
    policies: list[ResolvedPolicy] = []
    for policy in found:
        if policy is None:
            hands.append(ByHand(robot))
            policy = find_policy(hands[-1])
        policies.append(policy)
    place = offer.place(choice.place)
    if place.people != choice.people:
        place = replace(place, people=choice.people)
    scenario = place.load()
    split = "train" if hands else "test"
    return Chosen(
        robot=robot,
        policies=policies,
        by_hand=hands,
        guidance=choice.guidance or None,
        scenario=scenario,
        split=split,
        task=task_set(scenario, robot, split, 1, choice.task)[0],
    )


def _own_robot(policies: list[ResolvedPolicy | None]) -> RobotConfig:
    known = [policy for policy in policies if policy is not None]
    return known[0].driven(None) if known else load_robot("diffbot")


def _once(names: Iterable[Any]) -> list[str]:
    return list(dict.fromkeys(map(str, names)))
