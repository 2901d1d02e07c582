"""Use of a stored run: refusal by its verdict, its model, and verdicts on results that are made from it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, isfinite
from typing import Final

import numpy as np

from jointstiff.schemas.deflection import LinkMass
from jointstiff.schemas.finding import Assessment, Finding, FindingCode, Verdict, combine_assessments
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.run import Run, RunResult
from jointstiff.service.conversion.units import FORCE, MOMENT
from jointstiff.service.problems import STIFFNESS_REMEDY, VerdictError
from jointstiff.service.resources.inputs import Inputs, MeasuredRun
from jointstiff.service.tables.report import describe_passed_checks, format_count
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.correct.correct import LIMIT_TOLERANCE
from jointstiff.solver.correct.prior import FACTOR, build_prior_model
from jointstiff.solver.errors import RequestError
from jointstiff.solver.integrity.values import FLANGE_LENGTHS
from jointstiff.solver.mechanics.block import OwnWeight
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.outcome.rules import PLAUSIBLE_STIFFNESS
from jointstiff.solver.predict.answers import build_forward_model
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.predict.models import IdentifiedWeight, JointModel, ModelError
from jointstiff.solver.text import PAST_CARE, figure, length_text, stiffness_text


def find_accepted_run(inputs: Inputs, run_id: str, accept_verdict: str | None) -> MeasuredRun:
    """Return the run that a request names, with its measurement set.

    Raises:
        RequestError: there is no such run.
        VerdictError: the run's verdict is `do_not_use`, and the request does not accept this verdict.
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
    ignored_codes: Collection[str] = (),
) -> None:
    """Refuse a result with the verdict `do_not_use`, unless the request accepts this verdict.

    Args:
        assessment: assessment of the result.
        accept_verdict: verdict that the request accepts.
        subject: name of the result in the message.
        where: field of the request that names the result.
        ignored_codes: codes of reasons that are ignored.

    Raises:
        VerdictError: the result is refused; the error lists the reasons.
    """
    reasons = [
        (reason.where or "all readings", reason.message, reason.remedy)
        for reason in assessment.reasons
        if reason.weight == "do_not_use" and reason.code not in ignored_codes
    ]
    if reasons and accept_verdict != assessment.verdict:
        raise VerdictError.for_result(subject, where, reasons)


def require_result(run: Run) -> RunResult:
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


_FIRST_ORDER_REMARK: Final = (
    "the predictions are to first order in the load: links and joints bend linearly, own "
    "weight and complementary stiffness are left out"
)


