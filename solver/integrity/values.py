"""A measurement set prepared for all checks, and checks of its numbers: units, limits, names, duplicates.

Every statistical check of a set gives a false finding with probability `FALSE_ALARM`, divided among its
comparisons (Bonferroni). If the scale is not stated but estimated from the data by a median, its uncertainty
counts: quantiles are then those of the F distribution with the degrees of freedom of the median.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special

from jointstiff.schemas.finding import AdvisedAction, Finding, FindingCode, Unit, Verdict
from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.mechanics.block import unloaded_postures
from jointstiff.solver.mechanics.measurements import NOISE_SIGMAS, Measurements, find_first_equal
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import PAST_DO_NOT_USE, figure, length_text


class OtherUnit(NamedTuple):
    """Meaning of numbers that seem to have a unit that was not declared."""

    quantity: str
    declared: Unit
    code: FindingCode


OTHER_UNITS: Final[dict[Unit, OtherUnit]] = {
    "mm": OtherUnit("length", "m", "length_unit_suspect"),
    "m": OtherUnit("length", "mm", "length_unit_suspect"),
    "deg": OtherUnit("angle", "rad", "angle_unit_suspect"),
    "rad": OtherUnit("angle", "deg", "angle_unit_suspect"),
}
"""Unit that the numbers seem to have → what it means."""
LENGTH_UNITS: Final = (
    ("mm", "m", 1000.0),
    ("cm", "m", 100.0),
    ("inch", "m", 39.37),
    ("mm", "inch", 25.4),
    ("mm", "cm", 10.0),
    ("cm", "inch", 2.54),
)
"""Unit of the greater numbers, unit of the smaller numbers, and their ratio."""
IN_ORDER: Final = 0.8
"""If a joint's angle correlates more strongly with the row number, the set counts as measured in order."""
_LEAST_EQUAL: Final = 4
"""Least number of observations of two targets that show equal readings."""
FALSE_ALARM: Final = 1e-6
"""Significance level of a check: a dozen checks of one set a day give no false finding in centuries."""
MODEL_ALLOWANCE: Final = 1.5
"""Factor on limits of deviations that are not noise: these are not normal, and have greater extremes."""
MEDIAN_EFFICIENCY: Final = 0.37
"""Fraction of the readings whose standard deviation would be as certain as the scale from a median of all."""
MEDIAN_SIZE: Final = 0.6744897501960817
"""Median of the absolute value of a standard normal variable."""
SAME_ANGLE: Final = 1e-5
"""Greatest difference of angles [rad] of the same posture: 20 µm at 2 m."""
LARGEST_DEFLECTION: Final = 0.02
"""Largest plausible deflection [m]: more is a mistake in a unit or a label."""
SMALLEST_DEFLECTION: Final = 5e-6
"""Smallest deflection that a tracker can show [m]; if all are smaller, the lengths have another unit."""
LARGEST_SIGMA: Final = 1e-3
"""Largest standard uncertainty of a tracker [m]."""
FLANGE_LENGTHS: Final = (2e-3, 10.0)
"""Least and greatest plausible distance from the flange [m] of the farthest load point or target. Metres read
as millimetres give less, millimetres read as metres give more."""
FORCES: Final = (5.0, 5e4)
"""Least and greatest plausible force [N]: less deflects nothing, more is twice the payload of the largest
robots."""
RARE_TARGET_SHARE: Final = 0.1
"""Fraction of the observations below which the name of a target is probably misspelt."""
_LAST_DIGIT: Final = 1e-9
"""Difference [m] of positions below which only arithmetic makes them differ."""
_LIMIT_MARGIN: Final = 1e-3
_MANY_TURNS: Final = 4 * np.pi
_SMALL_DEGREES: Final = 2 * np.pi
_NUMBERS_OF_CHANCE: Final = 3
"""Greatest number of rounded values other than zero that may agree in two observations by chance."""


