"""Recorded answers on campaigns of all kinds: a net below changes that are to change no number.

    .venv/bin/python tests/support/recorded_answers.py [WORD]       compare; WORD selects cases by name
    .venv/bin/python tests/support/recorded_answers.py --record     record anew, as wanted

A number may differ by a thousandth of its standard uncertainty, where it is an estimate, or by 1e-6 of
itself; verdicts, reasons, statuses and choices are equal.
"""

import gzip
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import jointstiff as js

HERE = Path(__file__).parents[1] / "recorded"
ANSWERS = HERE / "answers.json.gz"
SHARED = HERE.parents[2] / "shared" / "data"
CLOSE, BESIDE_U = 1e-6, 1e-3
OF_SHARED_DATA = {
    "dead_weight_motor": "simulated/dead_weight_motor",
    "dead_weight_secondary": "simulated/dead_weight_secondary",
    "pull_40": "simulated/pull_40",
    "sweeps": "simulated/sweeps",
    "fanuc": "fanuc_r2000ic/campaign",
}
"""Campaigns that stand beside the checkout, not in it."""
ANGLES = (0.3, -0.4, 0.5, 0.2, 0.6, -0.1, 0.4)


def campaign(name: str) -> dict[str, Any]:
    """Return a campaign document by name."""
    if name in OF_SHARED_DATA:
        return json.loads((SHARED / f"{OF_SHARED_DATA[name]}.json").read_text())
    return json.loads(gzip.decompress((HERE / "campaigns" / f"{name}.json.gz").read_bytes()))


@dataclass(frozen=True)
class Case:
    """A piece of work with its recorded answer."""

    kind: str
    campaigns: list[str]
    options: dict[str, Any]
    answer: dict[str, Any]

    def again(self) -> dict[str, Any]:
        """Return what the same work answers today, as far as it is recorded."""
        verb = {"run": "identify", "pair": "compare"}.get(self.kind, self.kind)
        try:
            job = getattr(js, verb)(*map(campaign, self.campaigns), **self.options)
        except js.CampaignError as error:
            return {"refused": str(error.problem.title)}
        essentials = _of_run(job) if self.kind == "run" else _OF_KIND[self.kind](job.result)
        return json.loads(json.dumps(essentials))


def recorded() -> dict[str, Case]:
    """Return all cases by name."""
    known = json.loads(gzip.decompress(ANSWERS.read_bytes()))
    return {name: Case(**case) for name, case in known.items()}


def _of_run(run: Any) -> dict[str, Any]:
    if run.result is None:
        return {"state": run.state, "error": run.error.title if run.error else None}
    r = run.result
    out: dict[str, Any] = {
        "verdict": r.assessment.verdict,
        "reasons": sorted(reason.code for reason in r.assessment.reasons),
        "actions": sorted(reason.action.kind for reason in r.assessment.reasons if reason.action),
        "sigma": r.sigma,
        "rms": r.rms_residual,
        "explained": r.compensation,
        "chi2": r.goodness.chi_square if r.goodness else None,
    }
    if r.choice is not None:
        out |= {"choice": r.choice.elasticity, "loss": r.choice.loss, "p of links": r.choice.links_p_value}
    for joint in r.joints:
        u, ends = joint.standard_uncertainty, joint.compliance_interval or ()
        of_joint = {"status": joint.status, "verdict": joint.verdict}
        out[joint.name] = of_joint | {"c": [joint.compliance, u], "interval": [[end, u] for end in ends]}
        if joint.budget is not None:
            out[joint.name]["budget"] = [[part, u] for part in joint.budget.model_dump().values()]
    if r.resampling is not None:
        drawn = r.resampling.joints
        out["resampled"] = {j.name: [j.compliance_mean, j.compliance_deviation, None] for j in drawn}
    if all(joint.compliance is not None for joint in r.joints) and r.weight is None:
        out |= _predicted(run)
    return out


def _predicted(run: Any) -> dict[str, Any]:
    joints = run.result.joints
    head = ["label", *(f"{joint.name} [rad]" for joint in joints), "fx [N]", "fy [N]", "fz [N]"]
    row = ["a", *ANGLES[: len(joints)], 200, 100, -400]
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder, "postures.csv")
        table.write_text("\n".join(",".join(map(str, line)) for line in (head, row)) + "\n")
        case = js.predict(run, str(table), load_point=(0.05, 0.0, 0.12)).cases[0]
    u = case.budget.standard_uncertainty if case.budget else 0.0
    out: dict[str, Any] = {"predicted": [[value, u] for value in case.displacement]}
    return out | ({"ball": case.with_model_error.radius} if case.with_model_error is not None else {})


