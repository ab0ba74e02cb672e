"""Pictures show what the numbers say: pixels against geometry, drawn lines against data."""

import io
import json
import math
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from adrl import _core
from adrl.errors import CheckpointError
from adrl.report import figures
from adrl.report.figures import RoutePanel
from adrl.types import OccupancyGrid, World

SIZE_M = 10.0
TRIANGLE = np.array([[6.0, 1.0], [9.0, 2.0], [7.0, 3.5]])
CIRCLE = (2.5, 2.5, 1.2)


def world(yaw_rad: float = 0.4, discs: np.ndarray | None = None) -> World:
    """A circle, a triangle, a wall round them and a turned bitmap of a solid L."""
    solid = np.array([[1, 1, 1], [1, 0, 0]], dtype=np.uint8)
    return World(
        bounds=(0.0, 0.0, SIZE_M, SIZE_M),
        circles=np.array([CIRCLE]),
        polygons=(TRIANGLE,),
        segments=np.array([[0.0, 0.0, SIZE_M, 0.0], [0.0, SIZE_M, SIZE_M, SIZE_M]]),
        discs=np.empty((0, 8)) if discs is None else discs,
        grid=OccupancyGrid(solid=solid, resolution_m=1.0, origin=(4.0, 5.5, yaw_rad)),
    )


def panel(**changes) -> RoutePanel:
    line = np.linspace((1.0, 9.0), (9.0, 9.0), 50)
    start = RoutePanel(
        world=world(),
        start=(1.0, 9.0, 0.0),
        goal=(9.0, 9.0),
        path=np.array([[1.0, 9.0], [9.0, 9.0]]),
        trajectories={"adrl": line - [0.0, 0.5]},
        endings={"adrl": "success"},
    )
    return replace(start, **changes)


