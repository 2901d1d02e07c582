"""Recorded answers on campaigns of all kinds: a net below changes that are to change no number.

    PYTHONPATH=tests .venv/bin/python -m support.recorded_answers [WORD]       compare those with the word
    PYTHONPATH=tests .venv/bin/python -m support.recorded_answers --record [WORD ...]   new ones; these anew

`cases.json` names the cases; an answer is the whole document that the solver gives: every number, text,
remedy and budget, without ids, times and versions. A number may differ by 1e-6 of itself or of the largest
beside it, an estimate by a thousandth of its standard uncertainty; numbers in texts by the last digit
printed; words are equal.
"""

import gzip
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from support.campaigns import prepare
from support.live import positions

import jointstiff as js
from jointstiff.service.kinds.program.work import unpacked
from jointstiff.service.runs.trend import Campaign, ReadRun, trend_of
from jointstiff.service.store.tables import MeasurementSetEntry
from jointstiff.simulator import default_arm
from jointstiff.solver.integrity import inspect

HERE = Path(__file__).parents[1] / "recorded"
CASES, ANSWERS = HERE / "cases.json", HERE / "answers.zip"
SHARED = HERE.parents[2] / "shared" / "data"
OF_SHARED_DATA = {
    "dead_weight_motor": "simulated/dead_weight_motor",
    "dead_weight_secondary": "simulated/dead_weight_secondary",
    "pull_40": "simulated/pull_40",
    "sweeps": "simulated/sweeps",
    "fanuc": "fanuc_r2000ic/campaign",
}
"""Campaigns that stand beside the checkout, not in it."""
LEFT_OUT = {
    "content",
    "id",
    "provenance",
    "key_id",
    "key_name",
    "run_id",
    "measurement_set_id",
    "robot_id",
    "created_at",
    "sha256",
}
"""Fields that differ from one time to the next, and packed files."""
CLOSE, BESIDE_U, NOTHING = 1e-6, 1e-3, 1e-13
LOOSE = {"certificate": 1e-7, "weights_gap": 1e-7, "effective_freedom": 5e-3}
"""What is zero but for rounding, by the field that it stands in."""
UNSETTLED = "~"
"""In place of a number that rounding decides: it differs by the kernels of linear algebra."""
KERNELS = ("", "Haswell", "Nehalem")
"""Record on a processor with AVX-512: what is settled there is settled on others."""
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d{1,3})?")
OF_TODAY = re.compile(r"\b[0-9a-f]{32,64}\b|(?<=corrected )\d{4}-\d\d-\d\d")
"""Ids, and the day that the head of a corrected program names."""
POSTURES = [[0.3, -0.4, 0.5, 0.2, 0.6, -0.1, 0.4], [-0.5, 0.2, 0.3, -0.8, 0.9, 0.4, -0.2]]


def campaign(name: str) -> dict[str, Any]:
    """Return a campaign document by name."""
    if name in OF_SHARED_DATA:
        return json.loads((SHARED / f"{OF_SHARED_DATA[name]}.json").read_text())
    return json.loads(gzip.decompress((HERE / "campaigns" / f"{name}.json.gz").read_bytes()))


@dataclass(frozen=True)
class Case:
    """A piece of work with its recorded answer."""

    name: str
    kind: str  # a verb of `import jointstiff`, or a function below
    campaigns: list[str]
    options: dict[str, Any]
    changes: dict[str, Any]  # of each measurement set
    edits: list[list[Any]]  # of it, in turn: a path, how, and by what

    @cached_property
    def answer(self) -> Any:
        """Recorded answer."""
        with zipfile.ZipFile(ANSWERS) as file:
            return json.loads(file.read(self.name))

    def again(self) -> Any:
        """Return what the same work answers today."""
        work = _OF_KIND.get(self.kind) or getattr(js, self.kind)
        try:
            done = work(*map(self._document, self.campaigns), **self.options)
        except js.CampaignError as error:
            return {"refused": _plain(error.problem)}
        return _plain(done)

    def _document(self, name: str) -> dict[str, Any]:
        document = campaign(name)
        measurement_set = document["measurement_set"] | self.changes if self.changes or self.edits else None
        for path, how, by in self.edits:
            _edit(measurement_set, path.split("/"), how, by)
        return document | ({"measurement_set": measurement_set} if measurement_set else {})


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


def recorded() -> dict[str, Case]:
    """Return all cases by name."""
    cases = json.loads(CASES.read_text())
    return {name: Case(name, **{"changes": {}, "edits": []} | case) for name, case in cases.items()}


def _plain(value: Any) -> Any:
    """Return a document without what differs from one time to the next, its numbers to seven digits."""
    if hasattr(value, "model_dump"):
        value = value.model_dump(mode="json")
    if isinstance(value, Mapping):
        kept = {str(name): each for name, each in value.items() if name not in LEFT_OUT}
        root = np.array(kept.get("covariance_root") or 0.0)
        if root.ndim == 2:  # the signs of its columns are anything
            kept["covariance_root"] = (root @ root.T).tolist()
        if "contributions" in kept and "correlation" in kept:
            kept["correlation"] = _of_contributions(kept["contributions"], kept["correlation"])
        return {name: _plain(each) for name, each in kept.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, str):
        return OF_TODAY.sub("…", value)
    return float(f"{value:.7g}") if isinstance(value, float) else value


