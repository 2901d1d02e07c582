"""The work of a comparison of stored runs, of one measurement set or of two; nothing is identified again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any, Final

import numpy as np

from jointstiff.schemas.comparison import (
    CampaignComparison,
    ComparedRun,
    ComparedSide,
    ComparisonRequest,
    ComparisonResult,
)
from jointstiff.schemas.comparison import Side as SideName
from jointstiff.schemas.finding import Assessment, Finding, Verdict, combine_assessments
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Budget, BudgetComponent, JointResult, Run, RunRequest, RunResult
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.kinds.work import QuickWork
from jointstiff.service.resources.inputs import Inputs, MeasuredRun
from jointstiff.service.runs.verdicts import assess_with_run, make_reason
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.comparison.campaigns import (
    Comparison,
    FreeEstimate,
    SharedErrors,
    Side,
    compare_sides,
    models_differ,
)
from jointstiff.solver.comparison.shapes import list_other_dimensions
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.evidence.refuted import leave_out, list_refuted
from jointstiff.solver.evidence.structure import Apart, build_parts
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.answers import build_forward_model
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.text import figure

_NO_FIT: Final = Finding(
    code="no_joint_identified",
    weight="do_not_use",
    message="all compared methods failed, so no joint stiffness is known",
    remedy="read the error of each method, and follow its remedy",
)
_NOTHING_COMMON: Final = Finding(
    code="no_common_configuration",
    weight="use_with_care",
    message="no configuration was measured on both sides, so the avoided deflection is predicted, "
    "not measured",
    remedy="measure some of the same postures under the same load on both sides",
)
_OTHER_MODEL: Final = Finding(
    code="robot_models_differ",
    weight="use",
    message="the robots differ in their kinematics or joint map",
    remedy="check that both robots are of the same model; ratios compare joints with the same name",
)
_MAX_DIMENSIONS: Final = 3
"""Number of differing dimensions of two robots that a finding names."""
UNCONSTRAINED: Final[Mapping[str, Any]] = {"positive": False, "stiffness_bounds": {}, "stiffness_order": []}
"""Values of a run's options that remove all constraints."""
_SIDES: Final[tuple[SideName, SideName]] = ("first", "second")
_NO_NUMBERS: Final[Mapping[str, Any]] = {
    "characteristic_length": None,
    "assessment": None,
    "joints": [],
    "compensation": None,
    "rms_residual": None,
    "condition_number": None,
    "resampling": None,
    "left": [],
}
"""Fields of a compared run that has failed, and so has no numbers."""


def prepare_comparison(inputs: Inputs, request: ComparisonRequest) -> QuickWork:
    """Fetch the runs of a request, and return the work that compares these runs.

    Raises:
        RequestError: a run does not exist or has not ended, or the runs belong to more than two sets.
    """
    runs = [inputs.run(run_id, f"run_ids[{i}]") for i, run_id in enumerate(request.run_ids)]
    _refuse_unfinished(runs)
    set_ids = list(dict.fromkeys(each.run.request.measurement_set_id for each in runs))
    _refuse_third_set(set_ids)
    options = request.model_dump_json(exclude={"run_ids"})
    hashes_of_runs = [each.run.provenance.input_hash for each in runs]
    second_set_id = set_ids[1] if len(set_ids) > 1 else None
    return QuickWork(
        result=partial(compare_runs, inputs, request, runs),
        input_hash=hash_texts(*hashes_of_runs, options),
        robot_id=runs[0].prepared.robot_id,
        details={"measurement_set_id": set_ids[0], "second_set_id": second_set_id},
    )


def _refuse_third_set(set_ids: Sequence[str]) -> None:
    """Refuse runs of more than two measurement sets.

    Raises:
        RequestError: names the number of sets.
    """
    if len(set_ids) > len(_SIDES):
        raise RequestError(
            f"the runs belong to {len(set_ids)} measurement sets, but at most two sets can be compared",
            where="run_ids",
            remedy="give runs of one set or of two; the trend of the robot shows all sets",
        )


def _refuse_unfinished(runs: Sequence[MeasuredRun]) -> None:
    """Refuse runs that have neither a result nor an error yet.

    Raises:
        RequestError: names the first of them.
    """
    for i, each in enumerate(runs):
        if each.run.result is None and each.run.error is None:
            raise RequestError(
                f"the run '{each.run.id}' has no result to compare: its state is {each.run.state}",
                where=f"run_ids[{i}]",
                remedy="wait until the run has ended, or give another run",
            )


