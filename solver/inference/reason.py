"""Reasons not to use an identification, or to use it with care, as data."""

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
    "masses_contradicted",
    "lack_of_fit",
    "sigma_implausible",
    "deflections_below_noise",
]

ActionKind = Literal[
    "leave_out_readings",
    "use_huber",
    "include_complementary_stiffness",
    "omit_noise",
    "exchange_columns",
    "apply_joint_map",
    "exchange_load_and_target",
    "correct_load_point",
    "correct_force",
    "convert_units",
    "exchange_readings",
    "choose_model",
    "show_posture",
]


@dataclass(frozen=True)
class Place:
    """Subject of a reason: one observation or one joint."""

    observation: int | None = None  #: index of the observation; None for a joint
    joint: str | None = None  #: name of the joint; None for an observation


@dataclass(frozen=True)
class Action:
    """Action that a program can offer as a button."""

    kind: ActionKind  #: kind of action
    observations: tuple[int, ...] = ()  #: indices of the observations to leave out, or to show
    joints: tuple[str, ...] = ()  #: names of the joints whose columns are exchanged
    #: rows of the corrected joint map's matrix M; empty for other kinds
    joint_map: tuple[tuple[float, ...], ...] = ()
    offset: tuple[float, ...] = ()  #: offset of the corrected joint map [rad]; empty for other kinds
    #: index of the target to be exchanged with the load point; None for other kinds
    target: int | None = None
    #: (3,) correction of every load point, flange frame [m], or to every force, axes of R0 [N]; empty for
    #: other kinds
    correction: tuple[float, ...] = ()
    #: unit of lengths, angles or forces that the numbers are in: `m`, `mm`, `deg`, `rad`, `N` or `kN`; None
    #: for other kinds
    unit: str | None = None


@dataclass(frozen=True)
class Reason:
    """One reason not to use the result, or to use it with care."""

    code: ReasonCode  #: kind of reason
    #: the best verdict that a result with this reason can have
    weight: Literal["use_with_care", "do_not_use"]
    where: Place | None  #: the observation or joint; None for the whole set
    message: str  #: fault, with figure and unit
    remedy: str  #: correction to make
    action: Action | None = None  #: correction that a program can make; None if it needs a person
