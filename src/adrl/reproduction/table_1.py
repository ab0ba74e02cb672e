"""What section IV of the paper states of Table I, held against the kept episodes."""

from collections.abc import Callable, Mapping, Sequence

from adrl.reproduction.claims import (
    CONTRARY,
    REPRODUCES,
    UNDECIDED,
    UNMEASURED,
    WITHOUT,
    Claim,
    Verdict,
    judged,
)
from adrl.reproduction.pairs import EVALUATIONS, difference, pairs, untrained_rivals
from adrl.reproduction.reported import LABELS, OURS, PLANNER, RIVALS
from adrl.reproduction.results import Results

SIMPLE = "clutter"
"""The place that is not a complex environment."""
Driven = Mapping[str, tuple[str, str]]
"""Rival -> its method and guidance."""
_UNITS = {
    "success": "difference of success",
    "time_s": "s, on the tasks that both reached",
    "optimality": "path / shortest path, on the tasks that both reached",
}


def table_1(results: Results) -> list[Claim]:
    """The statements of the table, and ADRL's against planners that the paper does not have."""
    shared = ("td3bc", "sb3-sac", "sb3-ppo")
    return [
        *_of_others(results, shared),
        *_bests(results, PLANNER, *(name for name in RIVALS if name != OURS)),
        *_beside_the_paper(results),
        *_replanner(results),
        _all_metrics(_bests(results, *shared)),
    ]


def _of_others(results: Results, shared: Sequence[str]) -> list[Claim]:
    def claim(text: str, method: str, metric: str, higher: bool, *rivals: str) -> Claim:
        return _claim(results, text, method, metric, higher, rivals)

    slow, moderate = "td3bc", ("sb3-sac", "sb3-ppo")
    both = (PLANNER, OURS)
    return [
        claim("A*+DWA has a high success rate: above TD3+BC, SAC and PPO", PLANNER, "success", True, *shared),
        claim("A*+DWA has the longest navigation time", PLANNER, "time_s", True, *shared, OURS),
        claim("TD3+BC has a low success rate: below A*+DWA and ADRL", slow, "success", False, *both),
        claim("TD3+BC is slow: slower than SAC, PPO and ADRL", slow, "time_s", True, *moderate, OURS),
        *(
            claim(
                f"{LABELS[name]} has a moderate success rate: below A*+DWA and ADRL",
                name,
                "success",
                False,
                *both,
            )
            for name in moderate
        ),
        *(
            claim(
                f"{LABELS[name]} sacrifices efficiency: longer paths than A*+DWA, TD3+BC and ADRL",
                name,
                "optimality",
                True,
                PLANNER,
                slow,
                OURS,
            )
            for name in moderate
        ),
    ]


_BESTS = {
    "ADRL has the highest success rate": ("success", True),
    "ADRL has the shortest navigation time": ("time_s", False),
    "ADRL has the best path quality": ("optimality", False),
}
"""Statement -> metric, and whether more is better."""


def _bests(results: Results, *rivals: str) -> list[Claim]:
    return [_claim(results, text, OURS, *which, rivals) for text, which in _BESTS.items()]


def _beside_the_paper(results: Results) -> list[Claim]:
    """The same of ADRL against other planners, and planners on their own map; none where there were none of these."""

    def others(place: str, guidance: str) -> Driven:
        planners = untrained_rivals(results, place, guidance)
        return {name: driven for name, driven in planners.items() if name != PLANNER}

    found = []
    for text, (metric, higher) in _BESTS.items():
        verdicts = _verdicts(results, results.scenarios, OURS, metric, higher, others)
        if verdicts:
            found.append(
                Claim(
                    "Beside Table I",
                    f"{text}, also above planners that the paper does not have",
                    _UNITS[metric],
                    verdicts=verdicts,
                )
            )
    return found


def _claim(
    results: Results, text: str, method: str, metric: str, higher: bool, rivals: Sequence[str]
) -> Claim:
    """A verdict a place and evaluation, but for clutter: the paper's table is of complex environments."""
    complex_ones = [place for place in results.scenarios if place != SIMPLE] or results.scenarios
    places = [place for place in complex_ones if not results.lacks(place, {method, *rivals})]

    def driven(_: str, guidance: str) -> Driven:
        return {rival: _driven(rival, guidance) for rival in rivals}

    verdicts = _verdicts(results, places, method, metric, higher, driven)
    return Claim("Table I", text, _UNITS[metric], verdicts=verdicts)


def _verdicts(
    results: Results,
    places: Sequence[str],
    method: str,
    metric: str,
    higher: bool,
    rivals: Callable[[str, str], Driven],
) -> tuple[Verdict, ...]:
    """Of each place and evaluation with rivals(place, guidance), on the method's metric less each rival's."""
    verdicts = []
    for place in places:
        for guidance in results.about["scenarios"][place]["evaluated"]:
            own = _driven(method, guidance)
            less = {
                rival: difference(*pairs(results, place, own, driven)[metric])
                for rival, driven in rivals(place, guidance).items()
            }
            if less:
                verdicts.append(judged(f"{place}, {EVALUATIONS[guidance]}", less, higher=higher))
    return tuple(verdicts)


def _driven(method: str, guidance: str) -> tuple[str, str]:
    return method, "map" if method == PLANNER else guidance


def _replanner(results: Results) -> list[Claim]:
    """ADRL with the replanner against ADRL without it."""
    found = []
    for text, metric, higher in (
        ("The replanner raises ADRL's success rate", "success", True),
        ("The replanner makes ADRL more efficient: less time", "time_s", False),
        ("The replanner makes ADRL more efficient: shorter paths", "optimality", False),
    ):
        verdicts = []
        for scenario in results.scenarios:
            if not {"goal", "replan"} <= set(results.about["scenarios"][scenario]["evaluated"]):
                continue
            both = pairs(results, scenario, (OURS, "replan"), (OURS, "goal"))[metric]
            verdicts.append(judged(scenario, {WITHOUT: difference(*both)}, higher=higher))
        found.append(
            Claim("Table I", text, f"{_UNITS[metric]}, with less without it", verdicts=tuple(verdicts))
        )
    return found


def _all_metrics(bests: Sequence[Claim]) -> Claim:
    """A statement about every metric is refuted by one, and holds where all do."""
    verdicts = []
    for several in zip(*(claim.verdicts for claim in bests), strict=True):
        words = [verdict.word for verdict in several]
        worst = next((word for word in (CONTRARY, UNMEASURED, UNDECIDED) if word in words), REPRODUCES)
        verdicts.append(Verdict(several[0].place, worst, f"success, time and path: {', '.join(words)}"))
    text = "ADRL outperforms fixed BC (TD3+BC) and pure RL (SAC, PPO) in all metrics under identical training budgets"
    return Claim("IV.B", text, verdicts=tuple(verdicts))
