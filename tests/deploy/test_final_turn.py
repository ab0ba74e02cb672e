"""The turn to a goal's heading, on a robot that obeys at once but where something is in the way."""

import math

import pytest

from adrl.deploy.final_turn import FinalTurn
from adrl.errors import NoRoomToTurn
from adrl.worlds import ROBOTS

DIFFBOT = ROBOTS["diffbot"]


def turned(wanted: float, blocked: tuple[float, float] | None = None) -> tuple[float, set[float]]:
    """From heading 0: where it ends, and the signs of all that was asked for. blocked: headings it cannot come to."""
    turn, yaw, asked = FinalTurn(DIFFBOT, wanted, 0.1), 0.0, set()
    for step in range(600):
        twist = turn.twist(yaw, 0.1 * step)
        if twist is None:
            return yaw, asked
        asked.add(math.copysign(1.0, twist[1]))
        after = math.remainder(yaw + 0.1 * twist[1], 2.0 * math.pi)
        if blocked is None or not blocked[0] < after < blocked[1]:
            yaw = after
    raise AssertionError("it turns for ever")


@pytest.mark.parametrize("wanted", [-3.1, -1.0, 0.5, 2.5])
def test_it_turns_the_shorter_way(wanted: float) -> None:
    yaw, asked = turned(wanted)
    assert abs(math.remainder(yaw - wanted, 2.0 * math.pi)) <= 0.1
    assert asked == {math.copysign(1.0, wanted)}


@pytest.mark.parametrize("wanted", [0.6, 1.0, 2.5, 3.1])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_where_that_is_blocked_it_turns_all_the_way_round(wanted: float, side: float) -> None:
    """Past the place from where the other way is the shorter one."""
    sector = (0.3, 0.5) if side > 0.0 else (-0.5, -0.3)
    yaw, asked = turned(side * wanted, sector)
    assert abs(math.remainder(yaw - side * wanted, 2.0 * math.pi)) <= 0.1
    assert asked == {1.0, -1.0}


def test_once_round_who_turns_too_far_turns_back() -> None:
    turn = FinalTurn(DIFFBOT, 1.0, 0.1)
    asked = [
        turn.twist(yaw, now_s)
        for now_s, yaw in [(0.0, 0.3), (4.0, 0.3), (5.0, -1.0), (8.0, -3.0), (12.0, 0.8)]
    ]
    signs = [math.copysign(1.0, twist[1]) for twist in asked if twist is not None]
    assert signs == [1.0, 1.0, -1.0, -1.0, 1.0]


def test_without_room_either_way_it_says_so() -> None:
    with pytest.raises(NoRoomToTurn):
        turned(1.5, (-math.pi, math.pi))