@dataclass(frozen=True, eq=False)
class InstrumentFrame:
    """Frame in which positions were read: ``p = R p' + t`` in R0."""

    rotation: FloatArray  #: R (3, 3)
    translation: FloatArray  #: t (3,) [m]

    @property
    def inverse(self) -> InstrumentFrame:
        """The transform from R0 to the frame."""
        return InstrumentFrame(self.rotation.T, -self.translation @ self.rotation)

    def after(self, first: InstrumentFrame | None) -> InstrumentFrame:
        """Return the transform that moves points by `first`, if any, and then by this transform."""
        if first is None:
            return self
        translation = self.rotation @ first.translation + self.translation
        return InstrumentFrame(self.rotation @ first.rotation, translation)


@dataclass(frozen=True, eq=False)
class View:
    """Measurement set to be checked: N observations of T targets of a robot with n joints."""

    robot: Robot  #: model of the robot
    measurements: Measurements  #: measurements as they were posted
    degrees: bool = False  #: whether the angles were posted in degrees
    flange_fields: Sequence[str] = ()  #: fields of lengths in the flange frame, to be named in remedies
    header_units: Collection[str] = ()  #: quantities, such as length, whose units the headers of files state
    frame: InstrumentFrame | None = None  #: frame of the readings; None if they were given in R0
    length_unit: Literal["m", "mm"] = "mm"  #: unit of the lengths as posted

    def as_read(self, positions: FloatArray) -> FloatArray:
        """Return positions (..., 3) in R0 [m] in the frame in which they were read."""
        if self.frame is None:
            return positions
        return np.asarray((positions - self.frame.translation) @ self.frame.rotation)

    def to_base(self, positions: FloatArray) -> FloatArray:
        """Return positions (..., 3) in the frame of the readings [m] in R0."""
        if self.frame is None:
            return positions
        return np.asarray(positions @ self.frame.rotation.T + self.frame.translation)

    def build_finding(
        self,
        code: FindingCode,
        message: str,
        remedy: str,
        weight: Verdict = "use_with_care",
        action: AdvisedAction | None = None,
        *,
        row: int | None = None,
    ) -> Finding:
        """Build a finding about an observation, or about the whole set.

        Args:
            code: kind of the finding.
            message: what is wrong, in words.
            remedy: what to do.
            weight: best verdict that the finding allows.
            action: correction that a program can make; None if there is none.
            row: index of the observation; None for the whole set.
        """
        return Finding(
            code=code,
            weight=weight,
            where=None if row is None else self.measurements.place(row),
            observation=None if row is None else self.measurements.labels[row],
            message=message,
            remedy=remedy,
            action=action,
        )

    def suspect_other_unit(self, unit: Unit, effect: str) -> Finding:
        """Build the finding that lengths or angles seem to have another unit than the declared unit.

        Args:
            unit: unit that the numbers seem to have.
            effect: evidence in words.
        """
        return self.suspect_other_units((unit,), effect)

    def suspect_other_units(self, units: Sequence[Unit], effect: str) -> Finding:
        """Build the finding that lengths, angles or both seem to have other units than the declared ones.

        Args:
            units: units that the numbers seem to have, lengths first. An action converts a single unit.
            effect: evidence in words.
        """
        causes, remedies = [], []
        for unit in units:
            quantity, declared, _ = OTHER_UNITS[unit]
            causes.append(f"the {quantity}s seem to be in {unit}, not in {declared} as declared")
            remedy = f"set `units.{quantity}` to {unit}"
            if quantity in self.header_units:
                remedy = f"change the unit of {quantity}s in the headers from {declared} to {unit}"
            remedies.append(remedy)
        return self.build_finding(
            OTHER_UNITS[units[0]].code,
            f"{', and '.join(causes)}: {effect}",
            f"{' and '.join(remedies)}; {PAST_DO_NOT_USE}",
            "do_not_use",
            AdvisedAction.of("convert_units", unit=units[0]) if len(units) == 1 else None,
        )

    @cached_property
    def postures(self) -> Postures:
        """Kinematics of the N postures by the model, without load."""
        return unloaded_postures(self.robot, self.measurements)

    @cached_property
    def measured(self) -> BoolArray:
        """Mask (N, T) of the targets whose positions were read in R0."""
        return np.asarray(self.measurements.present & ~self.measurements.in_flange)

    @cached_property
    def compares_places(self) -> bool:
        """True if targets were read in several observations, so that their places on the flange decide."""
        is_repeated = self.measured.sum(axis=0) > 1
        return int((self.measured & is_repeated).any(axis=1).sum()) > 1

    @cached_property
    def places(self) -> FloatArray:
        """(N, T, 3) places of unloaded targets in the flange frame [m], from the model; NaN if not measured.

        Targets are fixed to the flange, so with a perfect model a target has the same place in all rows.
        """
        return transform_to_flange(self.postures, self.measurements.position, self.measured)

    @cached_property
    def reading_sigma(self) -> FloatArray:
        """Standard uncertainty (N, T) of a position in its worst direction [m]; zero where unknown."""
        measurements = self.measurements
        # The covariance is that of a deflection, the difference of two positions: a position has half of it.
        greatest_variance = 0.5 * np.linalg.eigvalsh(measurements.covariance)[..., -1]
        return np.broadcast_to(
            (measurements.sigma or 0.0) * np.sqrt(greatest_variance), measurements.present.shape
        )

    @cached_property
    def in_order(self) -> bool:
        """True if the postures were measured in the order of a joint's angle.

        Errors of the model then change gradually from row to row, as a drift in time does.
        """
        q = self.measurements.joints
        time = np.arange(len(q)) - 0.5 * (len(q) - 1)
        deviation = q - q.mean(axis=0)
        size = np.linalg.norm(deviation, axis=0) * np.linalg.norm(time)
        return bool((np.abs(time @ deviation) > IN_ORDER * size).any())

    @cached_property
    def loaded(self) -> BoolArray:
        """Mask (N,) of the observations with a force or a moment."""
        return np.asarray(self.measurements.force.any(axis=1) | self.measurements.moment.any(axis=1))


