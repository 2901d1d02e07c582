"""Innovation: whether a new reading is what the others let expect, and what explains it if not.

The others are fitted with what is uncertain of all loads and places as unknowns of stated size. What they
leave open of the new reading is then known before it is taken, and so is the probability of its distance.
Of a doubtful reading, mistakes that are made with a single reading compete: each changes what was read, and
the one that leaves the least is named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.integrity.values import View
from jointstiff.solver.mechanics.block import Term, regressor_blocks
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import FORCE_SCALE, SHIFT, TERMS
from jointstiff.solver.text import length_text


@dataclass(frozen=True)
class Innovation:
    """Comparison of a reading with what the others let expect."""

    #: probability of a reading at least so far from its prediction; None where the others do not predict it
    p_value: float | None = None
    distance: float | None = None  #: greatest distance of a target from where it was expected [m]
    doubtful: bool = False  #: whether it ought to be read again before the load is taken off
    causes: list[str] = field(default_factory=list)  #: causes in words, the likeliest first
    message: str | None = None


_NOT_COMPARABLE: Final = Innovation(message="too few other readings to compare this one with")

DOUBTFUL: Final = (1e-5, 1e-4)
"""Probability of so great a distance below which a reading is doubtful: in any way; as by another force."""
_BEYOND: Final = 9.0
"""Squared factor by which a doubtful reading that no slip explains is farther off than each of the others."""
_FARTHER: Final = 1.2
"""The same of what another force explains, where noise explains the others."""
_USUAL: Final = 0.03
"""Share of a deflection, alike at all targets of a posture, that joints of most arms leave unexplained: a
reading that it explains is not doubtful."""
_EXPLAINED: Final = 0.01
"""Probability of residuals as great as these by stated noise, above which noise is all there is."""
_FEWEST: Final = 4
"""Number of other readings from which on they are compared with each other, too."""
_BALL: Final = 0.9
"""Probability that the ball about a prediction holds."""
_VAGUE: Final = 30.0
"""Standard uncertainty of each compliance before any reading, relative to what would move targets alike."""
_PLAUSIBLE: Final = 1e-3
"""Probability above which a mistake explains a reading."""
_BETTER: Final = 6.0
"""Difference of two mistakes' criteria below which both are named."""
_MOST_NAMED: Final = 2
_PLACE: Final = 2e-3
"""Standard deviation of a target's place by the kinematic model [m], at least: arms are as accurate."""
_WRONG_PLACE: Final = 1e-6
"""Probability of so great a distance of the unloaded targets from where the model puts them."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """Expectation of another reading by N of them: a fit of the joints and of errors of stated size."""

    robot: Robot
    terms: tuple[Term, ...]
    compliance: FloatArray  #: (n,) at which rows are computed [rad/(N·m)]
    best: FloatArray  #: (K,) fitted unknowns of all terms
    root: FloatArray  #: (K, K); its product with the transpose is their covariance [unit²]
    noise: float  #: variance of a coordinate of unit covariance [m²]
    misfit: float  #: squared share of a deflection that is not explained, beyond noise
    freedom: float  #: degrees of freedom of both; inf where noise is stated and explains what is left
    places: FloatArray  #: (T, 3) of targets in the flange frame by unloaded readings [m]; NaN where unknown
    spread: float  #: standard deviation of a coordinate of such a place [m]

    @classmethod
    def from_readings(cls, robot: Robot, others: Measurements, compliance: FloatArray) -> Expectation | None:
        """Fit N readings to predict another reading; None if nothing determines the noise.

        Args:
            robot: n joints.
            others: N observations under load.
            compliance: (n,) compliances from a fit to these readings [rad/(N·m)].

        Raises:
            SolverError: the load finds no balance.
        """
        common = others.common_uncertainty
        errors = [(term, term.prior(common)) for term in TERMS.values()]
        errors = [(term, prior) for term, prior in errors if prior and max(prior) > 0.0]
        terms = (JOINTS, *(term for term, _ in errors))
        stack = _build_stack(robot, others, terms, compliance)
        triangle, read = stack.triangle(), int(stack.read.sum())
        moved = float(np.square(triangle.rhs).sum())  # sum of the squared deflections
        size = np.linalg.norm(triangle.matrix[:, triangle.span[JOINTS.name]], axis=0)
        alike = np.where(size > 1e-9 * size.max(), size, np.inf)
        deviation = [_VAGUE * np.sqrt(moved or len(stack.flat)) / alike]
        for term, prior in errors:
            deviation.append(np.resize(np.array(prior), stack.widths[term.name]))
        unit = np.concatenate(deviation)
        stated = None if others.sigma is None else others.sigma**2
        variance, freedom = stated or moved / len(stack.flat) or 1.0, np.inf
        # The weight of the prior depends on the variance, which the fit determines.
        for _ in range(1 if stated is None and read <= robot.n else 3):
            fit, used = triangle.fit_with_prior(unit, variance), variance
            left = read - int(np.isfinite(alike).sum())
            if left < 1:
                break
            by_readings = fit.squares / left
            known = stated is not None and special.chdtrc(left, fit.squares / stated) > _EXPLAINED
            variance, freedom = (stated or 0.0, np.inf) if known else (max(by_readings, 1e-24), left)
        if stated is None and not np.isfinite(freedom):
            return None
        root = np.sqrt(variance / used) * fit.root
        places, spread = _compute_median_places(robot, others)
        noise = variance if stated is None else stated
        misfit = (variance - noise) / (moved / read)
        return cls(robot, terms, compliance, fit.unknowns, root, noise, misfit, freedom, places, spread)

    def measure_distance(
        self, reading: Measurements, *, free: Term | None = None, usual: float = 0.0
    ) -> tuple[float, float, int]:
        """Measure how far one reading is from its prediction, relative to the uncertainty of the prediction.

        Args:
            reading: one observation.
            free: term that is fitted to this reading alone; None fits nothing.
            usual: share of the deflection by which all targets may deviate alike.

        Returns:
            Squared distance in standard uncertainties; probability of at least this distance; and number of
            coordinates compared, less the unknowns of the fitted term.

        Raises:
            SolverError: the load finds no balance.
        """
        rows = _build_stack(self.robot, reading, self.terms, self.compliance).flat
        count = int(reading.coordinates.sum())
        own, moved = rows[:, :-1] @ self.root, rows[:, :-1] @ self.best
        variance = self.noise + self.misfit * float(np.square(moved).sum()) / count
        covariance = variance * np.eye(len(own)) + own @ own.T
        if usual**2 > self.misfit:
            shift = _build_stack(self.robot, reading, (SHIFT,), self.compliance).flat[:, :-1]
            size = (usual**2 - self.misfit) * np.square(moved).sum() / np.square(shift).sum()
            covariance += size * shift @ shift.T
        factor = np.linalg.cholesky(covariance)
        e = np.linalg.solve(factor, rows[:, -1] - moved)
        if free is not None:
            more = _build_stack(self.robot, reading, (free,), self.compliance).flat
            C = np.linalg.solve(factor, more[:, :-1])
            e = e - C @ np.linalg.lstsq(C, e, rcond=None)[0]
            count -= C.shape[1]
        square = float(e @ e)
        return square, self.compute_exceedance_probability(square, count), count

    def compute_greatest_distance(self, reading: Measurements) -> float:
        """Return the greatest distance of a target of one reading from its prediction [m]."""
        rows = _build_stack(
            self.robot, replace(reading, covariance=np.eye(3)), self.terms, self.compliance
        ).flat
        left = (rows[:, -1] - rows[:, :-1] @ self.best).reshape(-1, 3)
        return float(np.linalg.norm(left, axis=1).max())

    def compare_unloaded_places(self, reading: Measurements) -> tuple[float, float]:
        """Compare the unloaded targets of a reading with their usual places on the flange.

        Returns:
            Squared distance in standard deviations; and the probability of at least this distance, 1 if no
            place can be compared.
        """
        places = View(self.robot, reading).places[0]
        off = (places - self.places)[np.isfinite(places - self.places).all(axis=1)] / self.spread
        square = float(np.square(off).sum())
        return square, float(special.chdtrc(off.size, square)) if off.size else 1.0

    def compute_squared_distance_quantile(self, probability: float, count: int) -> float:
        """Return the quantile of the squared Mahalanobis distance of a reading with `count` coordinates.

        The distribution is χ², or that of ``count · F`` where sigma is estimated with `freedom` degrees of
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
    """Compare the last reading with its prediction from the others; look for a mistake if it is doubtful.

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) compliances from a fit to the others [rad/(N·m)].
    """
    reading = measurements[-1:]
    others = measurements[:-1] if len(measurements) > 1 else None
    try:
        expected = None if others is None else Expectation.from_readings(robot, others, compliance)
        if others is None or expected is None:
            return _NOT_COMPARABLE
        _, p_value, _ = expected.measure_distance(reading)
        squares, p_values = _measure_unusual_distances(expected, reading, _USUAL)
        far = p_values < DOUBTFUL
        wrong_place = expected.compare_unloaded_places(reading)[1] < _WRONG_PLACE
        off, causes, doubtful = expected.compute_greatest_distance(reading), list[str](), bool(far.any())
        if doubtful or wrong_place:
            slips, causes = _find_causes(expected, reading, others)
            # A model error is no mistake of one reading: the others are as far from their predictions.
            known = len(others) >= _FEWEST
            factor = np.ones(2)
            if not slips:
                factor = np.array([_BEYOND, _FARTHER if expected.misfit == 0.0 else _BEYOND])
            least = np.array([0.0 if slips else np.inf, np.inf])
            if known:
                least = factor * _cross_check_readings(expected, others, _USUAL).max(axis=0)
            doubtful = bool((far & (squares > least)).any())
    except SolverError:  # other findings report a load without balance
        return _NOT_COMPARABLE
    if not doubtful and not wrong_place:
        return Innovation(p_value, off, message="as expected")
    if not causes and wrong_place:
        same = np.isclose(others.joints, reading.joints[0]).all(axis=1)
        whose = (
            f"those of '{others.labels[int(np.argmax(same))]}'" if same.any() else "not those of this posture"
        )
        causes = [f"the joint angles are {whose}"]
    where = (
        f"{length_text(off)} from where the other readings predict it"
        if doubtful
        else "the unloaded targets are misplaced"
    )
    why = " or ".join(causes) + "?" if causes else "no single mistake explains it"
    return Innovation(
        p_value=p_value,
        distance=off,
        doubtful=True,
        causes=causes,
        message=f"{where}: {why} Read it again before the load is taken off.",
    )


