"""Tables of `adrl reproduce` as Markdown and JSON: Table I beside the paper's numbers, and what tells more."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from adrl import files
from adrl.evaluation.learning_time import STEADY_BAND, STEADY_ROWS, STEADY_SHARE, SUCCESSIVE
from adrl.evaluation.metrics import OVER_SUCCESSES
from adrl.report.markdown import cell, of_seeds, plain, table
from adrl.reproduction.claims import Claim
from adrl.reproduction.figures import figures, write_figures
from adrl.reproduction.numbers import HARD_SHARE, LEVELS, success_rows, summary_rows, table_rows
from adrl.reproduction.pairs import EVALUATIONS, PAIRED, Criterion, criteria, paired_rows
from adrl.reproduction.reported import LABELS, SOURCE, TABLE_I, label, reported
from adrl.reproduction.results import Results, load
from adrl.reproduction.run import run_lines
from adrl.reproduction.statements import claims

SCHEMA_VERSION = 2
TABLES_FILE, PAGE_FILE = "tables.json", "README.md"
ENOUGH_SEEDS = 10
"""Seeds from which on a verdict says something."""
CLAIMS_NOTE = (
    "Each statement of section IV, in words that can be measured. The training seed is the unit: seed s of one "
    "method is paired with seed s of the other, and the numbers are means of the differences with 95 % bootstrap "
    "intervals over these pairs. A statement reproduces if the intervals against all rivals it names lie on its side "
    "of 0, does not reproduce if one lies on the other side, and is undecided otherwise. Intervals are not widened "
    "for the number of statements: of twenty that are true of nothing, about one is decided by chance."
)


def write_report(folder: str | os.PathLike[str]) -> list[Path]:
    """Figures, tables.json and README.md of the results in a folder, from its files alone. Raises CheckpointError."""
    folder = Path(folder)
    results = load(folder)
    tables = {scenario: table_rows(results, scenario) for scenario in results.scenarios}
    summaries = {scenario: summary_rows(results, scenario) for scenario in results.scenarios}
    success = {scenario: success_rows(results, scenario) for scenario in results.scenarios}
    paired = {scenario: paired_rows(results, scenario) for scenario in results.scenarios}
    asked = [found for scenario in results.scenarios for found in criteria(results, scenario)]
    verdicts = claims(results)
    files.write_json(
        folder / TABLES_FILE,
        {
            "schema_version": SCHEMA_VERSION,
            "paper": reported(),
            "table_1": _joined(tables),
            "success": _joined(success),
            "pairs": _joined(paired),
            "methods": _joined(summaries),
            "criteria": [asdict(found) | {"sentence": found.sentence()} for found in asked],
            "claims": [claim.document() for claim in verdicts],
        },
    )
    lines = _head(results)
    lines += ["## ADRL against its baselines", "", *_against(asked, paired)]
    lines += ["## Success of every method", "", *_success(results, success)]
    lines += ["## Table I", "", *_table_1(results, tables)]
    lines += ["## Learning", "", *_summary(results, summaries)]
    lines += ["## What the paper says, and what is found here", "", *_claims(results, verdicts)]
    lines += ["## Figures", "", *_figure_lines(results)]
    # The star of A*: two of them in a line would set what is between them in italics.
    files.atomic_write_text(folder / PAGE_FILE, "\n".join(lines).replace("A*", r"A\*"))
    return [folder / TABLES_FILE, folder / PAGE_FILE, *write_figures(results, folder)]


def _joined(rows: dict[str, list[dict[str, Any]]]) -> list[dict[str, Any]]:
    return [row for some in rows.values() for row in some]


def _head(results: Results) -> list[str]:
    lines = ["# The paper's section IV, run again", ""]
    lines += [
        f"Made by `adrl reproduce --{results.about['preset']}`; this page and its figures come from the files here.",
        "",
        *run_lines(results),
        "Every learned method of a place has the same environment steps, test tasks, robot and vector environment.",
        "",
    ]
    for place, about in results.about["scenarios"].items():
        lines.append(f"- `{place}`: {about['title']}, {about['seeds']} seeds.")
        if missing := results.missing[place]:
            lines.append(
                f"  {len(missing)} of {len(about['jobs'])} runs are not in it yet: {', '.join(missing)}."
            )
    return [*lines, ""]


def _against(asked: Sequence[Criterion], paired: dict[str, list[dict[str, Any]]]) -> list[str]:
    lines = [
        "Asked is that ADRL's mean success is above every baseline's with 95 % intervals that do not overlap, and "
        "that its time and optimality are no worse than A*+DWA's. Of each planner it is asked, too, that ADRL is above "
        "it in success or in time and no worse in the other. After each method: its success, and by how many points "
        "ADRL's is above it, seed by seed.",
        "",
        *[f"- {found.sentence()}" for found in asked],
        "",
        "Why it is so, as far as it is known, is in docs/reproduce.md.",
        "",
        "ADRL less each other method, seed s paired with seed s, with 95 % bootstrap intervals over the pairs; "
        "distance, time and optimality on the tasks that both reached. Below 0 ADRL has less: fewer successes, "
        "shorter paths, less time. Planners drive on the known map in all evaluations, and on their own map beside the "
        "replanner. Two intervals that do not overlap ask for "
        "more than one of the difference that leaves out 0.",
        "",
    ]
    headings = (
        "ADRL less",
        "ADRL evaluated",
        "pairs",
        "success, points",
        "Av.D m",
        "Av.T s",
        "optimality",
        "common tasks",
    )
    for scenario, rows in paired.items():
        lines += [f"`{scenario}`:", ""]
        cells = [
            [
                label(row["rival"]),
                EVALUATIONS[row["guidance"]],
                str(row["seeds"]),
                *(
                    cell(row, metric, decimals, scale, "+")
                    for metric, (decimals, scale) in zip(
                        PAIRED, ((1, 100.0), (2, 1.0), (2, 1.0), (3, 1.0)), strict=True
                    )
                ),
                f"{row['common_tasks']:.0f}",
            ]
            for row in rows
        ]
        lines += table(headings, cells)
    return lines


def _success(results: Results, success: dict[str, list[dict[str, Any]]]) -> list[str]:
    lines = [
        "In per cent of the test tasks, mean over seeds with its 95 % bootstrap interval over seeds; what the "
        "replanner adds is the mean of the differences, seed by seed. Freed: of the tasks that ran out of time "
        "without the replanner, the share that the same policy reached with it. Planners have no seeds: their "
        "intervals are Wilson's over the tasks. They drive on the known map, and in place of the replanner on a map of "
        "their own scans; one that cannot has the same number in both.",
        "",
    ]
    for place, rows in success.items():
        evaluated = results.about["scenarios"][place]["evaluated"]
        headings = ["method", "seeds"]
        for guidance in evaluated:
            headings += [f"{what}, %" for what in (f"success {EVALUATIONS[guidance]}", *_ENDINGS)]
        headings += ["replanner adds, points", "freed, %"]
        lines += [f"`{place}`:", "", *table(headings, [_success_cells(row, evaluated) for row in rows])]
    return lines


_ENDINGS = ("collision", "timeout")


def _success_cells(row: dict[str, Any], evaluated: Sequence[str]) -> list[str]:
    cells = [label(row["method"]), "-" if row["seeds"] is None else str(row["seeds"])]
    for guidance in evaluated:
        if row["seeds"] is None and f"success_{guidance}" not in row:
            guidance = "map"  # a planner's one evaluation stands for both
        known = f"success_{guidance}" in row
        cells.append(cell(row, f"success_{guidance}", 1, 100.0) if known else "-")
        shares = [row[f"{ending}_{guidance}"] if known else None for ending in _ENDINGS]
        cells += ["-" if share is None else f"{100.0 * share:.1f}" for share in shares]
    cells.append(cell(row, "gain", 1, 100.0, "+") if "gain" in row else "-")
    return [*cells, cell(row, "freed", 1, 100.0) if "freed" in row else "-"]


def _claims(results: Results, verdicts: Sequence[Claim]) -> list[str]:
    words = Counter(verdict.word for claim in verdicts for verdict in claim.verdicts)
    unjudged = sum(bool(claim.why_not) for claim in verdicts)
    counted = ", ".join(f"{word} {count}" for word, count in words.most_common())
    lines = [
        CLAIMS_NOTE,
        "",
        f"{len(verdicts)} statements: {unjudged} not judged; verdicts on the others: {counted}.",
    ]
    for place in results.scenarios:
        if (seeds := results.about["scenarios"][place]["seeds"]) < ENOUGH_SEEDS:
            lines.append(
                f"`{place}`: {seeds} seeds are too few for verdicts to say anything; it takes {ENOUGH_SEEDS}."
            )
    return [*lines, "", *(f"- {claim.sentence()}" for claim in verdicts), ""]


def _table_1(results: Results, tables: dict[str, list[dict[str, Any]]]) -> list[str]:
    lines = [f"First the paper's numbers as reported ({SOURCE}); they were not measured here.", ""]
    headings = ("method", "Av.D m", "Av.T s", "success", "optimality")
    rows = [
        [
            LABELS[name],
            f"{row['distance_m']:.2f}",
            f"{row['time_s']:.2f}",
            f"{row['success']:.2f}",
            f"{row['optimality']:.2f}",
        ]
        for name, row in TABLE_I.items()
    ]
    lines += table((*headings[:1], *(f"{h} (reported)" for h in headings[1:])), rows)
    for scenario, measured in tables.items():
        about = results.about["scenarios"][scenario]
        lines += [
            f"Measured on `{scenario}`, trained with guidance {about['guidance']}; in brackets 95 % bootstrap "
            f"intervals over seeds; of A*+DWA, which has none, over the tasks (success: Wilson's). Av.D, Av.T and "
            f"optimality are means over each method's own successes: who fails the long tasks has short means. The "
            f"last columns compare with A*+DWA: a method's mean / that of A*+DWA, both over the tasks that both "
            f"reached, seed by seed.",
            "",
        ]
        wide = (*headings[:1], "evaluated", "seeds", *headings[1:])
        wide += ("Av.D m / A*+DWA", "Av.T s / A*+DWA", "optimality / A*+DWA", "common tasks")
        lines += table(wide, [_measured_row(row) for row in measured])
    lines += [
        "Without the replanner learned methods see the final goal alone, and with it waypoints on a map of their own "
        "scans, when they are stuck or know of an obstacle on the straight way; on the known map they see a waypoint "
        "on its A* path. A planner that knows the map has a path that leads into no dead end, so the replanner has "
        "nothing to change: its row stands for both. Without the map a planner plans on what it has scanned.",
        "",
    ]
    return lines


def _measured_row(row: dict[str, Any]) -> list[str]:
    on_its_own_map = row["seeds"] is None and row["guidance"] == "replan"
    note = "on a map of its own scans" if on_its_own_map else EVALUATIONS[row["guidance"]]
    cells = [
        label(row["method"]),
        note,
        "-" if row["seeds"] is None else str(row["seeds"]),
        cell(row, "distance_m", 2),
        cell(row, "time_s", 2),
        cell(row, "success", 3),
        cell(row, "optimality", 2),
    ]
    if row["seeds"] is None or row["common_tasks"] is None:
        return [*cells, *["-"] * 4]
    pairs = [(row[f"{metric}_common"], row[f"reference_{metric}_common"]) for metric in OVER_SUCCESSES]
    return [*cells, *(f"{own:.2f} / {planner:.2f}" for own, planner in pairs), f"{row['common_tasks']:.0f}"]


def _summary(results: Results, summaries: dict[str, list[dict[str, Any]]]) -> list[str]:
    lines = []
    for scenario, rows in summaries.items():
        headings = [
            "method",
            "seeds",
            "success %",
            "IQM %",
            f"worst {100 * HARD_SHARE:.0f} % of worlds %",
            "ADRL better %",
        ]
        headings += [f"s to {100 * level:.0f} %" for level in LEVELS]
        headings += [f"steps to {100 * level:.0f} %" for level in LEVELS]
        headings += ["episodes to steady Q", "training s", "updates"]
        lines += [f"`{scenario}`, evaluated with guidance {results.trained_with(scenario)} as trained:", ""]
        lines += table(headings, [_summary_row(row) for row in rows])
    lines += [
        f"Worst worlds: the {100 * HARD_SHARE:.0f} % of the test tasks that all methods together solve least, the same "
        "for each. Times and steps to a success: median over seeds of the last of "
        f"{SUCCESSIVE} validations in a row, in brackets how many seeds got there. Episodes to steady Q (Fig. 6): mean "
        f"Q, smoothed by a trailing mean of {STEADY_ROWS} rows of the log, from then on stays within "
        f"{100 * STEADY_BAND:.0f} % of its range of its level, the mean of its last {100 * STEADY_SHARE:.0f} %. It "
        "says when a curve is flat, not how good the policy is.",
        "",
    ]
    return lines


def _summary_row(row: dict[str, Any]) -> list[str]:
    cells = [
        label(row["method"]),
        str(row["seeds"]),
        cell(row, "success", 1, 100.0),
        cell(row, "success_iqm", 1, 100.0),
        cell(row, "hard_success", 1, 100.0),
        cell(row, "improvement", 0, 100.0),
    ]
    for unit in ("seconds", "steps"):
        for level in LEVELS:
            name = round(100 * level)
            cells.append(of_seeds(row[f"{unit}_to_{name}"], row[f"seeds_to_{name}"], row["seeds"]))
    cells.append(of_seeds(row["episodes_to_steady"], row["seeds_to_steady"], row["seeds"]))
    return [*cells, plain(row["train_seconds"], 0), plain(row["gradient_updates"], 0)]


def _figure_lines(results: Results) -> list[str]:
    notes = {
        "fig4-ablations": "Fig. 4: mean Q of the ablations. Rewards differ, so levels of Q do not compare.",
        "fig5-methods": "Fig. 5: mean Q of the methods. PPO learns no Q: its curve is its value estimate V. SAC's Q "
        "includes its entropy bonus.",
        "fig6-convergence": "Fig. 6: episodes to steady-state mean Q, and steps to a level of success.",
        "success": "Success against environment steps and wall clock.",
        "promised-and-realised": "What each critic promises from the validation starts, and the return that came.",
        "survival": "Share of the seeds that have not reached a level of success.",
        "methods": "Interquartile mean without and with the replanner, worst worlds, probability of improvement.",
    }
    return [
        f"![{notes.get(name, 'Fig. 7: routes of the first seed on the same tasks.')}]({name}.png)\n"
        for name in figures(results)
    ]
