"""Mistakes of a whole set of readings: which correction brings all targets to their places on the flange.

Targets are fixed to the flange. With the joints that were measured, each target therefore has one place in
the flange frame in all observations, within millimetres. If the targets have no such places, the joints, the
lengths, the frame or the robot are not what was stated. Each hypothesis of such a mistake corrects the
readings, and the places decide. A frame is fitted in closed form, as for tables without names
(method.md §17).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from jointstiff.schemas.finding import AdvisedAction, Finding, FindingCode, Unit
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.values import (
    OTHER_UNITS,
    InstrumentFrame,
    View,
    median,
    transform_to_flange,
)
from jointstiff.solver.meaning.decision import (
    LARGEST_PART,
    LARGEST_RESIDUAL,
    LEAST_FREEDOM,
    LEAST_SHARE,
    MIRRORED_SIGNS,
    USUAL_RESIDUAL,
    compute_plausible_scale_error,
)
from jointstiff.solver.meaning.refinement import RigidFit, fit_frame
from jointstiff.solver.meaning.screening import FlangePlaces, LinearFit, choose_subsets, fit_all
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import KnownRobot, Robot
from jointstiff.solver.text import PAST_CARE, PAST_DO_NOT_USE, figure, length_text

LARGEST_MODEL_ERROR: Final = 0.02
"""Greatest plausible distance of a target from its place [m]: more means a wrong frame, joint map, unit or
angle."""
EXPLAINED: Final = 0.8
"""Fraction of the rows that a mistake of the whole set must explain; other rows may have mistakes of their
own."""
_CLEARLY: Final = 0.1
"""Fraction of the rows that a correction must explain in addition to those that fit as posted."""
_ALIKE: Final = 1.5
"""Ratio of residuals up to which positions do not distinguish two robots."""
_MICROMETRES: Final = 6
"""Decimals to which median distances [m] are rounded before two corrections are compared."""
_ANCHORS: Final = 24
"""Number of rows whose targets are tried as the usual places."""
_ROWS: Final = 150
"""Number of rows that suffice to find a mistake of the whole set."""
_LEAST_ROWS: Final = 4
"""Least number of rows that can show another robot."""
_LEAST_ROWS_OF_COUNTING: Final = 5
"""Least number of rows that can show another counting of the joints: there are many."""
_MOST_REVERSED: Final = 7
"""Most joints of a robot for which all sets of reversed joints are tried."""
_MOST_TARGETS: Final = 4
"""Targets that suffice to find a frame: those that were read most often."""
_SAME_AXES: Final = 0.03
"""Largest difference of a rotation from exchanged axes [rad]."""
_SIZES_OF_LENGTHS: Final = {"m": (1.0, 4), "mm": (1e-3, 1)}
"""Unit of a set's lengths → its size [m], and decimals that show a tenth of a millimetre."""
_LEAST_TURN: Final = 0.1
"""Least change of the flange's orientation [rad] that shows where the origin of a frame is."""
_SCALE_BY_RESIDUAL: Final = 3.0
"""Least change of the positions by a scale, relative to the residual that is left."""
_LARGEST_ZERO: Final = 0.1
"""Largest error of a joint's zero that is searched [rad]: quarter turns are searched elsewhere."""
_LEAST_ZERO: Final = 5e-3
"""Least error of a joint's zero that is reported [rad]: marks and gauges set zeros to a tenth of it."""
_ZERO_TOLERANCE: Final = 1e-5
"""Tolerance of the search for a zero [rad]."""
_ZERO_BY_RESIDUAL: Final = 3.0
"""Least ratio of the distances as posted and with the zero corrected."""
_CENTIMETRES_AND_INCHES: Final = (
    ("cm", "mm", 10.0),
    ("cm", "m", 1e-2),
    ("inch", "mm", 25.4),
    ("inch", "m", 0.0254),
)
"""True unit that a set cannot declare, declared unit, and factor on the lengths."""


