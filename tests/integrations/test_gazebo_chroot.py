"""scripts/gazebo-chroot deletes what it made and nothing else, and does only what it was asked to."""

import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "gazebo-chroot"
TOOLS = (
    "awk",
    "bash",
    "cat",
    "chmod",
    "cp",
    "cut",
    "dirname",
    "env",
    "head",
    "ls",
    "mkdir",
    "mktemp",
    "mv",
    "realpath",
)
TOOLS += ("rm", "rmdir", "sed", "sha256sum", "touch")


class Machine:
    """A PATH of harmless tools, on which the user is root and Debian is two files."""

    def __init__(self, folder: Path) -> None:
        self.bin, self.place = folder / "bin", folder / "gazebo"
        self.bin.mkdir()
        for tool in TOOLS:
            found = shutil.which(tool)
            assert found is not None, tool
            (self.bin / tool).symlink_to(found)
        self.has("id", "echo 0")
        self.has("apt-get", "echo http://mirror.invalid/debian")
        self.has("debootstrap", 'mkdir -p "$3/usr/sbin" "$3/etc/dpkg/dpkg.cfg.d"; echo "$4" > "$3/mirror"')
        self.has("chroot", "exit 1")  # as far as the packages

    def has(self, name: str, body: str) -> None:
        (self.bin / name).write_text(f"#!/usr/bin/env bash\n{body}\n")
        (self.bin / name).chmod(0o755)

    def run(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        values = {"PATH": str(self.bin), "HOME": "/nowhere", "ADRL_GAZEBO": str(self.place)} | environment
        return subprocess.run([SCRIPT, *arguments], env=values, capture_output=True, text=True)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


@pytest.mark.parametrize("arguments", [(), ("remove",)])
@pytest.mark.parametrize("content", ["thesis.tex", "root/home/thesis.tex"])
def test_a_folder_of_others_is_left_as_it_is(
    machine: Machine, arguments: tuple[str, ...], content: str
) -> None:
    file = machine.place / content
    file.parent.mkdir(parents=True)
    file.write_text("years of work")
    ran = machine.run(*arguments)
    assert ran.returncode == 1
    assert "not made by this script" in ran.stderr
    assert [path for path in machine.place.rglob("*") if path.is_file()] == [file]


def test_what_it_made_is_removed_and_what_others_put_there_is_not(machine: Machine) -> None:
    assert "installing Gazebo failed" in machine.run().stderr
    assert (machine.place / "root" / "mirror").exists()
    (machine.place / "notes").write_text("of somebody")
    assert "files of others" in machine.run("remove").stderr
    assert [path.name for path in machine.place.iterdir()] == ["notes"]
    (machine.place / "notes").unlink()
    machine.run()
    assert machine.run("remove").returncode == 0
    assert not machine.place.exists()


def test_an_interrupted_set_up_begins_anew_and_a_finished_one_does_not(machine: Machine) -> None:
    machine.has("debootstrap", 'mkdir -p "$3"; touch "$3/half"; exit 1')
    assert "debootstrap failed" in machine.run().stderr
    assert (machine.place / "root" / "half").exists()
    machine.has("debootstrap", 'mkdir -p "$3/usr/sbin" "$3/etc/dpkg/dpkg.cfg.d"')
    machine.run()
    assert not (machine.place / "root" / "half").exists()
    (machine.place / "root" / "kept").touch()
    machine.run()
    assert (machine.place / "root" / "kept").exists()


def test_only_known_arguments_are_taken(machine: Machine) -> None:
    assert "ADRL_GAZEBO" in machine.run("--help").stdout
    for arguments in (("rmeove",), ("remove", "all"), ("--force",)):
        ran = machine.run(*arguments)
        assert ran.returncode == 1
        assert "unknown arguments" in ran.stderr
    assert not machine.place.exists()


def test_it_says_what_a_machine_without_mirror_or_headers_needs(machine: Machine) -> None:
    machine.has("apt-get", ":")
    assert "ADRL_DEBIAN_MIRROR" in machine.run().stderr
    machine.run(ADRL_DEBIAN_MIRROR="http://other.invalid/debian")
    assert (machine.place / "root" / "mirror").read_text() == "http://other.invalid/debian\n"
    machine.run("remove")
    machine.has("gzserver", ":")
    assert "libgazebo-dev" in machine.run().stderr
    assert not (machine.place / "root").exists()


def test_under_sudo_it_goes_into_the_cache_of_the_user(machine: Machine, tmp_path: Path) -> None:
    machine.has("getent", f'[ "$2" = ada ] && echo "ada:x:1000:1000::{tmp_path}/ada:/bin/sh"')
    machine.has("sudo", f'echo "$2" > {tmp_path}/owner; shift 2; exec "$@"')
    machine.run(SUDO_USER="ada", ADRL_GAZEBO="", HOME="/root")
    assert (tmp_path / "ada/.cache/adrl/gazebo/root/mirror").exists()
    assert (tmp_path / "owner").read_text() == "ada\n"
