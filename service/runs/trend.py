"""Trends: comparable runs of a robot over time, and the change from the first to the latest."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property, lru_cache
from math import hypot, inf
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict

from jointstiff.schemas import trend as messages
from jointstiff.schemas.finding import Assessment, Verdict
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.options import Method, Weighting
from jointstiff.schemas.robot import ChangedJoint, Estimate, LastCampaign, MeasuredArm
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.resources.stored import robot_from_record
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import MeasurementSetEntry, RobotEntry
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.comparison.campaigns import CHANGED_LEVEL, Change, SharedErrors, log_stiffness

_MAX_RUNS: Final = 2_000
_OWN: Final = SharedErrors()
_MAX_CACHED_RUNS: Final = 4_000
_OPEN_INTERVAL = "the stiffness has no upper limit, or its uncertainty exceeds a quarter of the stiffness"


Stated = Annotated[bool, BeforeValidator(bool)]
"""True if a field of a run has a value other than null, zero or empty; the value itself is not stored."""


class _StoredPart(BaseModel):
    """Base of the parts of a stored run that a trend reads; other fields are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, from_attributes=True)


class _StoredOptions(_StoredPart):
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


class _StoredJoint(_StoredPart):
    name: str
    kind: StatedKind = "revolute"
    status: str = "identified"
    verdict: Verdict = "use"
    compliance: float | None = None
    standard_uncertainty: float | None = None
    stiffness: float | None = None
    stiffness_interval: tuple[float, float | None] | None = None
    reason: str | None = None


class _StoredComponent(_StoredPart):
    source: str
    included: bool = True
    degrees_of_freedom: float | None = None
    contributions: list[float]
    responses: list[tuple[float, float, float]] | None = None


class _StoredBudget(_StoredPart):
    joints: list[str]
    components: list[_StoredComponent]

    def contributions_to(self, joint: str) -> dict[str, float]:
        """Return source → contribution to a joint's standard uncertainty; empty for an unknown joint."""
        if joint not in self.joints:
            return {}
        index = self.joints.index(joint)
        return {part.source: part.contributions[index] for part in self.components if part.included}

    def responses_to_load_point(self, joint: str) -> tuple[float, float, float] | None:
        """Return changes of a joint's compliance by one standard uncertainty of the load point.

        The changes [rad/(N·m)] are along the axes of the flange; None if the run does not state them.
        """
        if joint not in self.joints:
            return None
        index = self.joints.index(joint)
        return next((part.responses[index] for part in self.components if part.responses is not None), None)


class _StoredResult(_StoredPart):
    joints: list[_StoredJoint]
    assessment: Assessment
    links: Stated = False
    budget: _StoredBudget | None = None


class ReadRun(_StoredPart):
    """Part of a run that a trend reads, as stored in the run's row."""

    request: _StoredOptions = _StoredOptions()
    result: _StoredResult


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
    def joints(self) -> Mapping[str, _StoredJoint]:
        """Joint's name → result of the run for this joint."""
        return {joint.name: joint for joint in self.run.result.joints}

    def sources(self, joint: str) -> dict[str, float]:
        """Return source → contribution to the uncertainty of a joint's compliance; empty if unknown."""
        budget = self.run.result.budget
        return {} if budget is None else budget.contributions_to(joint)

    def relative_responses_to_load_point(self, joint: str) -> FloatArray | None:
        """Return changes (3,) of ln k of a joint by one standard uncertainty of the load point.

        None if the run does not state the changes or has no compliance of the joint.
        """
        budget, result = self.run.result.budget, self.joints.get(joint)
        responses = None if budget is None else budget.responses_to_load_point(joint)
        if responses is None or result is None or not result.compliance:
            return None
        return -np.array(responses) / result.compliance

    @cached_property
    def selection(self) -> messages.TrendSelection:
        """Serial number and options, which all campaigns of one trend share."""
        request = self.run.request
        return _make_selection(
            serial_number=self.measured.serial_number,
            method=request.method,
            weighting=request.weighting,
            positive=request.positive,
            encoders="secondary" if self.measured.encoders == "secondary" else "motor",
            complementary_stiffness=request.complementary_stiffness,
        )

    @cached_property
    def unfit(self) -> str | None:
        """Reason in words why the run cannot be part of any trend; None if the run can be part of a trend."""
        return _explain_unfit_for_any_trend(self)


