"""adrl export, and the C++ example on what it writes."""

import fcntl
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from adrl.deploy import MlpPolicy
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.deploy.setup import setup_of
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.export.onnx_graph import to_onnx
from adrl.export.plain import to_safetensors
from adrl.observation import to_twist
from adrl.observation.config import FOLLOWED_STEPS
from adrl.types import RobotConfig
from adrl.worlds import FAMILIES, ROBOTS, get_scenario, task_set
from adrl.worlds.people import among_people
from deploy.recorded import a_policy, a_policy_of_a_family
from deploy.scan_rows import ScanRows, random_rows
from export.test_onnx import by_onnxruntime, ours
from small_run import run_cli

PROJECT = Path(__file__).resolve().parents[2]
TOOLS = Path(sys.executable).parent


@pytest.fixture(scope="module")
def programs() -> Path:
    """Folder of the built example; rebuilt when its sources or the core have changed."""
    build = PROJECT / "build" / "cpp"
    path = f"{TOOLS}{os.pathsep}{os.environ.get('PATH', '')}"
    cmake = shutil.which("cmake", path=path)
    assert cmake is not None, "cmake is one of the developers' tools: make setup"
    build.mkdir(parents=True, exist_ok=True)
    with open(build / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # another process of the run may be at it
        for arguments in (
            ["-S", PROJECT / "examples" / "cpp", "-B", build, "-G", "Ninja"],
            ["--build", build],
        ):
            done = subprocess.run(
                [cmake, *map(str, arguments)],
                env=os.environ | {"PATH": path},
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, done.stdout + done.stderr
    return build


def lines(rows: ScanRows, *, with_motion: bool, path: bool = False) -> str:
    """The rows as adrl_act reads them."""
    parts = [rows.ranges, rows.goal, rows.twist, rows.last_action, *([rows.path] if path else [])]
    if with_motion:
        parts += [rows.past_ranges, rows.pose, rows.past_pose]
    return "\n".join(" ".join(f"{n:.17g}" for n in row) for row in np.concatenate(parts, axis=1))


def act(programs: Path, file: Path, text: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [programs / "adrl_act", file], input=text, capture_output=True, text=True, check=False
    )


def velocities(
    programs: Path, file: Path, rows: ScanRows, *, with_motion: bool, path: bool = False
) -> np.ndarray:
    """(N, 2) of adrl_act."""
    done = act(programs, file, lines(rows, with_motion=with_motion, path=path))
    assert done.returncode == 0, done.stderr
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=np.float64)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("history_steps", [0, 5])
@pytest.mark.parametrize("name", ["diffbot", "jackal"])
def test_the_cpp_example_agrees(programs: Path, tmp_path: Path, name: str, history_steps: int):
    robot: RobotConfig = ROBOTS[name]
    policy = a_policy(robot, history_steps=history_steps)
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_safetensors(policy))
    rows = random_rows(robot, 50, seed=2)
    theirs = velocities(programs, file, rows, with_motion=history_steps > 0)
    np.testing.assert_allclose(theirs, ours(policy, robot, rows)[1], atol=1e-5)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("history_steps", [0, 3])
@pytest.mark.parametrize("path", [False, True])
@pytest.mark.parametrize("number", range(4))
def test_a_policy_of_a_family_acts_the_same_in_python_onnx_and_cpp(
    programs: Path, tmp_path: Path, number: int, history_steps: int, path: bool
):
    """Each fills in the body of the robot that it was made for, and takes metres for the same."""
    robot = FAMILIES["any"].draw("test", number)
    policy = a_policy_of_a_family(history_steps=history_steps, path=path)
    rows = random_rows(robot, 50, seed=number)
    action, velocity = ours(policy, robot, rows)
    assert np.abs(action).max() > 0.1
    scale = (robot.max_speed_mps, robot.max_yaw_rate_radps)
    told = by_onnxruntime(to_onnx(policy, robot), rows)
    np.testing.assert_allclose(told[0], action, atol=2e-5)
    np.testing.assert_allclose(told[1] / scale, velocity / scale, atol=2e-5)
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_safetensors(policy, robot))
    theirs = velocities(programs, file, rows, with_motion=history_steps > 0, path=path)
    np.testing.assert_allclose(theirs / scale, velocity / scale, atol=2e-5)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("history_steps", [0, 2])
