"""Every number of a configuration has a range, which its docstring and its error name."""

import ast
import dataclasses
import inspect
import math
import textwrap
from typing import Annotated, Any, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.agents.config import Td3Config, TrainConfig
from adrl.deploy.supervisor import SupervisorConfig
from adrl.errors import ConfigError
from adrl.imitation.demonstrations import NoiseConfig
from adrl.imitation.schedule import ScheduleConfig
from adrl.observation.config import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.ranges import Range, check_ranges, ranges, switches
from adrl.rewards.config import RewardConfig
from adrl.runs import RunConfig
from adrl.types import LidarConfig, RobotConfig

CONFIGS = (
    LidarConfig,
    RobotConfig,
    EncoderConfig,
    ReplannerConfig,
    RewardConfig,
    NoiseConfig,
    ScheduleConfig,
    Td3Config,
    TrainConfig,
    RunConfig,
    SupervisorConfig,
)
EVERY_CONFIG = pytest.mark.parametrize("kind", CONFIGS, ids=lambda kind: kind.__name__)
NUMBERS = [(kind, name, span) for kind in CONFIGS for name, (span, _, _) in ranges(kind).items()]


def docstrings(kind: type) -> dict[str, str]:
    """Field -> the text below it, those of the classes that it adds to included."""
    bodies = [
        ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        for base in reversed(kind.__mro__)
        if dataclasses.is_dataclass(base)
    ]
    return {
        field.target.id: " ".join(text.value.value.split())
        for body in bodies
        if isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


@EVERY_CONFIG
def test_every_number_has_a_range(kind: type) -> None:
    hints = get_type_hints(kind)
    numbers = {name for name, hint in hints.items() if hint in (int, float, int | None, float | None)}
    assert numbers == set(ranges(kind))


@EVERY_CONFIG
def test_the_docstring_says_the_range(kind: type) -> None:
    texts = docstrings(kind)
    for name, (span, _, _) in ranges(kind).items():
        assert str(span) in texts[name], f"{kind.__name__}.{name}: {span}"


@pytest.mark.parametrize(
    ("kind", "name", "span"), NUMBERS, ids=lambda value: getattr(value, "__name__", str(value))
)
def test_what_is_outside_is_refused_with_field_and_range(kind: Any, name: str, span: Range) -> None:
    whole = ranges(kind)[name][1]
    outside = [
        span.low - 1,
        span.high + max(1, abs(span.high)),
        math.nan,
        math.inf,
        -math.inf,
        "1",
        True,
    ]
    outside += [10**5000] if span.high < math.inf else []
    for value in [*outside, 0.5] if whole else outside:
        with pytest.raises(ConfigError) as caught:
            kind(**{name: value})
        assert name in str(caught.value)
        assert str(span) in str(caught.value)
        assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in CONFIGS for name in switches(kind)], ids=str
)
def test_what_is_on_or_off_is_nothing_else(kind: Any, name: str) -> None:
    for value in ("no", 0, None, math.nan):
        with pytest.raises(ConfigError, match=f"{name} is .*; give True or False"):
            kind(**{name: value})


@dataclasses.dataclass(frozen=True)
class _Sample:
    share: Annotated[float, Range(0.25, 0.5)] = 0.25


@given(value=st.floats())
def test_all_numbers_from_low_to_high_pass_and_no_others(value: float) -> None:
    if 0.25 <= value <= 0.5:
        check_ranges(_Sample(value), "sample.")
    else:
        with pytest.raises(ConfigError, match=r"sample\.share is .*; give 0\.25 to 0\.5"):
            check_ranges(_Sample(value), "sample.")