@lru_cache(256)
def _make_selection(**fields: Any) -> messages.TrendSelection:  # noqa: ANN401 - fields of the message
    """Return the message of a selection; most campaigns of a robot share one."""
    return messages.TrendSelection(**fields)


def compare_campaigns(
    names: Sequence[str],
    campaigns: Sequence[Campaign],
    *,
    shared: SharedErrors = _OWN,
    most: int = _MAX_RUNS,
    references: Sequence[str] = (),
) -> dict[str, Any]:
    """Compare campaigns of a robot; return the trend's fields about its campaigns and joints.

    Args:
        names: names of the robot's joints.
        campaigns: comparable campaigns, oldest first.
        most: greatest number of campaigns in the fields.
        shared: errors that are the same in all campaigns.
        references: ids of measurement sets; the comparison begins with the latest campaign that is one of
            them, or with the first campaign.
    """
    compared = _drop_before_reference(campaigns, references)
    changes = {name: _estimate_change(compared, name, shared) for name in names}
    # The more joints are tested, the stricter each test has to be.
    test_count = sum(1 for change in changes.values() if change is not None)
    shown = choose_shown(names, campaigns, most, compared)
    has_assessments = len(shown) <= messages.MOST_ASSESSED
    joints = [_summarise_joint(shown, name, changes[name], test_count) for name in names]
    reference_set_id = None if compared is campaigns else compared[0].measured.id
    return {
        "campaign_count": len(campaigns),
        "campaigns": [_describe_campaign(campaign, has_assessment=has_assessments) for campaign in shown],
        "reference_set_id": reference_set_id,
        "joints": joints,
        "level": CHANGED_LEVEL,
        "note": _write_note(compared, joints, shared),
    }


def _describe_campaign(campaign: Campaign, *, has_assessment: bool) -> messages.TrendCampaign:
    """Return the message of a campaign in a trend; with its whole assessment if `has_assessment` is true."""
    measured, assessment = campaign.measured, campaign.run.result.assessment
    return messages.TrendCampaign(
        run_id=campaign.run_id,
        measurement_set_id=measured.id,
        name=measured.name,
        at=campaign.at,
        time_source="created_at" if measured.measured_at is None else "measured_at",
        verdict=assessment.verdict,
        assessment=assessment if has_assessment else None,
    )


def _drop_before_reference(campaigns: Sequence[Campaign], references: Sequence[str]) -> Sequence[Campaign]:
    """Return the campaigns from the latest reference on; all campaigns if none of them is a reference."""
    for index in reversed(range(len(campaigns))):
        if campaigns[index].measured.id in references:
            return campaigns[index:]
    return campaigns


def _estimate_change(campaigns: Sequence[Campaign], name: str, shared: SharedErrors) -> Change | None:
    """Return the change of a joint's stiffness from the first to the latest campaign that determines it.

    None if fewer than two campaigns determine the stiffness. An error that both campaigns share, such as of
    the load cell, shifts both stiffnesses alike, so it is left out of their uncertainties. A shared error of
    the load point shifts them by different amounts: the difference of these amounts counts.
    """
    compared = _find_compared(campaigns, name)
    if compared is None:
        return None
    first, last = compared
    by_load_point, left_out = 0.0, list[str]()
    difference = _compare_responses_to_load_point(first, last, name) if shared.load else None
    if difference is not None:
        by_load_point = difference
        left_out.append("load_point")
    if shared.cell:
        left_out.append("force_scale")
    first_stiffness = _compute_log_stiffness(first, name, left_out)
    last_stiffness = _compute_log_stiffness(last, name, left_out)
    if first_stiffness is None or last_stiffness is None:
        return None
    freedom = min(_find_fewest_degrees_of_freedom(first), _find_fewest_degrees_of_freedom(last))
    return Change.between(first_stiffness, last_stiffness, freedom, by_load_point)