@dataclass(frozen=True, eq=False)
class JointCorrection:
    """Joint positions as the controller counts them, from those as posted: M q + b."""

    matrix: FloatArray  #: M (n, n)
    offset: FloatArray  #: b (n,) [rad]


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Assumed mistake, with the joint positions of some rows corrected for it."""

    code: FindingCode  #: code of the finding if the mistake is confirmed
    joints: FloatArray  #: (M, n) joints as the controller shows them [rad or m]
    change: str  #: change that was tried, in words for a message, after "with"
    remedy: str  #: the proposed correction
    rows: IndexArray  #: (M,) positions of the corrected rows among the rows that are checked
    length: float = 1.0  #: factor on the positions
    units: tuple[Unit, ...] = ()  #: true units of the numbers, for mistaken units that a set can declare
    correction: JointCorrection | None = None  #: for a mistake that another joint map corrects
    cause: str = ""  #: the mistake in words, if the change does not say it
    exchanged: tuple[str, ...] = ()  #: names of two joints whose columns are exchanged
    shift: int = 0  #: rows from each row to the row whose angles are right


def propose_unit_mistakes(joints: FloatArray, prismatic: BoolArray) -> Iterator[Hypothesis]:
    """Yield the hypotheses that all lengths, or all angles, were given in another unit.

    Args:
        joints: (M, n) joint positions of the controller as posted [rad or m].
        prismatic: (n,) mask of the joints whose positions are lengths.
    """
    # Factors apply to prismatic joints only, conversions of angles to the other joints only.
    rows = np.arange(len(joints))
    shorter = joints * np.where(prismatic, 1e-3, 1.0)
    longer = joints * np.where(prismatic, 1e3, 1.0)
    from_degrees = np.where(prismatic, joints, np.deg2rad(joints))
    from_radians = np.where(prismatic, joints, np.rad2deg(joints))
    # True unit, corrected joint positions, factor on all lengths, and the change in words
    units: list[tuple[Unit, FloatArray, float, str]] = [
        ("mm", shorter, 1e-3, "all lengths divided by 1000"),
        ("m", longer, 1e3, "all lengths multiplied by 1000"),
        ("deg", from_degrees, 1.0, "all angles taken as degrees"),
        ("rad", from_radians, 1.0, "all angles taken as radians"),
    ]
    for unit, corrected, length_factor, change in units:
        code = OTHER_UNITS[unit].code
        yield Hypothesis(code, corrected, change, "", rows, length_factor, (unit,))
    for true_unit, declared, factor in _CENTIMETRES_AND_INCHES:
        corrected = joints * np.where(prismatic, factor, 1.0)
        change = f"all lengths multiplied by {factor:g}"
        remedy = f"multiply all lengths by {factor:g}: {true_unit} to {declared}; {PAST_DO_NOT_USE}"
        cause = f"the lengths seem to be in {true_unit}, not in {declared} as declared"
        yield Hypothesis("length_unit_suspect", corrected, change, remedy, rows, factor, cause=cause)


def _propose_both_units(joints: FloatArray, prismatic: BoolArray) -> Iterator[Hypothesis]:
    """Yield the hypotheses that all lengths and all angles were given in other units."""
    by_unit = {each.units[0]: each for each in propose_unit_mistakes(joints, prismatic) if each.units}
    pairs: list[tuple[Unit, Unit]] = [("mm", "deg"), ("mm", "rad"), ("m", "deg"), ("m", "rad")]
    for length, angle in pairs:
        lengths, angles = by_unit[length], by_unit[angle]
        yield replace(
            lengths,
            joints=np.where(prismatic, lengths.joints, angles.joints),
            change=f"{lengths.change} and {angles.change}",
            units=(length, angle),
        )


def propose_angle_mistakes(
    joints: FloatArray, rows: IndexArray, names: tuple[str, ...]
) -> Iterator[Hypothesis]:
    """Yield the hypotheses of a wrong sign, two exchanged joints, shifted rows and a transposed array.

    Args:
        joints: (N, n) controller angles of the whole set [rad].
        rows: (M,) indices of the rows whose angles are corrected.
        names: names of the controller's joints.
    """
    angles, all_rows = joints[rows], np.arange(len(rows))
    for j in range(len(names)):
        yield _reverse_joints(angles, names, (j,))
    for j, k in combinations(range(len(names)), 2):
        exchanged_order = np.arange(len(names))
        exchanged_order[[j, k]] = k, j
        change = f"the angles of {names[j]} and {names[k]} exchanged"
        remedy = f"exchange the columns of {names[j]} and {names[k]} in every observation"
        corrected, pair = angles[:, exchanged_order], (names[j], names[k])
        yield Hypothesis("joints_swapped", corrected, change, remedy, all_rows, exchanged=pair)
    for shift, neighbour in ((-1, "before"), (1, "after")):
        # Rows whose neighbour exists
        rows_with_neighbour = np.flatnonzero((rows + shift >= 0) & (rows + shift < len(joints)))
        if len(rows_with_neighbour):
            change = f"the angles of the row {neighbour}"
            remedy = (
                f"shift the readings by one row: each reading belongs to the angles of the row {neighbour}"
            )
            shifted = joints[rows[rows_with_neighbour] + shift]
            code: FindingCode = "observations_out_of_order"
            yield Hypothesis(code, shifted, change, remedy, rows_with_neighbour, shift=shift)
    if len(joints) == len(names):  # only a square array hides that it is transposed
        change = "rows and columns of the joints exchanged"
        remedy = "transpose the array of the joints: a row for each observation, a column for each joint"
        yield Hypothesis("joints_swapped", joints.T[rows], change, remedy, all_rows)


def propose_countings(angles: FloatArray, robot: Robot) -> Iterator[Hypothesis]:
    """Yield the hypotheses that a controller counts the joints in another way than the joint map states.

    These are several reversed joints, all joints in reverse order, a third joint from the horizontal, and a
    joint whose zero is a quarter turn away.

    Args:
        angles: (M, n) controller angles as posted [rad].
        robot: robot with n joints.
    """
    names, n, rows = robot.joint_names, robot.n, np.arange(len(angles))
    if robot.prismatic.any() or len(angles) < _LEAST_ROWS_OF_COUNTING:
        return
    for count in range(2, n + 1 if n <= _MOST_REVERSED else 2):
        for joints in combinations(range(n), count):
            yield _reverse_joints(angles, names, joints)
    backwards = np.eye(n)[::-1]
    remedy = f"reverse the order of the columns: {names[-1]} was given as {names[0]}, and so on"
    change = "the joints in reverse order"
    correction = JointCorrection(backwards, np.zeros(n))
    yield Hypothesis("joints_swapped", angles[:, ::-1], change, remedy, rows, correction=correction)
    for sign, word in ((-1.0, "minus"), (1.0, "plus")) if n > 2 else ():
        matrix = np.eye(n)
        matrix[2, 1] = sign
        change = f"{names[2]} {word} {names[1]} as the angle of {names[2]}"
        remedy = f"use the suggested joint map: the controller counts {names[2]} together with {names[1]}"
        correction = JointCorrection(matrix, np.zeros(n))
        yield Hypothesis(
            "joints_counted_otherwise", angles @ matrix.T, change, remedy, rows, correction=correction
        )
    for joint in range(n):
        for turn in (-90, 90, 180):
            offset = np.zeros(n)
            offset[joint] = np.radians(turn)
            change = f"{turn:+d}° added to {names[joint]}"
            remedy = f"use the suggested joint map: the zero of {names[joint]} is {abs(turn)}° away"
            correction = JointCorrection(np.eye(n), offset)
            yield Hypothesis(
                "joints_counted_otherwise", angles + offset, change, remedy, rows, correction=correction
            )


def _reverse_joints(angles: FloatArray, names: Sequence[str], joints: Sequence[int]) -> Hypothesis:
    """Return the hypothesis that some joints have the opposite sign."""
    signs = np.ones(len(names))
    signs[list(joints)] = -1.0
    words = ", ".join(names[joint] for joint in joints)
    noun = "the sign of the angle of" if len(joints) == 1 else "the signs of the angles of"
    remedy = f"change the sign of {words} in every observation, or in the joint map"
    rows = np.arange(len(angles))
    correction = JointCorrection(np.diag(signs), np.zeros(len(names)))
    change = f"{noun} {words} reversed"
    return Hypothesis("joint_sign_suspect", angles * signs, change, remedy, rows, correction=correction)


@dataclass(frozen=True, eq=False)
class Trial:
    """Hypothesis of a mistake, with the places that the targets have after its correction."""

    hypothesis: Hypothesis
    places: FloatArray  #: (T, 3) places of the targets on the flange [m]
    distances: FloatArray  #: (M,) greatest distance of a target from its place in each corrected row [m]
    movement: float  #: largest standard deviation of a coordinate of all corrected positions [m]

    @property
    def explained(self) -> BoolArray:
        """Mask (M,) of the corrected rows whose targets are near their places.

        Targets that hardly move have the same places with an arm that hardly moves: they explain nothing.
        """
        moves = self.movement > LARGEST_MODEL_ERROR
        return np.asarray((self.distances <= LARGEST_MODEL_ERROR) & moves)

    @property
    def rank(self) -> tuple[int, float]:
        """Number of the rows that the hypothesis explains, then minus the median distance [m]."""
        return int(self.explained.sum()), -round(median(self.distances), _MICROMETRES)


def find_best_trial(view: View, sample: IndexArray) -> Trial:
    """Find the mistake in units or joints whose correction brings most rows to the same places.

    Of several such mistakes, the one with the least median distance of the targets is returned; of equal
    ones, the simplest.

    Args:
        view: measurement set.
        sample: (M,) indices of the rows that are corrected.
    """
    joints = view.measurements.joints
    units = propose_unit_mistakes(joints[sample], view.robot.prismatic)
    both = _propose_both_units(joints[sample], view.robot.prismatic)
    angles = propose_angle_mistakes(joints, sample, view.robot.joint_names)
    countings = propose_countings(joints[sample], view.robot)
    return max(
        (_try(view, sample, hypothesis) for hypothesis in (*units, *both, *angles, *countings)),
        key=lambda trial: trial.rank,
    )


def _try(view: View, sample: IndexArray, hypothesis: Hypothesis) -> Trial:
    """Correct rows for a mistake, and find the places on which most of them agree."""
    chosen = sample[hypothesis.rows]
    postures = Postures(view.robot, view.robot.joint_map.model_angles(hypothesis.joints))
    position = hypothesis.length * view.measurements.position[chosen]
    corrected = transform_to_flange(postures, position, view.measured[chosen])
    places = find_consensus_places(corrected)
    movement = float(position[view.measured[chosen]].std(axis=0).max())
    return Trial(hypothesis, places, greatest_distances(corrected, places), movement)


def report_trial(view: View, trial: Trial, agreeing: BoolArray, rows: IndexArray) -> Finding:
    """Build the finding that one mistake explains the whole set, with the action that corrects it.

    Args:
        view: measurement set.
        trial: the mistake.
        agreeing: (M,) mask of the rows that agree as posted.
        rows: (M,) indices of the rows.
    """
    hypothesis, explained = trial.hypothesis, trial.explained
    effect = (
        "with the data as given, the targets keep their positions on the flange (up to "
        f"{length_text(LARGEST_MODEL_ERROR)} is plausible) in only {agreeing.sum()} of {len(agreeing)} "
        f"observations; with {hypothesis.change}, in {explained.sum()} of {len(explained)}, "
        f"within {length_text(float(trial.distances[explained].max()))}"
    )
    if hypothesis.units:
        return view.suspect_other_units(hypothesis.units, effect)
    if hypothesis.cause:
        effect = f"{hypothesis.cause}: {effect}"
    action = None
    if hypothesis.exchanged:
        action = AdvisedAction.of("exchange_columns", joints=hypothesis.exchanged)
    if hypothesis.correction is not None:
        action = _advise_joint_map(view.robot, hypothesis.correction)
        # An arm in a plane and its mirror image have the same places: both causes are stated.
        found = _fit_frame_of(view, rows)
        axes = None if found is None else _name_axes(view, found)
        if axes is not None:
            effect += f"; x, y, z given as {axes} explain the readings as well"
    return view.build_finding(hypothesis.code, effect, hypothesis.remedy, "do_not_use", action)


def _advise_joint_map(robot: Robot, correction: JointCorrection) -> AdvisedAction:
    """Return the action that applies a correction of the joint positions by another joint map."""
    joint_map = robot.joint_map
    matrix = joint_map.matrix @ correction.matrix
    offset = joint_map.matrix @ correction.offset + joint_map.offset
    changed = np.abs(correction.matrix - np.eye(len(matrix))).any(axis=1) | (correction.offset != 0.0)
    names = [robot.joint_names[joint] for joint in np.flatnonzero(changed)]
    return AdvisedAction.of(
        "apply_joint_map", joints=names, joint_map=matrix.tolist(), offset=offset.tolist()
    )


def find_zero_mistake(view: View, rows: IndexArray) -> Finding | None:
    """Return the finding that the zero of one joint is off; None unless one zero explains the distances.

    The last joint turns all targets on the flange alike, so that its zero does not show.

    Args:
        view: measurement set whose targets are farther from their places than those of most robots.
        rows: (M,) indices of the rows with positions.
    """
    robot, sample = view.robot, sample_rows(rows)
    before = median(_measure_at_offset(view, sample, np.zeros(robot.n)))
    after, joint, offset = search_zero(view, rows)
    if after > before / _ZERO_BY_RESIDUAL or abs(offset) < _LEAST_ZERO:
        return None
    name = robot.joint_names[joint]
    unit, size = ("°", np.degrees(offset)) if view.degrees else (" rad", offset)
    amount = f"{figure(size, '.2g')}{unit}"
    correction = JointCorrection(np.eye(robot.n), offset * np.eye(robot.n)[joint])
    return view.build_finding(
        "joints_counted_otherwise",
        f"the targets are {length_text(before)} from their places on the flange in the median; with {amount} "
        f"added to {name} in every observation, {length_text(after)}",
        f"check the zero of {name}, its mastering or its offset in the joint map; {PAST_CARE}",
        "use_with_care",
        _advise_joint_map(robot, correction),
    )


def search_zero(view: View, rows: IndexArray) -> tuple[float, int, float]:
    """Search the zero of one joint with which the targets are nearest to their places on the flange.

    Returns:
        The median distance of a target from its place [m], infinite without a revolute joint before the last;
        the index of the joint; and what must be added to its positions [rad].
    """
    robot, sample = view.robot, sample_rows(rows)
    trials = [(float("inf"), 0, 0.0)]
    for joint in np.flatnonzero(~robot.prismatic[:-1]).tolist():
        direction = np.eye(robot.n)[joint]
        found = minimize_scalar(
            lambda offset, direction=direction: median(_measure_at_offset(view, sample, offset * direction)),
            bounds=(-_LARGEST_ZERO, _LARGEST_ZERO),
            method="bounded",
            options={"xatol": _ZERO_TOLERANCE},
        )
        trials.append((float(found.fun), joint, float(found.x)))
    return min(trials)


def _measure_at_offset(view: View, sample: IndexArray, offset: FloatArray) -> FloatArray:
    """Return for each row (M,) of a sample the greatest distance of a target from its place [m].

    `offset` (n,) is added to all joint positions of the controller [rad or m].
    """
    measurements = view.measurements[sample]
    postures = Postures(view.robot, view.robot.joint_map.model_angles(measurements.joints + offset))
    seen = transform_to_flange(postures, measurements.position, view.measured[sample])
    return greatest_distances(seen, compute_median_places(seen))


def find_missing_signs(view: View, rows: IndexArray) -> Finding | None:
    """Return the finding that angles were given without their signs; None unless signs explain the rows.

    `rows` (M,) are the rows whose targets have no common places as posted.
    """
    robot, joints = view.robot, view.measurements.joints
    is_possible = robot.n <= _MOST_REVERSED and len(rows) >= _LEAST_ROWS_OF_COUNTING
    if not is_possible or robot.prismatic.any() or (joints < 0.0).any():
        return None
    signs = np.array(np.meshgrid(*[[1.0, -1.0]] * robot.n)).reshape(robot.n, -1).T
    sample = sample_rows(rows)
    count = len(signs)
    angles = joints[sample, None] * signs
    postures = Postures(robot, robot.joint_map.model_angles(angles.reshape(-1, robot.n)))
    position = np.repeat(view.measurements.position[sample], count, axis=0)
    measured = np.repeat(view.measured[sample], count, axis=0)
    in_flange = transform_to_flange(postures, position, measured)
    in_flange = in_flange.reshape(len(sample), count, *in_flange.shape[1:])
    by_anchor = [
        np.nan_to_num(np.linalg.norm(in_flange - places, axis=3)).max(axis=2).min(axis=1)
        for places in in_flange[0]
    ]
    best = max(by_anchor, key=lambda distance: int((distance <= LARGEST_MODEL_ERROR).sum()))
    explained = best <= LARGEST_MODEL_ERROR
    if explained.sum() < EXPLAINED * len(sample):
        return None
    return view.build_finding(
        "joint_sign_suspect",
        "no joint angle is negative, and the targets keep their positions on the flange in "
        f"{explained.sum()} of {len(sample)} observations, within "
        f"{length_text(float(best[explained].max()))}, only if some angles of each observation are negative: "
        "the signs are missing",
        f"give the angles of all observations with their signs; {PAST_DO_NOT_USE}",
        "do_not_use",
    )


def inspect_other_robots(view: View, others: Iterable[KnownRobot]) -> Iterator[Finding]:
    """Report other robots that explain the positions better than the chosen robot, the best first.

    A robot explains an observation if the targets are at their usual places on its flange, within
    `LARGEST_MODEL_ERROR`. The robot is reported if it explains the fraction `EXPLAINED` of the observations,
    the chosen robot explains clearly fewer, and the robot fits these observations as well as arms usually fit
    their nominal models. R0 is fitted, too: a wrong length or zero moves all places by millimetres, in a way
    that a small turn or shift of R0 mostly explains, whereas no such turn makes another arm fit.

    Args:
        view: measurement set with the chosen robot.
        others: robots to try; robots with other kinds of joints are skipped.
    """
    # A target that was read only once has no usual place.
    is_compared = view.measured & (view.measured.sum(axis=0) > 1)
    rows = sample_rows(np.flatnonzero(is_compared.any(axis=1)))
    if len(rows) < _LEAST_ROWS:
        return
    sample, is_compared, fits = view.measurements[rows], is_compared[rows], []
    chosen_distances = _see_from_flange(view.robot, sample, is_compared).distances
    explained_by_chosen = int((chosen_distances <= LARGEST_MODEL_ERROR).sum())
    for known in chain(view.robot.list_misreadings(), others):
        if known.robot.joint_kinds != view.robot.joint_kinds:
            continue
        seen = _see_from_flange(known.robot, sample, is_compared)
        is_explained = seen.distances <= LARGEST_MODEL_ERROR
        count = int(is_explained.sum())
        explains_more = count > explained_by_chosen + _CLEARLY * len(rows)
        if count < EXPLAINED * len(rows) or not explains_more:
            continue
        residual = seen[is_explained].measure_residual()
        if residual <= USUAL_RESIDUAL:
            fits.append(_RobotFit(known, count, float(seen.distances[is_explained].max()), residual))
    fits.sort(key=lambda fit: (-fit.explained, round(fit.residual, _MICROMETRES)))
    for fit in fits:
        equals = [f"'{each.known.name}'" for each in fits if each is not fit and _are_alike(each, fit)]
        tie = f"; {' and '.join(equals)} fit{'s' if len(equals) == 1 else ''} as well" if equals else ""
        name, identifier = fit.known.name, fit.known.identifier
        remedy, action = fit.known.remedy, None
        if not remedy:
            remedy = f"check which robot was measured; if '{name}' was measured, choose this robot"
            action = AdvisedAction.of("choose_robot", robot=name, robot_id=identifier)
        yield view.build_finding(
            "another_robot_fits",
            f"with the robot '{name}', the targets keep their places on the flange in {fit.explained} "
            f"of {len(rows)} observations, within {length_text(fit.greatest_distance)}; with the chosen "
            f"robot, in only {explained_by_chosen} of {len(rows)}, within "
            f"{length_text(LARGEST_MODEL_ERROR)}{tie}",
            remedy,
            "do_not_use",
            action,
        )


@dataclass(frozen=True, eq=False)
class _RobotFit:
    """Known robot whose model gives the targets the same places on the flange in most observations."""

    known: KnownRobot  #: the robot
    #: number of explained observations: all targets are within `LARGEST_MODEL_ERROR` of their usual places
    explained: int
    greatest_distance: float  #: greatest distance of a target from its usual place in these observations [m]
    residual: float  #: of these observations after the fit of R0 [m]


@dataclass(frozen=True, eq=False)
class _SeenFromFlange:
    """T targets in M observations, as seen from the flange of a robot that may have been measured."""

    rotation: FloatArray  #: (M, 3, 3) rotation of the flange
    place: FloatArray  #: (M, 3) place of the flange [m]
    points: FloatArray  #: (M, T, 3) positions of the targets in R0 [m]; NaN for those that are not compared
    usual_places: FloatArray  #: (T, 3) places of the targets on the flange on which most agree [m]
    distances: FloatArray  #: (M,) greatest distance of a target from its usual place [m]

    def __getitem__(self, rows: BoolArray) -> _SeenFromFlange:
        """Return some observations, chosen by a mask (M,), with the usual places of all."""
        return _SeenFromFlange(
            self.rotation[rows],
            self.place[rows],
            self.points[rows],
            self.usual_places,
            self.distances[rows],
        )

    def measure_residual(self) -> float:
        """Return the residual [m] after a fit of R0; infinite if R0 is far off, or the fit cannot decide."""
        is_read = np.isfinite(self.points).all(axis=2).any(axis=0)
        points, targets = self.points[:, is_read], self.usual_places[is_read]
        fit = fit_frame(self.rotation, self.place, points, np.eye(3), targets)
        decides = fit.degrees_of_freedom >= LEAST_FREEDOM and fit.frame.is_base
        return fit.residual if decides else float("inf")


def _see_from_flange(robot: Robot, sample: Measurements, is_compared: BoolArray) -> _SeenFromFlange:
    """Compute where the targets of observations are as seen from the flange of a robot.

    Args:
        robot: robot that may have been measured.
        sample: M observations of T targets.
        is_compared: (M, T) mask of the targets that are compared.
    """
    postures = Postures(robot, robot.joint_map.model_angles(sample.joints))
    in_flange = transform_to_flange(postures, sample.position, is_compared)
    usual_places = find_consensus_places(in_flange)
    return _SeenFromFlange(
        rotation=postures.flange_rotation,
        place=postures.flange_translation,
        points=np.where(is_compared[..., None], sample.position, np.nan),
        usual_places=usual_places,
        distances=greatest_distances(in_flange, usual_places),
    )


def _are_alike(first: _RobotFit, second: _RobotFit) -> bool:
    """Return whether two robots explain the positions about equally well."""
    smaller, larger = sorted(round(fit.residual, _MICROMETRES) for fit in (first, second))
    return larger <= _ALIKE * smaller


def find_frame_mistake(view: View, rows: IndexArray) -> Finding | None:
    """Return the finding that positions are in another frame, or that their axes are exchanged.

    None is returned if no frame explains the positions, or if R0 does. A flange that keeps its orientation,
    such as that of linear axes, does not show whether a frame or the targets are elsewhere: only a turn of
    the frame is named then.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows with positions.
    """
    found = _fit_frame_of(view, rows)
    if found is None:
        return None
    fit = found.fit
    axes = _name_axes(view, found)
    within = f"within {length_text(fit.typical)} in the median of {len(fit.distances)} observations"
    if axes is not None:
        message = (
            f"the axes of the positions are exchanged: x, y, z of R0 are {axes} of the readings, {within}"
        )
        remedy = f"give the positions as {axes}; {PAST_DO_NOT_USE}"
        code: FindingCode = "frame_left_handed" if fit.frame.is_mirrored else "frame_mistaken"
        return view.build_finding(code, message, remedy, "do_not_use")
    if fit.frame.is_mirrored:
        return _report_left_handed_frame(view, rows, within)
    return _report_frame(view, found, within)


def _report_frame(view: View, found: _FrameFit, within: str) -> Finding | None:
    """Build the finding that positions are in another frame, with the frame to state; None if R0 fits.

    Args:
        view: measurement set.
        found: frame of the positions.
        within: distance of the targets from their places, in words.
    """
    fitted = InstrumentFrame(found.fit.frame.rotation, found.shown_origin)
    cosine_of_turn = 0.5 * (np.trace(fitted.rotation) - 1.0)
    turn = float(np.degrees(np.arccos(np.clip(cosine_of_turn, -1.0, 1.0))))
    distance = float(np.linalg.norm(fitted.translation))
    if turn < 1.0 and distance < LARGEST_MODEL_ERROR:
        return None
    message = f"the positions are not in R0: the targets keep their places on the flange, {within}, if the "
    if view.frame is None:
        message += f"positions are in a frame that is turned by {turn:.3g}° against R0"
    else:
        message += f"frame of the readings is turned by {turn:.3g}° against the stated `frame`"
    fitted = fitted.after(view.frame)
    stated = "state the `frame` of the readings"
    if found.shows_origin:
        of_other = "R0" if view.frame is None else "the stated frame"
        message += f", and whose origin is {length_text(distance)} from that of {of_other}"
        inverse = None if view.frame is None else view.frame.inverse
        if inverse is not None and _are_alike_frames(fitted, inverse):
            fitted = inverse
            message = (
                "the stated `frame` is the inverse: it leads from R0 to the frame of the readings; with its "
                f"inverse, the targets keep their places on the flange, {within}"
            )
            stated = "state the `frame` from the readings to R0"
    axes_rows = ", ".join(f"[{', '.join(f'{each:.5f}' for each in row)}]" for row in fitted.rotation)
    fitting = f"`rotation` [{axes_rows}] fits, and these orientations of the flange do not show `translation`"
    if found.shows_origin:
        size, digits = _SIZES_OF_LENGTHS[view.length_unit]
        place = ", ".join(f"{each / size:.{digits}f}" for each in fitted.translation)
        fitting = f"`rotation` [{axes_rows}] and `translation` [{place}] {view.length_unit} fit"
    remedy = f"{stated}: {fitting}, or identify the frame by `geometry`; {PAST_DO_NOT_USE}"
    return view.build_finding("frame_mistaken", message, remedy, "do_not_use")


def _are_alike_frames(first: InstrumentFrame, second: InstrumentFrame) -> bool:
    """Return whether two frames differ by no more than the error of a fit."""
    turn = float(np.abs(first.rotation - second.rotation).max())
    distance = float(np.linalg.norm(first.translation - second.translation))
    return turn <= _SAME_AXES and distance <= 2.0 * LARGEST_MODEL_ERROR


def _report_left_handed_frame(view: View, rows: IndexArray, within: str) -> Finding:
    """Build the finding that positions are in a left-handed frame, or that the arm is mirrored instead.

    An arm whose axes are in a plane at zero is its own mirror image after the signs of joints 1, 4 and 6 are
    reversed: the readings then fit as well in a right-handed frame, and cannot decide.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows with positions.
        within: distance of the targets from their places, in words.
    """
    message = (
        f"the positions are in a left-handed frame: the targets keep their places on the flange, {within}, "
        "only if one axis of the positions is reversed"
    )
    remedy = "reverse the sign of y of all positions, and check the set again, which then states its frame"
    if view.robot.n == len(MIRRORED_SIGNS):
        mirrored = replace(view.measurements, joints=view.measurements.joints * MIRRORED_SIGNS)
        twin = _fit_frame_of(replace(view, measurements=mirrored), rows)
        if twin is not None and not twin.fit.frame.is_mirrored:
            reversed_names = np.array(view.robot.joint_names)[MIRRORED_SIGNS < 0.0]
            names = ", ".join(reversed_names)
            message += f", or if {names} are reversed and the positions are in another frame than R0"
            remedy += f"; or, if the axes of the instrument are right, change the signs of {names}"
    return view.build_finding("frame_left_handed", message, f"{remedy}; {PAST_DO_NOT_USE}", "do_not_use")


def find_scale_mistake(view: View, rows: IndexArray) -> Finding | None:
    """Return the finding that all lengths differ from those of the model by one factor; None without it.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows with positions.
    """
    found = _fit_frame_of(view, rows, scale_is_free=True)
    if found is None:
        return None
    scale = found.factor
    is_clear = abs(scale - 1.0) * found.movement > _SCALE_BY_RESIDUAL * found.fit.typical
    plausible = compute_plausible_scale_error(found.movement)
    if abs(scale - 1.0) <= plausible or not is_clear:
        return None
    is_in_base = np.allclose(found.fit.frame.rotation, np.eye(3), atol=_SAME_AXES)
    if not is_in_base:
        return None
    return view.build_finding(
        "lengths_differ",
        f"the lengths of the readings are {figure(1.0 / scale)} times those of the robot's model, all alike "
        f"within {length_text(found.fit.typical)} in the median; up to {100 * plausible:.1g} % is plausible",
        "check which robot was measured, and the scale of the tracker: its unit, its scale bar, temperature "
        f"and air pressure; {PAST_CARE}",
    )


@dataclass(frozen=True, eq=False)
class _FrameFit:
    """Frame of the positions in which the targets keep their places on the flange."""

    fit: RigidFit
    movement: float  #: largest standard deviation of a coordinate [m]
    factor: float  #: factor on the positions before the fit
    shown: FloatArray  #: (D, 3) directions in R0 along which the postures show the place of the origin

    @property
    def shows_origin(self) -> bool:
        """Return whether the postures show the place of the frame's origin along all axes."""
        return len(self.shown) == 3

    @property
    def shown_origin(self) -> FloatArray:
        """Origin (3,) of the frame in R0 [m]; zero along the directions that the postures do not show."""
        return np.asarray(self.shown.T @ (self.shown @ self.fit.frame.origin))


