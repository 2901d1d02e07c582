"""Share of the deflection avoided in the second of two campaigns: measured where they match, or predicted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.inference.prediction import predict
from jointstiff.solver.paired.sides import Matches, PairSide
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.terms.block import regressor_blocks

_NO_EFFECT = 1e-9
"""Norm of a joint's column, relative to the largest, that counts as rounding."""


@dataclass(frozen=True)
class Share:
    """``1 − d_second / d_first`` of mean deflections d."""

    value: float | None  #: dimensionless; None where the first did not move
    standard_uncertainty: float | None = None  #: from that of the readings; None where it is unknown


@dataclass(frozen=True)
class MeasuredShare:
    """Share of the deflection avoided, measured in matching observations."""

    each: tuple[Share, ...]  #: one share a matching observation, of the mean deflection of its shared targets
    overall: Share  #: of the mean deflection of all of them


@dataclass(frozen=True)
class ConfigurationShare:
    """Share of the deflection avoided in one observation, over its targets."""

    observation: str  #: its label
    side: Literal["first", "second", "both"]  #: campaigns that have it
    measured: Share | None  #: from the readings; None unless both have it
    predicted: float | None  #: from both campaigns' compliances, dimensionless; None where they do not tell


@dataclass(frozen=True, eq=False)
class PredictedDeflection:
    """Mean predicted deflection of the targets in each of N observations."""

    first: FloatArray  #: (N,) with the compliances of the first campaign [m]; NaN where they do not tell
    second: FloatArray  #: (N,) with those of the second [m]; NaN for the same observations

    def share(self, rows: IndexArray | None = None) -> Share:
        """Return the share of some or all observations together, as far as it is known."""
        one, two = (self.first, self.second) if rows is None else (self.first[rows], self.second[rows])
        known = np.isfinite(one)
        return _share(float(one[known].sum()), float(two[known].sum()))

    def joined(self, other: PredictedDeflection) -> PredictedDeflection:
        """The observations of both."""
        return PredictedDeflection(
            np.concatenate([self.first, other.first]), np.concatenate([self.second, other.second])
        )


def configuration_shares(
    campaign: PairSide,
    predicted: PredictedDeflection,
    side: Literal["first", "second"],
    matches: Matches | None = None,
    measured: MeasuredShare | None = None,
) -> Iterator[ConfigurationShare]:
    """Yield the shares of a campaign's N observations.

    Args:
        campaign: of N observations.
        predicted: for the same.
        side: which campaign.
        matches: observations of the first campaign that the second has, too.
        measured: from their readings.
    """
    rows = [] if matches is None or measured is None else matches.first.tolist()
    each = dict(zip(rows, () if measured is None else measured.each, strict=True))
    for i, label in enumerate(campaign.measurements.labels):
        share = predicted.share(np.array([i])).value
        yield ConfigurationShare(label, "both" if i in each else side, each.get(i), share)


def measured_share(
    first: PairSide, second: PairSide, matches: Matches, sigmas: tuple[float | None, float | None]
) -> MeasuredShare:
    """Compare the readings of matching observations.

    The length of a deflection d has to first order the standard uncertainty ``√(d̂ᵀ Σ d̂)``, d̂ its
    direction and Σ its covariance; readings are independent.

    Args:
        first: of the campaign with the greater deflections.
        second: of the other.
        matches: their K matching observations.
        sigmas: standard uncertainty of one coordinate of one reading in each campaign [m], or None.
    """
    one, u_one = _mean_length(
        first.measurements, matches.first, matches.targets_first, matches.present, sigmas[0]
    )
    two, u_two = _mean_length(
        second.measurements, matches.second, matches.targets_second, matches.present, sigmas[1]
    )
    each = tuple(_share(*numbers) for numbers in zip(*map(list, (one, two, u_one, u_two)), strict=True))
    squares = float((u_one**2).sum()), float((u_two**2).sum())
    overall = _share(float(one.sum()), float(two.sum()), np.sqrt(squares[0]), np.sqrt(squares[1]))
    return MeasuredShare(each, overall)


def predicted_deflection(
    side: PairSide, compliances: tuple[FloatArray, FloatArray], unknown: BoolArray
) -> PredictedDeflection:
    """Predict the mean deflection of each observation's targets with both campaigns' compliances.

    Args:
        side: N observations, of either campaign.
        compliances: (n,) of the first campaign and of the second [rad/(N·m)].
        unknown: (n,) joints of which one of the campaigns says nothing; observations that twist them
            cannot be predicted.
    """
    one, two = (_mean_predicted(side, compliance) for compliance in compliances)
    blocks = regressor_blocks(side.robot, side.measurements)
    size = np.concatenate([np.abs(block.A).max(axis=(1, 2)) for block in blocks])
    hidden = (size[:, unknown] > _NO_EFFECT * size.max()).any(axis=1)
    return PredictedDeflection(np.where(hidden, np.nan, one), np.where(hidden, np.nan, two))


def _mean_predicted(side: PairSide, compliance: FloatArray) -> FloatArray:
    """(N,) mean predicted length of the deflections of each observation's targets [m]."""
    present = side.measurements.present
    prediction = predict(
        side.robot,
        side.measurements,
        compliance,
        complementary_stiffness=side.settings.complementary_stiffness,
    )
    lengths = np.linalg.norm(prediction.predicted, axis=2) * present
    mean: FloatArray = lengths.sum(axis=1) / present.sum(axis=1)
    return mean


def _mean_length(
    measurements: Measurements,
    rows: IndexArray,
    targets: IndexArray,
    present: BoolArray,
    sigma: float | None,
) -> tuple[FloatArray, FloatArray]:
    """(K,) mean length of the deflections of the chosen targets [m], and its standard uncertainty [m]."""
    deflection = measurements.deflection[rows[:, None], targets]
    covariance = measurements.covariance
    if covariance.ndim == 4:
        covariance = covariance[rows[:, None], targets]
    length = np.linalg.norm(deflection, axis=2)
    direction = deflection / np.where(length > 0, length, 1.0)[..., None]
    variance = np.sum(direction * (covariance @ direction[..., None])[..., 0], axis=2)
    count = present.sum(axis=1)
    mean = (length * present).sum(axis=1) / count
    scale = np.nan if sigma is None else sigma
    return mean, scale * np.sqrt((variance * present).sum(axis=1)) / count


def _share(first: float, second: float, u_first: float = np.nan, u_second: float = np.nan) -> Share:
    """The share, with the law of propagation of uncertainty (GUM, 5.1.2)."""
    if not first > 0:
        return Share(None)
    ratio = second / first
    uncertainty = float(np.hypot(u_second, ratio * u_first) / first)
    return Share(1.0 - ratio, uncertainty if np.isfinite(uncertainty) else None)
