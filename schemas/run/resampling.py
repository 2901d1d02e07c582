"""Resampling: the same fit on configurations drawn at random, many times."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from jointstiff.schemas.fields import Compliance, Message, Name, Stiffness

MAX_REPETITIONS = 100_000


class Resampling(Message):
    """What is drawn, how often, from which seed."""

    size: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        description="Configurations in a draw, at most those of the set.", examples=[10]
    )
    repetitions: Annotated[int, Field(strict=True, ge=1, le=MAX_REPETITIONS)] = Field(
        default=1000, description="How many draws."
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**53)] = Field(
        default=0, description="Of the draws: the same seed gives the same numbers, on any machines."
    )
    replacement: Annotated[bool, Field(strict=True)] = Field(
        default=False, description="Whether a configuration may come more than once in a draw (bootstrap)."
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
        description="Of the finite stiffnesses; to be read beside `share_infinite`."
    )
    stiffness_deviation: Stiffness[float | None] = Field(
        description="Standard deviation of one draw, of the same."
    )
    share_negative: float = Field(description="Share of the draws with a negative stiffness.")
    share_infinite: float = Field(description="Share of the draws with compliance zero.")
    share_undetermined: float = Field(description="Share of the draws that say nothing of the joint.")


class ResampledCompensation(Message):
    """Compensation on all configurations, drawn or not. Dimensionless."""

    mean: float | None
    deviation: float | None = Field(description="Standard deviation of one draw.")
    interval: tuple[float, float] | None = Field(description="Percentile interval.")


class ResamplingResult(Message):
    """How far the choice of configurations decides. Joints without a verdict have no numbers here either."""

    repetitions: int
    joints: list[ResampledJoint]
    share_any_negative: float = Field(description="Share of the draws with at least one negative stiffness.")
    compensation: ResampledCompensation
