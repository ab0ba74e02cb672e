"""Ranges of the numbers in configurations: declared with a field's type, checked in one place. So are bools.

window_s: Annotated[float, Range(0.05, 60.0)] = 2.0
\"\"\"n steps of eq 18 as a time in s; 0.05 to 60.\"\"\"
"""

import functools
import math
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from adrl.errors import ConfigError


@dataclass(frozen=True)
class Range:
    """The finite numbers from low to high, both included."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.low:g} or more" if self.high == math.inf else f"{self.low:g} to {self.high:g}"


def check_ranges(config: object, prefix: str) -> None:
    """Every field with a Range holds a number within it, or None where its type has that; every bool is one.

    prefix: what stands before a field's name in the message. Raises ConfigError.
    """
    for name in switches(type(config)):
        value = getattr(config, name)
        if not isinstance(value, bool):
            raise ConfigError(f"{prefix}{name} is {_shown(value)}; give True or False")
    for name, (span, whole, optional) in ranges(type(config)).items():
        value = getattr(config, name)
        if value is None and optional:
            continue
        number = not isinstance(value, bool) and isinstance(value, Integral if whole else Real)
        if not (number and span.low <= value <= span.high and value < math.inf):  # pyright: ignore
            what = ", a whole number" if whole else ""
            raise ConfigError(f"{prefix}{name} is {_shown(value)}; give {span}{what}")


@functools.cache
def ranges(kind: type) -> dict[str, tuple[Range, bool, bool]]:
    """Field of a configuration -> its range, whether it is a whole number, whether it may be None."""
    hints = get_type_hints(kind, include_extras=True)
    found: dict[str, tuple[Range, bool, bool]] = {}
    for field in fields(kind):  # pyright: ignore[reportArgumentType]  a dataclass
        options = [hints[field.name], *get_args(hints[field.name])]
        for option in (o for o in options if get_origin(o) is Annotated):
            for mark in (m for m in option.__metadata__ if isinstance(m, Range)):
                found[field.name] = (mark, option.__origin__ is int, type(None) in options)
    return found


@functools.cache
def switches(kind: type) -> tuple[str, ...]:
    """Fields of a configuration that are on or off."""
    hints = get_type_hints(kind)
    return tuple(field.name for field in fields(kind) if hints[field.name] is bool)  # pyright: ignore


def _shown(value: Any) -> str:
    try:
        return repr(value)[:40]
    except ValueError:
        return "a number of thousands of digits"
