"""Stiffness of a gearbox from logs of a motion, as cone programs by Clarabel (method.md §19)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from jointstiff.solver.arrays import FloatArray, unit_columns
from jointstiff.solver.fit.triangle import orthonormal_basis
from jointstiff.solver.gearboxes.motion import MotionCampaign, MotionLog
from jointstiff.solver.gearboxes.programs import Carried, TwistProgram

_LOST_MOTION_SPEED: Final = 0.005
"""Speed [rad/s] at which lost motion has turned over by tanh(1)."""
_GREATEST_SECOND_ORDER: Final = 9e-6
"""Bound of the second order in time [s²] between two encoders: filters of some ms."""
_GREATEST_ECCENTRICITY: Final = 100e-6
"""Bound of each part of the error of an encoder by eccentricity [rad]."""
_TWICE_A_TURN: Final = 3.0
"""Factor by which the bound of the error twice a turn is smaller."""
_CHI_SQUARED: Final = float(stats.chi2.ppf(0.95, 1))
_MEMORY: Final = 2.4
"""Greatest time [s] over which residuals depend on each other."""
_DELAYS: Final = 6
"""Greatest number of corrections of the delay."""
_LEAST_DELAY: Final = 1e-6
"""Correction of the delay [s] that counts as none."""
_LEAST_NOISE: Final = 1e-9
"""Least root mean square of residuals [rad]: computed angles have residuals of rounding alone."""


@dataclass(frozen=True, eq=False)
class LogFit:
    """Gearbox of one joint by some logs."""

    joint: int
    compliance: float  #: [rad/(N·m)]
    interval: tuple[float, float]  #: 95 % interval of the compliance [rad/(N·m)]
    delay: float  #: of the link encoder behind the motor's [s]
    lost_motion: float  #: twist in positive less that in negative motion [rad]
    noise: float  #: root mean square of the residuals [rad]
    independent: float  #: number of independent samples
    least_torque: float  #: [N·m]
    greatest_torque: float  #: [N·m]
    against_torque: float  #: standard uncertainties by which the twist, without bounds, is against the torque

    @property
    def torque_range(self) -> float:
        """Greatest less least torque [N·m]."""
        return self.greatest_torque - self.least_torque

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of the compliance [rad/(N·m)], from the width of the interval."""
        return (self.interval[1] - self.interval[0]) / (2.0 * math.sqrt(_CHI_SQUARED))


@dataclass(frozen=True, eq=False)
class _Samples:
    """Kept samples of the logs of one joint, one log after the other, for one delay of the link encoder."""

    lengths: tuple[int, ...]  # number of samples of each log
    twist: FloatArray  # (S,) [rad]
    position: FloatArray  # (S,) of the joint [rad]
    velocity: FloatArray  # (S,) [rad/s]
    acceleration: FloatArray  # (S,) [rad/s²]

    @classmethod
    def of(cls, logs: Sequence[MotionLog], joint: int, delay: float) -> _Samples:
        """Return the samples of logs for a delay of the link encoder [s]."""
        twists, motions = [], []
        for log in logs:
            twists.append(log.smooth(log.motor[:, joint] - log.shift_link(joint, delay)))
            motions.append([log.smooth(log.motor[:, joint], derivative) for derivative in range(3)])
        lengths = tuple(len(twist) for twist in twists)
        return cls(lengths, np.concatenate(twists), *np.concatenate(motions, axis=1))

    def list_other_columns(self, periods: Sequence[float]) -> FloatArray:
        """Return the columns (S, k) of what twists without a torque; the first seven have bounds or names.

        Order: second order in time, sine and cosine once and twice a turn, remaining delay, lost motion;
        then periods of the gear, and an offset for each log.
        """
        q = self.position
        columns = [self.acceleration, np.sin(q), np.cos(q), np.sin(2.0 * q), np.cos(2.0 * q)]
        columns += [self.velocity, np.tanh(self.velocity / _LOST_MOTION_SPEED)]
        for period in periods:
            columns += [np.sin(period * q), np.cos(period * q)]
        offsets = np.repeat(np.eye(len(self.lengths)), self.lengths, axis=0)
        return np.column_stack([*columns, offsets])


_BOUNDS: Final = np.array(
    [_GREATEST_SECOND_ORDER, *[_GREATEST_ECCENTRICITY] * 2, *[_GREATEST_ECCENTRICITY / _TWICE_A_TURN] * 2]
)
_DELAY_COLUMN, _LOST_MOTION_COLUMN = 5, 6


