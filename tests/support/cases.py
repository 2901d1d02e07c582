"""Cases: a campaign, what is asked of it, and what a user then reads.

    scripts/cases               carry out all cases, and print what changed by how much
    scripts/cases --write WORD  write what the cases with the word answer today

`tests/cases/NAME/case.json` names the work, its campaigns (`tests/cases/campaigns`) and options;
`expected.json` has the numbers and the codes that a user reads. Words are tested elsewhere.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from support.campaigns import prepare
from support.live import positions

import jointstiff as js
from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.runs.trend import Campaign, ReadRun, compare_campaigns
from jointstiff.service.store.tables import MeasurementSetEntry
from jointstiff.simulator import default_arm
from jointstiff.solver.integrity import inspect_measurements

HERE = Path(__file__).parents[1] / "cases"
SHARED = HERE.parents[2] / "shared" / "data"
OF_SHARED_DATA = {
    "dead_weight_motor": "simulated/dead_weight_motor",
    "dead_weight_secondary": "simulated/dead_weight_secondary",
    "pull_40": "simulated/pull_40",
    "sweeps": "simulated/sweeps",
    "fanuc": "fanuc_r2000ic/campaign",
}
"""Campaigns next to the checkout, not in it."""
DIGITS = 5
"""Digits of an expected number."""
WIDTH = 150
"""Columns of a line of an expected answer."""
CLOSE = 1e-4
"""Relative difference of two numbers that counts."""
CLOSE_FORCES = 0.02
"""Relative difference of a planned force that counts: the optimum is so flat that rounding elsewhere
turns a force by 0.5°, while the efficiency is the same to five digits."""
ZERO_LENGTH = 1e-12
"""Length [m] that is rounding of zero."""
SI = "m, rad, N, N.m"
"""Units of the options of cases."""
POSTURES = [[0.3, -0.4, 0.5, 0.2, 0.6, -0.1, 0.4], [-0.5, 0.2, 0.3, -0.8, 0.9, 0.4, -0.2]]
SHIFTS = {"moved": [[2e-4, -1e-4, 3e-4]], "bumped": [[4e-4, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]}
"""Displacements of what is read under load [m]: of all targets, or of each."""
SIZES = {"force": -1.0, "size": 1.4}
"""Stated over true force."""


def campaign(name: str) -> dict[str, Any]:
    """Return a campaign document by its name."""
    if name in OF_SHARED_DATA:
        document = json.loads((SHARED / f"{OF_SHARED_DATA[name]}.json").read_text())
        if "robot" in document and name != "fanuc":
            document["robot"].setdefault("payload", 240.0)  # the simulated arm is of the 240 kg class
        return document
    return json.loads((HERE / "campaigns" / f"{name}.json").read_text())


@dataclass(frozen=True)
class Case:
    """A piece of work, and what a user reads of it."""

    folder: Path
    kind: str  # a verb of `import jointstiff`, or a function below
    campaigns: Sequence[str]
    options: Mapping[str, Any]
    changes: Mapping[str, Any]  # fields of each measurement set
    edits: Sequence[Sequence[Any]]  # of each measurement set, in turn: a path, how, and by what
    refused: bool = False  # whether the answer is a refusal
    slow: bool = False  # whether it takes seconds

    @classmethod
    def read(cls, folder: Path) -> Case:
        """Read a case."""
        document = json.loads((folder / "case.json").read_text())
        return cls(folder, **{"options": {}, "changes": {}, "edits": []} | document)

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def missing(self) -> bool:
        """True if its campaigns are not there."""
        return not SHARED.is_dir() and bool(OF_SHARED_DATA.keys() & set(self.campaigns))

    @cached_property
    def expected(self) -> dict[str, Any]:
        """What a user is to read."""
        return json.loads((self.folder / "expected.json").read_text())

    def answer(self) -> dict[str, Any]:
        """Carry out the work; return what a user reads.

        Raises:
            CampaignError: it is refused, and the case does not say so.
        """
        work: Callable[..., dict[str, Any]] = WORK[self.kind]
        documents = [self._document(name) for name in self.campaigns]
        try:
            return _rounded(work(*documents, **self.options))
        except js.CampaignError as error:
            if not self.refused:
                raise
            return {"refused": [error.problem.type.rpartition(":")[2], error.problem.where]}

    def _document(self, name: str) -> dict[str, Any]:
        document = campaign(name)
        if not (self.changes or self.edits):
            return document
        measurement_set = document["measurement_set"] | dict(self.changes)
        for path, how, by in self.edits:
            _edit(measurement_set, path.split("/"), how, by)
        return document | {"measurement_set": measurement_set}

    def differences(self) -> list[str]:
        """Return a line for each number or code that is not the expected one."""
        expected, answer = self.expected, self.answer()
        if self.kind == "plan":
            _keep_close_forces(expected, answer)
        return list(changes(expected, answer))

    def write(self) -> None:
        """Write what the work answers today."""
        (self.folder / "expected.json").write_text(in_lines(self.answer()), encoding="utf-8")


def cases() -> list[Case]:
    """Return all cases, by name."""
    return [Case.read(path.parent) for path in sorted(HERE.glob("*/case.json"))]


def changes(then: Any, now: Any, place: str = "") -> Iterator[str]:
    """Yield a line for each value that differs: its place, the value before and after, and by how much."""
    if isinstance(then, dict) and isinstance(now, dict):
        for key in [*then, *(key for key in now if key not in then)]:
            where = f"{place}.{key}" if place else key
            yield from changes(then.get(key, "nothing"), now.get(key, "nothing"), where)
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        largest = max((abs(x) for x in then if _is_number(x)), default=0.0)
        for i, (a, b) in enumerate(zip(then, now, strict=True)):
            if not _are_close(a, b, 1e-6 * largest):
                yield from changes(a, b, f"{place}[{i}]")
    elif then != now and not _are_close(then, now, 1e-15):
        yield _line(place, then, now)


def _keep_close_forces(expected: Any, answer: Any) -> None:
    """Put the expected force of each planned reading into an answer whose force is close to that force."""
    for label, (_, then, *_) in expected.get("readings", {}).items():
        reading = answer["readings"].get(label)
        if reading and np.linalg.norm(np.subtract(reading[1], then)) <= CLOSE_FORCES * np.linalg.norm(then):
            reading[1] = then


def _are_close(then: Any, now: Any, rounding: float) -> bool:
    """Return whether two numbers differ by less than counts."""
    return _is_number(then) and _is_number(now) and math.isclose(then, now, rel_tol=CLOSE, abs_tol=rounding)


def _line(place: str, then: Any, now: Any) -> str:
    by = f"  ({100.0 * (now / then - 1.0):+.3g} %)" if _is_number(then) and _is_number(now) and then else ""
    return f"{place:40} {json.dumps(then):>16} → {json.dumps(now)}{by}"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def in_lines(value: Any, indent: str = "") -> str:
    """Return JSON whose objects are on one line where that is short, else with a line for each entry."""
    line = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict) or (len(indent) + len(line) <= WIDTH and indent):
        return line
    inner = (f"{indent}  {json.dumps(key)}: {in_lines(each, indent + '  ')}" for key, each in value.items())
    return "{\n" + ",\n".join(inner) + f"\n{indent}}}" + ("" if indent else "\n")


def _rounded(value: Any) -> Any:
    if hasattr(value, "model_dump"):
        value = value.model_dump(mode="json")
    if isinstance(value, Mapping):
        return {str(key): _rounded(each) for key, each in value.items() if each is not None and each != []}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else str(value)
    return value


def _edit(document: Any, path: Sequence[str], how: str, by: Any) -> None:
    """Change parts of a document: `observations/3:/force` is that of all from the fourth on.

    Numbers are `added`, or they are `times` others; a part `is` another, is to be `dropped`, or takes its
    place in an `order` of all of them.
    """
    parts = [document]
    for step in path[:-1]:
        parts = [part[key] for part in parts for key in _keys(part, step)]
    places = [(part, key) for part in parts for key in _keys(part, path[-1])]
    values = [part[key] for part, key in places]
    if how == "dropped":
        for part, key in reversed(places):
            del part[key]
        return
    changed: list[Any] = {
        "added": lambda: np.add(values, by).tolist(),
        "times": lambda: np.multiply(values, by).tolist(),
        "is": lambda: [by] * len(values),
        "order": lambda: [values[i] for i in by],
    }[how]()
    for (part, key), value in zip(places, changed, strict=True):
        part[key] = value


def _keys(part: Any, step: str) -> Sequence[Any]:
    """Return the keys of a part that a step of a path names."""
    if isinstance(part, dict):
        return [step]
    first, colon, last = step.partition(":")
    return range(len(part))[slice(int(first or 0), int(last) if last else None)] if colon else [int(step)]


def _assessed(assessment: Any) -> dict[str, Any]:
    findings = [*assessment.reasons, *assessment.questions]
    return {"verdict": assessment.verdict, "reasons": [_finding(each) for each in findings]}


def _finding(each: Any) -> str:
    action = f" ({each.action.kind})" if each.action is not None else ""
    place = f" {each.observation}" if each.observation else f" {each.where}" if each.where else ""
    return f"{each.code}{place}: {each.weight}{action}"


def _joint(joint: Any) -> list[Any]:
    value = [joint.status, joint.verdict, joint.stiffness, joint.standard_uncertainty]
    return [*value, joint.stiffness_interval or joint.stiffness_at_least]


def _of_run(run: Any) -> dict[str, Any]:
    """What a user reads of a run."""
    if run.result is None:
        return {"state": run.state, "error": [run.error.type.rpartition(":")[2], run.error.where]}
    return _of_result(run.result)


def _of_result(found: Any) -> dict[str, Any]:
    choice, links, weight = found.choice, found.links, found.weight
    out = _assessed(found.assessment) | {
        "joints": {joint.name: _joint(joint) for joint in found.joints},
        "fit": {
            "residuals": [found.sigma, found.rms_residual, found.compensation],
            "chi_square": [
                found.goodness.sigma_source,
                found.goodness.chi_square,
                found.goodness.degrees_of_freedom,
                found.goodness.p_value,
            ],
            "determined": [
                found.identifiability.rank,
                found.identifiability.parameters,
                found.identifiability.condition_number,
                found.identifiability.observability,
            ],
            "combinations": [_values(each) for each in found.identifiability.combinations],
            "characteristic_length": found.characteristic_length,
            "suspicious": [[each.observation, each.target, each.weight] for each in found.suspicious],
        },
        "causes": [[each.name, each.first, each.p_value] for each in found.causes[:4]],
        "shares": [each.mean for each in found.contributions],
        "advice": [
            [each.joint, each.observation, each.uncertainty_ratio, each.force]
            for each in found.identifiability.advice
        ],
        "warnings": [_finding(each) for each in found.warnings],
    }
    if found.complementary_stiffness is not None:
        out["fit"]["K_c"] = _values(found.complementary_stiffness)
    if choice is not None:
        out["model"] = {"chosen": [choice.elasticity, choice.loss, choice.source, choice.links_p_value]}
        out["model"] |= {
            f"{each.model} {each.loss}": [each.penalty, each.compensation, each.mean_residual]
            for each in choice.models
        }
    if found.budget is not None:
        out["budget"] = {
            part.source: [part.included, part.degrees_of_freedom, part.contributions]
            for part in found.budget.components
        }
        out["budget"]["with model error"] = found.budget.expanded_with_model_error
    if found.resampling is not None:
        out["resampled"] = {
            each.name: [each.compliance_mean, each.compliance_deviation, each.share_infinite]
            for each in found.resampling.joints
        } | {"compensation": [found.resampling.compensation_mean, found.resampling.compensation_interval]}
    if links is not None:
        out["links"] = {
            f"{each.joint}": [each.effective_freedom, float(np.trace(each.matrix))] for each in links.links
        }
        out["links"]["of"] = [links.penalty, links.effective_freedom, links.unexplained]
        if links.base is not None:
            out["links"]["base"] = np.diagonal(links.base.matrix).tolist()
    if weight is not None:
        out["weight"] = {each.joint: [each.torque, each.largest_sag] for each in weight.joints}
        out["weight"]["rms"] = [weight.rms_without_sag, weight.rms_residual]
    return out


def _values(message: Any) -> Any:
    return list(message.model_dump(mode="json").values()) if hasattr(message, "model_dump") else message


def identify(document: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Identify; where there is a number for each joint, predict two postures, too."""
    run = js.identify(document, units=SI, **options)
    out = _of_run(run)
    if run.result is not None and all(joint.compliance is not None for joint in run.result.joints):
        moved = predict(document, run=run)
        out["predicted"] = {"reasons": [moved["verdict"], *moved["reasons"]]}
        out["predicted"] |= {key: [moved[f"{what} {key}"] for what in ("moves", "interval")] for key in "12"}
    return out


