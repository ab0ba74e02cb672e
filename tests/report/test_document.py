"""What a report's page holds: numbers that are the files', small, and nothing that could break out of it."""

import base64
import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import adrl
from adrl.errors import CheckpointError
from adrl.evaluation.traces import Trace, Traces
from adrl.report import document as document_module
from adrl.report.document import MOST_BEAMS, MOST_FRAMES, MOST_REPLAYS, charts, document
from adrl.report.encode import numbers, packed
from adrl.report.failure_map import failure_map
from adrl.report.figures import save
from adrl.report.html import page
from adrl.report.paper import paper_figures
from adrl.report.source import Source, read_source
from adrl.rewards import REWARD_TERMS
from adrl.types import RobotConfig, World
from adrl.worlds.map_scenario import MapScenario
from map_files import write_map
from small_run import run_cli

BOUNDS = (0.0, 0.0, 8.0, 6.0)


def unpacked(content: dict[str, Any]) -> np.ndarray:
    """What the page's unpack makes of it."""
    dtype = {8: np.uint8, 16: "<i2"}[content["bits"]]
    integers = np.frombuffer(base64.b64decode(content["data"]), dtype)
    return integers.reshape(content["shape"]) * content["scale"]


@given(
    arrays.arrays(np.float64, st.tuples(st.integers(0, 9), st.integers(1, 4)), elements=st.floats(-1e4, 1e4))
)
def test_packed_numbers_are_exact_to_a_part_in_65000_of_the_largest(values: np.ndarray) -> None:
    step = np.abs(values).max(initial=0.0) / 32767
    assert np.abs(unpacked(packed(values)) - values).max(initial=0.0) <= 0.51 * step + 1e-30


@given(arrays.arrays(np.float64, 20, elements=st.floats(0.0, 6.0)))
def test_ranges_are_packed_in_a_byte_each(values: np.ndarray) -> None:
    content = packed(values, 6.0)
    assert content["bits"] == 8
    assert np.abs(unpacked(content) - values).max() <= 0.51 * 6.0 / 255


def test_what_json_lacks_becomes_null() -> None:
    assert numbers([1.0 / 3.0, np.nan, np.inf]) == [0.33333, None, None]


class Walls:
    """Drives straight on until something is in the way."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.tile(np.array([1.0, 0.02], np.float32), (len(observation), 1))


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an evaluation on a map, with collisions."""
    folder = tmp_path_factory.mktemp("map")
    pixels = np.full((120, 160), 254)
    pixels[[0, -1], :] = pixels[:, [0, -1]] = 0
    pixels[40:80, 70:80] = 0
    scenario = MapScenario(write_map(folder, pixels))
    out = folder / "<b>evaluation&amp;"
    adrl.evaluate(Walls(), scenario=scenario, episodes=40, out=out, num_threads=1)
    return out


def test_a_page_is_strict_json_that_no_name_breaks_out_of(evaluation: Path) -> None:
    source = read_source(evaluation)
    content = page(source, "/* plotly */")
    assert content.count("</script>") == 3
    assert "<b>" not in content
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', content, re.DOTALL)
    assert data is not None
    assert json.loads(data.group(1), parse_constant=pytest.fail) == json.loads(json.dumps(document(source)))
    assert "slot:" not in content


def test_the_table_and_the_replays_are_the_episodes(evaluation: Path) -> None:
    source = read_source(evaluation)
    (shown,) = document(source)["evaluations"]
    episodes, traces = source.evaluations[0].episodes, source.evaluations[0].traces
    assert traces is not None
    assert shown["tasks"]["task"] == episodes.task.tolist()
    assert [ending == "success" for ending in shown["tasks"]["ending"]] == episodes.success.tolist()
    kept = {trace.task: trace for trace in traces.episodes}
    assert 0 < len(shown["replays"]) <= MOST_REPLAYS
    for replay in shown["replays"]:
        trace = kept[replay["task"]]
        assert replay["ending"] == shown["tasks"]["ending"][replay["task"]]
        assert len(replay["time_s"]) <= MOST_FRAMES
        pose, ranges = unpacked(replay["pose"]), unpacked(replay["ranges"])
        assert ranges.shape == (len(replay["time_s"]), min(MOST_BEAMS, 180))
        assert np.hypot(*(pose[-1, :2] - trace.pose[-1, :2])) < 1e-3
        assert np.cos(pose[:, 2] - trace.pose[[0, -1], 2][:, None]).max() > 0.999
        paid = unpacked(replay["paid"])
        np.testing.assert_allclose(paid[-1], trace.paid.sum(axis=0), atol=2e-3)


