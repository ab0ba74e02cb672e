"""Timing on shared, noisy machines: several rounds, the median counts."""

import math
import statistics
import time
from collections.abc import Callable

from adrl.errors import ConfigError


def require_rounds(rounds: int, seconds: float) -> None:
    """Raises ConfigError unless there is a round, of a positive and finite length."""
    if rounds < 1:
        raise ConfigError(f"rounds is {rounds}; give 1 or more")
    if not (math.isfinite(seconds) and seconds > 0.0):
        raise ConfigError(f"seconds is {seconds}; give a positive number")


def rate_per_second(work: Callable[[], int], seconds: float) -> float:
    """Units of work a second: `work` does some and says how many, and is called for about `seconds`."""
    done, begin = 0, time.perf_counter()
    while True:
        done += work()
        if (elapsed := time.perf_counter() - begin) >= seconds:
            return done / elapsed


def median_seconds(work: Callable[[], object], rounds: int) -> float:
    """Median duration of one call."""
    durations = []
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        durations.append(time.perf_counter() - begin)
    return statistics.median(durations)
