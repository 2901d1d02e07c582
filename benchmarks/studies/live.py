"""Live campaigns on arms of our own: readings until a goal is met beside fixed lists; mistakes at a reading.

Arms differ in stiffness by up to half, their springs balance the load exactly; some are off by 3 % of the
deflection in each posture, some have links that bend. What is read is noise on top, as a tracker's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.schemas.live import LiveState, MeasurementSetPost
from jointstiff.schemas.measurement import Observation
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.live.campaign import Declared, Entry, LiveCampaign
from jointstiff.simulator import default_arm, robot_document
from jointstiff.simulator.campaign import LOAD_POINT, TARGETS, SpringArm
from jointstiff.simulator.elastic_links import beam_arm, elastic_deflections
from jointstiff.simulator.equilibrium import deflections
from jointstiff.simulator.experiment import plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.plan import plan_campaign

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


JOINTS = {"kind": "joints", "relative": 0.15}
PLACE = {"kind": "deflection", "uncertainty": 6e-6}
ROWS = (
    Row("every joint to ± 15 %", JOINTS, 750.0),
    Row("every joint to ± 15 %, 3 % unmodelled", JOINTS, 750.0, unmodelled=0.03),
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
                "noise": {"sigma": self.row.sigma, "load_point": 1e-4, "force": {"scale": 1e-3}},
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
        return LiveCampaign(Declared(robot, header, header.open))


def measured(reader: Reader) -> tuple[LiveCampaign, LiveState, int]:
    """Measure until it is enough; a doubtful reading is kept. Return campaign, state and number of doubts."""
    campaign, doubts = reader.declared(), 0
    while True:
        state = campaign.state()
        if campaign.doubtful:
            doubts += 1
            campaign = campaign.with_entry(Entry("kept", campaign.doubtful[-1]))
            continue
        if state.state != "measuring" or state.next is None or len(campaign.observations) >= _MOST:
            return campaign, state, doubts
        observation = reader.read(state.next.label, state.next.joints, state.next.force)
        campaign = campaign.with_entry(campaign.judged(observation))


def needed(reader: Reader, joints: FloatArray, forces: FloatArray) -> int:
    """Return how many readings of a list meet the goal."""
    start = reader.declared()
    entries = tuple(
        Entry("observation", f"f{k}", reader.read(f"f{k}", joints[k].tolist(), forces[k].tolist()))
        for k in range(len(joints))
    )
    low, high = 2, len(joints)
    while high - low > 1:
        middle = (low + high) // 2
        met = LiveCampaign(start.declared, entries[:middle]).share.greatest_share <= 1.0
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


def own_plan(reader: Reader) -> int:
    """Return how many readings of the product's own plan of 40, in its order, meet the goal.

    Those for validation are read in their turn, and held out from the fit.
    """
    ahead = reader.declared().declared.ahead
    plan = plan_campaign(ahead.robot, replace(ahead.request, readings=40))
    fitted = np.flatnonzero(~plan.validation)
    count = needed(reader, plan.joints[fitted], plan.force[fitted])
    return int(fitted[min(count, len(fitted)) - 1]) + 1


def covered(reader: Reader, campaign: LiveCampaign, state: LiveState) -> tuple[int, int]:
    """Return how many intervals hold, of how many: of joints, or of the deflection at places."""
    if reader.row.area is None:
        ends = [(each.interval, k) for each, k in zip(state.joints, reader.arm.stiffnesses, strict=True)]
        known = [(each, k) for each, k in ends if each is not None]
        return sum(low <= k <= (high or np.inf) for (low, high), k in known), len(known)
    known_, places = campaign.known, campaign.declared.ahead.places
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
    "force 10 % less": (_with_force(1.0 / 0.9), "force is another", 85.0),
}


def named(mistake: str, seed: int) -> bool:
    """Return whether a mistake at one reading of a campaign is named at that reading."""
    reader = Reader.of(ROWS[0], 10_000 + seed)
    reader = replace(reader, row=replace(reader.row, force=1500.0))
    campaign = reader.declared()
    plant, words, _ = MISTAKES[mistake]
    for _ in range(5 + seed % 5):
        following = campaign.next_reading()
        if following is None:
            return False
        observation = reader.read(following.label, following.joints, following.force)
        campaign = campaign.with_entry(campaign.judged(observation))
    following = campaign.next_reading()
    if following is None:
        return False
    other = campaign.observations[seed % len(campaign.observations)]
    wrong = plant(reader.read(following.label, following.joints, following.force), other)
    found = campaign.judged(wrong).innovation
    return found is not None and any(words in cause for cause in found.causes)


@dataclass(frozen=True)
class _Outcome:
    """One campaign at its stop."""

    reached: bool
    readings: int
    doubts: int
    right: tuple[int, int]  # intervals or decisions that hold, of how many
    first_inside: bool | None  # whether the first reading that was held out lay in its ball
    fresh_inside: bool | None  # whether one more, at random, does
    lists: tuple[int, int] | None  # readings of a fixed list, and of the own plan in its order


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
        _fresh_inside(reader, campaign) if reached else None,
        (fixed_list(reader), own_plan(reader)) if compares else None,
    )


def _share(values: Sequence[bool | None]) -> float:
    """Return the percentage of those that are known."""
    known = [value for value in values if value is not None]
    return 100.0 * sum(known) / len(known) if known else np.nan


def run(*, quick: bool, part: Part) -> list[Section]:
    """Measure campaigns of each kind; then plant mistakes at single readings."""
    rows, figures, doubts, campaigns = [], list[Figure](), 0, 0
    for row in ROWS:
        outcomes = [_outcome(row, seed) for seed in part.of(3 if quick else 40)]
        doubts, campaigns = doubts + sum(each.doubts > 0 for each in outcomes), campaigns + len(outcomes)
        mean = float(np.mean([each.readings for each in outcomes]))
        hold, of = (sum(each.right[k] for each in outcomes) for k in (0, 1))
        lists = [each.lists for each in outcomes if each.lists is not None]
        fixed, plan = np.mean(lists, axis=0) if lists else (np.nan, np.nan)
        first = _share([each.first_inside for each in outcomes])
        fresh = _share([each.fresh_inside for each in outcomes])
        reached, right = sum(each.reached for each in outcomes), 100.0 * hold / of if of else np.nan
        cells = (f"{mean:.1f}", f"{fixed:.1f}", f"{plan:.1f}", f"{right:.1f}", f"{first:.0f}", f"{fresh:.0f}")
        rows.append((row.name, f"{reached} of {len(outcomes)}", *cells))
        if lists:
            asked = 13.0 / 34.0 if row.area is None else 16.0 / 30.0
            figures.append(
                Figure(f"{row.name}: readings over the fixed list", mean / fixed, "at most", asked)
            )
            figures.append(
                Figure(f"{row.name}: readings over the plan in order", mean / plan, "at most", 0.6)
            )
        if of:
            least = 97.0 if row.goal["kind"] == "decision" else 93.0
            figures.append(Figure(f"{row.name}: right at the stop", right, "at least", least, " %"))
        if row.links:
            figures.append(
                Figure(f"{row.name}: first held-out reading inside", first, "at least", 85.0, " %")
            )
    told = []
    for mistake, (_, _, least) in MISTAKES.items():
        share = _share([named(mistake, seed) for seed in part.of(4 if quick else 60)])
        told.append((mistake, f"{share:.0f}"))
        figures.append(Figure(f"{mistake}: named at the reading", share, "at least", least, " %"))
    figures.append(
        Figure(f"of {campaigns} campaigns without a mistake, with a doubt", doubts, "at most", 1.0)
    )
    titles: tuple[str, ...] = ("goal", "reached", "readings", "fixed list", "plan in order", "right [%]")
    titles = (*titles, "first held-out inside [%]", "fresh inside [%]")
    return [
        Section("campaigns measured live until the goal is met", titles, tuple(rows), tuple(figures)),
        Section("mistakes at one reading", ("mistake", "named [%]"), tuple(told)),
    ]


def _right(reader: Reader, campaign: LiveCampaign, state: LiveState) -> tuple[int, int]:
    """Return whether a decision that was reached is right."""
    if state.state != "reached" or state.greatest_deflection is None:
        return 0, 0
    places = campaign.declared.ahead.places
    true = float(np.linalg.norm(places @ (1.0 / reader.arm.stiffnesses), axis=-1).max())
    limit = reader.row.goal["limit"]
    return int((state.greatest_deflection < limit) == (true < limit)), 1


def _fresh_inside(reader: Reader, campaign: LiveCampaign) -> bool:
    """Return whether one more reading, at random, lies in its 90 % ball."""
    from jointstiff.solver.live.innovation import held_out

    plan = plan_experiment(
        reader.arm, configurations=1, load="pull", force=reader.row.force, seed=reader.seed + 777
    )
    fresh = reader.read("fresh", plan.joints[0].tolist(), plan.forces[0].tolist())
    prepared = campaign.declared.prepared([*campaign.observations, fresh])
    m = prepared.measurements
    compliance = np.nan_to_num(campaign.known.compliance)
    found = held_out(prepared.robot, m, compliance, len(m) - 1)
    return found is not None and found.inside