def transform_to_flange(postures: Postures, position: FloatArray, measured: BoolArray) -> FloatArray:
    """Transform positions (N, T, 3) from R0 to the flange frame [m]; NaN where not measured."""
    return np.where(measured[..., None], postures.to_flange(position), np.nan)


def compute_norm_quantile(comparisons: int, degrees_of_freedom: float, coordinates: int = 3) -> float:
    """Return a limit on the norms of random vectors; the greatest norm exceeds it with `FALSE_ALARM`.

    The norms are divided by the standard deviation of a coordinate, which was estimated from the data.

    Args:
        comparisons: number of vectors.
        degrees_of_freedom: number of coordinates from whose median the standard deviation was estimated.
        coordinates: number of coordinates of each vector.
    """
    probability = 1.0 - FALSE_ALARM / max(comparisons, 1)
    f_quantile = special.fdtri(coordinates, max(1.0, MEDIAN_EFFICIENCY * degrees_of_freedom), probability)
    return float(np.sqrt(coordinates * f_quantile))


def median(sizes: FloatArray) -> float:
    """Return the median of one or more finite numbers, in a fifth of the time of `np.median`."""
    middle = (sizes.size - 1) // 2, sizes.size // 2
    ordered = np.partition(sizes.ravel(), middle)
    return float(0.5 * (ordered[middle[0]] + ordered[middle[1]]))


def estimate_coordinate_scale(norms: FloatArray, coordinates: int = 3) -> float:
    """Estimate the standard deviation of a coordinate from the norms (K,) of K vectors; 0 without vectors."""
    # Median norm of a vector whose coordinates have the standard deviation 1
    unit_median = float(np.sqrt(2.0 * special.gammaincinv(0.5 * coordinates, 0.5)))
    return median(norms) / unit_median if norms.size else 0.0