@pytest.mark.parametrize("robot", ["diffbot", "jackal"])
def test_the_cpp_example_finds_the_tracks(programs: Path, tmp_path: Path, robot: str, history_steps: int):
    """From the same last scans, the first of them a robot's very first."""
    body = ROBOTS[robot]
    policy = a_policy(body, history_steps=history_steps, num_tracks=3)
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_safetensors(policy))
    tasks = task_set(among_people(get_scenario("crowd"), 12, None, legs=False), body, "train", 3)
    sim = NavSim(3, body, encoder=setup_of(policy).encoder)
    sim.reset(np.arange(3), tasks, np.arange(3, dtype=np.uint64), np.random.default_rng(0))
    rows, wanted, tracked = [], [], 0
    for _ in range(25):
        seen = sim.observe()
        tracked += np.count_nonzero(seen[:, sim.encoder.places["tracks"]])
        ranges, goal, twist, last_action, history, *_ = sim.measured()
        assert history is not None
        ends = [history.ends(ago) for ago in range(FOLLOWED_STEPS + 1)]
        _, pose, past_ranges, past_pose = ends[history_steps]
        motion = [past_ranges, pose, past_pose] if history_steps > 0 else []
        followed = [
            part for _, _, ranges_then, pose_then in reversed(ends) for part in (ranges_then, pose_then)
        ]
        rows.append(np.concatenate([ranges, goal, twist, last_action, *motion, *followed], axis=1))
        action = policy.act(seen)
        wanted.append(to_twist(action, body))
        sim.step(action)
    assert tracked > 100
    text = "\n".join(" ".join(f"{n:.17g}" for n in row) for row in np.concatenate(rows))
    done = act(programs, file, text)
    assert done.returncode == 0, done.stderr
    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=np.float64)
    scale = (body.max_speed_mps, body.max_yaw_rate_radps)
    np.testing.assert_allclose(found / scale, np.concatenate(wanted) / scale, atol=2e-5)
    drive = subprocess.run([programs / "adrl_drive", file], capture_output=True, text=True, check=False)
    assert drive.returncode in (0, 1), drive.stderr
    assert drive.stderr == ""


def test_a_policy_of_a_family_is_exported_for_a_robot_that_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    a_policy_of_a_family().save(tmp_path / "run")
    assert run_cli("export", tmp_path / "run", "--onnx") == 2
    assert "drives robots of family any, and an export is for one; give robot" in capsys.readouterr().err
    assert run_cli("export", tmp_path / "run", "--onnx", "--robot", "jackal") == 0
    model = find_policy(tmp_path / "run" / "policy.onnx")
    assert model.robot == ROBOTS["jackal"]
    assert model.told_of_body
    assert model.taken_as(ROBOTS["jackal"]) == ROBOTS["jackal"]
    with pytest.raises(ConfigError, match=r"holds the encoder of robot jackal.*latency_s 0.1"):
        model.taken_as(replace(ROBOTS["jackal"], latency_s=0.1))
    assert run_cli("export", "diffbot", "--onnx", "--robot", "jackal", "--out", tmp_path / "d.onnx") == 2
    assert "was trained for robot diffbot and is exported for that" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("history_steps", [0, 5])
def test_the_cpp_example_takes_inf_as_reach_and_tells_nan(programs: Path, tmp_path: Path, history_steps: int):
    robot = ROBOTS["diffbot"]
    policy = a_policy(robot, history_steps=history_steps)
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_safetensors(policy))
    rows = random_rows(robot, 20, seed=3)
    reach_m = np.float32(robot.lidar.max_range_m)
    free = np.random.default_rng(0).random(rows.ranges.shape) < 0.3
    infinite = replace(rows, ranges=np.where(free, np.inf, rows.ranges))
    clipped = replace(rows, ranges=np.where(free, reach_m, rows.ranges))
    theirs = velocities(programs, file, infinite, with_motion=history_steps > 0)
    np.testing.assert_allclose(theirs, ours(policy, robot, clipped)[1], atol=1e-5)
    rows.ranges[3, 40] = np.nan
    theirs = velocities(programs, file, rows, with_motion=history_steps > 0)
    assert np.isnan(theirs[3]).all()
    assert np.isfinite(np.delete(theirs, 3, axis=0)).all()


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1.0 " * 100, "line 1 has 100 numbers"),
        ("1.0 " * 187, "line 1 has 187 numbers"),
        ("1.0 " * 186 + "\n" + "1.0 " * 185, "line 2 has 185 numbers"),
        ("1.0 " * 185 + "far", "no number: far"),
    ],
)
def test_the_cpp_example_refuses_malformed_rows(programs: Path, tmp_path: Path, text: str, why: str):
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_safetensors(a_policy(ROBOTS["diffbot"])))
    done = act(programs, file, text)
    assert done.returncode == 1
    assert why in done.stderr