def test_every_evaluation_has_its_share_of_the_replays() -> None:
    def evaluated(failures: int, arrivals: int) -> Any:
        endings = ["collision"] * failures + ["success"] * arrivals
        traces = [_trace(task, ending) for task, ending in enumerate(endings)]
        whole = Traces(
            robot=RobotConfig(),
            guidance="goal",
            maturity=0.0,
            terms=tuple(REWARD_TERMS),
            world=None,
            episodes=traces,
            tasks=np.arange(len(traces), dtype=np.int32),
            routes=[],
        )
        return type("Entry", (), {"traces": whole})

    choose: Any = document_module._chosen
    (alone,) = choose([evaluated(24, 8)])
    assert len(alone) == 32
    ours, planner = choose([evaluated(24, 8), evaluated(0, 8)])
    assert (len(ours), len(planner)) == (24, 8)
    assert [trace.task for trace in ours] == sorted(trace.task for trace in ours)
    many = choose([evaluated(24, 8)] * 14)
    assert {len(traces) for traces in many} <= {2, 3, 4, 6}
    assert sum(map(len, many)) == MOST_REPLAYS
    assert choose([type("Old", (), {"traces": None})]) == [[]]


def _trace(task: int, ending: str) -> Trace:
    none = np.empty(0)
    arrays = dict.fromkeys(
        ("path", "time_s", "pose", "twist", "waypoint", "clearance", "weights", "paid"), none
    )
    world = World(bounds=BOUNDS)
    ranges = np.empty((0, 1), np.float16)
    return Trace(
        task=task,
        ending=ending,
        robot=RobotConfig(),
        world=world,
        goal=(0.0, 0.0),
        goal_tolerance_m=0.3,
        ranges=ranges,
        **arrays,
    )


def test_a_failure_map_counts_each_episode_once_a_cell(evaluation: Path) -> None:
    """Against a slow twin: a thousand points along every route."""
    (entry,) = read_source(evaluation).evaluations
    assert entry.traces is not None
    found = failure_map(entry.traces, entry.episodes)
    assert found is not None
    passed, failed = np.zeros_like(found.passed), np.zeros_like(found.failed)
    for route, arrived in zip(entry.traces.routes, entry.episodes.success, strict=True):
        touched = set()
        for a, b in pairwise(route):
            for part in np.linspace(0.0, 1.0, 100):
                x, y = a + part * (b - a)
                touched.add((int((y - found.y0_m) / found.cell_m), int((x - found.x0_m) / found.cell_m)))
        for cell in touched:
            passed[cell] += 1
            failed[cell] += not arrived
    # A route may cut the corner of a cell between two points.
    assert np.abs(passed - found.passed).sum() <= 0.02 * passed.sum()
    assert np.abs(failed - found.failed).sum() <= 0.02 * failed.sum() + 1
    assert found.collided.sum() == entry.episodes.collision.sum()
    assert (found.failed <= found.passed).all()
    places = np.concatenate(entry.traces.routes)
    x_min, y_min, x_max, y_max = found.window_m
    margins = [*(places.min(axis=0) - (x_min, y_min)), *((x_max, y_max) - places.max(axis=0))]
    assert all(2.0 * found.cell_m <= margin <= 3.0 * found.cell_m + 1e-6 for margin in margins)


def test_routes_of_other_tasks_are_no_failure_map(evaluation: Path) -> None:
    (entry,) = read_source(evaluation).evaluations
    assert entry.traces is not None
    with pytest.raises(ValueError, match="different tasks"):
        failure_map(entry.traces, entry.episodes.select(np.arange(5)))


