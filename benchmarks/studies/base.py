"""A base that bends below joint 1, links that bend like one, and a mass that is wrong.

By name only: a loaded campaign on a pedestal takes some seconds; `--part 1/4` runs a quarter.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff import identify
from jointstiff.schemas.run import RunResult
from jointstiff.simulator import default_arm
from jointstiff.simulator.base import pedestal_campaign
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.simulator.own_weight import default_bodies, unloaded_campaign

__all__ = ["run"]

ARM = default_arm()
PEDESTALS = (5e7, 2e7, 8e6)
CAMPAIGNS, CLEAN = 20, 100
MASSES, LOADED, PAYLOAD = 60, 20, 100.0
BEAMS, BEAM_STIFFNESS = 20, (1e7, 6e7)
BODIES, WITHIN = default_bodies(), 0.1
BEYOND = 3.0
"""Standard uncertainties beyond which the number of joint 2 is wrong."""


@dataclass(frozen=True)
class _Beams:
    stiffness: float  # E I of all beams [N·m²]
    model: str
    codes: list[str]
    held: list[bool | None]  # whether each joint's interval contains the truth; None without an interval


def run(*, quick: bool, part: Part) -> list[Section]:
    """Pedestals under loads and by own weight, clean arms, and masses that are wrong."""
    share = 0.1 if quick else 1.0
    seeds, clean = (part.of(max(1, int(share * count))) for count in (CAMPAIGNS, CLEAN))
    found = {
        stiffness: [_second(_result(pedestal_campaign(ARM, stiffness, seed=seed))) for seed in seeds]
        for stiffness in PEDESTALS
    }
    without = Counter(_model(_result(pedestal_campaign(ARM, float("inf"), seed=seed))) for seed in clean)
    by_weight = {
        stiffness: [_second(_result(_unloaded(seed, pedestal=stiffness))) for seed in seeds]
        for stiffness in PEDESTALS
    }
    masses = part.of(max(1, int(share * MASSES)))
    beams = part.of(max(1, int(share * BEAMS)))
    return [
        _beams([_bent(seed) for seed in beams]),
        _pedestals("Under loads", found),
        _pedestals("By own weight", by_weight),
        _clean(without),
        *(_masses(masses, loaded) for loaded in (0, LOADED)),
    ]


def _bent(seed: int) -> _Beams:
    """Identify an arm of beams that is read at one target: some beams look like a base."""
    stiffness = 10.0 ** np.random.default_rng([seed, 77]).uniform(*np.log10(BEAM_STIFFNESS))
    elastic = beam_arm(ARM, bending=stiffness, torsion=2.0 / 3.0 * stiffness)
    target = {"P1": (0.05, 0.08, 0.1)}
    document = elastic_campaign(elastic, configurations=30, seed=seed, targets=target)
    result = _result(document | {"run": {"method": "partial_pose"}})
    axes = ARM.axis_directions
    effective = ARM.compliances + np.einsum("ji,jik,jk->j", axes, elastic.links[:, 3:, 3:], axes)
    held = [
        None
        if joint.compliance_interval is None
        else joint.compliance_interval[0] <= c <= joint.compliance_interval[1]
        for c, joint in zip(effective.tolist(), result.joints, strict=True)
    ]
    return _Beams(stiffness, _model(result), [reason.code for reason in result.assessment.reasons], held)


def _beams(found: list[_Beams]) -> Section:
    held = [each for campaign in found for each in campaign.held if each is not None]
    false = sum("base_bends" in campaign.codes for campaign in found)
    return Section(
        title=f"{len(found)} campaigns of an arm of beams, one target: effective stiffness about each axis",
        columns=("EI [N·m²]", "model", "reasons", "inside its interval"),
        rows=tuple(
            (f"{each.stiffness:.1e}", each.model, ", ".join(each.codes), f"{sum(map(bool, each.held))} of 6")
            for each in sorted(found, key=lambda each: each.stiffness)
        ),
        figures=(
            Figure(
                "beams: intervals with the effective stiffness",
                100 * sum(held) / len(held),
                "at least",
                93.0,
                " %",
            ),
            Figure.none("beams: a base named as the cause", false),
        ),
    )


def _unloaded(
    seed: int, link: int | None = None, *, loaded: int = 0, pedestal: float | None = None
) -> dict[str, Any]:
    """Return 40 unloaded postures, of which some are read with a payload, too.

    True masses are anywhere within ± 10 % of those stated; that of a link is twice as large.
    """
    true = BODIES.masses * (1.0 + WITHIN * np.random.default_rng([seed, 43]).uniform(-1.0, 1.0, 6))
    if link is not None:
        true[link] = 2.0 * BODIES.masses[link]
    bodies = replace(BODIES, masses=true)
    payload = PAYLOAD if loaded else 0.0
    document = unloaded_campaign(
        ARM, bodies, mass_uncertainty=WITHIN, payload=payload, seed=seed, pedestal=pedestal
    )
    for body, mass in zip(document["robot"]["bodies"], BODIES.masses.tolist(), strict=True):
        body["mass"] = mass
    for observation in document["measurement_set"]["observations"][loaded:]:
        observation["force"] = [0.0, 0.0, 0.0]
        for reading in observation["readings"]:
            reading.pop("loaded", None)
    return document


def _masses(seeds: range, loaded: int) -> Section:
    """Count verdicts and intervals with right masses, and with one of links 2 to 6 twice as heavy."""
    rows, use = [], dict[str, int]()
    for name in ("right", "one twice"):
        results = [
            _result(_unloaded(seed, None if name == "right" else 1 + seed % 5, loaded=loaded))
            for seed in seeds
        ]
        verdicts = Counter(result.assessment.verdict for result in results)
        held = [
            low <= truth <= high
            for result in results
            for joint, truth in zip(result.joints[1:], ARM.compliances[1:].tolist(), strict=True)
            for low, high in [joint.compliance_interval or (0.0, float("inf"))]
        ]
        use[name] = verdicts["use"]
        counts = (str(verdicts[verdict]) for verdict in ("use", "use_with_care", "do_not_use"))
        rows.append((f"{name}, within ± 10 %", *counts, f"{100 * np.mean(held):.1f} %"))
    right = 100 * use["right"] / len(seeds)
    what = f"{loaded} postures with {PAYLOAD:g} kg, too" if loaded else "no known load"
    return Section(
        title=f"Masses by own weight, {what}: {len(seeds)} campaigns of 40 postures each",
        columns=("masses", "use", "with care", "do not use", "joints held"),
        rows=tuple(rows),
        figures=(
            Figure(f"right masses, {what}: use", right, "at least", 100 * 58 / 60, " %"),
            Figure.none(f"one mass twice that stated, {what}: use", use["one twice"]),
        ),
        notes=("links 2 to 6 in turn: link 1 turns about the vertical, and no joint feels its mass",),
    )


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
            Figure.none(f"{title}: use with joint 2 beyond {BEYOND:g} u", harmful),
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