def compare_runs(inputs: Inputs, request: ComparisonRequest, runs: Sequence[MeasuredRun]) -> ComparisonResult:
    """Compare the runs of one measurement set, or of two sets, and return the result.

    Two sets are compared joint by joint with the first run of each set, the leading run.

    Raises:
        RequestError: the robots of two sets have different joints, or the runs cannot be compared.
        SolverError: an optimum could not be certified.
    """
    runs_by_side = _group_by_side(runs)
    result = _list_runs_side_by_side(request, runs, runs_by_side)
    if len(runs_by_side) == 1:
        assessment = assess_with_run("comparison", [], result.assessment)
        return result.model_copy(update={"assessment": assessment})
    return _add_comparison_of_sides(inputs, request, runs_by_side, result)


def _list_runs_side_by_side(
    request: ComparisonRequest,
    runs: Sequence[MeasuredRun],
    runs_by_side: Mapping[SideName, Sequence[MeasuredRun]],
) -> ComparisonResult:
    """Return a result with the numbers of all runs, in which the two sides are not yet compared."""
    sides = [_make_side_message(name, side_runs) for name, side_runs in runs_by_side.items()]
    side_of_set = {side.measurement_set_id: side for side in sides}
    assessments = [each.run.result.assessment for each in runs if each.run.result is not None]
    if not assessments:
        assessments = [Assessment(verdict="do_not_use", reasons=[_NO_FIT])]
    return ComparisonResult(
        assessment=combine_assessments(assessments),
        confidence=request.confidence or runs[0].run.request.confidence,
        sides=sides,
        entries=[_make_entry(each.run, side_of_set[each.run.request.measurement_set_id]) for each in runs],
        joints=[],
        avoided=None,
        ordered=None,
        warnings=_list_distinct_warnings(runs),
    )


def _group_by_side(runs: Sequence[MeasuredRun]) -> dict[SideName, list[MeasuredRun]]:
    """Return side → the runs of its measurement set; the first run's set is the first side.

    With one set there is only the first side.
    """
    runs_by_set = dict[str, list[MeasuredRun]]()
    for measured_run in runs:
        runs_by_set.setdefault(measured_run.run.request.measurement_set_id, []).append(measured_run)
    return dict(zip(_SIDES, runs_by_set.values(), strict=False))


def _list_distinct_warnings(runs: Sequence[MeasuredRun]) -> list[Finding]:
    """Return the warnings of all runs; of those with the same code and place only the first."""
    warnings = dict[tuple[str, str | None], Finding]()
    for measured_run in runs:
        for finding in _list_warnings(measured_run.run):
            warnings.setdefault((finding.code, finding.where), finding)
    return list(warnings.values())


def _list_warnings(run: Run) -> list[Finding]:
    """Return the warnings of a run; none if it has failed."""
    return [] if run.result is None else run.result.warnings


def _make_entry(run: Run, side: ComparedSide) -> ComparedRun:
    """Return the message of a compared run: its method, and its numbers or its error."""
    numbers = _NO_NUMBERS if run.result is None else _list_numbers(run.result, side)
    return ComparedRun(
        run_id=run.id,
        side=side.side,
        method=run.request.method,
        weighting=run.request.weighting,
        positive=run.request.positive,
        draws=run.request.resampling,
        error=run.error,
        **numbers,
    )


def _list_numbers(result: RunResult, side: ComparedSide) -> dict[str, Any]:
    """Return the fields of a compared run that has succeeded, by name.

    The field `left` has the mean length of the residual in each configuration of the side [m].
    """
    residuals = result.mean_lengths("residual")
    left = [residuals.get(label) for label in side.configurations] if residuals else []
    return {
        "characteristic_length": result.characteristic_length,
        "assessment": result.assessment,
        "joints": result.joints,
        "compensation": result.compensation,
        "rms_residual": result.rms_residual,
        "condition_number": result.identifiability.condition_number,
        "resampling": result.resampling,
        "left": left,
    }


