"""Elastic links where the load point is off by what is assumed, and one arm under many draws of noise.

By name only: a campaign takes some seconds; `--part 1/4` runs a quarter.
"""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff import identify
from jointstiff.simulator import default_arm
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign
from jointstiff.solver.arrays import FloatArray

__all__ = ["run"]

ARM = default_arm()
CAMPAIGNS, POSTURES = 60, 12
STIFFNESS = (1e7, 6e7)
LOAD_POINT = 0.01
"""Standard deviation of each coordinate of the load point, as a run assumes where nothing is stated [m]."""
DRAWS, SIGMA = 20, 2e-5


@dataclass(frozen=True)
class _Identified:
    model: str
    loss: str
    compliance: FloatArray  # (6,) [rad/(N·m)]; NaN where withheld
    uncertainty: FloatArray  # (6,) [rad/(N·m)]
    held: list[bool]  # whether each interval contains the truth; joints without an interval are left out


def run(*, quick: bool, part: Part) -> list[Section]:
    """Arms of beams whose load point is off, and one arm under many draws of the noise."""
    share = 0.1 if quick else 1.0
    seeds, draws = (part.of(max(2, int(share * count))) for count in (CAMPAIGNS, DRAWS))
    return [_cover([_off(seed) for seed in seeds]), _spread([_draw(seed) for seed in draws])]


def _off(seed: int) -> _Identified:
    """Identify an arm of beams from a campaign that states another load point than the true one."""
    rng = np.random.default_rng([seed, 77])
    stiffness = 10.0 ** rng.uniform(*np.log10(STIFFNESS))
    elastic = beam_arm(ARM, bending=stiffness, torsion=2.0 / 3.0 * stiffness)
    document = elastic_campaign(elastic, configurations=POSTURES, seed=seed)
    stated = document["measurement_set"]
    stated["load_point"] = np.add(stated["load_point"], rng.normal(0.0, LOAD_POINT, 3)).tolist()
    return _identify(document, elastic)


def _draw(seed: int) -> _Identified:
    """Identify one arm of beams in the same postures, with a noise of its own."""
    elastic = beam_arm(ARM)
    document = copy.deepcopy(elastic_campaign(elastic, configurations=POSTURES, seed=0, sigma=0.0))
    document["measurement_set"]["noise"] = {"sigma": SIGMA}
    rng = np.random.default_rng([seed, 78])
    for observation in document["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            for state in ("unloaded", "loaded"):
                reading[state] = np.add(reading[state], rng.normal(0.0, SIGMA, 3)).tolist()
    return _identify(document, elastic)


def _identify(document: dict[str, Any], elastic: ElasticArm) -> _Identified:
    result = identify({name: document[name] for name in ("robot", "measurement_set")}).result
    if result is None or result.choice is None:
        message = "a run without a result"
        raise RuntimeError(message)
    truth = _effective(elastic)
    held = [
        joint.compliance_interval[0] <= compliance <= joint.compliance_interval[1]
        for compliance, joint in zip(truth.tolist(), result.joints, strict=True)
        if joint.compliance_interval is not None
    ]
    numbers = np.array(
        [(joint.compliance, joint.standard_uncertainty) for joint in result.joints], dtype=np.float64
    )
    return _Identified(result.choice.elasticity, result.choice.loss, numbers[:, 0], numbers[:, 1], held)


def _effective(elastic: ElasticArm) -> FloatArray:
    """Return the true compliance (6,) about each axis: of the joint and of its link [rad/(N·m)]."""
    axes = ARM.axis_directions
    return np.asarray(ARM.compliances + np.einsum("ji,jik,jk->j", axes, elastic.links[:, 3:, 3:], axes))


def _cover(found: list[_Identified]) -> Section:
    held = [each for campaign in found for each in campaign.held]
    models = Counter((each.model, each.loss) for each in found)
    share = 100.0 * sum(held) / len(held)
    return Section(
        title=f"{len(found)} campaigns of arms of beams, load point off by 10 mm a coordinate, as assumed",
        columns=("model", "loss", "campaigns"),
        rows=tuple((model, loss, f"{count}") for (model, loss), count in models.most_common()),
        figures=(
            Figure(
                "beams, load point off: intervals with the effective stiffness", share, "at least", 92.5, " %"
            ),
            Figure("beams, load point off: no wider than asked", share, "at most", 97.0, " %"),
        ),
    )


def _spread(found: list[_Identified]) -> Section:
    truth, uncertainty = _effective(beam_arm(ARM)), np.mean([each.uncertainty for each in found], axis=0)
    compliances = np.array([each.compliance for each in found])
    spread, bias = (
        compliances.std(axis=0, ddof=1) / uncertainty,
        (compliances.mean(axis=0) - truth) / uncertainty,
    )
    held = [each for draw in found for each in draw.held]
    return Section(
        title=f"One arm of beams under {len(found)} draws of 20 µm noise",
        columns=("joint", "spread / u", "bias / u", "u [% of the compliance]"),
        rows=tuple(
            (f"{joint + 1}", f"{spread[joint]:.2f}", f"{bias[joint]:+.2f}", f"{100 * share:.1f}")
            for joint, share in enumerate(uncertainty / truth)
        ),
        figures=(
            Figure("draws of noise: greatest spread, in its own u", float(spread.max()), "at most", 1.2),
            Figure(
                "draws of noise: intervals with the effective stiffness",
                100.0 * sum(held) / len(held),
                "at least",
                92.5,
                " %",
            ),
        ),
    )
