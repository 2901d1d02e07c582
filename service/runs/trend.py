"""Trends: comparable runs of a robot over time, and the change from the first to the latest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property, lru_cache
from math import hypot, inf
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict

from jointstiff.schemas import trend as messages
from jointstiff.schemas.finding import Assessment, Verdict
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.options import Method, Weighting
from jointstiff.schemas.robot import ChangedJoint, Estimate, LastCampaign
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.resources.stored import robot_from_record
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import MeasurementSetEntry, RobotEntry
from jointstiff.solver.comparison.campaigns import CHANGED_LEVEL, Change, log_stiffness

_MOST_RUNS: Final = 2_000
_REMEMBERED: Final = 2_000
_OPEN_INTERVAL = "the stiffness has no upper limit, or its uncertainty exceeds a quarter of it"


Stated = Annotated[bool, BeforeValidator(bool)]
"""True if a field of a run has a value other than null, zero or empty; the value itself is not kept."""


class _Part(BaseModel):
    """Base of the parts of a stored run that a trend reads; other fields are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, from_attributes=True)


class _Options(_Part):
    method: Method = RunRequest.model_fields["method"].default
    weighting: Weighting = RunRequest.model_fields["weighting"].default
    positive: bool = RunRequest.model_fields["positive"].default
    complementary_stiffness: Literal["neglected", "included"] = RunRequest.model_fields[
        "complementary_stiffness"
    ].default
    weight: Stated = False
    priors: Stated = False
    stiffness_bounds: Stated = False
    stiffness_order: Stated = False


class _Joint(_Part):
    name: str
    kind: StatedKind = "revolute"
    status: str = "identified"
    verdict: Verdict = "use"
    compliance: float | None = None
    standard_uncertainty: float | None = None
    stiffness: float | None = None
    stiffness_interval: tuple[float, float | None] | None = None
    reason: str | None = None


class _Component(_Part):
    source: str
    included: bool = True
    degrees_of_freedom: float | None = None
    contributions: list[float]


class _Budget(_Part):
    joints: list[str]
    components: list[_Component]

    def contributions_to(self, joint: str) -> dict[str, float]:
        """Return source → contribution to a joint's standard uncertainty; empty for an unknown joint."""
        if joint not in self.joints:
            return {}
        index = self.joints.index(joint)
        return {part.source: part.contributions[index] for part in self.components if part.included}


class _Numbers(_Part):
    joints: list[_Joint]
    assessment: Assessment
    links: Stated = False
    budget: _Budget | None = None


class ReadRun(_Part):
    """Part of a run that a trend reads, as stored in the run's row."""

    request: _Options = _Options()
    result: _Numbers


def extract_trend_json(run: Run) -> str | None:
    """Return the part of a run that a trend reads, as JSON; None if the run has no result."""
    if run.result is None:
        return None
    return ReadRun.model_validate(run).model_dump_json(exclude_defaults=True)


@dataclass(frozen=True)
class Campaign:
    """A run, and the measurement set from which the run identified the robot."""

    run_id: str
    created_at: datetime  # when the run was posted
    run: ReadRun
    measured: MeasurementSetEntry

    @property
    def at(self) -> datetime:
        """Time of the measurement; time of storing if the set does not state it."""
        return self.measured.measured_at or self.measured.created_at

    @cached_property
    def joints(self) -> Mapping[str, _Joint]:
        """Joint's name → result of the run for this joint."""
        return {joint.name: joint for joint in self.run.result.joints}

    def sources(self, joint: str) -> dict[str, float]:
        """Return source → contribution to the uncertainty of a joint's compliance; empty if unknown."""
        budget = self.run.result.budget
        return {} if budget is None else budget.contributions_to(joint)

    @property
    def selection(self) -> messages.TrendSelection:
        """Serial number and options, which all campaigns of one trend share."""
        request = self.run.request
        return messages.TrendSelection(
            serial_number=self.measured.serial_number,
            method=request.method,
            weighting=request.weighting,
            positive=request.positive,
            encoders="secondary" if self.measured.encoders == "secondary" else "motor",
            complementary_stiffness=request.complementary_stiffness,
        )


def compare_campaigns(names: Sequence[str], campaigns: Sequence[Campaign]) -> dict[str, Any]:
    """Compare campaigns of a robot; return the trend's fields `campaigns`, `joints`, `level` and `note`.

    Args:
        names: names of the robot's joints.
        campaigns: comparable campaigns, oldest first.
    """
    changes = {name: _estimate_change(campaigns, name) for name in names}
    # The more joints are tested, the stricter each test has to be.
    tested = sum(1 for change in changes.values() if change is not None)
    joints = [_summarise_joint(campaigns, name, changes[name], tested) for name in names]
    return {
        "campaigns": [
            messages.TrendCampaign(
                run_id=one.run_id,
                measurement_set_id=one.measured.id,
                name=one.measured.name,
                at=one.at,
                time_source="created_at" if one.measured.measured_at is None else "measured_at",
                assessment=one.run.result.assessment,
            )
            for one in campaigns
        ],
        "joints": joints,
        "level": CHANGED_LEVEL,
        "note": _write_note(campaigns, joints),
    }