@dataclass(frozen=True)
class HeldOut:
    """A reading that was compared with its prediction before it counted."""

    label: str
    ball_ratio: float  #: distance from the prediction over the radius of its 90 % ball
    distance: float  #: greatest distance of a target from its prediction [m]

    @property
    def inside(self) -> bool:
        """Return whether the reading lies in the 90 % ball about its prediction."""
        return self.ball_ratio <= 1.0


def check_held_out_reading(
    robot: Robot, measurements: Measurements, compliance: FloatArray, row: int
) -> HeldOut | None:
    """Compare a held-out reading with the 90 % ball about its prediction by the other readings.

    The ball covers noise and the uncertainty of the prediction. With at least `_FEWEST` others it also
    covers the model error: each of them is compared with its prediction from the rest.

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) compliances from a fit to the others [rad/(N·m)].
        row: index of the held-out reading.

    Returns:
        The comparison; None where the other readings cannot predict this one.
    """
    others = measurements[np.delete(np.arange(len(measurements)), row)]
    reading = measurements[np.array([row])]
    try:
        expected = Expectation.from_readings(robot, others, compliance)
        if expected is None:
            return None
        square, _, count = expected.measure_distance(reading)
        limit = expected.compute_squared_distance_quantile(_BALL, count)
        if len(others) >= _FEWEST:
            own = np.sort(_cross_check_readings(expected, others, 0.0)[:, 0])
            limit = max(limit, float(own[min(len(own) - 1, int(np.ceil(_BALL * (len(own) + 1))) - 1)]))
        off = expected.compute_greatest_distance(reading)
    except SolverError:
        return None
    return HeldOut(measurements.labels[row], float(np.sqrt(square / limit)), off)


