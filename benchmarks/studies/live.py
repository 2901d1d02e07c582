"""Live campaigns on arms of our own: readings until a goal is met beside fixed lists; mistakes at a reading.

Arms differ in stiffness by up to half, their springs balance the load exactly; some are off by 3 % of the
deflection in each posture, some have links that bend. What is read is noise on top, as a tracker's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.schemas.live import LiveState, MeasurementSetPost
from jointstiff.schemas.measurement import Observation
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.live.campaign import Declaration, Entry, LiveCampaign
from jointstiff.service.live.declaration import complete_declaration
from jointstiff.simulator import default_arm, robot_document
from jointstiff.simulator.campaign import LOAD_POINT, TARGETS, SpringArm
from jointstiff.simulator.elastic_links import beam_arm, elastic_deflections
from jointstiff.simulator.equilibrium import deflections
from jointstiff.simulator.experiment import plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.plan import CampaignPlan, plan_campaign
from jointstiff.solver.run import run as identify

__all__ = ["run"]

SIGMA = 2e-5
_POINTS: FloatArray = np.array(list(TARGETS.values()))
_MOST = 80
_STREAM = 83
AREA = [[0.8, -0.5, 0.5], [1.8, 0.5, 1.5]]


@dataclass(frozen=True, eq=False)
class Row:
    """A kind of campaign."""

    name: str
    goal: dict[str, Any]
    force: float  # of the pulls [N]
    area: list[list[float]] | None = None
    unmodelled: float = 0.0  # share of the deflection that is off in each posture
    links: bool = False
    load: str = "any_direction"
    sigma: float = SIGMA  # of a coordinate of a reading [m]
    arms: int = 40


JOINTS = {"kind": "joints", "relative": 0.15}
PLACE = {"kind": "deflection", "uncertainty": 6e-6}
ROWS = (
    Row("every joint to ± 15 %", JOINTS, 750.0),
    Row("every joint to ± 15 %, 3 % unmodelled", JOINTS, 750.0, unmodelled=0.03, arms=160),
    Row("6 µm in a work area", PLACE, 500.0, AREA, sigma=1.2e-5),
    Row(
        "12 µm in a work area, 3 % unmodelled", {**PLACE, "uncertainty": 1.2e-5}, 500.0, AREA, unmodelled=0.03
    ),
    Row("0.2 mm in a work area, links bend", {**PLACE, "uncertainty": 2e-4}, 1500.0, AREA, links=True),
    Row("below half a millimetre?", {"kind": "decision", "limit": 5e-4}, 500.0, AREA),
)


@dataclass(frozen=True, eq=False)
class Reader:
    """Springs that are read."""

    arm: SpringArm
    row: Row
    seed: int

    @classmethod
    def of(cls, row: Row, seed: int) -> Reader:
        """Return an arm of its own."""
        arm = default_arm()
        factor = np.exp(np.random.default_rng([seed, _STREAM]).uniform(-0.5, 0.5, 6))
        return cls(replace(arm, stiffnesses=arm.stiffnesses * factor), row, seed)

    def exact(self, joints: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (N, T, 3) before and under load [m]."""
        points = np.broadcast_to(LOAD_POINT, force.shape)
        if self.row.links:
            return elastic_deflections(beam_arm(self.arm), joints, force, points, _POINTS)
        return deflections(self.arm, joints, force, np.zeros_like(force), points, _POINTS)

    def read(self, label: str, joints: Sequence[float], force: Sequence[float]) -> Observation:
        """Read one posture."""
        random = np.random.default_rng([self.seed, _STREAM, int.from_bytes(label.encode(), "big") % 2**32])
        before, after = self.exact(np.array([joints]), np.array([force]))
        size = float(np.linalg.norm(after - before, axis=-1).mean())
        off = self.row.unmodelled * size * random.standard_normal(3) / np.sqrt(3.0)
        noise = self.row.sigma * random.standard_normal((2, *before.shape))
        before, after = before + noise[0], after + off + noise[1]
        return Observation.model_validate(
            {
                "label": label,
                "joints": list(joints),
                "force": list(force),
                "readings": [
                    {"target": name, "unloaded": before[0, t].tolist(), "loaded": after[0, t].tolist()}
                    for t, name in enumerate(TARGETS)
                ],
            }
        )

    def declared(self) -> LiveCampaign:
        """Return the campaign before its first reading."""
        robot = prepare_robot(RobotDocument.model_validate(robot_document(self.arm))).robot
        header = MeasurementSetPost.model_validate(
            {
                "robot_id": "arm",
                "name": self.row.name,
                "units": {"length": "m", "angle": "rad", "force": "N"},
                "encoders": "motor",
                "noise": {
                    "sigma": self.row.sigma,
                    "load_point": 1e-4,
                    "grounds": {"load_point": "tracker"},
                    "force": {"scale": 1e-3},
                },
                "load_point": list(LOAD_POINT),
                "open": {
                    "goal": self.row.goal,
                    "load": {"kind": self.row.load, "force": self.row.force},
                    "targets": {name: list(place) for name, place in TARGETS.items()},
                    "work_area": self.row.area,
                },
            }
        )
        if header.open is None:
            raise ValueError(self.row.name)
        return LiveCampaign(Declaration(robot, complete_declaration(header, header.open)))