def inspect_values(view: View) -> Iterator[Finding]:
    """Yield the findings of all checks of numbers alone, which compare no reading with the robot's model."""
    for check in (
        inspect_angles,
        inspect_rare_targets,
        inspect_stated_noise,
        inspect_loads,
        inspect_flange_lengths,
        inspect_load_point,
        inspect_deflections,
        inspect_duplicates,
    ):
        yield from check(view)


def inspect_angles(view: View) -> Iterator[Finding]:
    """Report angles that seem to be in another unit, and joints beyond the robot's limits.

    Sizes of angles are looked at only if no positions show the unit.
    """
    joints, is_revolute = view.measurements.joints, ~view.robot.prismatic
    largest = float(np.abs(joints[:, is_revolute]).max(initial=0.0))
    if not view.compares_places and not view.degrees and largest > _MANY_TURNS:
        effect = (
            f"the largest angle is {largest:.4g} rad; up to {_MANY_TURNS:.3g} rad, two turns, is plausible"
        )
        yield view.suspect_other_unit("deg", effect)
    largest_degrees = float(np.rad2deg(largest))
    is_small = 0 < largest_degrees <= _SMALL_DEGREES and len(joints) > 1
    if not view.compares_places and view.degrees and is_small:
        yield view.suspect_other_unit(
            "rad",
            f"no joint turns by more than {largest_degrees:.3g}° in {len(joints)} observations; more "
            f"than {_SMALL_DEGREES:.3g}° is plausible",
        )
    model_angles = view.robot.joint_map.model_angles(joints)
    lower, upper = view.robot.limits.T
    is_outside = (model_angles < lower - _LIMIT_MARGIN) | (model_angles > upper + _LIMIT_MARGIN)
    for row, joint in np.argwhere(is_outside).tolist():
        units = JOINT_UNITS[view.robot.joint_kinds[joint]]
        yield view.build_finding(
            "joint_outside_limits",
            f"the model {units.dimension} of {view.robot.joint_names[joint]} is "
            f"{model_angles[row, joint]:.4g} {units.position}, "
            f"outside its limits [{lower[joint]:.4g}, {upper[joint]:.4g}] {units.position}",
            f"check `units.{units.dimension}`, the joint map, and the order of the joints; if the joint "
            "moves that far, correct the limits of the robot",
            row=row,
        )


def inspect_rare_targets(view: View) -> Iterator[Finding]:
    """Report targets that were read in hardly any observation: their names may be misspelt."""
    present = view.measurements.present
    observation_counts = present.sum(axis=0)
    is_rare = (observation_counts > 0) & (observation_counts < RARE_TARGET_SHARE * len(present))
    for target in np.flatnonzero(is_rare):
        yield view.build_finding(
            "target_name_suspect",
            f"target '{view.measurements.targets[target]}' is read in only {observation_counts[target]} of "
            f"{len(present)} observations",
            "check the spelling of the target's name",
            "use",
            row=int(present[:, target].argmax()),
        )


def inspect_stated_noise(view: View) -> Iterator[Finding]:
    """Report a stated standard uncertainty that is larger than any tracker's."""
    sigma = view.measurements.sigma
    if sigma is not None and sigma > LARGEST_SIGMA:
        yield view.build_finding(
            "sigma_suspect",
            f"the stated standard uncertainty of a reading is {length_text(sigma)}; up to "
            f"{length_text(LARGEST_SIGMA)} is plausible for a tracker",
            f"check the stated noise and its unit, `units.length`; {PAST_DO_NOT_USE}",
            "do_not_use",
        )


