"""Observability: which compliances the readings show, alone or in combination, and why not (method.md §6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.schemas.run import ObservabilityIndex
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import RegressorBlock
from jointstiff.solver.text import figure

NULL_COLUMN = 1e-9
"""Norm of a joint's column, relative to the largest norm that the joint's levers allow, that is rounding."""
NULL_DIRECTION = 1e-7
"""Singular value of the equilibrated regressor, relative to the first, below which it counts as zero.

One threshold for rank, pseudo-inverse and fit: no reading determines a digit in such a direction, and
the square of its inverse, which covariances hold, would drown in rounding.
"""
HARD_TO_TELL = 100.0
"""Condition number above which results are unreliable (Schröer et al. 1992, as quoted by
Nahvi & Hollerbach 1996)."""
_INVOLVED_PART = 1e-6
"""Component of a unit vector in a null space above which a joint belongs to a combination."""
_RELEVANT_PART = 0.1
"""Coefficient, relative to the largest one, below which a joint is not mentioned."""
_NOT_PRINTED = 0.005
"""Coefficient below which a joint is left out of a printed sum."""


@dataclass(frozen=True, eq=False)
class Combination:
    """Joints whose compliances appear in the readings only together."""

    joints: tuple[int, ...]  #: indices of the m joints
    #: (m − k, m) weighted sums of the m compliances that the readings determine, one sum in each row, in
    #: reduced echelon form, dimensionless; k is the number of directions that the readings do not determine
    seen: FloatArray

    def in_words(self, names: tuple[str, ...]) -> str:
        """Return the sums that the readings determine, such as ``c(joint_4) + 0.8 c(joint_6)``.

        Args:
            names: names of all n joints of the robot.
        """
        return " and ".join(_sum_in_words(row, self.joints, names) for row in self.seen)

    def reason(self, names: tuple[str, ...]) -> str:
        """Return in words why no stiffness of these joints is known, and what to do.

        `names` are the names of all joints of the robot.
        """
        together = ", ".join(names[joint] for joint in self.joints)
        return (
            f"only a combination of {together} is observable, {self.in_words(names)}: add postures in "
            "which the axes of these joints differ"
        )


@dataclass(frozen=True, eq=False)
class WeakDirection:
    """Change of the compliances that has the least effect on the readings."""

    joints: tuple[int, ...]  #: indices of the m joints with the largest part in the change
    #: (m,) change of these joints' compliances, dimensionless: the largest of size 1, the first positive
    change: FloatArray
    #: condition number of the columns scaled to unit norm: how many times less effect on the readings this
    #: change has than the most visible change
    attenuation: float

    def in_words(self, names: tuple[str, ...]) -> str:
        """Return a sentence on joints that are hard to distinguish; `names` are the names of all joints."""
        together = ", ".join(names[joint] for joint in self.joints)
        change = " : ".join(f"{component:+.2g}" for component in self.change)
        return (
            f"{together} are hard to distinguish: a change of their compliances in the ratio {change} "
            f"has {figure(self.attenuation, '.2g')} times less effect on the readings than "
            "the most visible change"
        )


def split_null_space(
    null_space: FloatArray, scale: FloatArray, columns: IndexArray
) -> tuple[Combination, ...]:
    """Return the groups of joints whose compliances the readings show only in combination within the group.

    Args:
        null_space: (k, p) orthonormal directions without effect on the readings, for columns of unit norm.
        scale: (p,) norms of the regressor's columns, by which it was equilibrated.
        columns: (p,) the joint of each column.
    """
    if not len(null_space):
        return ()
    # The projector onto the null space does not depend on the basis, and is block diagonal over the groups:
    # the groups are the connected components of the graph of its entries that are not zero.
    projector = null_space.T @ null_space  # (p, p)
    are_linked = np.abs(projector) > _INVOLVED_PART
    is_in_a_group = are_linked.diagonal()
    _, labels = connected_components(coo_array(are_linked), directed=False)
    combinations = list[Combination]()
    for label in np.unique(labels[is_in_a_group]):
        group = np.flatnonzero((labels == label) & is_in_a_group)
        combinations.append(_describe_combination(null_space, scale, group, columns))
    return tuple(combinations)


def _describe_combination(
    null_space: FloatArray, scale: FloatArray, group: IndexArray, columns: IndexArray
) -> Combination:
    """Return a group of joints with the weighted sums of their compliances that the readings determine.

    A sum with weights w is determined if no direction without effect on the readings changes it: ``ν w = 0``
    with these k directions ν (k, m), one in each row. Choose k joints f with independent columns ν_f of ν.
    Each other joint i then has one sum, with the weight 1 of joint i and ``w_f = −ν_f⁻¹ ν_i`` of joints f.

    Args:
        null_space: (k, p) orthonormal directions without effect on the readings, for columns of unit norm.
        scale: (p,) norms of the regressor's columns.
        group: (m,) columns of the joints of the group.
        columns: (p,) the joint of each column.
    """
    of_group = null_space[:, group]
    eigenvalues, eigenvectors = np.linalg.eigh(of_group.T @ of_group)  # a projector: eigenvalues are 0 or 1
    directions = eigenvectors[:, eigenvalues > 0.5].T  # (k, m) orthonormal basis of the rows of `of_group`
    chosen = _choose_independent_columns(directions)
    others = np.setdiff1d(np.arange(len(group)), chosen)
    nu = directions / scale[group]  # from columns of unit norm to the compliances themselves
    weights = np.zeros((len(others), len(group)))
    weights[np.arange(len(others)), others] = 1.0
    weights[:, chosen] = -np.linalg.solve(nu[:, chosen], nu[:, others]).T
    return Combination(joints=tuple(int(columns[i]) for i in group), seen=weights)


def _choose_independent_columns(directions: FloatArray) -> list[int]:
    """Return ascending indices of k independent columns of a matrix (k, m) of rank k.

    Columns are chosen one after the other, and each is projected out of the others. Of the columns that are
    then long enough, the last is chosen rather than the longest, so that rounding does not decide between
    equal columns.
    """
    remaining = directions
    chosen = list[int]()
    for _ in range(len(directions)):
        norms = np.linalg.norm(remaining, axis=0)
        is_long_enough = norms > _RELEVANT_PART * norms.max()
        last = int(np.flatnonzero(is_long_enough)[-1])
        unit_vector = remaining[:, last] / norms[last]
        remaining = remaining - np.outer(unit_vector, unit_vector @ remaining)
        chosen.append(last)
    return sorted(chosen)


def _sum_in_words(row: FloatArray, joints: tuple[int, ...], names: tuple[str, ...]) -> str:
    """Return a weighted sum of compliances as text, such as ``c(joint_4) + 0.8 c(joint_6)``.

    Weights below `_NOT_PRINTED` are left out, and a weight of 1 is not written.

    Args:
        row: (m,) weights of the compliances.
        joints: indices of the m joints.
        names: names of all joints.
    """
    text = ""
    for weight, joint in zip(row.tolist(), joints, strict=True):
        if abs(weight) < _NOT_PRINTED:
            continue
        is_negative = weight < 0
        if text:
            text += " - " if is_negative else " + "
        elif is_negative:
            text += "-"
        factor = f"{abs(weight):.2g}"
        if factor != "1":
            text += f"{factor} "
        text += f"c({names[joint]})"
    return text


@dataclass(frozen=True, eq=False)
class Observability:
    """Dependence of the readings on each joint, and excitation of each joint by the loads."""

    #: (n,) mask of joints that have no effect on the readings: the joint's column is zero up to rounding
    null: BoolArray
    #: (n,) compliance with which the joint alone, at its full lever, would explain all deflection
    #: [rad/(N·m)]
    reference_compliance: FloatArray
    #: (n,) reason why the joint has no effect, with a remedy; None for a joint that has an effect
    reasons: tuple[str | None, ...]
    #: (n,) norm of the joint's column over the largest norm possible, with the force across the joint's lever
    #: and the moment about the joint's axis in every observation; 0 to 1
    excitation: FloatArray
    #: (n,) greatest torque of the load about the joint over all observations [N·m]
    greatest_torque: FloatArray
    #: (n, n) greatest entries |K_c,ij| of the complementary stiffness over all observations [N·m/rad]
    greatest_stiffness: FloatArray
    kinds: tuple[JointKind, ...]  #: (n,) kinds of the joints


class Excitation:
    """Sums over observations of the effect of loads on each joint, and of each joint on the targets.

    For each joint the sums compare the effect with the largest effect possible at the same levers, with the
    force perpendicular to the levers. The ratios do not depend on unit or frame.
    """

    def __init__(self, joint_kinds: tuple[JointKind, ...]) -> None:
        """Start with sums of zero for n joints of some kinds.

        "Largest" is what is largest possible, with the force perpendicular to the lever.
        """
        n = len(joint_kinds)
        self._kinds = joint_kinds
        # Sums of squares over the observations, for each joint
        self._squared_torque = np.zeros(n)
        self._squared_largest_torque = np.zeros(n)
        self._squared_column = np.zeros(n)  # of the joint's column in the regressor
        self._squared_largest_column = np.zeros(n)
        self._squared_deflection = 0.0  # sum over all readings
        self._greatest_torque = np.zeros(n)  # of all observations
        self._greatest_stiffness = np.zeros((n, n))  # of all observations

    @classmethod
    def of(cls, rows: Rows) -> Excitation:
        """Return the excitation of the joints by the loads of all observations."""
        excitation = cls(rows.robot.joint_kinds)
        for block in rows.generate_blocks():
            excitation.add(block)
        return excitation

    def add(self, block: RegressorBlock) -> None:
        """Add a block of observations of the targets."""
        self.add_with_points(block, block.jacobian, block.measurements.present)
        greatest_of_block = np.abs(block.complementary_stiffness).max(axis=0)
        self._greatest_stiffness = np.maximum(self._greatest_stiffness, greatest_of_block)

    def add_with_points(self, block: RegressorBlock, jacobian: FloatArray, present: BoolArray) -> None:
        """Add the observations of a block to the sums, for given points that move with the flange.

        A joint's column in the regressor is its torque times the motion of the points by the joint. An
        encoder counts like a target at the distance from the axis at which a target has the same weight. The
        largest torque is that of a force perpendicular to the lever, and of a moment about the axis.

        Args:
            block: B observations.
            jacobian: (B, T, 3, n) Jacobian J_v of the T points [m/rad].
            present: (B, T) whether the point counts in the observation.
        """
        measurements, encoders = block.measurements, block.measurements.encoders
        if not present.all():
            jacobian = jacobian * present[..., None, None]
        jacobian_of_all_points = jacobian.reshape(len(jacobian), -1, jacobian.shape[-1])  # (B, 3 T, n)
        squared_motion = _square_columns(jacobian_of_all_points)  # (B, n) by a unit turn of each joint
        if encoders is not None:
            squared_lever = measurements.encoder_lever**2
            squared_motion += squared_lever * encoders.present
            self._squared_deflection += float((squared_lever * encoders.deflection**2).sum())
        self._squared_deflection += float((measurements.deflection**2).sum())

        squared_torque = block.torque**2
        self._squared_torque += squared_torque.sum(axis=0)
        self._squared_column += (squared_torque * squared_motion).sum(axis=0)
        greatest_of_block = np.abs(block.torque).max(axis=0)
        self._greatest_torque = np.maximum(self._greatest_torque, greatest_of_block)

        force = np.linalg.norm(measurements.force, axis=1)[:, None]
        moment = np.linalg.norm(measurements.moment, axis=1)[:, None]
        lever_arm = np.sqrt(_square_columns(block.load_jacobian))  # (B, n)
        squared_largest_torque = (lever_arm * force + moment) ** 2
        self._squared_largest_torque += squared_largest_torque.sum(axis=0)
        self._squared_largest_column += (squared_largest_torque * squared_motion).sum(axis=0)

    def add_wrist_centre(self, block: RegressorBlock, centre: FloatArray) -> None:
        """Add the observations of a block as if the wrist's centre was their only target.

        `centre` (3,) is in the flange frame [m].
        """
        observations = len(block.torque)
        centres_in_flange = np.broadcast_to(centre, (observations, 1, 3))
        jacobian = block.postures.jacobian_at(block.postures.to_base(centres_in_flange))
        present = np.ones((observations, 1), dtype=np.bool_)
        self.add_with_points(block, jacobian, present)

    @property
    def anything_moved(self) -> bool:
        """True if any target moved."""
        return self._squared_deflection > 0

    def observability(self) -> Observability:
        """Return how much each joint affects the readings, over all observations added so far.

        The effect of a joint is the norm of its column in the regressor, compared with the largest norm that
        loads of the same size can have. A joint has no effect if no load could show it, as no target moves
        with it or no load has a lever, or if the actual loads do not show it.
        """
        largest_possible = self._squared_largest_column
        no_load_could_show = largest_possible <= NULL_COLUMN**2 * largest_possible.max()
        loads_do_not_show = self._squared_column <= NULL_COLUMN**2 * largest_possible
        has_no_effect = no_load_could_show | loads_do_not_show
        reasons: list[str | None] = [None] * len(has_no_effect)
        for joint in np.flatnonzero(has_no_effect).tolist():
            reasons[joint] = self._explain_no_effect(joint)
        # Ratios to a column that is zero are zero.
        divisor = np.where(largest_possible > 0, largest_possible, np.inf)
        return Observability(
            null=has_no_effect,
            # A compliance c of the joint alone moves the targets by c times the largest column.
            reference_compliance=np.sqrt(self._squared_deflection / divisor),
            reasons=tuple(reasons),
            excitation=np.sqrt(self._squared_column / divisor),
            greatest_torque=self._greatest_torque,
            greatest_stiffness=self._greatest_stiffness,
            kinds=self._kinds,
        )

    def _explain_no_effect(self, joint: int) -> str:
        """Return why a joint has no effect on the readings, with a remedy."""
        words = JOINT_UNITS[self._kinds[joint]]  # with verbs for the kind, such as "twists" or "pushes"
        largest_possible = self._squared_largest_torque  # (n,) [N²·m²]
        if not largest_possible.any():
            return "no observation has a force or a moment: give the loads"
        # If the load always acts on the joint's axis, the largest torque of the joint is zero, too: then the
        # largest torque of all joints tells what is rounding.
        reference_torque = max(largest_possible[joint], 1e-6 * largest_possible.max())
        is_never_loaded = self._squared_torque[joint] <= NULL_COLUMN**2 * reference_torque
        if is_never_loaded:
            return f"the load never {words.loads} this joint: add loads that {words.load_verb} the joint"
        return f"no target moves when this joint {words.moves}: place a target away from the joint's axis"


def _square_columns(matrices: FloatArray) -> FloatArray:
    """Return the squared norms (B, n) of the columns of matrices (B, m, n)."""
    return np.asarray(np.einsum("bij,bij->bj", matrices, matrices))


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Observability analysis of the equilibrated, weighted regressor over the observable joints."""

    rank: int  #: number of directions that the readings determine
    condition_number: float  #: ratio of the extreme singular values; inf if rank deficient
    singular_values: FloatArray  #: largest first, dimensionless
    combinations: tuple[Combination, ...]  #: groups of joints that appear only in combination
    #: least observable direction; None if the rank is not full, or every direction is well observable
    weakest: WeakDirection | None

    @property
    def combined(self) -> frozenset[int]:
        """Indices of the joints that appear only in combination with others."""
        return frozenset(joint for group in self.combinations for joint in group.joints)


