"""A drive that people watch and steer: one robot, or two with different policies on the same task, step by step."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from adrl.benchmarks.faults import FAULTS, Fault, lost, twist_is
from adrl.errors import AdrlError, ConfigError, UnknownName
from adrl.report.encode import obstacles, world_content
from adrl.types import Array, World
from adrl.view import messages
from adrl.view.choices import Chosen, Offer, resolve
from adrl.view.demonstrations import Recorder
from adrl.view.hand import ByHand
from adrl.view.lane import Lane
from adrl.view.messages import Choose, Message
from adrl.view.pace import Pace
from adrl.worlds.people import Crowd, Ground, one_more

QUICK = {"Drop the scan": "scan dropped", "Slip the wheels": "wheels slip"}
"""Buttons of the page: what each says -> the fault it switches on."""
LIVE_FAULTS = {
    **{name: replace(fault, in_spells=False) for name, fault in FAULTS.items()},
    "scan dropped": Fault(scan=lost),
    # Wheels turn twice as far as the robot comes, and the odometry counts their turns.
    "wheels slip": Fault(
        base_factors={"speed_gain": 0.5, "yaw_gain": 0.5},
        base_terms={"speed_drift": 1.0, "yaw_drift": 1.0},
        odometry=partial(twist_is, factor=2.0),
    ),
}
"""Those of adrl bench faults, from when they are chosen until another is, and the two of the buttons."""
PILLAR_M = 0.25
"""Radius of a pillar that a person puts down."""
MAP_EVERY = 5
"""Turns from one picture of a robot's own map to the next."""


