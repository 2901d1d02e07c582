"""Models of what bends, from simple to rich: their rows, and the program that fits each (method.md §7).

The penalty has no length that anyone chose. It is the work that a unit force at the load point does on an
element: averaged over the force's direction and, as the fitted postures are few, over all directions of the
lever, whose length ρ_i (root mean square from the frame's origin to the load point) the fitted postures give.
For a link that is ``tr(M_i C_i)`` with ``M_i = diag(I, 2/3 ρ_i² I)``, for coupled joints the same with
``M = diag(2/3 ρ_j²)``. In ``X = K C K / u``, K² = M, it is a plain trace, and with u the deflection over the
force it has no unit either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.conic import Cone, LeastSquares, SemidefiniteProgram, diagonal, entries
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fitting.robust import DEFAULT_THRESHOLD
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import RegressorBlock, regressor_blocks
from jointstiff.solver.terms.joints import JOINTS
from jointstiff.solver.terms.links import COUPLED_JOINTS, link_motion, links_behind
from jointstiff.solver.terms.term import Term, rows_of
from jointstiff.solver.triangle import Triangle, triangle_of, whitened

MOST_JOINTS = 12
"""Maximum number of joints of a robot with elastic links: beyond, unknowns exceed readings."""

MOST_TARGETS: Final = 500
"""Targets up to which robust losses are supported: a program takes about 0.5 s there."""
_BLOCK = 256
"""Observations per block: their rows stay below 10 MB a target."""


@dataclass(frozen=True)
class ElasticColumns:
    """Columns of each compliance among the P columns of the richest model.

    Entries of matrices are vectors as in `jointstiff.solver.convex.conic`.
    """

    n: int  #: joints
    links: tuple[int, ...]  #: which joints' frames carry a link that bends

    def __post_init__(self) -> None:
        if self.n > MOST_JOINTS:
            raise UnsupportedMethodError(
                f"the robot has {self.n} joints; elastic links support at most {MOST_JOINTS}",
                where="elasticity",
                remedy="use elasticity joints",
            )

    @property
    def width(self) -> int:
        """P."""
        return self.n + len(self.coupling) + 21 * len(self.links)

    @property
    def joints(self) -> IndexArray:
        """(n,) columns of the joint compliances c [m/(rad/(N·m))]."""
        return np.arange(self.n)

    @property
    def coupling(self) -> IndexArray:
        """(n (n + 1) / 2,) columns of the full joint compliance C_θ [m/(rad/(N·m))]."""
        return np.arange(self.n, self.n + self.n * (self.n + 1) // 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Return the terms of all columns, in their order."""
        return JOINTS, COUPLED_JOINTS, links_behind(self.links)

    def link(self, joint: int) -> IndexArray:
        """(21,) columns of the compliance C_i of the link behind a joint."""
        start = self.n + len(self.coupling) + 21 * self.links.index(joint)
        return np.arange(start, start + 21)


@dataclass(frozen=True, eq=False)
class ElasticRows:
    """Contribution of observations to a fit: compressed rows, and sums that give the penalty its scale."""

    #: (P + 1, P + 1) with ``TᵀT`` the Gram matrix of the rows [A d], whitened in units of sigma
    triangle: FloatArray
    configurations: int  #: how many
    readings: int  #: coordinates that were read
    targets: int  #: targets that were read
    force: float  #: sum of ‖F‖² [N²]
    moment: float  #: sum of ‖M‖² [N²·m²]
    lever: FloatArray  #: (n,) sum of the squared distances of the load point from the frames' origins [m²]
    deflection: float  #: sum of ‖δp‖² [m²]

    #: (K, 3, P + 1) rows of each target, which a robust loss needs; None of more than `MOST_TARGETS`
    each: FloatArray | None

    @classmethod
    def merged(cls, parts: Sequence[ElasticRows]) -> ElasticRows:
        """Return the rows of all observations of the parts; nothing is subtracted, so nothing cancels."""
        summed = (f.name for f in fields(cls) if f.name not in {"triangle", "each"})
        sums = {name: sum(getattr(part, name) for part in parts) for name in summed}
        each = [part.each for part in parts if part.each is not None]
        few = len(each) == len(parts) and sums["targets"] <= MOST_TARGETS
        triangle = triangle_of(np.concatenate([part.triangle for part in parts]))
        return cls(triangle=triangle, each=np.concatenate(each) if few else None, **sums)

    @property
    def of_targets(self) -> FloatArray:
        """(K, 3, P + 1) rows of each target."""
        if self.each is None:
            raise ValueError("a robust loss needs the rows of all targets")
        return self.each

    def lengths(self, compliances: FloatArray) -> FloatArray:
        """Return the lengths (K,) of the whitened residuals of each target by compliances (P,) [m]."""
        residuals = self.of_targets[..., :-1] @ compliances - self.of_targets[..., -1]
        return np.asarray(np.linalg.norm(residuals, axis=1))

    def weighted(self, weight: FloatArray) -> ElasticRows:
        """Return the compressed rows, each target weighted (K,)."""
        rows = np.sqrt(weight)[:, None, None] * self.of_targets
        return replace(self, triangle=triangle_of(rows.reshape(-1, rows.shape[-1])))


