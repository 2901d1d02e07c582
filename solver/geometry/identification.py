"""Identify the geometry of a robot from sweeps or unloaded poses: one call from readings to a robot.

Every number comes with its uncertainty and every suspicion with its figure; nothing is corrected silently.

The uncertainty of the angles at which joints rest while others turn.

The readings show how far each joint is from the controller's angle while it turns: its gear's error. At
rest it is off by as much, and nothing shows it. Where joints rest at the same angles in all sweeps, that
only turns what model angle zero means; where they do not, it moves the axes against each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import InputError, MeasurementError
from jointstiff.solver.geometry.frames.base_frame import BaseConvention, find_base_frame
from jointstiff.solver.geometry.frames.wrist_centre import (
    CentreEstimate,
    WristCentre,
    find_wrist_centre,
    nearest_to_axes,
)
from jointstiff.solver.geometry.identified_geometry import (
    BaseTargets,
    Conventions,
    Evidence,
    IdentifiedGeometry,
    SweepFit,
)
from jointstiff.solver.geometry.model.identified_model import (
    FlangeConvention,
    identify_model,
    link_findings,
    link_table,
)
from jointstiff.solver.geometry.model.kinematic_calibration import calibrate
from jointstiff.solver.geometry.model.link_parameters import dh_table
from jointstiff.solver.geometry.sweeps.circle_point import AngleUse
from jointstiff.solver.geometry.sweeps.findings import (
    agreement_findings,
    angle_probability,
    disagree,
    geometry_findings,
    uneven,
)
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes
from jointstiff.solver.geometry.sweeps.pose_fit import Poses
from jointstiff.solver.geometry.sweeps.sweep import STILL, SweepSet
from jointstiff.solver.geometry.sweeps.swept_axes import (
    SweptAxes,
    identify_axes,
    influence_of_postures,
    refine_axes,
)
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.robot.configuration import WRIST_JOINTS


def resting_angles(swept: SweptAxes, probability: float, *, first: int = 0) -> FloatArray:
    """Return what gear errors at rest do to axes and targets: (4 n + 3 T, G), one column a standard one.

    Args:
        swept: axes fitted one by one with free angles.
        probability: that the controller's angles fit; if it is not small, gears are even and G is 0.
        first: joint of the controller from which on errors count. Columns go from the last joint inwards, so
            that those of fewer joints are the first of all.
    """
    columns = []
    if uneven(probability):
        matrix, by_posture = swept.sweeps.joint_map.matrix, influence_of_postures(swept)
        turned_from_last = sorted(swept.fits, key=lambda fit: -fit.sweep.joint)
        for fit in (fit for fit in turned_from_last if fit.sweep.joint >= first):
            joint = fit.sweep.joint
            # Standard deviation [rad] of a joint from the controller's angles, beyond the readings' noise
            deviation = fit.angle_deviation
            own = fit.linear.inverse[-(len(deviation) - 1) :]  # of the corrections, in an orthonormal basis
            noise = fit.sigma**2 * float(np.sum(own**2))
            size = float(np.sqrt(max(float(deviation @ deviation) - noise, 0.0) / (len(deviation) - 1)))
            # Masks (n,) of the sweeps, by model joint, in which a controller's joint rests at one angle
            order = [swept.sweeps.sweeps[index] for index in swept.order]
            angles = np.array([sweep.angles[:, joint].mean() for sweep in order])
            others = np.array([sweep.joint != joint for sweep in order])
            ascending = np.sort(angles[others])
            starts = ascending[np.flatnonzero(np.diff(ascending, prepend=-np.inf) > STILL)]
            number = np.searchsorted(starts, angles, side="right")
            for group in [others & (number == index + 1) for index in range(len(starts))]:
                turned = np.where(group[:, None], matrix[:, joint], 0.0)
                columns.append(size * by_posture @ turned.ravel())
    return np.array(columns).T if columns else np.zeros((len(swept.covariance), 0))


def widened(identified: SweptAxes, columns: FloatArray) -> SweptAxes:
    """Return the axes with an uncertainty that includes these columns, beside that of the readings."""
    return replace(
        identified,
        covariance=identified.covariance + columns @ columns.T,
        influence=np.hstack([identified.influence, columns / identified.sigma]),
    )


_DEGENERATE = "its uncertainty is too large"

LEAST_SIGMA = 1e-12
"""Smallest standard uncertainty of a coordinate [m]; with less, covariances vanish."""


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
        angles: see `circle_point`.
        base_targets: read before and after.

    Raises:
        InputError: the sweeps do not determine the robot, or contradict the nominal model.
    """
    free, trusted = identify_axes(sweeps), identify_axes(sweeps, angles="controller")
    alone = free if angles == "free" else trusted
    several = len(sweeps.sweeps) > 1
    together = refine_axes(alone, angles=angles) if fit == "together" and several else None
    agreement = None if together is None else angle_probability(alone, together)
    controller = angle_probability(free, trusted)
    chosen = alone if together is None or disagree(agreement) else together
    _refuse_exact(chosen)
    used: SweepFit = "one_by_one" if chosen is alone else "together"
    evidence = Evidence(alone, used, controller, agreement)
    identified = widened(chosen, resting_angles(free, controller))
    wrist_joints = resting_angles(free, controller, first=sweeps.joint_map.n - WRIST_JOINTS)
    wrist = _wrist_of_sweeps(widened(chosen, wrist_joints))  # where the arm had it, whatever its angles
    findings = geometry_findings(alone, together or alone) + agreement_findings(agreement)
    frame = _Frame(conventions, nominal, name, stated=sweeps.sigma is not None)
    return _identified_geometry(identified, frame, wrist, findings, base_targets, evidence)


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
    wrist = "the poses do not determine all axes" if identified.unseen.size else _wrist_of_axes(identified)
    stated = poses.sigma is not None and not identified.exceeds_stated
    frame = _Frame(conventions, nominal, name, stated=stated)
    return _identified_geometry(identified, frame, wrist, identified.findings(), base_targets)


