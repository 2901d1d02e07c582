"""Usual mistakes of a whole campaign on five makers' arms: is each named by its cause, in one sentence?

Readings are of springs that balance the load, on arms whose links differ from the published ones. Each
mistake is made in arrays, in a data frame and in a file, under forces and, if no load is mistaken, in a
campaign by the arm's own weight. What a person reads are the reasons of the run, or the refusal.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import pandas as pd

import jointstiff as js
from benchmarks.report import Figure, Part, Section
from benchmarks.studies.layouts import Array
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.catalogue import catalogue, nominal_robot
from jointstiff.service.problems import CampaignError
from jointstiff.simulator import SpringArm
from jointstiff.simulator.own_weight import Bodies, sag

__all__ = ["ARMS", "DOORS", "MISTAKES", "Readings", "run", "simulate"]

ARMS = (
    "ABB IRB 4600-60/2.05",
    "FANUC M-20iD/25",
    "KUKA KR 210 R2700 extra",
    "Universal Robots UR10e",
    "Yaskawa GP25",
)
_FIRST_SEED = 56_000
_POSTURES = 16
_NOISE = 2e-5  # of a coordinate [m]
_PLACE_ERROR, _ANGLE_ERROR = 0.7e-3, 0.5e-3  # of a link [m, rad]
_RANGE = np.radians([-100.0, 70.0])  # of each joint, if its limits allow
_LOAD_POINT = np.array([0.0, 0.0, 150.0])  # [mm]
_RATIOS = np.array([600.0, 600.0, 450.0, 80.0, 100.0, 30.0])
"""Stiffness of each joint relative to the torque of payload and reach [rad⁻¹], as of a measured FANUC arm."""
_MASSES = np.array([1.0, 1.0, 0.8, 0.3, 0.2, 0.15])
"""Masses of the bodies relative to the payload."""
_CENTRES = np.array([[0, 0, 0.1], [0, 0, 0.05], [0, 0, 0.05], [0, 0, 0.2], [0, 0, 0.1], [0.05, 0.03, 0.1]])
"""Centres of mass [m] in the frames of the joints, whose z is the axis."""
_TARGETS = np.array([[0.20, -0.11, 0.18], [-0.17, -0.14, 0.25], [0.02, 0.21, 0.12]])
_WHOLE = Part()
_NAMES = ("T1", "T2", "T3")
_LEAST = 100 * 20 / 22
_CAUSES = frozenset(
    (
        "length_unit_suspect",
        "angle_unit_suspect",
        "force_unit_suspect",
        "stiffness_against_payload",
        "another_robot_fits",
        "observations_out_of_order",
        "duplicated_observation",
        "joint_sign_suspect",
        "joints_swapped",
        "joints_counted_otherwise",
        "alternative_explains_better",
        "frame_mistaken",
        "frame_left_handed",
        "lengths_differ",
        "targets_swapped",
        "target_moved",
        "force_sign_suspect",
        "deflection_against_force",
        "cause_fitted",
        "masses_contradicted",
        "base_bends",
        "sigma_suspect",
        "drift_in_time",
    )
)
"""Codes of findings that name a cause; the others describe an effect."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Numbers of a campaign as a person gives them, with the units that the person states."""

    robot: RobotDocument
    joints: Array  # (N, 6) as the controller shows them
    unloaded: Array  # (N, 3, 3)
    loaded: Array | None  # (N, 3, 3); None without loads
    forces: Array | None  # (N, 3) on the robot, axes of R0; None without loads
    angle: str = "deg"
    length: str = "mm"
    force: str = "N"

    @property
    def units(self) -> str:
        """Units as an argument states them."""
        return f"{self.length}, {self.angle}, {self.force}"


@dataclass(frozen=True)
class Mistake:
    """Mistake in readings, and how its cause is named."""

    make: Callable[[Readings], Readings]
    codes: tuple[str, ...]  # of the finding that names the cause
    words: tuple[str, ...]  # of which each must be in its sentence
    needs_load: bool = False


def _place_frames(rows: Array, convention: str) -> Array:
    """Return the frames (7, 4, 4) of six joints and of the flange, at zero; z of a joint is its axis.

    `rows` (6, 4) are a, alpha, d and theta of Denavit and Hartenberg [m, rad].
    """
    whole, frames = np.eye(4), []
    for a, alpha, d, theta in rows:
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1.0]])
        rise = np.eye(4)
        rise[2, 3] = d
        link = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1.0]])
        if convention == "standard":
            frames.append(whole @ turn @ np.linalg.inv(rise))
            whole = whole @ turn @ link
        else:
            whole = whole @ link @ turn
            frames.append(whole)
    return np.array([*frames, whole])


