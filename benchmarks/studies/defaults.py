"""Runs without options: clean campaigns stay with joints, beams get links, actions mend planted mistakes."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Figure, Part, Section
from benchmarks.studies.assessment import WELL_DETERMINED, clean_campaign, planted_campaign
from benchmarks.studies.mistakes import Posted
from benchmarks.studies.verdicts import METHODS
from jointstiff import identify
from jointstiff.schemas.run import Campaign, ModelChoice, RunResult
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.library.results import TabledRun
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.simulator.urdf import BASE_LINK, FLANGE_LINK, urdf_text

__all__ = ["run_beams", "run_clean", "run_fanuc", "run_mended"]

_FANUC = Path(__file__).parents[3] / "shared" / "data" / "fanuc_r2000ic" / "campaign.json"
_LINKS = {"diagonal_links", "joints_and_links", "links_and_base"}
_UNDETERMINED = {"no_joint_identified", "no_residual_freedom", "few_postures", "deflections_below_noise"}


def run_clean(*, quick: bool, part: Part) -> list[Section]:
    """Count clean campaigns of springs that are escalated, or not for use."""
    seeds = part.of(4 if quick else 1_000)
    verdicts, chosen, odd = Counter[str](), Counter[str](), []
    for seed in seeds:
        measurements, method, _ = clean_campaign(seed)
        run = identify(_campaign(Posted(measurements)), method=METHODS[method])
        result = _result(run)
        relative = [(joint.standard_uncertainty or 0.0, joint.compliance or 0.0) for joint in result.joints]
        if any(u > WELL_DETERMINED * c for u, c in relative):
            continue
        verdicts[result.assessment.verdict] += 1
        chosen["escalated" if _choice(result).source == "cross_validation" else "quick"] += 1
        if result.assessment.verdict != "use":
            odd.append((seed, [reason.code for reason in result.assessment.reasons]))
    count = max(1, verdicts.total())
    return [
        Section(
            title=f"Default runs of {count} of {len(seeds)} clean campaigns, all u(c)/c < 0.2",
            columns=("outcome", "campaigns"),
            rows=tuple((name, str(number)) for name, number in (verdicts + chosen).items()),
            figures=(
                Figure("clean campaigns escalated", 100 * chosen["escalated"] / count, "at most", 1.0, " %"),
                Figure('clean campaigns for "use"', 100 * verdicts["use"] / count, "at least", 99.5, " %"),
            ),
            notes=(f"not for use: {odd}",),
        )
    ]


def run_beams(*, quick: bool, part: Part) -> list[Section]:
    """Count campaigns of flexible links, EI 3e6 to 6e7 N·m², whose model is chosen with links."""
    seeds = part.of(2 if quick else 200)
    chosen = Counter[str]()
    for seed in seeds:
        rng = np.random.default_rng([seed, 62])
        elastic = beam_arm(default_arm(), bending=3e6 * 20.0 ** rng.uniform())
        document = elastic_campaign(elastic, configurations=int(rng.integers(20, 41)), seed=seed)
        chosen[_choice(_result(identify(document))).elasticity] += 1
    share = 100 * sum(chosen[name] for name in _LINKS) / len(seeds)
    return [
        Section(
            title=f"Default runs of {len(seeds)} campaigns of flexible links, 20 to 40 postures",
            columns=("model", "campaigns"),
            rows=tuple((name, str(number)) for name, number in chosen.items()),
            figures=(Figure("flexible links: a model with links", share, "at least", 95.0, " %"),),
        )
    ]


def run_mended(*, quick: bool, part: Part) -> list[Section]:
    """Apply the first action of each planted mistake that is proved, and count the runs that are for use."""
    seeds = part.of(32 if quick else 2_000)
    ends: dict[str, Counter[str]] = {}
    for seed in seeds:
        name, posted, method, _ = planted_campaign(seed)
        ends.setdefault(name, Counter())[_end(identify(_campaign(posted), method=METHODS[method]))] += 1
    columns = ("not proved", "use", "not determined", "use_with_care", "do_not_use", "no action", "failed")
    total = sum(ends.values(), Counter[str]())
    proved = sum(total[name] for name in columns[1:] if name != "not determined")
    return [
        Section(
            title=f"Actions of {len(seeds)} campaigns with one planted mistake",
            columns=("mistake", *columns),
            rows=tuple((name, *(str(found[c]) for c in columns)) for name, found in sorted(ends.items())),
            figures=(
                Figure(
                    "proved mistakes whose action's run is for use",
                    100 * total["use"] / max(1, proved),
                    "at least",
                    100.0,
                    " %",
                ),
            ),
            notes=("not determined: the clean readings identify no joint, or leave no freedom",),
        )
    ]


def _end(run: TabledRun) -> str:
    """Return the verdict that the first action of a proved mistake leads to."""
    if run.result is None:
        return "failed"
    proved = [r for r in run.result.assessment.reasons if r.weight == "do_not_use"]
    if not proved:
        return "not proved"
    offered = [r.action.kind for r in proved if r.action is not None]
    offered = [kind for kind in offered if kind not in {"show_posture", "choose_model"}]
    offered.sort(key=lambda kind: kind == "omit_noise")  # the last resort, but where the noise is wrong
    if not offered:
        return "no action"
    try:
        after = run.apply(offered[0]).result
    except CampaignError:
        return "failed"
    if after is None:
        return "failed"
    codes = {reason.code for reason in after.assessment.reasons}
    return "not determined" if codes & _UNDETERMINED else after.assessment.verdict


def run_fanuc(*, quick: bool) -> list[Section]:
    """Identify the shared real set without options."""
    del quick  # it is one set
    result = _result(identify(_FANUC))
    models = [] if result.selection is None else result.selection.models
    rows = tuple(
        (scored.model, scored.loss, f"{100 * scored.compensation:.1f}", f"{100 * scored.standard_error:.1f}")
        for scored in models
    )
    return [
        Section(
            title=f"The real set without options: {_choice(result).message}",
            columns=("model", "loss", "held out [%]", "standard error [%]"),
            rows=rows,
            figures=(),
            notes=(f"verdict {result.assessment.verdict}",),
        )
    ]


def _result(run: TabledRun) -> RunResult:
    if run.result is None:
        raise ValueError(f"the run failed: {run.error}")
    return run.result


def _choice(result: RunResult) -> ModelChoice:
    if result.choice is None:
        raise ValueError("the run chose no model")
    return result.choice


def _campaign(posted: Posted) -> Campaign:
    """Return a set of arrays as a campaign file; one a thousand times off as numbers in the stated unit."""
    m, names = posted.measurements, list(TARGETS)
    by_deflections = bool(m.in_flange.any())
    short = float(np.linalg.norm(m.load_point, axis=1).max()) < 2e-3
    strong = float(np.linalg.norm(m.force, axis=1).min()) > 1e5
    length, force = (1e3 if short else 1.0), (1e-3 if strong else 1.0)
    joints = np.degrees(m.joints) if posted.degrees else m.joints
    position, deflection = length * m.position, length * m.deflection
    observations: list[dict[str, Any]] = []
    for i in range(len(m)):
        readings = []
        for t in np.flatnonzero(m.present[i]):
            place, bent = position[i, t], deflection[i, t]
            read = {"unloaded": place.tolist(), "loaded": (place + bent).tolist()}
            readings.append(
                {"target": names[t]} | ({"deflection": bent.tolist()} if by_deflections else read)
            )
        observations.append(
            {
                "label": f"c{i}",
                "joints": joints[i].tolist(),
                "force": (force * m.force[i]).tolist(),
                "load_point": (length * m.load_point[i]).tolist(),
                "readings": readings,
            }
        )
    measured: dict[str, Any] = {
        "name": "planted",
        "units": {
            "length": "mm" if short else "m",
            "angle": "deg" if posted.degrees else "rad",
            "force": "kN" if strong else "N",
        },
        "encoders": "motor",
        "observations": observations,
    }
    if m.sigma is not None:
        measured["noise"] = {"sigma": length * m.sigma}
    if by_deflections:
        measured["flange_targets"] = dict(zip(names, position[0].tolist(), strict=True))
    model = {"format": "urdf", "urdf": urdf_text(default_arm()), "base": BASE_LINK, "flange": FLANGE_LINK}
    robot = {"name": "simulated 6R", "model": model}
    return Campaign.model_validate({"robot": robot, "measurement_set": measured})
