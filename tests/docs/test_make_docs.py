"""make docs fails where a page does not hold what it promises."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GOOD = "# Start\n\n## Here\n\n[there](#here) [that](other.md#other)\n"


def make_docs(folder: Path, start: str) -> subprocess.CompletedProcess[str]:
    """The Makefile's own recipe and our settings, on a site of two pages."""
    (folder / "docs").mkdir()
    (folder / "docs" / "index.md").write_text(start)
    (folder / "docs" / "other.md").write_text("# Other\n")
    settings = (
        f"INHERIT: {ROOT / 'mkdocs.yml'}\ndocs_dir: docs\nhooks: []\nplugins: []\nnav: [index.md, other.md]\n"
    )
    (folder / "mkdocs.yml").write_text(settings)
    for sources in ("core", "examples"):  # where the Makefile looks
        (folder / sources).mkdir()
    set_up = ["--old-file=ready", "DEV=ready", f"BIN={Path(sys.executable).parent}"]
    make = ["make", "--no-print-directory", f"--file={ROOT / 'Makefile'}", *set_up, "docs"]
    return subprocess.run(make, cwd=folder, capture_output=True, text=True, timeout=120)


def test_a_whole_site_is_built_without_a_word(tmp_path: Path) -> None:
    done = make_docs(tmp_path, GOOD)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "build" / "site" / "index.html").is_file()


@pytest.mark.parametrize(
    "broken", ["[a](#nowhere)", "[a](other.md#nowhere)", "[a](none.md)", "![a](none.png)", "[a](/other.md)"]
)
def test_a_dead_link_fails_and_is_named(tmp_path: Path, broken: str) -> None:
    done = make_docs(tmp_path, f"{GOOD}\n{broken}\n")
    assert done.returncode != 0
    assert broken.partition("(")[2].rstrip(")").lstrip("/") in done.stderr
    assert "index.md" in done.stderr