def _estimate_change(campaigns: Sequence[Campaign], name: str) -> Change | None:
    """Return the change of a joint's stiffness from the first to the latest campaign that determines it.

    None if fewer than two campaigns determine the stiffness.
    """
    known = [one for one in campaigns if _comparable_log_stiffness(one, name) is not None]
    if len(known) < 2:
        return None
    pair = known[0], known[-1]
    instruments = {one.measured.instrument for one in pair}
    # A budget with a single source says nothing about the load cell.
    budgets = [sources for one in pair if len(sources := one.sources(name)) > 1]
    first, last = (
        _comparable_log_stiffness(
            one,
            name,
            same_load_cell=len(instruments) == 1 and None not in instruments,
            # If neither campaign states the scale of its load cell, both are taken to use the same cell.
            assumed_cell=all(budget.get("assumed_force_scale", 0.0) > 0.0 for budget in budgets),
        )
        for one in pair
    )
    if first is None or last is None:
        return None
    return Change.between(first, last, min(map(_fewest_degrees_of_freedom, pair)))


def _fewest_degrees_of_freedom(campaign: Campaign) -> float:
    """Return the fewest degrees of freedom of the budget's included components; inf if none has a number."""
    budget = campaign.run.result.budget
    components = () if budget is None else budget.components
    degrees = (part.degrees_of_freedom for part in components if part.included)
    return min((each for each in degrees if each is not None), default=inf)


def _comparable_log_stiffness(
    campaign: Campaign,
    name: str,
    *,
    same_load_cell: bool = False,
    assumed_cell: bool = False,
) -> tuple[float, float] | None:
    """Return ln k of a joint's stiffness k, and the standard uncertainty of ln k.

    Errors that the flags declare the same in both compared campaigns are left out of the uncertainty. None
    if the joint has no stiffness to compare.
    """
    joint = campaign.joints.get(name)
    if joint is None or joint.status != "identified" or joint.verdict == "do_not_use":
        return None
    is_shared = {
        "force_scale": same_load_cell,
        "assumed_force_scale": assumed_cell,
    }
    shared = hypot(*(size for source, size in campaign.sources(name).items() if is_shared.get(source, False)))
    return log_stiffness(joint.compliance, joint.standard_uncertainty, shared)


def _summarise_joint(
    campaigns: Sequence[Campaign], name: str, change: Change | None, tested: int
) -> messages.TrendJoint:
    """Return a joint's points and its change; `tested` is the number of joints tested for a change."""
    return messages.TrendJoint(
        name=name,
        kind=next((one.joints[name].kind for one in campaigns if name in one.joints), "revolute"),
        points=[_summarise_point(campaign, name) for campaign in campaigns],
        change=None if change is None else _relative_change(change),
        p_value=None if change is None else change.p_value,
        changed=change is not None and change.is_significant(tested),
    )


def _summarise_point(campaign: Campaign, name: str) -> messages.TrendPoint:
    """Return the stiffness of a joint in a campaign, with the reason if the stiffness cannot be compared."""
    joint = campaign.joints.get(name)
    if joint is None:
        return messages.TrendPoint(reason="the run has no joint of this name")
    reason = None if _comparable_log_stiffness(campaign, name) else _OPEN_INTERVAL
    if joint.status != "identified":
        reason = joint.reason or f"the joint is {joint.status.replace('_', ' ')}"
    elif joint.verdict == "do_not_use":
        reason = joint.reason or "its verdict is: do not use"
    return messages.TrendPoint(stiffness=joint.stiffness, interval=joint.stiffness_interval, reason=reason)


def _relative_change(change: Change) -> Estimate:
    """Return the change as a share of the first stiffness, with its standard uncertainty."""
    return Estimate(value=change.relative, standard_uncertainty=change.relative_uncertainty)


def _write_note(campaigns: Sequence[Campaign], joints: Sequence[messages.TrendJoint]) -> str | None:
    """Return a remark on too few campaigns, or on most joints changing in one direction; None otherwise."""
    if not campaigns:
        return "no campaign: identify measurement sets of this robot by the same method"
    if len(campaigns) == 1:
        return "only one campaign: a second one is needed to compare"
    signs = [joint.change.value > 0.0 for joint in joints if joint.changed and joint.change is not None]
    # Joints seldom soften together: if most of them changed in one direction, the load is probably wrong.
    alike = max(signs.count(True), signs.count(False))
    if alike > 2 and 2 * alike > len(joints):
        return (
            f"{alike} of {len(joints)} joints changed in one direction, which suggests an error of the "
            "force: check the load of the first and of the latest campaign"
        )
    return None