@pytest.mark.slow
@pytest.mark.integration
def test_the_cpp_example_drives_as_the_robot_of_its_policy_can(programs: Path, tmp_path: Path):
    file = tmp_path / "policy.safetensors"
    policy = load_policy(resolve_policy("diffbot"))

    def drive(**changes: float) -> subprocess.CompletedProcess[str]:
        config = replace(policy.config, robot={**policy.config.robot, **changes})
        file.write_bytes(to_safetensors(MlpPolicy(policy.layers, config)))
        return subprocess.run([programs / "adrl_drive", file], capture_output=True, text=True, check=False)

    as_trained, sluggish = drive(), drive(max_acceleration_mps2=0.1)
    for done in (as_trained, sluggish):
        assert done.returncode == 0, done.stdout + done.stderr
    first, second = (float(done.stdout.split()[-2]) for done in (as_trained, sluggish))
    assert second > first + 2.0  # 0.6 m/s take 6 s instead of 0.3 s
    assert drive(radius_m=0.9).returncode == 1  # it stands in the first pillar's way
    late = drive(latency_s=0.1)
    assert late.returncode == 1
    assert "latency" in late.stderr


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("content", [b"", b"\xff" * 64, b"\x10" + b"\0" * 7 + b'{"a":{"dtype":"F', None])
def test_the_cpp_example_refuses_other_files(programs: Path, tmp_path: Path, content: bytes | None):
    file = tmp_path / "policy.safetensors"
    if content is not None:
        file.write_bytes(content)
    done = act(programs, file, "")
    assert done.returncode == 1
    assert done.stderr.startswith("adrl_act: ")


@pytest.fixture(scope="module")
def checked_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of adrl_act that stops at what is undefined, outside of its memory or beyond an integer."""
    folder = tmp_path_factory.mktemp("checked")
    checks = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]
    sources = [
        PROJECT / "examples" / "cpp" / "act.cpp",
        *(PROJECT / "core" / "world" / name for name in ("motion_cue.cpp", "tracker.cpp")),
    ]
    command = ["c++", "-std=c++20", "-g", *checks, f"-I{PROJECT / 'core'}", *map(str, sources)]
    done = subprocess.run(
        [*command, "-o", str(folder / "adrl_act")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder


def damaged(
    content: bytes, tensor: str, change: dict[str, object] | None = None, value: float | None = None
) -> bytes:
    """A safetensors file with a tensor's header changed, or its data."""
    length = int.from_bytes(content[:8], "little")
    header, data = json.loads(content[8 : 8 + length]), bytearray(content[8 + length :])
    first, end = header[tensor]["data_offsets"]
    if value is not None:
        kind = {"F32": np.float32, "F64": np.float64, "I32": np.int32}[header[tensor]["dtype"]]
        array = np.frombuffer(data[first:end], kind).copy()
        array[0] = value
        data[first:end] = array.tobytes()
    header[tensor] |= change or {}
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + bytes(data)


BAD_HEADERS = [
    ("lidar", {"shape": [2**64]}),
    ("lidar", {"shape": [-7]}),
    ("lidar", {"shape": [1e300]}),
    ("lidar", {"shape": [2**63, 2]}),
    ("lidar", {"shape": ["7"]}),
    ("lidar", {"data_offsets": [2**63, 2**63 + 56]}),
    ("lidar", {"data_offsets": [56, 0]}),
    ("lidar", {"dtype": "F32"}),
    ("encoder.extent", {"shape": [0], "data_offsets": [0, 0]}),
    ("motion", {"shape": [1], "data_offsets": [0, 8]}),
    ("tracks", {"shape": [1], "data_offsets": [0, 8]}),
    ("layers.1.bias", {"shape": [0], "data_offsets": [0, 0]}),
]
BAD_VALUES = [
    *[("lidar", value) for value in (np.nan, np.inf, -1.0, 0.0, 1e300, 180.5)],
    *[("limits", value) for value in (np.nan, 0.0)],
    *[("base", value) for value in (np.nan, 0.0)],
    *[(name, value) for name in ("motion", "tracks") for value in (np.nan, 0.0, 1e18)],
    ("encoder.scales", 0.0),
    ("encoder.extent", np.nan),
    ("encoder.beams", -1),
    ("footprint", np.nan),
    ("layers.0.weight", np.inf),
]