@dataclass(frozen=True, eq=False)
class RunModel:
    """The model of a run, which predicts the deflection of the loaded robot."""

    run: Run
    result: RunResult
    model: ForwardModel
    # calibrates the bound of the model error; None if no posture could be omitted from the identification
    error: ModelError | None

    @classmethod
    def from_run(
        cls,
        robot: Robot,
        run: Run,
        *,
        absolute: bool = False,
        masses: Sequence[LinkMass] = (),
        length: float = 1.0,
    ) -> RunModel:
        """Build the model of a run of this robot, with own weight if `absolute` or `masses` request it.

        Args:
            robot: robot of n joints.
            run: run that identified this robot.
            absolute: whether predictions include the sag due to the own weight that the run identified.
            masses: masses of the links; without any, own weight is left out.
            length: metres in one unit of the masses' centres (0.001 for mm).

        Raises:
            RequestError: the run has no model or is of another robot, or the own weight does not fit it.
        """
        result = require_result(run)
        weight = _choose_own_weight(robot, run, absolute, masses, length)
        if result.model is None:
            raise RequestError(
                f"run '{run.id}' has no model", where="run_id", remedy="choose a run that determines a joint"
            )
        model, error = build_forward_model(robot, result.model, result.joints, weight)
        if weight is not None and model.first_order:
            raise RequestError(
                f"run '{run.id}' has elastic links or coupling, so own weight cannot be added",
                where="masses",
                remedy="omit masses, or choose a run with elasticity joints",
            )
        return cls(run, result, model, error)

    @property
    def name(self) -> str:
        """Id of the run, for marks in programs."""
        return self.run.id

    @property
    def assessment(self) -> Assessment | None:
        """Assessment of the run."""
        return self.result.assessment

    @property
    def postures(self) -> int:
        """Number of postures on which the bound of the model error is based."""
        return 0 if self.error is None else self.error.postures

    def remarks(self, confidence: float) -> list[str]:
        """Return remarks on all predictions: effects that are not modelled, and why the error has no bound.

        Args:
            confidence: confidence level of the bound, such as 0.95.
        """
        if isinstance(self.model, JointModel):
            effects = list(self._remark_effects_on_joints(self.model))
        else:
            effects = [_FIRST_ORDER_REMARK]
        missing_bound = self._explain_missing_bound(confidence)
        return effects if missing_bound is None else [*effects, missing_bound]

    def _remark_effects_on_joints(self, model: JointModel) -> Iterator[str]:
        """Yield whether predictions with elastic joints include own weight, and if K_c was neglected."""
        is_by_loads = self.run.request.weight is None  # not identified by own weight
        if model.weight is None:
            explanation = "no masses are given" if is_by_loads else "`absolute` is not requested"
            yield f"own weight is not included, because {explanation}"
        elif model.weight.absolute:
            yield (
                "the predictions are absolute (relative to an arm that does not bend), and include "
                "the sag under own weight"
            )
        if is_by_loads and self.run.request.complementary_stiffness == "neglected":
            yield (
                "the run neglects the complementary stiffness K_c, but the prediction includes K_c: "
                "identify with complementary_stiffness included"
            )

    def _explain_missing_bound(self, confidence: float) -> str | None:
        """Return why the model error has no finite bound at a level; None if it has one.

        The bound is a quantile of errors at postures that the fit left out, so that a high level needs many
        postures: 95 % needs 19 at least.
        """
        if self.error is None:
            reason = self.result.model.no_error if self.result.model else None
            return f"no bound of the model error: {reason or 'no posture could be omitted'}"
        prefix = f"no bound of the model error at {100 * confidence:g} %"
        needed = self.error.count_needed_postures(confidence)
        if self.error.postures < needed:
            return f"{prefix}: {needed} postures are needed, but the campaign has only {self.error.postures}"
        if np.isinf(self.error.quantile(confidence)):
            return f"{prefix}: too many postures are needed to determine a joint"
        return None


@dataclass(frozen=True, eq=False)
class PriorModel:
    """Model of a robot that was not measured: its stiffness is a prior from payload and reach."""

    model: ForwardModel
    assessment: Assessment
    error: None = None
    result: None = None
    name: str = "prior"

    @classmethod
    def from_robot(cls, robot: Robot, *, weighted: bool) -> PriorModel:
        """Build the model of a robot whose stiffness was not measured, from its payload and reach.

        `weighted` says whether own weight is requested.

        Raises:
            RobotError: the robot has no payload, or other joints than six revolute ones.
            RequestError: own weight is requested, which this model leaves out.
        """
        if weighted:
            raise RequestError(
                "a prior of the stiffness does not include own weight",
                where="masses",
                remedy="omit `masses` and `absolute`, or first identify the stiffness from a campaign with "
                "loads",
            )
        message = (
            "the stiffness was not measured, but guessed from payload and reach: deflections may be "
            f"wrong by a factor of up to {FACTOR:g}"
        )
        remedy = "measure a campaign to see the remaining deflection in µm and the benefit of a correction"
        reason = make_reason("prior_stiffness", "use_with_care", message, remedy)
        return cls(build_prior_model(robot), Assessment(verdict="use_with_care", reasons=[reason]))

    def remarks(self, confidence: float) -> list[str]:  # noqa: ARG002 - the same for all levels
        """Return remarks on all predictions."""
        return ["own weight is not included, because no masses are given"]


def _choose_own_weight(
    robot: Robot, run: Run, absolute: bool, masses: Sequence[LinkMass], length: float
) -> OwnWeight | None:
    """Return the own weight of the robot: identified by the run if `absolute`, else made of `masses`.

    None if neither is requested. `length` is the size in metres of the unit of the masses' centres.

    Raises:
        RequestError: the run identified no own weight, or the masses are in conflict.
    """
    if absolute:
        return _read_identified_weight(run, masses)
    if not masses:
        return None
    return _build_stated_weight(robot, masses, length)


