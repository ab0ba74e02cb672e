"""Tables of `adrl reproduce` as Markdown and JSON: Table I beside the paper's numbers, and what tells more."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from adrl import files
from adrl.evaluation.learning_time import STEADY_BAND, STEADY_ROWS, STEADY_SHARE, SUCCESSIVE
from adrl.evaluation.metrics import OVER_SUCCESSES
from adrl.report.reported import LABELS, SOURCE, TABLE_I, reported
from adrl.report.reproduction import Results, load
from adrl.report.reproduction_figures import figures, write_figures
from adrl.report.reproduction_numbers import HARD_SHARE, LEVELS, claims, summary_rows, table_rows

SCHEMA_VERSION = 1
TABLES_FILE, PAGE_FILE = "tables.json", "README.md"
CLAIMS_NOTE = (
    "Verdicts rank means or medians over seeds; the intervals above say whether one is more than noise."
)
GUIDANCE_NOTES = {
    "goal": "without replanner",
    "replan": "with replanner",
    "map": "known map",
}


def write_report(folder: Path) -> list[Path]:
    """Figures, tables.json and README.md of the results in a folder, from its files alone. Raises CheckpointError."""
    results = load(folder)
    tables = {scenario: table_rows(results, scenario) for scenario in results.scenarios}
    summaries = {scenario: summary_rows(results, scenario) for scenario in results.scenarios}
    verdicts = claims(results)
    files.write_json(
        folder / TABLES_FILE,
        {
            "schema_version": SCHEMA_VERSION,
            "paper": reported(),
            "table_1": [row for rows in tables.values() for row in rows],
            "methods": [row for rows in summaries.values() for row in rows],
            "claims": [{"sentence": c.sentence(), "holds": c.holds} for c in verdicts],
        },
    )
    lines = _head(results)
    lines += ["## Table I", "", *_table_1(results, tables)]
    lines += ["## Learning", "", *_summary(results, summaries)]
    lines += [
        "## What the paper says, and what is found here",
        "",
        CLAIMS_NOTE,
        "",
        *[f"- {c.sentence()}" for c in verdicts],
        "",
    ]
    lines += ["## Figures", "", *_figure_lines(results)]
    # The star of A*: two of them in a line would set what is between them in italics.
    files.atomic_write_text(folder / PAGE_FILE, "\n".join(lines).replace("*", r"\*"))
    return [folder / TABLES_FILE, folder / PAGE_FILE, *write_figures(results, folder)]


def _head(results: Results) -> list[str]:
    lines = ["# The paper's section IV, run again", ""]
    lines += [
        f"Made by `adrl reproduce --{results.about['preset']}`; this page and its figures come from the files here."
    ]
    lines += [
        "",
        "Every learned method has the same environment steps, test tasks, robot and vector environment.",
        "",
    ]
    for scenario, about in results.about["scenarios"].items():
        lines.append(f"- {about['title']}, {about['seeds']} seeds.")
        if missing := results.missing[scenario]:
            lines.append(
                f"  {len(missing)} of {len(about['jobs'])} runs are not in it yet: {', '.join(missing)}."
            )
    trainings = {(r["scenario"], r["method"], r["seed"]): r["train_seconds"] or 0.0 for r in results.runs}
    minutes = sum(trainings.values()) / 60.0
    return [*lines, "", f"Training took {minutes:.0f} min of one core in all, evaluation left out.", ""]


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
    lines += _markdown((*headings[:1], *(f"{h} (reported)" for h in headings[1:])), rows)
    for scenario, measured in tables.items():
        about = results.about["scenarios"][scenario]
        lines += [
            f"Measured on `{scenario}`, trained with guidance {about['guidance']}; in brackets 95 % intervals over "
            "seeds. Av.D, Av.T and optimality are means over each method's own successes: who fails the long tasks has "
            "short means. The last columns compare with A*+DWA: a method's mean / that of A*+DWA, both over the "
            "tasks that both reached, seed by seed.",
            "",
        ]
        wide = (*headings[:1], "evaluated", "seeds", *headings[1:])
        wide += ("Av.D m / A*+DWA", "Av.T s / A*+DWA", "optimality / A*+DWA", "common tasks")
        lines += _markdown(wide, [_measured_row(row) for row in measured])
    lines += [
        "Learned methods know no map: they see the final goal, and with the replanner waypoints on a map of their own "
        "scans, when they are stuck or know of an obstacle on the straight way. A*+DWA knows the map and its path "
        "leads into no dead end, so the replanner has nothing to change: its row stands for both.",
        "",
    ]
    return lines


def _measured_row(row: dict[str, Any]) -> list[str]:
    note = "known map, no replanner needed" if row["seeds"] is None else GUIDANCE_NOTES[row["guidance"]]
    cells = [
        LABELS[row["method"]],
        note,
        "-" if row["seeds"] is None else str(row["seeds"]),
        _cell(row, "distance_m", 2),
        _cell(row, "time_s", 2),
        _cell(row, "success", 3),
        _cell(row, "optimality", 2),
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
        lines += _markdown(headings, [_summary_row(row) for row in rows])
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
        LABELS[row["method"]],
        str(row["seeds"]),
        _cell(row, "success", 1, 100.0),
        _cell(row, "success_iqm", 1, 100.0),
        _cell(row, "hard_success", 1, 100.0),
        _cell(row, "improvement", 0, 100.0),
    ]
    for unit in ("seconds", "steps"):
        for level in LEVELS:
            name = round(100 * level)
            cells.append(_of_seeds(row[f"{unit}_to_{name}"], row[f"seeds_to_{name}"], row["seeds"]))
    cells.append(_of_seeds(row["episodes_to_steady"], row["seeds_to_steady"], row["seeds"]))
    return [*cells, _plain(row["train_seconds"], 0), _plain(row["gradient_updates"], 0)]


def _figure_lines(results: Results) -> list[str]:
    notes = {
        "fig4-ablations": "Fig. 4: mean Q of the ablations. Rewards differ, so levels of Q do not compare.",
        "fig5-methods": "Fig. 5: mean Q of the methods. PPO learns no Q: its curve is its value estimate V. SAC's Q "
        "includes its entropy bonus.",
        "fig6-convergence": "Fig. 6: episodes to steady-state mean Q, and steps to a level of success.",
        "success": "Success against environment steps and wall clock.",
        "promised-and-realised": "What each critic promises from the validation starts, and the return that came.",
        "survival": "Share of the seeds that have not reached a level of success.",
        "methods": "Interquartile mean, worst worlds, probability of improvement.",
    }
    return [
        f"![{notes.get(name, 'Fig. 7: routes of the first seed on the same tasks.')}]({name}.png)\n"
        for name in figures(results)
    ]


def _markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(headings) + " |", "|" + "-|" * len(headings)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def _cell(row: dict[str, Any], metric: str, decimals: int, scale: float = 1.0) -> str:
    value, low, high = (row[metric + end] for end in ("", "_low", "_high"))
    if value is None:
        return "-"
    text = f"{scale * value:.{decimals}f}"
    return text if low is None else f"{text} [{scale * low:.{decimals}f}, {scale * high:.{decimals}f}]"


def _plain(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _of_seeds(value: float | None, count: int, seeds: int) -> str:
    return f"{'>budget' if value is None else f'{value:.0f}'} ({count}/{seeds})"