@pytest.mark.slow
@pytest.mark.integration
def test_the_cpp_example_survives_damaged_policies(checked_program: Path, tmp_path: Path):
    """Each is refused in one line that names the file; nothing undefined happens on the way."""
    good = to_safetensors(a_policy(ROBOTS["diffbot"], history_steps=5, num_tracks=2))
    cases = {f"{name} {change}": damaged(good, name, change) for name, change in BAD_HEADERS}
    cases |= {f"{name} {value}": damaged(good, name, value=value) for name, value in BAD_VALUES}
    cases |= {f"first {n} bytes": good[:n] for n in (4, 8, 30, 1000, len(good) - 1)}
    cases |= {"backslash": b"\x09" + b"\0" * 7 + b'{"abcde\\\\', "deep": b"\x64" + b"\0" * 7 + b"{" * 100}
    file = tmp_path / "policy.safetensors"
    for label, content in cases.items():
        file.write_bytes(content)
        done = act(checked_program, file, "")
        assert done.returncode == 1, (label, done.stderr)
        assert done.stderr.startswith(f"adrl_act: {file}: "), (label, done.stderr)
        assert done.stderr.count("\n") == 1, (label, done.stderr)
    for other in (tmp_path, tmp_path / "nowhere", Path("/dev/zero")):
        assert "ordinary" in act(checked_program, other, "").stderr


@pytest.mark.slow
@pytest.mark.integration
def test_the_cpp_example_tells_what_is_no_measurement(checked_program: Path, tmp_path: Path):
    """A fault in any number of a row, and in no other row, makes the velocity NaN."""
    policy = a_policy(ROBOTS["diffbot"], history_steps=5)
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_safetensors(policy))
    rows = random_rows(ROBOTS["diffbot"], 1, seed=3)
    (row,) = lines(rows, with_motion=True).splitlines()
    numbers, beams = row.split(), ROBOTS["diffbot"].lidar.num_beams
    others = [k for k in range(len(numbers)) if not (k < beams or beams + 6 <= k < 2 * beams + 6)]
    text = [row]
    for place in (0, beams - 1, beams + 6, *others):
        for fault in ("nan", "inf", "-inf", "1e300") if place in others else ("nan",):
            text.append(" ".join([*numbers[:place], fault, *numbers[place + 1 :]]))
    done = act(checked_program, file, "\n".join([*text, row]))
    assert done.returncode == 0, done.stderr
    first, *faulty, last = done.stdout.splitlines()
    assert first == last
    assert "nan" not in first
    assert {line.replace("-", "") for line in faulty} == {"nan nan"}


def test_onnx_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "model.onnx"
    assert run_cli("export", "diffbot", "--onnx", "--out", out) == 0
    assert capsys.readouterr().out.strip() == str(out)
    session = onnxruntime.InferenceSession(out, providers=["CPUExecutionProvider"])
    assert session.get_modelmeta().custom_metadata_map["guidance"] == "map"


def test_a_run_folder_keeps_its_model(tmp_path: Path):
    a_policy(ROBOTS["diffbot"]).save(tmp_path / "run")
    assert run_cli("export", tmp_path / "run", "--onnx") == 0
    assert run_cli("export", tmp_path / "run", "--safetensors") == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"policy.onnx", "policy.plain.safetensors"} <= names


@pytest.mark.parametrize(
    "arguments",
    [
        ("diffbot",),
        ("diffbot", "--onnx", "--safetensors"),
        ("diffbot", "--onnx"),
        ("nowhere", "--onnx", "--out", "x"),
    ],
)
def test_what_cannot_be_exported(arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert run_cli("export", *arguments) == 2
    assert list(tmp_path.iterdir()) == []