def predict(document: dict[str, Any], *, run_options: Any = None, run: Any = None, **options: Any) -> Any:
    """Predict two postures, or the cases given."""
    run = run or js.identify(document, units=SI, **(run_options or {}))
    count = len(run.result.joints)
    given = [
        {"joints": posture[:count], "force": force}
        for posture, force in zip(POSTURES, ([200, 100, -400], [0, -300, 50]), strict=True)
    ]
    units = {"units": {"length": "m", "angle": "rad", "force": "N", "moment": "N.m"}}
    options = units | {"load_point": (0.05, 0.0, 0.12)} | options
    found = js.predict(run, options.pop("cases", given), **options)
    out = {
        "verdict": found.assessment.verdict,
        "reasons": [_finding(each) for each in (*found.assessment.reasons, *found.assessment.questions)],
    }
    for each in found.cases:
        out[f"moves {each.label}"] = [each.displacement, each.rotation]
        out[f"interval {each.label}"] = each.with_model_error or each.readings_only
        if each.compliance is not None:
            out[f"along {each.label}"] = _values(each.compliance.along)
    return out


def mended(document: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Return the reasons of a run, and what each action that they advise gives."""
    run = js.identify(document, units=SI, **options)
    out: dict[str, Any] = _assessed(run.result.assessment)
    for action in sorted({each.action.kind for each in run.result.assessment.reasons if each.action}):
        again = run.apply(action)
        out[action] = _assessed(again.result.assessment)
        out[action]["stiffness"] = [joint.stiffness for joint in again.result.joints]
    return out


def findings(document: dict[str, Any]) -> dict[str, Any]:
    """Return what the readings alone let find."""
    robot, measurements = prepare(document)
    return {"findings": [_finding(each) for each in inspect_measurements(robot, measurements, degrees=False)]}


def correct(document: dict[str, Any], program: Mapping[str, str], **options: Any) -> dict[str, Any]:
    """Correct a program that is given as its files' texts."""
    run = js.identify(document, units=SI, **options.pop("run", {}))
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, name) for name in program]
        for file in files:
            file.write_text(program[file.name])
        result = js.correct(run, files, **{"units": "m, deg, N"} | options).result
    found = result.program
    names = ("deflection", "correction", "residual")
    return _assessed(result.assessment) | {
        "moves": [found.moves, found.moves_left, found.points, found.corrected, found.capped],
        "sizes": {name: _values(getattr(found, name)) for name in names},
        "worst": {str(each.number): [each.interval, each.share, each.capped] for each in found.worst},
        "files": {
            each.name: [
                line
                for line in decompress_file(each).decode().splitlines()
                if line.startswith(("PTP", "LIN"))
            ]
            for each in found.files
        },
    }