def _fit_frame_of(view: View, rows: IndexArray, *, scale_is_free: bool = False) -> _FrameFit | None:
    """Fit the frame of the positions of some rows; return None if the targets do not keep their places."""
    sample = sample_rows(rows)
    most_read = np.argsort(-view.measured[sample].sum(axis=0), kind="stable")[:_MOST_TARGETS]
    known = view.measured[np.ix_(sample, most_read)]
    if known.sum() * 3 < LEAST_FREEDOM + 12 + 3 * len(most_read):
        return None
    points = np.where(known[..., None], view.measurements.position[np.ix_(sample, most_read)], np.nan)
    points = points[:, known.any(axis=0)]
    rotation, place = view.postures.flange_rotation[sample], view.postures.flange_translation[sample]
    linear = _fit_linear(rotation, place, points)
    if linear is None:
        return None
    fit = fit_frame(rotation, place, points, linear.matrix, linear.targets)
    factor = 1.0
    if scale_is_free:
        factor = fit.free_scale
        fit = fit_frame(rotation, place, factor * points, linear.matrix / factor, linear.targets)
    movement = fit.frame.scale * float(np.nanstd(points - np.nanmean(points, axis=0), axis=0).max())
    distances = fit.distances[np.isfinite(fit.distances)]
    share = float(np.mean(distances <= 2.0 * LARGEST_RESIDUAL))
    fits = (
        fit.typical <= min(LARGEST_RESIDUAL, LARGEST_PART * movement)
        and share >= LEAST_SHARE
        and fit.degrees_of_freedom >= LEAST_FREEDOM
        and fit.unit == "m"
    )
    return _FrameFit(fit, movement, factor, _find_shown_directions(rotation)) if fits else None


