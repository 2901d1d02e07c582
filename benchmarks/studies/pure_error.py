"""Noise of the readings whatever the model: what it accuses among clean campaigns, and what it sees.

Readings come from springs that balance the load exactly; mistakes are planted in loads, angles and places of
that simulator. Nothing is stated, so that sigma comes from the residuals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.designs import SIGMA, Design
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, deflections, plan_experiment
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.pure_error import PureError
from jointstiff.solver.fit.estimate import predict
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import CommonUncertainty
from jointstiff.solver.outcome.rules import measure_pure_error
from tests.support.springs import robot_of

__all__ = ["run"]

_STREAM = 97
_POINTS: FloatArray = np.array(list(TARGETS.values()))
Generator = np.random.Generator
Planted = tuple[FloatArray, Design]
"""Places (N, T, 3) of the targets under load [m], and the campaign as stated."""


def _clean(design: Design, _: Generator) -> Planted:
    return design.loaded, design


def _restate(design: Design, factor: FloatArray) -> Planted:
    """Return the campaign whose forces (N, 3) are stated as a multiple (N,) of what they were."""
    experiment = replace(design.experiment, forces=factor[:, None] * design.experiment.forces)
    return design.loaded, replace(design, experiment=experiment)


def _two_weights(design: Design, generator: Generator) -> Planted:
    """State one weight where half of the postures had another that is 15 % heavier."""
    heavier = generator.permutation(len(design.loaded)) < len(design.loaded) // 2
    return _restate(design, np.where(heavier, 1.0 / 1.15, 1.0))


def _swinging(design: Design, generator: Generator) -> Planted:
    """State forces of loads that swing by 5 % from posture to posture."""
    return _restate(design, 1.0 + 0.05 * generator.standard_normal(len(design.loaded)))


def _one_wrong(design: Design, generator: Generator) -> Planted:
    factor = np.ones(len(design.loaded))
    factor[generator.integers(len(factor))] = 1.2
    return _restate(design, factor)


def _play(design: Design, _: Generator) -> Planted:
    """Turn every joint by half of 0.1 mrad to the side that the load pushes it."""
    arm, experiment = design.arm, design.experiment
    bent = equilibrium(arm, experiment.joints, *experiment.wrenches)
    posture = arm.posture(experiment.joints + bent + 5e-5 * np.sign(bent))
    return posture.targets_to_base(_POINTS), design


def _repeats(design: Design, generator: Generator) -> Planted:
    joints = design.experiment.joints
    turned = joints + 2e-5 * generator.standard_normal(joints.shape)
    return deflections(design.arm, turned, *design.experiment.wrenches, _POINTS)[1], design


def _station(design: Design, generator: Generator) -> Planted:
    shift = 2e-5 * generator.standard_normal((len(design.loaded), 1, 3))
    return design.loaded + shift, design


MISTAKES: dict[str, Callable[[Design, Generator], Planted]] = {
    "two weights": _two_weights,
    "swinging loads": _swinging,
    "one load 20 % wrong": _one_wrong,
    "play of 0.1 mrad": _play,
    "repeatability 20 µrad": _repeats,
    "station's error of 20 µm": _station,
}


def _measure(
    plant: Callable[[Design, Generator], Planted], seed: int
) -> tuple[PureError | None, JointsAlone]:
    """Read a campaign of 12 to 30 postures; return its pure error and the identification."""
    generator = np.random.default_rng([seed, _STREAM])
    arm = default_arm()
    plan = plan_experiment(arm, configurations=int(generator.integers(12, 31)), load="pull", seed=seed)
    design = Design.by(arm, plan)
    loaded, stated = plant(design, generator)
    places = np.stack([stated.unloaded, loaded])
    read = stated.measurements(*(places + SIGMA * generator.standard_normal(places.shape)), sigma=None)
    read = replace(
        read, common_uncertainty=CommonUncertainty(load_point=0.01, assumed=frozenset({"load_point"}))
    )
    robot = robot_of(design.arm)
    joints = JointsAlone(Rows(robot, read), Settings.from_options(RunOptions(), robot))
    found = joints.estimate
    rows = joints.rows.at(found.balanced)
    prediction = predict(rows, found.compliance, statements=found.statements)
    return measure_pure_error(joints.rows, found, prediction), joints


def run(*, quick: bool) -> list[Section]:
    """Measure the pure error of clean campaigns and of those with mistakes."""
    clean = [_measure(_clean, seed)[0] for seed in range(6 if quick else 200)]
    sigmas = np.array([np.nan if each is None else each.sigma for each in clean])
    accused = sum(each is not None and each.shows_motion for each in clean)
    rows = [("clean", str(len(clean)), str(accused), "")]
    for name, plant in MISTAKES.items():
        found = [_measure(plant, seed) for seed in range(2 if quick else 24)]
        seen = sum(each is not None and each.shows_motion for each, _ in found)
        shared = sum(joints.shows_scatter for _, joints in found)
        rows.append((name, str(len(found)), str(seen), str(shared)))
    return [
        Section(
            title="Pure error: the tracker's noise, and what the model leaves beside it",
            columns=("campaign", "number", "more than noise", "shared errors found"),
            rows=tuple(rows),
            figures=(
                Figure("clean campaigns accused", 100.0 * accused / len(clean), "at most", 1.0, " %"),
                Figure("sigma found, median", 1e6 * float(np.nanmedian(sigmas)), "at least", 19.5, " µm"),
                Figure("sigma found, median", 1e6 * float(np.nanmedian(sigmas)), "at most", 20.5, " µm"),
            ),
            notes=("errors that a posture's targets share are fitted, so that they leave only noise",),
        )
    ]
