"""Live campaigns of a store, which are declared, measured one observation at a time, and closed.

The API calls the measurement set of a live campaign an open set.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any, Final
from uuid import uuid4

from pydantic import TypeAdapter

from jointstiff.schemas import live
from jointstiff.schemas.fields import Page
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.measurement import (
    MeasurementSetHeader,
    MeasurementSetRequest,
    MeasurementSetSummary,
    Observation,
    ResolvedFrame,
    SetChange,
)
from jointstiff.schemas.plan import AnyDirection, DeadWeight, Plan, PlanResult, ReadingOptions
from jointstiff.schemas.query import OpenSetQuery, SetQuery
from jointstiff.schemas.run import RunRequest
from jointstiff.service.conversion.prepared import frame_fields
from jointstiff.service.kinds.plan.kind import refuse_step_plan
from jointstiff.service.live.campaign import Declaration, Entry, LiveCampaign
from jointstiff.service.live.declaration import complete_declaration
from jointstiff.service.problems import LabelTakenError, NotFoundError
from jointstiff.service.resources.stored import Resources, load_job, resolve_frame
from jointstiff.service.store.tables import AccessKey, IdempotencyKey, LiveEntry, OpenSetRecord
from jointstiff.solver.errors import RequestError

_CAMPAIGNS: Final = 64
"""Greatest number of live campaigns that are kept in memory."""
_ENTRY: Final = TypeAdapter(Entry)
_FINDINGS: Final = TypeAdapter(list[Finding])

CreateRun = Callable[[RunRequest, IdempotencyKey, AccessKey | None], str]
"""Function that stores a run and returns the id of the run."""


class OpenSets:
    """The live campaigns of a store: measurement sets that are open for further observations."""

    def __init__(self, resources: Resources, create_run: CreateRun) -> None:
        """Serve the live campaigns of a store; `create_run` stores the run that identifies a closed set."""
        self._resources, self._store, self._create_run = resources, resources.store, create_run
        self._declaration = lru_cache(_CAMPAIGNS)(self._load_declaration)
        self._cached_campaigns: dict[str, LiveCampaign] = {}  # id of the set → campaign

    def create(
        self, request: live.MeasurementSetPost, options: live.LiveOptions, key: IdempotencyKey | None
    ) -> str:
        """Store a new live campaign, with the observations of the request; return its id.

        If the idempotency key `key` was used before, the id of the campaign created then is returned.

        Raises:
            RequestError: robot, plan, targets or loads are missing, or no reading is feasible.
            MeasurementError: an observation cannot be right.
        """
        if key is not None and (earlier := self._store.open_sets.find(key)) is not None:
            return earlier.id
        options, robot_id = self._take_options_from_plan(options), request.robot_id
        header = complete_declaration(
            request.model_copy(update={"observations": [], "robot_id": robot_id}), options
        )
        resolved, frame_findings = resolve_frame(self._store, header)
        robot, _ = self._resources.robot(robot_id, "robot_id")
        campaign = LiveCampaign(Declaration(robot, header, resolved, frame_findings))
        _ = campaign.declaration.candidate_readings  # computed here to raise an error if none is feasible
        for observation in request.observations:
            campaign = campaign.with_entry(campaign.compare_with_prediction(observation))
        record = OpenSetRecord(
            id=uuid4().hex,
            robot_id=robot_id,
            name=header.name,
            created_at=datetime.now(UTC),
            document=header.model_dump_json(),
            resolved=None if resolved is None else resolved.model_dump_json(),
            warnings=_FINDINGS.dump_json(list(frame_findings)).decode(),
        )
        stored = self._store.open_sets.add(record, key)
        if stored.id == record.id:
            for entry in campaign.entries:
                self._add_entry(record.id, entry, None)
        return stored.id

    def observe(self, set_id: str, observation: Observation, by: AccessKey | None) -> live.LiveState:
        """Add an observation to a live campaign; return the new state. A repeated call changes nothing.

        Raises:
            NotFoundError: no live campaign has this id.
            ClosedError: the campaign is closed.
            LabelTakenError: the campaign has a different observation with this label.
            MeasurementError: the observation cannot be right.
        """
        entry = self._load_campaign(set_id).compare_with_prediction(observation)
        # Another process may have stored a different observation with this label meanwhile.
        if self._add_entry(set_id, entry, by).observation != observation:
            raise LabelTakenError(observation.label)
        return self.state(set_id)

    def _add_decisions(self, set_id: str, change: SetChange, by: AccessKey | None) -> None:
        """Record that observations are withdrawn or kept although doubtful, or the next posture is skipped.

        Raises:
            NotFoundError: no live campaign has this id.
            RequestError: the campaign has no such observation, or the posture to skip is not the next one.
        """
        for entry in self._load_campaign(set_id).entries_for_change(change):
            self._add_entry(set_id, entry, by)

    def close(self, set_id: str, by: AccessKey | None) -> live.LiveState:
        """Close a live campaign: store its ordinary measurement set and its run; return the final state.

        A repeated call creates no second set and no second run.

        Raises:
            NotFoundError: no live campaign has this id.
            RequestError: the campaign has no observation in use.
            JointstiffError: the run cannot be created; the measurement set is stored nevertheless.
        """
        campaign = self._load_campaign(set_id)
        fields = campaign.fields_when_closed()  # raises its error before the campaign is closed
        if not campaign.closed:
            self._add_entry(set_id, Entry("closed", ""), by)
            campaign = self._load_campaign(set_id)
            fields = campaign.fields_when_closed()  # again, with observations that were added meanwhile
        with suppress(NotFoundError):
            self._store.sets.get(set_id)  # an earlier call has stored the set already
            return self.state(set_id)
        request: Any = MeasurementSetRequest.model_construct(**fields)  # type: ignore[arg-type]
        self._resources.sets.create(request, None, set_id)
        self._create_run_once(set_id, campaign, by)
        return self.state(set_id)

    def state(self, set_id: str) -> live.LiveState:
        """Return the state of a live campaign, with its next reading, or with its run after it was closed.

        Raises:
            NotFoundError: no live campaign has this id.
        """
        campaign = self._load_campaign(set_id)
        if not campaign.closed:
            return campaign.state()
        # If closing was interrupted after the set was stored, the run is created here.
        run_id = self._create_run_once(set_id, campaign, None) if self._is_stored(set_id) else None
        return campaign.state(set_id if run_id else None, run_id)

    def revision(self, set_id: str) -> int:
        """Return the number of entries in a campaign's record; raise `NotFoundError` for an unknown id."""
        return len(self._load_campaign(set_id).entries)

    def document(self, set_id: str) -> live.MeasurementSet:
        """Return the set of a live campaign, with its readings so far, as an API message.

        Raises:
            NotFoundError: no live campaign has this id.
        """
        record, campaign = self._store.open_sets.get(set_id), self._load_campaign(set_id)
        declaration = campaign.declaration
        fields = {name: getattr(declaration.header, name) for name in MeasurementSetHeader.model_fields}
        return live.MeasurementSet(
            **fields,
            **frame_fields(declaration.resolved),
            warnings=list(declaration.frame_findings),
            content_hash=None,
            id=set_id,
            robot_id=record.robot_id,
            created_at=record.created_at,
            open=declaration.options,
            observations=campaign.observations,
            live=self.state(set_id),
        )

    def page(self, query: SetQuery) -> Page[MeasurementSetSummary]:
        """Return one page of the live campaigns that are not closed.

        Filters of `query` that only ordinary measurement sets have are ignored.
        """
        page = self._store.open_sets.page(**OpenSetQuery.from_set_query(query).listing_arguments())
        return Page(items=[self.summary(each) for each in page.records], next=page.next, total=page.total)

    def summary(self, record: OpenSetRecord) -> MeasurementSetSummary:
        """Return the summary of a live campaign for listings."""
        campaign = self._load_campaign(record.id)
        return MeasurementSetSummary(
            id=record.id,
            robot_id=record.robot_id,
            name=record.name,
            encoders=campaign.declaration.header.encoders,
            observation_count=len(campaign.observations),
            warning_count=0,
            open=True,
            content_hash=None,
            created_at=record.created_at,
        )

    def is_open(self, set_id: str) -> bool:
        """Return whether an id is that of a live campaign, deleted or not, that was not closed."""
        with suppress(NotFoundError):
            self._store.open_sets.get(set_id, include_deleted=True)
            return not any(entry.change == "closed" for entry in self._store.live_entries.find(set_id=set_id))
        return False

    def apply_change(self, set_id: str, change: SetChange, by: AccessKey | None) -> MeasurementSetSummary:
        """Apply a change to a live campaign: decisions, deletion or restoration; return its summary.

        Raises:
            NotFoundError: no live campaign has this id, or it was deleted.
            RequestError: the campaign has no such observation, the posture to skip is not the next posture,
                or a declared field would change.
        """
        declared_fields = change.model_fields_set - {"deleted", "withdrawn", "kept", "skipped"}
        if declared_fields:
            raise RequestError(
                "the declaration of a live campaign cannot be changed",
                where=min(declared_fields),
                remedy="first close the campaign; or delete the campaign, and declare another live campaign",
            )
        if change.deleted is False:
            self._store.open_sets.restore(set_id)
        self._add_decisions(set_id, change, by)
        record = self._store.open_sets.get(set_id)
        summary = self.summary(record)
        if change.deleted:
            self._store.open_sets.delete(set_id)
        return summary

    def _is_stored(self, set_id: str) -> bool:
        """Return whether a closed set was stored as an ordinary measurement set."""
        with suppress(NotFoundError):
            return bool(self._store.sets.get(set_id))
        return False

    def _create_run_once(self, set_id: str, campaign: LiveCampaign, by: AccessKey | None) -> str:
        """Create the run of a closed campaign, or find the run that was created before; return its id."""
        # The idempotency key depends on the set only: with the same key the store returns the first run.
        key = IdempotencyKey(f"closed {set_id}", "closed")
        return self._create_run(RunRequest(measurement_set_id=set_id, **campaign.run_options), key, by)

    def _load_campaign(self, set_id: str) -> LiveCampaign:
        """Return a live campaign with all entries of its record.

        A campaign in memory is continued with the entries that it lacks, because its computations are cached.

        Raises:
            NotFoundError: no live campaign has this id, or it was deleted.
        """
        entries = [
            _ENTRY.validate_json(entry.document) for entry in self._store.live_entries.find(set_id=set_id)
        ]
        campaign = self._cached_campaigns.get(set_id)
        # More entries in memory than in the store can only be those of a set that was removed.
        if campaign is None or len(campaign.entries) > len(entries):
            campaign = LiveCampaign(self._declaration(set_id))
        for entry in entries[len(campaign.entries) :]:
            campaign = campaign.with_entry(entry)
        self._store.open_sets.get(set_id)  # raises an error if the set was deleted meanwhile
        if len(self._cached_campaigns) >= _CAMPAIGNS:
            self._cached_campaigns.clear()
        self._cached_campaigns[set_id] = campaign
        return campaign

    def _add_entry(self, set_id: str, entry: Entry, by: AccessKey | None) -> Entry:
        """Add an entry to the record of a live campaign and return the entry.

        If an entry of the same kind and label is stored, that entry is returned and nothing is added.
        """
        record = LiveEntry(
            set_id=set_id,
            change=entry.change,
            label=entry.label,
            noted_at=datetime.now(UTC),
            key_name=None if by is None else by.name,
            document=_ENTRY.dump_json(entry).decode(),
        )
        return _ENTRY.validate_json(self._store.live_entries.add(record).document)

    def _load_declaration(self, set_id: str) -> Declaration:
        """Read the declaration of a live campaign from the store."""
        record = self._store.open_sets.get(set_id)
        header = live.MeasurementSetPost.model_validate_json(record.document)
        if header.open is not None:  # older records may state the load point in one place only
            header = complete_declaration(header, header.open)
        robot, _ = self._resources.robots.load(record.robot_id)
        resolved = None if record.resolved is None else ResolvedFrame.model_validate_json(record.resolved)
        return Declaration(robot, header, resolved, _FINDINGS.validate_json(record.warnings))

    def _take_options_from_plan(self, options: live.LiveOptions) -> live.LiveOptions:
        """Return live options; if they name a plan, options that they do not state are those of the plan.

        Raises:
            RequestError: the plan does not exist, has no result, or is that of a weight step.
        """
        if options.plan_id is None:
            return options
        try:
            plan = load_job(self._store, Plan, options.plan_id)
        except NotFoundError as error:
            raise RequestError(error.reason, remedy=error.remedy, where="open.plan_id") from error
        if plan.result is None:
            raise RequestError(
                "the plan has no result", remedy="give a plan that has succeeded", where="open.plan_id"
            )
        refuse_step_plan(plan)
        options_of_plan: dict[str, Any] = {
            name: getattr(plan.request, name)
            for name in ReadingOptions.model_fields
            if name in plan.request.model_fields_set and name != "candidates"
        }
        options_of_plan |= {"targets": plan.result.targets, "load_point": plan.result.load_point}
        if options_of_plan.get("load") is None:
            options_of_plan["load"] = _find_load_of_plan(plan.result)
        # Options that the request states itself take precedence over those of the plan.
        completing_options = {
            name: value for name, value in options_of_plan.items() if name not in options.model_fields_set
        }
        return options.model_copy(update=completing_options)


def _find_load_of_plan(result: PlanResult) -> DeadWeight | AnyDirection | None:
    """Return the load of a plan: a dead weight if all its forces point down; None if all forces are zero."""
    forces = [reading.force for reading in result.readings]
    greatest_force = max((math.hypot(*force) for force in forces), default=0.0)
    if greatest_force == 0.0:
        return None
    if all(z <= 0.0 and math.hypot(x, y) <= 1e-9 * greatest_force for x, y, z in forces):
        return DeadWeight(force=greatest_force)
    return AnyDirection(kind="any_direction", force=greatest_force)