def _compare_responses_to_load_point(first: Campaign, last: Campaign, name: str) -> float | None:
    """Return by how much an error of the load point that both campaigns share changes their ratio.

    None if a campaign does not state how such an error changes the joint's stiffness.
    """
    response_of_first = first.relative_responses_to_load_point(name)
    response_of_last = last.relative_responses_to_load_point(name)
    if response_of_first is None or response_of_last is None:
        return None
    return float(np.linalg.norm(response_of_first - response_of_last))


def _find_compared(campaigns: Sequence[Campaign], name: str) -> tuple[Campaign, Campaign] | None:
    """Return the first and the latest campaign that determine a joint's stiffness; None without two."""
    first = _find_determining(campaigns, name)
    latest = _find_determining(reversed(campaigns), name)
    if first is None or latest is None or first is latest:
        return None
    return first, latest


def _find_determining(campaigns: Iterable[Campaign], name: str) -> Campaign | None:
    """Return the first of some campaigns that determines a joint's stiffness; None if none does."""
    return next((each for each in campaigns if _compute_log_stiffness(each, name) is not None), None)


def choose_shown(
    names: Sequence[str], campaigns: Sequence[Campaign], most: int, compared: Sequence[Campaign]
) -> Sequence[Campaign]:
    """Return at most about `most` campaigns: some at even distances, and those that joints are compared by.

    Args:
        names: names of the robot's joints.
        campaigns: campaigns of a trend, oldest first.
        most: number of campaigns at even distances, at least two.
        compared: campaigns from the reference on.
    """
    if len(campaigns) <= most:
        return campaigns
    numbers = {round(place) for place in np.linspace(0, len(campaigns) - 1, most)}
    needed = {id(each) for name in names for each in _find_compared(compared, name) or ()}
    needed.add(id(compared[0]))
    return [each for number, each in enumerate(campaigns) if number in numbers or id(each) in needed]


def _find_fewest_degrees_of_freedom(campaign: Campaign) -> float:
    """Return the fewest degrees of freedom of the budget's included components; inf if none has a number."""
    budget = campaign.run.result.budget
    components = () if budget is None else budget.components
    degrees = (part.degrees_of_freedom for part in components if part.included)
    return min((number for number in degrees if number is not None), default=inf)


def _compute_log_stiffness(
    campaign: Campaign, name: str, left_out: Collection[str] = ()
) -> tuple[float, float] | None:
    """Return ln k of a joint's stiffness k, and the standard uncertainty of ln k.

    Return None if the joint has no stiffness to compare.

    Args:
        campaign: one of the two campaigns.
        name: name of the joint.
        left_out: sources of errors, stated or assumed, that are left out of the uncertainty, because they are
            equal in both compared campaigns.
    """
    joint = campaign.joints.get(name)
    if joint is None or joint.status != "identified" or joint.verdict == "do_not_use":
        return None
    shared = [
        contribution
        for source, contribution in campaign.sources(name).items()
        if source.removeprefix("assumed_") in left_out
    ]
    return log_stiffness(joint.compliance, joint.standard_uncertainty, hypot(*shared))


def _summarise_joint(
    campaigns: Sequence[Campaign], name: str, change: Change | None, test_count: int
) -> messages.TrendJoint:
    """Return a joint's points and its change; `test_count` is the number of joints tested."""
    return messages.TrendJoint(
        name=name,
        kind=next(
            (campaign.joints[name].kind for campaign in campaigns if name in campaign.joints), "revolute"
        ),
        points=[_summarise_point(campaign, name) for campaign in campaigns],
        change=None if change is None else _make_estimate_of_change(change),
        p_value=None if change is None else change.p_value,
        unchanged=None if change is None else change.find_unchanged_ratios(test_count),
        changed=change is not None and change.is_significant(test_count),
    )


