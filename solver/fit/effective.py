"""Effective compliances of joints where links or base bend, with their ranges (method.md §7).

A rotation of joint j and a rotation of the link behind this joint about the same axis move every target
alike, so that readings determine at most the sum ``c_j + a_jᵀ C_j,rot a_j``, with a_j the axis in the joint's
frame: the effective compliance. The interval of an effective compliance is its range over all compliances of
the cone whose penalised sum of squares exceeds the least sum by no more than ``(q σ)²``, q the quantile.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

import numpy as np

from jointstiff.schemas.joints import IDENTIFIED, JOINT_UNITS, JointKind
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import find_diagonal_entries
from jointstiff.solver.fit.conic import (
    compute_penalised_range,
    compute_unconstrained_range,
)
from jointstiff.solver.fit.elastic import ElasticFit
from jointstiff.solver.fit.estimate import Estimate, JointCompliance
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.mechanics.block import spring_frames
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import BASE, triangle_indices, triangle_weights
from jointstiff.solver.models import Columns

_LIGHTER: Final = 0.12
"""Penalty for intervals relative to the penalty that predicts best. With the latter, bias is as large as
dispersion; with a lighter penalty dispersion outweighs bias (undersmoothing). Values need no lighter one."""
_NOTHING: Final = 1e-4
"""Lower end of an interval, relative to its upper end, below which the lower end counts as zero: cone
programs do not reach zero exactly."""
_GAP: Final = 1e-4
"""Duality gap of the optimum around which intervals are computed, relative to the readings."""


def build_effective_rows(robot: Robot, columns: Columns) -> FloatArray:
    """Return the matrix (n, P) that maps all compliances (P,) to the joints' effective compliances (n,).

    An effective compliance [rad/(N·m)] is the joint's compliance plus the compliance of its link about (for a
    prismatic joint: along) the joint's axis; for joint 1 also that of the base. Link and base move every
    target like the joint, so that readings cannot separate the three.
    """
    rows = np.zeros((columns.n, columns.width))
    joints = np.arange(columns.n)
    # A model has the joint's compliance as a number of its own, or on the diagonal of the coupled compliance.
    diagonal_of_coupling = columns.coupling[find_diagonal_entries(columns.n)]
    rows[joints, columns.joints] = 1.0
    rows[joints, diagonal_of_coupling] = 1.0
    for joint in columns.links:  # the link has the index of the joint before it
        rows[joint, columns.link_columns(joint)] = _project_on_axis(robot, joint, robot.axes[joint])
    # The base is a link before joint 1, in the axes of R0.
    only_posture, first_joint = 0, 0
    rotations, _ = spring_frames(Postures(robot, np.zeros((1, columns.n))))  # (1, n, 3, 3) joint to R0
    axis_in_base = rotations[only_posture, first_joint] @ robot.axes[first_joint]
    rows[first_joint, columns.link_columns(BASE)] = _project_on_axis(robot, first_joint, axis_in_base)
    return rows


def _project_on_axis(robot: Robot, joint: int, axis: FloatArray) -> FloatArray:
    """Return the weights (21,) of the entries of a compliance C in ``sᵀ C s``, with s a joint's unit motion.

    s has three translations, then three rotations. C is a symmetric 6 × 6 matrix, given by its upper
    triangle.

    Args:
        robot: n joints.
        joint: index of the joint, which turns about its axis or, if it is prismatic, slides along its axis.
        axis: (3,) unit vector along the joint's axis, in the axes of C.
    """
    slides = robot.prismatic[joint]
    translation = axis if slides else np.zeros(3)
    rotation = np.zeros(3) if slides else axis
    s = np.concatenate([translation, rotation])
    i, j = triangle_indices(6)
    return np.asarray(s[i] * s[j] * triangle_weights(6))  # entries off the diagonal count twice


@dataclass(frozen=True, eq=False)
class EffectiveCompliances:
    """Effective compliances of the n joints with their ranges; NaN where a number is not known."""

    #: (n,) compliance of each joint plus that of its link about, or along, the joint's axis [rad/(N·m)]
    compliance: FloatArray
    own: FloatArray  #: (n,) compliance of each joint without its link [rad/(N·m)]
    range: FloatArray  #: (n, 2) least and greatest values [rad/(N·m)]
    quantile: float  #: half-width of a range divided by the standard uncertainty
    #: False if the ranges must not be published as intervals, because the penalty was given
    ranges_are_published: bool = True

    @property
    def ends(self) -> FloatArray:
        """Ends (n, 2) of the published intervals [rad/(N·m)]; NaN if no intervals are published."""
        return self.range if self.ranges_are_published else np.full_like(self.range, np.nan)

    @property
    def uncertainty(self) -> FloatArray:
        """Standard uncertainties (n,) [rad/(N·m)]: half of a range divided by the quantile."""
        return 0.5 * (self.range[:, 1] - self.range[:, 0]) / self.quantile

    def widen_ranges_by(self, other: EffectiveCompliances) -> EffectiveCompliances:
        """Return these compliances with ranges widened to contain the ranges of another model.

        Each range still contains the compliance of this model. `fmin` and `fmax` ignore numbers that are not
        known (NaN).
        """
        lower = np.fmin(self.range[:, 0], other.range[:, 0])
        upper = np.fmax(self.range[:, 1], other.range[:, 1])
        # A range that comes only from the other model need not contain this model's value: widen the range.
        value = np.where(np.isnan(lower), np.nan, self.compliance)
        lower = np.fmin(lower, value)
        upper = np.fmax(upper, value)
        widened = np.column_stack([lower, upper])
        return replace(self, range=widened, quantile=min(self.quantile, other.quantile))


def compute_effective_compliances(
    robot: Robot,
    elastic: ElasticFit,
    confidence: float,
    fit_for_ranges: ElasticFit | None = None,
    *,
    publishes_ranges: bool = True,
) -> EffectiveCompliances:
    """Compute the joints' effective compliances and their confidence ranges.

    The compliance is that of the fit that predicts. Its range contains the values at which the objective,
    with a lighter penalty, is close to its minimum, and the compliance itself. For the model of joints and
    base, a range also contains the range of ordinary least squares, which has no bias from penalty or
    constraints.

    Args:
        robot: n joints.
        elastic: estimate of the chosen model, which predicts.
        confidence: confidence level of the ranges.
        fit_for_ranges: estimate of the richest model compared, from which the ranges are computed; None takes
            `elastic`.
        publishes_ranges: whether the ranges may be published as intervals: only if cross-validation chose the
            penalty.
    """
    fit_for_ranges = fit_for_ranges or elastic
    columns = elastic.candidate.columns
    to_effective = build_effective_rows(robot, columns)
    effective = to_effective @ elastic.entries
    quantile = fit_for_ranges.likelihood.scale.quantile(0.5 * (1.0 + confidence))
    ranges = _Ranges.unknown(len(effective))
    with suppress(SolverError):  # Without a certified optimum the ranges remain unknown.
        ranges = _find_ranges(fit_for_ranges, to_effective, quantile) or ranges
    # An error of all loads' size changes all compliances in proportion, and no reading shows it.
    scale_error = quantile * fit_for_ranges.force_scale * effective
    return EffectiveCompliances(
        compliance=np.where(np.isnan(elastic.compliance), np.nan, effective),
        own=elastic.entries[columns.joints],
        range=ranges.widen_around(effective, scale_error),
        quantile=quantile,
        ranges_are_published=publishes_ranges,
    )


class _Ranges(NamedTuple):
    """Ranges of the joints' effective compliances around the optimum with a lighter penalty [rad/(N·m)]."""

    lower: FloatArray  # (n,) NaN where unknown
    upper: FloatArray  # (n,) NaN where unknown

    @classmethod
    def unknown(cls, count: int) -> _Ranges:
        """Return unknown ranges of a number of effective compliances."""
        not_known = np.full(count, np.nan)
        return cls(not_known, not_known)

    def widen_around(self, effective: FloatArray, further_error: FloatArray) -> FloatArray:
        """Return ranges (n, 2) that contain the estimates, widened by a further independent error.

        The programs find the ends to a tolerance only, so that an end may lie on the wrong side of the
        estimate. No compliance is negative.

        Args:
            effective: (n,) estimates [rad/(N·m)].
            further_error: (n,) expanded uncertainty, added in squares [rad/(N·m)].
        """
        below = effective - np.minimum(np.maximum(self.lower, 0.0), effective)
        above = np.maximum(self.upper, effective) - effective
        lower = np.maximum(effective - np.hypot(below, further_error), 0.0)
        upper = effective + np.hypot(above, further_error)
        lower[lower < _NOTHING * upper] = 0.0
        return np.column_stack([lower, upper])


