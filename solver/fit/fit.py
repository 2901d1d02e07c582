"""Fit of compliances to readings: one function for joints and elastic models (method.md §2-§8).

Options with a penalty fit matrices by cone programs (`elastic`). Other options fit scalars within bounds, and
with them the balance of the loads (`identify`).
"""

from __future__ import annotations

from typing import Protocol, overload

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.elastic import ElasticFit, Penalised, fit_matrices
from jointstiff.solver.fit.identify import JointsFit, fit_scalars
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.problem import Certificate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stages import Scale
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.models import Model


class Fit(Protocol):
    """Fit of a model to N observations: the results that all models have."""

    @property
    def model(self) -> Model:
        """Model of the parts that bend."""

    @property
    def compliance(self) -> FloatArray:
        """Compliances (n,) of the joints [rad/(N·m)]."""

    @property
    def scale(self) -> Scale:
        """Sigma, as stated or from the residuals, and the chi-square of the residuals."""

    @property
    def statements(self) -> Statements:
        """Stated errors that were fitted together with the compliances."""

    @property
    def certificates(self) -> tuple[Certificate, ...]:
        """Evidence that the compliances are the optimum."""


@overload
def fit(rows: Rows, model: Model, options: Settings) -> JointsFit: ...


@overload
def fit(rows: Rows, model: Model, options: Penalised) -> ElasticFit: ...


def fit(rows: Rows, model: Model, options: Settings | Penalised) -> Fit:
    """Fit the compliances of a model to measured deflections.

    Args:
        rows: N observations of a robot with n joints.
        model: parts that bend.
        options: settings for a model whose compliances are scalars, or the penalty for one with matrices.

    Raises:
        UnsupportedMethodError: the readings, the robot or the model do not support the options, or the
            penalty is too small for the optimum to be certified.
        NotObservableError: the readings determine no joint.
        MeasurementError: an array has a wrong shape or wrong numbers, or the numbers overflow.
        SolverError: an optimum could not be certified.
    """
    if isinstance(options, Penalised):
        return fit_matrices(rows, model, options)
    if not model.has_only_joints:
        raise UnsupportedMethodError(
            f"the model {model.name} has compliance matrices, whose traces need a penalty",
            where="elasticity",
            remedy="give the weight of the penalty",
        )
    return fit_scalars(rows, options)
