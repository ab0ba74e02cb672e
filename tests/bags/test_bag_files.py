"""Bags of every storage are read alike, and one that is not whole says what mends it."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from adrl.errors import DatasetError
from adrl.imitation import read_demonstrations
from adrl.types import RobotConfig
from bag_corridor import STORE, corridor_bag
from bag_drives import drive_by_hand

ROBOT = RobotConfig()
MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a bag of each storage: mcap, db3, ros1.bag."""
    folder = tmp_path_factory.mktemp("whole")
    corridor_bag(folder / "mcap")
    corridor_bag(folder / "db3", storage=SQLITE)
    drive_by_hand(folder / "ros1.bag", [(2.0, 0.5, 0.0), (3.0, 0.0, 0.0)], ROBOT)
    return folder


def test_both_storages_are_read_alike_and_so_are_their_files(whole: Path) -> None:
    expected = read_demonstrations([whole / "mcap"], ROBOT)[0].observation
    for path in (whole / "db3", whole / "mcap" / "mcap.mcap", whole / "db3" / "db3.db3"):
        assert_array_equal(read_demonstrations([path], ROBOT)[0].observation, expected)


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (MCAP, CompressionMode.FILE),
        (SQLITE, CompressionMode.FILE),
        (SQLITE, CompressionMode.MESSAGE),
        (MCAP, CompressionMode.STORAGE),
    ],
)
def test_compressed_bags_are_read(
    whole: Path, tmp_path: Path, storage: StoragePlugin, mode: CompressionMode
) -> None:
    writer = Writer(tmp_path / "bag", version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with AnyReader([whole / "mcap"]) as reader, writer:
        lines = {
            line.topic: writer.add_connection(line.topic, line.msgtype, typestore=STORE)
            for line in reader.connections
        }
        for line, time_ns, raw in reader.messages():
            writer.write(lines[line.topic], time_ns, raw)
    expected = read_demonstrations([whole / "mcap"], ROBOT)[0].observation
    assert_array_equal(read_demonstrations([tmp_path / "bag"], ROBOT)[0].observation, expected)


@pytest.mark.parametrize("kind", [Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4])
def test_compressed_bags_of_ros_1_are_read(
    whole: Path, tmp_path: Path, kind: Writer1.CompressionFormat
) -> None:
    writer = Writer1(tmp_path / "a.bag")
    writer.set_compression(kind)
    with AnyReader([whole / "ros1.bag"]) as reader, writer:
        lines = {
            line.topic: writer.add_connection(line.topic, line.msgtype, typestore=reader.typestore)
            for line in reader.connections
        }
        for line, time_ns, raw in reader.messages():
            writer.write(lines[line.topic], time_ns, raw)
    expected = read_demonstrations([whole / "ros1.bag"], ROBOT)[0].observation
    assert_array_equal(read_demonstrations([tmp_path / "a.bag"], ROBOT)[0].observation, expected)


def stored(bag: Path) -> Path:
    return next(path for path in [*bag.glob("*.mcap"), *bag.glob("*.db3"), bag] if path.is_file())


def cut(share: float) -> Callable[[Path], object]:
    def damage(bag: Path) -> None:
        content = stored(bag).read_bytes()
        stored(bag).write_bytes(content[: int(share * len(content))])

    return damage


def said(old: str, new: str) -> Callable[[Path], object]:
    def damage(bag: Path) -> None:
        text = (bag / "metadata.yaml").read_text()
        assert old in text
        (bag / "metadata.yaml").write_text(text.replace(old, new))

    return damage


def without_index(bag: Path) -> None:
    content = bytearray(bag.read_bytes())
    at = content.index(b"index_pos=") + len(b"index_pos=")
    content[at : at + 8] = bytes(8)
    bag.write_bytes(content)


def with_longer_index(bag: Path) -> None:
    content = bytearray(bag.read_bytes())
    at = content.index(b"count=", content.rindex(b"op=\x04")) + len(b"count=")
    content[at : at + 4] = (7).to_bytes(4, "little")
    bag.write_bytes(content)


def gone(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()


def alone(bag: Path) -> None:
    gone(bag)
    stored(bag).unlink()


def one_folder_up(bag: Path) -> None:
    shutil.move(bag, bag.with_name("inner"))
    bag.mkdir()
    shutil.move(bag.with_name("inner"), bag / "inner")


DAMAGES: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "killed recorder, mcap": ("mcap", gone, r"no metadata\.yaml.*; run: ros2 bag reindex .*mcap"),
    "killed recorder, db3": ("db3", gone, r"no metadata\.yaml.*; run: ros2 bag reindex .*db3"),
    "no index": ("ros1.bag", without_index, r"not indexed.*; run: rosbag reindex .*ros1\.bag"),
    "cut, ros 1": ("ros1.bag", cut(0.9), r"; run: rosbag reindex .*ros1\.bag"),
    "cut, mcap": ("mcap", cut(0.9), "; if its end was lost, run: mcap recover"),
    "cut, db3": ("db3", cut(0.5), r"; if its end was lost, run: sqlite3 FILE\.db3 \.recover"),
    "index of other sizes": ("ros1.bag", with_longer_index, r"; run: rosbag reindex .*ros1\.bag"),
    "empty, ros 1": ("ros1.bag", cut(0.0), "the file is empty"),
    "empty, mcap": ("mcap", cut(0.0), r"mcap\.mcap is empty"),
    "empty, db3": ("db3", cut(0.0), r"db3\.db3 is empty"),
    "no data": ("mcap", lambda bag: stored(bag).unlink(), "files are missing.*ros2 bag reindex"),
    "empty folder": ("mcap", alone, "a folder without a bag"),
    "folder of bags": ("mcap", one_folder_up, "a folder of bags; give the bags in it: inner"),
    "unknown storage": (
        "mcap",
        said("storage_identifier: mcap", "storage_identifier: rosbag_v2"),
        "Storage plugin 'rosbag_v2' not supported.*ros2 bag convert",
    ),
    "mcap called sqlite3": (
        "mcap",
        said("storage_identifier: mcap", "storage_identifier: sqlite3"),
        "names another storage than .mcap; run: ros2 bag reindex",
    ),
    "db3 called mcap": (
        "db3",
        said("storage_identifier: sqlite3", "storage_identifier: mcap"),
        "names another storage than .db3; run: ros2 bag reindex",
    ),
    "a later version": ("mcap", said("version: 8", "version: 99"), "version 99 not supported.*convert"),
    "no CDR": ("mcap", said("serialization_format: cdr", "serialization_format: json"), "'json'"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_bag_that_is_not_whole_says_what_mends_it(whole: Path, tmp_path: Path, name: str) -> None:
    source, damage, message = DAMAGES[name]
    bag = tmp_path / source
    if (whole / source).is_dir():
        shutil.copytree(whole / source, bag)
    else:
        shutil.copy(whole / source, bag)
    damage(bag)
    with pytest.raises(DatasetError, match=message) as caught:
        read_demonstrations([bag], ROBOT)
    assert str(caught.value).startswith(f"{bag}: ")
    assert "()" not in str(caught.value)
    assert "please report" not in str(caught.value)


def test_what_is_no_bag_is_named(whole: Path, tmp_path: Path) -> None:
    shutil.copy(whole / "ros1.bag", tmp_path / "a.bag.active")
    (tmp_path / "notes.txt").write_text("no bag")
    for path, message in {
        tmp_path / "a.bag.active": "run: rosbag reindex",
        tmp_path / "notes.txt": "give a file .bag, or the folder",
        whole / "mcap" / "metadata.yaml": f"give {whole / 'mcap'}",
        Path("/dev/null"): "no ordinary file",
        tmp_path / "gone": "no such file",
    }.items():
        with pytest.raises(DatasetError, match=message):
            read_demonstrations([path], ROBOT)


def test_an_error_without_words_is_named_by_its_kind() -> None:
    from adrl.bags.damage import reason

    assert reason(AssertionError()) == "AssertionError"
    assert reason(ValueError("", "no chunk.")) == "no chunk"


def test_a_topic_without_a_definition_is_read_by_the_standard_one(whole: Path, tmp_path: Path) -> None:
    """db3 of before Iron has no definitions."""
    import sqlite3

    shutil.copytree(whole / "db3", tmp_path / "db3")
    with sqlite3.connect(stored(tmp_path / "db3")) as connection:
        connection.execute("DELETE FROM message_definitions WHERE topic_type != 'nav_msgs/msg/Odometry'")
    expected = read_demonstrations([whole / "mcap"], ROBOT)[0].observation
    assert_array_equal(read_demonstrations([tmp_path / "db3"], ROBOT)[0].observation, expected)