def elastic_rows(robot: Robot, measurements: Measurements, columns: ElasticColumns) -> ElasticRows:
    """Compress observations, block by block: memory stays flat.

    Raises:
        MeasurementError: a covariance is not one.
    """
    triangle, lever, each = Triangle(entries=columns.width), np.zeros(robot.n), []
    few = int(measurements.present.sum()) <= MOST_TARGETS
    for block, rows in elastic_blocks(robot, measurements, columns):
        part = block.measurements
        in_sigma = whitened(part.covariance, rows)
        triangle.add(in_sigma, count=3 * int(part.present.sum()))
        each.append(in_sigma[part.present] if few else in_sigma[:0, 0])
        lever += np.square(link_motion(block)[2]).sum(axis=(0, 2))
    return ElasticRows(
        triangle=triangle.R,
        configurations=len(measurements),
        readings=triangle.rows,
        targets=int(measurements.present.sum()),
        force=float(np.square(measurements.force).sum()),
        moment=float(np.square(measurements.moment).sum()),
        lever=lever,
        deflection=float(np.square(measurements.deflection).sum()),
        each=np.concatenate(each) if few else None,
    )


def elastic_blocks(
    robot: Robot, measurements: Measurements, columns: ElasticColumns
) -> Iterator[tuple[RegressorBlock, FloatArray]]:
    """Yield blocks with their rows (B, T, 3, P + 1): columns of the richest model, then the readings."""
    for start in range(0, len(measurements), _BLOCK):
        for block in regressor_blocks(robot, measurements[start : start + _BLOCK]):
            yield block, rows_of(block, columns.terms, np.zeros(robot.n)).targets


ModelName = Literal["joints", "coupled_joints", "diagonal_links", "joints_and_links"]

MODELS: Final[tuple[ModelName, ...]] = ("joints", "coupled_joints", "diagonal_links", "joints_and_links")
"""The models, from simple to rich."""

Loss = Literal["squared", "huber", "absolute"]

LOSSES: Final[tuple[Loss, ...]] = ("squared", "huber", "absolute")
"""Losses of the norm of each target's residual."""

_SHORTEST_LEVER: Final = 1e-2
"""Least lever relative to the longest: a shorter one, through the load point, would leave rotations
unpenalised."""
_NO_COLUMN: Final = 1e-9
"""Least joint column relative to the largest: a smaller one is rounding, and its joint gets no number."""


@dataclass(frozen=True)
class ElasticModel:
    """Set of the elements that deflect."""

    #: elastic elements besides the joints, whose compliances are zero or positive: `coupled_joints` a
    #: full positive semidefinite joint compliance, `diagonal_links` six compliances a link,
    #: `joints_and_links` a full positive semidefinite 6 × 6 compliance a link
    name: ModelName
    columns: ElasticColumns  #: columns of the richest model; its links are those that bend here
    #: loss of the norm of each target's whitened residual: its square, Huber's, or the norm itself
    loss: Loss = "squared"
    threshold: float = DEFAULT_THRESHOLD  #: threshold of Huber's loss, in units of sigma

    @property
    def key(self) -> tuple[ModelName, Loss]:
        """Return what tells it from the other models of a run."""
        return self.name, self.loss

    def elements(self, visible: BoolArray) -> Iterator[tuple[IndexArray, IndexArray | None, bool]]:
        """Columns of each penalised element, the joints or None for a link, and whether it is full."""
        if self.name == "coupled_joints":
            seen = np.flatnonzero(visible)
            rows, columns = entries(self.columns.n)
            yield self.columns.coupling[visible[rows] & visible[columns]], seen, True
        elif self.name != "joints":
            for joint in self.columns.links:
                full = self.name == "joints_and_links"
                own = self.columns.link(joint)
                yield (own if full else own[diagonal(6)]), None, full