class Spectrum:
    """Singular value decomposition of a weighted regressor with columns scaled to unit norm.

    One threshold decides the rank for verdicts, fit and covariance alike.

    Attributes:
        rank: number of singular values above the threshold.
        singular_values: (p,) largest first.
        scale: (p,) norms of the columns, 1 where a norm is zero.
        weakest: (p,) singular vector of the least singular value, for columns of unit norm.
        null_space: (p − rank, p) orthonormal directions without effect on the readings, for columns of unit
            norm.
        determined: (m, p) the regressor with the directions of `null_space` removed, so that no fit follows
            rounding; the regressor itself where the rank is full.
        inverse: (p, m) pseudo-inverse of the regressor.
        seen: (rank, p) weighted sums of the compliances that the readings determine, one in each row.
    """

    def __init__(self, R: FloatArray) -> None:
        """Decompose a regressor.

        Args:
            R: (m, p) weighted regressor, compressed; p may be zero.
        """
        m, p = R.shape
        scaled_R, self.scale = unit_columns(R)
        # With fewer rows than columns, only the full matrix Vᵀ contains the null space.
        U, singular_values, Vt = np.linalg.svd(scaled_R, full_matrices=m < p)
        self.singular_values = np.zeros(p)
        self.singular_values[: len(singular_values)] = singular_values
        threshold = NULL_DIRECTION * singular_values.max(initial=0.0)
        rank = int((self.singular_values > threshold).sum())
        self.rank = rank
        self.weakest: FloatArray = Vt[-1] if len(Vt) else np.zeros(0)
        self.null_space: FloatArray = Vt[rank:]

        # The first `rank` directions, and from columns of unit norm back to those of R.
        U, s, Vt = U[:, :rank], singular_values[:rank], Vt[:rank]
        self.determined: FloatArray = R if rank == p else (U * s) @ Vt * self.scale
        self.seen: FloatArray = Vt * self.scale
        self.inverse: FloatArray = (Vt.T / s) @ U.T / self.scale[:, None]

    def deviation(self, column: int) -> float | None:
        """Return the standard uncertainty of a column's unknown; None if the rows do not determine it.

        The unknown is not determined if a direction without effect on the readings changes it.
        """
        undetermined_part = (self.null_space[:, column] ** 2).sum()
        if undetermined_part > _INVOLVED_PART:
            return None
        return float(np.linalg.norm(self.inverse[column]))