@cache
def _build_arm(name: str, seed: int) -> tuple[SpringArm, Bodies, RobotDocument]:
    """Return an arm whose links differ from those of its document, with its bodies."""
    generator = np.random.default_rng([seed, sum(map(ord, name))])
    arm = next(each for each in catalogue().arms if each.name == name)
    rows = np.array([(row.a, row.alpha, row.d, row.theta) for row in arm.model.rows])
    errors = generator.standard_normal(rows.shape) * [_PLACE_ERROR, _ANGLE_ERROR, _PLACE_ERROR, _ANGLE_ERROR]
    frames = _place_frames(rows + errors, arm.model.convention)
    if arm.payload is None:
        raise ValueError(f"the catalogue has no payload of {name}")
    stiffnesses = _RATIOS * arm.payload * 9.80665 * arm.reach
    springs = SpringArm(
        axis_points=frames[:-1, :3, 3],
        axis_directions=frames[:-1, :3, 2],
        flange_rotation=frames[-1, :3, :3],
        flange_translation=frames[-1, :3, 3],
        stiffnesses=stiffnesses,
    )
    masses = _MASSES * arm.payload
    bodies = Bodies(masses, np.einsum("jab,jb->ja", frames[:-1, :3, :3], _CENTRES))
    stated = [
        {"name": f"link {j + 1}", "joint": f"joint_{j + 1}", "mass": float(mass), "centre": centre.tolist()}
        for j, (mass, centre) in enumerate(zip(masses, _CENTRES, strict=True))
    ]
    document = nominal_robot(arm).model_dump(mode="json", exclude_unset=True)
    return springs, bodies, RobotDocument.model_validate(document | {"bodies": stated})


def simulate(name: str, seed: int, *, loaded: bool) -> Readings:
    """Simulate readings of an arm of the catalogue under pulls, or by its own weight alone."""
    springs, bodies, document = _build_arm(name, seed)
    arm = next(each for each in catalogue().arms if each.name == name)
    generator = np.random.default_rng([seed, 1, sum(map(ord, name))])
    matrix = np.eye(6) if arm.joint_map is None else np.array(arm.joint_map.matrix)
    limits = np.array([(row.lower, row.upper) for row in arm.model.rows], dtype=float)
    lower, upper = np.where(np.isnan(limits), _RANGE, np.clip(limits, *_RANGE)).T
    q = generator.uniform(lower, upper, (_POSTURES, 6))
    joints = np.degrees(np.linalg.solve(matrix, q.T).T)
    pull = generator.standard_normal((_POSTURES, 3))
    weight = (arm.payload or 0.0) * 9.80665
    pull *= weight * generator.uniform(0.6, 1.0, (_POSTURES, 1)) / np.linalg.norm(pull, axis=1)[:, None]
    forces = np.round(pull, 1)
    states = []
    for force in (np.zeros(3), forces):
        bent = q + sag(springs, bodies, q, force=force, load_point=1e-3 * _LOAD_POINT)
        places = springs.posture(bent).targets_to_base(_TARGETS)
        states.append(1e3 * (places + _NOISE * generator.standard_normal(places.shape)))
    if not loaded:
        return Readings(document, joints, states[0], None, None)
    return Readings(document.model_copy(update={"bodies": None}), joints, states[0], states[1], forces)


def _moved(change: Callable[[Array], Array]) -> Callable[[Readings], Readings]:
    """Return a mistake in all positions."""

    def make(readings: Readings) -> Readings:
        loaded = None if readings.loaded is None else change(readings.loaded)
        return replace(readings, unloaded=change(readings.unloaded), loaded=loaded)

    return make


def _turned(change: Callable[[Array], Array]) -> Callable[[Readings], Readings]:
    """Return a mistake in all joints."""
    return lambda readings: replace(readings, joints=change(readings.joints))


def _pulled(change: Callable[[Array], Array]) -> Callable[[Readings], Readings]:
    """Return a mistake in all forces."""

    def make(readings: Readings) -> Readings:
        return readings if readings.forces is None else replace(readings, forces=change(readings.forces))

    return make


def _reverse(*joints: int) -> Callable[[Readings], Readings]:
    signs = np.where(np.isin(np.arange(6), joints), -1.0, 1.0)
    return _turned(lambda q: q * signs)


