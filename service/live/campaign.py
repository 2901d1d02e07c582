"""A campaign that is being measured: the entries of its record, and the state that follows from them."""

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
from jointstiff.service.problems import LabelTakenError
from jointstiff.solver.errors import RequestError
from jointstiff.solver.live.ahead import CandidateReadings
from jointstiff.solver.live.innovation import HeldOut, Innovation
from jointstiff.solver.live.priors import Standing
from jointstiff.solver.live.progress import Progress, ReadingsSoFar
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import length_text

MOST_READINGS: Final = 200
"""Greatest number of observations of a live campaign."""
_PRIOR_PHRASES: Final[Mapping[Standing, str]] = {
    "counts": "Prior knowledge counts",
    "deviates": "Prior knowledge does not count, as the readings disagree with it",
}
Change = Literal["observation", "withdrawn", "kept", "skipped", "closed"]


@dataclass(frozen=True)
class Entry:
    """Entry in the record of a live campaign: an observation, or a later decision of the user."""

    change: Change
    label: str  # label of the observation; empty for the entry that closes the campaign
    observation: Observation | None = None
    innovation: Innovation | None = None  # how far the observation was from its prediction
    held_out: HeldOut | None = None  # check by an observation that came when the goal was met
    reason: str | None = None  # why the observation was withdrawn
    joints: tuple[float, ...] = ()  # posture that was skipped


@dataclass(frozen=True, eq=False)
class Declaration:
    """Declaration of a live campaign, made before its first reading."""

    robot: Robot
    header: live.MeasurementSetPost  # units, noise, frame, goal and equipment; without observations
    resolved: ResolvedFrame | None = None  # transform from the frame of the readings to R0
    frame_findings: Sequence[Finding] = ()  # findings about this frame

    @cached_property
    def options(self) -> live.LiveOptions:
        """Goal and equipment of the open set, with its targets and its load point."""
        if self.header.open is None:
            raise ValueError("the set is not open")
        return self.header.open

    @cached_property
    def ahead(self) -> CandidateReadings:
        """Planner of the next readings: candidate postures and loads, from goal, equipment and robot.

        Raises:
            RequestError: work area, load point, targets or loads are missing; a prior names an unknown joint
                or cannot be used; or no reading is feasible.
        """
        options, header = self.options, self.header
        if isinstance(options.goal, DeflectionGoal | DecisionGoal) and options.work_area is None:
            raise RequestError(
                "the goal is about deflections, and the work area is missing",
                where="open.work_area",
                remedy="give two corners of the box in which deflections matter (frame R0), or "
                "the goal `joints`",
            )
        stated = options.model_dump(include=set(ReadingOptions.model_fields) - {"priors"})
        for name in options.priors:
            self.robot.joint_index(name, f"open.priors.{name}")
        if isinstance(options.load, OwnWeight) and options.priors:
            raise RequestError(
                "a campaign under the robot's own weight cannot use prior knowledge of stiffness (`priors`)",
                where="open.priors",
                remedy="omit `priors`, or measure with a load",
            )
        expected = {name: prior.stiffness for name, prior in options.priors.items()}
        # Priors serve here only as expected stiffness: a prior is used as knowledge after it has been tested.
        stated["stiffness"] = expected | options.stiffness
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
                "the load point is missing",
                where="open.load_point",
                remedy="give `open.load_point` in the flange frame in metres, or `load_point` of the set in "
                "its unit",
            )
        force = None if isinstance(options.goal, JointsGoal) else options.goal.force
        return CandidateReadings.from_request(self.robot, request, None if force is None else np.array(force))

    def document(self, observations: Sequence[Observation]) -> MeasurementSetDocument:
        """Return a measurement set of observations, without validation: each was checked on arrival."""
        fields = {name: getattr(self.header, name) for name in MeasurementSetDocument.model_fields}
        return MeasurementSetDocument.model_construct(**{**fields, "observations": list(observations)})

    def prepared(self, observations: Sequence[Observation]) -> PreparedSet:
        """Check a set of observations, and prepare the set for computation.

        Raises:
            MeasurementError: an observation cannot be right.
        """
        document, findings = self.document(observations), list(self.frame_findings)
        return check_set(document, self.robot, self.resolved, findings, robot_id=self.header.robot_id)


