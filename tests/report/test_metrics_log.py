"""Reading the log of a training run, whole, cut short and foreign."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.errors import CheckpointError
from adrl.report.metrics_log import read_metrics

ROWS = [
    {"wall_s": 1.5, "env_steps": 64, "S": 0.0, "success": None, "note": "warm-up"},
    {"wall_s": 3.0, "env_steps": 128, "S": 0.25, "success": 0.5, "weights": [1, 2]},
    {"wall_s": 4.5, "env_steps": 192, "S": 0.5, "success": None, "late_key": 7},
]
TEXT = "".join(json.dumps(row) + "\n" for row in ROWS)


def test_columns_are_numbers_with_nan_for_null_and_for_absent(tmp_path):
    path = tmp_path / "metrics.jsonl"
    path.write_text(TEXT)
    columns = read_metrics(path)
    assert list(columns) == ["wall_s", "env_steps", "S", "success", "late_key"]
    np.testing.assert_array_equal(columns["wall_s"], [1.5, 3.0, 4.5])
    np.testing.assert_array_equal(columns["success"], [math.nan, 0.5, math.nan])
    np.testing.assert_array_equal(columns["late_key"], [math.nan, math.nan, 7.0])


@given(st.integers(0, len(TEXT)))
def test_a_log_cut_anywhere_keeps_its_complete_rows(tmp_path_factory, kept):
    path = tmp_path_factory.mktemp("log") / "metrics.jsonl"
    path.write_text(TEXT[:kept])
    complete = TEXT[:kept].count("\n")
    if complete == 0:
        with pytest.raises(CheckpointError, match=r"metrics\.jsonl: holds no complete row"):
            read_metrics(path)
    else:
        assert read_metrics(path)["env_steps"].tolist() == [64.0, 128.0, 192.0][:complete]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TEXT + "{]\n", "line 4 is not valid JSON"),
        (TEXT + "[1, 2]\n", "line 4 is of another form: expected object, got array"),
        (TEXT + '{"S": 1.0}\n', "row 4 has no wall_s"),
        (b"\xff\xfe\x00", "cannot be read: it is no text in UTF-8"),
    ],
)
def test_a_foreign_log_is_named_with_its_line(tmp_path, content, message):
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(CheckpointError, match=rf"metrics\.jsonl:? {message}"):
        read_metrics(path)


def test_a_missing_log_is_named(tmp_path):
    with pytest.raises(CheckpointError, match=r"nowhere\.jsonl does not exist"):
        read_metrics(tmp_path / "nowhere.jsonl")
    with pytest.raises(CheckpointError, match="it is no ordinary file"):
        read_metrics(tmp_path)