def measured(reader: Reader) -> tuple[LiveCampaign, LiveState, int]:
    """Measure until it is enough; a doubtful reading is kept. Return campaign, state and number of doubts."""
    campaign, doubts = reader.declared(), 0
    while True:
        state = campaign.state()
        if campaign.progress.doubtful:
            doubts += 1
            campaign = campaign.with_entry(Entry("kept", campaign.progress.doubtful[-1]))
            continue
        if state.state != "measuring" or state.next is None or len(campaign.observations) >= _MOST:
            return campaign, state, doubts
        observation = reader.read(state.next.label, state.next.joints, state.next.force)
        campaign = campaign.with_entry(campaign.compare_with_prediction(observation))


def _read_all(reader: Reader, joints: FloatArray, forces: FloatArray) -> LiveCampaign:
    """Return the campaign of a list of readings."""
    entries = (
        Entry("observation", f"f{k}", reader.read(f"f{k}", joints[k].tolist(), forces[k].tolist()))
        for k in range(len(joints))
    )
    return LiveCampaign(reader.declared().declaration, tuple(entries))


def needed(reader: Reader, joints: FloatArray, forces: FloatArray) -> int:
    """Return how many readings of a list meet the goal as a live campaign judges it, none held out."""
    whole = _read_all(reader, joints, forces)
    low, high = 2, len(joints)
    while high - low > 1:
        middle = (low + high) // 2
        met = replace(whole, entries=whole.entries[:middle]).progress.goal_is_met
        low, high = (low, middle) if met else (middle, high)
    return high


def fixed_list(reader: Reader) -> int:
    """Return how many pulls at random meet the goal."""
    plan = plan_experiment(
        reader.arm,
        configurations=_MOST,
        load="pull" if reader.row.load == "any_direction" else "dead_weight",
        force=reader.row.force,
        seed=reader.seed,
    )
    return needed(reader, plan.joints, plan.forces)


@dataclass(frozen=True)
class Lists:
    """Readings of one arm by other rules than the live one."""

    fixed: int  # pulls at random until the goal is met
    whole: int  # all of the product's plan for the goal: whoever has no network carries that out
    whole_meets: bool  # whether the goal is met then
    in_order: int  # its plan of 40, in blocks, until the goal is met as the live campaign judges it


def other_lists(reader: Reader) -> Lists:
    """Return how many readings other rules take."""
    whole, plan = _plans(reader.row)
    fitted = ~whole.validation
    return Lists(
        fixed=fixed_list(reader),
        whole=len(whole.joints),
        whole_meets=_read_all(reader, whole.joints[fitted], whole.force[fitted]).progress.goal_is_met,
        in_order=_in_order(reader, plan),
    )


@cache
def _plans(row: Row) -> tuple[CampaignPlan, CampaignPlan]:
    """Return the product's plan for the goal, and that of 40 readings; all arms of a row have the same."""
    ahead = Reader.of(row, 0).declared().declaration.candidate_readings
    forty = replace(ahead.request, readings=40, goal=None)
    return plan_campaign(ahead.robot, ahead.request), plan_campaign(ahead.robot, forty)


