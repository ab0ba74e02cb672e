"""What adrl must do on bad input, for test_bad_input.py and test_bad_files.py."""

import dataclasses
from pathlib import Path

import pytest

from small_run import contents, run_cli


@dataclasses.dataclass
class Adrl:
    """Runs adrl in a folder of its own and holds what it must do on bad input."""

    folder: Path
    capsys: pytest.CaptureFixture[str]

    def refuses(self, *arguments: object, says: tuple[str, ...]) -> str:
        """Message; checks exit code, stderr and that no file below the folder is new or changed."""
        before = contents(self.folder)
        self.capsys.readouterr()
        code = run_cli(*arguments)
        shown = self.capsys.readouterr()
        message = " ".join(shown.err.replace("│", " ").split())
        assert code == 2, message
        assert "Traceback" not in message
        assert shown.out == ""
        for text in says:
            assert text in message, message
        assert contents(self.folder) == before
        return message