def test_a_band_holds_every_seed_and_its_mean(tmp_path: Path) -> None:
    logs = []
    for seed, slope in enumerate((1.0, 2.0, 6.0)):
        path = tmp_path / f"{seed}.jsonl"
        rows = [{"wall_s": t + 0.1 * seed, "env_steps": 100 * t, "S": slope * t / 100} for t in range(1, 11)]
        path.write_text("".join(json.dumps(row) + "\n" for row in rows))
        logs.append(path)
    source = Source(kind="comparison", name="", facts={}, logs={"adrl": logs}, rows=[], evaluations=[])
    (chart,) = charts(source)
    (series,) = chart["series"]
    steps = {key: np.array(values) for key, values in series["env_steps"].items()}
    assert (steps["x"][0], steps["x"][-1]) == (100, 1000)
    for key, slope in (("y", 3.0), ("low", 1.0), ("high", 6.0)):
        np.testing.assert_allclose(steps[key], slope * steps["x"] / 1e4, rtol=1e-4)
    wall = series["wall_s"]
    assert (wall["x"][0], wall["x"][-1]) == (1.2, 10.0)  # where all three are known


def test_an_older_evaluation_has_a_table_and_no_replay(evaluation: Path, tmp_path: Path) -> None:
    for name in ("summary.json", "episodes.parquet"):
        (tmp_path / name).write_bytes((evaluation / name).read_bytes())
    (shown,) = document(read_source(tmp_path))["evaluations"]
    assert (shown["replays"], shown["map"], len(shown["tasks"]["task"])) == ([], None, 40)


def test_what_is_no_result_folder_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], evaluation: Path
) -> None:
    for broken, message in (
        (tmp_path / "absent", "no such folder"),
        (tmp_path, "holds neither"),
    ):
        with pytest.raises(CheckpointError, match=message):
            read_source(broken)
        assert run_cli("report", broken) == 2
        assert message in capsys.readouterr().err
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(CheckpointError, match=r"summary\.json.*lacks"):
        read_source(tmp_path)
    (tmp_path / "summary.json").write_bytes((evaluation / "summary.json").read_bytes())
    with pytest.raises(CheckpointError, match=r"episodes\.parquet"):
        read_source(tmp_path)
    (tmp_path / "episodes.parquet").write_bytes((evaluation / "episodes.parquet").read_bytes())
    (tmp_path / "traces.safetensors").write_bytes(b"{}")
    with pytest.raises(CheckpointError, match=r"traces\.safetensors"):
        read_source(tmp_path)


def test_figures_for_papers_hold_the_map_and_the_routes(evaluation: Path, tmp_path: Path) -> None:
    paths = paper_figures(read_source(evaluation), tmp_path)
    assert {path.name.split("-")[0] for path in paths} == {"routes", "failures"}
    assert {path.suffix for path in paths} == {".png", ".pdf"}
    assert all(path.stat().st_size > 5000 for path in paths)


def test_equal_figures_are_equal_files(tmp_path: Path) -> None:
    for kind in ("png", "pdf"):
        for name in ("a", "b"):
            figure = Figure()
            FigureCanvasAgg(figure)
            figure.subplots().plot([1, 2])
            save(figure, tmp_path / f"{name}.{kind}")
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def contrast(first: str, second: str) -> float:
    """WCAG's ratio of two colours #rrggbb."""

    def luminance(colour: str) -> float:
        channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return float(linear @ (0.2126, 0.7152, 0.0722))

    light, dark = sorted((luminance(first), luminance(second)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_lines_stand_out_from_their_grounds(scheme: str) -> None:
    style = (Path(document_module.__file__).parent / "page" / "style.css").read_text()
    block = {"light": r":root \{(.*?)\}", "dark": r':root\[data-theme="dark"\] \{(.*?)\}'}[scheme]
    found = re.search(block, style, re.DOTALL)
    assert found is not None
    colours = dict(re.findall(r"--([a-z0-9-]+): (#[0-9a-f]{6})", found.group(1)))
    for ground in ("bg", "surface"):
        for text in ("ink", "muted", "accent", "good", "bad"):
            assert contrast(colours[text], colours[ground]) >= 4.5, (text, ground)
    for index in range(7):
        assert contrast(colours[f"s{index}"], colours["surface"]) >= 2.9, index


def test_dark_is_the_same_whether_asked_for_or_given_by_the_system() -> None:
    style = (Path(document_module.__file__).parent / "page" / "style.css").read_text()
    given, asked = (
        re.search(block, style, re.DOTALL)
        for block in (r'data-theme="light"\]\) \{(.*?)\}', r':root\[data-theme="dark"\] \{(.*?)\}')
    )
    assert given is not None
    assert asked is not None
    known = [re.findall(r"--[a-z0-9-]+: #[0-9a-f]{6}", found.group(1)) for found in (given, asked)]
    assert known[0] == known[1] != []
