"""The wrist centre in three ways, how far they agree, and whether the wrist's axes meet.

* **sphere**: with the arm at rest, every target runs on a sphere about the centre, whichever wrist joint
  turns;
* **axes**: the point nearest to the last three axes, each weighted by its uncertainty there;
* **trilateration**: at each position from three targets (`trilaterate`), at the distances that the spheres
  found.

All use the same readings, so their errors are related. Each way keeps its derivative by the readings, from
which covariances and those of differences are exact to first order. The combination weights each by the
inverse of its own covariance: a way that is ill-conditioned counts little, and none has a negative weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames.base_frame import BaseFrame
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.frames.sphere_fit import SphereFit, fit_spheres, trilaterate
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes, posed
from jointstiff.solver.geometry.sweeps.sweep import STILL
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes
from jointstiff.solver.robot.configuration import WRIST_JOINTS, Wrist
from jointstiff.solver.text import length_text


@dataclass(frozen=True)
class WristMiss:
    """By how much the last three axes miss a common point."""

    distance: float  #: greatest distance of one of the axes from the point nearest to them [m]
    #: of that [m]; where the distance is not beyond it, it says how large the miss may be
    standard_uncertainty: float
    probability: float  #: probability that axes which do meet are found so far apart

    @property
    def spherical(self) -> bool:
        """Return whether the axes meet within `Wrist.TOLERANCE`, which the decoupled method needs."""
        return self.distance <= Wrist.TOLERANCE


def nearest_to_axes(
    identified: IdentifiedAxes, posture: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], WristMiss]:
    """Find the point nearest to the last three axes, by generalised least squares.

    Args:
        identified: at least three axes.
        posture: (n,) model angles in which to look [rad]; of a spherical wrist its own do not matter.

    Returns:
        The point (3,) in the tracker's frame [m] with its derivative (3, m) by the whitened readings in units
        of sigma, and by how much the axes miss it.

    Raises:
        MeasurementError: the axes are nearly parallel.
    """
    reference = _wrist(identified.axes, posture)
    rough = _nearest(reference, np.eye(2 * WRIST_JOINTS))

    def offsets(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        return _offsets(_wrist(axes, posture), rough, reference)

    V = identified.covariance_of(offsets)
    weight = np.asarray(np.linalg.inv(V), dtype=np.float64)
    centre = _nearest(reference, weight)

    def nearest(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        return _nearest(_wrist(axes, posture), weight)

    def distances(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        wrist = _wrist(axes, posture)
        middle = _nearest(wrist, np.eye(2 * WRIST_JOINTS))
        return np.array([np.linalg.norm(axis.at(axis.foot(middle)) - middle) for axis in wrist])

    point = distances(identified.axes, identified.targets)
    farthest = int(np.argmax(point))
    left = _offsets(reference, centre, reference)
    miss = WristMiss(
        float(point[farthest]),
        float(np.sqrt(np.trace(V) / len(V))),
        float(special.chdtrc(2 * WRIST_JOINTS - 3, left @ weight @ left)),
    )
    return (centre, identified.jacobian_of(nearest) @ identified.influence), miss


def _wrist(axes: Sequence[Axis], posture: FloatArray) -> tuple[Axis, ...]:
    return posed(axes, posture)[0][-WRIST_JOINTS:]


def _offsets(axes: Sequence[Axis], point: FloatArray, reference: Sequence[Axis]) -> FloatArray:
    """Return the offsets of axes from a point, (6,) along the normals of reference axes nearby [m]."""
    gaps = [axis.at(axis.foot(point)) - point for axis in axes]
    return np.concatenate([r.frame[:, :2].T @ gap for r, gap in zip(reference, gaps, strict=True)])


def _nearest(axes: Sequence[Axis], weight: FloatArray) -> FloatArray:
    """Point of least weighted squares of its distances along two normals of each axis."""
    N = np.vstack([axis.frame[:, :2].T for axis in axes])
    points = np.concatenate([axis.frame[:, :2].T @ axis.point for axis in axes])
    system = N.T @ weight @ N
    scaled = system / np.trace(system)
    if np.linalg.svd(scaled, compute_uv=False)[-1] < 1e-9:
        raise MeasurementError(
            "the last three axes are nearly parallel, so there is no wrist centre",
            where="sweeps",
            remedy="use a method that needs no wrist centre",
        )
    return np.asarray(np.linalg.solve(system, N.T @ weight @ points))


CentreWay = Literal["sphere", "axes", "trilateration", "combined"]

DISAGREEMENT = 1e-4
"""p-value below which two estimates of the centre count as contradictory."""


@dataclass(frozen=True, eq=False)
class CentreEstimate:
    """The wrist centre by one estimate."""

    way: CentreWay  #: which
    centre: FloatArray  #: (3,) tracker's frame, arm as in the wrist's sweeps [m]
    covariance: FloatArray  #: (3, 3) [m²]
    influence: FloatArray  #: (3, m) derivative by the whitened readings, in units of sigma
    weight: FloatArray  #: (3, 3) its weight in the combination; the weights add up to the unit matrix

    @property
    def share(self) -> float:
        """Weight in the combination, mean over three directions."""
        return float(np.trace(self.weight) / 3.0)


@dataclass(frozen=True)
class Disagreement:
    """Two estimates side by side."""

    first: CentreWay  #: one way
    second: CentreWay  #: the other
    distance: float  #: between their centres [m]
    probability: float  #: probability that noise alone does this


@dataclass(frozen=True, eq=False)
class WristCentre:
    """The wrist centre of the sweeps."""

    estimates: tuple[CentreEstimate, ...]  #: estimates by each way that was possible
    combined: CentreEstimate  #: their weighted mean
    disagreements: tuple[Disagreement, ...]  #: disagreements of each two of them
    miss: WristMiss  #: miss of the axes
    posture: FloatArray  #: (n,) model angles of the arm; those of the wrist, here zero, do not matter [rad]

    def in_base(
        self, estimate: CentreEstimate, base: BaseFrame, identified: IdentifiedAxes
    ) -> tuple[FloatArray, FloatArray]:
        """A centre (3,) in R0 [m] and its covariance (3, 3), relation of centre and base frame included."""
        T = base.transform_tracker_to_base
        centre = T.apply(estimate.centre)
        through_base = RigidTransform.sensitivity(centre) @ base.jacobian @ identified.influence
        influence = through_base  # may have further columns, of angles at rest
        influence[:, : estimate.influence.shape[1]] += T.rotation @ estimate.influence
        return centre, identified.sigma**2 * influence @ influence.T

    def findings(self) -> tuple[Finding, ...]:
        """Ways that contradict each other beyond noise."""
        return tuple(
            Finding(
                code="wrist_centres_disagree",
                weight="use_with_care",
                where="sweeps",
                message=(
                    f"the wrist centres by {pair.first} and by {pair.second} are "
                    f"{length_text(pair.distance)} "
                    f"apart, more than their uncertainties explain (p = {pair.probability:.1g})"
                ),
                remedy=(
                    "check the sweeps of the wrist joints; axes that do not intersect have no common centre"
                ),
            )
            for pair in self.disagreements
            if pair.probability < DISAGREEMENT
        )


def find_wrist_centre(identified: SweptAxes) -> WristCentre:
    """Find the wrist centre by each way that the sweeps allow.

    Args:
        identified: at least three axes.

    Raises:
        MeasurementError: fewer than three axes, or the last three are nearly parallel.
    """
    if identified.n < WRIST_JOINTS:
        raise MeasurementError(
            f"a robot with {identified.n} axes has no three-axis wrist",
            where="sweeps",
            remedy="sweep all joints of the robot",
        )
    # Model angles (n,) in the last axis's sweep, those of the wrist set to zero
    sweeps = identified.sweeps
    last = next(s for s in sweeps.sweeps if min(sweeps.turning(s)) == identified.n - 1)
    posture: FloatArray = sweeps.model_angles(last).mean(axis=0)
    posture[-WRIST_JOINTS:] = 0.0
    by_axes, miss = nearest_to_axes(identified, posture)
    ways: list[tuple[CentreWay, FloatArray, FloatArray]] = [("axes", *by_axes)]
    arm = slice(0, identified.n - WRIST_JOINTS)
    away = [np.abs(sweeps.model_angles(sweep)[:, arm] - posture[arm]) for sweep in sweeps.sweeps]
    at_rest = [index for index, angles in enumerate(away) if angles.max(initial=0.0) <= STILL]
    sphere = fit_spheres(identified, at_rest)  # by the sweeps that leave the arm where the last one has it
    if sphere is not None:
        ways.append(("sphere", sphere.centre, sphere.influence[:3]))
        trilaterated = _by_trilateration(identified, sphere, by_axes[0])
        if trilaterated is not None:
            ways.append(("trilateration", *trilaterated))
    covariances = [identified.sigma**2 * influence @ influence.T for _, _, influence in ways]
    informations = [np.linalg.inv(covariance) for covariance in covariances]
    mean = np.linalg.inv(np.sum(informations, axis=0))
    estimates = tuple(
        CentreEstimate(way, centre, covariance, influence, mean @ information)
        for (way, centre, influence), covariance, information in zip(
            ways, covariances, informations, strict=True
        )
    )
    centre = np.sum([estimate.weight @ estimate.centre for estimate in estimates], axis=0)
    influence = np.sum([estimate.weight @ estimate.influence for estimate in estimates], axis=0)
    covariance = identified.sigma**2 * influence @ influence.T
    combined = CentreEstimate("combined", centre, covariance, influence, np.eye(3))
    disagreements = []
    for first, second in combinations(estimates, 2):
        gap = first.centre - second.centre
        difference = identified.sigma * (first.influence - second.influence)
        U, singular, _ = np.linalg.svd(difference, full_matrices=False)
        seen = singular > 1e-6 * max(singular[0], 1e-300)
        statistic = float(np.sum(((U.T @ gap)[seen] / singular[seen]) ** 2))
        probability = float(special.chdtrc(int(seen.sum()), statistic))
        disagreements.append(Disagreement(first.way, second.way, float(np.linalg.norm(gap)), probability))
    return WristCentre(estimates, combined, tuple(disagreements), miss, posture)


def _by_trilateration(
    identified: SweptAxes, sphere: SphereFit, near: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Weighted mean over all positions with the three targets, and its influence."""
    readings = sphere.readings
    read = np.flatnonzero(readings.present.any(axis=0)).tolist()
    triples = [list(three) for three in combinations(read, 3)]
    sides = [identified.targets[three[1:]] - identified.targets[three[0]] for three in triples]
    areas = [float(np.linalg.norm(np.cross(first, second))) for first, second in sides]
    if not max(areas, default=0.0) > 0.0:
        return None
    chosen = triples[int(np.argmax(areas))]  # they span the largest triangle
    total, centre, influence = np.zeros((3, 3)), np.zeros(3), np.zeros_like(sphere.influence[:3])
    radii = sphere.radii[chosen]
    by_radius = sphere.influence[[3 + t for t in chosen]]
    for k in np.flatnonzero(readings.present[:, chosen].all(axis=1)):
        factors = readings.factors[k, chosen]
        try:
            found = trilaterate(readings.points[k, chosen], radii, near)
        except MeasurementError:
            continue
        row = found.by_distance @ by_radius
        by_reading = np.einsum("itj,tjk->itk", found.by_target, factors)
        row[:, readings.columns[k, chosen].ravel()] += by_reading.reshape(3, -1)
        covariances = factors @ np.swapaxes(factors, -1, -2)
        weight = np.linalg.inv(found.covariance(covariances, by_radius @ by_radius.T))
        total += weight
        centre += weight @ found.centre
        influence += weight @ row
    if not total.any():
        return None
    mean = np.linalg.inv(total)
    return mean @ centre, mean @ influence