@dataclass(frozen=True)
class _Frame:
    """Frames that are requested of the result."""

    conventions: Conventions
    nominal: KinematicChain | None
    name: str
    stated: bool


def _identified_geometry(
    identified: IdentifiedAxes,
    frame: _Frame,
    wrist: WristCentre | str,
    findings: Sequence[Finding],
    base_targets: BaseTargets | None,
    evidence: Evidence | None = None,
) -> IdentifiedGeometry:
    conventions, nominal = frame.conventions, frame.nominal
    base = find_base_frame(identified, _base(conventions, identified, nominal))
    flange = _flange(conventions, nominal)
    model = identify_model(identified, base, flange, nominal=nominal, name=frame.name)
    middle = identified.targets.mean(axis=0)
    drift = None if base_targets is None else base_targets.drift(identified.sigma, middle)
    all_findings = [*findings]
    all_findings += wrist.findings() if isinstance(wrist, WristCentre) else ()
    all_findings += drift.findings() if drift else ()
    tables = (dh_table(model.chain, "standard"), dh_table(model.chain, "modified"))
    all_findings += tables[0].findings()
    links = () if nominal is None else link_table(identified, base, flange, nominal)
    all_findings += link_findings(links)
    return IdentifiedGeometry(
        identified=identified,
        sigma_stated=frame.stated,
        conventions=conventions,
        evidence=evidence,
        base=base,
        model=model,
        links=links,
        wrist=wrist,
        tables=tables,
        drift=drift,
        findings=tuple(all_findings),
    )


def _base(
    conventions: Conventions, identified: IdentifiedAxes, nominal: KinematicChain | None
) -> BaseConvention:
    if conventions.base == "axes":
        return BaseConvention.of_axes(identified, conventions.height)
    return BaseConvention.of_chain(_needed(nominal, "base.by"))


def _flange(conventions: Conventions, nominal: KinematicChain | None) -> FlangeConvention:
    if conventions.flange == "targets":
        return FlangeConvention.of_targets(conventions.flange_targets)
    if conventions.flange == "axes":
        return FlangeConvention.of_axes()
    return FlangeConvention.of_chain(_needed(nominal, "flange.by"))


def _needed(nominal: KinematicChain | None, where: str) -> KinematicChain:
    if nominal is None:
        raise MeasurementError(
            "the base or flange frame is requested by the nominal model, but there is no nominal model",
            where=where,
            remedy="give the robot's nominal model, or define the frame by `axes`",
        )
    return nominal


def _refuse_exact(identified: IdentifiedAxes) -> None:
    if not identified.sigma > LEAST_SIGMA:
        raise MeasurementError(
            f"the residuals give sigma = {identified.sigma:.1g} m, which no tracker reaches",
            where="noise.sigma",
            remedy="state sigma if the readings are simulated without noise",
        )


def _wrist_of_sweeps(identified: SweptAxes) -> WristCentre | str:
    try:
        return find_wrist_centre(identified)
    except InputError as error:
        return error.reason
    except np.linalg.LinAlgError:
        return _DEGENERATE


def _wrist_of_axes(identified: IdentifiedAxes) -> WristCentre | str:
    """The nearest point to the last three axes with the arm at model angle zero: there are no spheres."""
    if identified.n < WRIST_JOINTS:
        return f"a robot with {identified.n} axes has no three-axis wrist"
    posture = np.zeros(identified.n)
    try:
        (centre, influence), miss = nearest_to_axes(identified, posture)
    except InputError as error:
        return error.reason
    except np.linalg.LinAlgError:
        return _DEGENERATE
    covariance = identified.sigma**2 * influence @ influence.T
    by_axes = CentreEstimate("axes", centre, covariance, influence, np.eye(3))
    combined = CentreEstimate("combined", centre, covariance, influence, np.eye(3))
    return WristCentre((by_axes,), combined, (), miss, posture)