def _exchange_rows(values: Array) -> Array:
    """Return the values with the rows of two postures exchanged."""
    order = np.arange(len(values))
    order[[3, 9]] = 9, 3
    return values[order]


def _exchange_targets(positions: Array) -> Array:
    """Return the positions with the names of two targets exchanged in the rows of an afternoon."""
    exchanged = positions.copy()
    exchanged[10:] = positions[10:][:, [1, 0, 2]]
    return exchanged


def _mistype(joints: Array) -> Array:
    mistyped = joints.copy()
    mistyped[5, 1] += 10.0
    return mistyped


def _choose_other_arm(readings: Readings) -> Readings:
    """Return the readings with the document of an arm of another maker."""
    is_abb = readings.robot.name.startswith("ABB")
    _, _, document = _build_arm(ARMS[2] if is_abb else ARMS[0], _FIRST_SEED)
    bodies = None if readings.robot.bodies is None else document.bodies
    return replace(readings, robot=document.model_copy(update={"bodies": bodies}))


def _loaded(change: Callable[[Array, Array], tuple[Array, Array]]) -> Callable[[Readings], Readings]:
    """Return a mistake in the unloaded and loaded positions."""

    def make(readings: Readings) -> Readings:
        if readings.loaded is None:
            return readings
        unloaded, loaded = change(readings.unloaded, readings.loaded)
        return replace(readings, unloaded=unloaded, loaded=loaded)

    return make


