"""A stored run in use: refusal of one that is not to be used, its model, and what that leaves out."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from jointstiff.schemas.deflection import DeflectionOptions, MapOptions, MapRequest
from jointstiff.schemas.finding import Assessment
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.program import ProgramOptions, ProgramRequest
from jointstiff.schemas.run import Run, RunResult
from jointstiff.service.conversion.robots import joint_index
from jointstiff.service.conversion.units import FORCE, LENGTH, MOMENT
from jointstiff.service.problems.errors import VerdictError
from jointstiff.service.resources.inputs import Inputs, MeasuredRun
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.predict.answers import forward_model
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.predict.models import IdentifiedWeight, JointModel, ModelError, OwnWeight
from jointstiff.solver.robot.model import Robot


def accepted_run(inputs: Inputs, request: MapRequest | ProgramRequest) -> MeasuredRun:
    """Return the run that a request names.

    Raises:
        RequestError: there is no such run, or it is not to be used and the request does not accept that.
    """
    run = inputs.run(request.run_id, "run_id")
    if run.run.result is not None:
        refuse_unaccepted(run.run.result.assessment, request.accept_verdict, f"run '{run.run.id}'")
    return run


def refuse_unaccepted(
    assessment: Assessment,
    accept_verdict: str | None,
    subject: str,
    where: str = "run_id",
    *,
    passed_over: Collection[str] = (),
) -> None:
    """Refuse a result that is not to be used, with the reasons.

    Raises:
        VerdictError: it is not to be used, and the request does not accept that.
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
        RequestError: it has none.
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
    def of(cls, robot: Robot, run: Run, request: DeflectionOptions | MapOptions | ProgramOptions) -> RunModel:
        """Return the model of a run of this robot, with the own weight that a request wants.

        Raises:
            RequestError: the run has no model or is of another robot, or the own weight does not fit it.
        """
        result = result_of(run)
        weight = _own_weight(request, robot, run)
        if result.model is None:
            raise RequestError(
                f"run '{run.id}' has no model", where="run_id", remedy="choose a run that determines a joint"
            )
        model, error = forward_model(robot, result.model, weight)
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
        """Return what holds for all predictions: what the model leaves out, and no bound."""
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
        elif self.error.postures < (needed := self.error.needed(confidence)):
            remarks.append(f"{level}: {needed} postures are needed, and there are {self.error.postures}")
        elif np.isinf(self.error.quantile(confidence)):
            remarks.append(f"{level}: too many postures twist a joint that the others do not determine")
        return remarks


def _own_weight(
    request: DeflectionOptions | MapOptions | ProgramOptions, robot: Robot, run: Run
) -> OwnWeight | None:
    """Return the own weight of the links: the run's for absolute positions, or of stated masses, or None."""
    stated = [] if isinstance(request, MapOptions) else request.masses
    if request.absolute:
        model = None if run.result is None else run.result.model
        if model is None or model.weight is None or stated:
            raise RequestError(
                f"sag takes the own weight of the run: '{run.id}' has none, or masses are stated, too",
                where="absolute",
                remedy="choose a run with `weight` and without balancers, and leave `masses` out",
            )
        part = model.weight
        mass, centre, gravity, root = map(
            np.array, (part.mass, part.centre, part.gravity, part.covariance_root)
        )
        return IdentifiedWeight(mass, centre, gravity, root=root)
    if isinstance(request, MapOptions) or not stated:
        return None
    mass, centre = np.zeros(robot.n), np.zeros((robot.n, 3))
    for i, link in enumerate(stated):
        j = joint_index(robot, link.joint, f"masses[{i}].joint")
        if link.joint in (other.joint for other in stated[:i]):
            raise RequestError(
                f"'{link.joint}' has a mass already",
                where=f"masses[{i}].joint",
                remedy="give each joint one mass, at the common centre of what it carries",
            )
        mass[j], centre[j] = link.mass, LENGTH[request.units.length] * np.array(link.centre)
    return OwnWeight(mass, centre)


def moment_factor(units: Units, moments: FloatArray) -> float:
    """Return N·m in the unit of moments.

    Raises:
        RequestError: there are moments, whose unit is not stated, and the others do not imply it.
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
