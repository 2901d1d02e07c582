"""Reasons not to use an identification as it stands, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Usability = Literal["use", "use_with_care", "do_not_use"]

ReasonCode = Literal[
    "no_joint_identified",
    "no_residual_freedom",
    "few_postures",
    "gross_error",
    "suspicious_readings",
    "length_unit_suspect",
    "residuals_exceed_sigma",
    "residuals_vanish",
    "deflection_unexplained",
    "alternative_explains_better",
    "load_at_target",
    "stiffness_implausible",
    "prior_dominates",
    "complementary_stiffness_matters",
    "links_bend_with_joints",
]

ActionKind = Literal[
    "leave_out_readings",
    "use_huber",
    "include_complementary_stiffness",
    "omit_noise",
    "exchange_columns",
    "apply_joint_map",
    "exchange_load_and_target",
    "show_posture",
]


@dataclass(frozen=True)
class Place:
    """Subject of a reason: one observation or one joint.

    Attributes:
        observation: its index; None for a joint.
        joint: its name; None for an observation.
    """

    observation: int | None = None
    joint: str | None = None


@dataclass(frozen=True)
class Action:
    """Action that a program can offer as a button.

    Attributes:
        kind: which action.
        observations: indices of the observations to leave out, or to show.
        joints: names of the joints whose columns are exchanged.
        joint_map: rows of the corrected joint map's matrix M; empty for other kinds.
        offset: of the corrected joint map [rad]; empty for other kinds.
        target: index of the target to be exchanged with the load point; None for other kinds.
    """

    kind: ActionKind
    observations: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()
    joint_map: tuple[tuple[float, ...], ...] = ()
    offset: tuple[float, ...] = ()
    target: int | None = None


@dataclass(frozen=True)
class Reason:
    """One reason not to use the numbers without further ado.

    Attributes:
        code: its kind.
        weight: the best verdict that a result with this reason can have.
        where: the observation or joint; None for the whole set.
        message: what is wrong, with figure and unit.
        remedy: what to do about it.
        action: what a program can do about it; None where only people can.
    """

    code: ReasonCode
    weight: Literal["use_with_care", "do_not_use"]
    where: Place | None
    message: str
    remedy: str
    action: Action | None = None
