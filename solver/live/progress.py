"""Progress of a live campaign: what its readings say so far, whether they suffice, and what comes next.

A goal is met by enough readings, none of them doubtful or mistaken, whose uncertainty is that of the goal; a
reading that was held out then lies in the ball of its prediction.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.live import LiveJoint
from jointstiff.schemas.options import OwnWeight, RunOptions, StiffnessPrior
from jointstiff.schemas.plan import Goal, JointsGoal
from jointstiff.schemas.run import Budget, Goodness, RunResult
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.estimation.estimate import stiffness_interval
from jointstiff.solver.estimation.fit import student_quantile
from jointstiff.solver.estimation.joints import JointsAlone
from jointstiff.solver.estimation.method import Settings
from jointstiff.solver.live.ahead import CandidateReadings, KnownCompliances, NextReading, UncertaintyShare
from jointstiff.solver.live.innovation import (
    HeldOut,
    Innovation,
    check_held_out_reading,
    compare_last_reading,
)
from jointstiff.solver.live.priors import Standing, compare_priors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.run import run
from jointstiff.solver.text import length_text

FEWEST: Final = 5
"""Number of readings before a goal can be met."""
FEWEST_WITH_MODEL_ERROR: Final = 10
"""The same where residuals may be more than noise: a ball of 90 % about a prediction needs nine postures."""
_FEWEST_THAT_TELL: Final = 3
"""Number of readings from which on they show a mistake in one of them."""
ENOUGH_TO_SAY: Final = 10
"""Number of readings from which on a goal is reported as out of reach."""
_SHOWS: Final = 0.2
"""Probability of residuals as great as these by stated noise alone, above which nothing shows that joints
and loads explain too little."""


@dataclass(frozen=True, eq=False)
class ReadingsSoFar:
    """Readings of a live campaign, with what was found about each of them."""

    measurements: Measurements | None = None  #: readings that count; None before the first
    noticed: tuple[Finding, ...] = ()  #: findings of the integrity checks of these
    judged: Mapping[str, Innovation] = field(
        default_factory=dict
    )  #: each reading when it came, by its label; withdrawn ones, too
    withdrawn: frozenset[str] = frozenset()  #: labels
    kept: frozenset[str] = frozenset()  #: labels of doubtful readings that were kept
    skipped: tuple[tuple[float, ...], ...] = ()  #: postures that were left out [rad or m]
    check: HeldOut | None = None  #: the last reading that counts, if it was held out


@dataclass(frozen=True, eq=False)
class Progress:
    """A campaign's readings compared with its goal."""

    ahead: CandidateReadings  #: candidates of the readings to come, and the robot
    goal: Goal  #: declared before the first reading
    taken: ReadingsSoFar  #: readings so far
    priors: Mapping[str, StiffnessPrior]  #: prior stiffnesses by name of the joint
    weight: OwnWeight | None = None  #: options to identify by own weight; None with loads

    @property
    def count(self) -> int:
        """Number of readings that count."""
        return 0 if self.taken.measurements is None else len(self.taken.measurements)

    def compare_reading(self, readings: Measurements) -> tuple[Innovation | None, HeldOut | None]:
        """Compare a new reading with the readings so far.

        Args:
            readings: readings so far, and the new one last.

        Returns:
            The comparison with the prediction from the readings so far, None if they cannot predict it; and,
            if the new reading is held out, its place in the 90 % ball about the prediction, else None.
        """
        compliance, robot = self._compliance, self.ahead.robot
        if self.weight is not None or readings.direction is not None or compliance is None:
            return None, None
        found = compare_last_reading(robot, readings, compliance)
        if not self.awaits_held_out or found.doubtful:
            return found, None
        return found, check_held_out_reading(robot, readings, compliance, len(readings) - 1)

    @cached_property
    def _compliance(self) -> FloatArray | None:
        """(n,) compliances by the readings that count [rad/(N·m)]; None if they cannot be identified."""
        robot, measurements = self.ahead.robot, self.taken.measurements
        if measurements is None:
            return None
        try:
            estimate = JointsAlone(robot, measurements, Settings.from_options(RunOptions(), robot)).estimate
        except JointstiffError:
            return None
        return np.maximum(estimate.compliance, 0.0)

    @cached_property
    def result(self) -> RunResult | JointstiffError | None:
        """Result of the readings so far, with the priors in use; the error if the identification fails.

        It is None before the first reading.
        """
        priors = self.priors_in_use
        return self._identify_with_priors(priors) if priors else self._result_without_priors

    @cached_property
    def _result_without_priors(self) -> RunResult | JointstiffError | None:
        """Result of the readings so far without any prior, or the error; None before the first reading."""
        return self._identify_with_priors({})

    def _identify_with_priors(
        self, priors: Mapping[str, StiffnessPrior]
    ) -> RunResult | JointstiffError | None:
        """Identify the joints from the readings so far, with priors; return the error if this fails."""
        if self.taken.measurements is None:
            return None
        try:
            options = RunOptions(elasticity="joints", priors=dict(priors))
            if self.weight is not None:
                options = RunOptions(weight=self.weight)
            return run(self.ahead.robot, self.taken.measurements, options, self.taken.noticed)
        except JointstiffError as error:
            return error

    @cached_property
    def standings(self) -> dict[str, Standing]:
        """State of each prior by the name of its joint: "counts" (is used), "waits" or "deviates"."""
        if not self.priors or self.weight is not None:
            return {}
        own = self._extract_known_compliances(self._result_without_priors, assumed=True)
        return compare_priors(self.ahead.robot.joint_names, own, self.priors)

    @property
    def priors_in_use(self) -> dict[str, StiffnessPrior]:
        """Priors that the estimate uses, by the name of the joint; the others wait or deviate."""
        return {name: self.priors[name] for name, each in self.standings.items() if each == "counts"}

    @cached_property
    def known(self) -> KnownCompliances:
        """Compliances from the readings so far; their covariance contains stated errors, not assumed ones."""
        return self._extract_known_compliances(self.result, assumed=False)

    def _extract_known_compliances(
        self, result: RunResult | JointstiffError | None, *, assumed: bool
    ) -> KnownCompliances:
        """Return the compliances of a result with their covariance.

        Args:
            result: result of a run; an error or None gives a state in which nothing is known.
            assumed: whether the covariance includes errors that were assumed, not stated.
        """
        robot = self.ahead.robot
        if not isinstance(result, RunResult):
            return KnownCompliances.before_any_reading(robot.n)
        compliance = np.array([joint.compliance or np.nan for joint in result.joints], dtype=np.float64)
        if result.budget is not None:
            left_out = set() if _residuals_may_exceed_noise(result.goodness) else {"model_error"}
            if not assumed:
                left_out |= {part.source for part in result.budget.components if "assumed" in part.source}
            covariance, factor = _combine_covariances(result.budget, robot.joint_names, left_out)
        else:
            u = np.array([joint.standard_uncertainty or np.nan for joint in result.joints], dtype=np.float64)
            covariance, factor = np.diag(np.square(np.nan_to_num(u))), student_quantile(0.975, None)
        known = np.diagonal(covariance) > 0.0
        return KnownCompliances(np.where(known, compliance, np.nan), covariance, factor)

    @cached_property
    def share(self) -> UncertaintyShare:
        """Uncertainty so far compared with that of the goal."""
        return self.ahead.compare_with_goal(self.goal, self.known)

    @property
    def doubtful(self) -> list[str]:
        """Labels of doubtful readings that were neither withdrawn nor kept."""
        settled = self.taken.withdrawn | self.taken.kept
        return [
            label
            for label in self.taken.judged
            if label not in settled and self.find_comparison(label).doubtful
        ]

    def find_comparison(self, label: str) -> Innovation:
        """Return the comparison of a reading when it came, with a mistake that later readings have shown."""
        found, mistake = self.taken.judged[label], self.mistake
        if mistake is None or mistake.observation != label or found.doubtful:
            return found
        return replace(found, doubtful=True, causes=[], message=f"{mistake.message}; {mistake.remedy}")

    @cached_property
    def mistake(self) -> Finding | None:
        """Finding that says not to use an observation; None if no observation is mistaken.

        At least `_FEWEST_THAT_TELL` readings are needed: if two readings disagree, either may be wrong.
        Findings about the whole set, such as links that bend, are not counted: the model error covers them.
        """
        if self.count < _FEWEST_THAT_TELL or not isinstance(self.result, RunResult):
            return None
        kept = self.taken.kept
        wrong = [
            each
            for each in self.result.assessment.reasons
            if each.weight == "do_not_use" and each.observation
        ]
        if kept:  # a reason represents all findings of its kind, so the kind is searched for others
            kinds = {each.code for each in wrong}
            found = [each for each in self.taken.noticed if each.weight == "do_not_use"]
            wrong = [each for each in found if each.observation and each.code in kinds] + wrong
        return min(wrong, key=lambda each: each.observation in kept, default=None)

    @property
    def fewest(self) -> int:
        """Number of readings before the goal can be met."""
        result = self.result
        lacks = isinstance(result, RunResult) and _residuals_may_exceed_noise(result.goodness)
        return FEWEST_WITH_MODEL_ERROR if lacks else FEWEST

    @property
    def met(self) -> bool:
        """True if enough readings meet the goal, and none of them is doubtful or mistaken."""
        return self._uncertainty_suffices and self.mistake is None

    @property
    def _uncertainty_suffices(self) -> bool:
        """True if there are enough readings, none is doubtful, and the uncertainty is at most the goal's."""
        return self.count >= self.fewest and not self.doubtful and self.share.greatest_share <= 1.0

    @property
    def is_checked(self) -> bool:
        """True if the last reading was held out and lies in the 90 % ball about its prediction."""
        return self.taken.check is not None and self.taken.check.inside

    @property
    def awaits_held_out(self) -> bool:
        """True if the next reading is held out: the goal is met, or is expected to be met with it."""
        if self.count < self.fewest or self.doubtful:
            return False
        if self._uncertainty_suffices:
            return self.met and not self.is_checked
        # With a model error the forecast is less certain: the goal has to be met first.
        return self.fewest == FEWEST and self.next is not None and self.next.missing == 1

    @cached_property
    def next(self) -> NextReading | None:
        """The next reading; None if no candidate is left."""
        m = self.taken.measurements
        taken = np.array(self.taken.skipped, dtype=np.float64).reshape(-1, self.ahead.robot.n)
        if m is not None:
            taken = np.concatenate([taken, m.joints])
        return self.ahead.choose_next(self.goal, self.known, m, taken, None if m is None else m.joints[-1])

    @property
    def still_needed(self) -> int | None:
        """Number of readings still to be taken, the held-out reading included; None if unknown."""
        if self.met:
            return 0 if self.is_checked else 1
        if self.mistake is not None:  # the mistake has to be mended first
            return None
        missing = self.next.missing if self.next is not None and self.count else None
        if missing is None:
            return None
        left = self.fewest - self.count
        return max(missing, left + 1) if self.fewest == FEWEST else max(missing, left) + 1

    @property
    def reason_of_next(self) -> str:
        """Reason in words why the next reading is taken."""
        joint = self.share.joint
        if self.awaits_held_out:
            return "it is held out, to check the prediction by the other readings"
        if joint is not None:
            name = self.ahead.robot.joint_names[joint]
            return f"it helps {name} most, the joint that is farthest from the goal"
        if isinstance(self.goal, JointsGoal):
            return "it reduces the uncertainty of the joints most"
        return "it reduces the uncertainty of the deflection in the work area most"

    def state(self) -> tuple[Literal["measuring", "reached", "cannot"], str]:
        """Return the state of the campaign, and a sentence that explains the state."""
        read = "1 reading" if self.count == 1 else f"{self.count} readings"
        if self.doubtful:
            label = self.doubtful[-1]
            return "measuring", f"{label} is doubtful: {self.find_comparison(label).message or ''}"
        if self.met:
            return self._describe_check_state(read)
        if self.mistake is not None:
            return self._describe_mistake_state(self.mistake)
        missing = self.still_needed
        if self.count >= ENOUGH_TO_SAY and missing is None:
            return "cannot", f"the goal will not be met: {self._describe_obstacle()}"
        if isinstance(self.result, JointstiffError):
            does = "does" if self.count == 1 else "do"
            return "measuring", f"{read} {does} not give a result yet: {self.result.reason}"
        left = "" if missing is None else f"; about {missing} more"
        if 0 < self.count < self.fewest and self.share.greatest_share <= 1.0:
            left = f": the goal needs {self.fewest} readings and then a held-out one{left}"
        return "measuring", f"{read}{left}"

    def _describe_mistake_state(self, wrong: Finding) -> tuple[Literal["measuring", "cannot"], str]:
        """Return state and sentence of a campaign with a mistaken reading that was not withdrawn."""
        words = f"{wrong.observation}: {wrong.message}; {wrong.remedy}"
        if self.count >= ENOUGH_TO_SAY:
            return "cannot", f"the goal will not be met by these readings: {words}"
        return "measuring", f"do not use these readings yet: {words}"

    def _describe_check_state(self, read: str) -> tuple[Literal["measuring", "reached"], str]:
        """Return state and sentence of a campaign whose goal is met: checked by a held-out reading, or not.

        Args:
            read: number of readings in words.
        """
        if self.is_checked:
            near = "the held-out one is as near to its prediction as 90 % of good readings"
            return "reached", f"reached after {read}{self._describe_assumed_errors()}; {near}"
        far, check = "is further from its prediction than 90 % of good readings", self.taken.check
        failed = "" if check is None else f"held-out {check.label} {far}; "
        return "measuring", f"{failed}the goal is met; one held-out reading checks it"

    def _describe_assumed_errors(self) -> str:
        """Return a remark if assumed errors raise the uncertainty above the goal; else an empty string."""
        if not isinstance(self.goal, JointsGoal):
            return ""
        whole = self._extract_known_compliances(self.result, assumed=True)
        half = whole.factor * np.sqrt(np.diagonal(whole.covariance)) / whole.compliance
        greatest = float(np.max(half, initial=0.0, where=self.known.relative <= self.goal.relative))
        if not greatest > self.goal.relative:
            return ""
        return f", without the assumed errors of load point and force (with them ± {100 * greatest:.0f} %)"

    def _describe_obstacle(self) -> str:
        """Return a sentence that names the joint or the deflection that keeps the goal from being met."""
        share, result, names = self.share, self.result, self.ahead.robot.joint_names
        if share.joint is None:
            reached = "unknown" if share.uncertainty is None else length_text(share.uncertainty)
            return f"the deflection in the work area is known to {reached}, and more readings help little"
        parts = {part.joint: part for part in result.contributions} if isinstance(result, RunResult) else {}
        contribution = parts.get(names[share.joint])
        carries = (
            "" if contribution is None else f" carries {100 * contribution.mean:.1f} % of the deflection, and"
        )
        return f"{names[share.joint]}{carries} will not be known well enough"

    def joints(self) -> list[LiveJoint]:
        """Return stiffness, interval and uncertainty of each joint, without and with assumed errors."""
        whole, robot, joints = (
            self._extract_known_compliances(self.result, assumed=True),
            self.ahead.robot,
            [],
        )
        half = whole.factor * np.sqrt(np.diagonal(whole.covariance))
        for j, (name, kind) in enumerate(zip(robot.joint_names, robot.joint_kinds, strict=True)):
            c, h, prior = float(self.known.compliance[j]), float(half[j]), self.standings.get(name)
            if not np.isfinite(c):
                nothing = LiveJoint(name=name, kind=kind, stiffness=None, interval=None, relative=None)
                reason = None if j in self.ahead.wanted else f"the load never {JOINT_UNITS[kind].loads} it"
                joints.append(nothing.model_copy(update={"prior": prior, "reason": reason}))
                continue
            joints.append(
                LiveJoint(
                    name=name,
                    kind=kind,
                    stiffness=1.0 / c,
                    interval=stiffness_interval((max(c - h, 0.0), c + h)),
                    relative=float(self.known.relative[j]),
                    relative_with_assumed=h / c,
                    prior=prior,
                )
            )
        return joints


