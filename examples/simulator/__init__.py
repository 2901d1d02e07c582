"""An independent simulator of elastic arms, and the small campaigns made with it.

`jointstiff.simulator.arm` is the physics: torsion springs in the joints that balance a load exactly.
`jointstiff.simulator.campaign` turns it into campaign documents as the service takes them.

Nothing here imports the numerical core, the messages or the service, nor pinocchio: what the tests
call truth must not come from the code under test. Only numpy is used.
"""

from __future__ import annotations

from jointstiff.simulator.campaign import (
    LOAD_POINT,
    SI_UNITS,
    TARGETS,
    Document,
    Encoders,
    EquilibriumError,
    Experiment,
    Load,
    Readings,
    SpringArm,
    Targets,
    default_arm,
    default_targets,
    deflections,
    equilibrium,
    experiment_of,
    linear_deflections,
    plan_experiment,
    random_configurations,
    robot_document,
    simulate_campaign,
    simulate_positions,
    torques,
    truth,
)

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
