"""A documented arm of the paper's kind, wrong in stated ways, and what a tracker reads on it.

The arm is `simulator.campaign.default_arm`: 240 kg class, stiffness like the paper's Table II, encoders on
the motors alone (inactive, as the paper calls the second ones) or behind the gears, too (active). 19
configurations, 1500 N of dead weight. What is identified is always the nominal arm: that is what a user has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import LOAD_POINT, TARGETS, Encoders, deflections, plan_experiment
from jointstiff.simulator.imperfections import (
    angles_with_elastic_links,
    misplaced,
    with_elastic_links,
    with_link_errors,
)
from jointstiff.solver.readings.measurements import Measurements

__all__ = ["SOURCES", "STATED", "Imperfections", "avoided", "read"]


CONFIGURATIONS, FORCE = 19, 1500.0
TRANSVERSE = (12e6, 12e6, 10e6, 3e6, 3e6, 3e6)
"""Stiffness of link and bearing across each axis [N·m/rad], of axes 1 to 3 some four times their joints'."""
_STREAM = 22


@dataclass(frozen=True)
class Imperfections:
    """By how much the arm differs from its model. Zero: not at all.

    Attributes:
        sigma: standard deviation of each coordinate of each reading [m].
        plate: how far the plate with targets and load sits off its place on the flange [m].
        plate_angle: how far it is turned [rad].
        link: error of each link's vector [m].
        link_angle: tilt of each axis [rad].
        flexibility: of links and bearings, in units of 1 / `TRANSVERSE`.
    """

    sigma: float = 0.0
    plate: float = 0.0
    plate_angle: float = 0.0
    link: float = 0.0
    link_angle: float = 0.0
    flexibility: float = 0.0

    def __str__(self) -> str:
        return (
            f"{1e6 * self.sigma:g} µm; plate {1e3 * self.plate:g} mm, {1e3 * self.plate_angle:g} mrad; links "
            f"{1e3 * self.link:g} mm, {1e3 * self.link_angle:g} mrad; flexibility {self.flexibility:g}"
        )


STATED = Imperfections(sigma=2e-5, plate=2e-3, plate_angle=5e-3, link=1e-3, link_angle=1e-3, flexibility=1.0)
"""A good tracker; a plate and links as they are before anything is calibrated; links that are not rigid."""
_NOISE = Imperfections(sigma=STATED.sigma)
SOURCES: dict[str, Imperfections] = {
    "noise": _NOISE,
    "noise × 5": replace(_NOISE, sigma=5 * STATED.sigma),
    "noise + plate": replace(_NOISE, plate=STATED.plate, plate_angle=STATED.plate_angle),
    "noise + plate × 10": replace(_NOISE, plate=10 * STATED.plate, plate_angle=10 * STATED.plate_angle),
    "noise + links": replace(_NOISE, link=STATED.link, link_angle=STATED.link_angle),
    "noise + links × 10": replace(_NOISE, link=10 * STATED.link, link_angle=10 * STATED.link_angle),
    "noise + elastic links": replace(_NOISE, flexibility=1.0),
    "noise + elastic links × 3": replace(_NOISE, flexibility=3.0),
    "all as stated": STATED,
    "all, noise × 5": replace(STATED, sigma=5 * STATED.sigma),
}
"""Sources of error one by one, each on top of the noise, and together."""


def read(encoders: Encoders, wrong: Imperfections, *, seed: int) -> Measurements:
    """Read the true arm, with the nominal positions of load and targets, which are all one knows.

    Targets are given by their places on the flange and by their deflections, so that a plate that sits
    awry is not found out from the positions.

    Args:
        encoders: which close the position loop.
        wrong: how the arm differs from its model.
        seed: of configurations, directions of the errors, and noise.
    """
    nominal = default_arm(encoders)
    plan = plan_experiment(nominal, configurations=CONFIGURATIONS, force=FORCE, seed=seed)
    arm, joints = with_link_errors(nominal, length=wrong.link, angle=wrong.link_angle, seed=seed), plan.joints
    if wrong.flexibility:
        arm = with_elastic_links(arm, np.array(TRANSVERSE) / wrong.flexibility)
        joints = angles_with_elastic_links(joints)
    points = np.array([*TARGETS.values(), LOAD_POINT])
    true = misplaced(points, length=wrong.plate, angle=wrong.plate_angle, seed=seed)
    unloaded, loaded = deflections(arm, joints, plan.forces, plan.moments, true[-1], true[:-1])
    noise = np.random.default_rng([seed, _STREAM]).standard_normal((2, *loaded.shape))
    present = np.ones(loaded.shape[:2], dtype=np.bool_)
    return Measurements(
        joints=plan.joints,
        force=plan.forces,
        moment=plan.moments,
        load_point=np.array(plan.load_points),
        position=np.array(np.broadcast_to(points[:-1], loaded.shape)),
        in_flange=present,
        deflection=loaded - unloaded + wrong.sigma * (noise[1] - noise[0]),
        present=present,
        sigma=wrong.sigma or None,
    )


def avoided(wrong: Imperfections, *, seed: int) -> float:
    """Share of the mean deflection that active encoders avoid."""
    mean = {
        encoders: np.linalg.norm(read(encoders, wrong, seed=seed).deflection, axis=-1).mean()
        for encoders in ("motor", "secondary")
    }
    return float(1.0 - mean["secondary"] / mean["motor"])