def fit_logs(campaign: MotionCampaign, joint: int, numbers: Sequence[int]) -> LogFit:
    """Fit the gearbox of one joint to the logs of some numbers.

    Raises:
        SolverError: Clarabel finds no optimum.
    """
    logs = [campaign.logs[number] for number in numbers]
    of_bodies = np.concatenate([campaign.torques[number][:, joint] for number in numbers])
    delay = 0.0
    for _ in range(_DELAYS):
        samples = _Samples.of(logs, joint, delay)
        program = _state_program(campaign, joint, samples, of_bodies)
        program.solve()
        correction = float(program.other[_DELAY_COLUMN])
        if abs(correction) < _LEAST_DELAY:
            break
        delay += correction
    stated_torque = campaign.find_stated_torque(joint, numbers)
    own = _project_out(stated_torque, program.others)
    inflation = _find_inflation(program.residuals, samples.lengths, logs)
    independent = len(samples.twist) / inflation
    freedom = max(independent - 1.0, 1.0)
    least = max(float(np.linalg.norm(program.residuals)), _LEAST_NOISE * np.sqrt(len(samples.twist)))
    interval = program.find_ends(least * np.sqrt(1.0 + _CHI_SQUARED / freedom))
    return LogFit(
        joint,
        program.compliance,
        interval,
        delay,
        2.0 * float(program.other[_LOST_MOTION_COLUMN]),
        float(np.sqrt(np.mean(program.residuals**2))),
        independent,
        float(stated_torque.min()),
        float(stated_torque.max()),
        _measure_opposition(own, samples.twist, program.others, independent),
    )


def _state_program(
    campaign: MotionCampaign, joint: int, samples: _Samples, of_bodies: FloatArray
) -> TwistProgram:
    """Return the program of a joint; `of_bodies` (S, B, 4) are the torques of the bodies."""
    carried = [
        Carried(torques[:, 0], body.mass_tolerance, body.centre_tolerance, torques[:, 1:])
        for body, torques in zip(campaign.bodies, of_bodies.swapaxes(0, 1), strict=True)
        if body.joint >= joint  # bodies before the joint twist nothing
    ]
    carried += [
        Carried(spring.holding_torque(samples.position), spring.tolerance)
        for spring in campaign.springs
        if spring.joint == joint
    ]
    others = samples.list_other_columns(campaign.periods.get(joint, ()))
    return TwistProgram(carried, others, _BOUNDS, samples.twist)


def _project_out(torque: FloatArray, others: FloatArray) -> FloatArray:
    """Return what is left of a torque (S,) after the columns (S, k) of what twists without a torque."""
    basis = orthonormal_basis(unit_columns(others)[0])
    return np.asarray(torque - basis @ (basis.T @ torque))


def _measure_opposition(own: FloatArray, twist: FloatArray, others: FloatArray, independent: float) -> float:
    """Return by how many standard uncertainties a twist (S,) is against the torque.

    Args:
        own: (S,) what is left of the stated torque after the other columns.
        twist: (S,) [rad].
        others: (S, k) columns of what twists without a torque.
        independent: number of independent samples.
    """
    left = _project_out(twist, others)
    slope = float(own @ left) / float(own @ own)
    rest = left - slope * own
    uncertainty = np.linalg.norm(rest) / np.sqrt(max(independent - 1.0, 1.0)) / np.linalg.norm(own)
    return -slope / float(max(uncertainty, np.finfo(float).tiny))


def _find_inflation(residuals: FloatArray, lengths: Sequence[int], logs: Sequence[MotionLog]) -> float:
    """Return the number of samples that say as much as one independent sample, mean over the logs.

    ``1 + 2 Σ_k ρ(k)`` with the autocorrelations ρ of the residuals at lag k, up to the first that is not
    positive (Geyer 1992). It is that of a torque that hardly changes in this time: what other columns leave
    of a torque depends on bounds that are reached, so that its own autocorrelation is not used.
    """
    ends = np.cumsum(lengths)[:-1]
    inflations = []
    for log, rest in zip(logs, np.split(residuals, ends), strict=True):
        spacing = log.period * (log.kept.step or 1)
        lags = min(int(_MEMORY / spacing), len(rest) - 1)
        correlations = _autocorrelation(rest, lags)
        is_first_lobe = np.cumsum(correlations <= 0.0) == 0
        inflations.append(1.0 + 2.0 * float(correlations[is_first_lobe].sum()))
    return float(np.average(inflations, weights=lengths))


def _autocorrelation(values: FloatArray, lags: int) -> FloatArray:
    """Return the autocorrelations (lags,) of values at lags 1, 2, …."""
    centred = values - values.mean()
    whole = np.correlate(centred, centred, "full")[len(values) :]
    return np.asarray(whole[:lags] / max(float(centred @ centred), np.finfo(float).tiny))
