"""Use of a stored run: what its verdict refuses, its model, and the verdict on what is made of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from math import hypot, isfinite
from typing import Final

import numpy as np

from jointstiff.schemas.deflection import LinkMass
from jointstiff.schemas.finding import Assessment, Finding, FindingCode, Verdict, combined
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.run import Run, RunResult
from jointstiff.service.conversion.units import FORCE, MOMENT
from jointstiff.service.problems import VerdictError
from jointstiff.service.resources.inputs import Inputs, MeasuredRun
from jointstiff.service.tables.report import counted, support
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.block import OwnWeight
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.answers import build_forward_model
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.predict.models import IdentifiedWeight, JointModel, ModelError
from jointstiff.solver.text import figure


def accepted_run(inputs: Inputs, run_id: str, accept_verdict: str | None) -> MeasuredRun:
    """Return the run that a request names, with its measurement set.

    Raises:
        RequestError: there is no such run.
        VerdictError: the run is not to be used, and the request does not accept that.
    """
    run = inputs.run(run_id, "run_id")
    if run.run.result is not None:
        refuse_unaccepted(run.run.result.assessment, accept_verdict, f"run '{run.run.id}'")
    return run


def refuse_unaccepted(
    assessment: Assessment,
    accept_verdict: str | None,
    subject: str,
    where: str = "run_id",
    *,
    passed_over: Collection[str] = (),
) -> None:
    """Refuse a result that is not to be used, unless the request accepts its verdict.

    Args:
        assessment: of the result.
        accept_verdict: verdict that the request accepts.
        subject: name of the result in the message.
        where: field of the request that names the result.
        passed_over: codes of reasons that do not count.

    Raises:
        VerdictError: the result is refused; the error lists the reasons.
    """
    reasons = [
        (reason.where or "all readings", reason.message, reason.remedy)
        for reason in assessment.reasons
        if reason.weight == "do_not_use" and reason.code not in passed_over
    ]
    if reasons and accept_verdict != assessment.verdict:
        raise VerdictError.of(subject, where, reasons)


def result_of(run: Run) -> RunResult:
    """Return the result of a run.

    Raises:
        RequestError: the run has no result.
    """
    if run.result is None:
        raise RequestError(
            f"run '{run.id}' has {run.state} and has no model",
            where="run_id",
            remedy="give the id of a succeeded run",
        )
    return run.result


@dataclass(frozen=True, eq=False)
class RunModel:
    """The model of a run, which predicts the loaded robot."""

    run: Run
    result: RunResult
    model: ForwardModel
    error: ModelError | None  # None where no posture could be omitted

    @classmethod
    def of(
        cls,
        robot: Robot,
        run: Run,
        *,
        absolute: bool = False,
        masses: Sequence[LinkMass] = (),
        length: float = 1.0,
    ) -> RunModel:
        """Return the model of a run of this robot, with own weight if `absolute` or `masses` request it.

        Args:
            robot: robot of n joints.
            run: run that identified this robot.
            absolute: whether predictions include the sag by the own weight that the run identified.
            masses: masses of the links; without any, own weight is left out.
            length: metres in one unit of the masses' centres (0.001 for mm).

        Raises:
            RequestError: the run has no model or is of another robot, or the own weight does not fit it.
        """
        result = result_of(run)
        weight = _choose_own_weight(robot, run, absolute, masses, length)
        if result.model is None:
            raise RequestError(
                f"run '{run.id}' has no model", where="run_id", remedy="choose a run that determines a joint"
            )
        model, error = build_forward_model(robot, result.model, weight)
        if weight is not None and model.first_order:
            raise RequestError(
                f"run '{run.id}' has elastic links or coupling, which do not support own weight",
                where="masses",
                remedy="omit masses, or choose a run with elasticity joints",
            )
        return cls(run, result, model, error)

    @property
    def postures(self) -> int:
        """Number of postures that the bound of the model error is based on."""
        return 0 if self.error is None else self.error.postures

    def remarks(self, confidence: float) -> list[str]:
        """Return remarks on all predictions: effects left out of the model, and why errors have no bound."""
        remarks = []
        if not isinstance(self.model, JointModel):
            remarks.append(
                "to first order in the load: links and joints bend linearly, own weight and complementary "
                "stiffness are left out"
            )
        else:
            if self.model.weight is None:
                by_loads = self.run.request.weight is None
                why = "no masses are given" if by_loads else "`absolute` is not requested"
                remarks.append(f"own weight is not included, because {why}")
            elif self.model.weight.absolute:
                remarks.append(
                    "absolute: relative to an arm that does not bend, so sag by own weight is included"
                )
            if self.run.request.complementary_stiffness == "neglected" and self.run.request.weight is None:
                remarks.append(
                    "the run neglects the complementary stiffness K_c, which the prediction includes: "
                    "identify with complementary_stiffness included"
                )
        level = f"no bound of the model error at {100 * confidence:g} %"
        if self.error is None:
            reason = self.result.model.no_error if self.result.model else None
            remarks.append(f"no bound of the model error: {reason or 'no posture could be omitted'}")
        elif self.error.postures < (needed := self.error.count_needed_postures(confidence)):
            remarks.append(f"{level}: {needed} postures are needed, and there are {self.error.postures}")
        elif np.isinf(self.error.quantile(confidence)):
            remarks.append(f"{level}: too many postures are needed to determine a joint")
        return remarks


def _choose_own_weight(
    robot: Robot, run: Run, absolute: bool, masses: Sequence[LinkMass], length: float
) -> OwnWeight | None:
    """Return the own weight that a run identified, if `absolute`, else that of the stated masses, or None."""
    if absolute:
        model = None if run.result is None else run.result.model
        if model is None or model.weight is None or masses:
            raise RequestError(
                f"`absolute` uses the own weight of run '{run.id}': it has none, or masses are given, too",
                where="absolute",
                remedy="choose a run with `weight` and without balancers, and leave `masses` out",
            )
        found = model.weight
        mass, centre, gravity, root = map(
            np.array, (found.mass, found.centre, found.gravity, found.covariance_root)
        )
        return IdentifiedWeight(mass, centre, gravity, root=root)
    if not masses:
        return None
    mass, centre = np.zeros(robot.n), np.zeros((robot.n, 3))
    for i, link in enumerate(masses):
        j = robot.joint_index(link.joint, f"masses[{i}].joint")
        if link.joint in (other.joint for other in masses[:i]):
            raise RequestError(
                f"joint '{link.joint}' is given two masses",
                where=f"masses[{i}].joint",
                remedy="give each joint one mass, at the common centre of what it carries",
            )
        mass[j], centre[j] = link.mass, length * np.array(link.centre)
    return OwnWeight(mass, centre)


def moment_factor(units: Units, moments: FloatArray) -> float:
    """Return the factor from the unit of moments of a request to N·m.

    Raises:
        RequestError: there are moments, and their unit is neither stated nor implied by lengths in m.
    """
    if units.moment is not None:
        return MOMENT[units.moment]
    if units.length == "m" or not moments.any():
        return FORCE[units.force]
    raise RequestError(
        "a load has a moment, whose unit is not clear when lengths are in mm",
        where="units.moment",
        remedy=f"state units.moment, one of {', '.join(MOMENT)}",
    )


LARGEST_DEFLECTION: Final = 0.02
"""Deflection of an arm beyond which a load or a length is in another unit [m]."""
LARGEST_RATIO: Final = 20.0
"""Deflection relative to the campaign's greatest, beyond which a load or a length is in another unit."""
LONGEST_TOOL: Final = 1.5
"""Distance of a load point or a place from the flange that is usual [m]."""
_SUBJECT: Final[dict[Verdict, str]] = {
    "use": "Use this {}",
    "use_with_care": "Use this {} with care",
    "do_not_use": "Do not use this {}",
}