def _of_comparison(r: Any) -> dict[str, Any]:
    entries = {
        f"{e.method} {e.weighting} {'positive' if e.positive else 'free'}": [
            e.compensation,
            e.rms_residual,
            *(joint.compliance for joint in e.joints),
        ]
        for e in r.entries
    }
    return {"verdict": r.assessment.verdict} | entries


def _of_pair(r: Any) -> dict[str, Any]:
    measured, predicted = r.avoided.measured, r.avoided.predicted
    out: dict[str, Any] = {
        "measured": [measured.value, measured.standard_uncertainty],
        "predicted": getattr(predicted, "value", predicted),
    }
    out |= {joint.name: [joint.ratio, *(joint.ratio_interval or ())] for joint in r.joints}
    if r.ordered is not None:
        both = [v for joint in r.ordered.joints for v in (joint.compliance_first, joint.compliance_second)]
        out["ordered"] = [*both, r.ordered.chi_square_increase]
    return out


def _of_geometry(r: Any) -> dict[str, Any]:
    base, centre = r.base_frame.transform_tracker_to_base, r.wrist.combined
    return {
        "axes": [v for axis in r.axes for v in (*axis.tracker.point, *axis.tracker.direction)],
        "base": [*(v for row in base.rotation for v in row), *base.translation],
        "wrist": [*centre.tracker, *centre.base],
        "wrist covariance": [v for row in centre.tracker_covariance for v in row],
        "miss": r.wrist.miss_distance,
    }


def _of_map(r: Any) -> dict[str, Any]:
    return {
        "verdict": r.assessment.verdict,
        "quantiles": [quantile.deflection for quantile in r.quantiles],
        "worst": [r.worst.deflection, *r.worst.readings_only, *r.worst.with_model_error],
        "reached": r.counts.reached,
    }


def _of_plan(r: Any) -> dict[str, Any]:
    promised = [[joint.standard_uncertainty, joint.standard_uncertainty] for joint in r.joints]
    return {"promised": promised, "readings": len(r.readings)}


_OF_KIND = {
    "compare": _of_comparison,
    "pair": _of_pair,
    "geometry": _of_geometry,
    "map": _of_map,
    "plan": _of_plan,
}


def differences(then: Any, now: Any, where: str = "") -> Iterator[str]:
    """Yield what differs by more than it may."""
    if isinstance(then, dict) and isinstance(now, dict):
        for key in sorted(then.keys() | now.keys()):
            yield from differences(then.get(key), now.get(key), f"{where}/{key}")
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        if len(then) == 2 and all(map(_number, (*then, *now))):
            if not _same_estimate(then, now):
                yield f"{where}: {then} → {now}"
            return
        for i, (a, b) in enumerate(zip(then, now, strict=True)):
            yield from differences(a, b, f"{where}[{i}]")
    elif then != now and not (_number(then) and _number(now) and _same_number(then, now, where)):
        yield f"{where}: {then} → {now}"


def _same_estimate(then: list[float], now: list[float]) -> bool:
    """Compare values with their standard uncertainties."""
    limit = BESIDE_U * max(abs(then[1]), abs(now[1]))
    return abs(then[0] - now[0]) <= limit + 1e-9 * abs(then[0]) and abs(then[1] - now[1]) <= limit


def _same_number(then: float, now: float, where: str) -> bool:
    close = 1e-3 if where.endswith(("p of links", "chi2")) else CLOSE
    return math.isclose(then, now, rel_tol=close, abs_tol=1e-12)


def _number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def main(word: str = "") -> int:
    """Compare, or record anew; return how many answers differ."""
    if word == "--record":
        made = {name: asdict(replace(case, answer=case.again())) for name, case in recorded().items()}
        ANSWERS.write_bytes(gzip.compress(json.dumps(made, indent=0).encode(), mtime=0))
        return 0
    chosen, differing = {name: case for name, case in recorded().items() if word in name}, 0
    for name, case in chosen.items():
        found = list(differences(case.answer, case.again()))
        differing += bool(found)
        sys.stdout.writelines(f"{name} {line}\n" for line in found[:4])
    sys.stdout.write(f"{differing} of {len(chosen)} answers differ\n")
    return differing


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]) > 0)
