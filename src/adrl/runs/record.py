"""What a run says of itself: with its policy, and in its folder."""

import json
import math
import platform
from collections.abc import Mapping
from dataclasses import asdict, replace
from importlib import metadata
from typing import TYPE_CHECKING

from adrl.agents.methods import method_name
from adrl.deploy.policy import PolicyConfig
from adrl.deploy.training_worlds import training_worlds
from adrl.imitation import find_expert, recorded_worlds
from adrl.imitation.best_planner import Trial
from adrl.imitation.teachers import Taught
from adrl.simulators import NATIVE
from adrl.types import RobotConfig
from adrl.worlds.given import training_fingerprints

if TYPE_CHECKING:
    from adrl.runs.run import Run

PLANNER = "planner"
"""Entry of versions and of a policy's environment: what drove for the expert."""
TEACHERS = "teachers"
"""Entry of a policy's config.json: see Teacher.about; and of its environment, where each has a line."""
VERSIONED = ("adrl", "numpy", "jax", "jaxlib", "gymnasium", "safetensors")


def versions(planner: Trial | None = None) -> dict[str, str]:
    """What the run was made with; planner: how the planner of its demonstrations drove."""
    made = {"python": platform.python_version(), "machine": platform.machine()}
    made |= {name: metadata.version(name) for name in VERSIONED}
    return made if planner is None else made | {PLANNER: str(planner)}


def about_policy(
    run: "Run", planner: Trial | None = None, setup_seconds: Mapping[str, float] | None = None
) -> PolicyConfig:
    """What is saved with the policy; the learner fills in the sizes and what training took.

    planner: of the demonstrations. setup_seconds: wall clock of what came before the first update, told apart.
    """
    config, learner, name = run.config, run.learner, method_name(run.config.chosen_method)
    placed = config.placed_guidances
    places = ",".join(scenario.name for scenario in run.scenarios)
    settings = asdict(replace(config, robot=run.robot.name, guidance=",".join(placed)))
    settings |= {"demonstration_steps": run.demonstration_steps}
    settings |= {"method": name, "expert": str(find_expert(config.expert))}
    teachers = run.expert.teachers if isinstance(run.expert, Taught) else ()
    replans_as_printed = "replan" not in run.guidances or run.replanner == run.replanner.literal()
    return PolicyConfig(
        input_size=1,  # set by the learner, as is the next
        widths=learner.td3.widths,
        robot=asdict(run.robot) if isinstance(run.robot, RobotConfig) else {},
        family={} if isinstance(run.robot, RobotConfig) else asdict(run.robot),
        encoder=run.encoder.fields(),
        guidance=run.guidances[0],
        method=name,
        extra={
            "environment": {
                "scenario": places,
                **({"guidances": list(run.guidances)} if len(run.guidances) > 1 else {}),
                **({"placed_guidances": list(placed)} if placed != run.guidances else {}),
                "num_envs": config.num_envs,
                "task_pool": config.task_pool,
                "task_priority": config.task_priority,
                "randomize": config.randomize and config.env == NATIVE,
                **({"simulator": config.env} if config.env != NATIVE else {}),
                **({"fine_tune": str(config.fine_tune)} if config.fine_tune is not None else {}),
                **({PLANNER: planner.controller} if planner is not None else {}),
                **({TEACHERS: list(map(str, teachers))} if teachers else {}),
                **({"taken_as": asdict(run.taken_as)} if run.taken_as not in (None, run.robot) else {}),
                **({"stop_within_m": run.stop_within_m} if math.isfinite(run.stop_within_m) else {}),
                **_worlds(run),
                "replanner": asdict(run.replanner),
            },
            "run": run.folder.name,
            **({TEACHERS: [one.about for one in teachers]} if teachers else {}),
            # Of the weights that a replay shows; maturity None: the policy's own.
            "reward": {
                "constants": asdict(learner.reward)
                | {"extra_terms": list(map(str, learner.reward.extra_terms))},
                "maturity": None if learner.dynamic_reward else learner.static_maturity,
            },
            **(setup_seconds or {}),
            "scenario": places,
            "paper_literal": learner == learner.literal() and replans_as_printed,
            "settings": json.loads(json.dumps(settings, default=str)),
        },
    )


def _worlds(run: "Run") -> dict[str, list[str] | None]:
    """The entry that says which given worlds the policy has learned from, by fingerprint: None where a part of what it
    learns from does not say. No entry for a run that has drawn ones alone.
    """
    sources: list[set[str] | None] = [
        set[str]().union(*(training_fingerprints(scenario) for scenario in run.scenarios))
    ]
    if run.start is not None:
        sources.append(training_worlds(run.start.policy.config))
    if isinstance(run.expert, Taught):
        taught = [training_worlds(teacher.policy.config) for teacher in run.expert.teachers]
        sources += [worlds for worlds in taught if worlds != set()]
    if run.config.dataset is not None:
        sources.append(recorded_worlds(run.config.dataset))
    if sources == [set()]:
        return {}
    known = [worlds for worlds in sources if worlds is not None]
    return {"worlds": sorted(set().union(*known)) if len(known) == len(sources) else None}
