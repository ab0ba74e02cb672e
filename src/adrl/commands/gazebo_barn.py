"""adrl gazebo barn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adrl import api, files
from adrl.commands.barn import BarnDrives, benchmark_task, trained_on
from adrl.commands.options import parse, write_document
from adrl.commands.progress import console, counting_bar
from adrl.evaluation.barn import BarnRuns, BenchmarkClock, reference_table, warning, world_table
from adrl.evaluation.kept import KeptEpisodes
from adrl.evaluation.onboard import Onboard
from adrl.evaluation.results import SCHEMA_VERSION, interval_entry, plain_table, write_table
from adrl.evaluation.statistics import clustered_rate
from adrl.integrations.gazebo import Gazebo
from adrl.integrations.gazebo.published import Published
from adrl.integrations.gazebo.skid_steer import COLD_SEED, JACKAL, cold_jackals
from adrl.outputs import require_file
from adrl.worlds import BarnScenario
from adrl.worlds.barn import START, BarnWorld
from adrl.worlds.given import fingerprint

if TYPE_CHECKING:
    from rich.table import Table

REACHED = 0.97
"""Success that a cold Jackal is asked for."""


@dataclass(frozen=True, kw_only=True)
class GazeboBarnOptions(BarnDrives):
    """Which Jackals drive, and where the results go."""

    cold: bool = False
    """Twelve Jackals that differ from the one that is known, and that nobody told the policy of: wheels, masses,
    friction, latency and the LiDAR's mount."""
    out: Path | None = None
    """Folder for the runs and summary.json. The same command again goes on where it was stopped."""


def main(arguments: Sequence[str]) -> int:
    """Drive the benchmark in Gazebo and print its tables."""
    options = parse(
        GazeboBarnOptions,
        arguments,
        "gazebo barn",
        "Drive a policy in the published worlds of the BARN navigation benchmark in Gazebo, with a Jackal on four "
        "driven wheels, and the benchmark's clock and score: success * OT / clip(AT, 2 OT, 8 OT), at most 0.5.",
    )
    require_file("--json", options.json)
    policy, robot, v_max_mps = options.driver()
    scenario = BarnScenario(options.worlds, options.held_out)
    worlds = scenario.split("test")
    jackals = cold_jackals() if options.cold else (JACKAL,)
    guidance = policy.require_guidance(options.guidance)
    driver = policy
    if not policy.knows_the_world:
        driver = replace(policy, policy=Onboard(policy, robot, guidance), plans_itself=True)
    about = {
        "policy": policy.name,
        "policy_fingerprint": policy.fingerprint,
        "guidance": guidance,
        "simulator": "gazebo",
        "v_max_mps": v_max_mps,
        "seed": options.seed,
        "trials": options.trials,
        "cold_seed": COLD_SEED if options.cold else None,
    }
    pairs = [(world, jackal) for world in worlds for jackal in jackals]
    with (
        KeptEpisodes(
            options.out,
            about | {"jackals": [jackal.numbers() for jackal in jackals], "worlds": _digest(worlds)},
        ) as kept,
        counting_bar(f"driving {options.policy}", "runs") as show,
    ):
        for i, (world, jackal) in enumerate(pairs):
            name = f"{jackal.name}-world_{world.number}"
            if kept.has(name):
                continue
            assert world.file is not None
            clock = BenchmarkClock()
            place = Published(file=world.file, world=world.world, base=jackal, start=START)
            done = i * options.trials
            result = api.evaluate(
                driver,
                scenario=scenario,
                robot=robot,
                guidance=guidance,
                seed=options.seed,
                tasks=[benchmark_task(scenario, world, robot)] * options.trials,
                make_body=partial(Gazebo, published=place),
                on_drive=clock,
                on_step=lambda ended, _, done=done: show(done + ended, len(pairs) * options.trials),
            )
            kept.keep(name, clock.timed(result.rollout.episodes))
        runs = {
            jackal: BarnRuns(
                worlds=worlds,
                episodes=kept.by_trial([f"{jackal.name}-world_{world.number}" for world in worlds]),
                trained_on=trained_on(policy, worlds),
            )
            for jackal in jackals
        }
        summary = {"schema_version": SCHEMA_VERSION, **about, "held_out": options.held_out}
        summary |= {"trained_on_known": policy.training_worlds is not None}
        summary["jackals"] = [jackal.numbers() | _summary(own) for jackal, own in runs.items()]
        if options.out is not None:
            files.write_json(options.out / "summary.json", summary)
            for jackal, own in runs.items():
                write_table(options.out / f"{jackal.name}.parquet", own.to_table())
    _show(summary, cold=options.cold)
    write_document(options.json, summary)
    return 0


def _digest(worlds: Sequence[BarnWorld]) -> str:
    """Of what Gazebo opens, by number: the file, as its physics count too, and what stands there."""
    parts = sha256()
    for world in worlds:
        assert world.file is not None
        parts.update(f"{world.number} {fingerprint(world.world)} ".encode())
        parts.update(sha256(world.file.read_bytes()).digest())
    return parts.hexdigest()[:16]


def _summary(runs: BarnRuns) -> dict[str, Any]:
    """BarnRuns.summary with an interval of success that is not void where every run succeeds: Wilson's, which allows
    for how much worlds differ."""
    successes = np.rint(runs.by_world(runs.episodes.success) * runs.trials)
    interval = clustered_rate(successes, np.full(len(successes), runs.trials))
    return runs.summary() | interval_entry("success", interval)


def _show(summary: Mapping[str, Any], *, cold: bool) -> None:
    first = summary | summary["jackals"][0]
    if cold:
        console().print(_jackals_table(summary))
        reached = sum(jackal["success"] >= REACHED for jackal in summary["jackals"])
        console().print(
            f"{reached} of {len(summary['jackals'])} Jackals succeed in {REACHED:.0%} of their runs"
        )
    else:
        console().print(world_table(first))
        console().print(reference_table(first))
    if (line := warning(first)) is not None:
        console().print(line, style="bold", markup=False, highlight=False)


def _jackals_table(summary: Mapping[str, Any]) -> "Table":
    """A row a Jackal: how it differs, and how it drove."""
    jackals = summary["jackals"]
    table = plain_table(
        f"{summary['policy']}, guidance {summary['guidance']}, v_max {summary['v_max_mps']:g} m/s, "
        f"{jackals[0]['worlds']} worlds, trials a world: {summary['trials']}"
    )
    headings = (
        "wheels\nmm",
        "track\nmm",
        "chassis\nkg",
        "friction\n",
        "latency\ns",
        "LiDAR off by\nmm, degrees",
    )
    for heading in ("Jackal\n", *headings, "success\n%", "collision\n%", "score\n"):
        table.add_column(heading, justify="right")
    for one in jackals:
        table.add_row(
            one["name"],
            f"{1e3 * one['left_radius_m']:.0f}, {1e3 * one['right_radius_m']:.0f}",
            f"{1e3 * one['track_m']:.0f}",
            f"{one['chassis_kg']:.1f}",
            f"{one['friction']:.2f}",
            f"{one['latency_s']:.3f}",
            f"{1e3 * one['mount_x_m']:.0f}, {1e3 * one['mount_y_m']:.0f}, {np.degrees(one['mount_yaw_rad']):.1f}",
            f"{100 * one['success']:.1f} [{100 * one['success_low']:.1f}, {100 * one['success_high']:.1f}]",
            f"{100 * one['collision']:.1f}",
            f"{one['score']:.3f}",
        )
    return table
