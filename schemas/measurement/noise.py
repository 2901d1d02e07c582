"""Noise of the readings: one sigma for all, a tracker's data sheet, or one figure per reading."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from jointstiff.schemas.fields import Dimensionless, Message, Quantity, Radians, Vector3

LEAST_SIGMA = 1e-9


def _stated(sigma: object) -> object:
    if isinstance(sigma, int | float) and not isinstance(sigma, bool) and sigma < LEAST_SIGMA:
        raise ValueError(
            f"must be positive, at least {LEAST_SIGMA:g}: omit `noise` to estimate sigma from the residuals"
        )
    return sigma


Sigma = Annotated[float, Field(strict=True, ge=LEAST_SIGMA, le=1e3), BeforeValidator(_stated)]
"""Standard uncertainty of a length, in the set's unit of length."""

Place = Annotated[float, Field(strict=True, gt=0.0, le=1e3)]
"""Standard uncertainty of a place, in the set's unit of length."""

Matrix3 = Annotated[tuple[Vector3, Vector3, Vector3], Field(description="Row by row, symmetric.")]

_PerDistance = Annotated[float, Field(strict=True, ge=0.0, le=0.1)]


class Uncertainty(Message):
    """Standard uncertainty ``constant + per_distance · d`` at the distance d from the instrument."""

    constant: Annotated[float, Field(strict=True, ge=0.0, le=1e3)] = Field(
        description="Constant part, in the set's unit of length.", examples=[1e-5]
    )
    per_distance: Dimensionless[_PerDistance] = Field(
        description="Part per distance: 5e-6 is 5 µm per metre, in any unit of length.", examples=[5e-6]
    )

    @model_validator(mode="after")
    def _says_something(self) -> Uncertainty:
        if self.constant == 0.0 and self.per_distance == 0.0:
            raise ValueError("give a positive `constant` or `per_distance`: no instrument is exact")
        return self


class Instrument(Message):
    """A laser tracker, with different uncertainties along and across its line of sight.

    Standard uncertainties (coverage factor 1). Sheets often state a maximum permissible error; divide it as
    the sheet states, or by 2 otherwise.
    """

    station: Vector3 = Field(description="Position of the tracker in R0, in units.length.")
    range: Uncertainty = Field(description="Uncertainty along the line of sight.")
    transverse: Uncertainty = Field(
        description="Uncertainty across the line of sight, in each of two directions."
    )


class ForceUncertainty(Message):
    """Standard uncertainties of the load, each common to all observations of the set.

    They belong to the one scale or load cell that every observation used, so no number of readings averages
    them out. Coverage factor 1: a load cell of class 0.5 has a scale of about 0.005 / √3.
    """

    scale: Dimensionless[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] = Field(
        default=0.0,
        description="Relative standard uncertainty of the magnitude of forces and moments: 0.01 is one per "
        "cent. Every stiffness has the same relative error.",
        examples=[0.005],
    )
    direction: Radians[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] = Field(
        default=0.0,
        description="Standard uncertainty of a rotation of all forces and moments about each axis of R0, "
        "in rad whatever the "
        "set's unit of angle.",
        examples=[0.002],
    )

    @model_validator(mode="after")
    def _says_something(self) -> ForceUncertainty:
        if self.scale == 0.0 and self.direction == 0.0:
            raise ValueError("give a positive `scale` or `direction`, or leave `force` out")
        return self


class AxisUncertainty(Message):
    """Standard uncertainties of the joint axes in the robot's model, each axis by itself.

    A geometry states them for each axis (`position_uncertainty`, `direction_uncertainty`); give the typical
    or the greatest. Each axis has one error for all observations.
    """

    position: Annotated[float, Field(strict=True, ge=0.0, le=1e3)] = Field(
        default=0.0,
        description="Standard uncertainty of an axis's position in each direction across it, in the set's "
        "unit of length.",
        examples=[1e-4],
    )
    direction: Radians[Annotated[float, Field(strict=True, ge=0.0, le=0.5)]] = Field(
        default=0.0,
        description="Standard uncertainty of an axis's direction about each direction across it, in rad "
        "whatever the set's unit "
        "of angle.",
        examples=[1e-4],
    )

    @model_validator(mode="after")
    def _says_something(self) -> AxisUncertainty:
        if self.position == 0.0 and self.direction == 0.0:
            raise ValueError("give a positive `position` or `direction`, or leave `axes` out")
        return self


class Noise(Message):
    """Uncertainty of one reading of the tracker and of a secondary encoder, of the load and of places.

    Give the tracker's as `sigma` or as `instrument`, or as neither if every reading has its own.
    """

    sigma: Sigma | None = Field(
        default=None,
        description="Standard uncertainty of one coordinate of one position reading, in the set's unit of "
        "length. The uncertainty of a deflection, a difference of two, is √2 times larger.",
        examples=[2e-5],
    )
    encoder_sigma: Annotated[float, Field(strict=True, ge=1e-10, le=10.0)] | None = Field(
        default=None,
        description="Standard uncertainty of one reading of a secondary encoder, in the set's unit of "
        "angle; needed with encoder readings.",
        examples=[5e-6],
    )
    instrument: Instrument | None = Field(
        default=None, description="Uncertainty from the tracker's data sheet, instead of `sigma`."
    )
    force: ForceUncertainty | None = Field(
        default=None, description="Uncertainty of the load; if absent, forces and moments count as exact."
    )
    load_point: Place | None = Field(
        default=None,
        description="Standard uncertainty of each coordinate of the load point in the flange frame, in the "
        "set's unit of length; the error is the same in all observations. If absent, 10 mm is assumed, with "
        "a note in the assessment.",
        examples=[5e-4],
    )
    target_places: Place | None = Field(
        default=None,
        description="Standard uncertainty of each coordinate of each target's position in the flange frame, "
        "in the set's unit of length; each target has one error for all observations. Errors of the "
        "readings are in `sigma`. If absent, these positions count as exact.",
        examples=[5e-4],
    )

    axes: AxisUncertainty | None = Field(
        default=None,
        description="Uncertainty of the robot's geometry; if absent, its model counts as exact.",
    )
    refuted: bool = Field(
        default=False,
        strict=True,
        description="True if the residuals refuted the tracker's noise as `noise` or the readings state it. "
        "The statement stays on record, sigma is estimated from the residuals, and the verdict is at most "
        "*use with care*.",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Noise:
        if self.sigma is not None and self.instrument is not None:
            raise ValueError("give either `sigma` or `instrument`, not both")
        if not self.states_something:
            raise ValueError("give `sigma`, `instrument` or `force`, or leave `noise` out")
        return self

    @property
    def states_something(self) -> bool:
        """Return whether anything is stated."""
        return any(getattr(self, name) != field.default for name, field in type(self).model_fields.items())


def refuse_two_kinds(sigma: Quantity | None, unloaded: Matrix3 | None, loaded: Matrix3 | None) -> None:
    """Refuse a reading that states its noise twice, or that of one state only.

    Raises:
        ValueError: saying which.
    """
    if (unloaded is None) != (loaded is None):
        raise ValueError("give both `unloaded_covariance` and `loaded_covariance`, or neither")
    if sigma is not None and unloaded is not None:
        raise ValueError("give either `sigma` or the two covariances, not both")
