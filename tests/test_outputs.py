"""Places for results: refused before the work, one writer at a time, nothing left of what came to nothing."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from adrl import outputs
from adrl.errors import ConfigError
from adrl.outputs import locked, require_file, require_folder
from refusals import Adrl
from small_run import TRAIN

HOLD = """
import sys, time
from adrl.outputs import locked
with locked(sys.argv[1]):
    print("held", flush=True)
    time.sleep(60)
"""


def refuse(*_: object, **__: object) -> None:
    raise PermissionError


class TestPlaces:
    def test_nothing_is_made_by_looking(self, tmp_path: Path) -> None:
        require_folder("--out", tmp_path / "a" / "b")
        require_file("--json", str(tmp_path / "c" / "d.json"))
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("place", ["-", "/dev/null", "/dev/stdout", None])
    def test_streams_are_files(self, place: str | None) -> None:
        require_file("--json", place)

    def test_a_folder_of_something_else_is_not_written_to(self, tmp_path: Path) -> None:
        require_folder("--out", tmp_path, "summary.json")
        (tmp_path / ".hidden").touch()
        require_folder("--out", tmp_path, "summary.json")
        (tmp_path / "letters.txt").touch()
        with pytest.raises(ConfigError, match="files of something else"):
            require_folder("--out", tmp_path, "summary.json")
        (tmp_path / "summary.json").touch()
        require_folder("--out", tmp_path, "summary.json")

    def test_what_cannot_be_written_is_refused(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "file").touch()
        (tmp_path / "nowhere").symlink_to(tmp_path / "gone" / "far")
        for bad in (tmp_path / "file" / "below", tmp_path / "nowhere"):
            with pytest.raises(ConfigError, match="no folder"):
                require_folder("--out", bad)
        # Who runs the tests as root may write everywhere.
        monkeypatch.setattr(outputs.os, "access", lambda *_: False)
        monkeypatch.setattr(outputs.tempfile, "TemporaryFile", refuse)
        for check, bad in ((require_folder, tmp_path / "new"), (require_file, tmp_path / "file")):
            with pytest.raises(ConfigError, match="cannot be written to"):
                check("--out", bad)

    @pytest.mark.parametrize("place", ["/proc/version/x", "/proc/new", "/proc/new/er", "/sys/new"])
    def test_a_read_only_place_is_refused(self, place: str) -> None:
        """Permissions allow it to root, the file system to nobody."""
        with pytest.raises(ConfigError, match="give another place"):
            require_folder("--out", place)


class TestLock:
    def test_one_writer_at_a_time(self, tmp_path: Path) -> None:
        out = tmp_path / "a" / "b"
        with locked(out):
            with pytest.raises(ConfigError, match="another process"), locked(out):
                pass
            with locked(tmp_path / "other"):
                pass
        with locked(out):
            (out / "result").touch()
        assert [path.name for path in out.iterdir()] == ["result"]

    def test_what_came_to_nothing_leaves_nothing(self, tmp_path: Path) -> None:
        with pytest.raises(ZeroDivisionError), locked(tmp_path / "a" / "b"):
            raise ZeroDivisionError
        assert list(tmp_path.iterdir()) == []

    def test_a_killed_process_holds_nothing(self, tmp_path: Path) -> None:
        holder = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE)
        try:
            assert holder.stdout is not None
            assert holder.stdout.readline() == b"held\n"
            with pytest.raises(ConfigError, match="another process"), locked(tmp_path):
                pass
            holder.send_signal(signal.SIGKILL)
            holder.wait()
            with locked(tmp_path):
                pass
        finally:
            holder.kill()
            holder.wait()
        assert list(tmp_path.iterdir()) == []


def test_a_run_is_refused_where_another_trains_or_other_files_lie(adrl: Adrl) -> None:
    run = adrl.folder / "run"
    with locked(run):
        adrl.refuses(*TRAIN, "--out", "run", says=("another process", "give another folder"))
    (adrl.folder / "letters").mkdir()
    (adrl.folder / "letters" / "a.txt").touch()
    adrl.refuses(*TRAIN, "--out", "letters", says=("letters", "files of something else"))