def _measure_unusual_distances(
    expected: Expectation, reading: Measurements, usual: float
) -> tuple[FloatArray, FloatArray]:
    """Measure a reading's distance from its prediction beyond a usual share of the deflection.

    Returns:
        (2,) squared distance, and the part of it that another size of the force explains; and (2,) the
        p-values of these two numbers.
    """
    square, p_value, _ = expected.measure_distance(reading, usual=usual)
    fitted, _, _ = expected.measure_distance(reading, usual=usual, free=FORCE_SCALE)
    gain = square - fitted
    return np.array([square, gain]), np.array([p_value, expected.compute_exceedance_probability(gain, 1)])


def _cross_check_readings(expected: Expectation, others: Measurements, usual: float) -> FloatArray:
    """Predict each of K readings from the rest, and return the squared distances (K, 2).

    The columns are the squared distance, and the part of it that another size of the force explains. All
    predictions use the noise of `expected`. If no reading can be predicted, the result is one row of zeros.
    """
    squares = []
    for k in range(len(others)):
        part = others[np.delete(np.arange(len(others)), k)]
        rest = Expectation.from_readings(expected.robot, part, expected.compliance)
        if rest is not None:
            rest = replace(rest, noise=expected.noise, misfit=expected.misfit)
            squares.append(_measure_unusual_distances(rest, others[np.array([k])], usual)[0])
    return np.array(squares) if squares else np.zeros((1, 2))


