"""Measurements: arrays in SI units, checked once, that the identification reads, and their uncertainty.

Measurements may include readings of secondary encoders (angles behind the gearboxes, before and under load),
and uncertainties of errors that all observations share: of one load cell, one load hook, one set of
reflectors. A laser tracker (method.md §3) measures a distance and two angles, with standard uncertainties
``σ_r = a + b d`` in the line of sight and
``σ_t = c + e d`` across it, d the distance from the station: the covariance of a position turns with the line
of sight and grows with the distance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.measurement import ConfusedForceUnit, ForceUnit
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.mechanics.hook import HookReading
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

FORCE_UNITS: Final[Mapping[ConfusedForceUnit, float]] = {
    "N": 1.0,
    "kN": 1e3,
    "kgf": 9.80665,
    "lbf": 4.4482216152605,
}
"""Units of force that people confuse [N]; kgf and lbf by standard gravity, exactly."""
ISOTROPIC_DIFFERENCE: FloatArray = 2.0 * np.eye(3)
"""Covariance of a deflection in units of sigma²: it is a difference of two readings (method.md §3)."""
ISOTROPIC_DIFFERENCE.setflags(write=False)
SHORTEST_SIGHT: Final = 0.01
"""Distance from station to target [m] below which the line of sight is undefined."""
LEAST_SIGMA: Final = 1e-12
"""Least standard uncertainty of an instrument [m]: a picometre."""
LARGEST_CONDITION: Final = 1e12
"""Largest condition number of a covariance: standard uncertainties in a ratio of a million, beyond any
instrument's."""


@dataclass(frozen=True)
class Instrument:
    """Laser tracker at its station, with the standard uncertainties of its readings."""

    station: tuple[float, float, float]  #: place of the station, in R0 [m]
    range_constant: float  #: a [m]
    range_per_distance: float  #: b [m/m]
    transverse_constant: float  #: c [m]
    transverse_per_distance: float  #: e [m/m]

    def covariance(self, places: FloatArray) -> FloatArray:
        """Return the covariance of a reading, Σ = σ_t² I + (σ_r² − σ_t²) u uᵀ.

        σ_r and σ_t are the standard uncertainties along and across the line of sight u.

        Args:
            places: (..., 3) places of targets in R0 [m].

        Returns:
            (..., 3, 3) covariance of a reading at each place, axes of R0 [m²].

        Raises:
            MeasurementError: a target is at the station, or the uncertainties are zero or implausible.
        """
        line_of_sight = places - np.array(self.station)
        distance = np.linalg.norm(line_of_sight, axis=-1)
        if (distance < SHORTEST_SIGHT).any():
            raise MeasurementError(
                f"a target is only {1e3 * distance.min():.3g} mm away from the tracker",
                where="noise.instrument.station",
                remedy="give the tracker's station in R0, in `units.length`",
            )
        sigma_along = self.range_constant + self.range_per_distance * distance
        sigma_across = self.transverse_constant + self.transverse_per_distance * distance
        least = min(float(sigma_along.min()), float(sigma_across.min()))
        largest_ratio = np.inf
        if least > 0.0:
            ratio = sigma_along / sigma_across
            largest_ratio = float(np.maximum(ratio, sigma_across / sigma_along).max())
        # The condition number of the covariance is the squared ratio.
        if least < LEAST_SIGMA or largest_ratio**2 > LARGEST_CONDITION:
            raise MeasurementError(
                f"the standard uncertainties of {sigma_along.max():.3g} m along and "
                f"{sigma_across.max():.3g} m across the line of sight are not those of a tracker: at "
                f"least {LEAST_SIGMA:g} m, and a ratio of at most {LARGEST_CONDITION**0.5:g}, is "
                "plausible",
                where="noise.instrument",
                remedy="check the constants (in `units.length`) and the terms per distance; or state "
                "`noise.sigma` in place of the instrument",
            )
        u = line_of_sight / distance[..., None]
        variance_across = (sigma_across**2)[..., None, None]
        excess_along = (sigma_along**2 - sigma_across**2)[..., None, None]
        excess = excess_along * u[..., :, None] * u[..., None, :]  # (σ_r² − σ_t²) u uᵀ
        covariance: FloatArray = variance_across * np.eye(3) + excess
        return covariance

    def typical_sigma(self, places: FloatArray) -> float:
        """Return the root mean square of the standard uncertainties of coordinates at places (K, 3) [m]."""
        covariance = self.covariance(places)
        return float(np.sqrt(np.trace(covariance, axis1=-2, axis2=-1).mean() / 3.0))