def _summarise_point(campaign: Campaign, name: str) -> messages.TrendPoint:
    """Return the stiffness of a joint in a campaign, with the reason if the stiffness cannot be compared."""
    joint = campaign.joints.get(name)
    if joint is None:
        return messages.TrendPoint(reason="the run has no joint of this name")
    reason = None if _compute_log_stiffness(campaign, name) else _OPEN_INTERVAL
    if joint.status != "identified":
        reason = joint.reason or f"the joint is {joint.status.replace('_', ' ')}"
    elif joint.verdict == "do_not_use":
        reason = joint.reason or "the verdict on the joint is: do not use"
    return messages.TrendPoint(stiffness=joint.stiffness, interval=joint.stiffness_interval, reason=reason)


def _make_estimate_of_change(change: Change) -> Estimate:
    """Return the change relative to the first stiffness, with the standard uncertainty of the change."""
    return Estimate(value=change.relative, standard_uncertainty=change.relative_uncertainty)


def _write_note(
    campaigns: Sequence[Campaign], joints: Sequence[messages.TrendJoint], shared: SharedErrors
) -> str | None:
    """Return a remark on too few campaigns, on joints that change together, or on load points; else None."""
    if not campaigns:
        return "no campaign: identify measurement sets of this robot by the same method"
    if len(campaigns) == 1:
        return "only one campaign: a second one is needed to compare"
    note = _note_joints_that_agree(joints)
    if note is None and shared.load:
        note = _note_unknown_load_points(campaigns, joints)
    return note


def _note_joints_that_agree(joints: Sequence[messages.TrendJoint]) -> str | None:
    """Return a remark if most joints, and three at least, changed in one direction; else None.

    Joints seldom soften together: a wrong force is more probable, which scales all stiffnesses alike.
    """
    signs = [joint.change.value > 0.0 for joint in joints if joint.changed and joint.change is not None]
    agreeing = max(signs.count(True), signs.count(False))
    if agreeing <= 2 or 2 * agreeing <= len(joints):
        return None
    return (
        f"{agreeing} of {len(joints)} joints changed in one direction; this suggests an error of "
        "the force: check the load of the first and of the latest campaign"
    )


def _note_unknown_load_points(
    campaigns: Sequence[Campaign], joints: Sequence[messages.TrendJoint]
) -> str | None:
    """Return a remark on campaigns that do not state how an error of the load point changes a stiffness."""
    without = list[str]()
    for campaign in campaigns:
        responses = [campaign.relative_responses_to_load_point(joint.name) for joint in joints]
        if all(response is None for response in responses):
            without.append(campaign.measured.name)
    if not without:
        return None
    return (
        f"the runs of {', '.join(map(repr, without))} do not state how an error of the load point "
        "changes their stiffnesses, so each of these campaigns has its own error: identify these "
        "sets again with an uncertainty of the load point"
    )


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
        for campaign in runs_of_set:
            if campaign.unfit is None:
                newest_of_set.setdefault(campaign.selection, campaign)
        for selection, campaign in newest_of_set.items():
            groups.setdefault(selection, []).append(campaign)
    return groups


def choose_selection(
    runs: Iterable[Sequence[Campaign]], query: messages.TrendQuery
) -> messages.TrendSelection | None:
    """Choose the trend to show: the newest campaign's serial number, and the options with most campaigns.

    Return the selection; None if no selection matches the query. Counting campaigns keeps a single run with
    other options from ending a trend.
    """
    matching = _find_matching(group_by_selection(runs), query)
    if not matching:
        return None

    def newest_time(selection: messages.TrendSelection) -> tuple[datetime, datetime]:
        return max(map(_sorting_time, matching[selection]))

    serial_number = max(matching, key=newest_time).serial_number
    same_serial = [selection for selection in matching if selection.serial_number == serial_number]
    return max(same_serial, key=lambda selection: (len(matching[selection]), newest_time(selection)))


def _find_matching(
    groups: Mapping[messages.TrendSelection, list[Campaign]], query: messages.TrendQuery
) -> dict[messages.TrendSelection, list[Campaign]]:
    """Return the groups of campaigns whose serial number and options are those that the query states."""
    filters = query.model_dump(exclude_none=True, exclude={"same_load", "same_cell", "campaigns"})
    return {
        selection: campaigns
        for selection, campaigns in groups.items()
        if filters.items() <= selection.model_dump().items()
    }