def measure(document: dict[str, Any], mistakes: Mapping[str, str] | None = None, **options: Any) -> Any:
    """Measure by a simulated source, or an arm that is read with mistakes; each state on the way."""
    most, states = options.pop("most", 200), dict[str, Any]()
    with js.measure(document, source="simulated:1", units=SI, **options) as live:
        while live.state.state == "measuring" and live.next is not None and live.count < most:
            following, mistake = live.next, (mistakes or {}).get(str(live.count))
            if mistakes is None:
                live.run_source(most=live.count + 1)
            else:
                _observed(live, mistake)
            state, last = live.state, live.state.readings[-1]
            states[f"{live.count} {following.label}"] = [
                state.state,
                state.share,
                state.still_needed,
                [mistake, last.state, last.p_value, last.causes, last.ball_ratio],
                following.joints,
                [joint.relative for joint in state.joints],
            ]
        closed = live.close()
    return {"states": states} | _of_run(closed)


def _observed(live: Any, mistake: str | None) -> None:
    """Take a reading of the default arm with a mistake, which stays."""
    joints, force = live.next.joints, live.next.force
    read = positions(default_arm(), joints, force, sigma=2e-5, seed=live.count)
    unloaded, loaded = read["unloaded"], np.add(read["loaded"], SHIFTS.get(str(mistake), 0.0))
    if mistake == "states":
        unloaded, loaded = loaded, unloaded
    elif mistake == "targets":
        loaded = loaded[[1, 0, 2]]
    elif mistake == "angles":
        joints = np.multiply(joints, [1, 1, -1, 1, 1, 1])
    elif mistake == "stale":
        joints = np.add(joints, [0.2, -0.1, 0.1, 0.0, 0.3, 0.0])
    try:
        live.observe(unloaded, loaded, joints=joints, force=np.multiply(force, SIZES.get(str(mistake), 1.0)))
    except js.CampaignError:
        live.skip()


