"""Reading metrics.jsonl, the log of a training run."""

import math
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.errors import CheckpointError, FileError
from adrl.files import read_text
from adrl.json_files import parse_json

MAX_BYTES = 2**28


def read_metrics(path: str | os.PathLike[str]) -> dict[str, NDArray[np.float64]]:
    """Numeric columns of a metrics.jsonl file: key -> (rows,), NaN where a row has null or lacks the key.

    A last line cut short by a killed run is dropped. Raises CheckpointError naming the file, and the line,
    when it is missing, malformed or holds no row.
    """
    try:
        lines = read_text(path, MAX_BYTES).split("\n")
    except FileError as error:
        raise CheckpointError(f"{path} {error}; give the metrics.jsonl of a run folder") from None
    # A complete log ends in a line break, so what follows the last one is empty or was cut short.
    rows = [_row(path, number, line) for number, line in enumerate(lines[:-1], start=1) if line.strip()]
    if not rows:
        raise CheckpointError(f"{path}: holds no complete row; the run ended before its first log point")
    for number, row in enumerate(rows, start=1):
        if not math.isfinite(row.get("wall_s", math.nan)):
            raise CheckpointError(f"{path}: row {number} has no wall_s; it is not the log of a training run")
    keys = dict.fromkeys(key for row in rows for key in row)
    return {key: np.array([row.get(key, math.nan) for row in rows]) for key in keys}


def _row(path: str | os.PathLike[str], number: int, line: str) -> dict[str, float]:
    """The row's numbers, null as NaN; text, lists and nested objects are left out."""
    try:
        content = parse_json(line, dict[str, Any])
    except FileError as error:
        raise CheckpointError(f"{path}: line {number} {error}; delete the line") from None
    return {
        key: math.nan if value is None else float(value)
        for key, value in content.items()
        if value is None or isinstance(value, (int, float))
    }