def _read_identified_weight(run: Run, masses: Sequence[LinkMass]) -> IdentifiedWeight:
    """Return the own weight that a run identified, for predictions that include the sag under it.

    Raises:
        RequestError: the run identified no own weight, or a request states masses, too.
    """
    model = None if run.result is None else run.result.model
    if model is None or model.weight is None or masses:
        raise RequestError(
            f"`absolute` needs a run with own weight and a request without `masses`, but run '{run.id}' "
            "has no own weight, or the request has `masses`",
            where="absolute",
            remedy="choose a run with `weight` and without balancers, and leave `masses` out",
        )
    weight = model.weight
    return IdentifiedWeight(
        np.array(weight.mass),
        np.array(weight.centre),
        np.array(weight.gravity),
        root=np.array(weight.covariance_root),
    )


def _build_stated_weight(robot: Robot, masses: Sequence[LinkMass], length: float) -> OwnWeight:
    """Return the own weight of links whose masses a request states; links without a mass weigh nothing.

    `length` is the size in metres of the unit of the masses' centres.

    Raises:
        RequestError: a joint does not exist, or has two masses.
    """
    mass, centre = np.zeros(robot.n), np.zeros((robot.n, 3))
    known_joints = set[str]()
    for index, link in enumerate(masses):
        where = f"masses[{index}].joint"
        joint_index = robot.joint_index(link.joint, where)
        if link.joint in known_joints:
            raise RequestError(
                f"joint '{link.joint}' has two masses in the request",
                where=where,
                remedy="give each joint one mass: the sum of its masses, at their common centre",
            )
        known_joints.add(link.joint)
        mass[joint_index] = link.mass
        centre[joint_index] = length * np.array(link.centre)
    return OwnWeight(mass, centre)


def moment_factor(units: Units, moments: FloatArray) -> float:
    """Return the factor from a request's unit of moments to N·m.

    Args:
        units: units of the request.
        moments: moments of the loads, in the unit of moments (cases, 3).

    Raises:
        RequestError: a moment is not zero, and its unit is neither stated nor implied by lengths in m.
    """
    if units.moment is not None:
        return MOMENT[units.moment]
    if units.length == "m" or not moments.any():
        return FORCE[units.force]
    raise RequestError(
        "the unit of a moment is not stated, and cannot be inferred because lengths are in mm",
        where="units.moment",
        remedy=f"state units.moment, one of {', '.join(MOMENT)}",
    )


LARGEST_DEFLECTION: Final = 0.02
"""Deflection of an arm beyond which a load or a length is probably in a wrong unit [m]."""
LARGEST_RATIO: Final = 20.0
"""Ratio to the campaign's greatest deflection beyond which a load or a length is probably in a wrong unit."""
LEAST_RATIO: Final = 1e-3
"""Ratio to the campaign's greatest deflection below which a load is probably in kN that were read as N."""
PAST_OWN_VERDICT: Final = "if the numbers are right, state `accept_verdict` to use the result"
"""How to go past the verdict on a result that is made from a run: end of a remedy."""
PAST_NO_VERDICT: Final = "if the numbers are right, no option is needed: the result is complete"
"""The same for a result that is never refused."""
_NO_DEFLECTION: Final = 5e-6
"""Deflection [m] below which no process is corrected: no robot repeats it, and no tracker reads it."""
_ROUNDED: Final = 1e-5
"""Distance [m] from the flange up to which a point is its origin: metres read as millimetres are farther."""
LONGEST_TOOL: Final = 1.5
"""Longest usual distance of a load point or a place from the flange [m]."""
_SUBJECT: Final[dict[Verdict, str]] = {
    "use": "Use this {}",
    "use_with_care": "Use this {} with care",
    "do_not_use": "Do not use this {}",
}


def make_reason(code: FindingCode, weight: Verdict, message: str, remedy: str) -> Finding:
    """Return a reason that concerns a result itself rather than the run from which the result was made."""
    return Finding(code=code, weight=weight, message=message, remedy=remedy)


