"""Scans as LiDAR drivers publish them, made into what they mean: fields that cannot be are passed over, and told."""

import dataclasses
import logging
import math

import numpy as np

from adrl.deploy.messages import Scan

LOG = logging.getLogger("adrl.deploy")

LONGEST_SCAN_S = 1.0
"""No LiDAR turns slower."""
FARTHEST_M = 1000.0
"""No planar LiDAR reaches farther; what it says beyond is without end."""
FULL_CIRCLE_RAD = 1.01 * 2.0 * math.pi
"""Beams that reach farther round are those of a wrong increment."""
OFF_BEAMS = 2.0
"""angle_max may be so many beams off: drivers count the last one in their own ways."""
MANY, OFTEN = 0.2, 20
"""A share of the beams that tell nothing in so many scans is a driver's way to say that nothing came back."""


class ScanReader:
    """Reads one LiDAR's scans. What it passes over it says once, in the log `adrl.deploy`."""

    def __init__(self, *, zero_is_free: bool = False, nan_is_free: bool = False) -> None:
        """For LiDARs that report 0, or NaN, where nothing comes back. One that is dead then reads as free space."""
        self._means_free = {"0": zero_is_free, "NaN": nan_is_free}
        self._told: set[str] = set()
        self._often = dict.fromkeys(self._means_free, 0)

    def __call__(self, scan: Scan) -> Scan:
        """The same scan where nothing is wrong with it. What nothing can be made of stays as it is."""
        if scan.ranges.ndim != 1 or scan.ranges.size == 0:
            return scan
        changes = self._timing(scan) | self._limits(scan) | self._angles(scan) | self._free(scan)
        return dataclasses.replace(scan, **changes) if changes else scan

    def _timing(self, scan: Scan) -> dict[str, float]:
        if 0.0 <= scan.lasts_s <= LONGEST_SCAN_S:
            return {}
        self._pass_over(
            "time_increment", f"{scan.time_increment_s:g} s", "its beams are taken for simultaneous"
        )
        return {"time_increment_s": 0.0}

    def _limits(self, scan: Scan) -> dict[str, float]:
        least, most = scan.range_min_m, scan.range_max_m
        changes = {}
        if not most > max(least, 0.0) and not (math.isnan(least) and most > 0.0):
            self._pass_over(
                "range_max", f"{most:g} m with a range_min of {least:g} m", "all ranges are believed"
            )
            least, most, changes = 0.0, math.inf, {"range_min_m": 0.0}
        if not 0.0 <= least < math.inf:
            self._pass_over("range_min", f"{least:g} m", "0 is taken")
            changes["range_min_m"] = 0.0
        if most > FARTHEST_M:
            changes["range_max_m"] = FARTHEST_M
        return changes

    def _angles(self, scan: Scan) -> dict[str, float]:
        increment, steps = scan.angle_increment_rad, scan.ranges.size - 1
        by_max = (scan.angle_max_rad - scan.angle_min_rad) / max(steps, 1)
        if steps == 0 or not math.isfinite(by_max):
            return {}
        if not (math.isfinite(increment) and 0.0 < abs(increment) * steps <= FULL_CIRCLE_RAD):
            if not 0.0 < abs(by_max) * steps <= FULL_CIRCLE_RAD:
                return {}
            self._pass_over(
                "angle_increment", f"{increment:g} rad", f"angle_min and angle_max make it {by_max:g}"
            )
            return {"angle_increment_rad": by_max}
        off = abs(math.remainder((by_max - increment) * steps, 2.0 * math.pi))
        if off > OFF_BEAMS * abs(increment):
            last = scan.angle_min_rad + increment * steps
            self._pass_over(
                "angle_max",
                f"{scan.angle_max_rad:g} rad, and the last of {steps + 1} beams points at {last:g}",
                "angle_increment is believed",
            )
        return {}

    def _free(self, scan: Scan) -> dict[str, object]:
        """Infinity where nothing came back."""
        free = np.zeros(scan.ranges.size, dtype=bool)
        for name, beams in (("0", scan.ranges == 0.0), ("NaN", np.isnan(scan.ranges))):
            if self._means_free[name]:
                free |= beams
            elif beams.mean() > MANY:
                self._often[name] += 1
                if self._often[name] == OFTEN:
                    option = "zero_is_free" if name == "0" else "nan_is_free"
                    LOG.warning(
                        "%.0f %% of the scan's beams read %s, which tells nothing; if this LiDAR means that "
                        "nothing came back, say %s",
                        *(100.0 * beams.mean(), name, option),
                    )
        return {"ranges": np.where(free, np.inf, scan.ranges)} if free.any() else {}

    def _pass_over(self, field: str, value: str, instead: str) -> None:
        if field not in self._told:
            self._told.add(field)
            LOG.warning("the scan's %s cannot be: %s; it is passed over: %s", field, value, instead)