def _sorting_time(campaign: Campaign) -> tuple[datetime, datetime]:
    """Return the key for sorting campaigns: time of measurement, then time of the run."""
    return campaign.at, campaign.created_at


def _explain_unfit_for_any_trend(campaign: Campaign) -> str | None:
    """Return in words why a run cannot be part of any trend; None if the run can be part of a trend."""
    request, result = campaign.run.request, campaign.run.result
    if result.assessment.verdict == "do_not_use":
        reasons = result.assessment.reasons
        first_reason = f" ({reasons[0].message})" if reasons else ""
        return f"the verdict on its run is: do not use{first_reason}"
    if result.links:
        return "its run has elastic links or coupling, so the joint stiffnesses include the bending of links"
    if request.weight:
        return "its run uses the own weight, so an error of the masses shifts all stiffnesses"
    shifting_options = {
        "priors": request.priors,
        "bounds of the stiffness": request.stiffness_bounds,
        "an order of the joints": request.stiffness_order,
    }
    for name, value in shifting_options.items():
        if value:
            return f"its run uses {name}, which shift the stiffnesses"
    return None


def _sort_by_count_of_campaigns(
    campaigns: Mapping[messages.TrendSelection, Sequence[Campaign]],
) -> list[messages.TrendSelection]:
    """Return the selections of trends, the one with most campaigns first."""
    return sorted(campaigns, key=lambda selection: len(campaigns[selection]), reverse=True)


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
    campaigns_of_trend, left_out = list[Campaign](), list[messages.LeftOut]()
    for measured_set in sets:
        candidates = runs.get(measured_set.id, ())
        reasons = [_explain_unfit_for_selection(candidate, selection) for candidate in candidates]
        if None in reasons:
            newest_comparable = candidates[reasons.index(None)]
            campaigns_of_trend.append(newest_comparable)
            continue
        reason_of_newest = reasons[0] if reasons else "the campaign has no run with stiffnesses"
        left_out.append(
            messages.LeftOut(
                measurement_set_id=measured_set.id, name=measured_set.name, reason=reason_of_newest or ""
            )
        )
    campaigns_of_trend.sort(key=lambda campaign: (campaign.at, campaign.measured.created_at))
    return campaigns_of_trend, left_out


def _explain_unfit_for_selection(campaign: Campaign, selection: messages.TrendSelection | None) -> str | None:
    """Return in words why a run does not belong to the trend of a selection; None if it does."""
    if campaign.unfit is not None or selection is None:
        return campaign.unfit or "no run of this set matches the query"
    if campaign.selection == selection:
        return None
    own_values, trend_values = campaign.selection.model_dump(), selection.model_dump()
    differing = [name for name in trend_values if own_values[name] != trend_values[name]]
    return (
        ", ".join(f"{name.replace('_', ' ')}: {_show_value(own_values[name])}" for name in differing) or None
    )


def _show_value(value: object) -> str:
    """Return the value of an option in words."""
    if value is None:
        return "not stated"
    return ("yes" if value else "no") if isinstance(value, bool) else str(value).replace("_", " ")


_SOFTER_RANK: Final = 1e6  # is added to the rank of a softer joint, which is worse than any stiffer one


def rank_changes(changes: Iterable[Estimate]) -> float:
    """Return the rank of an arm by the changes of its joints; the arm of the greatest rank is the worst.

    The rank is the greatest ratio of a change to its standard uncertainty, at most 1e6. Softer joints have
    1e6 more. The rank is 0 without a change.
    """
    ranks = [0.0]
    for change in changes:
        uncertainty = change.standard_uncertainty
        ratio = abs(change.value) / uncertainty if uncertainty else _SOFTER_RANK
        is_softer = change.value < 0.0
        ranks.append(min(ratio, _SOFTER_RANK) + (_SOFTER_RANK if is_softer else 0.0))
    return max(ranks)