def render(figure: Figure) -> np.ndarray:
    """(H, W, 3) pixels, row 0 at the top."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return np.asarray(Image.open(buffer).convert("RGB"))


def pixel(image: np.ndarray, axes: Axes, x: float, y: float) -> np.ndarray:
    column, row = axes.transData.transform((x, y))
    return image[image.shape[0] - 1 - int(row), int(column)]


def coloured_lines(axes: Axes, colour: str) -> list[np.ndarray]:
    """Drawn lines (points, 2) of this colour, markers alone left out."""
    lines = [line for line in axes.lines if line.get_color() == colour and line.get_linestyle() != "None"]
    return [np.asarray(line.get_xydata()) for line in lines]


def is_solid(x: float, y: float, yaw_rad: float) -> bool:
    """Slow twin: what world() holds at a point."""
    if math.hypot(x - CIRCLE[0], y - CIRCLE[1]) < CIRCLE[2]:
        return True
    corners = [*TRIANGLE, TRIANGLE[0]]
    if all((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0 for a, b in pairwise(corners)):
        return True
    along = math.cos(yaw_rad) * (x - 4.0) + math.sin(yaw_rad) * (y - 5.5)
    across = math.cos(yaw_rad) * (y - 5.5) - math.sin(yaw_rad) * (x - 4.0)
    if not (0.0 <= along < 3.0 and 0.0 <= across < 2.0):
        return False
    return across < 1.0 or along < 1.0


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, 2.5, math.pi / 2])
def test_a_pixel_is_grey_where_the_world_is_solid_and_white_where_it_is_free(yaw_rad):
    figure = Figure(figsize=(5, 5), dpi=80)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    figures.draw_world(axes, world(yaw_rad))
    axes.set_xlim(0.0, SIZE_M)
    axes.set_ylim(0.0, SIZE_M)
    image = render(figure)
    checked = {True: 0, False: 0}
    for x, y in np.random.default_rng(0).uniform(0.3, SIZE_M - 0.3, (2000, 2)):
        near = {is_solid(x + dx, y + dy, yaw_rad) for dx in (-0.1, 0.0, 0.1) for dy in (-0.1, 0.0, 0.1)}
        if len(near) == 1:  # away from the edge
            solid = near.pop()
            expected = np.array(to_rgb(figures.SOLID if solid else "white")) * 255.0
            assert np.abs(pixel(image, axes, x, y) - expected).max() <= 2.0, (x, y)
            checked[solid] += 1
    assert min(checked.values()) > 100


@settings(max_examples=30)
@given(st.floats(0.0, 0.999), st.floats(0.1, 0.5))
def test_discs_are_drawn_where_the_lidar_sees_them_at_time_0(phase, radius):
    disc = np.array([[1.0, 1.0, 4.0, 3.0, radius, 0.4, phase, math.inf]])
    moving = World(bounds=(0.0, 0.0, SIZE_M, SIZE_M), discs=disc)
    (centre,) = moving.disc_centres(0.0)
    eye = np.array([6.0, 6.0])
    bearing = np.arctan2(*(centre - eye)[::-1])
    seen = _core.raycast(moving.native, np.array([[*eye, bearing]]), np.zeros(1), 20.0)
    assert seen[0, 0] == pytest.approx(np.linalg.norm(centre - eye) - radius, abs=1e-4)


def test_each_trajectory_is_drawn_point_by_point():
    ours = panel()
    (axes,) = figures.routes_figure([ours]).axes
    (drawn,) = coloured_lines(axes, figures.PALETTE[0])
    np.testing.assert_array_equal(drawn, ours.trajectories["adrl"])


def test_poses_and_positions_draw_the_same_line():
    positions = panel().trajectories["adrl"]
    poses = np.column_stack([positions, np.zeros(len(positions))])
    (axes,) = figures.routes_figure([panel(trajectories={"adrl": poses})]).axes
    np.testing.assert_array_equal(coloured_lines(axes, figures.PALETTE[0])[0], positions)


def test_a_policy_keeps_its_colour_in_panels_where_others_are_absent():
    line = panel().trajectories["adrl"]
    both = panel(trajectories={"astar-dwa": line, "adrl": line - [0.0, 1.0]})
    alone = panel(trajectories={"adrl": line - [0.0, 2.0]})
    first, second = figures.routes_figure([both, alone]).axes
    np.testing.assert_array_equal(coloured_lines(first, figures.PALETTE[1])[0], line - [0.0, 1.0])
    np.testing.assert_array_equal(coloured_lines(second, figures.PALETTE[1])[0], line - [0.0, 2.0])
    assert not coloured_lines(second, figures.PALETTE[0])


def test_six_panels_make_two_rows_of_three():
    drawn = figures.routes_figure([panel(title=str(i)) for i in range(6)])
    drawn.draw_without_rendering()
    boxes = [axes.get_position() for axes in drawn.axes]
    assert len({round(box.y0, 3) for box in boxes}) == 2
    assert len({round(box.x0, 3) for box in boxes}) == 3
    assert [axes.get_title(loc="left") for axes in drawn.axes] == list("012345")


def test_metres_are_as_long_in_x_as_in_y():
    drawn = figures.routes_figure([panel(), panel()])
    drawn.draw_without_rendering()
    for axes in drawn.axes:
        (x0, y0), (x1, y1) = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
        assert x1 - x0 == pytest.approx(y1 - y0)


@given(st.tuples(*[st.floats(-100.0, 100.0)] * 4))
@settings(max_examples=30)
def test_the_window_holds_all_of_the_route_and_of_a_world_not_much_larger(ends):
    wide = World(bounds=(-110.0, -110.0, 110.0, 110.0))
    line = np.array(ends).reshape(2, 2)
    start = (float(line[0, 0]), float(line[0, 1]), 0.0)
    goal = (float(line[1, 0]), float(line[1, 1]))
    route = RoutePanel(world=wide, start=start, goal=goal, trajectories={"adrl": line})
    (axes,) = figures.routes_figure([route]).axes
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    assert x0 < line[:, 0].min() <= line[:, 0].max() < x1
    assert y0 < line[:, 1].min() <= line[:, 1].max() < y1
    extent = np.ptp(line, axis=0).max()
    assert x1 - x0 < (1.05 * (extent + 2.0) if extent < 100.0 else 250.0)


def test_the_legend_names_what_is_drawn_and_nothing_else():
    disc = np.array([[1.0, 5.0, 3.0, 5.0, 0.3, 0.4, 0.0, math.inf]])

    def labels(*panels: RoutePanel) -> set[str]:
        return {text.get_text() for text in figures.routes_figure(panels).legends[0].get_texts()}

    assert labels(panel()) == {"adrl", "A* path", "start", "goal", "success"}
    plain = panel(path=None, endings={"adrl": "collision"}, world=world(discs=disc))
    assert labels(plain) == {"adrl", "start", "goal", "collision", "moving, at start"}


def test_equal_panels_give_equal_bytes_and_another_route_gives_others(tmp_path):
    other = panel(trajectories={"adrl": panel().trajectories["adrl"] - [0.0, 0.3]})
    for name, drawn in {"a": panel(), "b": panel(), "c": other}.items():
        figures.routes([drawn], tmp_path / "runs" / f"{name}.png")
    first, second, third = ((tmp_path / "runs" / f"{name}.png").read_bytes() for name in "abc")
    assert first == second != third


def test_no_panel_and_no_log_are_refused(tmp_path):
    with pytest.raises(ValueError, match="one panel or more"):
        figures.routes([], tmp_path / "a.png")
    with pytest.raises(ValueError, match="one run or more"):
        figures.learning_curve({}, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


# --- learning curve -------------------------------------------------------------------------------


def write_log(path, rows):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def log_rows(count=20, **constant):
    return [
        {
            "wall_s": 2.0 * i,
            "S": i / count,
            "alpha": 0.5 - 0.02 * i,
            "lambda_bc": 0.5 * 0.9**i,
            "success": None if i % 5 else 0.04 * i,
            **constant,
        }
        for i in range(count)
    ]


def by_title(figure: Figure) -> dict[str, Axes]:
    return {axes.get_title(loc="left"): axes for axes in figure.axes}


def points(axes: Axes) -> np.ndarray:
    """(points, 2) of the first line."""
    return np.asarray(axes.lines[0].get_xydata())


def test_the_curves_are_the_log_with_success_where_it_was_evaluated(tmp_path):
    rows = log_rows()
    drawn = by_title(figures.learning_curve_figure({"run": write_log(tmp_path / "m.jsonl", rows)}))
    expected = [(row["wall_s"], 100.0 * row["success"]) for row in rows if row["success"] is not None]
    np.testing.assert_allclose(points(drawn["success, %"]), expected)
    for title, key in {
        "maturity S": "S",
        "expert share alpha": "alpha",
        "imitation weight lambda_bc": "lambda_bc",
    }.items():
        np.testing.assert_allclose(points(drawn[title]), [(row["wall_s"], row[key]) for row in rows])


def test_nothing_logged_is_cut_off(tmp_path):
    log = write_log(tmp_path / "m.jsonl", log_rows(lambda_bc=2.5, S=-0.3))
    for axes in by_title(figures.learning_curve_figure({"run": log})).values():
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        x, y = points(axes).T
        assert x0 <= x.min() <= x.max() <= x1
        assert y0 <= y.min() <= y.max() <= y1


def test_a_method_without_imitation_has_panels_that_say_so(tmp_path):
    rows = [{"wall_s": float(i), "success": 0.5, "S": None} for i in range(3)]
    drawn = by_title(figures.learning_curve_figure({"td3": write_log(tmp_path / "m.jsonl", rows)}))
    for title, axes in drawn.items():
        said = [text.get_text() for text in axes.texts]
        assert said == ([] if title == "success, %" else ["not logged"])


def test_runs_have_their_own_colours_and_a_legend(tmp_path):
    log = write_log(tmp_path / "m.jsonl", log_rows())
    drawn = by_title(figures.learning_curve_figure({"seed 0": log, "seed 1": log}))
    legend = drawn["success, %"].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["seed 0", "seed 1"]
    for axes in drawn.values():
        assert [line.get_color() for line in axes.lines] == list(figures.PALETTE[:2])


def test_a_bad_log_writes_no_picture(tmp_path):
    good = write_log(tmp_path / "good.jsonl", log_rows())
    with pytest.raises(CheckpointError, match=r"bad\.jsonl"):
        figures.learning_curve({"a": good, "b": tmp_path / "bad.jsonl"}, tmp_path / "out.png")
    assert not (tmp_path / "out.png").exists()
    figures.learning_curve({"a": good}, tmp_path / "out.png")
    with Image.open(tmp_path / "out.png") as image:
        assert image.format == "PNG"
        assert image.width > 1000


def test_drawing_touches_no_global_state_and_result_files_need_no_matplotlib():
    code = (
        "import sys\n"
        "import adrl.evaluation.results, adrl.files, adrl.report.metrics_log\n"
        "assert not {'matplotlib', 'pyarrow', 'rich', 'scipy', 'jax', 'gymnasium'} & set(sys.modules)\n"
        "import adrl.report.figures\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
