"""Fit of compliances to readings: one function for all models (method.md §2-§8, §14).

Options with a penalty fit matrices by cone programs (`elastic`). Settings fit scalars within bounds, and with
them the balance of the loads (`identify`). Options of own weight fit scalars, and with them the geometry and
the masses (`weight`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, overload

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.elastic import ElasticFit, Penalised, fit_matrices
from jointstiff.solver.fit.identify import JointsFit, fit_scalars
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.problem import Certificate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stages import Scale
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.models import ElasticModel, Model, WeightModel

if TYPE_CHECKING:
    from jointstiff.solver.fit.weight import Weighed, WeightFit
    from jointstiff.solver.fit.weight_rows import WeightReadings


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
def fit(rows: Rows, model: ElasticModel, options: Settings) -> JointsFit: ...


@overload
def fit(rows: Rows, model: ElasticModel, options: Penalised) -> ElasticFit: ...


@overload
def fit(rows: WeightReadings, model: WeightModel, options: Weighed) -> WeightFit: ...


def fit(rows: Rows | WeightReadings, model: Model, options: Settings | Penalised | Weighed) -> Fit:
    """Fit the compliances of a model to measured deflections, or to positions of a robot that sags.

    Args:
        rows: N observations of a robot with n joints: deflections under known loads, or positions under own
            weight.
        model: parts that bend.
        options: settings for a model whose compliances are scalars, the penalty for one with matrices, or the
            options of own weight.

    Raises:
        UnsupportedMethodError: the readings, the robot or the model do not support the options, or the
            penalty is too small for the optimum to be certified.
        NotObservableError: the readings determine no joint.
        MeasurementError: an array has a wrong shape or wrong numbers, or the numbers overflow; or a fit by
            own weight does not converge.
        SolverError: an optimum could not be certified.
    """
    match rows, model, options:
        case Rows(), ElasticModel(), Settings():
            _refuse_matrices(model)
            return fit_scalars(rows, options)
        case Rows(), ElasticModel(), Penalised():
            return fit_matrices(rows, model, options)
        case _:
            return _fit_by_weight(rows, model, options)


def _refuse_matrices(model: ElasticModel) -> None:
    """Refuse a model with compliance matrices.

    Raises:
        UnsupportedMethodError: the model has matrices, which need a penalty.
    """
    if model.has_only_joints:
        return
    raise UnsupportedMethodError(
        f"the model {model.name} has compliance matrices, whose traces need a penalty",
        where="elasticity",
        remedy="give the weight of the penalty",
    )


def _fit_by_weight(rows: object, model: Model, options: object) -> WeightFit:
    """Fit positions of a robot that sags, and refuse any other rows, model or options.

    Raises:
        UnsupportedMethodError: rows, model and options are not all those of own weight.
    """
    # Fits under known loads do not need these modules, whose import takes a tenth of a second.
    from jointstiff.solver.fit.weight import Weighed, fit_weight
    from jointstiff.solver.fit.weight_rows import WeightReadings

    match rows, model, options:
        case WeightReadings(), WeightModel(), Weighed():
            return fit_weight(rows, options)
        case _:
            raise UnsupportedMethodError(
                f"the model {model.name} with the options {type(options).__name__} cannot be fitted to "
                f"{type(rows).__name__}",
                where="model",
                remedy="fit `WeightReadings` by the model own_weight with `Weighed`; fit `Rows` by another "
                "model with `Settings` or `Penalised`",
            )