def whitener(covariance: FloatArray) -> FloatArray:
    """Return the whitening matrix W with ``Wᵀ W = Σ⁻¹`` of a covariance Σ (method.md §5, step 1).

    If x has the covariance Σ, then W x has the unit matrix as covariance.

    Args:
        covariance: (..., m, m) covariances Σ.

    Returns:
        W (..., m, m), lower triangular: the inverse of the Cholesky factor of Σ.

    Raises:
        MeasurementError: a covariance is not finite, symmetric and positive definite.
    """
    invalid = MeasurementError(
        "a covariance is not finite, symmetric and positive definite",
        where="noise",
        remedy="check the stated uncertainties",
    )
    largest = np.abs(covariance).max()
    if not np.isfinite(largest):
        raise invalid
    asymmetry = np.abs(covariance - covariance.mT)
    if (asymmetry > 1e-9 * largest).any():
        raise invalid
    try:
        inverse: FloatArray = np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise invalid from None
    return inverse


def whitened(covariance: FloatArray, rows: FloatArray) -> FloatArray:
    """Whiten the rows of three coordinates: scale and combine them, so that their noise has unit covariance.

    Args:
        covariance: (3, 3) or (..., 3, 3) covariance of the three rows.
        rows: (..., 3, k) rows of least-squares problems.
    """
    # Most sets have the covariance 2 I. The comparison is by value, because a set that came from another
    # process has a copy of the constant.
    if np.array_equal(covariance, ISOTROPIC_DIFFERENCE):
        return np.asarray(rows / np.sqrt(2.0))
    return np.asarray(whitener(covariance) @ rows)


@dataclass(frozen=True, eq=False)
class DifferenceNoise:
    """Stated noise of the deflections of N observations of T targets: covariances, and sigma as unit."""

    #: root mean square, over the coordinates of all readings, of the standard uncertainty of a position, or
    #: of a displacement that was read itself [m]; only the unit of `covariance`, on which no estimate depends
    sigma: float
    covariance: FloatArray  #: (N, T, 3, 3) covariance of the deflections, in units of sigma²

    @classmethod
    def from_positions(
        cls,
        unloaded: FloatArray,
        loaded: FloatArray,
        coordinates: IndexArray,
        *,
        are_displacements: BoolArray | None = None,
    ) -> DifferenceNoise:
        """Return the noise of deflections, differences of two readings: Σ_d = Σ_unloaded + Σ_loaded.

        Args:
            unloaded: (N, T, 3, 3) covariance of the positions before the load [m²].
            loaded: (N, T, 3, 3) covariance of the positions under load [m²].
            coordinates: (N, T) number of coordinates that each reading shows.
            are_displacements: (N, T) whether a deflection is one reading, not a difference; None: nowhere.
        """
        of_deflection = unloaded + loaded
        reading_count = 2.0 if are_displacements is None else np.where(are_displacements, 1.0, 2.0)
        # A trace adds the variances of three coordinates.
        of_reading = np.trace(of_deflection, axis1=-2, axis2=-1) / (3.0 * reading_count)
        variance = np.average(of_reading, weights=coordinates)
        was_read = (coordinates > 0)[..., None, None]
        covariance = np.where(was_read, of_deflection / variance, ISOTROPIC_DIFFERENCE)
        return cls(float(np.sqrt(variance)), covariance)

    @classmethod
    def from_instrument(cls, instrument: Instrument, robot: Robot, plain: Measurements) -> DifferenceNoise:
        """Return the noise of measurements by an instrument; `plain` are the measurements without noise."""
        unloaded, loaded = position_covariances(instrument, robot, plain)
        return cls.from_positions(unloaded, loaded, plain.coordinates)


def position_covariances(
    instrument: Instrument, robot: Robot, measurements: Measurements
) -> tuple[FloatArray, FloatArray]:
    """Return (unloaded, loaded): covariances (N, T, 3, 3) [m²] of the positions that an instrument reads.

    For targets that are given in the flange frame, the robot's model gives the places in R0.
    """
    places = measurements.position
    if measurements.in_flange.any():
        postures = Postures(robot, robot.joint_map.model_angles(measurements.joints))
        in_flange = measurements.in_flange[..., None]
        places = np.where(in_flange, postures.to_base(places), places)
    unloaded = fill_unread_places(places, measurements.present)
    loaded = unloaded + measurements.deflection
    return instrument.covariance(unloaded), instrument.covariance(loaded)


