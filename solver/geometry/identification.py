"""Identify the geometry of a robot from sweeps or unloaded poses: one call from readings to a robot.

Every number comes with its uncertainty and every suspicion with its figure; nothing is corrected silently.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jointstiff.schemas import geometry as results
from jointstiff.schemas.finding import Assessment, Finding, combined
from jointstiff.schemas.geometry import IdentifiedAxis, IdentifiedDh, LinkComparison, SweepEvidence
from jointstiff.schemas.robot import JointMap as StoredJointMap
from jointstiff.schemas.robot import RobotDocument, UrdfModel
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
    CentreEstimate,
    WristCentre,
    find_base_frame,
    find_wrist_centre,
    place_axes,
)
from jointstiff.solver.geometry.model import (
    FlangeConvention,
    IdentifiedModel,
    dh_table,
    identify_model,
    link_table,
)
from jointstiff.solver.geometry.poses import CalibratedAxes, IdentifiedAxes, Poses, calibrate
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
from jointstiff.solver.messages import message, rows
from jointstiff.solver.robot.configuration import WRIST_JOINTS
from jointstiff.solver.robot.model import JointMap, KinematicChain
from jointstiff.solver.robot.urdf import write_urdf

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
    axes: list[IdentifiedAxis]  #: axes in the tracker's frame and in R0
    model: IdentifiedModel  #: the robot
    links: list[LinkComparison]  #: beside those of the nominal model; empty without one
    wrist: WristCentre | str  #: wrist centre, or the reason why there is none
    tables: tuple[IdentifiedDh, ...]  #: the model as a standard and as a modified DH table
    drift: BaseDrift | None  #: drift of the base; None if its targets were not read twice
    findings: tuple[Finding, ...]  #: findings for the user
    sweeps: Sequence[SweepEvidence] = ()  #: evidence of each sweep by itself; none for poses
    #: which axes are the result's: where the sweeps disagree those one by one, whatever was asked for; None
    #: for poses
    fit: SweepFit | None = None
    #: p-value of the controller's angles: that noise alone makes them fit as badly as they do; None for poses
    controller_probability: float | None = None
    #: p-value of one robot for all sweeps; None if that was not tested
    agreement_probability: float | None = None

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

    def result(self, name: str, joint_map: JointMap) -> results.GeometryResult:
        """Return what was found, with a robot of that name and joint map."""
        identified, wrist = self.identified, self.wrist
        reasons = [finding for finding in self.findings if finding.weight != "use"]
        return message(
            results.GeometryResult,
            self,
            joint_kinds={},
            assessment=combined([Assessment(verdict=each.weight, reasons=[each]) for each in reasons]),
            poses=identified.evidence if isinstance(identified, CalibratedAxes) else None,
            goodness=message(
                results.GeometryGoodness,
                self,
                sigma=identified.sigma,
                variance_factor=identified.variance_factor,
                degrees_of_freedom=identified.dof,
            ),
            base_frame=message(
                results.BaseFrameResult,
                self.base,
                by=self.conventions.base,
                covariance=self.base_covariance,
            ),
            wrist=self._wrist_result(wrist) if isinstance(wrist, WristCentre) else None,
            no_wrist=None if isinstance(wrist, WristCentre) else wrist,
            targets=rows(
                results.FlangeTarget,
                name=identified.names,
                position=self.model.targets_in_flange,
                covariance=self.target_covariances,
            ),
            flange=self.conventions.flange,
            robot=self._robot(name, joint_map),
            dh=self.tables,
        )

    def _wrist_result(self, wrist: WristCentre) -> results.WristResult:
        def centre(estimate: CentreEstimate) -> dict[str, object]:
            in_base, covariance = wrist.in_base(estimate, self.base, self.identified)
            tracker = {"tracker": estimate.centre, "tracker_covariance": estimate.covariance}
            return {**tracker, "base": in_base, "base_covariance": covariance}

        return message(
            results.WristResult,
            wrist,
            estimates=[message(results.WristEstimate, way, **centre(way)) for way in wrist.estimates],
            combined=message(results.WristCentre, wrist.combined, **centre(wrist.combined)),
        )

    def _robot(self, name: str, joint_map: JointMap) -> RobotDocument:
        chain = self.model.chain
        model = UrdfModel(format="urdf", urdf=write_urdf(chain), base=chain.base, flange=chain.flange)
        plain = np.array_equal(joint_map.matrix, np.eye(joint_map.n)) and not joint_map.offset.any()
        stored = None if plain else message(StoredJointMap, joint_map)
        return RobotDocument(name=name, model=model, joint_map=stored)


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
        wrist_axes=wrist_axes,
        sigma_source="residuals" if sweeps.sigma is None else "stated",
        findings=(*geometry_findings(alone, together), *agreement_findings(agreement)),
        base_targets=base_targets,
    )
    evidence = [
        SweepEvidence(
            joint=one.sweep.name,
            turned=[geometry.axes[index].name for index in sweeps.turning(one.sweep)],
            positions=len(one.sweep),
            arc=one.arc,
            targets=one.targets(sweeps.targets),
            angle_scale=one.angle_scale,
            angle_deviation=np.sqrt(np.mean(one.angle_deviation**2)) if one.angle_deviation.any() else None,
            variance_factor=one.variance_factor,
        )
        for one in alone.fits
    ]
    return replace(
        geometry,
        sweeps=evidence,
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
    stated = poses.sigma is not None and identified.exceeded_sigma is None
    return _identified_geometry(
        identified,
        conventions,
        nominal,
        name,
        wrist_axes=identified,
        sigma_source="stated" if stated else "residuals",
        findings=calibration_findings(identified),
        base_targets=base_targets,
    )


def _identified_geometry(
    identified: IdentifiedAxes,
    conventions: Conventions,
    nominal: KinematicChain | None,
    name: str,
    *,
    wrist_axes: IdentifiedAxes,
    sigma_source: Literal["stated", "residuals"],
    findings: Iterable[Finding],
    base_targets: BaseTargets | None,
) -> IdentifiedGeometry:
    flange = FlangeConvention(conventions.flange_targets if conventions.flange == "targets" else None)
    if conventions.flange == "nominal" and nominal is not None:
        flange = FlangeConvention.of_chain(nominal)
    placing = nominal if conventions.base == "nominal" else None
    base = find_base_frame(identified, placing, height=conventions.height)
    model = identify_model(identified, base, flange, nominal=nominal, name=name)
    # The wrist centre, or the reason why there is none
    wrist: WristCentre | str = "the poses do not determine all axes"
    if not wrist_axes.unseen.size:
        try:
            wrist = find_wrist_centre(wrist_axes)
        except InputError as error:
            wrist = error.reason
        except np.linalg.LinAlgError:
            wrist = "its uncertainty is too large"
    drift = None
    if base_targets is not None:
        drift = base_targets.drift(identified.sigma, identified.targets.mean(axis=0))
    tables = (dh_table(model.chain, "standard"), dh_table(model.chain, "modified"))
    links = [] if nominal is None else link_table(identified, base, flange, nominal)
    return IdentifiedGeometry(
        identified=identified,
        sigma_source=sigma_source,
        conventions=conventions,
        base=base,
        axes=place_axes(identified, base, model.chain.joint_names),
        model=model,
        links=links,
        wrist=wrist,
        tables=tables,
        drift=drift,
        findings=(
            *findings,
            *(wrist_findings(wrist) if isinstance(wrist, WristCentre) else ()),
            *(drift_findings(drift) if drift else ()),
            *model_findings(model.chain.joint_names, tables[0], links),
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
