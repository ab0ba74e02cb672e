"""What RViz and Foxglove are shown, over the middleware of either generation."""

import pytest

from integrations.ros_processes import Ros, is_idle

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.integration]


def test_who_looks_is_shown_waypoint_plan_words_and_the_robots_own_map(ros: Ros) -> None:
    ros.node("sim", "--scenario", "clutter", "--speed", "2")
    ros.node("drive", "--guidance", "replan")
    probe = ros.probe("adrl/markers", "adrl/map")
    probe.wait(is_idle)
    idle = probe.events[probe.wait(lambda e: e["topic"] == "markers" and e["text"] == "idle")]
    assert list(idle["frames"]) == ["status"]
    first = probe.order(goal=(6.0, 0.0), frame="odom")
    shown = probe.events[probe.wait(lambda e: e["topic"] == "markers" and "plan" in e["frames"], first)]
    assert {"plan", "waypoint", "status"} <= set(shown["frames"])
    assert set(shown["frames"].values()) == {"odom"}
    assert shown["points"]["plan"][-1] == pytest.approx((6.0, 0.0))
    assert "on the way to (6.00, 0.00)" in shown["text"]
    seen = probe.events[probe.wait(lambda e: e["topic"] == "map" and 100 in e["cells"], first)]
    (width, height), (x, y), cell_m = seen["size"], seen["corner"], seen["cell_m"]
    assert (seen["frame"], len(seen["cells"])) == ("odom", width * height)
    assert x < 0.0 < x + width * cell_m
    assert y < 0.0 < y + height * cell_m
    here = round(-y / cell_m) * width + round(-x / cell_m)
    assert seen["cells"][here] in (0, -1), "where the robot began nothing stands"
    assert set(seen["cells"]) <= {-1, 0, 100}