def inspect_loads(view: View) -> Iterator[Finding]:
    """Report observations without a load, and forces of an implausible size."""
    if not view.loaded.any():
        largest = float(np.linalg.norm(view.measurements.deflection, axis=2).max())
        yield view.build_finding(
            "zero_load",
            f"no observation has a force or a moment, but the targets moved by up to {length_text(largest)}",
            "give the force, or the moment, of each observation",
            "do_not_use",
        )
        return
    for i in np.flatnonzero(~view.loaded).tolist():
        yield view.build_finding(
            "zero_load",
            "force and moment are zero, so the observation carries no information on stiffness",
            "give the load, or remove the observation",
            "use",
            row=i,
        )
    sizes = np.linalg.norm(view.measurements.force, axis=1)
    if not sizes.any():  # loads that are moments
        return
    median_force, (least, greatest) = float(np.median(sizes[sizes > 0.0])), FORCES
    # Small forces are plausible where moments load the robot.
    if median_force > greatest or (median_force < least and not view.measurements.moment.any()):
        yield view.build_finding(
            "force_unit_suspect",
            f"the median force is {figure(median_force, '.3g')} N; {least:g} N to {greatest:g} N is "
            "plausible",
            "check `units.force`: kN may have been read as N, or N as kN (kgf read as N is not detected); "
            f"{PAST_DO_NOT_USE}",
            "do_not_use",
            AdvisedAction.of("convert_units", unit="N" if median_force > greatest else "kN"),
        )


def inspect_flange_lengths(view: View) -> Iterator[Finding]:
    """Report load points and targets that are implausibly near the flange, or far from it.

    Positions read in R0 show whether all lengths have another unit, or only those in the flange frame.
    """
    measurements = view.measurements
    points = np.concatenate(
        [measurements.load_point, measurements.position[measurements.present & measurements.in_flange]]
    )
    largest, (near, far) = float(np.linalg.norm(points, axis=1).max()), FLANGE_LENGTHS
    if near <= largest <= far or not largest:
        return
    subject = "load points and targets" if len(points) > len(measurements.load_point) else "load points"
    effect = (
        f"the {subject} are up to {length_text(largest)} from the origin of the flange frame "
        f"({length_text(near)} to {length_text(far)} is plausible)"
    )
    if view.compares_places:  # the positions show whether all lengths have another unit
        farthest = float(np.linalg.norm(measurements.position[view.measured], axis=1).max())
        finding = view.build_finding(
            "length_unit_suspect",
            f"{effect}, while the targets were read up to {length_text(farthest)} from the origin of R0",
            f"give the {subject} in the flange frame in the unit of all other lengths: "
            f"{'divide' if largest > far else 'multiply'} them by 1000 if they are in "
            f"{'mm' if largest > far else 'm'}; {PAST_DO_NOT_USE}",
            "do_not_use",
        )
    else:
        finding = view.suspect_other_unit("mm" if largest > far else "m", effect)
    if view.flange_fields:
        names = " and ".join(f"`{name}`" for name in view.flange_fields)
        finding = finding.model_copy(update={"remedy": f"check the unit of {names}"})
    yield finding


def inspect_load_point(view: View) -> Iterator[Finding]:
    """Report a stated load point that the reading of a target at the hook refutes."""
    hook = view.measurements.hook
    if hook is None or hook.stated is None:
        return
    largest = hook.find_largest_distance(float(special.chdtri(3, FALSE_ALARM)))
    if hook.distance <= largest:
        return
    yield view.build_finding(
        "load_point_refuted",
        f"the stated load point {_describe_place(hook.stated)} is {length_text(hook.distance)} away from "
        f"{_describe_place(hook.place)}, where the reading of target '{hook.target}' shows the hook; their "
        f"uncertainties allow {length_text(largest)}",
        "check that the target was on the hook; then omit the stated `load_point`, so that the reading alone "
        f"counts; {PAST_DO_NOT_USE}",
        "do_not_use",
        AdvisedAction.of("omit_load_point"),
    )


def _describe_place(place: FloatArray) -> str:
    """Return the text of a place (3,) in the flange frame [m], in mm."""
    return f"({', '.join(figure(1e3 * value, '.1f') for value in place.tolist())}) mm"