def _find_ranges(estimate: ElasticFit, to_effective: FloatArray, quantile: float) -> _Ranges | None:
    """Find the ranges in which the objective exceeds its minimum by (quantile · sigma)² at most.

    The penalty is lighter than that of the estimate. None if sigma is unknown.

    Args:
        estimate: fit with the rows, the penalty and sigma.
        to_effective: (n, P) matrix from all compliances to effective compliances.
        quantile: half-width of a range in standard uncertainties.

    Raises:
        SolverError: no certified optimum.
    """
    likelihood = estimate.likelihood
    sigma = likelihood.scale.sigma
    if sigma is None:
        return None
    reduced = likelihood.reduced
    program = reduced.build_problem(_LIGHTER * likelihood.weight)
    optimum = solve(program, gap=_GAP).x
    functions = to_effective[:, reduced.columns] * reduced.unit  # of the program's parameters x
    root_of_increase = quantile * sigma / reduced.reading_norm
    lower, upper = compute_penalised_range(program, optimum, root_of_increase**2, functions).T
    if estimate.model.name == "joints_and_base":
        # Where other compliances are zero, ranges in the cone alone hold the truth too seldom (method.md §6).
        least, greatest = compute_unconstrained_range(reduced.squares, functions, root_of_increase).T
        lower, upper = np.fmin(lower, least), np.fmax(upper, greatest)
    return _Ranges(lower, upper)


