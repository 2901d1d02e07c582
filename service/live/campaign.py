"""A campaign while it is measured: its record, and what the record says. No store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from typing import Any, Final, Literal

import numpy as np

from jointstiff.schemas import live
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.measurement import (
    MAX_NOTES_LENGTH,
    MeasurementSetDocument,
    MeasurementSetRequest,
    Observation,
    ResolvedFrame,
    SetChange,
)
from jointstiff.schemas.options import OwnWeight
from jointstiff.schemas.plan import (
    DecisionGoal,
    DeflectionGoal,
    JointsGoal,
    PlannedReading,
    PlanRequest,
    ReadingOptions,
)
from jointstiff.schemas.run import RunResult
from jointstiff.service.conversion.prepared import PreparedSet, check_set
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.plan.work import to_design_request
from jointstiff.service.problems import TakenError
from jointstiff.solver.errors import RequestError
from jointstiff.solver.live.ahead import Ahead
from jointstiff.solver.live.innovation import HeldOut, Innovation
from jointstiff.solver.live.priors import Standing
from jointstiff.solver.live.progress import Progress, Taken
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import length_text

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
            RequestError: targets or loads are not stated, a prior is of no joint or of no use, or no reading
                is feasible.
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

    def prepared(self, observations: Sequence[Observation]) -> PreparedSet:
        """Check a set of observations, and prepare the set for computation.

        Raises:
            MeasurementError: they cannot be right.
        """
        document, noticed = self.document(observations), list(self.noticed)
        return check_set(document, self.robot, self.resolved, noticed, robot_id=self.header.robot_id)


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
        if not before:
            return Entry("observation", observation.label, observation)
        found, last = self.progress.judge(prepared.measurements)
        return Entry("observation", observation.label, observation, found, last)

    @cached_property
    def _prepared(self) -> PreparedSet | None:
        observations = self.observations
        return self.declared.prepared(observations) if observations else None

    @cached_property
    def progress(self) -> Progress:
        """Return what the readings say so far, compared with the goal; raises as `Declared.ahead`."""
        options, observations, prepared = self.declared.options, self.observations, self._prepared
        taken = Taken(
            measurements=None if prepared is None else prepared.measurements,
            noticed=() if prepared is None else tuple(prepared.warnings),
            judged={label: entry.innovation or Innovation() for label, entry in self.of_label.items()},
            withdrawn=frozenset(self._labels("withdrawn")),
            kept=frozenset(self._labels("kept")),
            skipped=tuple(entry.joints for entry in self.entries if entry.change == "skipped"),
            check=self.of_label[observations[-1].label].held_out if observations else None,
        )
        weight = options.load if isinstance(options.load, OwnWeight) else None
        return Progress(self.declared.ahead, options.goal, taken, options.priors, weight)

    @property
    def run_options(self) -> dict[str, Any]:
        """Options of the run: the weight of readings without a load, and the priors that count."""
        return {"weight": self.progress.weight, "priors": self.progress.counting_priors}

    def state(self, measurement_set_id: str | None = None, run_id: str | None = None) -> live.LiveState:
        """Return what the record says, and what to do next; with the set and the run of a closed campaign."""
        progress, result = self.progress, self.progress.result
        state, message = self._state()
        over = state in {"reached", "closed"}
        share = progress.share if self.observations else None
        known = share is not None and np.isfinite(share.greatest_share)
        return live.LiveState(
            revision=len(self.entries),
            state=state,
            message=message,
            goal=goal_text(self.declared.options),
            share=share.greatest_share if share is not None and known else None,
            still_needed=0 if over else progress.still_needed,
            readings=self._record(),
            joints=progress.joints(),
            deflection_uncertainty=share.uncertainty if share is not None and known else None,
            greatest_deflection=share.greatest if share is not None and known else None,
            assessment=result.assessment if isinstance(result, RunResult) else None,
            next=None if over else self.next_reading(),
            warnings=list(progress.taken.noticed),
            measurement_set_id=measurement_set_id,
            run_id=run_id,
        )

    def _state(self) -> tuple[Literal["measuring", "reached", "cannot", "closed"], str]:
        count = len(self.observations)
        read = "1 reading" if count == 1 else f"{count} readings"
        return ("closed", f"closed after {read}") if self.closed else self.progress.state()

    def next_reading(self) -> PlannedReading | None:
        """Return what to read next."""
        following = self.progress.next
        if following is None:
            return None
        return PlannedReading(
            label=next(
                label
                for label in map("m{:02d}".format, count(1 + len(self.of_label)))
                if label not in self.of_label
            ),
            joints=following.joints.tolist(),
            force=tuple(following.force.tolist()),
            anchor=following.anchor,
            held_out=self.progress.awaits_held_out,
            reason=self.progress.reason_of_next,
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

    def _record(self) -> list[live.LiveReading]:
        withdrawn, doubtful = self._labels("withdrawn"), self.progress.doubtful
        return [
            live.LiveReading(
                label=label,
                state="withdrawn" if label in withdrawn else "doubtful" if label in doubtful else "counts",
                reason=withdrawn[label].reason if label in withdrawn else None,
                **vars(self.progress.found(label)),
                ball_ratio=None if entry.held_out is None else entry.held_out.ball_ratio,
            )
            for label, entry in self.of_label.items()
        ]

    def summary(self) -> str:
        """Return the declared rule, how it ended, and the readings that were withdrawn, for the report."""
        record = self._record()
        lines = [f"Measured live. Declared goal: {goal_text(self.declared.options)}."]
        open_entries = tuple(entry for entry in self.entries if entry.change != "closed")
        state, message = replace(self, entries=open_entries)._state()
        words = message if message.startswith(state) else f"{state}: {message}"
        lines.append(f"{words[0].upper()}{words[1:]}.")
        check = self.progress.taken.check
        if check is not None:
            lines.append(
                f"Held-out reading {check.label}: {length_text(check.distance)} from its "
                f"prediction, {check.ball_ratio:.2f} of the distance within which 90 % of good readings "
                "lie."
            )
        for standing, words in _OF_PRIORS.items():
            named = [name for name, each in self.progress.standings.items() if each == standing]
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