def analyse_spectrum(spectrum: Spectrum, columns: IndexArray) -> Identifiability:
    """Return rank, condition number, combined joints and weakest direction from a spectrum.

    A weakest direction is stated only if the rank is full and the condition number is above `HARD_TO_TELL`.
    Joints with a small part in the direction are left out.

    Args:
        spectrum: spectrum of the regressor of p joints.
        columns: (p,) index of the joint of each column; the result uses these indices.
    """
    singular_values = spectrum.singular_values
    has_full_rank = spectrum.rank == len(columns)
    condition = float(singular_values[0] / singular_values[-1]) if has_full_rank else float("inf")
    weakest = None
    if has_full_rank and condition > HARD_TO_TELL:
        direction = spectrum.weakest
        is_relevant = np.abs(direction) > _RELEVANT_PART * np.abs(direction).max()
        change = direction[is_relevant] / spectrum.scale[is_relevant]  # from unit columns to compliances
        # The sign of a singular vector is arbitrary: choose the sign for which the first part is positive.
        sign = np.sign(change[0])
        change = change * (sign / np.abs(change).max())
        weakest = WeakDirection(tuple(columns[is_relevant].tolist()), change, attenuation=condition)
    return Identifiability(
        rank=spectrum.rank,
        condition_number=condition,
        singular_values=singular_values,
        combinations=split_null_space(spectrum.null_space, spectrum.scale, columns),
        weakest=weakest,
    )