def _make_side_message(name: SideName, runs: Sequence[MeasuredRun]) -> ComparedSide:
    """Return the message of a side: its set, its leading run, and each configuration's mean deflection [m].

    The first run is the leading run, from which ratios are computed.
    """
    leading_run, labels = runs[0].run, list(runs[0].prepared.measurements.labels)
    lengths: dict[str, float] = {}
    for result in (measured_run.run.result for measured_run in runs):
        # A run that leaves out observations has no deflection of them: another run may have it.
        if result is not None and len(lengths) < len(runs[0].prepared.measurements):
            lengths |= result.mean_lengths("deflection")
    return ComparedSide(
        side=name,
        measurement_set_id=leading_run.request.measurement_set_id,
        run_id=leading_run.id,
        configurations=labels,
        deflection=[lengths.get(label) for label in labels],
    )


def _report_unlike_observations(side_comparison: Comparison) -> list[Finding]:
    """Return a finding if observations with the same label differ; nothing if a wrong unit explains this."""
    unlike = side_comparison.unlike
    if not unlike or side_comparison.unit_mistake is not None:
        return []
    return [
        Finding(
            code="configurations_differ",
            weight="use",
            message=f"{len(unlike)} observations have the same label but different postures or loads, or no "
            f"common target; the first of these observations is '{unlike[0]}'",
            remedy="measure the same postures under the same load, or give different labels",
        )
    ]


def _report_other_model(robots: Sequence[Robot], names: Sequence[str]) -> list[Finding]:
    """Return a finding if two robots are not of one model, so that their joints are not alike.

    `names` are those of the robots. Robots of one model may differ by a calibration, frames and tools.
    """
    differing = list_other_dimensions(*robots)
    if not differing:
        return []
    dimensions = []
    for each in differing[:_MAX_DIMENSIONS]:
        factor, unit = (np.degrees(1.0), "°") if each.is_angle else (1e3, " mm")
        first, second = (figure(factor * size, ".4g") for size in (each.first, each.second))
        dimensions.append(f"the {each.name} is {first}{unit} and {second}{unit}")
    more = len(differing) - len(dimensions)
    and_more = f", and {more} more differ" if more else ""
    first_name, second_name = names
    robot_names = f"'{first_name}' and '{second_name}'"
    return [
        Finding(
            code="robot_models_differ",
            weight="do_not_use",
            message=f"the robots are of different models, so that ratios of their joints mean nothing: "
            f"{robot_names}: {'; '.join(dimensions)}{and_more}",
            remedy="compare two campaigns of one robot, or of two robots of one model; if both arms are of "
            "one model, give the second campaign the `robot` of the first, and identify it again",
        )
    ]


def _list_comparison_reasons(side_comparison: Comparison) -> list[Finding]:
    """Return reasons against a comparison: a wrong unit, no common observations, or unknown ratios."""
    reasons = []
    if side_comparison.unit_mistake:  # this is also the reason if no observations match
        reasons.append(side_comparison.unit_mistake)
    elif not side_comparison.avoided.matching:
        reasons.append(_NOTHING_COMMON)
    joints_without_ratio = [joint.name for joint in side_comparison.joints if joint.ratio is None]
    if joints_without_ratio:
        message = f"the ratio of stiffnesses is unknown for {', '.join(joints_without_ratio)}"
        remedy = "measure both sets under loads that twist these joints"
        reasons.append(make_reason("numbers_missing", "use_with_care", message, remedy))
    return reasons


def _report_differing_encoders(apart: Apart | None, names: Sequence[str]) -> Iterator[Finding]:
    """Yield a finding for each joint whose encoder does not show what the second loop removes."""
    if apart is None:
        return
    for joint in apart.differing.tolist():
        excess = float(apart.excess[apart.joints.tolist().index(joint)])
        sense = "more" if excess > 0.0 else "less"
        yield Finding(
            code="encoder_against_difference",
            weight="use_with_care",
            message=f"the encoder of {names[joint]} shows {sense} deflection than the encoders in the loop "
            f"remove, by {figure(abs(excess), '.2g')} standard uncertainties",
            remedy="check that this encoder closes the loop, that its angles are those of the model's joint, "
            "and that the loads of both sets are stated alike",
            where=names[joint],
        )