LARGEST_UNCERTAINTY: Final = 0.5
"""Relative standard uncertainty of an effective compliance above which it is poorly known."""

RIGID: Final = 1e-12
"""Compliance [rad/(N·m)] below which a joint counts as rigid: cone programs do not reach zero exactly."""


def replace_by_effective(
    estimate: Estimate, elastic: ElasticFit, effective: EffectiveCompliances
) -> Estimate:
    """Return the joints' estimate with joint compliances replaced by effective compliances.

    Sigma, chi square, degrees of freedom and certificate are those of the estimate with bending links or
    base.

    Args:
        estimate: estimate of joints alone.
        elastic: estimate with bending links or base.
        effective: effective compliances of the same joints.
    """
    bending_words = _name_bending_elements(elastic, first_joint=estimate.joints[0].name)
    joints = list[JointCompliance]()
    for index, joint in enumerate(estimate.joints):
        joints.append(_build_effective_joint(joint, effective, index, bending_words.get(joint.name)))
    return replace(
        estimate,
        joints=tuple(joints),
        compliance=np.nan_to_num(effective.compliance),
        covariance=None,
        sigma=elastic.scale.sigma,
        chi_square=elastic.scale.chi_square,
        degrees_of_freedom=elastic.scale.degrees_of_freedom,
        complementary_stiffness=None,
        certificates=elastic.certificates,
    )


def _name_bending_elements(elastic: ElasticFit, first_joint: str) -> dict[str | None, str]:
    """Return the words for what bends about the axis of a joint, by the joint's name.

    The words are followed by "'s", as in "its link's and the base's rotation about its axis". The base bends
    about the axis of the first joint.
    """
    words: dict[str | None, str] = {link.joint: "its link" for link in elastic.links}
    if elastic.base is not None:
        first_link_bends = first_joint in words
        words[first_joint] = "its link's and the base" if first_link_bends else "the base"
    return words


def _build_effective_joint(
    joint: JointCompliance, effective: EffectiveCompliances, index: int, bending_words: str | None
) -> JointCompliance:
    """Return the result of a joint with its effective compliance, and remarks on links or base that bend.

    A joint that is not observable is returned unchanged.

    Args:
        joint: result of the joint alone.
        effective: effective compliances of all joints.
        index: index of the joint.
        bending_words: name of the link or base that bends about the joint's axis; None if both are rigid.
    """
    compliance = float(effective.compliance[index])
    if joint.status == "not_observable" or np.isnan(compliance):
        return joint
    uncertainty = float(effective.uncertainty[index])
    lower, upper = effective.ends[index].tolist()
    has_interval = bool(np.isfinite([lower, upper]).all())
    remarks = _list_remarks(joint.kind, compliance, uncertainty, bending_words)
    return JointCompliance(
        name=joint.name,
        kind=joint.kind,
        status=_find_status(compliance, uncertainty, (lower, upper) if has_interval else None),
        compliance=0.0 if compliance < RIGID else compliance,
        standard_uncertainty=uncertainty if np.isfinite(uncertainty) else None,
        compliance_interval=(lower, upper) if has_interval else None,
        reason="; ".join(remarks) or None,
        own_compliance=float(effective.own[index]),
    )


def _find_status(
    compliance: float, uncertainty: float, interval: tuple[float, float] | None
) -> Literal["identified", "uncertain", "at_bound"]:
    """Return the status of a joint by its effective compliance, uncertainty and interval [rad/(N·m)]."""
    if compliance < RIGID:
        return "at_bound"
    if interval is not None:
        lower, upper = interval
        return "identified" if 0.0 < upper <= IDENTIFIED * lower else "uncertain"
    return "identified" if uncertainty < compliance else "uncertain"  # uncertain, too, if it is NaN


def _list_remarks(
    kind: JointKind, compliance: float, uncertainty: float, bending_words: str | None
) -> list[str]:
    """Return the remarks on a joint's effective compliance: what it contains, and how well it is known.

    Args:
        kind: kind of the joint.
        compliance: effective compliance [rad/(N·m)].
        uncertainty: its standard uncertainty [rad/(N·m)]; infinite or NaN if it is not known.
        bending_words: name of the link or base that bends about the joint's axis; None if both are rigid.
    """
    if compliance < RIGID:
        return [
            "the other elastic elements (joints, links or base) explain the readings without a compliance of "
            "this joint"
        ]
    remarks = list[str]()
    if bending_words is not None:
        motion = JOINT_UNITS[kind].of_link  # "rotation about" or "motion along"
        remarks.append(
            f"effective compliance of the joint together with {bending_words}'s {motion} its axis, because "
            "readings do not distinguish the two"
        )
    if not np.isfinite(uncertainty):
        remarks.append("no interval: the range of compliances that fit the readings was not found")
    elif uncertainty > LARGEST_UNCERTAINTY * compliance:
        remarks.append(
            f"poorly determined (standard uncertainty {100 * uncertainty / compliance:.0f} %): "
            "bending links explain the readings nearly as well as this joint"
        )
    return remarks
