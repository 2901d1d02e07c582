"""Comparison of a new reading with its prediction from the other readings, and causes of a mistake.

The other readings are fitted; errors of loads and positions are unknowns with stated uncertainties. The fit
gives the prediction of the new reading with its covariance, and so the probability of the distance of the new
reading from the prediction. If this makes a reading doubtful, mistakes that happen with a single reading are
tried: for each, the reading is corrected accordingly and compared again. The mistakes that explain the
reading best are named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.integrity.values import View
from jointstiff.solver.mechanics.block import Term
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import FORCE_SCALE, SHIFT, TERMS
from jointstiff.solver.text import length_text


@dataclass(frozen=True)
class Innovation:
    """Comparison of a reading with its prediction from the other readings."""

    #: probability of a reading at least so far from its prediction; None if the others cannot predict the
    #: reading
    p_value: float | None = None
    distance: float | None = None  #: greatest distance of a target from its prediction [m]
    doubtful: bool = False  #: True if the reading ought to be repeated before the load is taken off
    causes: list[str] = field(default_factory=list)  #: possible mistakes in words, the likeliest first
    message: str | None = None  #: result of the comparison as a sentence; None without a comparison


_NOT_COMPARABLE: Final = Innovation(message="too few other readings to compare this reading with")

LARGEST_PLACE_ERROR: Final = 0.1
"""Greatest plausible distance of an unloaded target from its declared place by the model [m]."""
DOUBTFUL: Final = (1e-5, 1e-4)
"""p-values below which a reading is doubtful: of its distance from the prediction, and of the part of the
distance that another size of the force explains."""
_BEYOND: Final = 9.0
"""Ratio by which the squared distance of a reading must exceed the squared distance of every other reading,
to be doubtful although no slip explains the reading."""
_FARTHER: Final = 1.2
"""Ratio that replaces `_BEYOND` for the part that another size of the force explains, if noise explains the
other readings."""
_USUAL: Final = 0.03
"""Share of a deflection, equal for all targets of a posture, that a model of joints leaves unexplained on
most arms: a reading that deviates by no more is not doubtful."""
_EXPLAINED: Final = 0.01
"""p-value of the residuals for the stated noise, above which noise alone explains the residuals."""
_FEWEST: Final = 4
"""Fewest other readings with which each of them is compared with its prediction from the rest, too."""
_BALL: Final = 0.9
"""Probability that a reading lies in the ball about its prediction."""
_VAGUE: Final = 30.0
"""Prior standard uncertainty of a compliance, relative to the compliance with which this joint alone would
cause deflections as great as those that were read."""
_PLAUSIBLE: Final = 1e-3
"""p-value of the corrected reading above which a mistake explains the reading."""
_BETTER: Final = 6.0
"""Difference of the criteria of two mistakes below which both mistakes are named."""
_MOST_NAMED: Final = 2
"""Greatest number of mistakes that are named."""
_PLACE: Final = 2e-3
"""Least standard deviation of a target's position from the kinematic model [m]: the accuracy of an arm."""
_WRONG_PLACE: Final = 1e-6
"""p-value of the distance of unloaded targets from their usual positions, below which they are misplaced."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """Prediction of another reading from N readings: a fit of the compliances and of errors of known size."""

    robot: Robot  #: n joints
    terms: tuple[Term, ...]  #: compliances of the joints, and the errors that are unknowns of the fit
    compliance: FloatArray  #: (n,) compliances at which rows are linearised [rad/(N·m)]
    best: FloatArray  #: (K,) fitted unknowns of all terms
    root: FloatArray  #: (K, K) matrix R with R Rᵀ the covariance of the fitted unknowns
    noise: float  #: variance of a whitened coordinate [m²]
    misfit: float  #: squared share of a deflection that the fit does not explain, in addition to noise
    #: degrees of freedom of the variances; inf if the noise is stated and explains the residuals
    freedom: float
    #: (T, 3) usual positions of the targets in the flange frame, from unloaded readings [m]; NaN if unknown
    places: FloatArray
    spread: float  #: standard deviation of a coordinate of these positions [m]

    @classmethod
    def from_readings(
        cls, robot: Robot, other_readings: Measurements, compliance: FloatArray
    ) -> Expectation | None:
        """Fit some readings in order to predict another reading; return None if nothing determines the noise.

        Args:
            robot: n joints.
            other_readings: N observations under load.
            compliance: (n,) compliances from a fit to these readings [rad/(N·m)].

        Raises:
            SolverError: no equilibrium is found under the load.
        """
        common_uncertainty = other_readings.common_uncertainty
        terms_and_priors = [(term, term.prior(common_uncertainty)) for term in TERMS.values()]
        terms_and_priors = [(term, prior) for term, prior in terms_and_priors if prior and max(prior) > 0.0]
        terms = (JOINTS, *(term for term, _ in terms_and_priors))
        stack = _build_stack(robot, other_readings, terms, compliance)
        triangle, coordinate_count = stack.triangle(), int(stack.read.sum())
        squared_deflections = float(np.square(triangle.rhs).sum())
        # Norms of the joints' columns; inf gives a joint that no reading depends on a prior of zero.
        column_norms = np.linalg.norm(triangle.matrix[:, triangle.span[JOINTS.name]], axis=0)
        column_norms = np.where(column_norms > 1e-9 * column_norms.max(), column_norms, np.inf)
        prior_deviations = [_VAGUE * np.sqrt(squared_deflections or len(stack.flat)) / column_norms]
        for term, prior in terms_and_priors:
            prior_deviations.append(np.resize(np.array(prior), stack.widths[term.name]))
        prior_deviation = np.concatenate(prior_deviations)
        stated_variance = None if other_readings.sigma is None else other_readings.sigma**2
        variance, variance_freedom = stated_variance or squared_deflections / len(stack.flat) or 1.0, np.inf
        # The weight of the prior depends on the variance, which the fit determines: repeat the fit.
        for _ in range(1 if stated_variance is None and coordinate_count <= robot.n else 3):
            fit, used_variance = triangle.fit_with_prior(prior_deviation, variance), variance
            degrees_of_freedom = coordinate_count - int(np.isfinite(column_norms).sum())
            if degrees_of_freedom < 1:
                break
            residual_variance = fit.squares / degrees_of_freedom
            noise_explains = (
                stated_variance is not None
                and special.chdtrc(degrees_of_freedom, fit.squares / stated_variance) > _EXPLAINED
            )
            if noise_explains:
                variance, variance_freedom = stated_variance or 0.0, np.inf
            else:
                variance, variance_freedom = max(residual_variance, 1e-24), degrees_of_freedom
        if stated_variance is None and not np.isfinite(variance_freedom):
            return None
        covariance_root = np.sqrt(variance / used_variance) * fit.root
        places, spread = _compute_median_places(robot, other_readings)
        noise = variance if stated_variance is None else stated_variance
        misfit = (variance - noise) / (squared_deflections / coordinate_count)
        return cls(
            robot,
            terms,
            compliance,
            fit.unknowns,
            covariance_root,
            noise,
            misfit,
            variance_freedom,
            places,
            spread,
        )

    def measure_distance(
        self, reading: Measurements, *, free_term: Term | None = None, usual_share: float = 0.0
    ) -> tuple[float, float, int]:
        """Measure how far one reading is from its prediction, relative to the uncertainty of the prediction.

        Args:
            reading: one observation.
            free_term: term, such as the size of the force, that is fitted to this reading alone; None fits no
                term.
            usual_share: share of the deflection by which all targets together may deviate without doubt.

        Returns:
            Squared distance in standard uncertainties; probability of at least this distance; and number of
            coordinates compared minus the number of unknowns of the fitted term.

        Raises:
            SolverError: no equilibrium is found under the load.
        """
        rows = _build_stack(self.robot, reading, self.terms, self.compliance).flat
        coordinate_count = int(reading.coordinates.sum())
        prediction_root, predicted = rows[:, :-1] @ self.root, rows[:, :-1] @ self.best
        variance = self.noise + self.misfit * float(np.square(predicted).sum()) / coordinate_count
        covariance = variance * np.eye(len(prediction_root)) + prediction_root @ prediction_root.T
        if usual_share**2 > self.misfit:
            # All targets may be shifted together by the usual share of the deflection.
            shift = _build_stack(self.robot, reading, (SHIFT,), self.compliance).flat[:, :-1]
            shift_variance = (
                (usual_share**2 - self.misfit) * np.square(predicted).sum() / np.square(shift).sum()
            )
            covariance += shift_variance * shift @ shift.T
        factor = np.linalg.cholesky(covariance)
        whitened_difference = np.linalg.solve(factor, rows[:, -1] - predicted)  # whitened difference
        if free_term is not None:
            term_rows = _build_stack(self.robot, reading, (free_term,), self.compliance).flat
            whitened_columns = np.linalg.solve(factor, term_rows[:, :-1])
            whitened_difference = (
                whitened_difference
                - whitened_columns @ np.linalg.lstsq(whitened_columns, whitened_difference, rcond=None)[0]
            )
            coordinate_count -= whitened_columns.shape[1]
        squared_distance = float(whitened_difference @ whitened_difference)
        return (
            squared_distance,
            self.compute_exceedance_probability(squared_distance, coordinate_count),
            coordinate_count,
        )

    def compute_greatest_distance(self, reading: Measurements) -> float:
        """Return the greatest distance of a target of one reading from its prediction [m]."""
        # Whitened rows are not in metres: errors that the targets share make them smaller.
        stack = Rows(self.robot, reading, self.compliance).stack(self.terms, self.compliance, whitened=False)
        rows = stack.flat
        difference = (rows[:, -1] - rows[:, :-1] @ self.best).reshape(-1, 3)
        return float(np.linalg.norm(difference, axis=1).max())

    def compare_unloaded_places(self, reading: Measurements) -> tuple[float, float]:
        """Compare the unloaded targets of a reading with their usual positions on the flange.

        Returns:
            Squared distance in standard deviations; and the probability of at least this distance, 1 if no
            position can be compared.
        """
        difference = View(self.robot, reading).places[0] - self.places
        scaled = difference[np.isfinite(difference).all(axis=1)] / self.spread
        square = float(np.square(scaled).sum())
        return square, float(special.chdtrc(scaled.size, square)) if scaled.size else 1.0

    def compute_squared_distance_quantile(self, probability: float, count: int) -> float:
        """Return the quantile of the squared Mahalanobis distance of a reading with `count` coordinates.

        The distribution is χ², or that of ``count · F`` if sigma is estimated with `freedom` degrees of
        freedom.
        """
        if np.isinf(self.freedom):
            return float(special.chdtri(count, 1.0 - probability))
        return float(count * special.fdtri(count, self.freedom, probability))

    def compute_exceedance_probability(self, square: float, count: int) -> float:
        """Return the probability that the squared distance of `count` coordinates exceeds `square`."""
        if count < 1:
            return 0.0
        if np.isinf(self.freedom):
            return float(special.chdtrc(count, square))
        return float(special.fdtrc(count, self.freedom, square / count))


def compare_last_reading(robot: Robot, measurements: Measurements, compliance: FloatArray) -> Innovation:
    """Compare the last reading with its prediction from the other readings.

    If the last reading is doubtful, mistakes that may have happened with this reading are named.

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) compliances from a fit to the other readings [rad/(N·m)].
    """
    reading = measurements[-1:]
    other_readings = measurements[:-1] if len(measurements) > 1 else None
    try:
        expectation = (
            None if other_readings is None else Expectation.from_readings(robot, other_readings, compliance)
        )
        if other_readings is None or expectation is None:
            return _NOT_COMPARABLE
        _, p_value, _ = expectation.measure_distance(reading)
        # Two numbers each: of the whole distance, and of the part that another size of the force explains.
        squares, p_values = _measure_unusual_distances(expectation, reading, _USUAL)
        is_far = p_values < DOUBTFUL
        is_misplaced = expectation.compare_unloaded_places(reading)[1] < _WRONG_PLACE
        distance = expectation.compute_greatest_distance(reading)
        causes, doubtful = list[str](), bool(is_far.any())
        if doubtful or is_misplaced:
            is_slip, causes = _find_causes(expectation, reading, other_readings)
            # With a model error the other readings are as far from their predictions as this reading. The
            # reading is doubtful only if it is farther; with too few other readings, only if a slip explains
            # it.
            factors = np.ones(2)
            if not is_slip:
                factors = np.array([_BEYOND, _FARTHER if expectation.misfit == 0.0 else _BEYOND])
            limits = np.array([0.0 if is_slip else np.inf, np.inf])
            if len(other_readings) >= _FEWEST:
                limits = factors * _cross_check_readings(expectation, other_readings, _USUAL).max(axis=0)
            doubtful = bool((is_far & (squares > limits)).any())
    except SolverError:  # Other findings report a load without equilibrium.
        return _NOT_COMPARABLE
    if not doubtful and not is_misplaced:
        return Innovation(p_value, distance, message="the reading agrees with the other readings")
    if not causes and is_misplaced:
        causes = [_describe_wrong_angles(reading, other_readings)]
    place_text = (
        f"the reading is {length_text(distance)} away from the prediction by the other readings"
        if doubtful
        else "the unloaded targets are misplaced"
    )
    cause_text = " or ".join(causes) + "?" if causes else "no single mistake explains this difference"
    return Innovation(
        p_value=p_value,
        distance=distance,
        doubtful=True,
        causes=causes,
        message=f"{place_text}: {cause_text} Read the posture again before the load is taken off.",
    )


def compare_declared_places(
    robot: Robot, measurements: Measurements, places: Mapping[str, Sequence[float]]
) -> Innovation | None:
    """Compare the last reading with the declared places of its targets; None if a target is at its place.

    Args:
        robot: n joints.
        measurements: N observations.
        places: target → declared place in the flange frame [m].
    """
    seen = View(robot, measurements[-1:]).places[0]
    distances = [
        float(np.linalg.norm(seen[t] - places[name]))
        for t, name in enumerate(measurements.targets)
        if name in places and np.isfinite(seen[t]).all()
    ]
    if not distances or min(distances) <= LARGEST_PLACE_ERROR:
        return None
    causes = [
        "the arm was in another posture than stated",
        "the positions are in another frame or unit",
        "the targets were declared at other places",
    ]
    return Innovation(
        distance=max(distances),
        doubtful=True,
        causes=causes,
        message=f"all unloaded targets are over {length_text(LARGEST_PLACE_ERROR)} from their places by the "
        f"model, up to {length_text(max(distances))}: {' or '.join(causes)}? Withdraw the reading, and read "
        "again in the stated posture; or keep the reading if it is right.",
    )


def _describe_wrong_angles(reading: Measurements, other_readings: Measurements) -> str:
    """Return the cause of misplaced targets: wrong joint angles, maybe those of another reading.

    Targets are fixed to the flange, so that wrong joint angles misplace them.
    """
    is_same_posture = np.isclose(other_readings.joints, reading.joints[0]).all(axis=1)
    if not is_same_posture.any():
        return "the joint angles are not those of this posture"
    return f"the joint angles are those of '{other_readings.labels[int(np.argmax(is_same_posture))]}'"


@dataclass(frozen=True)
class HeldOut:
    """Comparison of a held-out reading with the 90 % ball about its prediction."""

    label: str  #: label of the reading
    ball_ratio: float  #: distance from the prediction divided by the radius of the 90 % ball
    distance: float  #: greatest distance of a target from its prediction [m]

    @property
    def inside(self) -> bool:
        """True if the reading lies in the ball about its prediction that contains 90 % of readings."""
        return self.ball_ratio <= 1.0


def check_held_out_reading(
    robot: Robot, measurements: Measurements, compliance: FloatArray, row: int
) -> HeldOut | None:
    """Compare a held-out reading with the 90 % ball about its prediction by the other readings.

    The ball covers noise and the uncertainty of the prediction. With at least `_FEWEST` other readings it
    also covers the model error: each of these readings is compared with its prediction from the rest.

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) compliances from a fit to the other readings [rad/(N·m)].
        row: index of the held-out reading.

    Returns:
        The comparison; None if the other readings cannot predict the held-out reading.
    """
    other_readings = measurements[np.delete(np.arange(len(measurements)), row)]
    reading = measurements[np.array([row])]
    try:
        expectation = Expectation.from_readings(robot, other_readings, compliance)
        if expectation is None:
            return None
        squared_distance, _, count = expectation.measure_distance(reading)
        limit = expectation.compute_squared_distance_quantile(_BALL, count)
        if len(other_readings) >= _FEWEST:
            # The distance that 90 % of the other readings do not exceed (conformal prediction).
            squares = np.sort(_cross_check_readings(expectation, other_readings, 0.0)[:, 0])
            rank = min(len(squares) - 1, int(np.ceil(_BALL * (len(squares) + 1))) - 1)
            limit = max(limit, float(squares[rank]))
        distance = expectation.compute_greatest_distance(reading)
    except SolverError:
        return None
    return HeldOut(measurements.labels[row], float(np.sqrt(squared_distance / limit)), distance)


def _measure_unusual_distances(
    expectation: Expectation, reading: Measurements, usual_share: float
) -> tuple[FloatArray, FloatArray]:
    """Measure a reading's distance from its prediction, where a usual share of the deflection is allowed.

    Args:
        expectation: fit of the other readings.
        reading: one observation.
        usual_share: share of the deflection by which all targets together may deviate.

    Returns:
        (2,) squared distance, and the part of it that another size of the force explains; and (2,) the
        p-values of these two numbers.
    """
    squared_distance, p_value, _ = expectation.measure_distance(reading, usual_share=usual_share)
    distance_with_other_force, _, _ = expectation.measure_distance(
        reading, usual_share=usual_share, free_term=FORCE_SCALE
    )
    gain = squared_distance - distance_with_other_force
    return np.array([squared_distance, gain]), np.array(
        [p_value, expectation.compute_exceedance_probability(gain, 1)]
    )


def _cross_check_readings(expectation: Expectation, readings: Measurements, usual_share: float) -> FloatArray:
    """Predict each of K readings from the rest, and return the squared distances (K, 2).

    The columns are the squared distance from the prediction, and the part of it that another size of the
    force explains. All predictions use the noise of `expectation`. If no reading can be predicted, the result
    is one row of zeros.
    """
    squares = []
    for left_out in range(len(readings)):
        remaining_readings = readings[np.delete(np.arange(len(readings)), left_out)]
        expectation_of_rest = Expectation.from_readings(
            expectation.robot, remaining_readings, expectation.compliance
        )
        if expectation_of_rest is not None:
            expectation_of_rest = replace(
                expectation_of_rest, noise=expectation.noise, misfit=expectation.misfit
            )
            squares.append(
                _measure_unusual_distances(expectation_of_rest, readings[np.array([left_out])], usual_share)[
                    0
                ]
            )
    return np.array(squares) if squares else np.zeros((1, 2))


def _find_causes(
    expectation: Expectation, reading: Measurements, other_readings: Measurements
) -> tuple[bool, list[str]]:
    """Search for the mistakes that explain a doubtful reading.

    Returns:
        True if the best explanation is a slip such as a wrong sign, which has no fitted size; and the
        explanations in words, the likeliest first.
    """
    # Whether a term was fitted, criterion, and words. Slips are preferred to fitted terms.
    scores: list[tuple[bool, float, str]] = []
    for words, corrected, fitted_term, unknown_count in _propose_mistakes(
        expectation.robot, reading, other_readings
    ):
        try:
            square, p_value, _ = expectation.measure_distance(corrected, free_term=fitted_term)
        except SolverError:
            continue
        place_square, p_place = expectation.compare_unloaded_places(corrected)
        if p_value > _PLAUSIBLE and p_place > _WRONG_PLACE:
            penalty = unknown_count * np.log(reading.coordinates.sum())  # Bayesian information criterion
            scores.append((fitted_term is not None, square + place_square + penalty, words))
    scores.sort(key=lambda score: score[:2])
    named = [
        words
        for is_fitted, criterion, words in scores
        if (is_fitted, criterion) <= (scores[0][0], scores[0][1] + _BETTER)
    ]
    return bool(scores) and not scores[0][0], list(dict.fromkeys(named))[:_MOST_NAMED]


def _propose_mistakes(
    robot: Robot, reading: Measurements, other_readings: Measurements
) -> Iterator[tuple[str, Measurements, Term | None, int]]:
    """Yield mistakes that may have happened with a reading.

    Yields:
        The mistake in words; the reading corrected for the mistake; the term to fit to this reading (None if
        the corrected reading has no unknown); and the number of unknowns that count for the mistake, where
        the choice among postures counts as one.
    """
    yield "the force has the opposite sign", replace(reading, force=-reading.force), None, 0
    if not reading.in_flange.any():
        after = reading.position + reading.deflection
        swapped = replace(reading, position=after, deflection=-reading.deflection)
        yield "unloaded and loaded readings are exchanged", swapped, None, 0
    for words, exchanged in _propose_target_exchanges(reading):
        yield words, exchanged, None, 0
    for label, joints in zip(other_readings.labels, other_readings.joints, strict=True):
        if not np.allclose(joints, reading.joints[0]):
            yield f"the arm was in the posture of '{label}'", replace(reading, joints=joints[None]), None, 1
    for joint, name in enumerate(robot.joint_names):
        joints_with_sign = reading.joints.copy()
        joints_with_sign[0, joint] *= -1.0
        yield f"the angle of {name} has the opposite sign", replace(reading, joints=joints_with_sign), None, 0
    yield "the force differs from the stated force", reading, FORCE_SCALE, 1
    yield "the arm or the tracker moved between the two readings", reading, SHIFT, 3


def _propose_target_exchanges(reading: Measurements) -> Iterator[tuple[str, Measurements]]:
    """Yield each exchange of two targets in words, and the reading with the exchange undone."""
    before, after = reading.position, reading.position + reading.deflection
    for first, second in combinations(np.flatnonzero(reading.present[0]).tolist(), 2):
        order = np.arange(len(reading.targets))
        order[[first, second]] = second, first
        words = f"{reading.targets[first]} and {reading.targets[second]} are exchanged"
        if reading.in_flange.any():
            yield words, replace(reading, deflection=reading.deflection[:, order])
            continue
        for start, end, state in (
            (before[:, order], after[:, order], ""),
            (before, after[:, order], " under load"),
            (before[:, order], after, " without load"),
        ):
            yield words + state, replace(reading, position=start, deflection=end - start)


def _build_stack(
    robot: Robot, measurements: Measurements, terms: tuple[Term, ...], compliance: FloatArray
) -> Stack:
    """Build the whitened rows of readings, with one column for each unknown of the terms.

    Args:
        robot: n joints.
        measurements: N observations.
        terms: compliances, and errors of loads or positions, each with its unknowns.
        compliance: (n,) compliances at which the rows are linearised [rad/(N·m)].
    """
    return Rows(robot, measurements, compliance).stack(terms, compliance)


def _compute_median_places(robot: Robot, measurements: Measurements) -> tuple[FloatArray, float]:
    """Return the median positions (T, 3) of targets in the flange frame, and their standard deviation [m].

    With fewer than `_FEWEST` observations, or without absolute positions, the positions are NaN. The standard
    deviation is at least `_PLACE`.
    """
    places = View(robot, measurements).places
    if len(measurements) < _FEWEST or np.isnan(places).all():
        return np.full(places.shape[1:], np.nan), _PLACE
    with np.errstate(all="ignore"):
        # 1.5 is nearly the ratio of the standard deviation to the median absolute deviation.
        median_places = np.nanmedian(places, axis=0)
        spread = 1.5 * float(np.nanmedian(np.abs(places - median_places)))
    return median_places, max(_PLACE, spread)