def inspect_deflections(view: View) -> Iterator[Finding]:
    """Report deflections that are implausibly large, implausibly small, or smaller than the noise."""
    measurements = view.measurements
    length = np.linalg.norm(measurements.deflection, axis=2)
    largest = length.max(axis=1)
    for row in np.flatnonzero(largest > LARGEST_DEFLECTION).tolist():
        yield view.build_finding(
            "deflection_implausibly_large",
            f"target '{measurements.targets[length[row].argmax()]}' moved by {length_text(largest[row])}; "
            f"up to {length_text(LARGEST_DEFLECTION)} is plausible",
            f"check `units.length`, and that unloaded and loaded readings belong together; {PAST_DO_NOT_USE}",
            "do_not_use",
            row=row,
        )
    if largest.max() < SMALLEST_DEFLECTION and view.loaded.any():
        yield view.build_finding(
            "deflection_implausibly_small",
            f"no target moved by more than {length_text(float(largest.max()))}; at least "
            f"{length_text(SMALLEST_DEFLECTION)} is plausible",
            "check `units.length`, and that the loaded readings were taken with the load applied; "
            f"{PAST_DO_NOT_USE}",
            "do_not_use",
        )
    noise = np.sqrt(2.0) * (measurements.sigma or 0.0)
    was_read = measurements.present.any(axis=1)
    for row in np.flatnonzero((largest <= NOISE_SIGMAS * noise) & view.loaded & was_read).tolist():
        yield view.build_finding(
            "deflection_below_noise",
            f"no target moved by more than {length_text(largest[row])}; the noise of a deflection is "
            f"{length_text(noise)}",
            "increase the load; check that the loaded readings were taken with the load applied, and "
            "check the stated noise",
            "use",
            row=row,
        )


def inspect_duplicates(view: View) -> Iterator[Finding]:
    """Report observations whose readings equal those of another observation in every digit."""
    measurements = view.measurements
    values = np.concatenate(
        [measurements.position * view.measured[..., None], measurements.deflection], axis=1
    ).reshape(len(measurements), -1)
    for row, first_equal_row in enumerate(
        find_first_equal(values).tolist()
    ):  # j is the first observation equal to i
        has_same_angles = np.array_equal(measurements.joints[row], measurements.joints[first_equal_row])
        # A few rounded values may agree by chance: report them only if the joint angles agree, too.
        if first_equal_row == row or (
            np.count_nonzero(values[row]) <= _NUMBERS_OF_CHANCE and not has_same_angles
        ):
            continue
        yield view.build_finding(
            "duplicated_observation",
            f"the {'joint angles and ' if has_same_angles else ''}readings of this observation equal those "
            f"of observations[{first_equal_row}] to the last digit",
            "remove one of the two observations, or give this observation its own readings",
            "do_not_use",
            row=row,
        )


def inspect_repeats(view: View) -> Iterator[Finding]:
    """Report how much deflections and unloaded positions scatter in repeated observations.

    Deflections show the tracker's noise alone, as the robot's position cancels; positions show the noise of
    tracker and robot.
    """
    measurements = view.measurements
    posture = np.round(measurements.joints / SAME_ANGLE)
    if len(np.unique(find_first_equal(posture))) == len(measurements):
        return
    yield from _report_repeated_deflections(view, posture)
    yield from _report_repeated_positions(view, posture)


