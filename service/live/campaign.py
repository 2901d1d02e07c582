"""A live campaign: the entries of its record, and the state that follows from these entries."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count, islice
from math import hypot
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
from jointstiff.schemas.run import Residual, RunResult
from jointstiff.service.conversion.measurements import refuse_informed_controller
from jointstiff.service.conversion.prepared import PreparedSet, check_set
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.plan.work import CampaignSoFar, to_design_request
from jointstiff.service.problems import LabelTakenError
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.live.ahead import CandidateReadings, UncertaintyShare
from jointstiff.solver.live.innovation import HeldOut, Innovation, compare_declared_places
from jointstiff.solver.live.priors import Standing
from jointstiff.solver.live.progress import Progress, ReadingsSoFar
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import length_text

_AT_ORIGIN: Final = 0.02
"""Distance [m] of targets from the origin of R0 at which no base lets a flange be."""
MOST_READINGS: Final = 200
"""Greatest number of observations of a live campaign."""
_PRIOR_PHRASES: Final[Mapping[Standing, str]] = {
    "counts": "The prior knowledge is used for",
    "deviates": "The prior knowledge is not used, as the readings disagree with it, for",
}
ReadingState = Literal["counts", "doubtful", "withdrawn"]
Change = Literal["observation", "withdrawn", "kept", "skipped", "closed"]


@dataclass(frozen=True)
class Entry:
    """Entry in the record of a live campaign: an observation, or a later decision of the user."""

    change: Change  # kind of the entry
    label: str  # label of the observation; empty for the entry that closes the campaign
    observation: Observation | None = None
    innovation: Innovation | None = None  # difference of the observation from its prediction
    held_out: HeldOut | None = None  # result of the check, if the observation was held out to check the model
    reason: str | None = None  # reason why the observation was withdrawn
    joints: tuple[float, ...] = ()  # skipped posture


@dataclass(frozen=True, eq=False)
class Declaration:
    """Declaration of a live campaign, made before its first reading."""

    robot: Robot
    header: live.MeasurementSetPost  # units, noise, frame, goal and equipment; without observations
    resolved: ResolvedFrame | None = None  # transform from the frame of the readings to R0
    frame_findings: Sequence[Finding] = ()  # findings about this frame

    @cached_property
    def options(self) -> live.LiveOptions:
        """Goal and equipment of the live campaign, with the targets and the load point of its set."""
        if self.header.open is None:
            raise ValueError("the measurement set declares no live campaign")
        return self.header.open

    @cached_property
    def candidate_readings(self) -> CandidateReadings:
        """Candidates for the next readings: postures and loads, made from goal, equipment and robot.

        Raises:
            RequestError: work area, load point, targets or loads are missing; a prior names an unknown joint
                or cannot be used; or no reading is feasible.
        """
        goal, noise = self.options.goal, self.header.noise
        if not self.is_by_own_weight:
            refuse_informed_controller(noise)
        self._refuse_missing_work_area()
        self._refuse_unusable_priors()
        sigma = None
        if noise is not None and noise.sigma is not None:
            sigma = LENGTH[self.header.units.length] * noise.sigma
        nothing_read = CampaignSoFar.without_readings(self.robot.n, sigma)
        request = to_design_request(self._make_plan_request(), self.robot, nothing_read)
        self._refuse_missing_load_point()
        force = None if isinstance(goal, JointsGoal) else goal.force
        return CandidateReadings.from_request(self.robot, request, None if force is None else np.array(force))

    @property
    def is_by_own_weight(self) -> bool:
        """True if the robot's own weight is the only load."""
        return isinstance(self.options.load, OwnWeight)

    def _make_plan_request(self) -> PlanRequest:
        """Return the request of a plan with the equipment of this campaign.

        A prior is only an expected stiffness here: its uncertainty is used only after readings confirm it.
        """
        options = self.options
        fields = options.model_dump(include=set(ReadingOptions.model_fields) - {"priors"})
        prior_stiffness = {name: prior.stiffness for name, prior in options.priors.items()}
        fields["stiffness"] = prior_stiffness | options.stiffness
        return PlanRequest.model_validate({**fields, "robot_id": self.header.robot_id})

    def _refuse_missing_work_area(self) -> None:
        """Refuse a goal about deflections without the box in which they matter.

        Raises:
            RequestError: the work area is missing.
        """
        options = self.options
        if isinstance(options.goal, DeflectionGoal | DecisionGoal) and options.work_area is None:
            raise RequestError(
                "the goal concerns deflections in a work area, but the request has no work area",
                where="open.work_area",
                remedy="give `work_area`, two corners of the box in which deflections matter (frame R0), or "
                "a goal for the joints",
            )

    def _refuse_unusable_priors(self) -> None:
        """Refuse prior knowledge of stiffness of unknown joints, or of a campaign under own weight.

        Raises:
            RequestError: names the prior.
        """
        for name in self.options.priors:
            self.robot.joint_index(name, f"open.priors.{name}")
        if self.is_by_own_weight and self.options.priors:
            raise RequestError(
                "a campaign under the robot's own weight cannot use prior knowledge of stiffness (`priors`)",
                where="open.priors",
                remedy="omit `priors`, or measure with a load",
            )

    def _refuse_missing_load_point(self) -> None:
        """Refuse a campaign whose load point is not known before the first reading, unless none is needed.

        Raises:
            RequestError: the load point is missing, or is to be read from a target.
        """
        if self.header.load_point_target is not None:
            raise RequestError(
                "a live campaign needs the load point before the first reading",
                where="load_point_target",
                remedy="omit `load_point_target`, and give `load_point`; after the campaign, post its "
                "readings with that of the hook as a set",
            )
        if self.options.load_point is None and not self.is_by_own_weight:
            raise RequestError(
                "the load point is missing",
                where="open.load_point",
                remedy="give `open.load_point` in the flange frame in metres, or `load_point` of the set in "
                "its unit",
            )

    def build_document(self, observations: Sequence[Observation]) -> MeasurementSetDocument:
        """Return a measurement set with these observations; it is not validated.

        Each observation was validated when it arrived.
        """
        fields = {name: getattr(self.header, name) for name in MeasurementSetDocument.model_fields}
        return MeasurementSetDocument.model_construct(**{**fields, "observations": list(observations)})

    def check_observations(self, observations: Sequence[Observation]) -> PreparedSet:
        """Check a set with these observations against the robot; return the set, prepared for computation.

        Raises:
            MeasurementError: an observation cannot be right.
        """
        if self.resolved is None:  # a tracker may have its origin at a target
            for observation in observations:
                _refuse_positions_at_origin(observation, LENGTH[self.header.units.length])
        document, findings = self.build_document(observations), list(self.frame_findings)
        return check_set(document, self.robot, self.resolved, findings, robot_id=self.header.robot_id)


