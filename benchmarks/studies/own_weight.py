"""Stiffness without a load: simulated campaigns of a heavy arm that bends under its own weight.

By name only: it takes ten minutes; `--part 1/4` runs a quarter of the campaigns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.simulator import random_configurations
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.simulator.own_weight import Bodies, sag
from jointstiff.solver import WeightEstimate, WeightReadings, identify_weight
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.solution import GAP
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.predict.models import JointModel
from tests.support.sagging import ARM, BODIES, LOAD_POINT, ROBOT, burden_of, campaign

__all__ = ["BOTH", "KNOWN", "WITHIN", "WRONG", "Way", "estimates", "harmful", "run", "summary"]

POSTURES, SIGMA, PAYLOAD = 40, 3e-5, 100.0
CAMPAIGNS, EXACT_CAMPAIGNS = 200, 1_000
SAG_CAMPAIGNS, UNMEASURED = 100, 60
JOINTS = slice(1, 6)  # a vertical axis carries no weight


@dataclass(frozen=True)
class Way:
    """A kind of campaign."""

    name: str
    stated: float  # half-width of each mass as stated, relative
    drawn: float  # half-width within which the true ones are drawn
    payload: bool = False  # whether each posture is read once more with a known payload
    misbuilt: bool = False  # whether every link is 1 mm and 1 mrad off


KNOWN = Way("masses known", 0.0, 0.0)
WITHIN = Way("masses within ± 10 %", 0.1, 0.1)
BOTH = Way("the same, with a known payload as second state", 0.1, 0.1, payload=True)
WRONG = Way(
    "links 1 mm and 1 mrad off, masses ± 15 % stated as ± 5 %", 0.05, 0.15, payload=True, misbuilt=True
)


def run(*, quick: bool, part: Part) -> list[Section]:
    """Coverage, widths, sag, and masses that are wrong."""
    share = 0.1 if quick else 1.0
    counts = {KNOWN: EXACT_CAMPAIGNS, WITHIN: CAMPAIGNS, BOTH: CAMPAIGNS, WRONG: CAMPAIGNS}
    found = {way: estimates(way, part.of(max(int(share * count), 4))) for way, count in counts.items()}
    return [_section(found), _sag_section(found, part), _wrong_section(found[WRONG])]


def estimates(way: Way, seeds: range) -> list[WeightEstimate]:
    """Simulate campaigns and identify each."""
    return [identify_weight(_readings(way, seed)) for seed in seeds]


def _bodies(way: Way, draws: np.random.Generator) -> Bodies:
    return replace(BODIES, masses=BODIES.masses * (1.0 + way.drawn * draws.uniform(-1.0, 1.0, 6)))


def _readings(way: Way, seed: int) -> WeightReadings:
    return campaign(
        seed=seed,
        arm=with_link_errors(ARM, length=1e-3, angle=1e-3, seed=seed) if way.misbuilt else ARM,
        bodies=_bodies(way, np.random.default_rng([seed, 41])),
        stated=burden_of(BODIES, way.stated),
        postures=POSTURES,
        sigma=SIGMA,
        payload=PAYLOAD if way.payload else 0.0,
    )


def _ends(found: list[WeightEstimate]) -> FloatArray:
    """(campaigns, 5, 2) ends of the intervals over the true compliances; of no number, all there is."""
    everything = (0.0, np.inf)
    ends = [[joint.compliance_interval or everything for joint in each.joints[JOINTS]] for each in found]
    return np.array(ends) / ARM.compliances[JOINTS, None]


def summary(found: list[WeightEstimate]) -> tuple[FloatArray, FloatArray, float]:
    """Return shares of intervals that hold the truth (5,), median half-widths (5,), and the greatest gap."""
    ends = _ends(found)
    covered = ((ends[..., 0] <= 1.0) & (ends[..., 1] >= 1.0)).mean(axis=0)
    return covered, np.median(0.5 * np.ptp(ends, axis=2), axis=0), max(each.certificate.gap for each in found)


def _section(found: dict[Way, list[WeightEstimate]]) -> Section:
    rows, figures = [], []
    sums = {way: summary(estimates) for way, estimates in found.items() if way is not WRONG}
    for way, (covered, width, gap) in sums.items():
        count = f"{len(found[way])} campaigns of {way.name}"
        rows.append((f"{count}: hold the truth, %", *(f"{100 * share:.1f}" for share in covered)))
        rows.append((f"{count}: half-width, %", *(f"{100 * part:.1f}" for part in width)))
        figures.append(Figure(f"gap of the certificate, {way.name}", gap, "at most", GAP))
    known, within, both = (sums[way] for way in (KNOWN, WITHIN, BOTH))
    for joints, where in (("2 and 3", slice(0, 2)), ("4 and 5", slice(2, 4))):
        what = f"coverage, masses within ± 10 %: joints {joints}"
        figures.append(Figure(what, 100 * within[0][where].min(), "at least", 95.0, " %"))
    figures += [
        Figure("median half-width of c₂, masses within ± 10 %", 100 * within[1][0], "at most", 20.0, " %"),
        Figure("coverage, masses known: least of a joint", 100 * known[0].min(), "at least", 93.5, " %"),
        Figure("coverage, masses known: greatest of a joint", 100 * known[0].max(), "at most", 96.5, " %"),
        Figure("width with a payload over that without: widest", (both[1] / within[1]).max(), "at most", 0.5),
    ]
    return Section(
        title=f"Stiffness without a load: {POSTURES} postures, 3 targets, {1e6 * SIGMA:g} µm, all axes free",
        columns=("", *(f"joint {j}" for j in range(2, 7))),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=("an arm of the 240 kg class whose links weigh a tonne; its sag is millimetres",),
        data={way.name: [part.tolist() for part in sums[way][:2]] for way in sums},
    )


def harmful(estimate: WeightEstimate) -> bool:
    """Return whether nothing is said although a joint is beyond 5 u and 20 % of its true compliance."""
    for joint, truth in zip(estimate.joints[JOINTS], ARM.compliances[JOINTS], strict=True):
        c, u = joint.compliance, joint.standard_uncertainty
        if c is not None and u is not None and abs(c - truth) > max(5.0 * u, 0.2 * truth):
            return not estimate.reasons
    return False


def sag_errors(way: Way, seed: int, estimate: WeightEstimate, force: FloatArray) -> FloatArray:
    """Return whether intervals of the sag hold the true one (3,), and the median error and sag [m].

    Of postures that were not measured, under a load; along the axes of R0.
    """
    q = random_configurations(ARM, UNMEASURED, 99_999)
    many = np.tile(force, (UNMEASURED, 1))
    point = np.tile(LOAD_POINT, (UNMEASURED, 1))
    positive = Constraints(Bounds.positive(ROBOT.n))
    predicted = JointModel(ROBOT, estimate.fit.compliance, None, positive, estimate.weight).deflect(
        LoadCases(q, many, np.zeros_like(many), point, point)
    )
    bent = q + sag(
        ARM, _bodies(way, np.random.default_rng([seed, 41])), q, force=force, load_point=LOAD_POINT
    )
    true = ARM.posture(bent).point_to_base(point) - ARM.posture(q).point_to_base(point)
    interval = np.asarray(predicted.interval(0.95))[:, :3]
    inside = ((interval[..., 0] <= true) & (true <= interval[..., 1])).mean(axis=0)
    off, size = (np.median(np.linalg.norm(each, axis=1)) for each in (predicted.displacement - true, true))
    return np.array([*inside, off, size])


def _sag_section(found: dict[Way, list[WeightEstimate]], part: Part) -> Section:
    rows, figures = [], []
    for way in (KNOWN, WITHIN, BOTH):
        seeds = part.of(len(found[way]) * part.count)
        for load in (0.0, 1000.0):
            force = np.array([0.0, 0.0, -load])
            cases = zip(seeds, found[way][:SAG_CAMPAIGNS], strict=False)
            numbers = np.mean([sag_errors(way, seed, each, force) for seed, each in cases], axis=0)
            name = f"{way.name}, sag" + (f" and {load:g} N" if load else "")
            shares = tuple(f"{100 * share:.1f}" for share in numbers[:3])
            rows.append((name, *shares, f"{1e6 * numbers[3]:.0f} µm", f"{1e3 * numbers[4]:.2f} mm"))
            figures.append(Figure(f"{name}: least share held", float(numbers[:3].min()), "at least", 0.9))
    return Section(
        title=f"Sag of {UNMEASURED} postures that were not measured, {SAG_CAMPAIGNS} campaigns at most",
        columns=("masses", "x held, %", "y", "z", "median error", "median displacement"),
        rows=tuple(rows),
        figures=tuple(figures),
    )


def _wrong_section(found: list[WeightEstimate]) -> Section:
    said = sum(bool(each.reasons) for each in found)
    unsaid = sum(harmful(each) for each in found)
    return Section(
        title=f"Stiffness without a load: {len(found)} campaigns of {WRONG.name}",
        columns=("", "campaigns"),
        rows=(("contradiction said", f"{said}"), ("a joint beyond 5 u and 20 %, nothing said", f"{unsaid}")),
        figures=(Figure.none("campaigns to use with a joint beyond 5 u and 20 %", unsaid),),
        notes=(f"with a known payload of {PAYLOAD:g} kg as second state",),
        data={"said": said, "harmful": unsaid},
    )