@dataclass(frozen=True, eq=False)
class LiveCampaign:
    """A campaign with the entries of its record so far. It is immutable: a change returns a new campaign."""

    declared: Declaration
    entries: tuple[Entry, ...] = ()
    entry_by_label: Mapping[str, Entry] = field(init=False)  # label → entry of the observation

    def __post_init__(self) -> None:
        named = {entry.label: entry for entry in self.entries if entry.change == "observation"}
        object.__setattr__(self, "entry_by_label", named)

    def with_entry(self, entry: Entry) -> LiveCampaign:
        """Return the campaign with one more entry; an entry object in the record is not added again."""
        if any(entry is each for each in self.entries):
            return self
        return LiveCampaign(self.declared, (*self.entries, entry))

    def _entries_by_label(self, change: Change) -> dict[str, Entry]:
        """Return label → entry, for the entries of one kind of change."""
        return {entry.label: entry for entry in self.entries if entry.change == change}

    @property
    def observations(self) -> list[Observation]:
        """Observations in use: all that were not withdrawn, in the order of their arrival."""
        withdrawn = self._entries_by_label("withdrawn")
        return [
            entry.observation
            for label, entry in self.entry_by_label.items()
            if label not in withdrawn and entry.observation is not None
        ]

    @property
    def closed(self) -> bool:
        """True once the set is closed and takes no more readings."""
        return bool(self._entries_by_label("closed"))

    def compare_with_prediction(self, observation: Observation) -> Entry:
        """Return the entry for an observation, with its difference from the prediction if it is new.

        The prediction is made from the earlier observations in use; the first observation has none.

        Raises:
            LabelTakenError: the set has a different observation with this label.
            RequestError: the set has `MOST_READINGS` observations already.
            MeasurementError: the observation cannot be right.
        """
        known = self.entry_by_label.get(observation.label)  # sent again, if it is the same observation
        if known is not None and known.observation != observation:
            raise LabelTakenError(observation.label)
        if known is not None:
            return known
        if len(self.entry_by_label) >= MOST_READINGS:
            raise RequestError(
                f"an open set takes {MOST_READINGS} observations at most",
                where="label",
                remedy="close this set, and open another set",
            )
        before = self.observations
        prepared = self.declared.prepared([*before, observation])
        if not before:
            return Entry("observation", observation.label, observation)
        innovation, held_out = self.progress.compare_reading(prepared.measurements)
        return Entry("observation", observation.label, observation, innovation, held_out)

    @cached_property
    def _prepared(self) -> PreparedSet | None:
        """The observations in use, prepared for computation; None if there are no observations."""
        observations = self.observations
        return self.declared.prepared(observations) if observations else None

    @cached_property
    def progress(self) -> Progress:
        """Progress of the readings so far towards the goal; raises the errors of `Declaration.ahead`."""
        options, observations, prepared = self.declared.options, self.observations, self._prepared
        record = ReadingsSoFar(
            measurements=None if prepared is None else prepared.measurements,
            noticed=() if prepared is None else tuple(prepared.warnings),
            comparisons={
                label: entry.innovation or Innovation() for label, entry in self.entry_by_label.items()
            },
            withdrawn=frozenset(self._entries_by_label("withdrawn")),
            kept=frozenset(self._entries_by_label("kept")),
            skipped=tuple(entry.joints for entry in self.entries if entry.change == "skipped"),
            check=self.entry_by_label[observations[-1].label].held_out if observations else None,
        )
        weight = options.load if isinstance(options.load, OwnWeight) else None
        return Progress(self.declared.ahead, options.goal, record, options.priors, weight)

    @property
    def run_options(self) -> dict[str, Any]:
        """Options of the run that identifies the set: `weight` for readings without a load, and `priors`."""
        return {"weight": self.progress.weight, "priors": self.progress.priors_in_use}

    def state(self, measurement_set_id: str | None = None, run_id: str | None = None) -> live.LiveState:
        """Return the state of the campaign with the next reading.

        After the campaign was closed, the arguments are the ids of its measurement set and of its run.
        """
        progress = self.progress
        result = progress.result
        state, message = self._state_and_message()
        is_over = state in {"reached", "closed"}
        share = progress.share if self.observations else None
        is_known = share is not None and np.isfinite(share.greatest_share)
        return live.LiveState(
            revision=len(self.entries),
            state=state,
            message=message,
            goal=describe_goal(self.declared.options),
            share=share.greatest_share if share is not None and is_known else None,
            still_needed=0 if is_over else progress.still_needed,
            readings=self._list_readings(),
            joints=progress.list_joints(),
            deflection_uncertainty=share.uncertainty if share is not None and is_known else None,
            greatest_deflection=share.greatest if share is not None and is_known else None,
            assessment=result.assessment if isinstance(result, RunResult) else None,
            next=None if is_over else self.next_reading(),
            warnings=list(progress.so_far.noticed),
            measurement_set_id=measurement_set_id,
            run_id=run_id,
        )

    def _state_and_message(self) -> tuple[Literal["measuring", "reached", "cannot", "closed"], str]:
        """Return the state of the campaign, and a sentence that explains the state to people."""
        count = len(self.observations)
        read = "1 reading" if count == 1 else f"{count} readings"
        return ("closed", f"closed after {read}") if self.closed else self.progress.describe_state()

    def next_reading(self) -> PlannedReading | None:
        """Return posture, load and label of the next reading; None if no reading is planned."""
        following = self.progress.next
        if following is None:
            return None
        return PlannedReading(
            label=next(
                label
                for label in map("m{:02d}".format, count(1 + len(self.entry_by_label)))
                if label not in self.entry_by_label
            ),
            joints=following.joints.tolist(),
            force=tuple(following.force.tolist()),
            anchor=following.anchor,
            held_out=self.progress.awaits_held_out,
            reason=self.progress.reason_of_next,
        )

    def entries_for_change(self, change: SetChange) -> list[Entry]:
        """Return new entries for a change that withdraws or keeps observations, or skips the next posture.

        Raises:
            RequestError: the set has no such observation, or the posture to skip is not the next one.
        """
        named = [*change.withdrawn, *change.kept]
        unknown = next((label for label in named if label not in self.entry_by_label), None)
        if unknown is not None:
            raise RequestError(
                f"the set has no observation '{unknown}'",
                where="withdrawn" if unknown in change.withdrawn else "kept",
                remedy="give labels of readings of this set",
            )
        entries = [Entry("withdrawn", label, reason=reason) for label, reason in change.withdrawn.items()]
        entries += [Entry("kept", label) for label in change.kept]
        if change.skipped:
            following = self.next_reading()
            if following is None or following.label != change.skipped:
                raise RequestError(
                    f"'{change.skipped}' is not the next reading",
                    where="skipped",
                    remedy="get the state of the set, which names the next reading",
                )
            # The number makes the label unique: the next posture may have the label of the skipped one.
            number = sum(entry.change == "skipped" for entry in self.entries)
            entries.append(Entry("skipped", f"{following.label}/{number}", joints=tuple(following.joints)))
        return entries

    def fields_when_closed(self) -> dict[str, object]:
        """Return the fields of the ordinary measurement set that the open set becomes when it is closed.

        Raises:
            RequestError: the set has no observation in use.
        """
        if not self.observations:
            raise RequestError(
                "the set has no reading to identify: none was sent, or all were withdrawn",
                where="close",
                remedy="send observations, or delete the open set",
            )
        header = self.declared.header
        notes = "\n".join(filter(None, [header.notes, self.summary()]))[:MAX_NOTES_LENGTH]
        fields = {name: getattr(header, name) for name in MeasurementSetRequest.model_fields}
        return fields | {"observations": self.observations, "notes": notes}

    def _list_readings(self) -> list[live.LiveReading]:
        """Return all readings with their states: `counts` (in use), `doubtful` or `withdrawn`."""
        withdrawn, doubtful = self._entries_by_label("withdrawn"), self.progress.doubtful
        return [
            live.LiveReading(
                label=label,
                state="withdrawn" if label in withdrawn else "doubtful" if label in doubtful else "counts",
                reason=withdrawn[label].reason if label in withdrawn else None,
                **vars(self.progress.find_comparison(label)),
                ball_ratio=None if entry.held_out is None else entry.held_out.ball_ratio,
            )
            for label, entry in self.entry_by_label.items()
        ]

    def summary(self) -> str:
        """Return lines for the report: goal, outcome, check reading, priors, readings withdrawn or kept."""
        readings = self._list_readings()
        lines = [f"Measured live. Declared goal: {describe_goal(self.declared.options)}."]
        open_entries = tuple(entry for entry in self.entries if entry.change != "closed")
        state, message = replace(self, entries=open_entries)._state_and_message()
        words = message if message.startswith(state) else f"{state}: {message}"
        lines.append(f"{words[0].upper()}{words[1:]}.")
        check = self.progress.so_far.check
        if check is not None:
            lines.append(
                f"Held-out reading {check.label}: {length_text(check.distance)} from its "
                f"prediction, {check.ball_ratio:.2f} of the distance within which 90 % of good readings "
                "lie."
            )
        for standing, words in _PRIOR_PHRASES.items():
            named = [name for name, each in self.progress.prior_standings.items() if each == standing]
            if named:
                lines.append(f"{words}: {', '.join(named)}.")
        lines += [f"Withdrawn {each.label}: {each.reason}." for each in readings if each.state == "withdrawn"]
        lines += [f"Kept although doubtful: {label}." for label in self._entries_by_label("kept")]
        return "\n".join(lines)


def describe_goal(options: live.LiveOptions) -> str:
    """Return the declared goal as a phrase for people."""
    goal = options.goal
    if isinstance(goal, JointsGoal):
        return f"every joint that the load can twist is known to ± {100 * goal.relative:.3g} %"
    force = "" if goal.force is None else f" under ({', '.join(f'{part:.4g}' for part in goal.force)}) N"
    if isinstance(goal, DeflectionGoal):
        return f"deflection in the work area{force} to ± {length_text(goal.uncertainty)}"
    return f"whether the deflection in the work area{force} stays below {length_text(goal.limit)}"