@dataclass(frozen=True, eq=False)
class Formulation:
    """A model on some observations, ready to be solved for any weight of the penalty."""

    fit: LeastSquares  #: quadratic part, in the program's parameters
    cone: Cone  #: cone of the parameters
    columns: IndexArray  #: (p,) column of each parameter
    unit: FloatArray  #: (p,) unit of each parameter: compliances are ``unit · x``
    width: int  #: P, number of columns
    size: float  #: ‖z‖, by which the readings are divided, in units of the whitened readings [m]

    def program(self, weight: float) -> SemidefiniteProgram:
        """The program for a weight λ of the penalty."""
        return SemidefiniteProgram(self.fit, self.cone, weight)

    def compliances(self, x: FloatArray) -> FloatArray:
        """(..., P) compliances of parameters (..., p); zero where no parameter is."""
        out = np.zeros((*x.shape[:-1], self.width))
        out[..., self.columns] = self.unit * x
        return out


def formulate(rows: ElasticRows, model: ElasticModel, visible: BoolArray) -> Formulation:
    """State a model on some observations.

    Args:
        rows: of the observations.
        model: what bends.
        visible: (n,) joints that the readings see.

    Raises:
        UnsupportedMethodError: nothing moved or nothing loads the robot, so that the penalty has no scale.
    """
    triangle, z = rows.triangle[:, :-1], rows.triangle[:, -1]
    size = float(np.linalg.norm(z))
    norms = np.linalg.norm(triangle[:, model.columns.joints], axis=0)
    joints = np.flatnonzero(visible & (norms > _NO_COLUMN * norms.max()))
    scale, lever = _scale(rows, size)
    scalars, blocks = [(joints, size / norms[joints])], []
    sizes = []
    seen = np.isin(np.arange(len(visible)), joints)
    for columns, coupled, full in model.elements(seen):
        if coupled is not None:
            root = np.sqrt(2.0 / 3.0) * lever[coupled]
        else:
            joint = next(each for each in model.columns.links if columns[0] in model.columns.link(each))
            root = np.repeat([1.0, np.sqrt(2.0 / 3.0) * float(lever[joint])], 3)
        if full:
            i, j = entries(len(root))
            blocks.append((columns, scale / (root[i] * root[j])))
            sizes.append(len(root))
        else:
            scalars.append((columns, scale / root**2))
    of_parameters = np.concatenate([columns for columns, _ in scalars + blocks])
    unit = np.concatenate([unit for _, unit in scalars + blocks])
    count = sum(len(columns) for columns, _ in scalars)
    return Formulation(
        fit=LeastSquares((triangle / size)[:, of_parameters] * unit, z / size),
        cone=Cone(count, tuple(sizes), penalised=count - len(joints)),
        columns=of_parameters,
        unit=unit,
        width=triangle.shape[1],
        size=size,
    )


def _scale(rows: ElasticRows, size: float) -> tuple[float, FloatArray]:
    """Compliance u that takes the force to the deflection [m/N], and the levers ρ (n,) [m].

    A moment counts as the force that has it on the levers.
    """
    lever = np.sqrt(rows.lever / rows.configurations)
    lever = np.maximum(lever, _SHORTEST_LEVER * lever.max())
    if size == 0.0 or not lever.all():
        raise _no_scale()
    force = rows.force + rows.moment * float(np.mean(1.5 / lever**2))
    if force == 0.0:
        raise _no_scale()
    return float(np.sqrt(rows.deflection / rows.targets / (force / rows.configurations))), lever


def _no_scale() -> UnsupportedMethodError:
    return UnsupportedMethodError(
        "nothing moved, or no load has a lever arm, so the penalty on link compliance has no scale",
        where="elasticity",
        remedy="use elasticity joints",
    )