def _find_causes(
    expected: Expectation, reading: Measurements, others: Measurements
) -> tuple[bool, list[str]]:
    """Search for the mistakes that explain a doubtful reading.

    Returns:
        True if the best explanation is a slip such as a wrong sign, without a fitted size; and the
        explanations in words, the likeliest first.
    """
    scores: list[tuple[bool, float, str]] = []  # fitted, cost, words; plain slips first
    for words, changed, free, unknowns in _propose_mistakes(expected.robot, reading, others):
        try:
            square, p_value, _ = expected.measure_distance(changed, free=free)
        except SolverError:
            continue
        off, p_place = expected.compare_unloaded_places(changed)
        if p_value > _PLAUSIBLE and p_place > _WRONG_PLACE:
            price = unknowns * np.log(reading.coordinates.sum())
            scores.append((free is not None, square + off + price, words))
    scores.sort(key=lambda score: score[:2])
    named = [
        words
        for fitted, square, words in scores
        if (fitted, square) <= (scores[0][0], scores[0][1] + _BETTER)
    ]
    return bool(scores) and not scores[0][0], list(dict.fromkeys(named))[:_MOST_NAMED]


def _propose_mistakes(
    robot: Robot, reading: Measurements, others: Measurements
) -> Iterator[tuple[str, Measurements, Term | None, int]]:
    """Yield possible mistakes of a reading.

    Yields:
        The mistake in words, the reading as it would be without the mistake, the term to fit (None for a
        plain slip), and the number of unknowns.
    """
    yield "the force has the opposite sign", replace(reading, force=-reading.force), None, 0
    if not reading.in_flange.any():
        after = reading.position + reading.deflection
        swapped = replace(reading, position=after, deflection=-reading.deflection)
        yield "unloaded and loaded readings are exchanged", swapped, None, 0
    for words, exchanged in _propose_target_exchanges(reading):
        yield words, exchanged, None, 0
    for label, joints in zip(others.labels, others.joints, strict=True):
        if not np.allclose(joints, reading.joints[0]):
            yield f"the arm was in the posture of '{label}'", replace(reading, joints=joints[None]), None, 1
    for j, name in enumerate(robot.joint_names):
        turned = reading.joints.copy()
        turned[0, j] *= -1.0
        yield f"the angle of {name} has the opposite sign", replace(reading, joints=turned), None, 0
    yield "the force differs from the stated one", reading, FORCE_SCALE, 1
    yield "the arm or the tracker moved between the two readings", reading, SHIFT, 3


def _propose_target_exchanges(reading: Measurements) -> Iterator[tuple[str, Measurements]]:
    """Yield each exchange of two targets in words, and the reading with the exchange undone."""
    before, after = reading.position, reading.position + reading.deflection
    for a, b in combinations(np.flatnonzero(reading.present[0]).tolist(), 2):
        order = np.arange(len(reading.targets))
        order[[a, b]] = b, a
        words = f"{reading.targets[a]} and {reading.targets[b]} are exchanged"
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
        terms: compliances and errors that are unknown.
        compliance: (n,) compliances at which the rows are linearised [rad/(N·m)].
    """
    return Stack.from_blocks(regressor_blocks(robot, measurements, compliance), terms, compliance)


def _compute_median_places(robot: Robot, others: Measurements) -> tuple[FloatArray, float]:
    """Return the median places (T, 3) of targets in the flange frame [m], and their standard deviation [m].

    With fewer than `_FEWEST` observations, or without positions, the places are NaN.
    """
    places = View(robot, others).places
    if len(others) < _FEWEST or np.isnan(places).all():
        return np.full(places.shape[1:], np.nan), _PLACE
    with np.errstate(all="ignore"):
        # 1.5 is nearly the ratio of the standard deviation to the median absolute deviation.
        middle = np.nanmedian(places, axis=0)
        spread = 1.5 * float(np.nanmedian(np.abs(places - middle)))
    return middle, max(_PLACE, spread)