def group_by_selection(
    runs: Iterable[Sequence[Campaign]],
) -> dict[messages.TrendSelection, list[Campaign]]:
    """Group campaigns by serial number and options; return selection → campaigns.

    Args:
        runs: for each measurement set its runs, newest first. If several runs of a set have the same
            options, only the newest of them is used.
    """
    groups: dict[messages.TrendSelection, list[Campaign]] = {}
    for runs_of_set in runs:
        newest_of_set: dict[messages.TrendSelection, Campaign] = {}
        for one in runs_of_set:
            if _reason_not_charted(one) is None:
                newest_of_set.setdefault(one.selection, one)
        for selection, one in newest_of_set.items():
            groups.setdefault(selection, []).append(one)
    return groups


def choose_selection(
    runs: Iterable[Sequence[Campaign]], query: messages.TrendQuery
) -> messages.TrendSelection | None:
    """Choose the trend to show: the newest campaign's serial number, and the options with most campaigns.

    Return the selection; None if no selection matches the query. Counting campaigns keeps a single run with
    other options from ending a trend.
    """
    filters = query.model_dump(exclude_none=True)
    matching = {
        selection: campaigns
        for selection, campaigns in group_by_selection(runs).items()
        if filters.items() <= selection.model_dump().items()
    }
    newest = {selection: max(map(_time_order, campaigns)) for selection, campaigns in matching.items()}
    if not matching:
        return None
    serial_number = max(matching, key=lambda each: newest[each]).serial_number
    same_serial = [each for each in matching if each.serial_number == serial_number]
    return max(same_serial, key=lambda each: (len(matching[each]), newest[each]))


def _time_order(campaign: Campaign) -> tuple[datetime, datetime]:
    """Return the key for sorting campaigns: time of measurement, then time of the run."""
    return campaign.at, campaign.created_at


def _reason_not_charted(candidate: Campaign) -> str | None:
    """Return why a run may not be part of any trend; None if the run may be part of one."""
    request, result = candidate.run.request, candidate.run.result
    verdict = result.assessment
    if verdict.verdict == "do_not_use":
        why = f" ({verdict.reasons[0].message})" if verdict.reasons else ""
        return f"its assessment is: do not use{why}"
    if result.links:
        return "it has elastic links or coupling, so its joint stiffnesses are effective values"
    if request.weight:
        return "it was identified by own weight, so that an error of the masses shifts all stiffnesses"
    for name, value in (
        ("priors", request.priors),
        ("bounds of the stiffness", request.stiffness_bounds),
        ("an order of the joints", request.stiffness_order),
    ):
        if value:
            return f"it was identified with {name}, which shift the stiffnesses"
    return None


def split_by_comparability(
    sets: Sequence[MeasurementSetEntry],
    runs: Mapping[str, Sequence[Campaign]],
    selection: messages.TrendSelection | None,
) -> tuple[list[Campaign], list[messages.LeftOut]]:
    """Return the campaigns that belong to a trend, oldest first, and the other sets, each with the reason.

    Args:
        sets: measurement sets of the robot.
        runs: set's id → campaigns made of this set, newest first.
        selection: serial number and options of the trend; None if no run matches the query.
    """
    entering, left_out = [], []
    for measured in sets:
        candidates = runs.get(measured.id, ())
        comparable = [run for run in candidates if _reason_not_comparable(run, selection) is None]
        if comparable:
            entering.append(comparable[0])
        else:
            reason = (
                _reason_not_comparable(candidates[0], selection)
                if candidates
                else "it has no run with stiffnesses"
            )
            left_out.append(
                messages.LeftOut(measurement_set_id=measured.id, name=measured.name, reason=reason or "")
            )
    entering.sort(key=lambda candidate: (candidate.at, candidate.measured.created_at))
    return entering, left_out


def _reason_not_comparable(candidate: Campaign, selection: messages.TrendSelection | None) -> str | None:
    """Return why a run does not belong to the trend of a selection; None if the run belongs to the trend."""
    if (unfit := _reason_not_charted(candidate)) is not None or selection is None:
        return unfit or "no run of this set matches the query"
    own, required = candidate.selection.model_dump(), selection.model_dump()
    differing = [name for name in required if own[name] != required[name]]
    return ", ".join(f"{name.replace('_', ' ')}: {_show_value(own[name])}" for name in differing) or None


