"""Advice: which posture or load direction would tell more of the joints that the readings hardly show.

Each candidate is one more reading of all targets under the strongest force of the set. It adds
``K = AᵀΣ⁻¹A`` to the information ``G = RᵀR`` of the readings at hand, so that the standard uncertainty of
c_j after it is known before it is taken: ``u_j = σ √[(G + K)⁻¹]_jj``, that of the partial pose weighted by
covariance. Candidates are compared by it, and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from typing import Final

import numpy as np

from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.run import Advice
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.design.candidates import in_whole_units, within_limits
from jointstiff.solver.design.optimum import uncertainty_of
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.fitting.observability import Spectrum
from jointstiff.solver.messages import point
from jointstiff.solver.readings.measurements import Measurements, shown_along
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import targets_in_flange
from jointstiff.solver.text import posture_text
from jointstiff.solver.triangle import whitened

LARGEST_RELATIVE_UNCERTAINTY: Final = 0.1
"""Relative standard uncertainty of a compliance above which a joint gets advice."""
MOST_JOINTS: Final = 3
"""Maximum number of joints that get advice, the worst first: one posture often serves several."""
MOST_POSTURES: Final = 48
"""Maximum number of postures of the set, and of new ones; fewer where many joints make each candidate
costly."""
LEAST_GAIN: Final = 0.05
"""Least relative reduction of the standard uncertainty, what all readings share included, for which a reading
is advised: two digits of it show the gain."""
LITTLE_MORE: Final = 1.1
"""The easier of two pieces of advice is chosen if it does as well within this factor: weights can only pull
downwards, so a new posture; otherwise one of the set, which is known to be free of collisions."""
EASIER: Final = 1.05
"""A force along an axis of R0, or the set's own, is easier to apply: others must be better by this factor."""
_SHOWS: Final = 1e-6
_LEAST_LEVER: Final = 1e-6
"""Distance [m] of a force from an axis below which it twists the joint by rounding alone."""
_LEAST_SPAN: Final = (1.0, 0.1)
"""Range of a joint [rad, m of a prismatic one] for new postures, where the set itself spans less."""
_DRAWS: Final = 4
"""New postures drawn for each one needed, as limits of coupled joints exclude some."""
_SEED: Final = 20170924
_CUBE: Final = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (z, y, x) > (0, 0, 0)],
    dtype=np.float64,
)
"""(13, 3) towards faces, edges and corners of a cube, one of each opposite pair: both tell the same."""
_DIRECTIONS: Final = _CUBE / np.linalg.norm(_CUBE, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Postures:
    """M postures in which all targets could be read, and the Jacobians that turn a load into deflections."""

    joints: FloatArray  #: (M, n) angles as the controller shows them [rad]
    observation: IndexArray  #: (M,) the observation that has this posture; -1 for a new one
    load_jacobian: FloatArray  #: (M, 3, n) J_v at the load point [m/rad]
    target_jacobian: FloatArray  #: (M, 3 T, n) J_v at the targets, whitened in units of sigma

    @classmethod
    def of(
        cls, robot: Robot, measurements: Measurements, joints: FloatArray, observation: IndexArray
    ) -> Postures:
        """Compute the Jacobians for the targets of the observation that read most of them.

        A posture of the set has its own load point, a new one that of the strongest force.
        """
        count = len(joints)
        strongest = int(np.argmax(np.linalg.norm(measurements.force, axis=1)))
        richest = int(np.argmax(measurements.coordinates.sum(axis=1)))
        present, covariance = measurements.present[richest], measurements.covariance
        places = targets_in_flange(robot, measurements[richest : richest + 1])[present]
        targets = np.broadcast_to(places, (count, *places.shape))
        load_point = measurements.load_point[np.where(observation < 0, strongest, observation)]
        direction = None
        if measurements.direction is not None:
            direction = np.broadcast_to(measurements.direction[richest, present], targets.shape)
        now = Configurations(robot, robot.joint_map.model_angles(joints))
        covariance = covariance if covariance.ndim == 2 else covariance[richest, present]
        jacobian = whitened(covariance, shown_along(direction, now.jacobian_at(now.to_base(targets))))
        return cls(
            joints,
            observation,
            now.jacobian_at(now.to_base(load_point[:, None]))[:, 0],
            jacobian.reshape(count, 3 * len(places), robot.n),
        )

    def __len__(self) -> int:
        return len(self.joints)

    def information(self, force: FloatArray) -> FloatArray:
        """Return ``diag(τ) (Σ_t J_tᵀ Σ_t⁻¹ J_t) diag(τ)`` of a reading under each force (M, D, 3) [N].

        Returns:
            (M, D, n, n) in units of sigma⁻².
        """
        motion = self.target_jacobian.transpose(0, 2, 1) @ self.target_jacobian
        torque = force @ self.load_jacobian
        return np.asarray(motion[:, None] * torque[..., :, None] * torque[..., None, :])


def advise(robot: Robot, measurements: Measurements, estimate: Estimate) -> tuple[Advice, ...]:
    """Find the best next reading for each joint that needs one.

    For each joint two candidates win: a posture of the set under a load in another direction, and a new
    posture, where weights were the load under the same. One is left out if the other is easier and
    does about as well; either is, if it gains next to nothing.

    Returns:
        At most two pieces of advice a joint, the better first; none where all joints are well determined
        or no force was applied.
    """
    # The joints without a number, at zero or of a large uncertainty: the worst, in this order
    relative = np.zeros(len(estimate.joints))
    for j, joint in enumerate(estimate.joints):
        if joint.status == "not_observable" or joint.compliance == 0.0:
            relative[j] = np.inf
        elif joint.compliance is not None and joint.standard_uncertainty is not None:
            relative[j] = joint.standard_uncertainty / abs(joint.compliance)
    worst = np.argsort(-relative, kind="stable")[:MOST_JOINTS]
    joints = worst[relative[worst] > LARGEST_RELATIVE_UNCERTAINTY]
    if not len(joints) or not measurements.force.any():
        return ()
    count = int(np.clip(36 * MOST_POSTURES // robot.n**2, 4, MOST_POSTURES))
    inside = np.flatnonzero(within_limits(robot, measurements.joints))
    spread = inside[np.unique(np.linspace(0, len(inside) - 1, min(count, len(inside))).astype(np.intp))]
    new = new_postures(robot, measurements, count)
    own = measurements.force[int(np.argmax(np.linalg.norm(measurements.force, axis=1)))]
    sizes = np.linalg.norm(measurements.force, axis=1) * np.linalg.norm(own)
    weights = bool((np.abs(measurements.force @ own) >= (1.0 - 1e-6) * sizes).all())
    search = _Search(robot, measurements, estimate, own, one_direction=weights)
    of_set = Postures.of(robot, measurements, measurements.joints[spread], spread)
    unseen = Postures.of(robot, measurements, new, np.full(len(new), -1, dtype=np.intp))
    advice: list[Advice] = []
    for measured, unmeasured in zip(
        search.best(of_set, joints, all_directions=True),
        search.best(unseen, joints, all_directions=not weights),
        strict=True,
    ):
        easier_first = (unmeasured, measured) if weights else (measured, unmeasured)
        useful = [a for a in easier_first if a and (a[1].uncertainty_ratio or 0.0) <= 1.0 - LEAST_GAIN]
        if len(useful) == 2 and useful[0][0] <= LITTLE_MORE * useful[1][0]:
            useful = useful[:1]
        advice += [piece for _, piece in sorted(useful, key=itemgetter(0))]
    return tuple(advice)


def new_postures(robot: Robot, measurements: Measurements, count: int) -> FloatArray:
    """Draw postures in whole degrees and millimetres, within what the set spans and the joints' limits.

    The draw is the same at each call. A joint that the set hardly moves is moved by `_LEAST_SPAN`, as a
    posture that none of the set resembles may be what is missing.

    Args:
        robot: n joints.
        measurements: N observations.
        count: at most so many.

    Returns:
        (M, n) [rad or m].
    """
    least, greatest = measurements.joints.min(axis=0), measurements.joints.max(axis=0)
    half = np.maximum(greatest - least, robot.by_kind(*_LEAST_SPAN)) / 2.0
    draws = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_DRAWS * count, robot.n))
    joints = in_whole_units(robot, (least + greatest) / 2.0 + half * draws)
    return joints[within_limits(robot, joints)][:count]


Candidate = tuple[float, Advice]
"""Advice after the standard uncertainty that it leaves, in units of sigma [rad/(N·m)/m]."""


class _Search:
    """Compares candidates for one set of readings."""

    def __init__(
        self,
        robot: Robot,
        measurements: Measurements,
        estimate: Estimate,
        own: FloatArray,
        *,
        one_direction: bool,
    ) -> None:
        self._names, self._kinds, self._labels = robot.joint_names, robot.joint_kinds, measurements.labels
        self._regressor = np.where(estimate.observability.null, 0.0, estimate.regressor)
        self._spectrum = Spectrum(self._regressor)
        self._sigma = estimate.sigma
        self._shared = np.zeros(
            robot.n
        )  # variances by errors that all readings share: no reading lessens them
        if estimate.common is not None:
            self._shared = np.square(estimate.common.responses).sum(axis=1)
        self._own, self._strength = own, float(np.linalg.norm(own))
        self._one_direction = one_direction
        # Whether the estimate's uncertainties are those of the partial pose weighted by covariance: the same
        # method will then find what is promised
        self._same_method = False
        if estimate.covariance is not None and estimate.sigma is not None:
            visible = ~estimate.observability.null
            inverse = Spectrum(self._regressor[:, visible]).inverse
            least = estimate.sigma * np.linalg.norm(inverse, axis=1)
            by_readings = np.diagonal(estimate.covariance) - self._shared
            deviation = np.sqrt(np.maximum(by_readings[visible], 0.0))
            self._same_method = np.allclose(deviation, least, rtol=0.01, atol=0.0)

    def best(self, postures: Postures, joints: IndexArray, *, all_directions: bool) -> list[Candidate | None]:
        """Return for each joint the candidate of least uncertainty; None if none determines it."""
        if not len(postures):
            return [None] * len(joints)
        forces = self._forces(postures, joints if all_directions else joints[:0])
        total = self._regressor.T @ self._regressor + postures.information(forces)
        deviation = uncertainty_of(total, total.shape[-1])
        easy = np.isclose(np.abs(forces).max(axis=2), self._strength, rtol=_SHOWS)
        easy[:, 0] = True
        best = list[Candidate | None]()
        for joint in joints.tolist():
            scores = deviation[..., joint] / np.where(easy, EASIER, 1.0)
            m, d = np.unravel_index(int(np.argmin(scores)), scores.shape)
            best.append(self._advice(joint, postures, int(m), forces[m, d]))
        return best

    def _forces(self, postures: Postures, across: IndexArray) -> FloatArray:
        """Return candidate forces (M, D, 3) [N]: the set's own, and for joints others and across each."""
        own = self._own / self._strength
        count = len(postures)
        directions = np.broadcast_to(own, (count, 1, 3))
        if len(across):
            # a × r is the velocity of the load point: no force of this strength twists the joint more.
            arm = postures.load_jacobian[:, :, across].transpose(0, 2, 1)
            lever = np.linalg.norm(arm, axis=2, keepdims=True)
            arm = np.where(lever > 0, arm / np.where(lever > 0, lever, 1.0), own)
            cube = np.broadcast_to(_DIRECTIONS, (count, len(_DIRECTIONS), 3))
            directions = np.concatenate([directions, cube, arm], axis=1)
        # A force tells the same as its opposite: of both, the one that is more like the set's own.
        sign = np.where(directions @ own < -_SHOWS, -1.0, 1.0)
        return np.asarray(self._strength * sign[..., None] * directions)

    def _advice(self, joint: int, postures: Postures, m: int, force: FloatArray) -> Candidate | None:
        """Put a candidate into numbers and words, by a decomposition of all readings with it."""
        torque = force @ postures.load_jacobian[m]
        added = postures.target_jacobian[m] * torque
        before = _deviation(self._spectrum, joint)
        after = _deviation(Spectrum(np.vstack([self._regressor, added])), joint)
        if after is None or abs(torque[joint]) <= _LEAST_LEVER * self._strength:
            return None
        units = JOINT_UNITS[self._kinds[joint]]
        name, size, i = self._names[joint], float(np.linalg.norm(force)), int(postures.observation[m])
        if i >= 0:
            posture = f"in posture {self._labels[i]}"
        else:
            shown = posture_text(postures.joints[m].tolist(), self._kinds)
            posture = f"in posture {shown}, if it is free of collisions,"
        load = f"apply the load of {size:.4g} N as before"
        if not (self._one_direction and np.allclose(force, self._own, rtol=1e-9)):
            direction = ", ".join(f"{part / size + 0.0:.2f}" for part in force.tolist())
            load = f"apply {size:.4g} N along ({direction})"
        uncertainty, ratio = None, None if before is None else after / before
        if self._sigma is not None:
            shared = float(np.sqrt(self._shared[joint]))
            uncertainty = float(np.hypot(self._sigma * after, shared))
            ratio = None if before is None else uncertainty / float(np.hypot(self._sigma * before, shared))
        changes = [] if uncertainty is None else [f"{uncertainty:.2g} {units.compliance}"]
        if ratio is not None:
            changes.append(f"{ratio:.2g} times its present value")
        gain = f"a {units.load.replace(' ', f' of {abs(torque[joint]):.3g} {units.effort} ', 1)} {name}"
        if changes:
            method = "" if self._same_method else "with method partial_pose "
            gain = f"{method}u({name}) falls to {', '.join(changes)}"
        return after, Advice(
            joint=name,
            message=f"{posture} {load}: {gain}",
            joints=postures.joints[m].tolist(),
            observation=None if i < 0 else self._labels[i],
            force=point(force),
            uncertainty_ratio=ratio,
            standard_uncertainty=uncertainty,
        )


def _deviation(spectrum: Spectrum, joint: int) -> float | None:
    """Return the standard uncertainty of c_j in units of sigma; None where the rows do not determine it."""
    if (spectrum.null_space[:, joint] ** 2).sum() > _SHOWS:
        return None
    return float(np.linalg.norm(spectrum.inverse[joint]))
