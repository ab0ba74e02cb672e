"""Who shows a run how to drive: its expert, and the teachers that fit it."""

import math
from collections.abc import Iterator, Sequence

from adrl.deploy.another_robot import outside_family, robot_differences
from adrl.deploy.training_worlds import training_worlds
from adrl.errors import ConfigError
from adrl.imitation import Expert, find_expert
from adrl.imitation.teachers import Taught, Teacher, tasks_of
from adrl.registry import listed_option
from adrl.runs.config import RunConfig
from adrl.types import RobotConfig, Scenario
from adrl.worlds import RobotFamily
from adrl.worlds.given import training_fingerprints


def expert_of(
    config: RunConfig,
    scenarios: Sequence[Scenario],
    robot: RobotConfig | RobotFamily,
    taken_as: RobotConfig | None,
) -> Expert:
    """The expert of a run, taught where it has teachers. Raises AdrlError, also where one sees something else.

    taken_as: the robot as the run's policy takes it, see Run; None for a family.
    """
    expert = find_expert(config.expert)
    if not config.teachers:
        return expert
    if getattr(expert, "drives", None) is not None:
        raise ConfigError(f"expert {expert} shows no more than its drives, and teachers would; leave one out")
    teachers = []
    for name in listed_option("teachers", config.teachers):
        teacher = Teacher.of(name)
        for wrong in _unfit(teacher, config, scenarios, robot, taken_as):
            raise ConfigError(f"teacher {name!r} {wrong}")
        teachers.append(teacher)
    return Taught(expert, tuple(teachers))


def _unfit(
    teacher: Teacher,
    config: RunConfig,
    scenarios: Sequence[Scenario],
    robot: RobotConfig | RobotFamily,
    taken_as: RobotConfig | None,
) -> Iterator[str]:
    """What speaks against a teacher."""
    setup = teacher.setup
    own = tasks_of([scenario.name for scenario in scenarios], config.placed_guidances) & teacher.tasks
    if not own:
        yield (
            f"was trained in {', '.join(teacher.taught)}, and the run has none of these; leave it out, or give its "
            "scenario (of people, with the same --people) and guidance"
        )
    stop_within_m = math.inf if config.stop_within_m is None else config.stop_within_m
    if setup.stop_within_m != stop_within_m:
        yield (
            f"was trained with stop_within_m {setup.stop_within_m:g}, and the run has {stop_within_m:g}; train both "
            "with the same"
        )
    pairs = [("encoder", setup.encoder.fields(), config.encoder.fields())]
    if any(guidance == "replan" for _, guidance in own):
        pairs.append(("replanner", vars(setup.replanner), vars(config.resolved_replanner())))
    for options, its, ours in pairs:
        for field in (field for field in ours if its[field] != ours[field]):
            yield (
                f"was trained with {options}.{field} {its[field]}, and the run has {ours[field]}; train both with the "
                "same"
            )
    yield from _other_robot(teacher, robot, taken_as)
    worlds = training_worlds(teacher.policy.config)
    for scenario in scenarios:
        if scenario.name not in {place for place, _ in own}:
            continue
        if worlds is None and training_fingerprints(scenario):
            yield "does not say in which worlds it was trained; train it anew"
        elif worlds is not None and not training_fingerprints(scenario) <= worlds:
            yield f"was trained in another world that is called {scenario.name}, too; train it in this one"


def _other_robot(
    teacher: Teacher, robot: RobotConfig | RobotFamily, taken_as: RobotConfig | None
) -> Iterator[str]:
    family, trained = teacher.setup.family, teacher.setup.robot
    if isinstance(robot, RobotFamily):
        if family != robot:
            yield f"was not trained for all robots of family {robot.name}; train both with the same --robot"
    elif trained is not None:
        if different := robot_differences(robot, trained):
            yield f"was trained for another robot, with {', '.join(different[:3])}; train both with the same --robot"
    elif family is not None and (outside := outside_family("of it", family, robot)) is not None:
        yield f"does not know the robot: {outside}; train both with the same --robot"
    if isinstance(robot, RobotConfig) and taken_as is not None:  # of one robot there always is
        different = robot_differences(taken_as, teacher.setup.taken_as(robot))
        if different:
            yield (
                f"takes the robot for another than the run does, with {', '.join(different[:3])}; begin both with the "
                "same --fine-tune, or with none"
            )
