"""Table I of the results is that of the kept results."""

import json
from pathlib import Path
from typing import Any

import pytest

from adrl.reproduction.reported import LABELS, TABLE_I

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "results" / "index.md").read_text(encoding="utf-8")
TABLES = json.loads((ROOT / "docs" / "results" / "reproduce" / "tables.json").read_text(encoding="utf-8"))
EVALUATED = {"map": "known map", "goal": "without replanner", "replan": "with replanner"}


def measured(row: dict[str, Any], metric: str, decimals: int, scale: float = 1.0) -> str:
    value, low, high = (f"{scale * row[metric + end]:.{decimals}f}" for end in ("", "_low", "_high"))
    return f"{value} [{low}, {high}]"


@pytest.mark.parametrize(
    "row", TABLES["table_1"], ids=lambda row: f"{row['scenario']}-{row['method']}-{row['guidance']}"
)
def test_every_row_stands_in_the_page_with_its_intervals(row: dict[str, Any]) -> None:
    cells = [f"`{row['scenario']}`", LABELS[row["method"]].replace("*", r"\*"), EVALUATED[row["guidance"]]]
    cells += [measured(row, "success", 1, 100.0), measured(row, "distance_m", 1), measured(row, "time_s", 1)]
    assert f"| {' | '.join([*cells, measured(row, 'optimality', 2)])} |" in PAGE


def test_the_papers_rows_stand_beside_them() -> None:
    for name, row in TABLE_I.items():
        numbers = (
            f"{100 * row['success']:.0f} | {row['distance_m']} | {row['time_s']} | {row['optimality']:.2f}"
        )
        assert (
            f"| as reported | {LABELS[name].replace('*', chr(92) + '*')} | not measured here | {numbers} |"
            in PAGE
        )
