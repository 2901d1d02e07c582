"""False alarms of the trend's charts, and drifts that they find: simulated campaigns of six joints.

By name only: it takes a minute or two.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from benchmarks.report import Figure, Section
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.compare.trend import (
    FALSE_ALARMS,
    LEAST_BASELINE,
    LIFE,
    Baseline,
    alarm_level,
    monitor,
    pooled_excess,
)

__all__ = ["run"]

ROBOTS: Final = 20_000
JOINTS: Final = 6
U: Final = 0.02
"""Standard uncertainty of ln k of one campaign."""
DRIFT: Final = 0.3
"""Of one joint, in units of U a campaign."""
_CHUNK: Final = 250
_CLASSICAL_LIMIT: Final = 2.859
"""Of an EWMA with λ = 0.2 for one false alarm in 500 campaigns, where the mean is known (Lucas and
Saccucci, Technometrics 32, 1990)."""


class Case(NamedTuple):
    """A way in which campaigns in control differ from each other."""

    name: str
    between: float = 0.0
    """τ / u of every joint, or of one."""
    is_of_one: bool = False
    common: float = 0.0
    """Error that all joints of a campaign share, such as of the force, in units of u; part of u."""
    ratio: float = 1.0
    """Greatest over least u of the campaigns."""
    relative: float = U
    """u(c) / c of one campaign; the simulated compliance is normal, not its logarithm."""


CASES: Final = (
    Case("readings alone"),
    Case("between campaigns 0.5 u", between=0.5),
    Case("between campaigns 1 u", between=1.0),
    Case("between campaigns 2 u", between=2.0),
    Case("between campaigns 5 u", between=5.0),
    Case("error common to the joints 0.8 u", common=0.8),
    Case("u from 0.5 to 2 times", ratio=4.0),
    Case("u(c)/c = 0.15", relative=0.15),
    Case("between campaigns 1 u, one joint alone", between=1.0, is_of_one=True),
    Case("between campaigns 2 u, one joint alone", between=2.0, is_of_one=True),
    Case("between campaigns 5 u, one joint alone", between=5.0, is_of_one=True),
)


def run(*, quick: bool) -> list[Section]:
    """Each case: false alarms by joint and by robot, and drifts found."""
    robots = 200 if quick else ROBOTS
    rows: list[tuple[str, ...]] = []
    found = {case.name: _simulated(case, robots, seed) for seed, case in enumerate(CASES)}
    for name, outcome in found.items():
        rows.append((name, *(f"{100.0 * share:.2f}" for share in outcome)))
    honest = found[CASES[0].name]
    worst = max(found[case.name].by_robot for case in CASES if not case.is_of_one)
    classical = _classical(robots)
    rate = 100.0 * FALSE_ALARMS
    return [
        Section(
            title=f"Trend: {robots:,} robots of {JOINTS} joints each ({robots * JOINTS:,} charts), baseline "
            f"of {LEAST_BASELINE}, then {LIFE} campaigns; shares in %",
            columns=(
                "in control, but for",
                "false alarm, by joint",
                "by robot",
                f"drift {DRIFT} u found by campaign {LIFE}",
                f"by campaign {LIFE - LEAST_BASELINE}",
            ),
            rows=tuple(rows),
            figures=(
                Figure(
                    "false alarms by robot, readings alone", 100.0 * honest.by_robot, "at most", rate, " %"
                ),
                Figure(
                    "false alarms by robot, worst where joints are alike",
                    100.0 * worst,
                    "at most",
                    rate,
                    " %",
                ),
                Figure(
                    f"drift of {DRIFT} u a campaign found, readings alone",
                    100.0 * honest.found,
                    "at least",
                    95.0,
                    " %",
                ),
                Figure(
                    f"the same, within {LIFE} campaigns with those of the baseline",
                    100.0 * honest.found_early,
                    "at least",
                    95.0,
                    " %",
                ),
            ),
            notes=(
                "a false alarm by robot is one of any of its joints, at any of the campaigns",
                "the drift is of one joint (the one that scatters): it softens, beginning after the baseline",
                f"for comparison, limits of ±{_CLASSICAL_LIMIT} standard deviations by joint: "
                f"{100.0 * classical[0]:.1f} % false alarms by joint with the baseline's uncertainty, "
                f"{100.0 * classical[1]:.1f} % if it is ignored ({100.0 * classical[2]:.1f} % by robot)",
                f"standard error of a share of 5 %: {21.8 / robots**0.5:.2f} %",
            ),
            data={"classical": classical},
        )
    ]


class Outcome(NamedTuple):
    """Shares of charts, or robots."""

    by_joint: float
    by_robot: float
    found: float
    found_early: float


def _simulated(case: Case, robots: int, seed: int) -> Outcome:
    generator = np.random.default_rng([seed, 18])
    parts = [_chunk(case, min(_CHUNK, robots - at), generator) for at in range(0, robots, _CHUNK)]
    alarms = np.concatenate([part[0] for part in parts])
    drifts = np.concatenate([part[1] for part in parts])
    return Outcome(
        float(alarms.any(-1).mean()),
        float(alarms.any((-1, -2)).mean()),
        float(drifts.any(-1).mean()),
        float(drifts[:, : LIFE - LEAST_BASELINE].any(-1).mean()),
    )


def _chunk(case: Case, robots: int, generator: np.random.Generator) -> tuple[BoolArray, BoolArray]:
    """Return false alarms (robots, joints, campaigns), and alarms of a drift of joint 1."""
    shape = (robots, JOINTS, LEAST_BASELINE + LIFE)
    scale = case.relative * np.exp(
        np.log(case.ratio) * (generator.uniform(size=(robots, 1, shape[-1])) - 0.5)
    )
    noise = np.sqrt(1.0 - case.common**2) * generator.standard_normal(shape)
    noise += case.common * generator.standard_normal((robots, 1, shape[-1]))
    true = case.between * case.relative * generator.standard_normal(shape)
    if case.is_of_one:
        true[:, 1:] = 0.0
    drift = np.zeros(shape)
    drift[:, 0, LEAST_BASELINE:] = -DRIFT * case.relative * np.arange(1, LIFE + 1)
    return _alarms(true, scale * noise, scale), _alarms(true + drift, scale * noise, scale)[:, 0]


def _alarms(true: FloatArray, noise: FloatArray, scale: FloatArray) -> BoolArray:
    """Chart compliances exp(-true), read with the relative uncertainty `scale`."""
    compliance = np.exp(-true)
    read = compliance + noise
    # A compliance near zero would not enter the chart; none is as low as this.
    values, u = -np.log(np.maximum(read, 0.05)), scale / np.maximum(read, 0.05)
    baseline = Baseline.of(values[..., :LEAST_BASELINE], u[..., :LEAST_BASELINE])
    excess = pooled_excess(baseline.scatter.sum(-1), JOINTS * (LEAST_BASELINE - 1))
    after = values[..., LEAST_BASELINE:], u[..., LEAST_BASELINE:]
    found = monitor(baseline, np.repeat(excess[:, None], JOINTS, axis=1), *after, alarm_level(JOINTS))
    return found.exceeded


def _classical(robots: int) -> tuple[float, float, float]:
    """Return false alarms by joint with and without the baseline's uncertainty, and by robot without."""
    generator = np.random.default_rng(38)
    values = generator.standard_normal((robots, JOINTS, LEAST_BASELINE + LIFE))
    centre = values[..., :LEAST_BASELINE].mean(-1)
    weights = np.array([[0.2 * 0.8 ** (t - i) if i <= t else 0.0 for i in range(LIFE)] for t in range(LIFE)])
    deviation = np.abs((values[..., LEAST_BASELINE:] - centre[..., None]) @ weights.T)
    known = (weights**2).sum(-1)
    honest = known + weights.sum(-1) ** 2 / LEAST_BASELINE
    with_it = (deviation > _CLASSICAL_LIMIT * np.sqrt(honest)).any(-1)
    without = (deviation > _CLASSICAL_LIMIT * np.sqrt(known)).any(-1)
    return float(with_it.mean()), float(without.mean()), float(without.any(-1).mean())