def _of_contributions(contributions: list[float], correlation: list[list[float]]) -> list[list[Any]]:
    """Return correlations (n, n) without those of contributions (n,) that are nothing but rounding."""
    if not all(map(_is_number, contributions)):
        return correlation
    counts = [abs(each) > 1e-6 * max(map(abs, contributions)) for each in contributions]
    return [
        [each if counts[i] and counts[j] else 0.0 for j, each in enumerate(row)]
        for i, row in enumerate(correlation)
    ]


def _identify(document: dict[str, Any], predicted: bool = True, **options: Any) -> Any:
    """Identify; where there is a number for each joint, predict two postures, too."""
    run = js.identify(document, **options)
    out = {"state": run.state, "result": run.result, "error": run.error}
    if predicted and run.result is not None and all(j.compliance is not None for j in run.result.joints):
        out["predicted"] = _predict(document, run=run)
    return out


def _predict(
    document: dict[str, Any],
    run_options: Mapping[str, Any] = MappingProxyType({}),
    *,
    run: Any = None,
    **options: Any,
) -> Any:
    run = run or js.identify(document, **run_options)
    count = len(run.result.joints)
    cases = [
        {"joints": posture[:count], "force": force}
        for posture, force in zip(POSTURES, ([200, 100, -400], [0, -300, 50]), strict=True)
    ]
    units = {"units": {"length": "m", "angle": "rad", "force": "N", "moment": "N.m"}}
    options = units | {"load_point": (0.05, 0.0, 0.12)} | options
    return js.predict(run, options.pop("cases", cases), **options)


def _mended(document: dict[str, Any], **options: Any) -> Any:
    """Return the reasons of a run, and what each action that they advise gives."""
    run = js.identify(document, **options)
    out: dict[str, Any] = {"reasons": run.result.assessment.reasons}
    for action in sorted({each.action.kind for each in run.result.assessment.reasons if each.action}):
        try:
            mended = run.apply(action)
            out[action] = {"request": mended.request, "result": mended.result, "error": mended.error}
        except js.CampaignError as error:
            out[action] = error.problem
    return out


def _compensate(document: dict[str, Any], program: Mapping[str, str], **options: Any) -> Any:
    """Compensate a program that is given as its files' texts."""
    run = js.identify(document, **options.pop("run", {}))
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, name) for name in program]
        for file in files:
            file.write_text(program[file.name])
        result = js.compensate(run, *files, **options).result
    return result.model_dump(mode="json") | {"files": [unpacked(each).decode() for each in result.files]}


def _findings(document: dict[str, Any]) -> Any:
    """Return what the readings alone let find."""
    robot, measurements = prepare(document)
    return list(inspect(robot, measurements, degrees=False))


def _measure(document: dict[str, Any], mistakes: Mapping[str, str] | None = None, **options: Any) -> Any:
    """Measure by a simulated source, or an arm that is read with mistakes; each state on the way."""
    most, said = options.pop("most", 200), []
    with js.measure(document, source="simulated:1", **options) as live:
        while live.state.state == "measuring" and live.next is not None and live.count < most:
            following, mistake = live.next, (mistakes or {}).get(str(live.count))
            if mistakes is None:
                live.run_source(most=live.count + 1)
            else:
                mistake = _observed(live, mistake)
            state = live.state.model_dump(mode="json", exclude={"readings"})
            said.append({**state, "next": following, "mistake": mistake, "last": live.state.readings[-1]})
        return {"states": said, "run": live.close().result, "outcome": live.outcome}


