"""Progress of a live campaign: results of the readings so far, state of the goal, and the next reading.

A goal is met if there are enough readings, no reading is doubtful or mistaken, and the uncertainty is at most
that of the goal. The campaign is finished when, in addition, a reading that was held out lies in the 90 %
ball about its prediction from the other readings.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.live import LiveJoint
from jointstiff.schemas.options import OwnWeight, RunOptions, StiffnessPrior
from jointstiff.schemas.plan import DecisionGoal, Goal, JointsGoal
from jointstiff.schemas.run import Budget, Goodness, RunResult
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.candidates import Equipment
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.scatter import Posterior
from jointstiff.solver.fit.estimate import stiffness_interval
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.live.ahead import CandidateReadings, KnownCompliances, NextReading, UncertaintyShare
from jointstiff.solver.live.innovation import (
    HeldOut,
    Innovation,
    check_held_out_reading,
    compare_last_reading,
)
from jointstiff.solver.live.priors import Standing, compare_priors
from jointstiff.solver.mechanics.measurements import Measurements, Scatter
from jointstiff.solver.run import run
from jointstiff.solver.text import figure, length_text

FEWEST: Final = 5
"""Fewest readings with which a goal can be met."""
FEWEST_WITH_MODEL_ERROR: Final = 10
"""Fewest readings with which a goal can be met if residuals may be greater than noise: a ball of 90 % about a
prediction needs nine other postures."""
_FEWEST_TO_FIND_MISTAKE: Final = 3
"""Fewest readings with which a mistake in one of them can be found."""
ENOUGH_TO_SAY: Final = 10
"""Number of readings from which on a goal may be reported as out of reach."""
_MANY: Final = 8
"""Number of missing readings from which on another load is looked for."""
_SIGNIFICANT: Final = 0.2
"""p-value of the residuals for the stated noise, below which a model error is assumed."""


@dataclass(frozen=True, eq=False)
class ReadingsSoFar:
    """Readings of a live campaign, with the results of the checks of each reading."""

    measurements: Measurements | None = None  #: readings that count (not withdrawn); None before the first
    noticed: tuple[Finding, ...] = ()  #: findings of the integrity checks of the readings that count
    #: comparison of each reading, also of withdrawn readings, with its prediction at the time, by the label
    comparisons: Mapping[str, Innovation] = field(default_factory=dict)
    withdrawn: frozenset[str] = frozenset()  #: labels of withdrawn readings
    kept: frozenset[str] = frozenset()  #: labels of doubtful readings that the user kept
    skipped: tuple[tuple[float, ...], ...] = ()  #: postures that the user skipped [rad or m]
    check: HeldOut | None = None  #: check of the last reading that counts; None if it was not held out


class _Fitted(NamedTuple):
    """Joints fitted to the readings so far."""

    compliance: FloatArray  # (n,) [rad/(N·m)], zero or more
    scatter: Scatter  # errors that the targets of a posture share
    posterior: Posterior | None  # of the scatter; None if the scatter is as stated


@dataclass(frozen=True, eq=False)
class OtherLoad:
    """Load with which further readings meet the goal sooner than with the present load."""

    equipment: Equipment  #: equipment with this load
    is_stronger: bool  #: whether the force is greater; else the hook is farther out
    missing: int  #: number of readings until the goal is met

    @property
    def words(self) -> str:
        """Load in words, as a condition."""
        if self.is_stronger:
            return f"with {figure(self.equipment.loads.force)} N, if the arm may carry it,"
        x, y, z = (figure(1e3 * coordinate) for coordinate in self.equipment.load_point)
        return f"with the load farther out, at {x}, {y}, {z} mm in the flange frame,"


@dataclass(frozen=True, eq=False)
class Progress:
    """Readings of a live campaign compared with the goal of the campaign."""

    candidates: CandidateReadings  #: candidates for further readings, and the robot
    goal: Goal  #: goal, which was declared before the first reading
    so_far: ReadingsSoFar  #: readings so far, and the results of their checks
    priors: Mapping[str, StiffnessPrior]  #: prior stiffnesses by name of the joint
    weight: OwnWeight | None = None  #: options to identify by own weight; None with loads

    @property
    def count(self) -> int:
        """Number of readings that count."""
        return 0 if self.so_far.measurements is None else len(self.so_far.measurements)

    def compare_reading(self, readings: Measurements) -> tuple[Innovation | None, HeldOut | None]:
        """Compare a new reading with its prediction from the readings so far.

        Args:
            readings: readings so far, and the new reading last.

        Returns:
            The comparison, None if the readings so far cannot predict the new reading; and the check of the
            new reading with the 90 % ball about its prediction, None if the new reading is not held out.
        """
        fitted, robot = self._fitted, self.candidates.robot
        if self.weight is not None or readings.direction is not None or fitted is None:
            return None, None
        readings = replace(readings, scatter=fitted.scatter)
        found = compare_last_reading(robot, readings, fitted.compliance)
        if not self.awaits_held_out or found.doubtful:
            return found, None
        return found, check_held_out_reading(robot, readings, fitted.compliance, len(readings) - 1)

    @cached_property
    def _fitted(self) -> _Fitted | None:
        """Fit of the joints to the readings that count; None if the readings do not identify any joint."""
        robot, measurements = self.candidates.robot, self.so_far.measurements
        if measurements is None:
            return None
        try:
            joints = JointsAlone(Rows(robot, measurements), Settings.from_options(RunOptions(), robot))
            compliance = np.maximum(joints.estimate.compliance, 0.0)
            return _Fitted(compliance, joints.measurements.scatter, joints.identified.posterior)
        except JointstiffError:
            return None

    @cached_property
    def result(self) -> RunResult | JointstiffError | None:
        """Result of the identification from the readings so far, with the priors in use.

        An error if the identification fails; None before the first reading.
        """
        priors = self.priors_in_use
        return self._identify_with_priors(priors) if priors else self._result_without_priors

    @cached_property
    def _result_without_priors(self) -> RunResult | JointstiffError | None:
        """Result of the identification without any prior, or its error; None before the first reading."""
        return self._identify_with_priors({})

    def _identify_with_priors(
        self, priors: Mapping[str, StiffnessPrior]
    ) -> RunResult | JointstiffError | None:
        """Identify the joints from the readings so far, with priors of their stiffnesses.

        Return the result; the error if the run fails; None without readings.
        """
        if self.so_far.measurements is None:
            return None
        try:
            options = RunOptions(elasticity="joints", priors=dict(priors))
            if self.weight is not None:
                options = RunOptions(weight=self.weight)
            return run(self.candidates.robot, self.so_far.measurements, options, self.so_far.noticed)
        except JointstiffError as error:
            return error

    @cached_property
    def prior_standings(self) -> dict[str, Standing]:
        """State of each prior, by the name of the joint: "counts" (is used), "waits" or "deviates"."""
        if not self.priors or self.weight is not None:
            return {}
        from_readings_alone = self._extract_known_compliances(self._result_without_priors, assumed=True)
        return compare_priors(self.candidates.robot.joint_names, from_readings_alone, self.priors)

    @property
    def priors_in_use(self) -> dict[str, StiffnessPrior]:
        """Priors that the identification uses (state "counts"), by the name of the joint."""
        return {name: self.priors[name] for name, each in self.prior_standings.items() if each == "counts"}

    @cached_property
    def known(self) -> KnownCompliances:
        """Compliances from the readings so far; the covariance contains stated errors, not assumed errors."""
        known = self._extract_known_compliances(self.result, assumed=False)
        if self.weight is not None or self._fitted is None:
            return known
        return replace(known, scatter=self._fitted.scatter, posterior=self._fitted.posterior)

    def _extract_known_compliances(
        self, result: RunResult | JointstiffError | None, *, assumed: bool
    ) -> KnownCompliances:
        """Return the compliances of a result with their covariance.

        Args:
            result: result of a run; for an error or None all compliances are unknown (NaN).
            assumed: whether the covariance includes errors of load point and force that the user did not
                state.
        """
        robot = self.candidates.robot
        if not isinstance(result, RunResult):
            return KnownCompliances.before_any_reading(robot.n)
        compliance = np.array([joint.compliance or np.nan for joint in result.joints], dtype=np.float64)
        if result.budget is not None:
            ignored = set() if _residuals_may_exceed_noise(result.goodness) else {"model_error"}
            if not assumed:
                ignored |= {part.source for part in result.budget.components if "assumed" in part.source}
            covariance, factor = _combine_covariances(result.budget, robot.joint_names, ignored)
        else:
            u = np.array([joint.standard_uncertainty or np.nan for joint in result.joints], dtype=np.float64)
            covariance = np.diag(np.square(np.nan_to_num(u)))
            factor = student_quantile(0.975, None)
        known = np.diagonal(covariance) > 0.0
        return KnownCompliances(np.where(known, compliance, np.nan), covariance, factor)

    @cached_property
    def share(self) -> UncertaintyShare:
        """Uncertainty so far, relative to the uncertainty that the goal allows."""
        return self.candidates.compare_with_goal(self.goal, self.known)

    @property
    def doubtful(self) -> list[str]:
        """Labels of doubtful readings that the user neither withdrew nor kept."""
        settled = self.so_far.withdrawn | self.so_far.kept
        return [
            label
            for label in self.so_far.comparisons
            if label not in settled and self.find_comparison(label).doubtful
        ]

    def find_comparison(self, label: str) -> Innovation:
        """Return the comparison of a reading with its prediction at the time the reading came.

        If later readings have shown a mistake in the reading, the comparison is marked as doubtful, and its
        message describes the mistake.
        """
        comparison, mistake = self.so_far.comparisons[label], self.mistake
        if mistake is None or mistake.observation != label or comparison.doubtful:
            return comparison
        return replace(comparison, doubtful=True, causes=[], message=f"{mistake.message}; {mistake.remedy}")

    @cached_property
    def mistake(self) -> Finding | None:
        """Finding with the verdict not to use an observation; None if no observation is mistaken.

        At least `_FEWEST_TO_FIND_MISTAKE` readings are needed: if two readings disagree, either may be wrong.
        Findings about the whole set, such as links that bend, do not count: the model error covers them. A
        finding about an observation that the user did not keep is returned in preference.
        """
        if self.count < _FEWEST_TO_FIND_MISTAKE or not isinstance(self.result, RunResult):
            return None
        kept = self.so_far.kept
        wrong = [
            each
            for each in self.result.assessment.reasons
            if each.weight == "do_not_use" and each.observation
        ]
        if kept:
            # A reason represents all findings with its code. If it is about a kept observation, another
            # finding with this code may be about an observation that was not kept.
            codes = {each.code for each in wrong}
            severe = [each for each in self.so_far.noticed if each.weight == "do_not_use"]
            wrong = [each for each in severe if each.observation and each.code in codes] + wrong
        return min(wrong, key=lambda each: each.observation in kept, default=None)

    @property
    def fewest_readings(self) -> int:
        """Fewest readings with which the goal can be met: more if a model error is likely."""
        result = self.result
        has_model_error = isinstance(result, RunResult) and _residuals_may_exceed_noise(result.goodness)
        return FEWEST_WITH_MODEL_ERROR if has_model_error else FEWEST

    @property
    def goal_is_met(self) -> bool:
        """True if enough readings meet the goal, and no reading is doubtful or mistaken."""
        return self._uncertainty_suffices and self.mistake is None

    @property
    def _uncertainty_suffices(self) -> bool:
        """True if there are enough readings, none is doubtful, and the goal allows the uncertainty."""
        return self.count >= self.fewest_readings and not self.doubtful and self.share.greatest_share <= 1.0

    @property
    def is_checked(self) -> bool:
        """True if the last reading was held out, and lies in the 90 % ball about its prediction."""
        return self.so_far.check is not None and self.so_far.check.inside

    @property
    def awaits_held_out(self) -> bool:
        """True if the next reading will be held out: the goal is met, or will be met with this reading."""
        if self.count < self.fewest_readings or self.doubtful:
            return False
        if self._uncertainty_suffices:
            return self.goal_is_met and not self.is_checked
        # With a model error the forecast is less certain: the goal has to be met first.
        return self.fewest_readings == FEWEST and self.next is not None and self.next.missing == 1

    @cached_property
    def next(self) -> NextReading | None:
        """Posture and load of the next reading; None if no candidate remains."""
        m = self.so_far.measurements
        present_posture = None if m is None else m.joints[-1]
        return self._choose_next(self._present_candidates, present_posture)

    @cached_property
    def _present_candidates(self) -> CandidateReadings:
        """Candidate readings with the hook of the last reading: whoever moves the hook goes on with it.

        The hook is the declared one if no further reading is feasible with that of the last reading, which is
        then hardly where the reading states it.
        """
        m = self.so_far.measurements
        if m is None or self.weight is not None:
            return self.candidates
        try:
            return self.candidates.with_load_point(m.load_point[-1])
        except RequestError:
            return self.candidates

    def _choose_next(
        self, candidates: CandidateReadings, present_posture: FloatArray | None
    ) -> NextReading | None:
        """Choose the next of some candidate readings; None if no candidate remains.

        `present_posture` (n,) is that of the arm [rad]; None if travel does not matter.
        """
        m = self.so_far.measurements
        excluded = np.array(self.so_far.skipped, dtype=np.float64).reshape(-1, candidates.robot.n)
        if m is not None:
            excluded = np.concatenate([excluded, m.joints])
        return candidates.choose_next(self.goal, self.known, m, excluded, present_posture)

    @cached_property
    def other_load(self) -> OtherLoad | None:
        """Load with which the goal needs at most half as many further readings; None if there is none.

        A hook that is farther out is preferred to a greater force, which the arm may not carry.
        """
        missing = self._missing
        is_far = missing is None or missing >= _MANY
        if not (is_far and isinstance(self.result, RunResult)):
            return None
        found = list[OtherLoad]()
        present_force = self._present_candidates.request.equipment.loads.force
        for candidates in self._present_candidates.with_other_loads:
            following = self._choose_next(candidates, None)
            if following is None or following.missing is None:
                continue
            equipment = candidates.request.equipment
            found.append(OtherLoad(equipment, equipment.loads.force > present_force, following.missing))
        best = min(found, key=lambda each: (each.missing, each.is_stronger), default=None)
        if best is None or (missing is not None and 2 * best.missing > missing):
            return None
        return best

    @property
    def _missing(self) -> int | None:
        """Predicted number of readings until the uncertainty meets the goal; None before the first reading.

        None also if more readings than can be predicted are missing, so that the goal is out of reach.
        """
        return self.next.missing if self.next is not None and self.count else None

    @property
    def still_needed(self) -> int | None:
        """Number of readings still to be taken, the held-out reading included; None if unknown."""
        if self.goal_is_met:
            return 0 if self.is_checked else 1
        # The number is unknown until a mistake is corrected, and until the readings determine each joint:
        # before, the effect of errors that are fitted with the joints is unknown.
        if self.mistake is not None or not np.isfinite(self.share.greatest_share):
            return None
        missing = self._missing
        return None if missing is None else self._count_with_check(missing)

    def _count_with_check(self, missing: int) -> int:
        """Return the number of further readings, the held-out reading included.

        `missing` is the number until the uncertainty meets the goal.
        """
        to_fewest = self.fewest_readings - self.count
        if self.fewest_readings == FEWEST:
            # The last of the missing readings is the held-out reading; see `awaits_held_out`.
            return max(missing, to_fewest + 1)
        return max(missing, to_fewest) + 1

    @property
    def reason_of_next(self) -> str:
        """Reason why this reading is next, in words."""
        joint = self.share.joint
        if self.awaits_held_out:
            return "the reading is held out, to check its prediction from the other readings"
        if joint is not None:
            name = self.candidates.robot.joint_names[joint]
            return f"the reading most improves {name}, the joint that is farthest from the goal"
        if isinstance(self.goal, JointsGoal):
            return "the reading most reduces the uncertainty of the joints"
        return "the reading most reduces the uncertainty of the deflection in the work area"

    def describe_state(self) -> tuple[Literal["measuring", "reached", "cannot"], str]:
        """Return the state of the campaign, and a sentence that explains the state."""
        read = "1 reading" if self.count == 1 else f"{self.count} readings"
        if self.doubtful:
            label = self.doubtful[-1]
            return "measuring", f"{label} is doubtful: {self.find_comparison(label).message or ''}"
        if self.goal_is_met:
            return self._describe_check_state(read)
        if self.mistake is not None:
            return self._describe_mistake_state(self.mistake)
        missing = self.still_needed
        if self.count >= ENOUGH_TO_SAY and self._missing is None:
            obstacle = self._describe_obstacle()
            return "cannot", f"the goal will not be met: {obstacle}{self._describe_other_load()}"
        if isinstance(self.result, JointstiffError):
            does = "does" if self.count == 1 else "do"
            return "measuring", f"{read} {does} not give a result yet: {self.result.reason}"
        left = "" if missing is None else f"; about {missing} more{self._describe_other_load()}"
        if 0 < self.count < self.fewest_readings and self.share.greatest_share <= 1.0:
            left = f": the goal needs {self.fewest_readings} readings and then a held-out reading{left}"
        return "measuring", f"{read}{left}"

    def _describe_mistake_state(self, wrong: Finding) -> tuple[Literal["measuring", "cannot"], str]:
        """Return state and sentence of a campaign with a mistaken reading that was not withdrawn."""
        explanation = f"{wrong.observation}: {wrong.message}; {wrong.remedy}"
        if self.count >= ENOUGH_TO_SAY:
            return "cannot", f"the goal will not be met by these readings: {explanation}"
        return "measuring", f"do not use these readings yet: {explanation}"

    def _describe_check_state(self, read: str) -> tuple[Literal["measuring", "reached"], str]:
        """Return state and sentence of a campaign whose goal is met.

        The state is "reached" if a held-out reading has confirmed the prediction, else "measuring".

        Args:
            read: number of readings in words, such as "6 readings".
        """
        if self.is_checked:
            confirmed = "the held-out reading is as near to its prediction as 90 % of good readings"
            answer = self._describe_decision() + self._describe_assumed_errors()
            return "reached", f"reached after {read}{answer}; {confirmed}"
        check = self.so_far.check
        is_far = "is further from its prediction than 90 % of good readings"
        failed = "" if check is None else f"held-out {check.label} {is_far}; "
        return "measuring", f"{failed}the goal is met; one held-out reading checks it"

    def _describe_decision(self) -> str:
        """Return whether the deflection is below the limit, if this is the goal; else an empty string."""
        share = self.share
        if not isinstance(self.goal, DecisionGoal) or share.greatest is None or share.uncertainty is None:
            return ""
        side = "below" if share.greatest < self.goal.limit else "above"
        deflection = f"{length_text(share.greatest)} ± {length_text(share.uncertainty)} (95 %)"
        limit = length_text(self.goal.limit)
        return f": the greatest deflection in the work area is {deflection}, {side} {limit}"

    def _describe_assumed_errors(self) -> str:
        """Return a remark if assumed errors would raise the uncertainty above the goal; else an empty string.

        Assumed errors are those of load point and force that the user did not state.
        """
        if not isinstance(self.goal, JointsGoal):
            return ""
        whole = self._extract_known_compliances(self.result, assumed=True)
        half = whole.factor * np.sqrt(np.diagonal(whole.covariance)) / whole.compliance
        meets_goal = self.known.relative_uncertainty <= self.goal.relative
        greatest = float(np.max(half, initial=0.0, where=meets_goal))
        if not greatest > self.goal.relative:
            return ""
        return (
            f"; without the assumed errors of load point and force (± {100 * greatest:.0f} % with these "
            "errors)"
        )

    def _describe_other_load(self) -> str:
        """Return which load meets the goal with fewer readings; an empty string if there is none."""
        other = self.other_load
        if other is None:
            return ""
        needed = self._count_with_check(other.missing)
        return f"; {other.words} about {needed} more would meet the goal"

    def _describe_obstacle(self) -> str:
        """Return a sentence that names the joint or the deflection that keeps the goal from being met."""
        share, result, names = self.share, self.result, self.candidates.robot.joint_names
        if share.joint is None:
            uncertainty = "unknown" if share.uncertainty is None else length_text(share.uncertainty)
            return (
                f"the uncertainty of the deflection in the work area is {uncertainty}, and more readings "
                "reduce it only a little"
            )
        parts = {part.joint: part for part in result.contributions} if isinstance(result, RunResult) else {}
        contribution = parts.get(names[share.joint])
        carries = (
            "" if contribution is None else f" causes {100 * contribution.mean:.1f} % of the deflection, and"
        )
        return f"{names[share.joint]}{carries} will not be known accurately enough"

    def list_joints(self) -> list[LiveJoint]:
        """Return stiffness, interval and uncertainty of each joint.

        The relative uncertainty is given without and with assumed errors of load point and force.
        """
        whole = self._extract_known_compliances(self.result, assumed=True)
        robot = self.candidates.robot
        joints = []
        half = whole.factor * np.sqrt(np.diagonal(whole.covariance))
        for j, (name, kind) in enumerate(zip(robot.joint_names, robot.joint_kinds, strict=True)):
            c = float(self.known.compliance[j])
            h = float(half[j])
            prior = self.prior_standings.get(name)
            if not np.isfinite(c):
                unknown_joint = LiveJoint(name=name, kind=kind, stiffness=None, interval=None, relative=None)
                is_twisted = j in self.candidates.twisted_joints
                reason = None if is_twisted else f"the load never {JOINT_UNITS[kind].loads} this joint"
                joints.append(unknown_joint.model_copy(update={"prior": prior, "reason": reason}))
                continue
            joints.append(
                LiveJoint(
                    name=name,
                    kind=kind,
                    stiffness=1.0 / c,
                    interval=stiffness_interval((max(c - h, 0.0), c + h)),
                    relative=float(self.known.relative_uncertainty[j]),
                    relative_with_assumed=h / c,
                    prior=prior,
                )
            )
        return joints


def _residuals_may_exceed_noise(goodness: Goodness) -> bool:
    """Return whether residuals may be greater than noise explains, so that a model error is likely.

    If sigma was computed from the residuals, they cannot be compared with noise, and a model error is
    assumed.
    """
    if goodness.sigma_source == "residuals":
        return True
    return float(special.chdtrc(goodness.degrees_of_freedom, goodness.chi_square)) < _SIGNIFICANT


def _combine_covariances(
    budget: Budget, names: Sequence[str], ignored: Collection[str]
) -> tuple[FloatArray, float]:
    """Add the covariances of the components of an uncertainty budget, including the model error.

    Args:
        budget: uncertainty budget of a run.
        names: names of the n joints.
        ignored: sources of uncertainty that are not added.

    Returns:
        The covariance (n, n) of the compliances [(rad/(N·m))²]; and the coverage factor of 95 %, from
        Student's distribution with the least effective degrees of freedom of a joint (Welch-Satterthwaite,
        GUM G.4).
    """
    in_budget = [names.index(name) for name in budget.joints]
    # The sum of u⁴ over degrees of freedom is the denominator of the formula of Welch and Satterthwaite.
    total = np.zeros((len(in_budget), len(in_budget)))
    denominator = np.zeros(len(in_budget))
    for part in budget.components:
        counts = part.included or part.source == "model_error"
        if not counts or part.source in ignored:
            continue
        u = np.array(part.contributions)
        total += np.array(part.correlation) * np.outer(u, u)
        if part.degrees_of_freedom is not None:
            denominator += u**4 / part.degrees_of_freedom
    numerator = np.square(np.diagonal(total))
    is_finite = denominator > 0.0
    effective = np.where(is_finite, numerator / np.where(is_finite, denominator, 1.0), np.inf)
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(in_budget, in_budget)] = total
    least = float(effective.min()) if len(in_budget) else np.inf
    return covariance, student_quantile(0.975, least if np.isfinite(least) else None)
