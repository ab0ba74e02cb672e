"""Writes are whole or not at all."""

import json
import math
import os
import stat
import subprocess
import sys
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import files


@given(st.binary(max_size=1000), st.binary(max_size=1000))
def test_what_is_written_is_read_back_and_replaced(tmp_path_factory, first, second):
    path = tmp_path_factory.mktemp("files") / "new" / "folder" / "data"
    for content in (first, second):
        files.atomic_write_bytes(path, content)
        assert path.read_bytes() == content
    assert os.listdir(path.parent) == ["data"]


@pytest.mark.parametrize("broken", ["fsync", "replace"])
def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, broken):
    path = tmp_path / "data"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr(os, broken, fail)
        with pytest.raises(OSError, match="disk full"):
            files.atomic_write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["data"]


def test_the_data_is_on_the_disk_before_the_name(tmp_path, monkeypatch):
    calls = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (calls.append("fsync"), fsync(fd)))
    monkeypatch.setattr(os, "replace", lambda a, b: (calls.append("replace"), replace(a, b)))
    files.atomic_write_bytes(tmp_path / "data", b"new")
    assert calls == ["fsync", "replace", "fsync"]  # the file, the rename, the folder


def test_a_killed_writer_leaves_a_whole_file(tmp_path):
    path = tmp_path / "data"
    code = (
        "import sys, itertools\n"
        "from adrl import files\n"
        "for i in itertools.count():\n"
        "    files.atomic_write_bytes(sys.argv[1], bytes([i % 256]) * 500_000)\n"
    )
    for delay_s in (0.0, 0.003, 0.011):
        path.unlink(missing_ok=True)
        writer = subprocess.Popen([sys.executable, "-c", code, str(path)])
        try:
            deadline = time.monotonic() + 30.0
            while not path.exists():
                assert time.monotonic() < deadline
                time.sleep(0.001)
            time.sleep(delay_s)
        finally:
            writer.kill()
            writer.wait()
        content = path.read_bytes()
        assert len(content) == 500_000
        assert len(set(content)) == 1


def test_a_new_file_has_the_usual_mode(tmp_path):
    files.atomic_write_bytes(tmp_path / "atomic", b"")
    (tmp_path / "usual").write_bytes(b"")
    assert stat.S_IMODE((tmp_path / "atomic").stat().st_mode) == stat.S_IMODE(
        (tmp_path / "usual").stat().st_mode
    )


def test_a_symbolic_link_stays_one(tmp_path):
    (tmp_path / "target").write_bytes(b"old")
    (tmp_path / "link").symlink_to("target")
    files.atomic_write_bytes(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"new"


def test_a_pipe_is_written_to_and_not_replaced(tmp_path):
    """As for /dev/stdout. A pipe of its own: as root, a faulty write would replace the machine's device."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        files.write_json(pipe, {"a": 1})
        assert stat.S_ISFIFO(pipe.stat().st_mode)
        assert json.loads(os.read(reader, 1000)) == {"a": 1}
    finally:
        os.close(reader)
    assert os.listdir(tmp_path) == ["pipe"]


def test_a_folder_is_not_overwritten(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError):  # noqa: PT011  # which one depends on the system
        files.atomic_write_bytes(tmp_path / "folder", b"")
    assert os.listdir(tmp_path) == ["folder"]


def test_json_keeps_its_order_and_refuses_nan(tmp_path):
    path = tmp_path / "a.json"
    files.write_json(path, {"b": 1, "a": [0.1, None, "é"]})
    before = path.read_bytes()
    assert list(json.loads(before)) == ["b", "a"]
    for number in (math.nan, math.inf):
        with pytest.raises(ValueError, match="JSON"):
            files.write_json(path, {"a": number})
    assert path.read_bytes() == before