def own_reason(code: FindingCode, weight: Verdict, message: str, remedy: str) -> Finding:
    """Return a reason that concerns a result itself rather than the run behind it."""
    return Finding(code=code, weight=weight, message=message, remedy=remedy)


def judged(subject: str, reasons: Sequence[Finding], run: Assessment | None) -> Assessment:
    """Return the worse verdict of a result and of its run, with the reasons of both and a headline.

    Args:
        subject: name of the result in the headline, such as `map`.
        reasons: reasons of the result itself.
        run: assessment of the run or runs behind the result; None without a run.
    """
    worst: Verdict = max((each.weight for each in reasons), key=list(_SUBJECT).index, default="use")
    own = Assessment(verdict=worst, reasons=list(reasons))
    whole = combined([own] if run is None else [own, run])
    parts = [f"{counted(len(reasons), 'reason')} of its own"] if reasons else []
    if run is not None and run.reasons:
        parts.append(f"{counted(len(run.reasons), 'reason')} of its run")
    if not parts:
        passed = "" if run is None else f"; {support(run, ' of its run')}"
        parts = [f"nothing speaks against it{passed}"]
    headline = f"{_SUBJECT[whole.verdict].format(subject)}: {', '.join(parts)}"
    return whole.model_copy(update={"headline": headline})


def of_deflection(greatest: float | None, run: RunResult) -> list[Finding]:
    """Return a reason if the greatest deflection [m] is too large for an arm, or for this campaign."""
    if greatest is None or not isfinite(greatest):
        return []
    measured = max((hypot(*each.deflection) for each in run.residuals), default=0.0)
    ratio = greatest / measured if measured > 0.0 else 0.0
    if greatest <= LARGEST_DEFLECTION and ratio <= LARGEST_RATIO:
        return []
    compared = f", {figure(ratio, '.3g')} times the greatest of the campaign" if ratio > 1.0 else ""
    return [
        own_reason(
            "prediction_implausible",
            "do_not_use",
            f"the greatest deflection is {1e3 * greatest:.4g} mm{compared}",
            "check the units of the load and of the points (N or kN, m or mm)",
        )
    ]


def of_points(points: Iterable[Sequence[float] | None]) -> list[Finding]:
    """Return a reason if a point on the tool [m, flange frame] is unusually far from the flange."""
    far = max((hypot(*point) for point in points if point is not None), default=0.0)
    if far <= LONGEST_TOOL:
        return []
    message = f"the load point or the place is {far:.3g} m from the flange"
    return [own_reason("point_implausible", "use_with_care", message, "check its unit and its frame")]


def of_campaign(count: int, total: int, what: str) -> list[Finding]:
    """Return a reason if loads or postures of `count` of `total` cases are beyond those of the campaign."""
    if not count:
        return []
    message = f"{count} of {total} {what} have loads or postures beyond those of the campaign"
    remedy = "measure with such loads and postures"
    return [own_reason("beyond_campaign", "use_with_care", message, remedy)]


def of_missing(count: int, total: int, what: str, *, unseen: bool = True) -> list[Finding]:
    """Return a reason if `count` of `total` cases have no number; `unseen`: for want of determined joints."""
    if not count:
        return []
    weight: Verdict = "do_not_use" if count == total else "use_with_care"
    share = f"none of the {total}" if count == total else f"{total - count} of {total}"
    message = f"{share} {what} {'have' if total != 1 else 'has'} a number"
    measure = "measure what twists the joints without a number, or " if unseen else ""
    remedy = f"read why each one lacks a number; {measure}move the places"
    return [own_reason("numbers_missing", weight, message, remedy)]
