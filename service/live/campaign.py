"""A campaign while it is measured: its record, and what the record says. No store."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from typing import Any, Final, Literal

import numpy as np
from scipy import special

from jointstiff.schemas import live
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.measurement import (
    MAX_NOTES_LENGTH,
    MeasurementSetDocument,
    MeasurementSetRequest,
    Observation,
    ResolvedFrame,
    SetChange,
)
from jointstiff.schemas.options import OwnWeight, RunOptions, StiffnessPrior
from jointstiff.schemas.plan import (
    DecisionGoal,
    DeflectionGoal,
    JointsGoal,
    PlannedReading,
    PlanRequest,
    ReadingOptions,
)
from jointstiff.schemas.run import Budget, Goodness, RunResult
from jointstiff.service.conversion.prepared import CheckedSet, PreparedSet, check_set
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.plan.work import to_design_request
from jointstiff.service.live.priors import Standing, standings
from jointstiff.service.problems import TakenError
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.estimation.estimate import stiffness_interval
from jointstiff.solver.estimation.fit import student_quantile
from jointstiff.solver.estimation.joints import JointsAlone
from jointstiff.solver.estimation.method import Settings
from jointstiff.solver.live.ahead import Ahead, Known, Next, Share
from jointstiff.solver.live.innovation import HeldOut, Innovation, held_out, innovation
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.run import run
from jointstiff.solver.text import length_text

FEWEST: Final = 5
"""Number of readings before a goal can be met."""
FEWEST_WITH_MODEL_ERROR: Final = 10
"""The same where residuals may be more than noise: a ball of 90 % about a prediction needs nine postures."""
_FEWEST_THAT_TELL: Final = 3
"""Number of readings from which on they show a mistake in one of them."""
ENOUGH_TO_SAY: Final = 10
"""Number of readings from which on it is said that a goal will not be met."""
MOST_READINGS: Final = 200
"""Observations of an open set."""
_OF_PRIORS: Final[Mapping[Standing, str]] = {
    "counts": "Prior knowledge counts",
    "deviates": "Prior knowledge does not count, as the readings disagree with it",
}
Change = Literal["observation", "withdrawn", "kept", "skipped", "closed"]


@dataclass(frozen=True)
class Entry:
    """An entry in the record of a campaign: a reading, or what became of one."""

    change: Change
    label: str  # of the observation; empty for the end
    observation: Observation | None = None
    innovation: Innovation | None = None  # of an observation
    held_out: HeldOut | None = None  # of an observation that came when the goal was met
    reason: str | None = None  # why it was withdrawn
    joints: tuple[float, ...] = ()  # posture that was skipped


@dataclass(frozen=True, eq=False)
class Declared:
    """Declaration of a campaign, made before its first reading."""

    robot: Robot
    header: live.MeasurementSetPost  # units, noise, frame, goal and equipment; without observations
    resolved: ResolvedFrame | None = None  # what its frame means
    noticed: Sequence[Finding] = ()  # about the frame

    @cached_property
    def options(self) -> live.LiveOptions:
        """Goal and equipment, with the targets and the load point of the set."""
        if self.header.open is None:
            raise ValueError("the set is not open")
        return self.header.open

    @cached_property
    def ahead(self) -> Ahead:
        """Candidates of the readings to come.

        Raises:
            RequestError: targets or loads are not said, a prior is of no joint or of no use, or no reading is
                feasible.
        """
        options, header = self.options, self.header
        if isinstance(options.goal, DeflectionGoal | DecisionGoal) and options.work_area is None:
            raise RequestError(
                "the goal is about deflections, and the work area is missing",
                where="open.work_area",
                remedy="give the corners of the box in which they matter, in R0, or the goal `joints`",
            )
        stated = options.model_dump(include=set(ReadingOptions.model_fields) - {"priors"})
        for name in options.priors:
            self.robot.joint_index(name, f"open.priors.{name}")
        if isinstance(options.load, OwnWeight) and options.priors:
            raise RequestError(
                "readings by own weight take no priors",
                where="open.priors",
                remedy="omit `priors`, or measure with a load",
            )
        expected = {name: prior.stiffness for name, prior in options.priors.items()}
        stated["stiffness"] = expected | options.stiffness  # a prior has to be tested before it counts
        noise = header.noise.sigma if header.noise is not None else None
        request = to_design_request(
            PlanRequest.model_validate({**stated, "robot_id": header.robot_id}),
            self.robot,
            nominal=np.full(self.robot.n, np.nan),
            sigma=None if noise is None else LENGTH[header.units.length] * noise,
            unexplained=None,
            so_far=None,
        )
        if options.load_point is None and not isinstance(options.load, OwnWeight):
            raise RequestError(
                "where the load acts is missing",
                where="open.load_point",
                remedy="give it in the flange frame, in metres, or `load_point` of the set in its unit",
            )
        force = None if isinstance(options.goal, JointsGoal) else options.goal.force
        return Ahead.of(self.robot, request, None if force is None else np.array(force))

    def document(self, observations: Sequence[Observation]) -> MeasurementSetDocument:
        """Return the set of some observations; their labels and readings were checked when they came."""
        fields = {name: getattr(self.header, name) for name in MeasurementSetDocument.model_fields}
        return MeasurementSetDocument.model_construct(**{**fields, "observations": list(observations)})

    def checked(self, observations: Sequence[Observation]) -> CheckedSet:
        """Check a set of observations.

        Raises:
            MeasurementError: they cannot be right.
        """
        return check_set(self.document(observations), self.robot, self.resolved, list(self.noticed))

    def prepared(self, observations: Sequence[Observation]) -> PreparedSet:
        """Return observations ready for computation; raises as `checked` does."""
        checked = self.checked(observations)
        return PreparedSet(
            self.robot, checked.measurements, checked.warnings, self.header.robot_id, checked.content_hash
        )


@dataclass(frozen=True, eq=False)
class LiveCampaign:
    """A campaign with the entries of its record so far. Each change gives another one."""

    declared: Declared
    entries: tuple[Entry, ...] = ()
    of_label: Mapping[str, Entry] = field(init=False)  # the observations

    def __post_init__(self) -> None:
        named = {entry.label: entry for entry in self.entries if entry.change == "observation"}
        object.__setattr__(self, "of_label", named)

    def with_entry(self, entry: Entry) -> LiveCampaign:
        """Return the campaign with one more entry; with one that it has, as it is."""
        if any(entry is each for each in self.entries):
            return self
        return LiveCampaign(self.declared, (*self.entries, entry))

    def _labels(self, change: Change) -> dict[str, Entry]:
        return {entry.label: entry for entry in self.entries if entry.change == change}

    @property
    def observations(self) -> list[Observation]:
        """The observations that count."""
        withdrawn = self._labels("withdrawn")
        return [
            entry.observation
            for label, entry in self.of_label.items()
            if label not in withdrawn and entry.observation is not None
        ]

    @property
    def closed(self) -> bool:
        """True once no reading comes any more."""
        return bool(self._labels("closed"))

    def judged(self, observation: Observation) -> Entry:
        """Return the entry of an observation; a new one is compared with those that count.

        Raises:
            TakenError: there is another observation of its label.
            RequestError: the set has as many as it takes.
            MeasurementError: it cannot be right.
        """
        known = self.of_label.get(observation.label)
        if known is not None and known.observation != observation:
            raise TakenError(observation.label)
        if known is not None:
            return known
        if len(self.of_label) >= MOST_READINGS:
            raise RequestError(
                f"an open set takes {MOST_READINGS} observations at most",
                where="label",
                remedy="close it, and open another one",
            )
        before = self.observations
        prepared = self.declared.prepared([*before, observation])
        if (
            not before
            or isinstance(self.declared.options.load, OwnWeight)
            or prepared.measurements.direction is not None
        ):
            return Entry("observation", observation.label, observation)
        compliance = self._compliance
        if compliance is None:
            return Entry("observation", observation.label, observation)
        robot, readings, last = self.declared.robot, prepared.measurements, None
        found = innovation(robot, readings, compliance)
        if self.awaits_held_out and not found.doubtful:
            last = held_out(robot, readings, compliance, len(before))
        return Entry("observation", observation.label, observation, found, last)

    @cached_property
    def _prepared(self) -> PreparedSet | None:
        observations = self.observations
        return self.declared.prepared(observations) if observations else None

    @cached_property
    def _compliance(self) -> FloatArray | None:
        """Compliances by the readings that count; None if they cannot be identified."""
        if self._prepared is None:
            return None
        try:
            settings = Settings.of(RunOptions(), self.declared.robot)
            estimate = JointsAlone(self.declared.robot, self._prepared.measurements, settings).estimate
        except JointstiffError:
            return None
        return np.maximum(estimate.compliance, 0.0)

    @cached_property
    def result(self) -> RunResult | JointstiffError | None:
        """The ordinary result of the readings so far, or why there is none; None before the first reading."""
        counting = self.run_options["priors"]
        return self._result(counting) if counting else self._own_result

    @cached_property
    def _own_result(self) -> RunResult | JointstiffError | None:
        return self._result({})

    def _result(self, priors: Mapping[str, StiffnessPrior]) -> RunResult | JointstiffError | None:
        if self._prepared is None:
            return None
        load = self.declared.options.load
        try:
            options = RunOptions(elasticity="joints", priors=dict(priors))
            if isinstance(load, OwnWeight):
                options = RunOptions(weight=load)
            prepared = self._prepared
            return run(prepared.robot, prepared.measurements, options, prepared.warnings)
        except JointstiffError as error:
            return error

    @cached_property
    def standings(self) -> dict[str, Standing]:
        """Standing of the prior of each joint that has one."""
        priors = self.declared.options.priors
        if not priors or isinstance(self.declared.options.load, OwnWeight):
            return {}
        own = self._known(self._own_result, assumed=True)
        return standings(self.declared.robot.joint_names, own, priors)

    @property
    def run_options(self) -> dict[str, Any]:
        """Options of the run: the weight of readings without a load, and the priors that count."""
        options, standing = self.declared.options, self.standings
        counting = {name: options.priors[name] for name in standing if standing[name] == "counts"}
        return {"weight": options.load if isinstance(options.load, OwnWeight) else None, "priors": counting}

    @cached_property
    def known(self) -> Known:
        """Compliances by the readings so far, with the stated errors."""
        return self._known(self.result, assumed=False)

    def _known(self, result: RunResult | JointstiffError | None, *, assumed: bool) -> Known:
        """Return what is known by a result, with or without errors of which nothing was stated."""
        n = self.declared.robot.n
        if not isinstance(result, RunResult):
            return Known.nothing(n)
        compliance = np.array([joint.compliance or np.nan for joint in result.joints], dtype=np.float64)
        if result.budget is not None:
            left_out = set() if _lacks(result.goodness) else {"model_error"}
            if not assumed:
                left_out |= {part.source for part in result.budget.components if "assumed" in part.source}
            covariance, factor = _spread(result.budget, self.declared.robot.joint_names, left_out)
        else:
            u = np.array([joint.standard_uncertainty or np.nan for joint in result.joints], dtype=np.float64)
            covariance, factor = np.diag(np.square(np.nan_to_num(u))), student_quantile(0.975, None)
        known = np.diagonal(covariance) > 0.0
        return Known(np.where(known, compliance, np.nan), covariance, factor)

    @cached_property
    def share(self) -> Share:
        """Uncertainty so far beside that of the goal."""
        return self.declared.ahead.reached(self.declared.options.goal, self.known)

    @property
    def doubtful(self) -> list[str]:
        """Labels of doubtful readings of which nothing became yet."""
        settled = self._labels("withdrawn") | self._labels("kept")
        return [label for label in self.of_label if label not in settled and self._innovation(label).doubtful]

    def _innovation(self, label: str) -> Innovation:
        """Return what a reading was when it came, or the mistake that all of them show in it by now."""
        found, mistake = self.of_label[label].innovation or Innovation(), self.mistake
        if mistake is None or mistake.observation != label or found.doubtful:
            return found
        return replace(found, doubtful=True, causes=[], message=f"{mistake.message}; {mistake.remedy}")

    @property
    def met(self) -> bool:
        """True if the goal is met by enough readings that can be used, none of them in doubt."""
        return self._is_small and self.mistake is None

    @property
    def _is_small(self) -> bool:
        """True if the uncertainty is that of the goal by enough readings, none of them in doubt."""
        enough = len(self.observations) >= self.fewest
        return enough and not self.doubtful and self.share.greatest_share <= 1.0

    @property
    def mistake(self) -> Finding | None:
        """The finding for which an observation is not to be used; None without one.

        Of two readings that disagree nobody knows which one is wrong. Other findings, such as links that
        bend, are no mistake of a reading: the model error counts them.
        """
        if len(self.observations) < _FEWEST_THAT_TELL or not isinstance(self.result, RunResult):
            return None
        reasons, kept = self.result.assessment.reasons, self._labels("kept")
        wrong = [each for each in reasons if each.weight == "do_not_use" and each.observation]
        if kept and self._prepared is not None:  # a reason stands for all findings of its kind
            kinds = {each.code for each in wrong}
            found = [each for each in self._prepared.warnings if each.weight == "do_not_use"]
            wrong = [each for each in found if each.observation and each.code in kinds] + wrong
        return min(wrong, key=lambda each: each.observation in kept, default=None)

    @property
    def fewest(self) -> int:
        """Number of readings before the goal can be met."""
        result = self.result
        lacks = isinstance(result, RunResult) and _lacks(result.goodness)
        return FEWEST_WITH_MODEL_ERROR if lacks else FEWEST

    @property
    def check(self) -> HeldOut | None:
        """The held-out reading that counts, if it is the last one."""
        observations = self.observations
        return self.of_label[observations[-1].label].held_out if observations else None

    @property
    def awaits_held_out(self) -> bool:
        """True if the next reading is held out: the goal is met, or is expected to be met with it."""
        if len(self.observations) < self.fewest or self.doubtful:
            return False
        if self._is_small:
            return self.met and (self.check is None or not self.check.inside)
        # Where the model errs, the goal is met before: its interval is less certain.
        return self.fewest == FEWEST and self.ahead is not None and self.ahead.missing == 1

    @cached_property
    def ahead(self) -> Next | None:
        """The next reading; None if no candidate is left."""
        m = None if self._prepared is None else self._prepared.measurements
        skipped = [entry.joints for entry in self.entries if entry.change == "skipped"]
        taken = np.array([*skipped], dtype=np.float64).reshape(-1, self.declared.robot.n)
        if m is not None:
            taken = np.concatenate([taken, m.joints])
        last = m.joints[-1] if m is not None else None
        return self.declared.ahead.next(self.declared.options.goal, self.known, m, taken, last)

    def state(self, measurement_set_id: str | None = None, run_id: str | None = None) -> live.LiveState:
        """Return what the record says, and what to do next; with the set and the run of a closed campaign."""
        result = self.result
        state, message = self._standing()
        following = None if self.closed or state == "reached" else self.next_reading()
        warnings = [] if self._prepared is None else list(self._prepared.warnings)
        share = self.share if self.observations else None
        known = share is not None and np.isfinite(share.greatest_share)
        return live.LiveState(
            revision=len(self.entries),
            state=state,
            message=message,
            goal=goal_text(self.declared.options),
            share=share.greatest_share if share is not None and known else None,
            still_needed=0 if state in ("reached", "closed") else self.still_needed,
            readings=self._record(),
            joints=_joints(
                self.declared.ahead, self.known, self._known(result, assumed=True), self.standings
            ),
            deflection_uncertainty=share.uncertainty if share is not None and known else None,
            greatest_deflection=share.greatest if share is not None and known else None,
            assessment=result.assessment if isinstance(result, RunResult) else None,
            next=following,
            warnings=warnings,
            measurement_set_id=measurement_set_id,
            run_id=run_id,
        )

    @property
    def still_needed(self) -> int | None:
        """Number of readings that are missing, the held-out one among them; None if unknown."""
        if self.met:
            return 0 if self.check is not None and self.check.inside else 1
        if self.mistake is not None:  # it has to be mended
            return None
        missing = self.ahead.missing if self.ahead is not None and self.observations else None
        if missing is None:
            return None
        left = self.fewest - len(self.observations)
        return max(missing, left + 1) if self.fewest == FEWEST else max(missing, left) + 1

    def next_reading(self) -> PlannedReading | None:
        """Return what to read next."""
        following = self.ahead
        if following is None:
            return None
        share, robot, goal = self.share, self.declared.robot, self.declared.options.goal
        if self.awaits_held_out:
            reason = "it is held out, and checks what the others say"
        elif share.joint is not None:
            reason = f"it tells most of {robot.joint_names[share.joint]}, which is farthest from the goal"
        elif isinstance(goal, JointsGoal):
            reason = "it tells most of the joints"
        else:
            reason = "it tells most of the deflection in the work area"
        return PlannedReading(
            label=next(
                label
                for label in map("m{:02d}".format, count(1 + len(self.of_label)))
                if label not in self.of_label
            ),
            joints=following.joints.tolist(),
            force=tuple(following.force.tolist()),
            anchor=following.anchor,
            held_out=self.awaits_held_out,
            reason=reason,
        )

    def entries_of(self, change: SetChange) -> list[Entry]:
        """Return the entries of a change: readings withdrawn or kept, the next posture skipped.

        Raises:
            RequestError: it has no such observation, or another posture is next.
        """
        named = [*change.withdrawn, *change.kept]
        unknown = next((label for label in named if label not in self.of_label), None)
        if unknown is not None:
            raise RequestError(
                f"the set has no observation '{unknown}'",
                where="withdrawn" if unknown in change.withdrawn else "kept",
                remedy="give labels of its readings",
            )
        entries = [Entry("withdrawn", label, reason=reason) for label, reason in change.withdrawn.items()]
        entries += [Entry("kept", label) for label in change.kept]
        if change.skipped:
            following = self.next_reading()
            if following is None or following.label != change.skipped:
                raise RequestError(
                    f"'{change.skipped}' is not what is read next",
                    where="skipped",
                    remedy="ask what is next",
                )
            again = sum(entry.change == "skipped" for entry in self.entries)
            entries.append(Entry("skipped", f"{following.label}/{again}", joints=tuple(following.joints)))
        return entries

    def closing(self) -> dict[str, object]:
        """Return the fields of the ordinary set that it becomes.

        Raises:
            RequestError: no reading counts.
        """
        if not self.observations:
            raise RequestError(
                "no reading counts yet", where="close", remedy="send observations, or delete the open set"
            )
        header = self.declared.header
        notes = "\n".join(filter(None, [header.notes, self.summary()]))[:MAX_NOTES_LENGTH]
        fields = {name: getattr(header, name) for name in MeasurementSetRequest.model_fields}
        return fields | {"observations": self.observations, "notes": notes}

    def _standing(self) -> tuple[Literal["measuring", "reached", "cannot", "closed"], str]:
        """Return the state, and where the campaign stands in words."""
        count = len(self.observations)
        read = "1 reading" if count == 1 else f"{count} readings"
        if self.closed:
            return "closed", f"closed after {read}"
        if self.doubtful:
            label = self.doubtful[-1]
            found = self._innovation(label)
            return "measuring", f"{label} is doubtful: {found.message if found else ''}"
        if self.met:
            return self._checked(read)
        wrong = self.mistake
        if wrong is not None:
            return self._mistaken(wrong)
        missing = self.still_needed
        if count >= ENOUGH_TO_SAY and missing is None:
            return "cannot", f"the goal will not be met: {self._obstacle()}"
        if isinstance(self.result, JointstiffError):
            return "measuring", f"{read} {'does' if count == 1 else 'do'} not tell yet: {self.result.reason}"
        left = "" if missing is None else f"; about {missing} more"
        if count < self.fewest and self.observations and self.share.greatest_share <= 1.0:
            left = f": the goal takes {self.fewest} and a held-out one to be sure of{left}"
        return "measuring", f"{read}{left}"

    def _mistaken(self, wrong: Finding) -> tuple[Literal["measuring", "cannot"], str]:
        """Return where a campaign stands in which a mistake is kept."""
        words = f"{wrong.observation}: {wrong.message}; {wrong.remedy}"
        if len(self.observations) >= ENOUGH_TO_SAY:
            return "cannot", f"the goal will not be met by these readings: {words}"
        return "measuring", f"do not use these readings yet: {words}"

    def _checked(self, read: str) -> tuple[Literal["measuring", "reached"], str]:
        """Return where a campaign stands whose goal is met: a held-out reading decides."""
        if self.check is not None and self.check.inside:
            near = "the held-out one is as near to its prediction as 90 % of good readings"
            return "reached", f"reached after {read}{self._assumed()}; {near}"
        far = "is further from its prediction than 90 % of good readings"
        failed = "" if self.check is None else f"held-out {self.check.label} {far}; "
        return "measuring", f"{failed}the goal is met; one held-out reading checks it"

    def _assumed(self) -> str:
        """Return what the goal's joints are known to with assumed errors, if that is beyond the goal."""
        goal = self.declared.options.goal
        if not isinstance(goal, JointsGoal):
            return ""
        whole = self._known(self.result, assumed=True)
        half = whole.factor * np.sqrt(np.diagonal(whole.covariance)) / whole.compliance
        greatest = float(np.max(half, initial=0.0, where=self.known.relative <= goal.relative))
        if not greatest > goal.relative:
            return ""
        return f", without the assumed errors of load point and force (with them ± {100 * greatest:.0f} %)"

    def _obstacle(self) -> str:
        """Return what keeps the goal from being met, by joint or by place."""
        share, result, names = self.share, self.result, self.declared.robot.joint_names
        if share.joint is None:
            reached = "unknown" if share.uncertainty is None else length_text(share.uncertainty)
            return f"the deflection in the work area is known to {reached}, and readings add little"
        parts = {part.joint: part for part in result.contributions} if isinstance(result, RunResult) else {}
        own = parts.get(names[share.joint])
        carries = "" if own is None else f" carries {100 * own.mean:.1f} % of the deflection, and"
        return f"{names[share.joint]}{carries} will not be known well enough"

    def _record(self) -> list[live.LiveReading]:
        withdrawn, doubtful = self._labels("withdrawn"), self.doubtful
        return [
            live.LiveReading(
                label=label,
                state="withdrawn" if label in withdrawn else "doubtful" if label in doubtful else "counts",
                reason=withdrawn[label].reason if label in withdrawn else None,
                **vars(self._innovation(label)),
                ball_ratio=None if entry.held_out is None else entry.held_out.ball_ratio,
            )
            for label, entry in self.of_label.items()
        ]

    def summary(self) -> str:
        """Return the declared rule, how it ended, and the readings that were withdrawn, for the report."""
        record = self._record()
        lines = [f"Measured live. Declared goal: {goal_text(self.declared.options)}."]
        open_entries = tuple(entry for entry in self.entries if entry.change != "closed")
        state, message = replace(self, entries=open_entries)._standing()
        told = message if message.startswith(state) else f"{state}: {message}"
        lines.append(f"{told[0].upper()}{told[1:]}.")
        if self.check is not None:
            lines.append(
                f"Held-out reading {self.check.label}: {length_text(self.check.distance)} from its "
                f"prediction, {self.check.ball_ratio:.2f} of the distance within which 90 % of good readings "
                "lie."
            )
        for standing, words in _OF_PRIORS.items():
            named = [name for name, each in self.standings.items() if each == standing]
            if named:
                lines.append(f"{words}: {', '.join(named)}.")
        lines += [f"Withdrawn {each.label}: {each.reason}." for each in record if each.state == "withdrawn"]
        lines += [f"Kept although doubtful: {label}." for label in self._labels("kept")]
        return "\n".join(lines)