def fill_unread_places(places: FloatArray, present: BoolArray) -> FloatArray:
    """Return places (N, T, 3), with the first place that was read at all targets that were not read.

    Covariances are computed for all targets, and any valid place will do for a target without reading.
    """
    return np.where(present[..., None], places, places[present][0])


def find_first_equal(keys: FloatArray) -> IndexArray:
    """Return, for each row of `keys` (N, k), the index (N,) of the first row with equal numbers."""
    # Rows are compared by their bytes. Adding zero turns −0.0 into 0.0, whose bytes differ.
    keys = keys + 0.0
    first_index_of_row = dict[bytes, int]()
    first_indices = list[int]()
    for index, row in enumerate(keys):
        first_indices.append(first_index_of_row.setdefault(row.tobytes(), index))
    return np.array(first_indices)


def refuse_invalid_covariance(covariance: FloatArray, present: BoolArray, field: str) -> None:
    """Refuse covariance matrices that are not symmetric and positive definite within rounding.

    Args:
        covariance: (N, T, 3, 3) covariances of readings, in any unit.
        present: (N, T) mask of the readings to check.
        field: name of the field with the covariance, for the error.

    Raises:
        MeasurementError: a matrix is not a covariance; the error names the first such reading.
    """
    eigenvalues = np.linalg.eigvalsh(covariance)  # (N, T, 3), ascending
    least, greatest = eigenvalues[..., 0], eigenvalues[..., -1]
    is_definite = (least > 0.0) & (least * LARGEST_CONDITION > greatest)
    asymmetry = np.abs(covariance - covariance.mT).max(axis=(-1, -2))
    is_symmetric = asymmetry <= 1e-9 * np.abs(eigenvalues).max(axis=-1)
    invalid = np.argwhere(present & ~(is_definite & is_symmetric))
    if len(invalid):
        observation, target = invalid[0].tolist()
        reading = int(present[observation, :target].sum())  # the request lists only targets that were read
        raise MeasurementError(
            "the covariance matrix is not symmetric and positive definite",
            where=f"observations[{observation}].readings[{reading}].{field}",
            remedy="give the covariance of the three coordinates, axes of R0, in `units.length` squared",
        )


@dataclass(frozen=True, eq=False)
class EncoderReadings:
    """Readings of secondary encoders in N observations of a robot with n joints.

    While the motors' encoders close the position loop, the angle behind the gearbox changes under load by
    the deflection of the joint itself: ``δθ_j = c_j τ_j``, free of what else bends.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, or sigma is not positive.
    """

    deflection: FloatArray  #: (N, n) loaded minus unloaded, angles of the model's joints [rad]
    present: BoolArray  #: (N, n) which joints were read; the others hold zeros
    sigma: float  #: standard uncertainty of one encoder reading [rad]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma) and self.sigma > 0):
            raise MeasurementError(
                f"the encoders' sigma must be positive, but is {self.sigma}",
                where="noise.encoder_sigma",
                remedy="give a positive angle",
            )
        check_array("encoder_readings", self.deflection, self.present.shape)
        self.present.setflags(write=False)

    def __getitem__(self, rows: slice | IndexArray) -> EncoderReadings:
        """Return the readings of the selected observations, in the given order."""
        return EncoderReadings(self.deflection[rows], self.present[rows], self.sigma)


@dataclass(frozen=True, eq=False)
class ReturnReadings:
    """Remaining deflections of N observations of T targets after the load was removed.

    The deflections then count from the mean of the readings before and after the load.
    """

    remaining: FloatArray  #: (N, T, 3) position after minus before the load, axes of R0 [m]
    present: BoolArray  #: (N, T) which targets were read again; the others hold zeros

    def __post_init__(self) -> None:
        check_array("unloaded_after", self.remaining, (*self.present.shape, 3))
        self.present.setflags(write=False)

    def __getitem__(self, rows: slice | IndexArray) -> ReturnReadings:
        """Return the readings of the selected observations, in the given order."""
        return ReturnReadings(self.remaining[rows], self.present[rows])


