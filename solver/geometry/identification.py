"""Identify the geometry of a robot from sweeps or unloaded poses: one call from readings to a robot.

Every number comes with its uncertainty and every suspicion with its figure; nothing is corrected silently.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.geometry.result import IdentifiedAxis, SweepEvidence
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import InputError, MeasurementError
from jointstiff.solver.geometry.findings import (
    agreement_findings,
    calibration_findings,
    drift_findings,
    geometry_findings,
    model_findings,
    wrist_findings,
)
from jointstiff.solver.geometry.frames import (
    BaseDrift,
    BaseFrame,
    BaseTargets,
    WristCentre,
    find_base_frame,
    find_wrist_centre,
    place_axes,
)
from jointstiff.solver.geometry.model import (
    DhTable,
    FlangeConvention,
    IdentifiedModel,
    LinkParameter,
    dh_table,
    identify_model,
    link_table,
)
from jointstiff.solver.geometry.poses import IdentifiedAxes, Poses, calibrate
from jointstiff.solver.geometry.sweeps import (
    DISAGREEMENT,
    UNEVEN,
    AngleUse,
    SweepSet,
    SweptAxes,
    angle_probability,
    identify_axes,
    refine_axes,
    resting_angles,
)
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.robot.configuration import WRIST_JOINTS

SweepFit = Literal["one_by_one", "together"]

LEAST_SIGMA = 1e-12
"""Smallest standard uncertainty of a coordinate [m]; with less, covariances vanish."""


@dataclass(frozen=True)
class Conventions:
    """Conventions for R0 and the flange frame, which no axis determines."""

    base: Literal["nominal", "axes"]  #: see `find_base_frame`
    flange: Literal["nominal", "axes", "targets"]  #: see `FlangeConvention`
    height: float = 0.0  #: for `axes`, of the foot of the common perpendicular of axes 1 and 2 above R0 [m]
    flange_targets: tuple[int, int, int] = (0, 1, 2)  #: for `targets`, indices of the three


@dataclass(frozen=True, eq=False)
class IdentifiedGeometry:
    """A robot as it was found."""

    identified: IdentifiedAxes  #: axes and targets
    sigma_source: Literal["stated", "residuals"]  #: origin of sigma
    conventions: Conventions  #: conventions by which the frames are placed
    base: BaseFrame  #: placement of R0
    model: IdentifiedModel  #: the robot
    links: tuple[LinkParameter, ...]  #: beside those of the nominal model; empty without one
    wrist: WristCentre | str  #: wrist centre, or the reason why there is none
    tables: tuple[DhTable, ...]  #: the model as a standard and as a modified DH table
    drift: BaseDrift | None  #: drift of the base; None if its targets were not read twice
    findings: tuple[Finding, ...]  #: findings for the user
    one_by_one: SweptAxes | None = None  #: axes of each sweep by itself, with the fits; None for poses
    #: which axes are the result's: where the sweeps disagree those one by one, whatever was asked for; None
    #: for poses
    fit: SweepFit | None = None
    #: p-value of the controller's angles: that noise alone makes them fit as badly as they do; None for poses
    controller_probability: float | None = None
    #: p-value of one robot for all sweeps; None if that was not tested
    agreement_probability: float | None = None

    @cached_property
    def axes(self) -> list[IdentifiedAxis]:
        """The axes in the tracker's frame and in R0."""
        return place_axes(self.identified, self.base, self.model.chain.joint_names)

    @property
    def sweeps(self) -> list[SweepEvidence]:
        """Evidence of each sweep by itself; empty for poses."""
        swept, joints = self.one_by_one, self.model.chain.joint_names
        if swept is None:
            return []
        return [
            SweepEvidence(
                joint=fit.sweep.name,
                turned=[joints[index] for index in swept.sweeps.turning(fit.sweep)],
                positions=len(fit.sweep),
                arc=fit.arc,
                targets=fit.targets(swept.names),
                angle_scale=fit.angle_scale,
                angle_deviation=float(np.sqrt(np.mean(fit.angle_deviation**2)))
                if fit.angle_deviation.any()
                else None,
                variance_factor=fit.variance_factor,
            )
            for fit in swept.fits
        ]

    @property
    def base_covariance(self) -> FloatArray | None:
        """(6, 6) of the transform from tracker to base [m, rad]; None if it is not determined."""
        known = np.isfinite(self.identified.standard_uncertainties(self.base.jacobian)).all()
        return self.base.transform_tracker_to_base.covariance if known else None

    @property
    def target_covariances(self) -> FloatArray:
        """(T, 3, 3) of the targets in the flange frame [m²]; NaN where not determined."""
        count = len(self.identified.names)
        blocks = self.model.targets_covariance.reshape(count, 3, count, 3)
        return np.stack([blocks[t, :, t] for t in range(count)])