def _add_comparison_of_sides(
    inputs: Inputs,
    request: ComparisonRequest,
    runs_by_side: Mapping[SideName, Sequence[MeasuredRun]],
    result: ComparisonResult,
) -> ComparisonResult:
    """Return a copy of a result with the comparison of its two sides.

    Added are the ratios of stiffnesses, the avoided deflection (how much less the targets deflect on the
    second side), warnings, the assessment and, on request, the ordered fit.

    Args:
        inputs: source of measurement sets, which are fetched by id.
        request: request of the comparison; with `ordered`, no joint may be softer on the second side.
        runs_by_side: all runs of each side; ratios are computed from the first run.
        result: result of the comparison so far.

    Raises:
        RequestError: a leading run has failed, or the runs cannot be compared.
    """
    leading_runs = {name: side_runs[0].run for name, side_runs in runs_by_side.items()}
    assessments = [_get_assessment_of_side(run, name) for name, run in leading_runs.items()]
    _refuse_same_readings([runs_by_side[name][0] for name in _SIDES])
    first, second = (_make_solver_side(inputs, runs_by_side[name]) for name in _SIDES)
    side_comparison = compare_sides(
        first,
        second,
        confidence=result.confidence,
        ordered=request.ordered,
        shared=SharedErrors(load=request.same_load, cell=request.same_cell),
    )
    names = first.robot.joint_names
    sets = inputs.named_sets([side.measurement_set_id for side in result.sides], "run_ids")
    of_other_model = _report_other_model(
        (first.robot, second.robot), [measured_set.robot_name for measured_set in sets]
    )
    reasons = [
        *of_other_model,
        *_list_comparison_reasons(side_comparison),
        *_report_differing_encoders(side_comparison.apart, names),
    ]
    assessment = assess_with_run("comparison", reasons, combine_assessments(assessments))
    compared = _describe_comparison(side_comparison, names, assessment.verdict)
    warnings = _list_warnings_of_sides(leading_runs)
    if models_differ(first.robot, second.robot) and not of_other_model:
        warnings.append(_OTHER_MODEL)
    warnings += _report_unlike_observations(side_comparison)
    return result.model_copy(update={"assessment": assessment, "warnings": warnings, **compared})


def _refuse_same_readings(leading_runs: Sequence[MeasuredRun]) -> None:
    """Refuse two sides with the same readings, whose ratios are 1 and have no meaning.

    Raises:
        RequestError: the sets are equal, and the runs have the same options.
    """
    first, second = leading_runs
    contents = [each.prepared.content for each in leading_runs]
    options = [each.run.request.model_dump(exclude={"measurement_set_id"}) for each in (first, second)]
    if contents[0] == contents[1] and options[0] == options[1]:
        raise RequestError(
            "both campaigns have the same robot and the same readings, so that each ratio is 1",
            where="run_ids",
            remedy="give two different campaigns; or give one campaign, to compare methods",
        )


def _list_warnings_of_sides(leading_runs: Mapping[SideName, Run]) -> list[Finding]:
    """Return the warnings of the leading run of each side, whose places name the side."""
    warnings = list[Finding]()
    for name, run in leading_runs.items():
        warnings += [_add_side_to_place(finding, name) for finding in _list_warnings(run)]
    return warnings


def _describe_comparison(
    side_comparison: Comparison, names: Sequence[str], verdict: Verdict
) -> dict[str, Any]:
    """Return the fields of a result, by name, that compare its two sides.

    `differences` has what the second side removes from each joint. If encoders show a part of that, the
    gearboxes and the structure behind them have results of their own.

    Args:
        side_comparison: comparison by the solver.
        names: names of the joints.
        verdict: verdict on the whole comparison; no joint has a better one.
    """
    gearboxes = build_parts(side_comparison.apart, "gearboxes", names)
    structures = build_parts(side_comparison.apart, "structure", names)
    return {
        "joints": side_comparison.joints,
        "differences": _limit_verdicts(side_comparison.differences, verdict),
        "gearboxes": _limit_verdicts(gearboxes, verdict),
        "structures": _limit_verdicts(structures, verdict),
        "avoided": side_comparison.avoided,
        "ordered": side_comparison.ordered,
    }


def _get_assessment_of_side(leading_run: Run, name: SideName) -> Assessment:
    """Return the assessment of the leading run of a side; its reasons name the side.

    Raises:
        RequestError: the run has failed.
    """
    if leading_run.result is None:
        raise RequestError(
            f"the run of the {name} measurement set has failed",
            where="run_ids",
            remedy="read the `error` of the run, and give a run that succeeded",
        )
    assessment = leading_run.result.assessment
    reasons = [_add_side_to_place(reason, name) for reason in assessment.reasons]
    return assessment.model_copy(update={"reasons": reasons})


