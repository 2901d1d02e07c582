"""Clarabel as a witness: its own answers and the proved optima, honest and lying; some minutes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, Final

import clarabel
import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff import identify
from jointstiff.service.problems import CampaignError
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.simulator.own_weight import unloaded_campaign
from jointstiff.solver.arrays import FloatArray

__all__ = ["run"]

HONEST, LYING = 1000, 100
LIES: Final[dict[str, Callable[[FloatArray, np.random.Generator], FloatArray]]] = {
    "1 % too large": lambda values, _: 1.01 * values,
    "sign changed": lambda values, _: -values,
    "noise of 1 %": lambda values, rng: values * (1.0 + 0.01 * rng.standard_normal(len(values))),
}
OPTIONS: Final[tuple[dict[str, Any], ...]] = (
    *(
        {"elasticity": "joints", "method": method, "loss": loss}
        for method in ("partial_pose", "complete_pose", "decoupled_partial_pose")
        for loss in ("squared", "huber")
    ),
    *(
        {"elasticity": elasticity, "link_penalty": 1e-2, "loss": loss, "cross_validation": {"folds": 2}}
        for elasticity in ("coupled_joints", "diagonal_links", "joints_and_base")
        for loss in ("squared", "huber")
    ),
    {"weight": {}},
)
"""Options of runs: each method and loss of joints, models of each shape of cone, and own weight."""


def run(*, quick: bool, part: Part) -> list[Section]:
    """Count the runs that name or refuse an honest solver, and those that do with a lying one."""
    honest, lying = (part.of(count // (20 if quick else 1)) for count in (HONEST, LYING))
    accused = sum(_named(number) for number in honest)
    rows, figures = (
        [("honest", f"{len(honest)}", f"{accused}")],
        [Figure.none("honest solver accused", accused)],
    )
    for lie in LIES:
        with _lying(lie):
            noticed = sum(_named(number) for number in lying)
        rows.append((lie, f"{len(lying)}", f"{noticed}"))
        share = 100.0 * noticed / len(lying)
        figures.append(Figure(f"lying solver noticed, {lie}", share, "at least", 99.0, " %"))
    return [
        Section(
            title="Runs in which Clarabel's own answer is named as wrong, or refused",
            columns=("solver", "runs", "named or refused"),
            rows=tuple(rows),
            figures=tuple(figures),
        )
    ]


def _named(number: int) -> bool:
    """Return whether a run of simulated readings names the solver, or is refused."""
    options = OPTIONS[number % len(OPTIONS)]
    if "weight" in options:
        document = unloaded_campaign(default_arm(), configurations=20, seed=number)
    elif options["elasticity"] == "joints":
        document = simulate_campaign(default_arm(), configurations=10, seed=number)
    else:
        document = elastic_campaign(beam_arm(default_arm()), configurations=8, seed=number)
    try:
        result = identify({name: document[name] for name in ("robot", "measurement_set")}, **options).result
    except CampaignError:
        return True
    return result is None or "solver_disagrees" in {each.code for each in result.warnings}


@contextmanager
def _lying(lie: str) -> Iterator[None]:
    """Let Clarabel's answers lie."""
    honest, rng = clarabel.DefaultSolver, np.random.default_rng(0)

    class Lying:
        def __init__(self, *arguments: object) -> None:
            self.solver = honest(*arguments)

        def solve(self) -> SimpleNamespace:
            found = self.solver.solve()
            x, z = (LIES[lie](np.asarray(values), rng) for values in (found.x, found.z))
            return SimpleNamespace(x=x, z=z, status=found.status)

    clarabel.DefaultSolver = Lying
    try:
        yield
    finally:
        clarabel.DefaultSolver = honest