def _find_shown_directions(rotation: FloatArray) -> FloatArray:
    """Return the directions (D, 3) in R0 along which M postures show the origin of a frame.

    The origin and the targets can be moved together along a direction that all rotations of the flange keep,
    such as the vertical of a SCARA, and the positions stay: ``Rᵢᵀ a = R₁ᵀ a`` for all postures.

    Args:
        rotation: (M, 3, 3) of the flange.
    """
    changes = (rotation - rotation[0]).swapaxes(1, 2).reshape(-1, 3)
    _, singular_values, directions = np.linalg.svd(changes, full_matrices=False)
    return np.asarray(directions[singular_values > _LEAST_TURN * np.sqrt(len(rotation))])


def _fit_linear(rotation: FloatArray, place: FloatArray, points: FloatArray) -> LinearFit | None:
    """Fit positions (M, K, 3) in closed form, in all rows and in subsets of them; return the best fit."""
    count = len(points)
    fits: list[LinearFit] = []
    for chosen in (np.arange(count), *choose_subsets(count)):
        flange = FlangePlaces(rotation[None, chosen], place[None, chosen])
        found = fit_all(flange.stack_columns(points.shape[1]), points[chosen])
        if found and found[0].residual < LARGEST_RESIDUAL:
            return found[0]
        fits += found
    return min(fits, key=lambda fit: fit.residual, default=None)