def _tracker(mirror: float) -> Callable[[Array], Array]:
    """Return the change to the frame of a tracker; `mirror` is −1 for a left-handed frame."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    turn[:, 1] *= mirror
    return lambda p: p @ turn + [2500.0, -1200.0, 400.0]


_LENGTH, _ANGLE, _ROWS = "length_unit_suspect", "angle_unit_suspect", "observations_out_of_order"
_FRAME, _LEFT_HANDED = "frame_mistaken", "frame_left_handed"
_SIGN, _SWAPPED, _COUNTED = "joint_sign_suspect", "joints_swapped", "joints_counted_otherwise"
_MAP = "alternative_explains_better"
_FORCE, _STATES = "force_sign_suspect", "deflection_against_force"

MISTAKES: Mapping[str, Mistake] = {
    "inches as mm": Mistake(_moved(lambda p: p / 25.4), (_LENGTH,), ("in inch, not in mm",)),
    "cm as mm": Mistake(_moved(lambda p: p / 10.0), (_LENGTH,), ("in cm, not in mm",)),
    "m as mm": Mistake(_moved(lambda p: p / 1000.0), (_LENGTH,), ("in m",)),
    "a scale of 1.01": Mistake(_moved(lambda p: 1.01 * p), ("lengths_differ",), ("times those of",)),
    "z y x": Mistake(_moved(lambda p: p[..., ::-1]), (_LEFT_HANDED,), ("z, y, x of the readings",)),
    "y z x": Mistake(_moved(lambda p: p[..., [1, 2, 0]]), (_FRAME,), ("z, x, y of the readings",)),
    "a tracker's frame": Mistake(_moved(_tracker(1.0)), (_FRAME,), ("not in R0",)),
    "a left-handed frame": Mistake(_moved(_tracker(-1.0)), (_LEFT_HANDED,), ("left-handed frame",)),
    "radians as degrees": Mistake(_turned(np.radians), (_ANGLE,), ("in rad, not in deg",)),
    "degrees as radians": Mistake(
        lambda readings: replace(readings, angle="rad"), (_ANGLE,), ("in deg, not in rad",)
    ),
    "sign of J3": Mistake(_reverse(2), (_SIGN, _MAP), ("joint_3", "reversed")),
    "signs of J2, J3, J5": Mistake(_reverse(1, 2, 4), (_SIGN, _MAP), ("joint_2, joint_3, joint_5", "sign")),
    "no signs": Mistake(_turned(np.abs), (_SIGN,), ("the signs are missing",)),
    "J3 from the horizontal": Mistake(
        _turned(lambda q: q + q[:, [1]] * np.eye(6)[2]), (_COUNTED, _MAP), ("joint_3", "joint_2", "joint map")
    ),
    "J4 and J5 exchanged": Mistake(
        _turned(lambda q: q[:, [0, 1, 2, 4, 3, 5]]), (_SWAPPED, _MAP), ("joint_4 and joint_5 exchanged",)
    ),
    "joints from the flange": Mistake(_turned(lambda q: q[:, ::-1]), (_SWAPPED, _MAP), ("in reverse order",)),
    "zero of J2 a quarter turn away": Mistake(
        _turned(lambda q: q + 90.0 * np.eye(6)[1]), (_COUNTED, _MAP), ("-90°", "joint_2")
    ),
    "rows rolled by one": Mistake(_turned(lambda q: np.roll(q, 1, axis=0)), (_ROWS,), ("the row after",)),
    "two rows exchanged": Mistake(_turned(_exchange_rows), (_ROWS,), ("observations[9]",)),
    "another arm": Mistake(_choose_other_arm, ("another_robot_fits",), ("the robot '{arm}'",)),
    "two targets exchanged in some rows": Mistake(
        _moved(_exchange_targets), ("targets_swapped",), ("'T1' and 'T2' are exchanged",)
    ),
    "an angle mistyped": Mistake(_turned(_mistype), ("target_off_model",), ("c06", "joint_2")),
    "loaded and unloaded exchanged": Mistake(
        _loaded(lambda unloaded, loaded: (loaded, unloaded)),
        (_FORCE, _STATES),
        ("exchange the unloaded and",),
        needs_load=True,
    ),
    "forces by the robot": Mistake(
        _pulled(lambda f: -f), (_FORCE, _STATES), ("sign of every force",), needs_load=True
    ),
    "forces in kN as N": Mistake(
        _pulled(lambda f: f / 1e3), ("force_unit_suspect",), ("kN may have been read as N",), needs_load=True
    ),
    "masses in kg as N": Mistake(
        _pulled(lambda f: f / 9.80665), ("stiffness_against_payload",), ("kgf, not in N",), needs_load=True
    ),
    "forces in lbf as N": Mistake(
        _pulled(lambda f: f / 4.4482216), ("stiffness_against_payload",), ("lbf, not in N",), needs_load=True
    ),
    "loaded rolled by one": Mistake(
        _loaded(lambda unloaded, loaded: (unloaded, np.roll(loaded, 1, axis=0))),
        (_ROWS,),
        ("the loaded readings",),
        needs_load=True,
    ),
    "deflections as loaded": Mistake(
        _loaded(lambda unloaded, loaded: (unloaded, loaded - unloaded)),
        ("deflection_implausibly_large",),
        ("to be deflections",),
        needs_load=True,
    ),
}  # fmt: skip
"""Mistake → how it is made, and the words that name its cause."""


def _enter_arrays(readings: Readings) -> js.Campaign:
    return js.Campaign.from_arrays(
        readings.robot,
        readings.joints,
        readings.forces,
        unloaded=readings.unloaded,
        loaded=readings.loaded,
        load_point=_to_length(readings),
        units=readings.units,
        encoders="motor",
        sigma=float(_to_length(readings)[2]) / 150.0 * 0.02,
    )


def _to_length(readings: Readings) -> Array:
    """Return the load point in the stated unit of length."""
    return _LOAD_POINT if readings.length == "mm" else 1e-3 * _LOAD_POINT


def _tabulate(readings: Readings) -> pd.DataFrame:
    """Return the readings as a table with headers, as a person exports it."""
    columns: dict[str, Any] = {"label": [f"c{i + 1:02d}" for i in range(len(readings.joints))]}
    for j in range(6):
        columns[f"J{j + 1} [{readings.angle}]"] = readings.joints[:, j]
    if readings.forces is not None:
        columns |= {f"F{axis} [{readings.force}]": readings.forces[:, i] for i, axis in enumerate("xyz")}
    states = {"unloaded": readings.unloaded}
    if readings.loaded is not None:
        states["loaded"] = readings.loaded
    for target, name in enumerate(_NAMES):
        for state, positions in states.items():
            for i, axis in enumerate("xyz"):
                columns[f"{name} {state} {axis} [{readings.length}]"] = positions[:, target, i]
    return pd.DataFrame(columns)


def _read_file(readings: Readings) -> js.ImportedReadings:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "readings.csv"
        _tabulate(readings).to_csv(file, sep=";", index=False)
        return _read(file, readings)


def _read_frame(readings: Readings) -> js.ImportedReadings:
    return _read(_tabulate(readings), readings)


def _read(source: Path | pd.DataFrame, readings: Readings) -> js.ImportedReadings:
    point = 1e3 * _LOAD_POINT if readings.length == "m" else _LOAD_POINT
    return js.read(source, robot=readings.robot, load_point=tuple(point), encoders="motor")


DOORS: Mapping[str, Callable[[Readings], js.Campaign | js.ImportedReadings]] = {
    "arrays": _enter_arrays,
    "a frame": _read_frame,
    "a file": _read_file,
}

_ASKED: Final = "asked"
"""Code of a question or a fault of the import, which shows the readings before there is a campaign."""


def list_sentences(door: str, readings: Readings) -> list[tuple[str, str]]:
    """Return code and sentence of each reason that a person reads; a refusal has the code `refused`."""
    options: dict[str, Any] = {"weight": {}} if readings.forces is None else {}
    try:
        entered = DOORS[door](readings)
        if isinstance(entered, js.ImportedReadings):
            texts = [*entered.answer.faults, *(question.text for question in entered.questions)]
            if texts:
                return [(_ASKED, text) for text in texts]
            entered = entered.campaign
        run = js.identify(entered, **options)
    except CampaignError as error:
        return [("refused", f"{error.problem.detail}; {error.problem.remedy}")]
    if run.result is None:
        return [("failed", str(run.error))]
    reasons = run.result.assessment.reasons
    return [(each.code, f"{each.where or ''} {each.message}; {each.remedy}") for each in reasons]


def judge(name: str, arm: str, reasons: list[tuple[str, str]]) -> str:
    """Return whether the first reason names the cause, another cause, or none; the others name no other.

    A refusal, or a run that fails, is read as the first reason.
    """
    mistake = MISTAKES[name]
    codes = (*mistake.codes, "refused", "failed")
    others = [code for code, _ in reasons if code not in codes and code in _CAUSES]
    if others:
        return "wrong"
    if not reasons:
        return "silent"
    if reasons[0][0] == _ASKED:
        return _ASKED
    code, sentence = reasons[0]
    is_named = code in codes and all(word.format(arm=arm) in sentence for word in mistake.words)
    return "named" if is_named else "other words"


def run(*, quick: bool = False, part: Part = _WHOLE) -> Iterator[Section]:
    """Judge right readings, and each mistake in each door, with forces and without."""
    arms = ARMS[:1] if quick else ARMS
    doors = list(DOORS)[:1] if quick else list(DOORS)
    for loaded in (True, False):
        names = [name for name, mistake in MISTAKES.items() if loaded or not mistake.needs_load]
        campaigns = list(product(("", *names), arms))
        cases = [
            (name, arm, doors[(number + turn) % len(doors)])
            for turn in range(len(doors))  # part 1/3 has each mistake of each arm once, by all doors in turn
            for number, (name, arm) in enumerate(campaigns)
        ]
        yield _judge_cases([cases[number] for number in part.of(len(cases))], loaded=loaded)


def _judge_cases(cases: list[tuple[str, str, str]], *, loaded: bool) -> Section:
    """Judge cases of mistake, arm and door; a mistake without a name stands for right readings."""
    outcomes: dict[str, Counter[str]] = {}
    for name, arm, door in cases:
        readings = simulate(arm, _FIRST_SEED, loaded=loaded)
        if name:
            readings = MISTAKES[name].make(readings)
        reasons = list_sentences(door, readings)
        outcome = judge(name, arm, reasons) if name else _judge_right(reasons)
        if outcome not in ("named", _ASKED):
            print(f"{name or 'right readings'}, {arm}, {door}: {outcome}: {reasons}", file=sys.stderr)
        outcomes.setdefault(name or "none", Counter())[outcome] += 1
    right = outcomes.pop("none", Counter())
    every = Counter[str]()
    for each in outcomes.values():
        every.update(each)
    share = 100 * (every["named"] + every[_ASKED]) / max(every.total(), 1)
    what = "with forces" if loaded else "without forces"
    kinds = sum(each["named"] + each[_ASKED] == each.total() for each in outcomes.values())
    figures = (
        Figure(f"mistakes named by their cause, or asked about, {what} [%]", share, "at least", _LEAST),
        Figure.none(f"wrong causes of mistakes, {what}", every["wrong"]),
        Figure.none(f"causes of right readings, {what}", right["wrong"]),
    )
    return Section(
        f"{every.total()} campaigns with a mistake, {what}; {kinds} of {len(outcomes)} kinds always",
        ("mistake", "outcomes"),
        tuple((name, str(dict(each))) for name, each in outcomes.items()),
        figures,
    )


def _judge_right(reasons: list[tuple[str, str]]) -> str:
    """Return whether the reasons of right readings name a cause."""
    accusing = (*_CAUSES, "refused", "failed", _ASKED)
    return "wrong" if any(code in accusing for code, _ in reasons) else "named"
