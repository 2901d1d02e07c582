"""Causes of what joints alone leave unexplained: planted, named, fitted beside the joints; clean ones silent.

Readings come from springs that balance the load exactly; what is planted is done to loads, angles and places
of that simulator, never by the solver's own terms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.designs import SIGMA, Design
from benchmarks.report import Figure, Part, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, SpringArm, plan_experiment
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.estimation.fitted_causes import fit_causes
from jointstiff.solver.estimation.joints import JointsAlone
from jointstiff.solver.estimation.method import Settings
from jointstiff.solver.mechanics.measurements import (
    CommonUncertainty,
    DifferenceNoise,
    Instrument,
    Measurements,
)
from tests.support.springs import robot_of

__all__ = ["run"]

_STREAM = 71
_POINTS: FloatArray = np.array(list(TARGETS.values()))
Generator = np.random.Generator


@dataclass(frozen=True, eq=False)
class Planted:
    """A campaign with one cause planted: what is read, and the loads and places that are stated."""

    loaded: FloatArray  #: (N, T, 3) places of the targets under load [m]
    stated: Design


def _direction(generator: Generator) -> FloatArray:
    vector = generator.standard_normal(3)
    return vector / np.linalg.norm(vector)


def _design(seed: int) -> Design:
    """Return 16 to 40 pulls on an arm whose joints are up to a third stiffer or softer than usual."""
    generator = np.random.default_rng([seed, _STREAM])
    arm = default_arm()
    arm = replace(arm, stiffnesses=arm.stiffnesses * np.exp(0.3 * generator.uniform(-1.0, 1.0, 6)))
    force = float(generator.uniform(1000.0, 2000.0))
    count = int(generator.integers(16, 41))
    return Design.by(arm, plan_experiment(arm, configurations=count, load="pull", force=force, seed=seed))


def _restated(design: Design, **changes: FloatArray) -> Design:
    """Return a design whose experiment is stated otherwise than it was carried out."""
    return replace(design, experiment=replace(design.experiment, **changes))


def _load_point(design: Design, generator: Generator) -> Planted:
    off = generator.uniform(0.05, 0.15) * _direction(generator)
    stated = _restated(design, load_points=design.experiment.load_points + off)
    return Planted(design.loaded, stated)


def _constant_force(design: Design, generator: Generator) -> Planted:
    missing = generator.uniform(100.0, 300.0) * _direction(generator)
    return Planted(design.loaded, _restated(design, forces=design.experiment.forces - missing))


def _load_zero(design: Design, generator: Generator) -> Planted:
    zero = generator.uniform(100.0, 300.0) * _direction(generator)
    turned = design.arm.posture(design.experiment.joints).flange_rotation @ zero
    return Planted(design.loaded, _restated(design, forces=design.experiment.forces - turned))


def _load_scale(design: Design, generator: Generator) -> Planted:
    """Hang heavier loads than stated from the middle on."""
    count = len(design.loaded)
    later = np.arange(count) >= generator.integers(count // 3, 2 * count // 3)
    factor = np.where(later, 1.0 / generator.uniform(1.06, 1.12), 1.0)[:, None]
    return Planted(design.loaded, _restated(design, forces=factor * design.experiment.forces))


def _since(count: int, generator: Generator) -> FloatArray:
    """Return ones from the first observation on, or from one in the middle."""
    first = 0 if generator.random() < 0.5 else int(generator.integers(count // 3, 2 * count // 3))
    return (np.arange(count) >= first).astype(np.float64)[:, None, None]


def _shift(design: Design, generator: Generator) -> Planted:
    moved = generator.uniform(5e-5, 1.5e-4) * _direction(generator)
    return Planted(design.loaded + _since(len(design.loaded), generator) * moved, design)


def _turn(design: Design, generator: Generator) -> Planted:
    """Turn the tracker about where it stands."""
    station, turn = np.array([4.0, 1.0, 1.5]), generator.uniform(5e-5, 2e-4) * _direction(generator)
    moved = np.cross(turn, design.loaded - station)
    return Planted(design.loaded + _since(len(design.loaded), generator) * moved, design)


def _play(design: Design, generator: Generator) -> Planted:
    """Turn every joint through half its play, to the side that the load pushes it."""
    arm, experiment = design.arm, design.experiment
    bent = equilibrium(arm, experiment.joints, *experiment.wrenches)
    side = np.sign(bent)
    play = generator.uniform(1e-4, 2e-4) * generator.choice([0.0, 1.0], 6, p=[0.3, 0.7])
    posture = arm.posture(experiment.joints + bent + side * play)
    return Planted(posture.targets_to_base(_POINTS), design)


CAUSES: dict[str, Callable[[Design, Generator], Planted]] = {
    "load_point": _load_point,
    "constant_force": _constant_force,
    "load_zero": _load_zero,
    "load_scale": _load_scale,
    "shift": _shift,
    "turn": _turn,
    "play": _play,
}


def _read(planted: Planted, generator: Generator, *, sigma: bool) -> Measurements:
    """Read a planted campaign with noise; sigma is stated or not, the load point is assumed to 10 mm."""
    places = np.stack([planted.stated.unloaded, planted.loaded])
    noisy = places + SIGMA * generator.standard_normal(places.shape)
    read = planted.stated.measurements(*noisy, sigma=SIGMA if sigma else None)
    return replace(
        read, common_uncertainty=CommonUncertainty(load_point=0.01, assumed=frozenset({"load_point"}))
    )


@dataclass(frozen=True)
class _Outcome:
    """Outcome of a campaign: causes named, whether links are tried, and joints whose intervals hold."""

    named: tuple[str, ...]
    waits: bool
    covered: int = 0
    joints: int = 0


def _outcome(arm: SpringArm, read: Measurements) -> _Outcome:
    robot = robot_of(arm)
    settings = Settings.from_options(RunOptions(), robot)
    joints = JointsAlone(robot, read, settings)
    estimate, screening = joints.estimate, joints.screening
    named = [(cause.suspect.name, cause.suspect.first) for cause in screening.causes]
    if named:
        read = fit_causes(robot, read, named)
        estimate = JointsAlone(robot, read, settings).estimate
    truth = arm.compliances
    ends = [
        (joint.compliance_interval, truth[j])
        for j, joint in enumerate(estimate.joints)
        if joint.compliance_interval is not None
    ]
    covered = sum(low <= c <= high for (low, high), c in ends)
    return _Outcome(tuple(name for name, _ in named), screening.links_need_validation, covered, len(ends))


def run(*, quick: bool, part: Part) -> list[Section]:
    """Plant each cause, name it and fit it beside the joints; then read clean arms."""
    seeds, clean = part.of(4 if quick else 30), part.of(8 if quick else 200)
    rows, figures, right = [], [], 0
    for cause, plant in CAUSES.items():
        outcomes = [_planted(plant, seed) for seed in seeds]
        alone = sum(each.named == (cause,) for each in outcomes)
        tied = sum(cause in each.named for each in outcomes) - alone
        right += alone + tied
        others = Counter(", ".join(each.named) or "none" for each in outcomes if cause not in each.named)
        joints = sum(each.joints for each in outcomes)
        share = 100.0 * sum(each.covered for each in outcomes) / max(1, joints)
        instead = ", ".join(f"{name} {count}" for name, count in others.items())
        rows.append((cause, str(alone), str(tied), instead, f"{share:.1f} of {joints}"))
        what = f"{cause}: intervals that hold after the mend"
        figures.append(Figure(what, share, "at least", 93.0, " %"))
    named = 100.0 * right / (len(seeds) * len(CAUSES))
    silent = [_clean(seed) for seed in clean]
    accused, waiting = sum(bool(each.named) for each in silent), sum(each.waits for each in silent)
    figures += [
        Figure("planted causes named, or in a tie", named, "at least", 90.0, " %"),
        Figure.none(f"of {len(clean)} clean campaigns, causes named", accused),
        Figure.none(f"of {len(clean)} clean campaigns, waiting for a cross-validation", waiting),
    ]
    return [
        Section(
            title=f"{len(seeds)} campaigns with each cause planted; {len(clean)} clean ones",
            columns=("planted", "named alone", "in a tie", "named instead", "intervals that hold [%]"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=("half of the clean campaigns state a data sheet of the wrong shape",),
        )
    ]


def _planted(plant: Callable[[Design, Generator], Planted], seed: int) -> _Outcome:
    generator = np.random.default_rng([seed, _STREAM, 1])
    design = _design(seed)
    return _outcome(design.arm, _read(plant(design, generator), generator, sigma=seed % 2 == 0))


def _clean(seed: int) -> _Outcome:
    """Read a clean arm; every other campaign states a data sheet of the wrong shape."""
    generator = np.random.default_rng([seed, _STREAM, 2])
    design = _design(1000 + seed)
    read = _read(Planted(design.loaded, design), generator, sigma=True)
    if seed % 2:
        sheet = Instrument((4.0, 1.0, 1.5), 3e-6, 1e-6, 1e-5, 5e-6)
        noise = DifferenceNoise.from_instrument(sheet, robot_of(design.arm), read)
        read = replace(read, sigma=noise.sigma, covariance=noise.covariance)
    return _outcome(design.arm, read)
