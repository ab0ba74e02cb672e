"""The same tasks in two simulators: the paper's Fig. 8 as numbers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from adrl.evaluation.calibration import Calibration
from adrl.evaluation.drives import Drives
from adrl.evaluation.metrics import Episodes, solved_by_all
from adrl.evaluation.results import SCHEMA_VERSION, Summary, compare_paired, interval_entry
from adrl.evaluation.statistics import Interval

if TYPE_CHECKING:
    from rich.table import Table

GAPS = ("success", "collision", "timeout", "time_s", "distance_m", "spl")


@dataclass(frozen=True, kw_only=True)
class Side:
    """What one simulator measured."""

    summary: Summary
    episodes: Episodes
    drives: Drives

    def document(self) -> Summary:
        """The summary with the tracking errors."""
        speed, yaw_rate = self.drives.tracking_error()
        return self.summary | {
            "tracking_error_mps": float(speed),
            "tracking_error_radps": float(yaw_rate),
        }


def transfer_document(sides: Mapping[str, Side], fit: Calibration) -> dict[str, Any]:
    """The JSON document: each simulator's summary, the fit, and each one's gap to Gazebo.

    sides: native, calibrated and gazebo. A gap is Gazebo's less the other's, on the same tasks, with a paired interval
    (compare_paired); times and distances on the tasks that both solved. time_percent: the gap in time, of the other's.
    """
    gazebo = sides["gazebo"]
    document: dict[str, Any] = {"schema_version": SCHEMA_VERSION}
    document |= {name: side.document() for name, side in sides.items()}
    document["calibration"] = fit.summary()
    document["gap"] = {name: _gap(gazebo, side) for name, side in sides.items() if side is not gazebo}
    return document


def _gap(gazebo: Side, other: Side) -> Summary:
    differences = compare_paired(gazebo.episodes, other.episodes)
    entries: Summary = {}
    for metric in GAPS:
        entries |= interval_entry(metric, differences[metric])
    solved = solved_by_all([gazebo.episodes, other.episodes])[1]
    if len(solved):
        percent = 100.0 / solved.time_s.mean()
        scaled = Interval(*(number * percent for number in differences["time_s"]))
        entries |= interval_entry("time_percent", scaled)
    return entries


def transfer_table(document: Mapping[str, Any]) -> "Table":
    """A row a simulator, and below each the gap from it to Gazebo."""
    from rich import box
    from rich.table import Table

    about = document["gazebo"]
    title = (
        f"{about['policy']}, {about['scenario']}, robot {about['robot']}, guidance {about['guidance']}, "
        f"{about['episodes']} {about['split']} tasks"
    )
    table = Table(
        title=title, title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0)
    )
    headings = ("success\n%", "collision\n%", "Av.T\ns", "Av.D\nm", "tracking\nm/s", "error\nrad/s")
    table.add_column("simulator\n")
    for heading in headings:
        table.add_column(heading, justify="right")
    for name in ("native", "calibrated", "gazebo"):
        side = document[name]
        table.add_row(
            name,
            *(_number(side[key], scale) for key, scale in _COLUMNS),
            f"{side['tracking_error_mps']:.3f}",
            f"{side['tracking_error_radps']:.3f}",
        )
    for name, gap in document["gap"].items():
        cells = [f"{_number(gap[key], scale)}\n{_range(gap, key, scale)}" for key, scale in _COLUMNS]
        table.add_row(f"gazebo - {name}", *cells, "", "")
    return table


_COLUMNS = (("success", 100.0), ("collision", 100.0), ("time_s", 1.0), ("distance_m", 1.0))


def _number(value: float | None, scale: float) -> str:
    return "-" if value is None else f"{scale * value:.2f}"


def _range(entries: Mapping[str, Any], key: str, scale: float) -> str:
    return f"{_number(entries[key + '_low'], scale)} to {_number(entries[key + '_high'], scale)}"