def assess_with_run(subject: str, reasons: Sequence[Finding], run: Assessment | None) -> Assessment:
    """Return the assessment of a result made from a run: worse verdict, reasons of both, and a headline.

    Args:
        subject: name of the result in the headline, such as `map`.
        reasons: reasons of the result itself.
        run: assessment of the run or runs from which the result was made; None without a run.
    """
    own_verdict: Verdict = max((reason.weight for reason in reasons), key=list(_SUBJECT).index, default="use")
    own_assessment = Assessment(verdict=own_verdict, reasons=list(reasons))
    combined = combine_assessments([own_assessment] if run is None else [own_assessment, run])
    headline_parts = [f"{format_count(len(reasons), 'reason')} of its own"] if reasons else []
    if run is not None and run.reasons:
        headline_parts.append(f"{format_count(len(run.reasons), 'reason')} of its run")
    if not headline_parts:
        checks_of_run = "" if run is None else f"; {describe_passed_checks(run, ' of its run')}"
        headline_parts = [f"no fault was found{checks_of_run}"]
    headline = f"{_SUBJECT[combined.verdict].format(subject)}: {', '.join(headline_parts)}"
    return combined.model_copy(update={"headline": headline})


def find_implausible_deflection(
    greatest: float | None, run: RunResult | None, past: str = PAST_OWN_VERDICT
) -> list[Finding]:
    """Return a reason if the greatest deflection [m] is implausible for an arm or for the run's campaign.

    The deflection may be too large, or so small that its load is probably in another unit.

    The list is empty if the deflection is plausible or unknown. `run` is None without a campaign. `past` is
    the end of the remedy, for numbers that are right.
    """
    if greatest is None or not isfinite(greatest):
        return []
    measured = () if run is None else run.residuals
    greatest_measured = max((hypot(*residual.deflection) for residual in measured), default=0.0)
    ratio = greatest / greatest_measured if greatest_measured > 0.0 else 0.0
    if 0.0 < ratio < LEAST_RATIO and greatest < _NO_DEFLECTION:
        return [
            make_reason(
                "prediction_implausible",
                "use_with_care",
                f"the greatest deflection is {length_text(greatest)}, while the loads of the campaign moved "
                f"targets by up to {length_text(greatest_measured)}: this load is very small",
                f"check the unit of the load (its numbers may be kN that were read as N); {PAST_CARE}",
            )
        ]
    if greatest <= LARGEST_DEFLECTION and ratio <= LARGEST_RATIO:
        return []
    comparison = f", {figure(ratio, '.3g')} times the greatest of the campaign" if ratio > 1.0 else ""
    return [
        make_reason(
            "prediction_implausible",
            "do_not_use",
            f"the greatest deflection is {1e3 * greatest:.4g} mm{comparison}; up to "
            f"{1e3 * LARGEST_DEFLECTION:g} mm, and {LARGEST_RATIO:g} times the campaign's, is plausible",
            f"check the units of the load and of the points (N or kN, m or mm); {past}",
        )
    ]


def refuse_implausible_bounds(robot: Robot, bounds: Mapping[str, tuple[float | None, float | None]]) -> None:
    """Refuse limits of stiffnesses, by joint, that exclude all stiffnesses of joints of industrial robots.

    Raises:
        RequestError: names the joint.
    """
    least, greatest = PLAUSIBLE_STIFFNESS
    for name, (lower, upper) in bounds.items():
        if lower is not None and lower > greatest:
            refuse_implausible_stiffness(robot, name, lower, "stiffness_bounds")
        if upper is not None and upper < least:
            refuse_implausible_stiffness(robot, name, upper, "stiffness_bounds")


def refuse_implausible_length(robot: Robot, length: float | None) -> None:
    """Refuse a characteristic length [m] beyond the arm's reach: it seems to be in mm.

    Raises:
        RequestError: the length is longer than the arm.
    """
    if length is None or length <= robot.reach_bound:
        return
    raise RequestError(
        f"the characteristic length is {length_text(length)}, beyond the arm's reach of "
        f"{length_text(robot.reach_bound)}",
        where="characteristic_length",
        remedy=f"for {length:g} mm give {1e-3 * length:g} where lengths are in m, as in messages and HTTP "
        f"requests, and {length:g} where they are in mm; or omit `characteristic_length`, which is then the "
        "length of least condition number",
    )