def _in_order(reader: Reader, plan: CampaignPlan) -> int:
    """Return how many readings of a plan meet the goal; those for validation are read in their turn."""
    fitted = np.flatnonzero(~plan.validation)
    count = needed(reader, plan.joints[fitted], plan.force[fitted])
    return int(fitted[min(count, len(fitted)) - 1]) + 1


def covered(reader: Reader, campaign: LiveCampaign, state: LiveState) -> tuple[int, int]:
    """Return how many intervals hold, of how many: of joints, or of the deflection at places."""
    if reader.row.area is None:
        ends = [(each.interval, k) for each, k in zip(state.joints, reader.arm.stiffnesses, strict=True)]
        known = [(each, k) for each, k in ends if each is not None]
        return int(sum(low <= k <= (high or np.inf) for (low, high), k in known)), len(known)
    known_, places = campaign.progress.known, campaign.declaration.candidate_readings.work_area_deflections
    moved = places @ known_.compliance
    half = known_.factor * np.sqrt(np.einsum("...j,jk,...k->...", places, known_.covariance, places))
    true = places @ (1.0 / reader.arm.stiffnesses)
    inside = np.abs(moved - true) <= half
    return int(inside[:20].sum()), int(inside[:20].size)


def _exchanged(body: Observation, _: Observation) -> Observation:
    first, second, *rest = body.readings
    names = {"target": second.target}, {"target": first.target}
    swapped = [first.model_copy(update=names[0]), second.model_copy(update=names[1]), *rest]
    return body.model_copy(update={"readings": swapped})


def _with_force(factor: float) -> Callable[[Observation, Observation], Observation]:
    def changed(body: Observation, _: Observation) -> Observation:
        x, y, z = (factor * part for part in body.force)
        return body.model_copy(update={"force": (x, y, z)})

    return changed


MISTAKES: dict[str, tuple[Callable[[Observation, Observation], Observation], str, float]] = {
    "sign of the force": (_with_force(-1.0), "opposite sign", 95.0),
    "angles of another posture": (
        lambda body, other: body.model_copy(update={"joints": other.joints}),
        "joint angles",
        95.0,
    ),
    "two targets exchanged": (_exchanged, "exchanged", 95.0),
    "force 10 % less": (_with_force(1.0 / 0.9), "force differs", 85.0),
}


def named(mistake: str, seed: int) -> bool:
    """Return whether a mistake at one reading of a campaign is named at that reading."""
    reader = Reader.of(ROWS[0], 10_000 + seed)
    reader = replace(reader, row=replace(reader.row, force=1500.0))
    campaign = reader.declared()
    plant, words, _ = MISTAKES[mistake]
    for _ in range(5 + seed % 5):
        following = campaign.plan_next_reading()
        if following is None:
            return False
        observation = reader.read(following.label, following.joints, following.force)
        campaign = campaign.with_entry(campaign.compare_with_prediction(observation))
    following = campaign.plan_next_reading()
    if following is None:
        return False
    other = campaign.observations[seed % len(campaign.observations)]
    wrong = plant(reader.read(following.label, following.joints, following.force), other)
    found = campaign.compare_with_prediction(wrong).innovation
    return found is not None and any(words in cause for cause in found.causes)


@dataclass(frozen=True)
class _Outcome:
    """One campaign at its stop."""

    reached: bool
    readings: int
    doubts: int
    right: tuple[int, int]  # intervals or decisions that hold, of how many
    first_inside: bool | None  # whether the first reading that was held out lay in its ball
    lists: Lists | None  # readings by other rules
    ends_with_links: bool  # whether an ordinary run of the readings chooses elastic links or a base


def _outcome(row: Row, seed: int) -> _Outcome:
    reader = Reader.of(row, seed)
    campaign, state, doubts = measured(reader)
    decides, reached = row.goal["kind"] == "decision", state.state == "reached"
    right = _right(reader, campaign, state) if decides else (0, 0)
    if not decides and not row.links:
        right = covered(reader, campaign, state)
    held = [entry.held_out for entry in campaign.entries if entry.held_out is not None]
    compares = not (decides or row.links or row.unmodelled)
    return _Outcome(
        reached,
        len(campaign.observations),
        doubts,
        right,
        held[0].inside if held else None,
        other_lists(reader) if compares else None,
        _ends_with_links(campaign),
    )


