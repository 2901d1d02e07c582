"""Joints that a campaign cannot see: the arm's prior takes the place of their stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from jointstiff.service.runs.verdicts import PriorModel, RunModel
from jointstiff.solver.errors import RobotError
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.process.prior import assume_unseen_joints


def assume_unseen(run_model: RunModel | PriorModel) -> tuple[RunModel | PriorModel, tuple[str, ...]]:
    """Return the model with priors for the joints that its readings do not determine, and their names.

    Without a payload, and for models with links, the model stays as it is.
    """
    model = run_model.model
    if isinstance(run_model, PriorModel) or not isinstance(model, JointModel):
        return run_model, ()
    try:
        filled, names = assume_unseen_joints(model)
    except RobotError:  # the arm has no prior: a load of such a joint is refused, as in a prediction
        return run_model, ()
    return (replace(run_model, model=filled), names) if names else (run_model, ())


def advise_load(names: Sequence[str]) -> str:
    """Return the remedy for joints of unknown stiffness: the load that shows them."""
    return (
        f"measure a few postures with a horizontal load across the arm, at a lever of 0.2 m from the last "
        f"axis: this load twists {' and '.join(names)}"
    )
