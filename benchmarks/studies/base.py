"""A base that bends below joint 1: pedestals of known stiffness, under loads and by own weight.

By name only: a loaded campaign on a pedestal takes some seconds; `--part 1/4` runs a quarter.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from benchmarks.report import Figure, Part, Section
from jointstiff import identify
from jointstiff.schemas.run import RunResult
from jointstiff.simulator import default_arm
from jointstiff.simulator.base import pedestal_campaign

__all__ = ["run"]

ARM = default_arm()
PEDESTALS = (5e7, 2e7, 8e6)
CAMPAIGNS, CLEAN = 20, 100
BEYOND = 3.0
"""Standard uncertainties beyond which the number of joint 2 is wrong."""


def run(*, quick: bool, part: Part) -> list[Section]:
    """Pedestals under loads and clean arms."""
    share = 0.1 if quick else 1.0
    seeds, clean = (part.of(max(1, int(share * count))) for count in (CAMPAIGNS, CLEAN))
    found = {
        stiffness: [_second(_result(pedestal_campaign(ARM, stiffness, seed=seed))) for seed in seeds]
        for stiffness in PEDESTALS
    }
    without = Counter(_model(_result(pedestal_campaign(ARM, float("inf"), seed=seed))) for seed in clean)
    return [_pedestals("Under loads", found), _clean(without)]


@dataclass(frozen=True)
class _Second:
    """Outcome of a run for joint 2."""

    model: str
    verdict: str
    off: float  # from the true compliance, in standard uncertainties
    covered: bool

    @property
    def harmful(self) -> bool:
        return self.verdict == "use" and self.off > BEYOND


def _result(document: dict[str, Any]) -> RunResult:
    result = identify(document).result
    if result is None:
        raise ValueError("the run failed")
    return result


def _model(result: RunResult) -> str:
    return "by own weight" if result.choice is None else result.choice.elasticity


def _second(result: RunResult) -> _Second:
    joint, truth = result.joints[1], float(ARM.compliances[1])
    verdict = joint.verdict if joint.verdict != "use" else result.assessment.verdict
    low, high = joint.compliance_interval or (0.0, float("inf"))
    off = 0.0
    if joint.compliance is not None and joint.standard_uncertainty is not None:
        off = abs(joint.compliance - truth) / joint.standard_uncertainty
    return _Second(_model(result), verdict, off, low <= truth <= high)


def _pedestals(title: str, found: dict[float, list[_Second]]) -> Section:
    rows, every = [], [each for campaigns in found.values() for each in campaigns]
    for stiffness, campaigns in found.items():
        models = Counter(each.model for each in campaigns)
        rows.append(
            (
                f"{stiffness:.0e} N·m/rad",
                ", ".join(f"{name} {count}" for name, count in models.items()),
                str(sum(each.verdict == "use" for each in campaigns)),
                str(sum(each.harmful for each in campaigns)),
                f"{max(each.off for each in campaigns):.2g} u",
                f"{100 * sum(each.covered for each in campaigns) / len(campaigns):.0f} %",
            )
        )
    covered = 100 * sum(each.covered for each in every) / len(every)
    harmful = sum(each.harmful for each in every)
    return Section(
        title=f"{title}: {len(every)} campaigns of an arm on a pedestal, joint 2",
        columns=("pedestal", "model", "use", f"use beyond {BEYOND:g} u", "worst", "held"),
        rows=tuple(rows),
        figures=(
            Figure(f"{title}: use with joint 2 beyond {BEYOND:g} u", harmful, "at most", 0),
            Figure(f"{title}: intervals of c₂ that hold the truth", covered, "at least", 93.0, " %"),
        ),
    )


def _clean(models: Counter[str]) -> Section:
    based = sum(count for name, count in models.items() if "base" in name)
    return Section(
        title=f"{models.total()} campaigns of the same arm on the floor",
        columns=("model", "campaigns"),
        rows=tuple((name, str(count)) for name, count in models.items()),
        figures=(Figure("clean arms with a base", 100 * based / models.total(), "at most", 1.0, " %"),),
    )
