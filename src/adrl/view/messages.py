"""What a page asks of the server: JSON objects whose `do` says which of these they are."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from adrl.errors import ConfigError, brief

LONGEST = 4096
"""Characters of a name or a path, and bytes of a message."""
SLOWEST, FASTEST = 0.1, 20.0
"""Speeds of a drive, in times of real time."""
FARTHEST_M = 1e4

Name = Annotated[str, Meta(max_length=LONGEST)]
Metres = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Share = Annotated[float, Meta(ge=-1.0, le=1.0)]


class _Ask(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="do"):
    """One request."""


class Choose(_Ask, frozen=True, tag="choose"):
    """Another robot, policy or place: the drive begins anew."""

    policies: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=2)]
    """One drives, or two side by side on the same task."""
    place: Name
    """A scenario's name, or the file or folder of a map, a world, or BARN's worlds."""
    robot: Name = ""
    """Empty: the first policy's own."""
    guidance: Name = ""
    """Empty: as trained."""
    people: Annotated[int, Meta(ge=0, le=64)] = 0
    """So many walk there, beside those that the place has of its own."""
    task: Annotated[int, Meta(ge=0, le=1_000_000)] = 0
    """Its number in the split."""


class Restart(_Ask, frozen=True, tag="restart"):
    """The same task again."""


class Goal(_Ask, frozen=True, tag="goal"):
    """Drive there instead."""

    x: Metres
    y: Metres


class Move(_Ask, frozen=True, tag="move"):
    """An obstacle is somewhere else from now on."""

    kind: Literal["circles", "polygons", "discs"]
    index: Annotated[int, Meta(ge=0)]
    dx: Metres
    dy: Metres


class Pillar(_Ask, frozen=True, tag="pillar"):
    """A new obstacle."""

    x: Metres
    y: Metres


class Person(_Ask, frozen=True, tag="person"):
    """One more person, who walks about from there."""

    x: Metres
    y: Metres


class Faulted(_Ask, frozen=True, tag="fault"):
    """What goes wrong from now on: a name of adrl.benchmarks.faults.FAULTS."""

    name: Name


class Pace(_Ask, frozen=True, tag="pace"):
    """How fast time goes, and whether; what is left out stays as it is."""

    playing: bool | None = None
    speed: Annotated[float, Meta(ge=SLOWEST, le=FASTEST)] | None = None


class Seek(_Ask, frozen=True, tag="seek"):
    """Another time of a recording."""

    time_s: Annotated[float, Meta(ge=0.0)]


class Hand(_Ask, frozen=True, tag="hand"):
    """What the person at the wheel wants: shares of the robot's greatest speed and yaw rate."""

    speed: Share
    turn: Share


class Record(_Ask, frozen=True, tag="record"):
    """Begin or end the recording of demonstrations."""

    on: bool


class Save(_Ask, frozen=True, tag="save"):
    """Write the demonstrations recorded so far."""


Message = Choose | Restart | Goal | Move | Pillar | Person | Faulted | Pace | Seek | Hand | Record | Save

_DECODER = msgspec.json.Decoder(Message)


def decode(text: str) -> Message:
    """Raises ConfigError for what is no message."""
    if len(text) > LONGEST:
        raise ConfigError(f"a message of {len(text)} characters; they have at most {LONGEST}")
    try:
        return _DECODER.decode(text)
    except msgspec.DecodeError as error:
        raise ConfigError(f"not a message of the page: {brief(error)}; reload the page") from None