def _limit_verdicts(joints: Iterable[JointResult], verdict: Verdict) -> list[JointResult]:
    """Return results whose verdicts are not better than that of the whole comparison."""
    order: list[Verdict] = ["use", "use_with_care", "do_not_use"]
    limited = list[JointResult]()
    for joint in joints:
        worst = max(joint.verdict, verdict, key=order.index)
        limited.append(joint.model_copy(update={"verdict": worst}))
    return limited


def _add_side_to_place(finding: Finding, side: SideName) -> Finding:
    """Return a copy of a finding whose `where` begins with the side, such as "first.observations[2]"."""
    where = f"{side}.{finding.where}" if finding.where else side
    return finding.model_copy(update={"where": where})


def _make_solver_side(inputs: Inputs, runs: Sequence[MeasuredRun]) -> Side:
    """Return a side for the solver, from its leading run and its run without constraints.

    Args:
        inputs: source of measurement sets.
        runs: all runs of the side: the leading run, from which ratios are computed, is the first.

    Raises:
        RequestError: the leading run has elastic links or base, was identified by own weight, or uses priors.
    """
    run, prepared = runs[0].run, runs[0].prepared
    _refuse_dependent_errors(run)
    if run.request.leave_out:
        set_id = run.request.measurement_set_id
        prepared = inputs.measured(set_id, "run_ids", run.request.leave_out)
    measurements = _correct_readings(run, prepared)
    model = _rebuild_joint_model(run, prepared.robot)
    complementary_stiffness = run.result.complementary_stiffness if run.result else None
    return Side(
        robot=prepared.robot,
        measurements=measurements,
        compliance=model.compliance,
        constraints=model.constraints,
        complementary_stiffness=complementary_stiffness is not None and complementary_stiffness.included,
        free=_make_free_estimate(_find_unconstrained_run(run, runs), prepared.robot),
    )


def _refuse_dependent_errors(run: Run) -> None:
    """Refuse a run whose stiffnesses contain the same error as those of the other set, such as of a mass.

    Raises:
        RequestError: the run was identified by own weight, or uses priors.
    """
    if run.request.weight is None and not run.request.priors:
        return
    obstacle = "was identified by own weight" if run.request.weight is not None else "uses priors"
    raise RequestError(
        f"the run '{run.id}' {obstacle}, so the errors of both sets may be common, but the sets "
        "must be independent",
        where="run_ids",
        remedy="identify the measurement set under external loads and without `priors`, and give the new run",
    )


def _correct_readings(run: Run, prepared: PreparedSet) -> Measurements:
    """Return the readings of a run without refuted ones, and without the effects of its causes."""
    causes = [cause.name_and_first_label for cause in run.request.causes]
    refuted = list_refuted(prepared.measurements, prepared.warnings)
    trusted_readings = leave_out(prepared.measurements, refuted)
    return fit_causes(Rows(prepared.robot, trusted_readings), causes)


def _rebuild_joint_model(run: Run, robot: Robot) -> JointModel:
    """Rebuild the model of a run, in which only joints are elastic, from the stored result.

    Raises:
        RequestError: links or the base of the model are elastic, too.
    """
    model = None
    if run.result is not None and run.result.model is not None:
        model, _ = build_forward_model(robot, run.result.model, run.result.joints)
    if not isinstance(model, JointModel):
        raise RequestError(
            "two measurement sets can be compared only if joints alone are elastic in the runs, but the "
            f"run '{run.id}' has elasticity {run.elasticity}",
            where="run_ids",
            remedy="identify the measurement set with elasticity `joints`, and give the new run",
        )
    return model


def _find_unconstrained_run(run: Run, runs: Sequence[MeasuredRun]) -> Run:
    """Return the run of `runs` that has the same options as `run`, but no constraints.

    The answer is `run` itself if no constraint is active in it, or if `runs` has no such run.
    """
    if not has_active_constraint(run):
        return run
    for other in (each.run for each in runs if each.run.result is not None):
        is_free = all(getattr(other.request, name) == value for name, value in UNCONSTRAINED.items())
        if is_free and _influential_options(other) == _influential_options(run):
            return other
    return run


def has_active_constraint(run: Run) -> bool:
    """Return whether a joint of a run is at a bound, so that estimates are not normally distributed."""
    return any(joint.status == "at_bound" for joint in (run.result.joints if run.result else ()))