def _refuse_positions_at_origin(observation: Observation, length: float) -> None:
    """Refuse an observation whose positions are all at the origin of R0, because of their unit.

    Raises:
        MeasurementError: no target is farther from the origin than `_AT_ORIGIN`.
    """
    positions = [each.unloaded for each in observation.readings if each.unloaded is not None]
    distances = [length * hypot(*position) for position in positions]
    if distances and max(distances) < _AT_ORIGIN:
        raise MeasurementError(
            f"all positions are within {length_text(max(distances))} of the origin of their frame: their "
            "unit seems to be wrong",
            where="readings",
            remedy="give the positions in the unit of lengths that is stated, or state theirs as `units`",
        )


@dataclass(frozen=True, eq=False)
class LiveCampaign:
    """A campaign with the entries of its record so far. It is immutable: a change returns a new campaign."""

    declaration: Declaration
    entries: tuple[Entry, ...] = ()
    entry_by_label: Mapping[str, Entry] = field(init=False)  # label → entry of the observation

    def __post_init__(self) -> None:
        # The class is frozen, so that a field can only be set through `object`.
        object.__setattr__(self, "entry_by_label", self._entries_by_label("observation"))

    def with_entry(self, entry: Entry) -> LiveCampaign:
        """Return the campaign with one more entry, or this campaign if it has this entry object already."""
        if any(entry is each for each in self.entries):
            return self
        return LiveCampaign(self.declaration, (*self.entries, entry))

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
        """True if the campaign was closed, so that no more readings can be added."""
        return bool(self._entries_by_label("closed"))

    def compare_with_prediction(self, observation: Observation) -> Entry:
        """Return the entry for an observation: its stored entry if it was sent before, else a new entry.

        A new entry compares the observation with the prediction from the earlier observations in use; the
        first observation has no prediction.

        Raises:
            LabelTakenError: the campaign has a different observation with this label.
            RequestError: the campaign has `MOST_READINGS` observations already.
            MeasurementError: the observation cannot be right.
        """
        stored_entry = self.entry_by_label.get(observation.label)
        if stored_entry is not None and stored_entry.observation != observation:
            raise LabelTakenError(observation.label)
        if stored_entry is not None:  # the same observation was sent again
            return stored_entry
        if len(self.entry_by_label) >= MOST_READINGS:
            raise RequestError(
                f"a live campaign accepts at most {MOST_READINGS} observations",
                where="label",
                remedy="close this campaign, and declare another live campaign",
            )
        earlier_observations = self.observations
        prepared = self.declaration.check_observations([*earlier_observations, observation])
        misplaced = compare_declared_places(
            self.declaration.robot, prepared.measurements, self.declaration.options.targets
        )
        if not earlier_observations:
            return Entry("observation", observation.label, observation, misplaced)
        innovation, held_out = self.progress.compare_reading(prepared.measurements)
        if misplaced is not None and (innovation is None or innovation.p_value is None):
            innovation = misplaced
        return Entry("observation", observation.label, observation, innovation, held_out)

    @cached_property
    def _prepared(self) -> PreparedSet | None:
        """The observations in use, prepared for computation; None if there are no observations."""
        observations = self.observations
        return self.declaration.check_observations(observations) if observations else None

    @cached_property
    def progress(self) -> Progress:
        """Progress of the readings so far towards the goal.

        Raises:
            RequestError: the declaration is incomplete, or no reading is feasible.
        """
        options = self.declaration.options
        weight = options.load if isinstance(options.load, OwnWeight) else None
        return Progress(
            self.declaration.candidate_readings, options.goal, self._readings_so_far, options.priors, weight
        )

    @property
    def _readings_so_far(self) -> ReadingsSoFar:
        """Readings and decisions of the user so far, in the form that the solver uses."""
        observations, prepared = self.observations, self._prepared
        comparisons = {
            label: entry.innovation or Innovation() for label, entry in self.entry_by_label.items()
        }
        last_entry = self.entry_by_label[observations[-1].label] if observations else None
        return ReadingsSoFar(
            measurements=None if prepared is None else prepared.measurements,
            noticed=() if prepared is None else tuple(prepared.warnings),
            comparisons=comparisons,
            withdrawn=frozenset(self._entries_by_label("withdrawn")),
            kept=frozenset(self._entries_by_label("kept")),
            skipped=tuple(entry.joints for entry in self.entries if entry.change == "skipped"),
            check=None if last_entry is None else last_entry.held_out,
        )

    @property
    def run_options(self) -> dict[str, Any]:
        """Options of the run that identifies the campaign: `weight` (None with loads) and `priors` in use."""
        return {"weight": self.progress.weight, "priors": self.progress.priors_in_use}

    def state(self, measurement_set_id: str | None = None, run_id: str | None = None) -> live.LiveState:
        """Return the state of the campaign as an API message, with the next reading.

        The arguments are the ids of the measurement set and of the run that closing the campaign created;
        None before the campaign is closed.
        """
        progress = self.progress
        result = progress.result
        state, message = self._state_and_message()
        needs_no_reading = state in {"reached", "closed"}
        share = self._finite_share()
        return live.LiveState(
            revision=len(self.entries),
            state=state,
            message=message,
            goal=describe_goal(self.declaration.options),
            share=None if share is None else share.greatest_share,
            still_needed=0 if needs_no_reading else progress.still_needed,
            readings=self._list_readings(),
            joints=progress.list_joints(),
            residuals=self._residuals_of_last_reading(),
            deflection_uncertainty=None if share is None else share.uncertainty,
            greatest_deflection=None if share is None else share.greatest,
            assessment=result.assessment if isinstance(result, RunResult) else None,
            next=None if needs_no_reading else self.plan_next_reading(),
            following=[] if needs_no_reading else self._plan_following_readings(),
            warnings=list(progress.so_far.noticed),
            measurement_set_id=measurement_set_id,
            run_id=run_id,
        )

    def _finite_share(self) -> UncertaintyShare | None:
        """Return the uncertainty as a share of the goal; None while the readings do not determine it."""
        if not self.observations:
            return None
        share = self.progress.share
        return share if np.isfinite(share.greatest_share) else None

    def _residuals_of_last_reading(self) -> list[Residual]:
        """Return the residuals of the last reading that counts; an empty list without an identification."""
        result = self.progress.result
        if not isinstance(result, RunResult):
            return []
        label = self.observations[-1].label
        return [each for each in result.residuals if each.observation == label]

    def _state_and_message(self) -> tuple[Literal["measuring", "reached", "cannot", "closed"], str]:
        """Return the state of the campaign, and a sentence that explains the state to people."""
        if not self.closed:
            return self.progress.describe_state()
        number = len(self.observations)
        return "closed", f"closed after {'1 reading' if number == 1 else f'{number} readings'}"

    def plan_next_reading(self) -> PlannedReading | None:
        """Return posture, load and label of the next reading; None if no reading is planned."""
        next_reading = self.progress.next
        if next_reading is None:
            return None
        return PlannedReading(
            label=next(self._free_labels()),
            joints=next_reading.joints.tolist(),
            force=tuple(next_reading.force.tolist()),
            anchor=next_reading.anchor,
            held_out=self.progress.awaits_held_out,
            reason=self.progress.reason_of_next,
        )

    def _plan_following_readings(self) -> list[PlannedReading]:
        """Return posture, load and label of the readings that will probably come after the next one."""
        next_reading = self.progress.next
        labels = islice(self._free_labels(), 1, None)
        return [
            PlannedReading(
                label=label,
                joints=each.joints.tolist(),
                force=tuple(each.force.tolist()),
                anchor=each.anchor,
                held_out=False,
            )
            for each, label in zip(
                () if next_reading is None else next_reading.following, labels, strict=False
            )
        ]

    def _free_labels(self) -> Iterator[str]:
        """Yield m01, m02 and so on, without labels that the user gave to earlier readings."""
        labels = map("m{:02d}".format, count(1 + len(self.entry_by_label)))
        return (label for label in labels if label not in self.entry_by_label)

    def entries_for_change(self, change: SetChange) -> list[Entry]:
        """Return new entries for a change that withdraws or keeps observations, or skips the next posture.

        Raises:
            RequestError: the campaign has no such observation, or the posture to skip is not the next one.
        """
        self._refuse_unknown_labels(change)
        entries = [Entry("withdrawn", label, reason=reason) for label, reason in change.withdrawn.items()]
        entries += [Entry("kept", label) for label in change.kept]
        if change.skipped:
            entries.append(self._skip_next_reading(change.skipped))
        return entries

    def _refuse_unknown_labels(self, change: SetChange) -> None:
        """Refuse a change of observations that the campaign does not have.

        Raises:
            RequestError: names the first of them.
        """
        for field_name, labels in (("withdrawn", change.withdrawn), ("kept", change.kept)):
            for label in labels:
                if label not in self.entry_by_label:
                    raise RequestError(
                        f"the set has no observation '{label}'",
                        where=field_name,
                        remedy="give labels of readings of this set",
                    )

    def _skip_next_reading(self, label: str) -> Entry:
        """Return the entry that skips the posture of the next reading, given its label.

        The store keeps one entry of a kind and label. The posture planned in place of a skipped posture has
        the same label and may be skipped, too: the number of skipped postures makes labels unique, as m03/0.

        Raises:
            RequestError: the next reading has another label.
        """
        next_reading = self.plan_next_reading()
        if next_reading is None or next_reading.label != label:
            raise RequestError(
                f"'{label}' is not the next reading",
                where="skipped",
                remedy="get the state of the set, and send the next reading that the state names",
            )
        number = sum(entry.change == "skipped" for entry in self.entries)
        return Entry("skipped", f"{label}/{number}", joints=tuple(next_reading.joints))

    def fields_when_closed(self) -> dict[str, object]:
        """Return the fields of the ordinary measurement set that closing this campaign creates.

        Raises:
            RequestError: the campaign has no observation in use.
        """
        if not self.observations:
            raise RequestError(
                "the set has no reading to identify: no reading was sent, or all readings were withdrawn",
                where="close",
                remedy="send observations, or delete the live campaign",
            )
        header = self.declaration.header
        notes = "\n".join(filter(None, [header.notes, self.describe_course()]))[:MAX_NOTES_LENGTH]
        fields = {name: getattr(header, name) for name in MeasurementSetRequest.model_fields}
        return fields | {"observations": self.observations, "notes": notes}

    def _list_readings(self) -> list[live.LiveReading]:
        """Return all readings with their states: `counts` (in use), `doubtful` or `withdrawn`."""
        withdrawn, doubtful = self._entries_by_label("withdrawn"), self.progress.doubtful
        readings = list[live.LiveReading]()
        for label, entry in self.entry_by_label.items():
            state: ReadingState = "doubtful" if label in doubtful else "counts"
            reason = None
            if label in withdrawn:
                state, reason = "withdrawn", withdrawn[label].reason
            readings.append(
                live.LiveReading(
                    label=label,
                    state=state,
                    reason=reason,
                    **vars(self.progress.find_comparison(label)),
                    ball_ratio=None if entry.held_out is None else entry.held_out.ball_ratio,
                )
            )
        return readings

    def describe_course(self) -> str:
        """Return lines for the report on how the campaign went.

        The lines state goal, outcome, held-out reading, use of priors, and readings withdrawn or kept.
        """
        goal = describe_goal(self.declaration.options)
        withdrawn = [each for each in self._list_readings() if each.state == "withdrawn"]
        lines = [
            f"Measured live. Declared goal: {goal}.",
            self._describe_outcome(),
            *self._describe_check(),
            *self._describe_use_of_priors(),
            *[f"Withdrawn {each.label}: {each.reason}." for each in withdrawn],
            *[f"Kept although doubtful: {label}." for label in self._entries_by_label("kept")],
        ]
        return "\n".join(lines)

    def _describe_outcome(self) -> str:
        """Return a sentence on whether the goal was reached, by the state before the campaign was closed."""
        earlier_entries = tuple(entry for entry in self.entries if entry.change != "closed")
        state, message = replace(self, entries=earlier_entries)._state_and_message()
        outcome = message if message.startswith(state) else f"{state}: {message}"
        return f"{outcome[0].upper()}{outcome[1:]}."

    def _describe_check(self) -> Iterator[str]:
        """Yield a sentence on the held-out reading that checked the model, if there is one."""
        check = self.progress.so_far.check
        if check is not None:
            yield (
                f"Held-out reading {check.label}: {length_text(check.distance)} from its "
                f"prediction, {check.ball_ratio:.2f} of the distance within which 90 % of good readings lie."
            )

    def _describe_use_of_priors(self) -> Iterator[str]:
        """Yield a sentence on the joints whose prior stiffness was used, and on those where it was not."""
        for standing, phrase in _PRIOR_PHRASES.items():
            joints = [name for name, each in self.progress.prior_standings.items() if each == standing]
            if joints:
                yield f"{phrase}: {', '.join(joints)}."


def describe_goal(options: live.LiveOptions) -> str:
    """Return the declared goal as a phrase for people."""
    goal = options.goal
    if isinstance(goal, JointsGoal):
        return f"every joint that the load can twist is known to ± {100 * goal.relative:.3g} %"
    force = "" if goal.force is None else f" under ({', '.join(f'{part:.4g}' for part in goal.force)}) N"
    if isinstance(goal, DeflectionGoal):
        return f"deflection in the work area{force} to ± {length_text(goal.uncertainty)}"
    return f"whether the deflection in the work area{force} stays below {length_text(goal.limit)}"