NOISE_SIGMAS: Final = 3.0
"""Number of standard deviations below which a deflection carries little information."""
ASSUMED_LOAD_POINT: Final = 0.01
"""Standard uncertainty of each coordinate of a load point without a stated uncertainty [m]."""
LEAST_OF_GROUND: Final[dict[str, float]] = {"tracker": 1e-3, "drawing": 3e-3, "hand": ASSUMED_LOAD_POINT}
"""Least standard uncertainty of each coordinate of a load point [m], by how the point is known."""
ASSUMED_FORCE_SCALE: Final = 0.01
"""Relative standard uncertainty of all forces and moments without a stated uncertainty."""
FORCE_BEYOND_PULLEY: Final = 0.95
"""Force at the hook over the force measured beyond a pulley, whose friction takes 5 ± 3 % of it."""
PULLEY_SCALE: Final = 0.03 / FORCE_BEYOND_PULLEY
"""Relative standard uncertainty of the force at the hook, if it is measured beyond a pulley."""
CATALOGUE_SCALE: Final = 0.03
"""Least relative standard uncertainty of a weight by its catalogue: a casting is within some 5 % of it."""
ROPE_ZERO_OF_CELL: Final = 60.0 / math.sqrt(3.0)
"""Standard uncertainty of the zero of a cell in the rope [N]: it is within 60 N, each value as probable."""
ROPE_ZERO_IF_TARED: Final = 2.0
"""Standard uncertainty of the zero of a cell in the rope that was tared before each reading [N]."""
ASSUMED_LIVE_DRIFT: Final = 1e-6
"""Standard uncertainty of the drift from one observation to the next [m] that live campaigns assume, which is
20 µm over 20 observations."""


@dataclass(frozen=True)
class CommonUncertainty:
    """Standard uncertainties of errors that all observations share (method.md §8).

    The true wrench is ``(1 + ε) (I + φ×) W``: ε scales force and moment of all observations alike, φ turns
    both about the axes of R0. The load point and the targets deviate from their stated places in the flange
    frame.

    Raises:
        MeasurementError: an uncertainty is negative or not finite.
    """

    scale: float = 0.0  #: standard uncertainty of ε, dimensionless
    direction: float = 0.0  #: standard uncertainty of each component of φ [rad]
    #: standard uncertainty of a force along each rope, one for all loads: the zero of a load cell [N]
    rope_zero: float = 0.0
    load_point: float = 0.0  #: standard uncertainty of each coordinate of the load point [m]
    #: standard uncertainty of each coordinate of a target's place, independent of other targets [m]
    target_places: float = 0.0
    #: standard uncertainty of a joint axis's place in the model, in each direction across it [m]
    axis_position: float = 0.0
    #: standard uncertainty of a joint axis's direction, about each direction across it [rad]
    axis_direction: float = 0.0
    #: standard uncertainty of the drift of loaded against unloaded positions from one observation to the
    #: next, along each axis of R0 [m]
    drift: float = 0.0
    assumed: frozenset[str] = frozenset()  #: terms whose uncertainty was not stated with the readings
    #: standard uncertainty that is stated for each coordinate of the load point, smaller than `load_point`,
    #: although the point is known by hand or in an unknown way [m]; None otherwise
    doubtful_load_point: float | None = None

    @property
    def stated(self) -> CommonUncertainty:
        """Return these uncertainties, with zero in place of those that were assumed rather than stated."""
        load_point = 0.0 if "load_point" in self.assumed else self.load_point
        scale = 0.0 if "force_scale" in self.assumed else self.scale
        return replace(self, load_point=load_point, scale=scale, assumed=frozenset())

    def source(self, term: str) -> str:
        """Return the name of a term in uncertainty budgets; `assumed_` precedes it if it was not stated."""
        return f"assumed_{term}" if term in self.assumed else term

    def __post_init__(self) -> None:
        value_of_field = {
            "force.scale": self.scale,
            "force.direction": self.direction,
            "force.zero": self.rope_zero,
            "load_point": self.load_point,
            "target_places": self.target_places,
            "axes.position": self.axis_position,
            "axes.direction": self.axis_direction,
            "drift": self.drift,
        }
        for field_name, value in value_of_field.items():
            is_valid = np.isfinite(value) and value >= 0.0
            if not is_valid:
                raise MeasurementError(
                    f"the standard uncertainty is {value}",
                    where=f"noise.{field_name}",
                    remedy="give a number that is zero or positive",
                )


EXACT: Final = CommonUncertainty()
"""Loads and places without uncertainty."""