def trend(*documents: dict[str, Any]) -> dict[str, Any]:
    """Chart campaigns of one arm, the oldest first."""
    campaigns = []
    for i, document in enumerate(documents):
        run = js.identify(document)
        parts = {"request": run.request.model_dump(mode="json"), "result": run.result.model_dump(mode="json")}
        day = datetime(2026, 1 + i, 10, tzinfo=UTC)
        entry = MeasurementSetEntry(
            id=f"set_{i}",
            name=f"{i}",
            robot_id="",
            encoders="motor",
            observation_count=0,
            warning_count=0,
            content_hash="",
            created_at=day,
            measured_at=day,
        )
        campaigns.append(Campaign(f"run_{i}", day, ReadRun.model_validate(parts), entry))
    found = compare_campaigns([joint.name for joint in run.result.joints], campaigns)
    return {
        "joints": {
            each.name: [each.changed, each.p_value, each.change, [point.stiffness for point in each.points]]
            for each in found["joints"]
        }
    }


def compare(*documents: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Compare methods on a campaign, or two campaigns."""
    found = js.compare(*documents, units=SI, **options).result
    out: dict[str, Any] = _assessed(found.assessment)
    for each in found.entries:
        name = f"{each.side} {each.method} {each.weighting} {'positive' if each.positive else 'free'}"
        out[name] = [each.error and each.error.type.rpartition(":")[2], each.compensation]
        out[name] += [[joint.stiffness, joint.standard_uncertainty] for joint in each.joints]
    if found.joints:
        out["ratios"] = {each.name: [each.ratio, each.ratio_interval, each.p_value] for each in found.joints}
    if found.avoided is not None:
        out["avoided"] = [found.avoided.matching, _values(found.avoided.measured), found.avoided.predicted]
    if found.ordered is not None:
        out["ordered"] = {
            each.name: [each.stiffness_first, each.stiffness_second, each.equal]
            for each in found.ordered.joints
        } | {"increase": found.ordered.chi_square_increase}
    return out


def plan(document: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Plan readings."""
    found = js.plan(document, units=SI, **options).result
    return _assessed(found.assessment) | {
        "criterion": [found.criterion, found.efficiency, found.random_efficiency, found.goal_share],
        "feasible": [found.considered, found.feasible, found.struck_out],
        "joints": {each.name: [each.relative, each.before, each.one_at_a_time] for each in found.joints},
        "readings": {
            each.label: [each.joints, each.force, each.anchor, each.direction, each.held_out, each.block]
            for each in found.readings
        },
        "deflection": [found.deflection_uncertainty, found.worst_deflection_uncertainty],
    }


def map_(document: dict[str, Any], run_options: Any = None, **options: Any) -> dict[str, Any]:
    """Map a work area."""
    run = js.identify(document, units=SI, **(run_options or {}))
    found = js.map(run, units=SI, **options).result
    out: dict[str, Any] = _assessed(found.assessment)
    out |= {"counts": _values(found.counts), "percentiles": list(found.percentiles.values())}
    for name in ("worst", "stiffest"):
        place = getattr(found, name)
        if place is not None:
            interval = place.with_model_error or place.readings_only
            out[name] = [place.position, place.joints, place.deflection, interval, place.extrapolation]
    return out


def geometry(document: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Identify the geometry."""
    found = js.geometry(document, **options).result
    out: dict[str, Any] = _assessed(found.assessment)
    out |= {
        "findings": [_finding(each) for each in found.findings],
        "axes": {
            each.name: [each.position_uncertainty, each.direction_uncertainty, each.point]
            for each in found.axes
        },
        "sigma": [found.sigma_source, found.sigma, found.degrees_of_freedom, found.variance_factor],
        "agreement": [found.agreement_probability, found.controller_probability],
        "base": [found.base, *found.transform_tracker_to_base.translation],
        "targets": {each.name: each.position for each in found.targets},
    }
    if found.wrist is not None:
        out["wrist"] = [found.wrist.combined.base, found.wrist.miss_distance, found.wrist.decoupled_method]
    if found.dh:
        out["dh"] = {
            str(i): [_settle(row.a), row.alpha, _settle(row.d), row.theta]
            for i, row in enumerate(found.dh[0].rows)
        }
    return out


def _settle(length: float) -> float:
    """Return a length [m], or zero for a length that is rounding of zero."""
    return length if abs(length) > ZERO_LENGTH else 0.0


WORK: dict[str, Callable[..., dict[str, Any]]] = {
    "identify": identify,
    "predict": predict,
    "mended": mended,
    "findings": findings,
    "correct": correct,
    "measure": measure,
    "trend": trend,
    "compare": compare,
    "plan": plan,
    "map": map_,
    "geometry": geometry,
}


def main(*arguments: str) -> int:
    """Compare the cases with a word, or write them anew; print what changed."""
    write, words = "--write" in arguments, [each for each in arguments if each != "--write"]
    changed = 0
    for case in cases():
        if (words and not any(word in case.name for word in words)) or case.missing:
            continue
        exists = (case.folder / "expected.json").exists()
        lines = case.differences() if exists else ["new"]
        if lines:
            changed += 1
            sys.stdout.write(f"{case.name}\n" + "".join(f"  {line}\n" for line in lines))
        if write and lines:
            case.write()
    sys.stdout.write(f"{changed} cases changed\n")
    return int(bool(changed) and not write)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
