"""Statements of the paper with verdicts on them, from the intervals of differences between methods.

A statement is put as comparisons: a method is higher, or lower, than each of its rivals. The training seed is the unit:
seed s of one is paired with seed s of the other.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from adrl.evaluation.statistics import Interval, entry
from adrl.reproduction.reported import label

REPRODUCES, CONTRARY, UNDECIDED = "reproduces", "does not reproduce", "undecided"
UNMEASURED, NOT_JUDGED = "was not measured", "not judged"
ZERO, WITHOUT = "zero", "itself without the replanner"
"""Stand for a rival whose every number is 0, and for the method without the replanner."""


@dataclass(frozen=True)
class Verdict:
    """Of a statement in one place: a scenario, or an evaluation in it."""

    place: str
    word: str
    numbers: str = ""
    differences: Mapping[str, Interval] = field(default_factory=dict[str, Interval])
    """Rival -> the method's number less the rival's."""

    def text(self) -> str:
        """The verdict with its numbers."""
        scenario, comma, evaluation = self.place.partition(", ")
        return f"`{scenario}`{comma}{evaluation}: **{self.word}**" + (
            f" ({self.numbers})" if self.numbers else ""
        )


def judged(
    place: str, differences: Mapping[str, Interval], *, higher: bool, value: float = math.nan
) -> Verdict:
    """The verdict on a method that is said to be higher, or lower, than each of its rivals.

    It reproduces if every interval is on the side that is said, and does not if one of them is on the other. Else, with
    an interval that holds 0 or that is not known (fewer than two seeds), it is undecided. value: the method's own mean.
    """
    sides = [(d.low, d.high) if higher else (-d.high, -d.low) for d in differences.values()]
    if all(math.isnan(d.estimate) for d in differences.values()):
        return Verdict(place, UNMEASURED, "", differences)
    if any(high < 0.0 for _, high in sides):
        word = CONTRARY
    else:
        word = REPRODUCES if all(low > 0.0 for low, _ in sides) else UNDECIDED
    numbers = [] if math.isnan(value) else [f"{value:.3g}"]
    numbers += [
        signed(interval) if rival in (ZERO, WITHOUT) else f"less {label(rival)} {signed(interval)}"
        for rival, interval in differences.items()
    ]
    return Verdict(place, word, "; ".join(numbers), differences)


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, in words that can be measured."""

    where: str
    """Table or figure."""
    text: str
    unit: str = ""
    """Of the numbers."""
    caveat: str = ""
    verdicts: tuple[Verdict, ...] = ()
    why_not: str = ""
    """Why it is not judged; empty where it is."""

    def sentence(self) -> str:
        """The statement and all its verdicts."""
        text = f"{self.where}: {self.text}" + (f" ({self.unit})" if self.unit else "")
        if self.why_not:
            return f"{text}. **{NOT_JUDGED.capitalize()}**: {self.why_not}."
        verdicts = "; ".join(verdict.text() for verdict in self.verdicts)
        return f"{text}. {verdicts}." + (f" {self.caveat}" if self.caveat else "")

    def document(self) -> dict[str, Any]:
        """All of it as JSON has it."""
        verdicts = [
            {
                "place": verdict.place,
                "verdict": verdict.word,
                "rivals": [
                    {"rival": rival} | entry("difference", found)
                    for rival, found in verdict.differences.items()
                ],
            }
            for verdict in self.verdicts
        ]
        return {
            "sentence": self.sentence().replace("**", ""),
            "why_not": self.why_not or None,
            "verdicts": verdicts,
        }


def signed(interval: Interval) -> str:
    """A difference with its interval."""
    if math.isnan(interval.estimate):
        return "unknown"
    ends = "" if math.isnan(interval.low) else f" [{interval.low:+.3g}, {interval.high:+.3g}]"
    return f"{interval.estimate:+.3g}{ends}"