def explain_noise(
    joint: int, names: tuple[str, ...], observability: Observability, uncertainty: float
) -> str:
    """Return a sentence on why noise hides a joint that the readings depend on, with a remedy.

    Args:
        joint: index of the joint.
        names: names of the n joints.
        observability: observability of the joints in the same observations.
        uncertainty: standard uncertainty of the joint's compliance [rad/(N·m)].
    """
    torques = observability.greatest_torque
    units = JOINT_UNITS[observability.kinds[joint]]  # units and verbs by the kind of the joint
    load = f"at most {figure(torques[joint], '.2g')} {units.effort}"
    most_loaded = int(np.argmax(torques))
    if most_loaded != joint:
        unit = JOINT_UNITS[observability.kinds[most_loaded]].effort
        load += f", and {names[most_loaded]} with up to {figure(torques[most_loaded], '.2g')} {unit}"
    explaining_all = figure(observability.reference_compliance[joint], ".2g")
    return (
        "hidden by noise: the compliance of this joint has a standard uncertainty of "
        f"{figure(uncertainty, '.2g')} {units.compliance}, but a compliance of {explaining_all} "
        f"{units.compliance} would explain all deflections by this joint alone; the load {units.loads} the "
        f"joint with {load}: add loads that {units.load_verb} the joint more"
    )


