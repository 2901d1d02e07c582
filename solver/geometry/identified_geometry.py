"""A robot as sweeps or poses show it, with the conventions that place its frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.frames.base_drift import BaseDrift, find_drift
from jointstiff.solver.geometry.frames.base_frame import BaseFrame, PlacedAxis, place_axes
from jointstiff.solver.geometry.frames.wrist_centre import WristCentre
from jointstiff.solver.geometry.model.identified_model import IdentifiedModel, LinkParameter
from jointstiff.solver.geometry.model.link_parameters import DhTable
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes
from jointstiff.solver.geometry.sweeps.swept_axes import SweepEvidence, SweptAxes


@dataclass(frozen=True)
class Conventions:
    """Conventions for R0 and the flange frame, which no axis determines."""

    #: `nominal`, as in the nominal model; `axes`, as in `BaseConvention.of_axes`
    base: Literal["nominal", "axes"]
    flange: Literal["nominal", "axes", "targets"]  #: `nominal`, `axes` or `targets`, as in `FlangeConvention`
    height: float = 0.0  #: for `axes`, of the foot of the common perpendicular of axes 1 and 2 above R0 [m]
    flange_targets: tuple[int, int, int] = (0, 1, 2)  #: for `targets`, indices of the three


@dataclass(frozen=True, eq=False)
class BaseTargets:
    """Targets on the robot's base, read twice."""

    before: FloatArray  #: (B, 3) tracker's frame [m]
    after: FloatArray  #: (B, 3) later
    covariance: FloatArray  #: (3, 3) or (B, 3, 3) of one reading in units of sigma²
    names: tuple[str, ...]  #: (B,) names of the targets

    def drift(self, sigma: float, at: FloatArray) -> BaseDrift:
        """Return the motion between the two readings.

        Args:
            sigma: standard uncertainty of a coordinate [m].
            at: (3,) point whose displacement is of interest [m].

        Raises:
            MeasurementError: the base targets lie on a line.
        """
        return find_drift(
            self.before, self.after, sigma=sigma, at=at, covariance=self.covariance, names=self.names
        )


SweepFit = Literal["one_by_one", "together"]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Statistics of the fit of the sweeps."""

    one_by_one: SweptAxes  #: the axes of each sweep by itself, with the fits
    #: which axes are the result's: where the sweeps disagree those one by one, whatever was asked for
    fit: SweepFit
    controller_probability: float  #: that noise alone makes the controller's angles fit as badly as they do
    #: that noise alone makes one robot fit all sweeps as badly as it does; None if they were fitted one by
    #: one
    agreement_probability: float | None


@dataclass(frozen=True, eq=False)
class IdentifiedGeometry:
    """A robot as it was found."""

    identified: IdentifiedAxes  #: axes and targets
    sigma_stated: bool  #: whether its sigma was stated; it comes from the residuals if not
    conventions: Conventions  #: conventions by which the frames are placed
    evidence: Evidence | None  #: evidence of sweeps; None for poses
    base: BaseFrame  #: placement of R0
    model: IdentifiedModel  #: the robot
    links: tuple[LinkParameter, ...]  #: beside those of the nominal model; empty without one
    wrist: WristCentre | str  #: wrist centre, or the reason why there is none
    tables: tuple[DhTable, ...]  #: the model as a standard and as a modified DH table
    drift: BaseDrift | None  #: drift of the base; None if its targets were not read twice
    findings: tuple[Finding, ...]  #: findings for the user

    @cached_property
    def axes(self) -> tuple[PlacedAxis, ...]:
        """The axes in the tracker's frame and in R0."""
        return place_axes(self.identified, self.base, self.model.chain.joint_names)

    @property
    def sweeps(self) -> tuple[SweepEvidence, ...]:
        """Evidence of each sweep by itself; empty for poses."""
        if self.evidence is None:
            return ()
        return self.evidence.one_by_one.evidence(self.model.chain.joint_names)

    @property
    def base_covariance(self) -> FloatArray | None:
        """(6, 6) of the transform from tracker to base [m, rad]; None if it is not determined."""
        known = np.isfinite(self.identified.standard_uncertainties(self.base.jacobian)).all()
        return self.base.transform_tracker_to_base.covariance if known else None

    @property
    def target_covariances(self) -> FloatArray:
        """(T, 3, 3) of the targets in the flange frame [m²]; NaN where not determined."""
        count = len(self.model.target_names)
        blocks = self.model.targets_covariance.reshape(count, 3, count, 3)
        own = np.stack([blocks[t, :, t] for t in range(count)])
        return np.where(self.model.targets_determined[:, None, None], own, np.nan)

    @property
    def sigma(self) -> float:
        """Standard uncertainty of a coordinate [m], stated or from the residuals."""
        return self.identified.sigma

    @property
    def sigma_source(self) -> Literal["stated", "residuals"]:
        """Origin of sigma."""
        return "stated" if self.sigma_stated else "residuals"

    @property
    def variance_factor(self) -> float:
        """χ²/dof: 1 on average if the stated sigma is right; 1 if it comes from the residuals."""
        return self.identified.variance_factor

    @property
    def fit(self) -> SweepFit | None:
        """Return the fit that gave the axes; None for poses."""
        return None if self.evidence is None else self.evidence.fit

    @property
    def agreement_probability(self) -> float | None:
        """Return the p-value of one robot model for all sweeps; None if that was not tested."""
        return None if self.evidence is None else self.evidence.agreement_probability

    @property
    def controller_probability(self) -> float | None:
        """Return the p-value of the controller's angles; None for poses."""
        return None if self.evidence is None else self.evidence.controller_probability