def _residuals_may_exceed_noise(goodness: Goodness) -> bool:
    """Return whether residuals may be greater than noise explains, so that a model error is likely."""
    if goodness.sigma_source == "residuals":
        return True
    return float(special.chdtrc(goodness.degrees_of_freedom, goodness.chi_square)) < _SHOWS


def _combine_covariances(
    budget: Budget, names: Sequence[str], left_out: Collection[str]
) -> tuple[FloatArray, float]:
    """Combine the components of an uncertainty budget, and its model error, to one covariance.

    Args:
        budget: uncertainty budget of a run.
        names: names of the n joints.
        left_out: sources of uncertainty that are ignored.

    Returns:
        The covariance (n, n) of the compliances [(rad/(N·m))²]; and the coverage factor of 95 %: Student's
        distribution with the least effective degrees of freedom of a joint (Welch-Satterthwaite, GUM G.4).
    """
    shown = [names.index(name) for name in budget.joints]
    total, by_freedom = np.zeros((len(shown), len(shown))), np.zeros(len(shown))
    for part in budget.components:
        counts = part.included or part.source == "model_error"
        if not counts or part.source in left_out:
            continue
        u = np.array(part.contributions)
        total += np.array(part.correlation) * np.outer(u, u)
        if part.degrees_of_freedom is not None:
            by_freedom += u**4 / part.degrees_of_freedom
    whole = np.square(np.diagonal(total))
    effective = np.where(by_freedom > 0.0, whole / np.where(by_freedom > 0.0, by_freedom, 1.0), np.inf)
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(shown, shown)] = total
    least = float(effective.min()) if len(shown) else np.inf
    return covariance, student_quantile(0.975, least if np.isfinite(least) else None)