def identify_from_sweeps(
    sweeps: SweepSet,
    conventions: Conventions,
    *,
    nominal: KinematicChain | None = None,
    name: str = "identified",
    fit: SweepFit = "together",
    angles: AngleUse = "free",
    base_targets: BaseTargets | None = None,
) -> IdentifiedGeometry:
    """Identify a robot from its sweeps.

    Args:
        sweeps: one of each joint.
        conventions: where R0 and the flange frame are.
        nominal: model of the robot; needed where a convention is by it.
        name: of the identified robot.
        fit: `one_by_one` asks least of the controller's repeatability; see `refine_axes`. Where the sweeps
            disagree, `together` falls back to it with a finding. Where gears are uneven, uncertainties
            include those of the angles at rest; see `resting_angles`.
        angles: see `fit_axis`.
        base_targets: read before and after.

    Raises:
        InputError: the sweeps do not determine the robot, or contradict the nominal model.
    """
    free, trusted = identify_axes(sweeps), identify_axes(sweeps, angles="controller")
    alone = free if angles == "free" else trusted
    controller, agreement = angle_probability(free, trusted), None
    chosen = together = alone
    if fit == "together" and len(sweeps.sweeps) > 1:
        together = refine_axes(alone, angles=angles)
        agreement = angle_probability(alone, together)
        chosen = alone if agreement < DISAGREEMENT else together
    _refuse_exact(chosen)
    wrist_axes = identified = chosen
    if controller < UNEVEN:
        columns, joints = resting_angles(free)
        identified = _widened(chosen, columns)
        # The wrist centre is where the arm had it, whatever the arm's angles
        of_wrist = np.array(joints, dtype=int) >= sweeps.joint_map.n - WRIST_JOINTS
        wrist_axes = _widened(chosen, columns[:, of_wrist])
    geometry = _identified_geometry(
        identified,
        conventions,
        nominal,
        name,
        wrist=_wrist(wrist_axes),
        findings=(*geometry_findings(alone, together), *agreement_findings(agreement)),
        base_targets=base_targets,
    )
    return replace(
        geometry,
        sigma_source="residuals" if sweeps.sigma is None else "stated",
        one_by_one=alone,
        fit="one_by_one" if chosen is alone else "together",
        controller_probability=controller,
        agreement_probability=agreement,
    )


def identify_from_poses(
    poses: Poses,
    conventions: Conventions,
    *,
    nominal: KinematicChain,
    name: str = "identified",
    base_targets: BaseTargets | None = None,
) -> IdentifiedGeometry:
    """Identify a robot from unloaded poses, starting from a nominal model; see `identify_from_sweeps`.

    Raises:
        InputError: the poses contradict the nominal model, or have too little in them.
        NotObservableError: fewer readings than unknowns.
    """
    identified = calibrate(nominal, poses)
    _refuse_exact(identified)
    geometry = _identified_geometry(
        identified,
        conventions,
        nominal,
        name,
        wrist="the poses do not determine all axes" if identified.unseen.size else _wrist(identified),
        findings=calibration_findings(identified),
        base_targets=base_targets,
    )
    stated = poses.sigma is not None and identified.exceeded_sigma is None
    return replace(geometry, sigma_source="stated" if stated else "residuals")


def _identified_geometry(
    identified: IdentifiedAxes,
    conventions: Conventions,
    nominal: KinematicChain | None,
    name: str,
    *,
    wrist: WristCentre | str,
    findings: Iterable[Finding],
    base_targets: BaseTargets | None,
) -> IdentifiedGeometry:
    flange = FlangeConvention(conventions.flange_targets if conventions.flange == "targets" else None)
    if "nominal" in {conventions.base, conventions.flange} and nominal is None:
        raise MeasurementError(
            "the base or flange frame is requested by the nominal model, but there is no nominal model",
            where="base.by" if conventions.base == "nominal" else "flange.by",
            remedy="give the robot's nominal model, or define the frame by `axes`",
        )
    if conventions.flange == "nominal" and nominal is not None:
        flange = FlangeConvention.of_chain(nominal)
    placing = nominal if conventions.base == "nominal" else None
    base = find_base_frame(identified, placing, height=conventions.height)
    model = identify_model(identified, base, flange, nominal=nominal, name=name)
    drift = None
    if base_targets is not None:
        drift = base_targets.drift(identified.sigma, identified.targets.mean(axis=0))
    tables = (dh_table(model.chain, "standard"), dh_table(model.chain, "modified"))
    links = () if nominal is None else link_table(identified, base, flange, nominal)
    return IdentifiedGeometry(
        identified=identified,
        sigma_source="stated",
        conventions=conventions,
        base=base,
        model=model,
        links=links,
        wrist=wrist,
        tables=tables,
        drift=drift,
        findings=(
            *findings,
            *(wrist_findings(wrist) if isinstance(wrist, WristCentre) else ()),
            *(drift_findings(drift) if drift else ()),
            *model_findings(tables[0], links),
        ),
    )


def _widened(identified: SweptAxes, columns: FloatArray) -> SweptAxes:
    """Return axes whose uncertainties include further, independent displacements (4 n + 3 T, G)."""
    return replace(
        identified,
        covariance=identified.covariance + columns @ columns.T,
        influence=np.hstack([identified.influence, columns / identified.sigma]),
    )


def _refuse_exact(identified: IdentifiedAxes) -> None:
    if not identified.sigma > LEAST_SIGMA:
        raise MeasurementError(
            f"the residuals give sigma = {identified.sigma:.1g} m, which no tracker reaches",
            where="noise.sigma",
            remedy="state sigma if the readings are simulated without noise",
        )


def _wrist(identified: IdentifiedAxes) -> WristCentre | str:
    """Return the wrist centre, or the reason why there is none."""
    try:
        return find_wrist_centre(identified)
    except InputError as error:
        return error.reason
    except np.linalg.LinAlgError:
        return "its uncertainty is too large"
