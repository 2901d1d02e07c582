"""Sweeps: one joint turned alone while a tracker follows the targets on the flange."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.robot.model import JointMap
from jointstiff.solver.triangle import whitener

MIN_POSITIONS = 4
"""Least number of positions: three points always lie on a circle, the fourth can contradict it."""

STILL = 1e-4
"""Largest range of the angle of a joint at rest [rad]: 0.2 mm at 2 m."""

SHORTEST_ARC = np.radians(5.0)
"""Least arc [rad]: below it a circle differs from its tangent by less than 0.1 % of its radius."""

SMALLEST_MOTION = 1e-3
"""Least displacement of the target that moves most [m]."""

LEAST_REACH, MOST_REACH = 1e-2, 50.0
"""Displacements of a target [m] that no robot's readings stay below, or exceed: the unit is wrong."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """K positions of one sweep, T targets. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, fewer than `MIN_POSITIONS` positions, a
            position without any reading, the joint did not move, or its targets did not.
    """

    name: str  #: name of the controller's joint that was turned, for messages
    joint: int  #: index of the joint, 0 to n - 1
    angles: FloatArray  #: (K, n) as the controller shows them [rad]
    points: FloatArray  #: (K, T, 3) readings in the tracker's frame [m]; anything where absent
    present: BoolArray  #: (K, T) True for targets that were read
    #: (3, 3) or (K, T, 3, 3) of the readings in units of sigma²
    covariance: FloatArray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        self._check_shapes()
        if len(self) < MIN_POSITIONS:
            raise MeasurementError(
                f"the sweep has {len(self)} positions; at least {MIN_POSITIONS} are needed",
                where=self.where,
                remedy="record more positions; 10 to 20 over a wide arc are good practice",
            )
        blind = np.flatnonzero(~self.present.any(axis=1))
        if len(blind):
            raise MeasurementError(
                f"position {blind[0] + 1} has no reading",
                where=self.where,
                remedy="omit the position",
            )
        turned = float(np.ptp(self.angles[:, self.joint]))
        moving = np.flatnonzero(np.ptp(self.angles, axis=0) > STILL)
        if turned <= STILL:
            others = ", ".join(f"joint {index + 1}" for index in moving)
            raise MeasurementError(
                f"the joint did not move: its angle changes by only {np.degrees(turned):.2g}°"
                + (f", while {others} turned" if others else ""),
                where=self.where,
                remedy="name the joint that was turned, or repeat the sweep",
            )
        way = self.largest_motion
        if way < SMALLEST_MOTION:
            raise MeasurementError(
                f"the joint did not move: the controller shows {np.degrees(turned):.3g}°, but no target "
                f"moved by more than {way * 1e3:.3g} mm",
                where=self.where,
                remedy="check that readings and angles belong together, that the targets were tracked, and "
                "units.length",
            )
        for array in (self.angles, self.points, self.present, self.covariance):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def where(self) -> str:
        """The sweep, for a message."""
        return f"sweep of {self.name}"

    @property
    def targets(self) -> int:
        """Number of targets T."""
        return int(self.present.shape[1])

    def _check_shapes(self) -> None:
        if self.present.ndim != 2 or self.angles.ndim != 2 or len(self.angles) != len(self.present):
            raise MeasurementError(
                f"the angles have shape {self.angles.shape}, the readings {self.present.shape}",
                where=self.where,
                remedy="give all joint angles and a reading of each target for each position",
            )
        count, targets = self.present.shape
        if self.points.shape != (count, targets, 3) or self.covariance.shape not in {
            (3, 3),
            (count, targets, 3, 3),
        }:
            raise MeasurementError(
                f"the points have shape {self.points.shape}, the covariance {self.covariance.shape}",
                where=self.where,
                remedy="give three coordinates per reading, and one covariance for all readings or "
                "one per reading",
            )
        if not (np.isfinite(self.angles).all() and np.isfinite(self.points[self.present]).all()):
            raise MeasurementError(
                "an angle or a coordinate is not finite",
                where=self.where,
                remedy="omit or repeat the reading",
            )
        if not 0 <= self.joint < self.angles.shape[1]:
            raise MeasurementError(
                f"joint {self.joint + 1} does not exist: the robot has {self.angles.shape[1]} joints",
                where=self.where,
                remedy="name one of the robot's joints",
            )

    @property
    def largest_motion(self) -> float:
        """Diagonal of the box [m] around the readings of the target that moved most."""
        return max(
            (
                float(np.linalg.norm(np.ptp(self.points[self.present[:, t], t], axis=0)))
                for t in range(self.targets)
                if self.present[:, t].any()
            ),
            default=0.0,
        )

    def whitened(self) -> tuple[FloatArray, FloatArray]:
        """Return points (K, T, 3) [m] and whiteners (K, T, 3, 3) in units of 1/sigma; zero where absent."""
        present = self.present[..., None]
        weight = np.where(present[..., None], whitener(self.covariance), 0.0)
        return np.where(present, self.points, 0.0), weight


def refuse_other_unit(reach: float) -> None:
    """Refuse readings that only make sense in another unit of length.

    Args:
        reach: largest displacement of a target [m].

    Raises:
        MeasurementError: it is not that of a robot.
    """
    other = reach / 1e3 if reach > 1.0 else 1e3 * reach  # what does not move at all fits no unit
    if LEAST_REACH <= reach <= MOST_REACH or other < LEAST_REACH:
        return
    shown = f"{reach:,.0f} m" if reach > 1.0 else f"{1e3 * reach:.2g} mm"
    given, meant = ("m", "mm") if reach > 1.0 else ("mm", "m")
    raise MeasurementError(
        f"no target moves farther than {shown}" if reach < 1.0 else f"a target moves by {shown}",
        where="units.length",
        remedy=f"check units.length: positions in {meant} seem to be declared in {given}",
    )


def refuse_other_sigma(sigma: float | None) -> None:
    """Refuse a standard uncertainty that is not positive and finite.

    Raises:
        MeasurementError: it is not.
    """
    if sigma is not None and not (np.isfinite(sigma) and sigma > 0.0):
        raise MeasurementError(
            f"sigma must be positive, but is {sigma}", where="noise.sigma", remedy="give a positive length"
        )


@dataclass(frozen=True, eq=False)
class SweepSet:
    """Sweeps of one robot by one tracker that stood still, with the same targets.

    Raises:
        MeasurementError: no sweep, sweeps of different robots or targets, two sweeps of one joint, a sigma
            that is not positive, or a joint that turns along although the map does not couple it.
    """

    sweeps: tuple[Sweep, ...]  #: in any order; positions in the tracker's frame
    targets: tuple[str, ...]  #: names of the T targets
    joint_map: JointMap  #: from controller to model angles
    sigma: float | None = None  #: standard uncertainty of one coordinate of one reading [m]; None if unknown

    def __post_init__(self) -> None:
        refuse_other_sigma(self.sigma)
        if not self.sweeps:
            raise MeasurementError("no sweep", where="sweeps", remedy="give one sweep of each joint")
        refuse_other_unit(max(sweep.largest_motion for sweep in self.sweeps))
        for sweep in self.sweeps:
            if sweep.angles.shape[1] != self.joint_map.n or sweep.targets != len(self.targets):
                raise MeasurementError(
                    f"the sweep has {sweep.angles.shape[1]} angles and {sweep.targets} targets, but the "
                    f"robot has {self.joint_map.n} joints and the set {len(self.targets)} targets",
                    where=sweep.where,
                    remedy="give all joint angles and the same targets in all sweeps",
                )
            turning = self.turning(sweep)
            arc = float(np.ptp(self.model_angles(sweep)[:, turning], axis=0).max())
            if arc < SHORTEST_ARC:
                raise MeasurementError(
                    f"the arc of {np.degrees(arc):.2g}° is too short to determine the axis",
                    where=sweep.where,
                    remedy=f"sweep at least {np.degrees(SHORTEST_ARC):.0f}°, better 90° or more",
                )
        name, count = Counter(
            " and ".join(f"model joint {index + 1}" for index in self.turning(sweep)) for sweep in self.sweeps
        ).most_common(1)[0]
        if count > 1:
            raise MeasurementError(
                f"{count} sweeps turn {name}",
                where="sweeps",
                remedy="give one sweep per joint; add the positions of a repeated sweep to the first",
            )

    def model_angles(self, sweep: Sweep) -> FloatArray:
        """Angles of the model (K, n) [rad] in a sweep."""
        return self.joint_map.model_angles(sweep.angles)

    def turning(self, sweep: Sweep) -> tuple[int, ...]:
        """IndexArray of the model joints that turn in a sweep.

        One, as a rule. With coupled axes (J2/J3 of FANUC) turning one joint of the controller turns two
        of the model; and turning two of the controller's against each other may turn one of the model.
        """
        ranges = np.ptp(self.model_angles(sweep), axis=0)
        return tuple(int(index) for index in np.flatnonzero(ranges > STILL))