def observability_indices(
    regressor: FloatArray, observability: Observability
) -> dict[ObservabilityIndex, float] | None:
    """Return the observability indices O1 to O5 of robot calibration, over the joints that the readings see.

    Each column is divided by the largest norm that the joint's levers allow, so ``Σ s² ≤ p``, and no index
    exceeds 1. These norms grow with the number of readings, so that readings taken twice change nothing;
    Borm & Menq divide by the square root of the number of readings instead.

    Args:
        regressor: (m, n) regressor of all readings, weighted with their covariance, in any unit.
        observability: observability in the same readings.

    Returns:
        The indices by name; None where the rank is not full.
    """
    visible = ~observability.null
    spectrum = Spectrum(regressor[:, visible])
    if spectrum.rank < np.count_nonzero(visible):
        return None
    columns = regressor[:, visible] / spectrum.scale * observability.excitation[visible]
    singular_values = np.linalg.svd(columns, compute_uv=False).astype(np.float64, copy=False)
    return {
        "o1": float(np.exp(np.log(singular_values).mean())),  # Borm & Menq 1991
        "o2": float(singular_values[-1] / singular_values[0]),  # Driels & Pathre 1990
        "o3": float(singular_values[-1]),  # Nahvi, Hollerbach & Hayward 1994
        "o4": float(singular_values[-1] ** 2 / singular_values[0]),  # Nahvi & Hollerbach 1996
        "o5": float(1.0 / np.sum(1.0 / singular_values)),  # Sun & Hollerbach 2008
    }