def _name_axes(view: View, found: _FrameFit) -> str | None:
    """Return which coordinates are x, y and z of R0, such as `z, y, −x`; None unless axes are exchanged.

    None for readings in a stated frame, whose axes are not those of R0.
    """
    if view.frame is not None:
        return None
    rotation = found.fit.frame.rotation
    nearest = np.round(rotation)
    is_exchange = np.abs(rotation - nearest).max() <= _SAME_AXES and not np.array_equal(nearest, np.eye(3))
    if not is_exchange or np.linalg.norm(found.shown_origin) > 2.0 * LARGEST_MODEL_ERROR:
        return None
    names = []
    for row in nearest:
        column = int(np.abs(row).argmax())
        names.append(("−" if row[column] < 0.0 else "") + "xyz"[column])
    return ", ".join(names)


def are_unusual(distances: FloatArray) -> bool:
    """Return whether targets are farther from their usual places than those of most robots.

    `distances` (M,) are the greatest distances of a target in each row [m].
    """
    return bool(len(distances)) and median(distances) > USUAL_RESIDUAL


def sample_rows(rows: IndexArray) -> IndexArray:
    """Return at most `_ROWS` of the rows (M,), evenly spread, enough to find a mistake in the whole set."""
    return np.asarray(rows[np.unique(np.linspace(0, len(rows) - 1, _ROWS).round().astype(int))])