@dataclass(frozen=True)
class CampaignSummary:
    """The latest campaign of a robot, None before its first run; and its arms with a run, the worst first."""

    last: LastCampaign | None
    arms: list[MeasuredArm]

    @classmethod
    def from_stored(cls, campaign: dict[str, Any] | None, arms: list[Any] | None) -> CampaignSummary:
        """Return the summary of what the store keeps of a robot."""
        last = None if campaign is None else LastCampaign.model_validate(campaign)
        return cls(last, [MeasuredArm.model_validate(arm) for arm in arms or ()])


class _JointOfArm(NamedTuple):
    """A joint of one of the arms of a robot's model."""

    serial_number: str | None  # of the arm; None if its measurement sets state none
    name: str  # of the joint


class _TestedJoints(NamedTuple):
    """Joints that the trends of a robot test, in the order of the joints, each once for each arm."""

    tested: list[_JointOfArm]
    changed: list[ChangedJoint]  # those whose stiffness changed


def _describe_last_campaign(newest: Campaign, changed: Iterable[ChangedJoint]) -> LastCampaign:
    """Return the message of a robot's newest run with the changed joints, those of its own arm first."""
    own_number = newest.measured.serial_number

    def order_of_arm(joint: ChangedJoint) -> tuple[bool, str]:
        """Return the key that sorts joints of the newest measured arm first."""
        return joint.serial_number != own_number, joint.serial_number or ""

    return LastCampaign(
        run_id=newest.run_id,
        at=newest.at,
        serial_number=own_number,
        verdict=newest.run.result.assessment.verdict,
        changed=sorted(changed, key=order_of_arm),
    )


def _describe_arms(campaigns: Sequence[Campaign], joints: _TestedJoints) -> list[MeasuredArm]:
    """Return a message for each serial number in the campaigns, the arm with the greatest change first."""
    arms = list[MeasuredArm]()
    for serial_number in {campaign.measured.serial_number for campaign in campaigns}:
        times = [each.at for each in campaigns if each.measured.serial_number == serial_number]
        changes = [each.change for each in joints.changed if each.serial_number == serial_number]
        tested = [each.name for each in joints.tested if each.serial_number == serial_number]
        rank = rank_changes(changes)
        arms.append(MeasuredArm(serial_number=serial_number, at=max(times), tested=tested, rank=rank))
    arms.sort(key=lambda arm: (arm.rank, arm.at), reverse=True)
    return arms


