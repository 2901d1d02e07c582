"""Simulated campaigns of a tracker with encoders behind gearboxes that have play.

Readings come from springs that balance the load exactly. Play turns the links, which tracker and encoders
both see; errors of the encoders are seen by the encoders alone. Both are far beyond what is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from jointstiff.simulator import SpringArm
from jointstiff.simulator.campaign import TARGETS, Experiment
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.measurements import EncoderReadings, Measurements

_STREAM: Final = 93
SIGMA: Final = 2e-5
"""Standard uncertainty of one coordinate of one reading [m]."""
READ: Final = (0, 1, 2)
"""Joints with an encoder behind the gearbox."""
STATED: Final = 5e-6
"""Stated standard uncertainty of an angle [rad], which is that of its noise."""
_POINTS: FloatArray = np.array(list(TARGETS.values()))


class Design(Protocol):
    """Arm of springs with postures and pulls, such as a `SpringCampaign`."""

    @property
    def arm(self) -> SpringArm: ...

    @property
    def experiment(self) -> Experiment: ...

    def measurements(
        self, unloaded: FloatArray, loaded: FloatArray, *, sigma: float | None
    ) -> Measurements: ...


@dataclass(frozen=True)
class Errors:
    """Errors that the campaign does not state."""

    play: float = 0.0  #: lost motion of each gearbox [rad]: the angle is off by half of it to either side
    encoder: float = 0.0  #: standard deviation of an error of each encoder's angle [rad]
    structure: float = 0.0  #: part of each compliance that is behind the encoder


@dataclass(frozen=True, eq=False)
class EncoderCampaign:
    """Campaign with what is true."""

    arm: SpringArm
    measurements: Measurements


def simulate(design: Design, errors: Errors, seed: int) -> EncoderCampaign:
    """Return a campaign of 12 to 19 postures, three targets, and encoders behind three gearboxes.

    Args:
        design: 19 postures and pulls.
        errors: errors that the campaign does not state.
        seed: of the noise and the errors.
    """
    generator = np.random.default_rng([seed, _STREAM])
    arm, plan = design.arm, design.experiment
    sides = generator.choice([-1.0, 1.0], (2, *plan.joints.shape))
    unloaded, from_side = plan.joints + 0.5 * errors.play * sides
    bent = equilibrium(arm, from_side, *plan.wrenches)
    loaded = from_side + bent
    shape = (len(plan.joints), *_POINTS.shape)
    positions = [
        arm.posture(links).targets_to_base(_POINTS) + SIGMA * generator.standard_normal(shape)
        for links in (unloaded, loaded)
    ]
    noise = np.sqrt(2.0) * np.hypot(STATED, errors.encoder) * generator.standard_normal(plan.joints.shape)
    twist = loaded - unloaded - errors.structure * bent + noise
    present = np.zeros(twist.shape, np.bool_)
    present[:, READ] = True
    encoders = EncoderReadings(np.where(present, twist, 0.0), present, STATED)
    kept = np.sort(generator.permutation(len(twist))[: int(generator.integers(12, 20))])
    measurements = design.measurements(positions[0], positions[1], sigma=SIGMA)
    return EncoderCampaign(arm, replace(measurements, encoders=encoders)[kept])
