"""Effective stiffness after the default chose a model of elastic links, beside exact beams.

By name only: a campaign takes half a minute a loss; `--part 1/4` runs a quarter.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff import identify
from jointstiff.simulator import default_arm
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign

__all__ = ["run"]

CAMPAIGNS = 26
LOSSES: tuple[Literal["squared", "huber", "automatic"], ...] = ("squared", "huber", "automatic")


def run(*, quick: bool, part: Part) -> list[Section]:
    """Count how often 95 % intervals hold what the beams have: joint and link about the joint's axis."""
    seeds, rows, figures = part.of(1 if quick else CAMPAIGNS), list[tuple[str, ...]](), list[Figure]()
    data = dict[str, list[int]]()
    for loss in LOSSES[:1] if quick else LOSSES:
        chosen, held, width = Counter[str](), list[bool](), list[float]()
        for seed in seeds:
            rng = np.random.default_rng([seed, 63])
            elastic = beam_arm(default_arm(), bending=3e6 * 20.0 ** rng.uniform())
            count, axes = int(rng.integers(20, 31)), elastic.arm.axis_directions
            links = np.einsum("ji,jik,jk->j", axes, elastic.links[:, 3:, 3:], axes)
            result = identify(
                elastic_campaign(elastic, configurations=count, seed=seed + 7_000),
                elasticity="automatic",
                loss=loss,
            ).result
            if result is None or result.choice is None or result.choice.source != "cross_validation":
                chosen["not escalated"] += 1
                continue
            chosen[result.choice.elasticity] += 1
            for joint, truth in zip(result.joints, elastic.arm.compliances + links, strict=True):
                low, high = joint.compliance_interval or (np.inf, -np.inf)
                held.append(bool(low <= truth <= high))
                width.append(0.5 * max(high - low, 0.0) / truth)
        share = 100 * sum(held) / max(len(held), 1)
        models = ", ".join(f"{name} {number}" for name, number in chosen.items())
        of_all, data[loss] = f"{sum(held)} of {len(held)}", [sum(held), len(held)]
        rows.append((loss, models, of_all, f"{share:.1f}", f"{np.median(width or [0.0]):.2f}"))
        what = f"default runs, loss {loss}: intervals of the effective stiffness that hold it"
        figures.append(Figure(what, share, "at least", 93, " %"))
    return [
        Section(
            title=f"Effective stiffness after the choice of a model: {len(seeds)} default runs a loss",
            columns=("loss", "models chosen", "joints held", "coverage, %", "median half-width"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(
                "exact beams, EI 3e6 to 6e7 N·m², 20 to 30 postures; what is not escalated is not counted",
                "a loss absolute cannot be asked for without a model: automatic compares it with the others",
            ),
            data={**data},
        )
    ]