SHIFTS = {"moved": [[2e-4, -1e-4, 3e-4]], "bumped": [[4e-4, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]}
"""Displacements of what is read under load [m]: of all targets, or of each."""


SIZES = {"force": -1.0, "size": 1.4}
"""Stated over true force."""


def _observed(live: Any, mistake: str | None) -> str | None:
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
    except js.CampaignError as error:
        live.skip()
        return str(error.problem.detail)
    return mistake


def _trend(*documents: dict[str, Any]) -> Any:
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
    return trend_of([joint.name for joint in run.result.joints], campaigns)


def _of_result(verb: str) -> Any:
    def result(*campaigns: Any, run_options: Mapping[str, Any] | None = None, **options: Any) -> Any:
        """Do the work on campaigns, or on the run of one by its own options."""
        sources = campaigns if run_options is None else [js.identify(*campaigns, **run_options)]
        return getattr(js, verb)(*sources, **options).result

    return result


_OF_KIND = {
    "identify": _identify,
    "predict": _predict,
    "mended": _mended,
    "compensate": _compensate,
    "measure": _measure,
    "findings": _findings,
    "trend": _trend,
} | {verb: _of_result(verb) for verb in ("compare", "geometry", "map", "plan")}


def differences(then: Any, now: Any, close: float = 1.0) -> list[str]:
    """Return what differs by more than it may, times `close`."""
    found = list[str]()
    settled(then, now, close, found)
    return found


def settled(
    then: Any, now: Any, close: float, found: list[str], where: str = "", floor: float = NOTHING
) -> Any:
    """Return an answer with `UNSETTLED` in place of what differs by more than it may, times `close`.

    Args:
        then: as recorded.
        now: as given today.
        close: factor on all tolerances.
        found: what differs is added to it.
        where: path of the part.
        floor: what counts as nothing there.
    """
    if then == UNSETTLED:
        return then
    if isinstance(then, dict) and isinstance(now, dict) and then.keys() == now.keys():
        uncertainty = then.get("standard_uncertainty")
        if isinstance(uncertainty, float) and _is_number(then.get("compliance")):
            floor = max(floor, BESIDE_U * uncertainty)
        floors = {key: max(floor, LOOSE.get(key, 0.0)) for key in then}
        return {
            key: settled(each, now[key], close, found, f"{where}/{key}", floors[key])
            for key, each in then.items()
        }
    if isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        floor = max(floor, CLOSE * _largest(then))
        pairs = enumerate(zip(then, now, strict=True))
        return [settled(a, b, close, found, f"{where}[{i}]", floor) for i, (a, b) in pairs]
    if not _same(then, now, close, floor):
        found.append(f"{where}: {str(then)[:300]} → {str(now)[:300]}")
        return UNSETTLED
    return then


def _same(then: Any, now: Any, close: float, floor: float) -> bool:
    """Compare two parts that have no parts."""
    if isinstance(then, str) and isinstance(now, str):
        return _same_text(then, now)
    if _is_number(then) and _is_number(now):
        return math.isclose(then, now, rel_tol=close * CLOSE, abs_tol=close * floor)
    return bool(then == now)


def _largest(values: list[Any]) -> float:
    """Return the largest number of a vector or matrix."""
    parts = (_largest(each) if isinstance(each, list) else each for each in values)
    return max((abs(each) for each in parts if _is_number(each)), default=0.0)


def _same_text(then: str, now: str) -> bool:
    """Compare words exactly, and numbers but for the last digit printed."""
    if NUMBER.sub("#", then) != NUMBER.sub("#", now):
        return False
    pairs = zip(NUMBER.findall(then), NUMBER.findall(now), strict=True)
    return all(a == b or abs(_value(a) - _value(b)) <= _tolerance(a) for a, b in pairs)


def _value(text: str) -> float:
    return float(text.replace("−", "-"))


def _tolerance(text: str) -> float:
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    if not decimals and not exponent:
        return 0.0
    return max(1.01 * 10.0 ** (int(exponent or 0) - decimals), CLOSE * abs(_value(text)), 1e-9)


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def record(words: Sequence[str]) -> None:
    """Record the answers of the cases anew that have no answer yet, or whose names have one of the words.

    What the kernels of linear algebra decide, a tenth of a tolerance apart, is not settled.
    """
    cases = recorded()
    with zipfile.ZipFile(ANSWERS) as file:
        kept = {name: json.loads(file.read(name)) for name in file.namelist() if name in cases}
    chosen = [name for name in cases if name not in kept or any(word in name for word in words)]
    made = []
    for kernel in KERNELS:
        environment = os.environ | ({"OPENBLAS_CORETYPE": kernel} if kernel else {})
        command = [sys.executable, "-m", "support.recorded_answers", "--answers", *chosen]
        made.append(json.loads(subprocess.check_output(command, env=environment)))
    unsettled = list[str]()
    for name in chosen:
        kept[name] = made[0][name]
        for other in made[1:]:
            kept[name] = settled(kept[name], other[name], 0.1, unsettled, name)
    with zipfile.ZipFile(ANSWERS, "w", zipfile.ZIP_LZMA) as file:
        for name in cases:
            file.writestr(zipfile.ZipInfo(name), json.dumps(kept[name]), zipfile.ZIP_LZMA)
    sys.stdout.writelines(f"{line}\n" for line in unsettled)


def main(does: str = "", *words: str) -> int:
    """Compare, or record anew; return how many answers differ."""
    if does == "--record":
        record(words)
        return 0
    cases = recorded()
    if does == "--answers":
        json.dump({name: cases[name].again() for name in words}, sys.stdout)
        return 0
    chosen, differing = [case for name, case in cases.items() if does in name], 0
    for case in chosen:
        found = differences(case.answer, case.again())
        differing += bool(found)
        sys.stdout.writelines(f"{case.name} {line}\n" for line in found[:8])
    sys.stdout.write(f"{differing} of {len(chosen)} answers differ\n")
    return differing


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]) > 0)