class Drive:
    """What the page shows, and what becomes of what it asks for."""

    kind = "drive"

    def __init__(self, offer: Offer, choice: Choose, out: Path) -> None:
        """out: where recorded demonstrations are saved. Raises AdrlError."""
        self.offer, self._out = offer, out
        self._pace = Pace()
        self._fault = "none"
        self._recorder: Recorder | None = None
        self._recording = False
        self._saved: list[Path] = []
        self.version = 0
        """Counts up when pages are to be told all anew."""
        self.choose(choice)

    # --- what pages ask for -------------------------------------------------------------------------------------

    def turn(self, asked: list[Message], now_s: float) -> dict[str, Any]:
        """Do what is asked, drive on to this time of the wall's clock, and tell what is new."""
        errors: list[str] = []
        for message in asked:
            try:
                self._take(message, now_s)
            except AdrlError as error:
                errors.append(str(error))
        for hand in self._chosen.by_hand:
            hand.let_go(now_s)
        try:
            self._drive_on(now_s)
        except AdrlError as error:
            self._pace.playing = False
            errors.append(str(error))
        return self._frame() | ({"errors": errors} if errors else {})

    def _take(self, message: Message, now_s: float) -> None:
        match message:
            case messages.Choose():
                self.choose(message)
            case messages.Restart():
                self._begin(self._chosen, self.choice)
            case messages.Goal() | messages.Move() | messages.Pillar() | messages.Person():
                self._touch(message)
            case messages.Faulted():
                self._set_fault(message.name)
            case messages.Pace():
                self._pace.set(message.playing, message.speed)
            case messages.Hand():
                for hand in self._chosen.by_hand:
                    hand.tell(message.speed, message.turn, now_s)
            case messages.Record():
                self._record(message.on)
            case messages.Save():
                self._save()
            case _:
                raise ConfigError("this page shows a drive, not a recording; reload it")

    def _touch(self, message: messages.Goal | messages.Move | messages.Pillar | messages.Person) -> None:
        """What a hand does in the world."""
        match message:
            case messages.Goal():
                for lane in self.lanes:
                    lane.set_goal((message.x, message.y))
            case messages.Move():
                self._set_world(_moved(self._world, message))
            case messages.Pillar():
                circles = np.vstack([self._world.circles, [[message.x, message.y, PILLAR_M]]])
                self._set_world(replace(self._world, circles=circles))
            case messages.Person():
                self._add_person(np.array([message.x, message.y]))

    def _add_person(self, place: Array) -> None:
        """The same one about every robot. Raises TaskError."""
        people = self.lanes[0].task.people
        rng = np.random.default_rng((self.choice.task, len(people)))
        ground = Ground(self._world, self._chosen.robot, Crowd().radius_m[1])
        people = one_more(people, place, ground, rng)
        for lane in self.lanes:
            lane.set_people(people)

    def choose(self, choice: Choose) -> None:
        """The drive begins anew with what is chosen. Raises AdrlError, and leaves all as it was."""
        chosen, recorder = resolve(choice, self.offer), self._recorder
        fits = recorder is None or (recorder.robot, recorder.scenario.name) == (
            chosen.robot,
            chosen.scenario.name,
        )
        if recorder is not None and not fits:
            if len(recorder):
                raise ConfigError(
                    f"the {len(recorder)} recorded steps are of another robot or place; save them first"
                )
            self._recorder = None
        self._begin(chosen, choice)

    def _begin(self, chosen: Chosen, choice: Choose) -> None:
        """Every robot at the start of its task. Raises AdrlError, and leaves all as it was."""
        lanes: list[Lane] = []
        for policy in chosen.policies:
            by_hand = isinstance(policy.policy, ByHand)
            lanes.append(
                Lane(
                    policy,
                    chosen.robot,
                    chosen.task,
                    LIVE_FAULTS[self._fault],
                    guidance=None if by_hand else chosen.guidance,
                    seed=choice.task,
                    recovery=not by_hand,
                )
            )
        if self._recorder is not None:
            self._recorder.cut()
        self._recording = self._recording and bool(chosen.by_hand)
        self._chosen, self.choice = chosen, choice
        self.lanes, self._world = lanes, chosen.task.world
        self._give_recorder()
        self._pace.begin(chosen.robot.control_period_s)
        self._turns, self._new_obstacles = 0, False
        self.version += 1

    def _set_world(self, world: World) -> None:
        for lane in self.lanes:
            lane.set_world(world)
        self._world, self._new_obstacles = world, True

    def _set_fault(self, name: str) -> None:
        if name not in LIVE_FAULTS:
            raise UnknownName("fault", name, LIVE_FAULTS)
        self._fault = name
        for lane in self.lanes:
            lane.set_fault(LIVE_FAULTS[name])

    # --- demonstrations -----------------------------------------------------------------------------------------

    def _record(self, on: bool) -> None:
        if not on:
            if self._recorder is not None:
                self._recorder.cut()
            self._recording = False
        elif not self._chosen.by_hand:
            raise ConfigError("a person's drive is recorded: choose the policy 'by hand' first")
        else:
            self._recorder = self._recorder or Recorder(self._chosen.robot, self._chosen.scenario)
            self._recording = True
        self._give_recorder()

    def _give_recorder(self) -> None:
        """The recorder watches the lane that a person drives."""
        for lane in self.lanes:
            by_hand = isinstance(lane.policy.policy, ByHand)
            lane.recorder = self._recorder if self._recording and by_hand else None

    def _save(self) -> None:
        if self._recorder is None:
            raise ConfigError("nothing is recorded yet; choose the policy 'by hand', record, and drive")
        self._saved.append(self._recorder.save(self._out))

    def close(self) -> list[str]:
        """What was recorded and not saved is saved. What the command says at its end."""
        if self._recorder is not None and len(self._recorder):
            self._save()
        return [str(path) for path in self._saved]

    # --- time, and what is shown --------------------------------------------------------------------------------

    def _drive_on(self, now_s: float) -> None:
        for _ in self._pace.steps(now_s):
            if self.over:
                if self._recording:
                    self._next_task()
                return
            for lane in self.lanes:
                lane.step()

    @property
    def over(self) -> bool:
        """Whether nothing will move a robot but a new goal."""
        return all(lane.over for lane in self.lanes)

    def _next_task(self) -> None:
        self.choose(structs.replace(self.choice, task=self.choice.task + 1))

    def setup(self) -> dict[str, Any]:
        """All that a page needs to begin, with what has been driven so far."""
        return {
            "kind": self.kind,
            "offer": self.offer.content(),
            "choice": structs.asdict(self.choice),
            "robot": self._chosen.robot.name,
            "split": self._chosen.split,
            "by_hand": bool(self._chosen.by_hand),
            "period_s": self._chosen.robot.control_period_s,
            "faults": list(LIVE_FAULTS),
            "quick_faults": QUICK,
            "world": world_content(self._world),
            "lanes": [lane.about() | {"rows": list(lane.rows)} for lane in self.lanes],
        }

    def _frame(self) -> dict[str, Any]:
        self._turns += 1
        lanes = []
        for lane in self.lanes:
            lanes.append(lane.now() | {"rows": lane.news()})
            if self._turns % MAP_EVERY == 1:
                lanes[-1]["map"] = lane.map()
        frame: dict[str, Any] = {"lanes": lanes, "fault": self._fault, "record": self._recorded()}
        frame |= self._pace.content()
        if self._new_obstacles:
            frame["obstacles"] = obstacles(self._world)
            self._new_obstacles = False
        return frame

    def _recorded(self) -> dict[str, Any]:
        recorder = self._recorder
        return {
            "on": self._recording,
            "steps": 0 if recorder is None else len(recorder),
            "episodes": 0 if recorder is None else recorder.episodes,
            "arrivals": 0 if recorder is None else recorder.arrivals,
            "saved": [str(path) for path in self._saved],
        }


def _moved(world: World, move: messages.Move) -> World:
    """Raises ConfigError for an obstacle that is not there."""
    by = np.array([move.dx, move.dy])
    count = len(getattr(world, move.kind))
    if move.index >= count:
        raise ConfigError(f"{move.kind}[{move.index}] does not exist, there are {count}; reload the page")
    if move.kind == "polygons":
        polygons = list(world.polygons)
        polygons[move.index] = polygons[move.index] + by
        return replace(world, polygons=tuple(polygons))
    rows = getattr(world, move.kind).copy()
    rows[move.index, :2] += by
    if move.kind == "discs":  # both ends of its way
        rows[move.index, 2:4] += by
    return replace(world, **{move.kind: rows})
