"""Resampling: the same fit on configurations drawn at random, many times."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from jointstiff.schemas.fields import Compliance, Message, Name, Stiffness

MAX_REPETITIONS = 100_000


class Resampling(Message):
    """Size, number and seed of the draws."""

    size: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        description="Number of configurations per draw, at most those of the set.", examples=[10]
    )
    repetitions: Annotated[int, Field(strict=True, ge=1, le=MAX_REPETITIONS)] = Field(
        default=1000, description="Number of draws."
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**53)] = Field(
        default=0, description="Random seed: the same seed gives the same numbers on any machine."
    )
    replacement: Annotated[bool, Field(strict=True)] = Field(
        default=False, description="True if a configuration may be drawn more than once (bootstrap)."
    )


class ResampledJoint(Message):
    """One joint over all draws."""

    name: Name
    compliance_mean: Compliance[float | None]
    compliance_deviation: Compliance[float | None] = Field(description="Standard deviation of one draw.")
    compliance_interval: Compliance[tuple[float, float] | None] = Field(
        description="Percentile interval at the run's confidence."
    )
    stiffness_mean: Stiffness[float | None] = Field(
        description="Mean of the finite stiffnesses; see also `share_infinite`."
    )
    stiffness_deviation: Stiffness[float | None] = Field(
        description="Standard deviation of one draw, of the finite stiffnesses."
    )
    share_negative: float = Field(description="Share of the draws with a negative stiffness.")
    share_infinite: float = Field(description="Share of the draws with compliance zero.")
    share_undetermined: float = Field(description="Share of the draws in which the joint is not observable.")


class ResampledCompensation(Message):
    """Compensation on all configurations, drawn or not. Dimensionless."""

    mean: float | None
    deviation: float | None = Field(description="Standard deviation of one draw.")
    interval: tuple[float, float] | None = Field(description="Percentile interval.")


class ResamplingResult(Message):
    """Dispersion due to the choice of configurations. Joints that are not observable have no numbers."""

    repetitions: int
    joints: list[ResampledJoint]
    share_any_negative: float = Field(description="Share of the draws with at least one negative stiffness.")
    compensation: ResampledCompensation