def _report_repeated_deflections(view: View, posture: FloatArray) -> Iterator[Finding]:
    """Report the scatter of deflections in equal postures (N, n) under equal loads."""
    measurements = view.measurements
    equal_values = [
        posture,
        measurements.force,
        measurements.moment,
        measurements.load_point,
        measurements.present,
    ]
    if measurements.direction is not None:
        equal_values.append(np.round(measurements.direction.reshape(len(measurements), -1), 4))
    variance, degrees_of_freedom, repeated_count = _pool_scatter(
        measurements.deflection, measurements.coordinates, np.hstack(equal_values)
    )
    if variance:
        sigma = np.sqrt(variance / 2.0)  # a deflection is the difference of two readings
        statement, exceeds_noise = "no noise is stated", False
        if measurements.sigma is not None:
            statement = f"the stated sigma is {length_text(measurements.sigma)}"
            chi_square = degrees_of_freedom * (sigma / measurements.sigma) ** 2
            exceeds_noise = special.chdtrc(degrees_of_freedom, chi_square) < FALSE_ALARM
        yield view.build_finding(
            "repeated_readings",
            f"{repeated_count} observations repeat the posture and load of other observations; their "
            f"deflections give sigma = {length_text(sigma)} ({degrees_of_freedom} degrees of freedom), and "
            f"{statement}",
            "state a noise that agrees with the repetitions, and find the cause of the scatter between them"
            if exceeds_noise
            else "keep the repetitions in the set; the fit uses repetitions like all other observations",
            "use_with_care" if exceeds_noise else "use",
        )


def _report_repeated_positions(view: View, posture: FloatArray) -> Iterator[Finding]:
    """Report the scatter of unloaded positions in equal postures (N, n).

    Positions that are equal to the last digit are one reading, which several loads share.
    """
    position = view.measurements.position
    keys = np.hstack([posture, view.measured])
    digits = np.round(position.reshape(len(position), -1) / _LAST_DIGIT)
    rows = np.unique(find_first_equal(np.hstack([keys, np.nan_to_num(digits)])))
    variance, degrees_of_freedom, repeated_count = _pool_scatter(
        position[rows], 3 * view.measured[rows], keys[rows]
    )
    if variance:
        yield view.build_finding(
            "repeated_readings",
            f"in {repeated_count} repeated postures the unloaded targets scatter by "
            f"{length_text(np.sqrt(variance))} per coordinate ({degrees_of_freedom} degrees of "
            "freedom): the scatter of tracker and robot together",
            "compare this scatter with the stated noise: the excess is the repeatability of the robot",
            "use",
        )


def _pool_scatter(values: FloatArray, coordinates: IndexArray, keys: FloatArray) -> tuple[float, int, int]:
    """Return the pooled variance of a coordinate, its degrees of freedom, and the number of repeated rows.

    Args:
        values: (N, T, 3) vectors.
        coordinates: (N, T) number of coordinates that were read; zero where not measured.
        keys: (N, K) keys of the rows; rows with equal keys repeat each other.
    """
    squares, degrees_of_freedom, repeated_count = 0.0, 0, 0
    first_equal = find_first_equal(keys)  # for each row, index of the first row with the same keys
    first_rows, sizes = np.unique(first_equal, return_counts=True)
    for first_row in first_rows[sizes > 1]:
        rows = np.flatnonzero(first_equal == first_row)
        repeated = values[rows][:, coordinates[first_row] > 0]
        squares += float(((repeated - repeated.mean(axis=0)) ** 2).sum())
        degrees_of_freedom += (len(rows) - 1) * int(coordinates[first_row].sum())
        repeated_count += len(rows) - 1
    return squares / max(degrees_of_freedom, 1), degrees_of_freedom, repeated_count


def inspect_equal_targets(view: View) -> Iterator[Finding]:
    """Report pairs of targets whose readings are equal in every digit in all observations of both."""
    measurements = view.measurements
    readings = np.concatenate([measurements.position, measurements.deflection], axis=2)
    for first, second in combinations(range(len(measurements.targets)), 2):
        both = measurements.present[:, first] & measurements.present[:, second]
        are_few = int(both.sum()) < _LEAST_EQUAL
        if are_few or not np.array_equal(readings[both, first], readings[both, second]):
            continue
        names = [measurements.targets[target] for target in (first, second)]
        yield view.build_finding(
            "repeated_readings",
            f"the targets '{names[0]}' and '{names[1]}' have the same readings to the last digit in "
            f"{both.sum()} observations: they count as two targets, and were read once",
            f"give '{names[1]}' its own readings, or leave out this target; {PAST_DO_NOT_USE}",
            "do_not_use",
        )