class Trends:
    """The trends of a store's robots."""

    def __init__(self, store: Store) -> None:
        self._store = store
        # Id of a run → the parsed run, in the order of reading: a run never changes once it has ended.
        self._cached_runs: dict[str, ReadRun] = {}

    def trend(self, robot_id: str, query: messages.TrendQuery) -> messages.Trend:
        """Return the trend of a robot.

        Raises:
            NotFoundError: there is no such robot.
        """
        robot = robot_from_record(self._store.robots.get(robot_id))
        sets = self._store.sets_of_robot(robot_id)
        runs = self._group_runs_by_set(robot_id, sets)
        selection = choose_selection(runs.values(), query)
        campaigns_of_trend, left_out = split_by_comparability(sets, runs, selection)
        fields_of_comparison = compare_campaigns(
            [joint.name for joint in robot.joints],
            campaigns_of_trend,
            shared=SharedErrors(load=query.same_load, cell=query.same_cell),
            most=query.campaigns,
            references=robot.reference_set_ids,
        )
        serial_numbers = {entry.serial_number for entry in sets if entry.serial_number is not None}
        return messages.Trend(
            robot_id=robot_id,
            selection=selection,
            serial_numbers=sorted(serial_numbers),
            left_out=left_out,
            **fields_of_comparison,
        )

    def summarise(self, entry: RobotEntry) -> CampaignSummary:
        """Return the latest campaign of a robot and its measured arms.

        This summary is cached with the robot, and renewed if the robot, its runs or its sets changed since it
        was written.
        """
        if entry.is_current:
            return CampaignSummary.from_stored(entry.campaign, entry.arms)
        summary = self._summarise_anew(entry.id)
        # If the database cannot be written now, the summary is made again next time.
        with suppress(StoreUnavailableError):
            last, arms = summary.last, summary.arms
            self._store.robots.store_last_campaign(
                entry,
                None if last is None else last.model_dump(mode="json"),
                [arm.model_dump(mode="json") for arm in arms],
                max((arm.rank for arm in arms), default=None),
            )
        return summary

    def renew_outdated_summaries(self, limit: int) -> None:
        """Renew the outdated summaries of at most `limit` robots, so that listing the robots is fast."""
        for entry in self._store.robots.list_outdated(limit):
            self.summarise(entry)

    def _summarise_anew(self, robot_id: str) -> CampaignSummary:
        """Return a robot's newest run and its arms, with the joints that any trend tests or finds changed."""
        sets = self._store.sets_of_robot(robot_id)
        runs = self._group_runs_by_set(robot_id, sets)
        if not runs:
            return CampaignSummary(None, [])
        campaigns = [campaign for candidates in runs.values() for campaign in candidates]
        newest = max(campaigns, key=_sorting_time)
        joints = self._test_joints(robot_id, sets, runs)
        last = _describe_last_campaign(newest, joints.changed)
        return CampaignSummary(last, _describe_arms(campaigns, joints))

    def _test_joints(
        self,
        robot_id: str,
        sets: Sequence[MeasurementSetEntry],
        runs: Mapping[str, Sequence[Campaign]],
    ) -> _TestedJoints:
        """Return the joints that any trend of the robot tests, and those that changed.

        If a joint changed in several trends, the change in the trend with most campaigns is returned.

        Args:
            robot_id: id of the robot.
            sets: measurement sets of the robot.
            runs: set's id → campaigns made of this set, newest first.
        """
        robot = robot_from_record(self._store.robots.get(robot_id))
        names = [joint.name for joint in robot.joints]
        tested = set[_JointOfArm]()
        changed = dict[_JointOfArm, ChangedJoint]()
        for selection in _sort_by_count_of_campaigns(group_by_selection(runs.values())):
            campaigns_of_trend, _ = split_by_comparability(sets, runs, selection)
            fields = compare_campaigns(names, campaigns_of_trend, most=2, references=robot.reference_set_ids)
            for joint in fields["joints"]:
                key = _JointOfArm(selection.serial_number, joint.name)
                if joint.change is not None:
                    tested.add(key)
                if joint.change is not None and joint.changed:
                    # An earlier trend has more campaigns, so its change is kept.
                    message = ChangedJoint(
                        joint=key.name, serial_number=key.serial_number, change=joint.change
                    )
                    changed.setdefault(key, message)
        return _TestedJoints(
            sorted(tested, key=lambda each: names.index(each.name)),
            sorted(changed.values(), key=lambda each: names.index(each.joint)),
        )

    def _group_runs_by_set(
        self, robot_id: str, sets: Iterable[MeasurementSetEntry]
    ) -> dict[str, list[Campaign]]:
        """Return measurement set's id → campaigns made of this set that have a result, newest first."""
        set_by_id = {campaign.id: campaign for campaign in sets}
        campaigns_by_set: dict[str, list[Campaign]] = {}
        entries = self._store.runs_with_numbers(robot_id, _MAX_RUNS)
        runs = self._read_runs([entry.id for entry in entries])
        for entry in entries:
            measured_set, run = set_by_id.get(entry.measurement_set_id), runs.get(entry.id)
            if measured_set is not None and run is not None:
                campaign = Campaign(entry.id, entry.created_at, run, measured_set)
                campaigns_by_set.setdefault(measured_set.id, []).append(campaign)
        return campaigns_by_set

    def _read_runs(self, run_ids: Sequence[str]) -> dict[str, ReadRun]:
        """Return id → run, for the runs that are stored; only runs that are not cached are read."""
        cached = self._cached_runs
        runs = {run_id: run for run_id in run_ids if (run := cached.get(run_id)) is not None}
        missing = [run_id for run_id in run_ids if run_id not in runs]
        for run_id, text in self._store.read_trend_numbers(missing).items():
            runs[run_id] = cached[run_id] = ReadRun.model_validate_json(text)
        for run_id in list(cached)[: max(0, len(cached) - _MAX_CACHED_RUNS)]:
            cached.pop(run_id, None)
        return runs