def _ends_with_links(campaign: LiveCampaign) -> bool:
    """Return whether an ordinary run of the readings chooses a model in which more than joints bends."""
    progress = campaign.progress
    if progress.so_far.measurements is None:
        return False
    robot, noticed = progress.candidates.robot, progress.so_far.noticed
    return identify(robot, progress.so_far.measurements, RunOptions(), noticed).links is not None


def _share(values: Sequence[bool | None]) -> float:
    """Return the percentage of those that are known."""
    known = [value for value in values if value is not None]
    return 100.0 * sum(known) / len(known) if known else np.nan


def run(*, quick: bool, part: Part) -> list[Section]:
    """Measure campaigns of each kind; then plant mistakes at single readings."""
    rows, other, figures, doubts, campaigns = [], [], list[Figure](), 0, 0
    for row in ROWS:
        outcomes = [_outcome(row, seed) for seed in part.of(3 if quick else row.arms)]
        doubts, campaigns = doubts + sum(each.doubts > 0 for each in outcomes), campaigns + len(outcomes)
        mean = float(np.mean([each.readings for each in outcomes]))
        hold, of = (sum(each.right[k] for each in outcomes) for k in (0, 1))
        first = _share([each.first_inside for each in outcomes])
        reached, right = sum(each.reached for each in outcomes), 100.0 * hold / of if of else np.nan
        cells = (f"{mean:.1f}", f"{right:.1f}", f"{first:.0f}")
        rows.append((row.name, f"{reached} of {len(outcomes)}", *cells))
        lists = [each.lists for each in outcomes if each.lists is not None]
        if lists:
            fixed, whole, in_order = (
                float(np.mean([getattr(each, name) for each in lists]))
                for name in ("fixed", "whole", "in_order")
            )
            meets = _share([each.whole_meets for each in lists])
            numbers = (mean, fixed, whole, in_order)
            other.append((row.name, *(f"{number:.1f}" for number in numbers), f"{meets:.0f}"))
            asked = 13.0 / 34.0 if row.area is None else 16.0 / 30.0
            beside = {"the fixed list": (fixed, asked), "the whole plan": (whole, 0.6)}
            beside["the plan in order, stopped when met"] = (in_order, 0.6)
            for name, (readings, most) in beside.items():
                figures.append(Figure(f"{row.name}: readings over {name}", mean / readings, "at most", most))
        if not row.links:
            as_links = sum(each.ends_with_links for each in outcomes)
            figures.append(Figure.none(f"{row.name}: of {len(outcomes)} rigid arms, with links", as_links))
        if of:
            least_right = 97.0 if row.goal["kind"] == "decision" else 93.0
            figures.append(Figure(f"{row.name}: right at the stop", right, "at least", least_right, " %"))
        if row.links:
            figures.append(
                Figure(f"{row.name}: first held-out reading inside", first, "at least", 85.0, " %")
            )
    told = []
    for mistake, (_, _, least) in MISTAKES.items():
        share = _share([named(mistake, seed) for seed in part.of(4 if quick else 60)])
        told.append((mistake, f"{share:.0f}"))
        figures.append(Figure(f"{mistake}: named at the reading", share, "at least", least, " %"))
    doubtful = 100.0 * doubts / campaigns
    most = 100.0 / 240.0
    figures.append(Figure("campaigns without a mistake, with a doubt", doubtful, "at most", most, " %"))
    titles = ("goal", "reached", "readings", "right [%]", "first held-out inside [%]")
    rules = ("goal", "live", "fixed list", "whole plan", "plan in order", "whole meets [%]")
    return [
        Section("campaigns measured live until the goal is met", titles, tuple(rows), tuple(figures)),
        Section("readings by other rules, means", rules, tuple(other)),
        Section("mistakes at one reading", ("mistake", "named [%]"), tuple(told)),
    ]


def _right(reader: Reader, campaign: LiveCampaign, state: LiveState) -> tuple[int, int]:
    """Return whether a decision that was reached is right."""
    if state.state != "reached" or state.greatest_deflection is None:
        return 0, 0
    places = campaign.declaration.candidate_readings.work_area_deflections
    true = float(np.linalg.norm(places @ (1.0 / reader.arm.stiffnesses), axis=-1).max())
    limit = reader.row.goal["limit"]
    return int((state.greatest_deflection < limit) == (true < limit)), 1
