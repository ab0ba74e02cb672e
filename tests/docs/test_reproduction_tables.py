"""Table I on the page of the reproduction is that of the kept results."""

import json
from pathlib import Path
from typing import Any

import pytest

from adrl.report.markdown import cell
from adrl.reproduction.reported import LABELS, TABLE_I

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "results" / "reproduce"
PAGE = (FOLDER / "README.md").read_text(encoding="utf-8")
TABLES = json.loads((FOLDER / "tables.json").read_text(encoding="utf-8"))
EVALUATED = {"map": "on the known map", "goal": "without the replanner", "replan": "with the replanner"}


OWN_MAP = "on a map of its own scans"
"""Of a planner with guidance replan: it has no replanner."""


def shown(name: str) -> str:
    return LABELS[name].replace("*", r"\*")


@pytest.mark.parametrize(
    "row", TABLES["table_1"], ids=lambda row: f"{row['scenario']}-{row['method']}-{row['guidance']}"
)
def test_every_row_stands_in_the_page_with_its_intervals(row: dict[str, Any]) -> None:
    plans = row["method"].startswith("astar-") and row["guidance"] == "replan"
    evaluated = OWN_MAP if plans else EVALUATED[row["guidance"]]
    cells = [shown(row["method"]), evaluated, str(row["seeds"] or "-")]
    cells += [cell(row, "distance_m", 2), cell(row, "time_s", 2), cell(row, "success", 3)]
    table = PAGE.partition(f"Measured on `{row['scenario']}`")[2].partition("Measured on")[0]
    assert f"| {' | '.join([*cells, cell(row, 'optimality', 2)])} |" in table


def test_the_papers_rows_stand_beside_them() -> None:
    for name, row in TABLE_I.items():
        numbers = f"{row['distance_m']} | {row['time_s']} | {row['success']:.2f} | {row['optimality']:.2f}"
        assert f"| {shown(name)} | {numbers} |" in PAGE
