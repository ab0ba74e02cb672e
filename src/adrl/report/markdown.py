"""Tables in Markdown, and the numbers in their cells."""

from collections.abc import Mapping, Sequence
from typing import Any


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Its lines, and an empty one."""
    lines = ["| " + " | ".join(headings) + " |", "|" + "-|" * len(headings)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def cell(row: Mapping[str, Any], metric: str, decimals: int, scale: float = 1.0, sign: str = "") -> str:
    """A metric of a row with its interval; scale: of the numbers shown, sign: + shows it of all."""
    value, *ends = (row[metric + end] for end in ("", "_low", "_high"))
    if value is None:
        return "-"
    value, *ends = (
        None if number is None else f"{scale * number:{sign}z.{decimals}f}" for number in (value, *ends)
    )
    return f"{value}" if ends[0] is None else f"{value} [{ends[0]}, {ends[1]}]"


def plain(value: float | None, decimals: int) -> str:
    """A number, or - where there is none."""
    return "-" if value is None else f"{value:.{decimals}f}"


def of_seeds(value: float | None, count: int, seeds: int) -> str:
    """A median over seeds, and how many of the seeds have it."""
    return f"{'>budget' if value is None else f'{value:.0f}'} ({count}/{seeds})"
