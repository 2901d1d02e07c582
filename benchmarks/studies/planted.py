"""Campaigns with mistakes planted for studies of causes: in loads, places, gears and single readings.

Readings come from springs that balance the load exactly; what is planted is done to loads, angles and places
of that simulator, never by the solver's own terms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from benchmarks.designs import SIGMA, Design
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, plan_experiment, torques
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements

__all__ = [
    "CAUSES",
    "POINTS",
    "STREAM",
    "Plant",
    "Planted",
    "design_campaign",
    "place_targets",
    "plant_bump",
    "plant_curved_springs",
    "read",
]

STREAM = 71
POINTS: FloatArray = np.array(list(TARGETS.values()))
_ROUNDS = 50
Generator = np.random.Generator


@dataclass(frozen=True, eq=False)
class Planted:
    """A campaign with mistakes planted: what is read, and the loads and places that are stated."""

    true: Design  #: what was carried out
    loaded: FloatArray  #: (N, T, 3) places of the targets under load [m]
    stated: Design  #: what is stated

    @classmethod
    def clean(cls, design: Design) -> Planted:
        """Return a campaign without a mistake."""
        return cls(design, design.loaded, design)

    def move(self, motion: FloatArray) -> Planted:
        """Return the campaign whose loaded targets are read elsewhere, by a motion (N, T, 3) [m]."""
        return replace(self, loaded=self.loaded + motion)

    def restate(self, **changes: FloatArray) -> Planted:
        """Return the campaign whose experiment is stated otherwise."""
        experiment = replace(self.stated.experiment, **changes)
        return replace(self, stated=replace(self.stated, experiment=experiment))


Plant: TypeAlias = Callable[[Planted, Generator], Planted]


def _draw_direction(generator: Generator) -> FloatArray:
    vector = generator.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def design_campaign(seed: int) -> Design:
    """Return 16 to 40 pulls on an arm whose joints are up to a third stiffer or softer than usual."""
    generator = np.random.default_rng([seed, STREAM])
    arm = default_arm()
    arm = replace(arm, stiffnesses=arm.stiffnesses * np.exp(0.3 * generator.uniform(-1.0, 1.0, 6)))
    force = float(generator.uniform(1000.0, 2000.0))
    count = int(generator.integers(16, 41))
    return Design.by(arm, plan_experiment(arm, configurations=count, load="pull", force=force, seed=seed))


def read(planted: Planted, generator: Generator, *, sigma: bool) -> Measurements:
    """Read a planted campaign with noise; sigma is stated or not, the load point is assumed to 10 mm."""
    places = np.stack([planted.stated.unloaded, planted.loaded])
    noisy = places + SIGMA * generator.standard_normal(places.shape)
    measured = planted.stated.measurements(*noisy, sigma=SIGMA if sigma else None)
    return replace(
        measured, common_uncertainty=CommonUncertainty(load_point=0.01, assumed=frozenset({"load_point"}))
    )


def _move_load_point(planted: Planted, generator: Generator) -> Planted:
    off = generator.uniform(0.05, 0.15) * _draw_direction(generator)
    return planted.restate(load_points=planted.stated.experiment.load_points + off)


def _forget_force(planted: Planted, generator: Generator) -> Planted:
    missing = generator.uniform(100.0, 300.0) * _draw_direction(generator)
    return planted.restate(forces=planted.stated.experiment.forces - missing)


def _offset_load_cell(planted: Planted, generator: Generator) -> Planted:
    zero = generator.uniform(100.0, 300.0) * _draw_direction(generator)
    turned = planted.true.arm.posture(planted.true.experiment.joints).flange_rotation @ zero
    return planted.restate(forces=planted.stated.experiment.forces - turned)


def _hang_heavier_loads(planted: Planted, generator: Generator) -> Planted:
    """Hang heavier loads than stated from the middle on."""
    count = len(planted.loaded)
    later = np.arange(count) >= generator.integers(count // 3, 2 * count // 3)
    factor = np.where(later, 1.0 / generator.uniform(1.06, 1.12), 1.0)[:, None]
    return planted.restate(forces=factor * planted.stated.experiment.forces)


def _since(count: int, generator: Generator) -> FloatArray:
    """Return ones from the first observation on, or from one in the middle."""
    first = 0 if generator.random() < 0.5 else int(generator.integers(count // 3, 2 * count // 3))
    return (np.arange(count) >= first).astype(np.float64)[:, None, None]


def _shift_tracker(planted: Planted, generator: Generator) -> Planted:
    moved = generator.uniform(5e-5, 1.5e-4) * _draw_direction(generator)
    return planted.move(_since(len(planted.loaded), generator) * moved)


def _turn_tracker(planted: Planted, generator: Generator) -> Planted:
    """Turn the tracker about where it stands."""
    station, turn = np.array([4.0, 1.0, 1.5]), generator.uniform(5e-5, 2e-4) * _draw_direction(generator)
    moved = np.cross(turn, planted.true.loaded - station)
    return planted.move(_since(len(planted.loaded), generator) * moved)


def place_targets(design: Design, angles: FloatArray) -> FloatArray:
    """Return the places (N, T, 3) of the targets at joint angles (N, n) [m]."""
    return design.arm.posture(angles).targets_to_base(POINTS)


def _turn_gears(planted: Planted, generator: Generator) -> Planted:
    """Turn every joint through half its play, to the side that the load pushes it."""
    arm, experiment = planted.true.arm, planted.true.experiment
    bent = equilibrium(arm, experiment.joints, *experiment.wrenches)
    play = generator.uniform(1e-4, 2e-4) * generator.choice([0.0, 1.0], 6, p=[0.3, 0.7])
    turned = place_targets(planted.true, experiment.joints + bent + np.sign(bent) * play)
    return planted.move(turned - planted.true.loaded)


CAUSES: dict[str, Plant] = {
    "load_point": _move_load_point,
    "constant_force": _forget_force,
    "load_zero": _offset_load_cell,
    "load_scale": _hang_heavier_loads,
    "shift": _shift_tracker,
    "turn": _turn_tracker,
    "play": _turn_gears,
}


def plant_curved_springs(planted: Planted, generator: Generator) -> Planted:
    """Make the springs harden: by a cubic law, or in the three stages of a strain wave gear.

    The stiffness at small torques is that of the arm. At the largest torque of a joint the cubic law is 8
    to 35 % stiffer; the stages are 1, 1.35 and 1.75 times as stiff, as in makers' catalogues.
    """
    arm, experiment = planted.true.arm, planted.true.experiment
    largest = np.abs(torques(arm, experiment.joints, *experiment.wrenches)).max(axis=0)
    hardening = generator.uniform(0.1, 0.6) if generator.random() < 0.5 else None
    angle = np.zeros_like(experiment.joints)
    for _ in range(_ROUNDS):
        torque = torques(arm, experiment.joints + angle, *experiment.wrenches)
        x = np.abs(torque) / largest
        if hardening is None:
            stages = np.minimum(x, 0.15) + np.clip(x - 0.15, 0.0, 0.35) / 1.35
            wound = stages + np.maximum(x - 0.5, 0.0) / 1.75
        else:
            wound = _solve_cubic(x, hardening)
        angle = arm.compliances * largest * np.sign(torque) * wound
    return planted.move(place_targets(planted.true, experiment.joints + angle) - planted.true.loaded)


def _solve_cubic(torque: FloatArray, hardening: float) -> FloatArray:
    """Return the winding y ≥ 0 of ``y (1 + h y²) = x`` for torques x, relative to the linear spring's."""
    y = torque / (1.0 + hardening * torque**2)
    for _ in range(_ROUNDS):
        y = y - (y + hardening * y**3 - torque) / (1.0 + 3.0 * hardening * y**2)
    return np.asarray(y)


def plant_bump(planted: Planted, generator: Generator) -> Planted:
    """Bump the tracker in one posture: its targets are read 0.3 to 0.8 mm away."""
    moved = np.zeros_like(planted.loaded)
    row = int(generator.integers(len(moved)))
    moved[row] = generator.uniform(3e-4, 8e-4) * _draw_direction(generator)
    return planted.move(moved)