def project_on_directions(direction: FloatArray | None, motion: FloatArray) -> FloatArray:
    """Project the motions of targets whose readings show one direction n only; keep all other motions.

    A motion δp becomes ``n nᵀ δp``: its three rows, with isotropic noise, have the same sum of squares as the
    single row ``nᵀ δp`` of the reading. So these readings are handled like vectors (method.md §3).

    Args:
        direction: (N, T, 3) unit vectors, zero for readings of all three coordinates; None if no reading is
            along a direction.
        motion: (N, T, 3) or (N, T, 3, k) motions, axes of R0.

    Returns:
        The projected motions, in the shape of `motion`.
    """
    if direction is None:
        return motion
    columns = motion.reshape(*direction.shape, -1)  # (N, T, 3, k)
    n, n_transposed = direction[..., :, None], direction[..., None, :]
    projected = n * (n_transposed @ columns)
    reads_all_coordinates = np.asarray(~direction.any(axis=-1))  # (N, T)
    return np.where(reads_all_coordinates[..., None, None], columns, projected).reshape(motion.shape)


@dataclass(frozen=True)
class Scatter:
    """Errors that are new in every posture and shared by its targets, in units of sigma (method.md §3)."""

    joints: float = 0.0  #: standard deviation of each joint's angle, by which the targets move [rad/m]
    station: float = 0.0  #: standard deviation of each coordinate of the whole set of targets, dimensionless
    #: (n,) noise of the encoder of each joint, relative to its stated noise; encoders then also see the turns
    #: of `joints`. Empty: noise as stated, and encoders see no turns.
    encoders: tuple[float, ...] = ()
    #: (n,) standard deviation of each joint's angle relative to `joints`; empty if all are alike
    relative: tuple[float, ...] = ()
    is_assumed: bool = False  #: whether the errors are assumed: neither stated nor shown by the residuals

    def list_turns(self, count: int) -> FloatArray:
        """Return the standard deviation of each of `count` joints' angles [rad/m]."""
        return self.joints * np.array(self.relative or (1.0,) * count)

    def __bool__(self) -> bool:
        """Return whether targets of a posture share errors."""
        return self.joints > 0.0 or self.station > 0.0