def goal_text(options: live.LiveOptions) -> str:
    """Return what was declared, in words."""
    goal = options.goal
    if isinstance(goal, JointsGoal):
        return f"every joint that the load can twist is known to ± {100 * goal.relative:.3g} %"
    force = "" if goal.force is None else f" under ({', '.join(f'{part:.4g}' for part in goal.force)}) N"
    if isinstance(goal, DeflectionGoal):
        return f"deflection in the work area{force} to ± {length_text(goal.uncertainty)}"
    return f"whether the deflection in the work area{force} stays below {length_text(goal.limit)}"


def _joints(ahead: Ahead, known: Known, whole: Known, priors: Mapping[str, Standing]) -> list[live.LiveJoint]:
    """Return what is known of each joint: without errors that are only assumed, and with them."""
    robot, half, joints = ahead.robot, whole.factor * np.sqrt(np.diagonal(whole.covariance)), []
    for j, (name, kind) in enumerate(zip(robot.joint_names, robot.joint_kinds, strict=True)):
        c, h = float(known.compliance[j]), float(half[j])
        if not np.isfinite(c):
            nothing = live.LiveJoint(name=name, kind=kind, stiffness=None, interval=None, relative=None)
            reason = None if j in ahead.wanted else f"the load never {JOINT_UNITS[kind].loads} it"
            joints.append(nothing.model_copy(update={"prior": priors.get(name), "reason": reason}))
            continue
        joints.append(
            live.LiveJoint(
                name=name,
                kind=kind,
                stiffness=1.0 / c,
                interval=stiffness_interval((max(c - h, 0.0), c + h)),
                relative=float(known.relative[j]),
                relative_with_assumed=h / c,
                prior=priors.get(name),
            )
        )
    return joints


_SHOWS: Final = 0.2
"""Probability of residuals as great as these by stated noise alone, above which nothing shows that joints
and loads explain too little."""


def _lacks(goodness: Goodness) -> bool:
    """Return whether residuals may be more than noise: the dispersion over postures is model error then."""
    if goodness.sigma_source == "residuals":
        return True
    return float(special.chdtrc(goodness.degrees_of_freedom, goodness.chi_square)) < _SHOWS


def _spread(budget: Budget, names: Sequence[str], left_out: Collection[str]) -> tuple[FloatArray, float]:
    """Return covariance (n, n) of the compliances with the model error, and coverage factor of 95 %.

    The factor is Student's at the effective degrees of freedom (Welch and Satterthwaite, GUM G.4) of the
    joint whose are least.

    Args:
        budget: of a run.
        names: of the n joints.
        left_out: sources of uncertainty that do not count.
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