def _influential_options(run: Run) -> dict[str, Any]:
    """Return the options of a run that influence its estimate, by name, without the constraints."""
    without_influence = {
        "measurement_set_id",
        "variant_of",
        "elasticity",
        "cross_validation",
        "resampling",
        "confidence",
    }
    return run.request.model_dump(exclude={*without_influence, *UNCONSTRAINED})


def _make_free_estimate(run: Run, robot: Robot) -> FreeEstimate:
    """Return a run's estimate before constraints: n compliances with their covariance (n, n).

    The estimate also has parts of the covariance: one from the readings, and one from the scale of the force.
    """
    model, result = _rebuild_joint_model(run, robot), run.result
    if result is None:
        raise ValueError("a run without a result has no model")
    estimate = _CompliancesBeforeConstraints.from_joints(result.joints)
    parts = _CovarianceParts.unknown(robot.n)
    if model.likelihood is not None and result.budget is not None:
        parts = _CovarianceParts.from_budget(result.budget, estimate.is_known)
        estimate = estimate.replace_by_likelihood(model.likelihood)
    return FreeEstimate(
        compliance=estimate.compliance,
        covariance=estimate.covariance,
        readings=parts.readings,
        force_scale=parts.force_scale,
        load_point=parts.load_point,
        sigma=result.sigma,
        degrees_of_freedom=inf if model.degrees_of_freedom is None else model.degrees_of_freedom,
        reasons=[joint.reason for joint in result.joints],
        unseen=estimate.is_undetermined,
    )


@dataclass(frozen=True, eq=False)
class _CompliancesBeforeConstraints:
    """Compliances [rad/(N·m)] of n joints and their covariance, before constraints change them."""

    compliance: FloatArray  # (n,); NaN for a joint whose result has no compliance
    covariance: FloatArray  # (n, n); zero where unknown
    is_known: BoolArray  # (n,) joints whose result has a compliance
    is_undetermined: BoolArray  # (n,) joints that the readings do not determine

    @classmethod
    def from_joints(cls, joints: Sequence[JointResult]) -> _CompliancesBeforeConstraints:
        """Return the compliances of a run's result, without a covariance."""
        or_nan = [np.nan if joint.compliance is None else joint.compliance for joint in joints]
        compliance = np.array(or_nan, dtype=np.float64)
        is_known = np.isfinite(compliance)
        return cls(compliance, np.zeros((len(joints), len(joints))), is_known, np.isnan(compliance))

    def replace_by_likelihood(self, likelihood: Likelihood) -> _CompliancesBeforeConstraints:
        """Return the estimate by the readings alone, whose centre and covariance the likelihood has.

        The likelihood is about the joints that the readings determine; a joint without a compliance in the
        result stays without one.
        """
        n, determined = len(self.compliance), likelihood.joints
        compliance, covariance = self.compliance.copy(), np.zeros((n, n))
        compliance[determined] = likelihood.centre
        compliance[~self.is_known] = np.nan
        covariance[np.ix_(determined, determined)] = likelihood.covariance
        covariance *= np.outer(self.is_known, self.is_known)
        is_undetermined = ~np.isin(np.arange(n), determined)
        return replace(self, compliance=compliance, covariance=covariance, is_undetermined=is_undetermined)


@dataclass(frozen=True, eq=False)
class _CovarianceParts:
    """Parts of the covariance of n compliances, by their causes."""

    readings: FloatArray | None  # (n, n) by the errors of the readings; None if unknown
    force_scale: FloatArray  # (n, n) by the scale of the force
    load_point: FloatArray  # (n, 3) responses of the compliances to the load point; (n, 0) if unknown

    @classmethod
    def unknown(cls, n: int) -> _CovarianceParts:
        """Return the parts of a run without an uncertainty budget."""
        return cls(None, np.zeros((n, n)), np.zeros((n, 0)))

    @classmethod
    def from_budget(cls, budget: Budget, is_known: BoolArray) -> _CovarianceParts:
        """Return the parts by the components of a budget, whose joints are those with `is_known` (n,)."""
        parts = cls.unknown(len(is_known))
        for component in budget.components:
            covariance = _spread_covariance(component, is_known)
            if component.source == "readings":
                parts = replace(parts, readings=covariance)
            elif component.source.removeprefix("assumed_") == "force_scale":
                parts = replace(parts, force_scale=covariance)
            if component.responses is not None:
                load_point = np.zeros((len(is_known), 3))
                load_point[is_known] = component.responses
                parts = replace(parts, load_point=load_point)
        return parts


