"""Example campaigns: what a laser tracker reads on an arm whose springs balance the load exactly.

    document = simulate_campaign(default_arm(), configurations=19, load="dead_weight")
    experiment = experiment_of(document)    # the same, as arrays in SI units
    truth(default_arm(), document)          # what an identification ought to find

Arguments are in SI units (m, rad, N, N·m), whatever the units of the document.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import Encoders, SpringArm, default_arm
from jointstiff.simulator.document import Document, Readings, experiment_of, measurement_set, robot_document
from jointstiff.simulator.equilibrium import (
    EquilibriumError,
    deflections,
    equilibrium,
    linear_deflections,
    torques,
)
from jointstiff.simulator.experiment import (
    LOAD_POINT,
    TARGETS,
    Experiment,
    Load,
    Targets,
    default_targets,
    plan_experiment,
    random_configurations,
    simulate_positions,
)
from jointstiff.simulator.units import DEFAULT_MOMENT, SI_UNITS

__all__ = [
    "LOAD_POINT",
    "SI_UNITS",
    "TARGETS",
    "Document",
    "Encoders",
    "EquilibriumError",
    "Experiment",
    "Load",
    "Readings",
    "SpringArm",
    "Targets",
    "default_arm",
    "default_targets",
    "deflections",
    "equilibrium",
    "experiment_of",
    "linear_deflections",
    "plan_experiment",
    "random_configurations",
    "robot_document",
    "simulate_campaign",
    "simulate_positions",
    "torques",
    "truth",
]

UNTWISTED = 1e-9  # largest torque of a joint, beside the largest of all joints, that counts as none


def simulate_campaign(
    arm: SpringArm,
    *,
    configurations: int = 19,
    targets: Targets = TARGETS,
    load: Load = "dead_weight",
    force: float = 1500.0,
    moment: float = 0.0,
    load_point: ArrayLike = LOAD_POINT,
    sigma: float = 2e-5,
    noise: bool = True,
    readings: Readings = "positions",
    units: Mapping[str, str] = SI_UNITS,
    encoders: Encoders = "motor",
    method: str = "partial_pose",
    seed: int = 0,
    noise_seed: int | None = None,
) -> Document:
    """Simulate a campaign and write it down as the service takes it.

    The same arguments always give the same document. Configurations, directions and noise have
    separate random streams: a seed keeps the configurations when the load or the noise changes.

    Args:
        arm: The arm.
        configurations: How many configurations, N.
        targets: Targets in the flange frame [m] by name, at least one.
        load: A dead weight pulls along −z of R0, a pull in a random direction for each
            configuration.
        force: Size of the force [N].
        moment: Size of the moment about the load point [N·m]; its direction is random in either
            case.
        load_point: Where the force acts, in the flange frame [m]: (3,), or (N, 3) one by one; then
            each observation states its own.
        sigma: Standard deviation of each coordinate of each position read [m]; 0 for exact
            readings.
        noise: Whether the set states sigma. It never states 0.
        readings: Two positions per target, or their difference with the targets in the flange
            frame.
        units: Units of the document. Where the load has a moment, its unit is N.m if none is named.
        encoders: Which encoders the set says close the loop. It changes no physics: the arm's
            stiffnesses do.
        method: Method the run asks for.
        seed: Seed of all random numbers.
        noise_seed: Seed of the noise alone, for another campaign in the same configurations; None for `seed`.

    Returns:
        The document, {"robot", "measurement_set", "run"}.

    Raises:
        ValueError: An argument makes no sense.
        EquilibriumError: The load is too large for the arm.
    """
    _check_words(load=(load, Load), readings=(readings, Readings), encoders=(encoders, Encoders))
    _check_sizes(force=force, moment=moment, sigma=sigma)
    _check_counts(configurations=configurations, targets=len(targets))
    experiment = plan_experiment(
        arm,
        configurations=configurations,
        load=load,
        force=force,
        moment=moment,
        load_point=load_point,
        seed=seed,
    )
    unloaded, loaded = simulate_positions(
        arm, experiment, targets, sigma=sigma, seed=seed if noise_seed is None else noise_seed
    )
    document = measurement_set(
        experiment,
        targets,
        unloaded,
        loaded,
        name=f"{load.replace('_', ' ')}, {configurations} configurations, {encoders} encoders",
        units={"moment": DEFAULT_MOMENT, **units} if moment else units,
        encoders=encoders,
        readings=readings,
        sigma=sigma if noise and sigma > 0.0 else None,
    )
    return {
        "robot": robot_document(arm),
        "measurement_set": document,
        "run": {"method": method},
    }


def truth(arm: SpringArm, document: Document) -> Document:
    """Return the true values that an identification from this campaign should find.

    Args:
        arm: The arm that was simulated.
        document: Its campaign.

    Returns:
        "joints", their names; "stiffness" [N·m/rad], null for a rigid joint; "compliance"
        [rad/(N·m)]; and "not_observable", the joints that no load of the campaign twists, such as a
        vertical axis 1 under a dead weight.
    """
    experiment = experiment_of(document)
    torque = np.abs(torques(arm, experiment.joints, *experiment.wrenches)).max(axis=0)
    untwisted = torque <= UNTWISTED * torque.max()
    return {
        "joints": list(arm.joint_names),
        "stiffness": [float(k) if np.isfinite(k) else None for k in arm.stiffnesses],
        "compliance": arm.compliances.tolist(),
        "not_observable": [name for name, none in zip(arm.joint_names, untwisted, strict=True) if none],
    }


def _check_words(**choices: tuple[str, Any]) -> None:
    for name, (word, literal) in choices.items():
        if word not in get_args(literal):
            msg = f"{name} is {word!r}; expected one of {', '.join(get_args(literal))}"
            raise ValueError(msg)


def _check_sizes(**sizes: float) -> None:
    for name, size in sizes.items():
        if not (np.isfinite(size) and size >= 0.0):
            msg = f"{name} is {size}; expected a finite number, not negative"
            raise ValueError(msg)


def _check_counts(**counts: int) -> None:
    for name, count in counts.items():
        if count < 1:
            msg = f"{count} {name}; expected at least one"
            raise ValueError(msg)
