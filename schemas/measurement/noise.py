"""What a reading is worth: one sigma for all, an instrument's sheet, or a figure of each reading's own."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from jointstiff.schemas.fields import Dimensionless, Message, Quantity, Vector3

Sigma = Annotated[float, Field(strict=True, ge=1e-9, le=1e3)]
"""Standard uncertainty of a length, in the set's unit of length."""

Matrix3 = Annotated[tuple[Vector3, Vector3, Vector3], Field(description="Row by row, symmetric.")]

_PerDistance = Annotated[float, Field(strict=True, ge=0.0, le=0.1)]


class Uncertainty(Message):
    """Standard uncertainty ``constant + per_distance · d`` at the distance d from the instrument."""

    constant: Annotated[float, Field(strict=True, ge=0.0, le=1e3)] = Field(
        description="In the set's unit of length.", examples=[1e-5]
    )
    per_distance: Dimensionless[_PerDistance] = Field(
        description="A number: 5e-6 is 5 µm in a metre, whatever the unit of length.", examples=[5e-6]
    )

    @model_validator(mode="after")
    def _says_something(self) -> Uncertainty:
        if self.constant == 0.0 and self.per_distance == 0.0:
            raise ValueError("give a positive `constant` or `per_distance`: no instrument is exact")
        return self


class Instrument(Message):
    """A laser tracker: along its line of sight and across it a reading is worth unlike much.

    Standard uncertainties (coverage factor 1). Sheets often state a maximum permissible error; divide it as
    the sheet says, or by 2 if it says nothing.
    """

    station: Vector3 = Field(description="Where the tracker stands, in R0, in units.length.")
    range: Uncertainty = Field(description="Along the line of sight.")
    transverse: Uncertainty = Field(description="Across it, in each of two directions.")


class Noise(Message):
    """What one reading of the tracker, and of a secondary encoder, is worth.

    Of the tracker exactly one kind: `sigma`, or `instrument`, or neither where every reading states its own.
    """

    sigma: Sigma | None = Field(
        default=None,
        description="Standard uncertainty of one coordinate of one position reading, in the set's "
        "unit of length. A deflection, being a difference of two, has √2 times that.",
        examples=[2e-5],
    )
    encoder_sigma: Annotated[float, Field(strict=True, ge=1e-10, le=10.0)] | None = Field(
        default=None,
        description="Standard uncertainty of one reading of a secondary encoder, in the set's unit of "
        "angle; needed where encoders were read.",
        examples=[5e-6],
    )
    instrument: Instrument | None = Field(
        default=None, description="What the tracker's sheet says, in place of `sigma`."
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Noise:
        if self.sigma is not None and self.instrument is not None:
            raise ValueError("give either `sigma` or `instrument`, not both")
        if self.sigma is None and self.instrument is None and self.encoder_sigma is None:
            raise ValueError("give `sigma` or `instrument`, or leave `noise` out")
        return self


def refuse_two_kinds(sigma: Quantity | None, unloaded: Matrix3 | None, loaded: Matrix3 | None) -> None:
    """Refuse a reading that states its noise twice, or that of one state only.

    Raises:
        ValueError: saying which.
    """
    if (unloaded is None) != (loaded is None):
        raise ValueError("give both `unloaded_covariance` and `loaded_covariance`, or neither")
    if sigma is not None and unloaded is not None:
        raise ValueError("give either `sigma` or the two covariances, not both")