def refuse_implausible_stiffness(robot: Robot, name: str, value: float, field: str = "stiffness") -> None:
    """Refuse a stated stiffness of a joint that does not exist, or that no joint of an industrial robot has.

    `field` is the field of the request that states the stiffness by joint.

    Raises:
        RequestError: names the joint.
    """
    joint = robot.joint_index(name, f"{field}.{name}")
    least, greatest = PLAUSIBLE_STIFFNESS
    if not least <= value <= greatest:
        kind = robot.joint_kinds[joint]
        limits = " to ".join(stiffness_text(limit, kind) for limit in PLAUSIBLE_STIFFNESS)
        raise RequestError(
            f"the stiffness of {name} is {stiffness_text(value, kind)}; {limits} is plausible",
            where=f"{field}.{name}",
            remedy=STIFFNESS_REMEDY,
        )


def find_far_points(points: Iterable[Sequence[float] | None]) -> list[Finding]:
    """Return a reason if points on the tool [m, flange frame] are unusually far from the flange, or near.

    [] is returned for usual points, such as the origin of the flange frame. Other points nearer than
    `FLANGE_LENGTHS` are not usual.
    """
    least_length, _ = FLANGE_LENGTHS
    distances = sorted(hypot(*point) for point in points if point is not None)
    unusual = [each for each in distances if _ROUNDED < each < least_length or each > LONGEST_TOOL]
    if not unusual:
        return []
    worst = unusual[-1]
    distance = f"{length_text(worst)} from the flange"
    plausible = f"{length_text(least_length)} to {LONGEST_TOOL:g} m"
    message = f"the load point or the place is {distance}; {plausible} is plausible"
    units = "mm that were read as m" if worst > LONGEST_TOOL else "m that were read as mm"
    remedy = f"check the unit of this point (its numbers may be {units}) and its frame; {PAST_CARE}"
    return [make_reason("point_implausible", "use_with_care", message, remedy)]


def find_beyond_campaign(count: int, total: int, what: str) -> list[Finding]:
    """Return a reason if `count` of `total` cases are beyond the campaign's loads or postures; [] for 0.

    `what` is the plural noun for cases in the message, such as `places`.
    """
    if not count:
        return []
    message = f"{count} of {total} {what} have loads or postures beyond those of the campaign"
    remedy = "measure with such loads and postures"
    return [make_reason("beyond_campaign", "use_with_care", message, remedy)]


def find_beyond_limits(robot: Robot, joints: FloatArray, labels: Sequence[str]) -> list[Finding]:
    """Return a reason if a posture is beyond the limits of the robot's joints, else [].

    Args:
        robot: the robot, n joints.
        joints: (m, n) controller's positions of the joints [rad or m].
        labels: names of the m postures.
    """
    lower, upper = robot.limits.T
    positions = robot.joint_map.model_angles(joints)
    excess = np.maximum(lower - positions, positions - upper)
    is_beyond = excess > LIMIT_TOLERANCE
    if not is_beyond.any():
        return []
    row, joint = divmod(int(np.argmax(excess)), robot.n)
    count = int(is_beyond.any(axis=1).sum())
    message = (
        f"{count} of {len(joints)} postures {'is' if count == 1 else 'are'} beyond the limits of the joints, "
        f"such as {robot.joint_names[joint]} in posture {labels[row]}"
    )
    remedy = "check the positions of the joints and their unit, or correct the limits of the robot"
    return [make_reason("joint_outside_limits", "use_with_care", message, remedy)]


def find_missing_numbers(
    count: int,
    total: int,
    what: str,
    *,
    unseen: bool = True,
    remedy: str | None = None,
    first: str = "",
) -> list[Finding]:
    """Return a reason if `count` of `total` cases have no number; [] for 0.

    Args:
        count: number of cases without a number.
        total: number of all cases.
        what: plural noun for cases in the message, such as `places`.
        unseen: whether numbers may be missing because the run does not determine some joints.
        remedy: remedy of the reasons of these cases, if it is known.
        first: name of the first case without a number, and the reason; empty if a table next to it says so.
    """
    if not count:
        return []
    weight: Verdict = "do_not_use" if count == total else "use_with_care"
    subject = f"none of the {total}" if count == total else f"{total - count} of {total}"
    message = f"{subject} {what} {'have' if total != 1 else 'has'} a number"
    if first:
        message += f"; the first without one is {first}"
    measuring_advice = "measure with loads that twist the undetermined joints, or " if unseen else ""
    remedy = remedy or f"read the reason why each case has no number; {measuring_advice}move the places"
    return [make_reason("numbers_missing", weight, message, remedy)]