def _spread_covariance(component: BudgetComponent, is_known: BoolArray) -> FloatArray:
    """Return the covariance (n, n) of a component of the budget, zero for joints that the budget omits.

    ``C_ij = u_i u_j r_ij`` with the contributions u and their correlation r, of the joints with `is_known`.
    """
    covariance = np.zeros((len(is_known), len(is_known)))
    in_budget = np.flatnonzero(is_known)
    contributions = np.outer(component.contributions, component.contributions)
    covariance[np.ix_(in_budget, in_budget)] = contributions * np.array(component.correlation)
    return covariance


# ---- the runs that the verb `compare` makes


@dataclass(frozen=True)
class ComparedSet:
    """A measurement set to be compared, with options of its runs."""

    set_id: str  # id of the measurement set
    leave_out: Sequence[str]  # labels of observations that the runs of this set omit
    options: RunOptions  # options of the leading run, which is compared with the leading run of another set

    def build_leading_options(self, common: Mapping[str, Any]) -> RunOptions:
        """Return the options of the leading run: those of the set, and those that all runs have in common.

        An elasticity that the user names is kept, so that any elasticity but `joints` is refused later.
        """
        own = self.options.model_dump(exclude={"leave_out"})
        named_elasticity = {} if own["elasticity"] == "automatic" else {"elasticity": own["elasticity"]}
        return RunOptions.model_validate({**own, **common, **named_elasticity})

    def make_runs(
        self,
        run_options: Sequence[RunOptions],
        leading: RunOptions,
        identify: Callable[[RunRequest, bool], Run | None],
    ) -> list[Run]:
        """Make the runs of this set, and one without constraints if the leading run has an active constraint.

        Runs that failed are left out. `identify` is that of `request_comparison`.
        """
        run_by_options = [(each, identify(self._request_run(each), each != leading)) for each in run_options]
        leading_runs = [run for each, run in run_by_options if each == leading]
        is_constrained = any(run is not None and has_active_constraint(run) for run in leading_runs)
        runs = [run for _, run in run_by_options]
        unconstrained = leading.model_copy(update=UNCONSTRAINED)
        if is_constrained and unconstrained not in run_options:
            runs.append(identify(self._request_run(unconstrained), unconstrained != leading))
        return [run for run in runs if run is not None]

    def _request_run(self, options: RunOptions) -> RunRequest:
        """Return the request of a run of this set with these options."""
        readings = {"measurement_set_id": self.set_id, "leave_out": list(self.leave_out)}
        return RunRequest.model_validate({**options.model_dump(), **readings})


def request_comparison(
    sets: Sequence[ComparedSet],
    options: CampaignComparison,
    identify: Callable[[RunRequest, bool], Run | None],
) -> ComparisonRequest:
    """Make the runs of one set or of two sets, and return the request that compares these runs.

    Each of two sets gets a leading run, from which ratios are computed, and, if a constraint is active in the
    leading run, also a run without constraints.

    Args:
        sets: one set to compare methods, or two sets to compare with each other.
        options: methods, constraints and resampling of the comparison.
        identify: function that identifies a request and returns the run, or None if this failed; its second
            argument is True if the comparison is possible without this run.
    """
    confidence = options.confidence or sets[0].options.confidence
    common = {"elasticity": "joints", "confidence": confidence, "resampling": options.resampling}
    run_options = _list_run_options(options, common)
    runs: list[Run] = []
    for compared_set in sets:
        leading = compared_set.build_leading_options(common)
        options_of_set = run_options
        if len(sets) > 1:
            others = [each for each in run_options if each != leading]
            options_of_set = [leading, *others]
        runs += compared_set.make_runs(options_of_set, leading, identify)
    return ComparisonRequest(
        run_ids=[run.id for run in runs],
        ordered=options.ordered,
        same_load=options.same_load,
        same_cell=options.same_cell,
        confidence=options.confidence,
    )


def _list_run_options(options: CampaignComparison, common: Mapping[str, Any]) -> list[RunOptions]:
    """Return the options of a run for each method and constraint; `common` are those of all runs."""
    run_options = list[RunOptions]()
    for method in options.methods:
        for constraint in options.constraints:
            positive = constraint == "positive"
            run_options.append(RunOptions(**method.model_dump(), **common, positive=positive))
    return run_options
