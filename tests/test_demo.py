"""adrl demo deletes what demos left, and nothing else."""

from pathlib import Path
from uuid import uuid4

import pytest

from adrl.commands import demo
from adrl.errors import ConfigError
from small_run import finished_run, run_cli


class Killed(Exception):
    """In place of a signal."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Demos run here."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def killed(*_: object) -> None:
    """The demo's first command, half-way."""
    (demo.DRAWN / "robots.parquet").write_text("half of it")
    (demo.DRAWN / f".summary.json.{uuid4().hex}.tmp").write_text("half of it")
    raise Killed


@pytest.mark.parametrize("folder_of_demo", [demo.RUN, demo.DRAWN])
@pytest.mark.parametrize(
    "name", ["notes.txt", "policy.safetensors", "evaluation/summary.json", ".git/config"]
)
def test_what_no_demo_has_left_is_not_deleted(
    folder_of_demo: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run that somebody trained there, too, and what somebody put into a demo's folder."""
    mine = folder_of_demo / name
    mine.parent.mkdir(parents=True)
    mine.write_text("a week's training")
    assert run_cli("demo") == 2
    assert f"{folder_of_demo} holds what no demo" in capsys.readouterr().err
    (folder_of_demo / demo.MARK).touch()
    if mine.relative_to(folder_of_demo).parts[0] not in demo.LEFT:
        assert run_cli("demo") == 2
        assert f"({name.partition('/')[0]})" in capsys.readouterr().err
    assert mine.read_text() == "a week's training"


def test_a_demo_that_was_killed_is_followed_by_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "_run", killed)
    for _ in range(2):
        with pytest.raises(Killed):
            demo.main([])
    demo._claim(demo.RUN)
    (demo.RUN / "checkpoint").mkdir()
    with pytest.raises(Killed):
        demo.main([])
    assert not demo.RUN.exists()


def test_the_mark_is_deleted_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a demo that is killed while it deletes leaves what the next one knows."""
    demo._claim(demo.RUN)
    others = demo.LEFT - {demo.MARK}
    for name in others:
        (demo.RUN / name).touch()
    delete, marked = Path.unlink, []

    def deleting(path: Path) -> None:
        delete(path)
        marked.append((demo.RUN / demo.MARK).exists())

    monkeypatch.setattr(Path, "unlink", deleting)
    demo._delete(demo.RUN)
    assert marked == [True] * len(others)
    assert not demo.RUN.exists()


def test_a_link_is_not_deleted(folder: Path) -> None:
    (folder / "elsewhere").mkdir()
    demo.RUN.parent.mkdir()
    demo.RUN.symlink_to(folder / "elsewhere")
    with pytest.raises(ConfigError, match="is a link"):
        demo.main([])
    assert demo.RUN.is_symlink()


def test_what_a_demo_has_left_is_made_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adrl.commands.demo.extras.installed", lambda name: False)
    assert run_cli("demo") == 0
    page = demo.DRAWN / "report.html"
    page.write_text("of the first")
    assert run_cli("demo") == 0
    assert page.read_text() != "of the first"
    assert not demo.RUN.exists()


@pytest.mark.slow
@pytest.mark.integration
def test_what_a_training_leaves_is_known(tmp_path_factory: pytest.TempPathFactory) -> None:
    assert {path.name for path in finished_run(tmp_path_factory).iterdir()} <= demo.LEFT