def greatest_distances(seen_from_flange: FloatArray, places: FloatArray) -> FloatArray:
    """Return for each row (M,) the greatest distance [m] of a target from its place; 0 if none was measured.

    Args:
        seen_from_flange: (M, T, 3) targets as seen from the flange [m]; NaN where not measured.
        places: (T, 3) places of the targets on the flange [m].
    """
    return np.asarray(np.nan_to_num(np.linalg.norm(seen_from_flange - places, axis=2)).max(axis=1))


def find_consensus_places(seen_from_flange: FloatArray) -> FloatArray:
    """Return the places (T, 3) of the targets on the flange [m] on which most rows agree.

    The targets of some rows, the anchors, are tried as places. The median over the rows near the best anchor
    is returned, as a median over all rows would lie between two places if half of the rows are wrong.

    `seen_from_flange` (M, T, 3) are the targets of each row in the flange frame [m].
    """
    anchors = seen_from_flange[
        np.unique(np.linspace(0, len(seen_from_flange) - 1, _ANCHORS).round().astype(int))
    ]
    supporting_rows = [
        greatest_distances(seen_from_flange, anchor) <= 2.0 * LARGEST_MODEL_ERROR for anchor in anchors
    ]
    most_supported = max(supporting_rows, key=lambda is_near: int(is_near.sum()))
    return compute_median_places(seen_from_flange[most_supported])


def compute_median_places(seen_from_flange: FloatArray) -> FloatArray:
    """Return the median place (T, 3) of each target over the rows; NaN for a target never measured.

    `seen_from_flange` (M, T, 3) are the targets of each row in the flange frame [m]; NaN where not measured.
    """
    # Sorting puts NaN last, so the middle of the first `count` values is the median of those measured.
    ordered = np.sort(seen_from_flange, axis=0)
    count = np.maximum((~np.isnan(seen_from_flange)).sum(axis=0), 1)
    two_middle_values = np.take_along_axis(ordered, np.stack([(count - 1) // 2, count // 2]), axis=0)
    return np.asarray(0.5 * two_middle_values.sum(axis=0))
