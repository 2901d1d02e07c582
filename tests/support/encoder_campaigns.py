"""Simulated campaigns of a tracker with encoders behind gearboxes that have play.

Readings come from springs that balance the load exactly. Play turns the links, which tracker and encoders
both see; errors of the encoders are seen by the encoders alone. Both are far beyond what is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import SpringArm, default_arm
from jointstiff.simulator.campaign import TARGETS, Experiment
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.comparison.campaigns import (
    Comparison,
    FreeEstimate,
    SharedErrors,
    Side,
    compare_sides,
)
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import CommonUncertainty, EncoderReadings, Measurements

from .springs import robot_of

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
    repeatability: float = 0.0  #: standard deviation of a turn of each joint between both readings [rad]
    encoder: float = 0.0  #: standard deviation of an error of each encoder's angle [rad]
    structure: float = 0.0  #: part of each compliance that is behind the encoder


@dataclass(frozen=True, eq=False)
class EncoderCampaign:
    """Campaign with what is true."""

    arm: SpringArm
    measurements: Measurements


@dataclass(frozen=True, eq=False)
class EncoderPair:
    """Campaigns of the same postures and pulls by both position loops, with what is true."""

    motor: Measurements  #: with readings of encoders behind three gearboxes
    secondary: Measurements  #: while these encoders close the position loop
    gearboxes: FloatArray  #: (3,) compliances in front of the encoders [rad/(N·m)]
    structure: FloatArray  #: (3,) compliances behind them [rad/(N·m)]


MOTOR: Final = default_arm("motor")
SECONDARY: Final = default_arm("secondary")


def simulate_pair(
    design: Design, common: CommonUncertainty, seed: int, shared: SharedErrors, *, play: float = 20e-6
) -> EncoderPair:
    """Return campaigns whose loads err as stated.

    Args:
        design: postures and pulls.
        common: uncertainties of loads.
        seed: of the noise and the errors.
        shared: errors that are the same in both campaigns.
        play: lost motion of each gearbox [rad].
    """
    generator = np.random.default_rng([seed, _STREAM, 2])
    scales = common.scale * generator.standard_normal(2)
    places = common.load_point * generator.standard_normal((2, 3))
    if shared.cell:
        scales[1] = scales[0]
    if shared.load:
        places[1] = places[0]
    read = list(READ)
    measured = []
    for arm, scale, place in zip((MOTOR, SECONDARY), scales, places, strict=True):
        plan = design.experiment
        force, moment, point = (np.asarray(each) for each in plan.wrenches)
        sides = generator.choice([-1.0, 1.0], (2, *plan.joints.shape))
        unloaded, from_side = plan.joints + 0.5 * play * sides
        bent = equilibrium(arm, from_side, (1.0 + scale) * force, (1.0 + scale) * moment, point + place)
        loaded = from_side + bent
        shape = (len(plan.joints), *_POINTS.shape)
        positions = [
            arm.posture(links).targets_to_base(_POINTS) + SIGMA * generator.standard_normal(shape)
            for links in (unloaded, loaded)
        ]
        campaign = replace(design.measurements(*positions, sigma=SIGMA), common_uncertainty=common)
        if arm is MOTOR:
            of_gearboxes = bent * (1.0 - SECONDARY.compliances / MOTOR.compliances)
            noise = np.sqrt(2.0) * STATED * generator.standard_normal(bent.shape)
            twist = from_side - unloaded + of_gearboxes + noise
            present = np.zeros(twist.shape, np.bool_)
            present[:, READ] = True
            encoders = EncoderReadings(np.where(present, twist, 0.0), present, STATED)
            campaign = replace(campaign, encoders=encoders)
        else:
            campaign = replace(campaign, closed_on_links=True)
        measured.append(campaign)
    gearboxes = (MOTOR.compliances - SECONDARY.compliances)[read]
    return EncoderPair(measured[0], measured[1], gearboxes, SECONDARY.compliances[read])


def compare_pair(pair: EncoderPair, shared: SharedErrors) -> Comparison:
    """Identify both campaigns of a pair, and compare them."""
    robot = robot_of(MOTOR)
    settings = Settings.from_options(RunOptions(), robot)
    sides = []
    for measurements in (pair.motor, pair.secondary):
        estimate = JointsAlone(Rows(robot, measurements), settings).estimate
        common = estimate.common
        assert common is not None
        assert estimate.covariance is not None
        is_assumed = "force_scale" in measurements.common_uncertainty.assumed
        responses = common.responses_to("assumed_force_scale" if is_assumed else "force_scale")
        free = FreeEstimate(
            compliance=estimate.compliance,
            covariance=estimate.covariance,
            readings=estimate.covariance,
            force_scale=responses @ responses.T,
            load_point=common.responses_to("load_point"),
            sigma=estimate.sigma,
            degrees_of_freedom=np.inf,
            reasons=[None] * robot.n,
            unseen=estimate.observability.null,
        )
        sides.append(Side(robot, measurements, estimate.compliance, settings.constraints, True, free))
    return compare_sides(*sides, confidence=0.95, shared=shared)


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
    turns = np.random.default_rng([seed, _STREAM, 3]).standard_normal(plan.joints.shape)
    from_side = from_side + errors.repeatability * turns
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