def _show_value(value: object) -> str:
    """Return the value of an option in words."""
    if value is None:
        return "not stated"
    return ("yes" if value else "no") if isinstance(value, bool) else str(value).replace("_", " ")


class Trends:
    """The trends of a store's robots."""

    def __init__(self, store: Store) -> None:
        self._store = store
        # Parsed runs are cached: a run never changes once it has ended.
        self._read_run = lru_cache(_REMEMBERED)(ReadRun.model_validate_json)

    def trend(self, robot_id: str, query: messages.TrendQuery) -> messages.Trend:
        """Return the trend of a robot.

        Raises:
            NotFoundError: there is no such robot.
        """
        names = [joint.name for joint in robot_from_record(self._store.robots.get(robot_id)).joints]
        sets = self._store.sets_of_robot(robot_id)
        runs = self._runs_by_set(robot_id, sets)
        selection = choose_selection(runs.values(), query)
        entering, left_out = split_by_comparability(sets, runs, selection)
        return messages.Trend(
            robot_id=robot_id,
            selection=selection,
            serial_numbers=sorted({one.serial_number for one in sets if one.serial_number is not None}),
            left_out=left_out,
            **compare_campaigns(names, entering),
        )

    def last_campaign(self, entry: RobotEntry) -> LastCampaign | None:
        """Return the latest campaign of a robot and the joints that changed; None without a campaign.

        This summary is cached in the robot's row, and renewed if runs or sets changed since it was written.
        """
        if entry.is_current:
            return None if entry.campaign is None else LastCampaign.model_validate(entry.campaign)
        found = self._summarise_last_campaign(entry.id)
        # If the database cannot be written now, the summary is made again next time.
        with suppress(StoreUnavailableError):
            self._store.robots.store_last_campaign(
                entry, None if found is None else found.model_dump(mode="json")
            )
        return found

    def renew_outdated_summaries(self, most: int) -> None:
        """Renew the outdated summaries of at most `most` robots, so that listing the robots is fast."""
        for entry in self._store.robots.list_outdated(most):
            self.last_campaign(entry)

    def _summarise_last_campaign(self, robot_id: str) -> LastCampaign | None:
        """Return a robot's newest run with the joints that changed in any trend; None without runs."""
        sets = self._store.sets_of_robot(robot_id)
        runs = self._runs_by_set(robot_id, sets)
        if not runs:
            return None
        newest = max((one for candidates in runs.values() for one in candidates), key=_time_order)
        return LastCampaign(
            run_id=newest.run_id,
            at=newest.at,
            serial_number=newest.measured.serial_number,
            verdict=newest.run.result.assessment.verdict,
            changed=self._find_changed_joints(robot_id, sets, runs, newest.measured.serial_number),
        )

    def _find_changed_joints(
        self,
        robot_id: str,
        sets: Sequence[MeasurementSetEntry],
        runs: Mapping[str, Sequence[Campaign]],
        newest: str | None,
    ) -> list[ChangedJoint]:
        """Return the joints that changed in any trend of the robot, at most once for each serial number.

        Joints of the serial number `newest` come first. If a joint changed in several trends, its change in
        the trend with most campaigns is returned.
        """
        names = [joint.name for joint in robot_from_record(self._store.robots.get(robot_id)).joints]
        found: dict[tuple[str | None, str], ChangedJoint] = {}
        by_options = group_by_selection(runs.values())
        for selection in sorted(by_options, key=lambda each: len(by_options[each]), reverse=True):
            entering, _ = split_by_comparability(sets, runs, selection)
            for joint in compare_campaigns(names, entering)["joints"]:
                if joint.changed and joint.change is not None:
                    arm = selection.serial_number
                    of_arm = ChangedJoint(joint=joint.name, serial_number=arm, change=joint.change)
                    found.setdefault((arm, joint.name), of_arm)
        order = {name: place for place, name in enumerate(names)}
        return sorted(
            found.values(),
            key=lambda each: (each.serial_number != newest, each.serial_number or "", order[each.joint]),
        )

    def _runs_by_set(self, robot_id: str, sets: Iterable[MeasurementSetEntry]) -> dict[str, list[Campaign]]:
        """Return measurement set's id → campaigns made of this set that have a result, newest first."""
        known = {one.id: one for one in sets}
        candidates: dict[str, list[Campaign]] = {}
        for entry in self._store.runs_with_numbers(robot_id, _MOST_RUNS):
            if (measured := known.get(entry.measurement_set_id)) is not None:
                one = Campaign(entry.id, entry.created_at, self._read_run(entry.trend), measured)
                candidates.setdefault(measured.id, []).append(one)
        return candidates
