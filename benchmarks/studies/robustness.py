"""Effect of gross errors in the readings on an estimate, without and with a robust loss.

By name only: it takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.campaigns import default_robot
from benchmarks.designs import SIGMA, planned_design
from benchmarks.report import Figure, Section
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.solution import Bounds
from jointstiff.solver.estimate import identify
from jointstiff.solver.fitting.method import Loss, Settings
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

__all__ = ["KINDS", "GrossErrors", "Shift", "run", "shifts", "spoiled"]


SHARE = 0.1
"""Of the readings, that are gross errors."""
SIZE = 20.0
"""Of a gross error, in units of sigma."""
DESIGNS, DRAWS = 10, 50
LOSSES: tuple[Loss, ...] = ("squared", "huber")
_STREAM = 21


@dataclass(frozen=True)
class GrossErrors:
    """A kind of gross error of the loaded reading.

    Attributes:
        name: in words.
        along_load: towards where the load pulls, as a reflector slips; else in any direction.
    """

    name: str
    along_load: bool


KINDS = (GrossErrors("any direction", along_load=False), GrossErrors("along the load", along_load=True))


@dataclass(frozen=True)
class Shift:
    """Errors of a loss for each of n joints, in units of the clean fit's standard uncertainty.

    Attributes:
        bias: |mean error| over all campaigns.
        rms: root mean square error.
    """

    bias: tuple[float, ...]
    rms: tuple[float, ...]


def run(*, quick: bool) -> list[Section]:
    """Clean readings and two kinds of gross errors, under both losses."""
    return [_section(*((2, 3) if quick else (DESIGNS, DRAWS)))]


def shifts(kind: GrossErrors | None, losses: Sequence[Loss], designs: int, draws: int) -> dict[Loss, Shift]:
    """Return the bias under each loss, partial pose, K_c included, sigma given.

    Args:
        kind: of gross errors; None for clean readings.
        losses: to compare, on the same readings.
        designs: how many planned designs.
        draws: campaigns of each.
    """
    robot, arm = default_robot(default_arm()), default_arm()
    errors: dict[Loss, list[FloatArray]] = {loss: [] for loss in losses}
    for seed in range(designs):
        design = planned_design(arm, seed=seed)
        uncertainty = np.sqrt(np.diag(design.cramer_rao()))
        generator = np.random.default_rng([seed, _STREAM])
        for clean in design.measured(draws, seed=seed):
            read = clean if kind is None else spoiled(clean, kind, generator)
            for loss in losses:
                estimate = identify(robot, read, _settings(robot, loss))
                errors[loss].append((estimate.compliance - arm.compliances) / uncertainty)
    return {
        loss: Shift(
            tuple(np.abs(np.mean(found, axis=0)).tolist()),
            tuple(np.sqrt(np.square(found).mean(axis=0)).tolist()),
        )
        for loss, found in errors.items()
    }


def spoiled(clean: Measurements, kind: GrossErrors, generator: np.random.Generator) -> Measurements:
    """The same readings, one in ten of them wrong by 20 sigma.

    Args:
        clean: N observations of T targets.
        kind: of gross errors.
        generator: of which readings are wrong, and of directions.
    """
    shape = clean.present.shape
    wrong = generator.permutation(clean.present.size)[: round(SHARE * clean.present.size)]
    directions = generator.standard_normal((*shape, 3))
    if kind.along_load:
        directions = np.broadcast_to(clean.force[:, None], directions.shape)
    directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    errors = np.zeros((clean.present.size, 3))
    errors[wrong] = SIZE * SIGMA * directions.reshape(-1, 3)[wrong]
    return replace(clean, deflection=clean.deflection + errors.reshape(*shape, 3))


def _settings(robot: Robot, loss: Loss) -> Settings:
    return Settings(
        "partial_pose", "covariance", Bounds.positive(robot.n), loss=loss, complementary_stiffness=True
    )


def _section(designs: int, draws: int) -> Section:
    found = {"clean": shifts(None, LOSSES, designs, draws)}
    found |= {f"gross, {kind.name}": shifts(kind, LOSSES, designs, draws) for kind in KINDS}
    rows, figures = [], []
    for case, of_case in found.items():
        for loss, shift in of_case.items():
            rows.append((f"{case}: {loss}, bias", *(f"{value:.2f}" for value in shift.bias)))
            rows.append((f"{case}: {loss}, rms", *(f"{value:.2f}" for value in shift.rms)))
        if case != "clean":
            worst = max(of_case["huber"].bias)
            figures.append(Figure(f"{case}, huber: greatest bias / clean u", worst, "at most", 1.0))
    return Section(
        title=f"Gross errors: {100 * SHARE:g} % of readings, {SIZE:g} sigma, {designs * draws:,} campaigns",
        columns=(
            "error / standard uncertainty of the clean fit",
            *(f"joint {j + 1}" for j in range(len(rows[0]) - 1)),
        ),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            "a reading is one target in one configuration; partial pose, K_c included, sigma given",
            "any direction: drawn anew for each; along the load: where the load pulls, as reflectors slip",
        ),
        data={case: {loss: vars(s) for loss, s in of_case.items()} for case, of_case in found.items()},
    )