NO_SCATTER: Final = Scatter()
"""Joints that repeat exactly, and readings whose errors are independent."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measured deflections under load: N observations of up to T targets. Arrays are made read-only.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, there is no observation, sigma is
            not positive, encoders were read and sigma is unknown, or a covariance is not symmetric
            positive definite.
    """

    joints: FloatArray  #: (N, n) controller's joint angles [rad]
    force: FloatArray  #: (N, 3) force on the robot, axes of R0 [N]
    moment: FloatArray  #: (N, 3) moment on the robot about the load point, axes of R0 [N·m]
    load_point: FloatArray  #: (N, 3) where the force acts, flange frame [m]
    #: (N, T, 3) unloaded place of each target [m]: in R0 if measured, in the flange frame where `in_flange`
    #: says so
    position: FloatArray
    in_flange: BoolArray  #: (N, T) frame of `position`
    deflection: FloatArray  #: (N, T, 3) loaded minus unloaded, axes of R0 [m]
    present: BoolArray  #: (N, T) True for targets that were read; the others hold zeros
    sigma: float | None = None  #: standard uncertainty of one coordinate of one reading [m]; None if unknown
    #: standard uncertainty that was stated and that the residuals refuted [m], `sigma` being None
    refuted_sigma: float | None = None
    #: (3, 3) or (N, T, 3, 3) covariance of the deflections in units of sigma²
    covariance: FloatArray = field(default_factory=lambda: ISOTROPIC_DIFFERENCE)
    #: (N, T, 3) unit vectors, axes of R0, of readings along one direction; zero for readings of all three
    #: coordinates. None if there are only those.
    direction: FloatArray | None = None
    #: readings of secondary encoders; None without encoders. They require `sigma`, which weights them
    #: relative to the targets.
    encoders: EncoderReadings | None = None
    hook: HookReading | None = None  #: load point that a target at the hook showed; None without a reading
    closed_on_links: bool = False  #: whether encoders behind the gearboxes close the position loop
    returned: ReturnReadings | None = None  #: readings after the load was removed; None without any
    #: repeatability as stated: standard deviation of each joint's angle from one posture to the next, which
    #: moves all targets of a posture together [rad]; None if not stated
    repeatability: float | None = None
    scatter: Scatter = NO_SCATTER  #: errors that all targets of a posture share, as fits account for them
    #: (N, T) weights by a robust loss, 1 for a good reading; None for ones
    weight: FloatArray | None = None
    #: uncertainty of loads and places that all observations share
    common_uncertainty: CommonUncertainty = EXACT
    #: (N, T) mask of targets that were read without load but not under load: only `position` is valid, and
    #: `present` is False. None if there are no such targets.
    unloaded_only: BoolArray | None = None
    force_unit: ForceUnit = "N"  #: unit of forces that was declared with the readings; `force` is in N
    #: (N,) number of each observation in the order of reading, by which a drift grows; 0, 1, … if empty
    order: FloatArray = field(default_factory=lambda: np.zeros(0))
    labels: tuple[str, ...] = ()  #: (N,) labels of the observations; "1", "2", … where none are given
    targets: tuple[str, ...] = ()  #: (T,) names of the targets; "1", "2", … where none are given

    def __post_init__(self) -> None:
        count, target_count = self.present.shape
        if count == 0 or target_count == 0:
            raise MeasurementError("no observation", remedy="give at least one observation")
        object.__setattr__(self, "labels", _complete_names("labels", self.labels, count))
        object.__setattr__(self, "targets", _complete_names("targets", self.targets, target_count))
        if not self.order.size:
            object.__setattr__(self, "order", np.arange(float(count)))
        self._refuse_invalid_noise()
        for name, shape_of_row in self._row_shapes.items():
            check_array(name, getattr(self, name), (count, *shape_of_row))
        if self.covariance.ndim == 2:
            check_array("covariance", self.covariance, (3, 3))
        if self.direction is not None:
            object.__setattr__(self, "deflection", self.project_on_directions(self.deflection))
        if self.encoders is not None:
            check_array("encoder_readings", self.encoders.deflection, self.joints.shape)

    def _refuse_invalid_noise(self) -> None:
        """Refuse standard uncertainties that are not plausible numbers, and encoders without sigma."""
        sigma, repeatability = self.sigma, self.repeatability
        if sigma is not None and not (np.isfinite(sigma) and sigma > 0):
            raise MeasurementError(
                f"sigma must be positive, but is {sigma} m",
                where="noise.sigma",
                remedy="give a positive length; omit `noise` to estimate sigma from the residuals",
            )
        if repeatability is not None and not (np.isfinite(repeatability) and repeatability >= 0.0):
            raise MeasurementError(
                f"the repeatability must be zero or positive, but is {repeatability} rad",
                where="noise.repeatability",
                remedy="give an angle that is zero or positive; omit the repeatability to estimate it from "
                "the residuals",
            )
        if self.encoders is not None and sigma is None:
            raise MeasurementError(
                "there are encoder readings but no sigma of the tracker, so angles and lengths cannot be "
                "weighted",
                where="noise",
                remedy="state `noise.sigma` and `noise.encoder_sigma`, or omit the encoder readings",
            )

    def number_unloaded_readings(self) -> IndexArray:
        """Return the number (N,) of the unloaded reading of each observation, counted from 0.

        Loads of one posture may share it: equal angles and equal positions of all targets are one reading.
        Where positions were not measured, or encoders were read, each observation has a reading of its own.
        """
        count = len(self.joints)
        if self.in_flange.any() or self.direction is not None or self.encoders is not None:
            return np.arange(count)
        keys = np.hstack([self.joints, self.position.reshape(count, -1), self.present])
        _, numbers = np.unique(keys, axis=0, return_inverse=True)
        return numbers.reshape(count)

    @property
    def _row_shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of one row of each array that has a row for each observation, by the name of the array.

        Optional arrays that are None are omitted.
        """
        n, T = self.joints.shape[-1], self.present.shape[1]
        shapes: dict[str, tuple[int, ...]] = {
            "joints": (n,),
            "covariance": (T, 3, 3),
            "force": (3,),
            "moment": (3,),
            "load_point": (3,),
            "position": (T, 3),
            "deflection": (T, 3),
            "direction": (T, 3),
            "in_flange": (T,),
            "present": (T,),
            "weight": (T,),
            "unloaded_only": (T,),
            "order": (),
        }
        all_readings_share_covariance = self.covariance.ndim == 2
        if all_readings_share_covariance:
            del shapes["covariance"]
        return {name: shape for name, shape in shapes.items() if getattr(self, name) is not None}

    @property
    def encoder_lever(self) -> float:
        """Lever [m] that turns an encoder's deflection into that of a target; 0 without encoders.

        A target at this distance from the joint's axis moves by ``lever · δθ``, and determines the joint's
        angle as precisely as the encoder does.
        """
        if self.encoders is None or self.sigma is None:
            return 0.0
        return self.sigma / self.encoders.sigma

    @property
    def coordinates(self) -> IndexArray:
        """Number (N, T) of coordinates that each reading shows: 3; 1 along a direction; 0 if not read."""
        coordinates = np.where(self.present, 3, 0)
        if self.direction is not None:
            is_along_direction = self.direction.any(axis=-1)
            coordinates[self.present & is_along_direction] = 1
        return coordinates

    def project_on_directions(self, motion: FloatArray) -> FloatArray:
        """Project motions (N, T, 3[, k]), axes of R0, on the directions of readings along one direction."""
        return project_on_directions(self.direction, motion)

    def __len__(self) -> int:
        return len(self.joints)

    def place(self, row: int) -> str:
        """Return the words by which messages name an observation, such as ``observations[3] '4'``.

        `row` is the index of the observation.
        """
        return f"observations[{row}] '{self.labels[row]}'"

    @property
    def is_unloaded(self) -> bool:
        """Return whether all readings are positions without load."""
        return self.unloaded_only is not None and not self.present.any()

    def require_loads(self) -> Measurements:
        """Return these measurements, after checking that every reading has a position under load.

        Raises:
            MeasurementError: some readings have no position under load; the error names the first.
            RequestError: no reading has a position under load.
        """
        if self.unloaded_only is None:
            return self
        by_weight = "give the robot's masses (`bodies`), and `weight` in the run"
        if self.is_unloaded:
            raise RequestError(
                "the set has only positions without load, which show no deflection",
                where="measurement_set_id",
                remedy=f"identify the set by the robot's own weight: {by_weight}",
            )
        observation, target = np.argwhere(self.unloaded_only)[0].tolist()
        missing, present = int(self.unloaded_only.sum()), int(self.present.sum())
        raise MeasurementError(
            f"{self.place(observation)}, target {self.targets[target]}: `loaded` is missing ({missing} of "
            f"{missing + present} readings)",
            where=f"observations[{observation}].readings",
            remedy="give the position under load, or omit the reading; to identify by the sag under the "
            f"robot's own weight, {by_weight}",
        )

    def select_evenly(self, most: int) -> Measurements:
        """Return at most `most` observations, evenly spread over the set; all if the set is not larger."""
        count = len(self)
        if count <= most:
            return self
        return self[np.arange(most) * (count - 1) // max(most - 1, 1)]

    def __getitem__(self, rows: slice | IndexArray) -> Measurements:
        """Return the measurements of the selected observations, in the given order."""
        arrays = {name: getattr(self, name)[rows] for name in self._row_shapes}
        selected = np.arange(len(self))[rows].tolist()
        labels = tuple(self.labels[i] for i in selected)
        encoders = None if self.encoders is None else self.encoders[rows]
        returned = None if self.returned is None else self.returned[rows]
        return replace(self, **arrays, encoders=encoders, returned=returned, labels=labels)


def _complete_names(where: str, names: tuple[str, ...], count: int) -> tuple[str, ...]:
    """Return the names, or the numbers "1", "2", … up to `count` in place of missing names.

    `where` says what is named, "labels" or "targets", for the error.

    Raises:
        MeasurementError: the number of names is not `count`.
    """
    if not names:
        return tuple(str(number) for number in range(1, count + 1))
    if len(names) != count:
        raise MeasurementError(
            f"{len(names)} {where} are given, but {count} are needed",
            where=where,
            remedy="give one label for each observation, and one name for each target",
        )
    return names


def check_array(name: str, array: npt.NDArray[np.generic], shape: tuple[int, ...]) -> None:
    """Check the shape of an array and that its numbers are finite, and make it read-only.

    Raises:
        MeasurementError: the array has another shape, or a number is not finite; the error names the array.
    """
    if array.shape != shape:
        raise MeasurementError(
            f"the shape is {array.shape} instead of {shape}",
            where=name,
            remedy="give one entry for each observation and target",
        )
    if array.dtype != np.bool_ and not np.isfinite(array).all():
        raise MeasurementError("a number is not finite", where=name, remedy="omit or repeat the reading")
    array.setflags(write=False)
