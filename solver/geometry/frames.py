"""Frames, wrist centre, links and the robot as it was measured: what follows from the identified axes.

Two axes determine the base frame R0 up to a convention, because the axes show neither the height of the floor
nor the direction that the maker chose for x:

* *By a nominal model* (preferred): R0 is related to the perpendicular frame of the identified axes 1 and 2
  (below) as the model's R0 is to that of its own axes, all at model angle zero. The nominal height
  of axis 2 above R0 is kept, for instance, and all else is measured.
* *By the axes alone*: z along axis 1, in the sense of its positive rotation; the origin on axis 1 at the foot
  of its common perpendicular with axis 2, less a height that is given; x along that perpendicular at
  model angle zero of joint 1, from axis 1 towards axis 2. If the two axes meet within their uncertainty, x
  is the product of the directions of axes 2 and 1 instead.

The *perpendicular frame* of a main axis and another axis, both with a sense of rotation, has z along the main
axis; x along the cross product of the other axis's direction and z, the direction of the common
perpendicular; and its origin at the foot of that perpendicular on the main axis. The frame depends on the
axes alone, also where the axes meet: the cross product still defines x, although both feet are the same
point.

The wrist centre is found in three ways:

* **sphere**: with the arm at rest, every target runs on a sphere about the centre, whichever wrist joint
  turns;
* **axes**: the point nearest to the last three axes, each weighted by its uncertainty there;
* **trilateration**: at each position from three targets (`trilaterate`), at the distances that the spheres
  found.

All three use the same readings, so their errors are related. Each estimate keeps its derivative with respect
to the readings, from which the covariances of estimates and of their differences are exact to first order.
The combination weights each estimate with the inverse of its own covariance: an ill-conditioned estimate
counts little, and no estimate has a negative weight.

Links are lengths and angles between neighbouring axes as Denavit and Hartenberg name them. For neighbours i
and i+1: distance a_i and twist alpha_i along and about their common perpendicular x_i; for each axis, offset
d_i and angle theta_i from x_{i-1} to x_i along and about z_i (Craig, Introduction to Robotics, ch. 3). The
foot of the perpendicular runs away as axes become parallel. Between axes that are meant to be parallel x_i
therefore starts where x_{i-1} ended (d_i = 0), and their small angle has a second component beta_i, about
z_i × x_i (Hayati 1983). A table has four numbers for each joint, and that is enough for any axes. But two
axes 1 m apart at 10 µrad to each other may have their common perpendicular 100 m off: pairs below a tolerance
are made exactly parallel first, and the table says by how much its flange is then off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy import special
from scipy.spatial.transform import Rotation

from jointstiff.schemas.geometry import (
    Drift,
    IdentifiedDh,
    LinkComparison,
    WristCentre,
    WristDistance,
    WristResult,
    WristTarget,
)
from jointstiff.schemas.robot import DhRow
from jointstiff.solver.arrays import BoolArray, FloatArray, cross
from jointstiff.solver.errors import MeasurementError, RobotError
from jointstiff.solver.geometry.poses import (
    Axis,
    IdentifiedAxes,
    LinearFit,
    Motion,
    build_right_handed_frame,
    differentiate_by_rigid_motion,
    list_chain_axes,
    minimise,
    transform_points,
)
from jointstiff.solver.geometry.sweeps import RESTING_RANGE, SweptAxes
from jointstiff.solver.mechanics.chain import ChainJoint, Convention, KinematicChain
from jointstiff.solver.mechanics.measurements import whitener
from jointstiff.solver.mechanics.postures import WRIST_JOINTS, Postures, Wrist
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import build_messages, point, to_rigid

LEAST_SINE = 0.1
"""Sine of the angle between two axes below which the foot of their common perpendicular is unreliable."""

SIGNIFICANCE = 1e-4
"""p-value below which a drift, or a base target that moved, is reported."""

_MEETING_UNCERTAINTIES = 5.0  # standard uncertainties of the distance of axes 1 and 2 below which they meet
_COLLINEAR = 1e-3  # least width of targets over their length, below which they are on a line


def find_common_perpendicular_feet(first: Axis, second: Axis) -> tuple[FloatArray, FloatArray]:
    """Return the feet of the common perpendicular of two axes: the point (3,) [m] on each axis.

    The axes must not be parallel.
    """
    first_direction, second_direction = first.direction, second.direction
    gap = second.point - first.point
    cosine = float(first_direction @ second_direction)
    squared_sine = float(np.sum(cross(first_direction, second_direction) ** 2))
    along_first, along_second = float(gap @ first_direction), float(gap @ second_direction)
    first_foot = first.point_at((along_first - along_second * cosine) / squared_sine)
    second_foot = second.point_at((along_first * cosine - along_second) / squared_sine)
    return first_foot, second_foot


def compute_perpendicular_frame(axes: Sequence[Axis], frame: Literal["base", "flange"]) -> pin.SE3:
    """Return the transform from the perpendicular frame of two axes to the frame of the axes' coordinates.

    The perpendicular frame has z along the main axis and x along the common perpendicular with the other
    axis.

    Args:
        axes: all axes at model angle zero, base first.
        frame: `base` takes axis 1 as main axis and axis 2 as other axis; `flange` takes the last axis as main
            axis and the axis before the last as other axis.

    Raises:
        MeasurementError: there are fewer than two axes, or they are nearly parallel.
    """
    if len(axes) < 2:
        base_remedy = "give the transform from the tracker's frame to R0 explicitly"
        raise MeasurementError(
            f"a single axis does not define a {frame} frame",
            where="sweeps",
            remedy=base_remedy if frame == "base" else "define the flange frame by three targets",
        )
    main, other = (axes[0], axes[1]) if frame == "base" else (axes[-1], axes[-2])
    x = cross(other.direction, main.direction)
    sine = float(np.linalg.norm(x))
    if sine < LEAST_SINE:
        raise MeasurementError(
            "the two axes that should define the frame are nearly parallel "
            f"({np.degrees(np.arcsin(sine)):.2g}°)",
            where="sweeps",
            remedy="give the transform explicitly; parallel axes do not define a frame",
        )
    return build_right_handed_frame(x / sine, main.direction, find_common_perpendicular_feet(main, other)[0])


@dataclass(frozen=True, eq=False)
class BaseFrame:
    """Placement of R0 in the tracker's frame, computed from identified axes and a convention."""

    identified: IdentifiedAxes  #: at least two axes
    #: convention: transform from the perpendicular frame of axes 1 and 2, at model angle zero, to R0
    base_from_perpendicular: pin.SE3

    def place(self, axes: Sequence[Axis]) -> pin.SE3:
        """Return the transform from the tracker's frame to R0, computed from axes at model angle zero."""
        return self.base_from_perpendicular * compute_perpendicular_frame(axes, "base").inverse()

    @cached_property
    def transform_tracker_to_base(self) -> pin.SE3:
        """Transform from the tracker's frame to R0, from the identified axes."""
        return self.place(self.identified.axes)

    @cached_property
    def jacobian(self) -> FloatArray:
        """Derivative (6, 4 n + 3 T) of `transform_tracker_to_base` with respect to axes and targets.

        Rows are a small motion of R0, in its axes: translation [m], then rotation [rad]. Columns are the four
        chart coordinates of each of n axes, then the coordinates of T targets.
        """
        base_to_tracker = self.transform_tracker_to_base.inverse()
        return self.identified.differentiate_quantity(
            lambda axes, _: pin.log6(self.place(axes) * base_to_tracker).vector
        )


def find_base_frame(
    identified: IdentifiedAxes, nominal: KinematicChain | None = None, *, height: float = 0.0
) -> BaseFrame:
    """Return the base frame R0 of the robot, placed relative to its identified axes.

    Args:
        identified: at least two axes.
        nominal: model whose position of R0 relative to its own axes is adopted; None places R0 by axes 1 and
            2 alone.
        height: without a nominal model, height above R0 of the point where the common perpendicular of axes
            1 and 2 meets axis 1 [m].

    Raises:
        MeasurementError: fewer than two axes, or nearly parallel axes.
    """

    def compute_signed_distance(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        """Return the signed distance (1,) [m] from axis 1 to axis 2 along x of their perpendicular frame."""
        x = compute_perpendicular_frame(axes, "base").rotation[:, 0]
        first, second = find_common_perpendicular_feet(axes[0], axes[1])
        return np.array([(second - first) @ x])

    if nominal is not None:
        base_from_perpendicular = compute_perpendicular_frame(list_chain_axes(nominal)[0], "base")
    else:
        distance = compute_signed_distance(identified.axes, identified.targets)[0]
        uncertainty = np.sqrt(identified.compute_covariance_of(compute_signed_distance)[0, 0])
        # Turn x by half a turn if it points away from axis 2: R0 has x from axis 1 towards axis 2.
        sign = -1.0 if distance < -_MEETING_UNCERTAINTIES * uncertainty else 1.0
        base_from_perpendicular = pin.SE3(np.diag([sign, sign, 1.0]), np.array([0.0, 0.0, height]))
    return BaseFrame(identified, base_from_perpendicular)


@dataclass(frozen=True, eq=False)
class BaseTargets:
    """Three or more targets on the robot's base, read before and after the measurement."""

    before: FloatArray  #: (B, 3) earlier readings in the tracker's frame [m]
    after: FloatArray  #: (B, 3) later readings in the tracker's frame [m]
    covariance: FloatArray  #: (3, 3) or (B, 3, 3) covariance of one reading in units of sigma²
    names: tuple[str, ...]  #: (B,) names of the targets
    where: str = "base_targets_after"  #: field of the request that has the later readings

    def fit_drift(self, sigma: float, reference_point: FloatArray) -> Drift:
        """Fit the rigid motion ``after = R before + t`` of the base, and test whether it is only noise.

        Args:
            sigma: standard uncertainty of a coordinate [m].
            reference_point: (3,) point whose displacement is returned [m], such as the middle of the robot's
                targets.

        Returns:
            The motion with its covariance, the p-values of the hypotheses that the base did not move and
            that it moved rigidly, and the name of a target that moved relative to the other targets.

        Raises:
            MeasurementError: the base targets lie on a line.
        """
        before, after, centre = self.before, self.after, self.before.mean(axis=0)
        spread = np.linalg.svd(before - centre, compute_uv=False)
        if spread[1] <= _COLLINEAR * spread[0]:
            raise MeasurementError(
                "the base targets lie on a line, so a rotation about that line cannot be determined",
                where=self.where,
                remedy="place the targets so that they form a triangle",
            )
        # Factor 2: both readings of a target have this covariance.
        whiteners = np.broadcast_to(whitener(2.0 * sigma**2 * self.covariance), (len(before), 3, 3))
        start_rotation, _ = Rotation.align_vectors(after - after.mean(axis=0), before - centre)
        start_matrix = start_rotation.as_matrix()
        motion, linear = minimise(
            pin.SE3(start_matrix, after.mean(axis=0) - start_matrix @ centre),
            lambda motion: np.asarray(
                (whiteners @ (after - transform_points(motion, before))[..., None]).ravel()
            ),
            lambda motion: np.asarray(
                (whiteners @ differentiate_by_rigid_motion(transform_points(motion, before))).reshape(-1, 6)
            ),
            lambda motion, step: pin.exp6(step) * motion,
            where=self.where,
        )
        residual = linear.residual
        residual_if_unmoved = (whiteners @ (after - before)[..., None]).ravel()
        gain_of_motion = float(residual_if_unmoved @ residual_if_unmoved) - linear.rss
        probability = float(special.chdtrc(6, max(gain_of_motion, 0.0)))  # a rigid motion has six numbers
        point_derivative = differentiate_by_rigid_motion(reference_point)
        return Drift(
            transform_after_to_before=to_rigid(motion.inverse()),
            displacement=point(transform_points(motion, reference_point) - reference_point),
            displacement_covariance=(point_derivative @ linear.covariance @ point_derivative.T).tolist(),
            rotation=point(Rotation.from_matrix(motion.rotation).as_rotvec()),
            probability=probability,
            deformation_probability=float(special.chdtrc(residual.size - 6, linear.rss)),
            significant=probability < SIGNIFICANCE,
            moved_targets=self._find_moved_target(linear),
        )

    def _find_moved_target(self, linear: LinearFit) -> list[str]:
        """Return the name of the target that moved most relative to the others, if this is significant.

        Each target is tested alone: the drop in the sum of squares when the target is left out is χ² with
        three degrees of freedom. A single target is named, as its motion disturbs the residuals of all.

        Args:
            linear: linearised fit of the rigid motion.
        """
        suspects: list[tuple[float, str]] = []  # drop in the sum of squares, name of the target
        count = len(self.before)
        if count <= 3:  # too few degrees of freedom remain to find the target that moved
            return []
        for target, name in enumerate(self.names):
            rows = slice(3 * target, 3 * target + 3)
            residual = linear.residual[rows]
            redundancy = np.eye(3) - linear.range_basis[rows] @ linear.range_basis[rows].T
            drop = float(residual @ np.linalg.lstsq(redundancy, residual, rcond=1e-9)[0])
            if special.chdtrc(3, drop) * count < SIGNIFICANCE:
                suspects.append((drop, name))
        return [max(suspects)[1]] if suspects else []


CentreWay = Literal["sphere", "axes", "trilateration"]


def find_wrist_centre(
    identified: IdentifiedAxes, base: BaseFrame, model: IdentifiedModel | None = None
) -> WristResult:
    """Estimate the wrist centre by every method that the readings allow, and combine the estimates.

    The methods are `axes`, `sphere` and `trilateration`; without sweeps only `axes` is possible.

    Args:
        identified: at least three axes.
        base: placement of R0, identified from the same readings.
        model: kinematics with the targets in its flange frame, for the offsets of the targets.

    Returns:
        All estimates and their weighted combination, in the tracker's frame and in R0; the distances between
        the estimates; and with `model` the targets relative to the centre.

    Raises:
        MeasurementError: fewer than three axes, or the last three are nearly parallel.
    """
    if identified.n < WRIST_JOINTS:
        raise MeasurementError(
            f"a robot with {identified.n} axes has no three-axis wrist",
            where="sweeps",
            remedy="sweep all joints of the robot",
        )
    sigma = identified.sigma
    posture = np.zeros(identified.n)
    if isinstance(identified, SweptAxes):  # take the arm's posture in the last sweep
        posture[:-WRIST_JOINTS] = identified.sweeps.postures[-1, :-WRIST_JOINTS]
    nearest_to_axes, miss_distance, miss_uncertainty, miss_probability = _find_point_nearest_to_axes(
        identified, posture
    )
    # Each estimate: method, centre (3,) [m], derivative (3, m) with respect to the whitened readings
    estimates_by_method: list[tuple[CentreWay, FloatArray, FloatArray]] = [("axes", *nearest_to_axes)]
    sphere = None
    if isinstance(identified, SweptAxes):
        sphere = fit_spheres(identified, posture[:-WRIST_JOINTS])
    if isinstance(identified, SweptAxes) and sphere is not None:
        sphere_centre, radii, sphere_influence, was_fitted = sphere
        estimates_by_method.append(("sphere", sphere_centre, sphere_influence[:3]))
        trilaterated = _trilaterate_all_positions(
            identified, radii, sphere_influence, was_fitted, rough_centre=nearest_to_axes[0]
        )
        if trilaterated is not None:
            estimates_by_method.append(("trilateration", *trilaterated))

    information_matrices = [
        np.linalg.inv(sigma**2 * influence @ influence.T) for _, _, influence in estimates_by_method
    ]
    # Matrices whose sum is the identity
    weights = np.linalg.inv(np.sum(information_matrices, axis=0)) @ information_matrices
    weighted_estimates = list(zip(weights, estimates_by_method, strict=True))
    estimates = [
        WristCentre(
            way=method,
            weight=float(np.trace(weight_matrix) / 3.0),
            **_express_in_both_frames(centre, influence, base, sigma),
        )
        for weight_matrix, (method, centre, influence) in weighted_estimates
    ]
    combined_centre = np.sum(
        [weight_matrix @ centre for weight_matrix, (_, centre, _) in weighted_estimates], axis=0
    )
    combined_influence = np.sum(
        [weight_matrix @ influence for weight_matrix, (_, _, influence) in weighted_estimates], axis=0
    )
    combined = WristCentre(
        way="combined",
        weight=1.0,
        **_express_in_both_frames(combined_centre, combined_influence, base, sigma),
    )
    targets: list[WristTarget] = []
    if sphere is not None and model is not None:
        _, radii, influence, present = sphere
        deviations = sigma * np.linalg.norm(influence[3:], axis=1)
        chosen = _choose_triple(identified, present) or []
        targets = [
            WristTarget(
                name=identified.names[t],
                offset=offset.tolist(),
                distance=radii[t],
                standard_uncertainty=deviations[t],
                trilaterates=t in chosen,
            )
            for t, offset in enumerate(_compute_offsets(model, np.array(combined.base), posture))
            if present[:, t].any()
        ]
    return WristResult(
        estimates=estimates,
        combined=combined,
        distances=_compare_centres(estimates_by_method, sigma),
        targets=targets,
        posture=posture.tolist(),
        miss_distance=miss_distance,
        miss_uncertainty=miss_uncertainty,
        miss_probability=miss_probability,
        decoupled_method=miss_distance <= Wrist.TOLERANCE,
    )


def _compute_offsets(model: IdentifiedModel, centre: FloatArray, posture: FloatArray) -> FloatArray:
    """Return the targets (T, 3) less the wrist centre, in the flange frame [m].

    Args:
        model: kinematics in R0, with the targets in its flange frame.
        centre: (3,) in R0 in this posture [m].
        posture: (n,) model angles [rad].
    """
    at = Postures(Robot(model.chain.model()), posture[None])
    centre_in_flange = at.flange_rotation[0].T @ (centre - at.flange_translation[0])
    return np.asarray(model.targets_in_flange - centre_in_flange)


def _express_in_both_frames(
    centre: FloatArray, influence: FloatArray, base: BaseFrame, sigma: float
) -> dict[str, Any]:
    """Return the fields of a `WristCentre`: position and covariance in the tracker's frame and in R0.

    Args:
        centre: (3,) centre in the tracker's frame [m].
        influence: (3, m) derivative of the centre with respect to the whitened readings.
        base: placement of R0, identified from the same readings.
        sigma: standard deviation of a whitened reading [m].
    """
    tracker_to_base = base.transform_tracker_to_base
    centre_in_base = transform_points(tracker_to_base, centre)
    # R0 may depend on more quantities than the centre does, namely the angles of the joints that do not
    # turn in a sweep; the columns of these angles come last.
    base_influence = differentiate_by_rigid_motion(centre_in_base) @ base.jacobian @ base.identified.influence
    base_influence[:, : influence.shape[1]] += tracker_to_base.rotation @ influence
    return {
        "tracker": centre.tolist(),
        "tracker_covariance": (sigma**2 * influence @ influence.T).tolist(),
        "base": centre_in_base.tolist(),
        "base_covariance": (sigma**2 * base_influence @ base_influence.T).tolist(),
    }


def _compare_centres(
    estimates: Sequence[tuple[CentreWay, FloatArray, FloatArray]], sigma: float
) -> list[WristDistance]:
    """Return the distance of each pair of estimates of the wrist centre, with the p-value of a χ² test.

    Args:
        estimates: for each estimate its method, the centre (3,) [m], and the derivative (3, m) of the centre
            with respect to the whitened readings.
        sigma: standard uncertainty of a coordinate of a reading [m].
    """
    distances = []
    for (first, centre_1, influence_1), (second, centre_2, influence_2) in combinations(estimates, 2):
        centre_difference = centre_1 - centre_2
        influence_difference = sigma * (influence_1 - influence_2)
        U, singular_values, _ = np.linalg.svd(influence_difference, full_matrices=False)
        # The χ² test leaves out directions in which noise moves both estimates alike.
        distinguishable = singular_values > 1e-6 * max(singular_values[0], 1e-300)
        statistic = float(
            np.sum(((U.T @ centre_difference)[distinguishable] / singular_values[distinguishable]) ** 2)
        )
        probability = float(special.chdtrc(int(distinguishable.sum()), statistic))
        distance = float(np.linalg.norm(centre_difference))
        distances.append(
            WristDistance(first=first, second=second, distance=distance, probability=probability)
        )
    return distances


def _find_point_nearest_to_axes(
    identified: IdentifiedAxes, posture: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], float, float, float]:
    """Find the point nearest to the last three axes in a posture (n,) [rad], by generalised least squares.

    Returns:
        A pair of the point (3,) in the tracker's frame [m] and its derivative (3, m) with respect to the
        whitened readings in units of sigma; the greatest distance of an axis from the point [m]; the
        uncertainty of this distance [m]; and the p-value of the hypothesis that the three axes intersect.

    Raises:
        MeasurementError: the axes are nearly parallel.
    """

    def place_wrist_axes(axes: Sequence[Axis]) -> list[Axis]:
        """Return the last three axes in `posture`, computed from all axes at model angle zero."""
        # `Motion` needs a target; a target at the origin does not affect the axes.
        rotations, origins = Motion(axes, np.zeros((1, 3)), posture[None]).postures.joint_frames
        frames = zip(rotations[0, -WRIST_JOINTS:], origins[0, -WRIST_JOINTS:], strict=True)
        return [Axis(pin.SE3(rotation, origin)) for rotation, origin in frames]

    reference = place_wrist_axes(identified.axes)
    normals = np.stack([axis.frame[:, :2].T for axis in reference])
    unweighted_centre = _solve_nearest_point(reference, np.eye(2 * WRIST_JOINTS))

    def compute_offsets(axes: Sequence[Axis], point: FloatArray) -> FloatArray:
        """Return offsets (6,) [m] of three axes from a point, along two normals of each reference axis."""
        gaps = np.array([axis.nearest_point_to(point) - point for axis in axes])
        return np.asarray((normals @ gaps[..., None]).ravel())

    offset_covariance = identified.compute_covariance_of(
        lambda axes, _: compute_offsets(place_wrist_axes(axes), unweighted_centre)
    )
    weight = np.asarray(np.linalg.inv(offset_covariance), dtype=np.float64)
    centre = _solve_nearest_point(reference, weight)
    residual = compute_offsets(reference, centre)
    J = identified.differentiate_quantity(
        lambda axes, _: _solve_nearest_point(place_wrist_axes(axes), weight)
    )
    probability = float(special.chdtrc(2 * WRIST_JOINTS - 3, residual @ weight @ residual))
    distance = max(
        float(np.linalg.norm(axis.nearest_point_to(unweighted_centre) - unweighted_centre))
        for axis in reference
    )
    uncertainty = float(np.sqrt(np.trace(offset_covariance) / len(offset_covariance)))
    return (centre, J @ identified.influence), distance, uncertainty, probability


def _solve_nearest_point(axes: Sequence[Axis], weight: FloatArray) -> FloatArray:
    """Return the point (3,) [m] nearest to three axes, by weighted least squares.

    `weight` (6, 6) weights the distances along two normals of each axis.

    Raises:
        MeasurementError: the axes are nearly parallel.
    """
    N = np.vstack([axis.frame[:, :2].T for axis in axes])
    # A point p that lies on all axes satisfies N p = offsets.
    offsets = np.concatenate([axis.frame[:, :2].T @ axis.point for axis in axes])
    system = N.T @ weight @ N
    if np.linalg.svd(system / np.trace(system), compute_uv=False)[-1] < 1e-9:
        raise MeasurementError(
            "the last three axes are nearly parallel, so there is no wrist centre",
            where="sweeps",
            remedy="use a method that needs no wrist centre",
        )
    return np.asarray(np.linalg.solve(system, N.T @ weight @ offsets))


def fit_spheres(
    identified: SweptAxes, arm_angles: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray] | None:
    """Fit spheres with a common centre, the wrist centre, to the targets.

    While the arm is at rest and wrist joints turn, each target keeps its distance from the wrist centre. The
    fit is by maximum likelihood.

    Args:
        identified: axes with the sweeps whose readings are fitted.
        arm_angles: (n - 3,) model angles of the joints before the wrist [rad]; only sweeps at these angles
            are fitted.

    Returns:
        The common centre (3,) in the tracker's frame [m]; the radii (T,) [m], meaningless for a target
        without reading; the derivative (3 + T, m) of centre and radii with respect to all whitened readings,
        in units of sigma; and a mask (N, T) of the readings that were fitted. None if the readings do not
        determine a centre: a single sweep shows only a circle.
    """
    sweeps, readings = identified.sweeps, identified.sweeps.whitened
    resting_masks = []  # for each sweep, a mask of its positions: all true if the arm stays at `arm_angles`
    for sweep in sweeps.sweeps:
        difference = np.abs(sweeps.model_angles(sweep)[:, : len(arm_angles)] - arm_angles)
        resting_masks.append(np.full(len(sweep), difference.max(initial=0.0) <= RESTING_RANGE))
    if sum(is_at_rest.all() for is_at_rest in resting_masks) < 2:  # a single sweep shows only a circle
        return None
    present = sweeps.present & np.concatenate(resting_masks)[:, None]
    # Position and target of each of the m fitted readings
    position_of_reading, target_of_reading = np.nonzero(present)
    points = readings.points[position_of_reading, target_of_reading]
    has_target = np.eye(present.shape[1])[target_of_reading]
    # (m, 3, 3) derivative of each reading with respect to the whitened reading
    unwhiteners = np.linalg.inv(readings.weight[position_of_reading, target_of_reading])

    def compute_distances_and_directions(state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distances (m,) of the readings from the centre, and unit vectors (m, 3) from the centre."""
        from_centre = points - state[:3]
        length = np.linalg.norm(from_centre, axis=1)
        return length, from_centre / length[:, None]

    start = _fit_spheres_linearly(points, has_target)
    # The weights are computed at the start values and kept: they hardly depend on the state, and with
    # constant weights the problem is ordinary least squares.
    distance_deviation = np.linalg.norm(
        np.einsum("mji,mj->mi", unwhiteners, compute_distances_and_directions(start)[1]), axis=1
    )
    try:
        state, linear = minimise(
            start,
            lambda s: np.asarray(
                (compute_distances_and_directions(s)[0] - has_target @ s[3:]) / distance_deviation
            ),
            lambda s: (
                np.hstack([compute_distances_and_directions(s)[1], has_target]) / distance_deviation[:, None]
            ),
            lambda s, step: np.asarray(s + step),
            where="wrist",
        )
    except MeasurementError:
        return None
    if not linear.determines(slice(0, 3)):
        return None
    distance_derivatives = (
        np.einsum("mji,mj->mi", unwhiteners, compute_distances_and_directions(state)[1])
        / distance_deviation[:, None]
    )
    # Columns of `influence` that belong to the coordinates of each reading
    columns = np.arange(readings.points.size).reshape(readings.points.shape)
    influence = np.zeros((len(state), identified.influence.shape[1]))
    influence_of_coordinates = linear.pseudo_inverse[:, :, None] * distance_derivatives
    influence[:, columns[position_of_reading, target_of_reading].ravel()] = influence_of_coordinates.reshape(
        len(state), -1
    )
    return state[:3], state[3:], influence, present


def _fit_spheres_linearly(points: FloatArray, has_target: FloatArray) -> FloatArray:
    """Return the common centre and the radii (3 + T,) of spheres by a linear fit, as start values [m].

    The fit solves ``2 c·p + (r_t² − ‖c‖²) = ‖p‖²``, with the origin at the mean of the readings.

    Args:
        points: (m, 3) readings p [m].
        has_target: (m, T) 1 for the target of each reading, else 0.
    """
    mean = points.mean(axis=0)
    centred_points = points - mean
    solution = np.linalg.lstsq(
        np.hstack([2.0 * centred_points, has_target]), np.sum(centred_points**2, axis=1), rcond=None
    )[0]
    radii = np.sqrt(np.maximum(solution[3:] + solution[:3] @ solution[:3], 1e-12))
    return np.concatenate([solution[:3] + mean, radii])


def _choose_triple(identified: IdentifiedAxes, present: BoolArray) -> list[int] | None:
    """Return the indices of the three targets that span the largest triangle; None without a triangle.

    Args:
        identified: axes with their targets.
        present: (N, T) mask of the readings that may be used.
    """
    read_targets = np.flatnonzero(present.any(axis=0)).tolist()
    triples = [list(triple) for triple in combinations(read_targets, 3)]
    sides = [identified.targets[triple[1:]] - identified.targets[triple[0]] for triple in triples]
    areas = [float(np.linalg.norm(cross(first, second))) for first, second in sides]
    if not max(areas, default=0.0) > 0.0:
        return None
    return triples[int(np.argmax(areas))]


def _trilaterate_all_positions(
    identified: SweptAxes,
    radii: FloatArray,
    sphere_influence: FloatArray,
    present: BoolArray,
    rough_centre: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Return the mean of the wrist centres trilaterated in all positions in which three targets were read.

    The three targets are those that span the largest triangle.

    Args:
        identified: axes with their sweeps' readings and targets.
        radii: (T,) distances of the targets from the centre [m].
        sphere_influence: (3 + T, m) derivative of centre and radii with respect to the whitened readings.
        present: (N, T) mask of the readings that may be used.
        rough_centre: (3,) rough centre [m].

    Returns:
        The weighted mean (3,) [m] and its derivative (3, m) with respect to the whitened readings; None
        without three targets that form a triangle.
    """
    readings = identified.sweeps.whitened
    columns = np.arange(readings.points.size).reshape(readings.points.shape)
    largest_triple = _choose_triple(identified, present)
    if largest_triple is None:
        return None
    radius_influence = sphere_influence[[3 + t for t in largest_triple]]
    # Sums over the positions: of the weights, of weight · centre, and of weight · derivative
    total_weight = np.zeros((3, 3))
    weighted_centre = np.zeros(3)
    weighted_influence = np.zeros_like(sphere_influence[:3])
    for position in np.flatnonzero(present[:, largest_triple].all(axis=1)):
        try:
            point, distance_derivative, target_derivative = trilaterate(
                readings.points[position, largest_triple], radii[largest_triple], rough_centre
            )
        except MeasurementError:
            continue
        unwhiteners = np.linalg.inv(readings.weight[position, largest_triple])
        reading_influence = np.einsum("itj,tjk->itk", target_derivative, unwhiteners).reshape(3, -1)
        point_influence = distance_derivative @ radius_influence
        weight = np.linalg.inv(reading_influence @ reading_influence.T + point_influence @ point_influence.T)
        point_influence[:, columns[position, largest_triple].ravel()] += reading_influence
        total_weight += weight
        weighted_centre += weight @ point
        weighted_influence += weight @ point_influence
    if not total_weight.any():
        return None
    mean_covariance = np.linalg.inv(total_weight)
    return mean_covariance @ weighted_centre, mean_covariance @ weighted_influence


def trilaterate(
    targets: FloatArray, distances: npt.ArrayLike, approximate_point: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find the point whose distances from three targets are known (paper, eqs 13-20).

    Args:
        targets: (3, 3) positions of the three targets [m], one in each row.
        distances: (3,) distance of the point from each target [m].
        approximate_point: (3,) approximate position [m]; of the two solutions, the nearer one is returned.

    Returns:
        The point (3,) [m]; its derivative (3, 3) with respect to the distances; and its derivative (3, 3, 3)
        with respect to the targets, indexed by component of the point, target, coordinate of the target.

    Raises:
        MeasurementError: the targets lie on a line, or no point has these distances.
    """
    radii = np.asarray(distances, dtype=np.float64)
    sides = targets[1:] - targets[0]
    normal, lengths = cross(*sides), np.linalg.norm(sides, axis=1)
    area = float(np.linalg.norm(normal))
    if not area > _COLLINEAR * lengths[0] ** 2:
        raise MeasurementError(
            "the three targets lie on a line, so the distances do not determine a point",
            where="targets",
            remedy="place the targets so that they form a triangle",
        )
    # In the plane of the targets the spheres meet where ``2 sides · x = sides² + r_0² − r_t²``. The solution
    # of least norm lies in this plane.
    foot_from_first = np.linalg.lstsq(sides, 0.5 * (lengths**2 + radii[0] ** 2 - radii[1:] ** 2), rcond=None)[
        0
    ]
    squared_height = float(radii[0] ** 2 - foot_from_first @ foot_from_first)
    if not squared_height > 0.0:
        raise MeasurementError(
            "no point has these distances from the three targets, or the point lies in the plane of "
            "the targets",
            where="targets",
            remedy="check the distances; trilateration cannot find a centre that lies in the plane of the "
            "targets",
        )
    solutions = targets[0] + foot_from_first + np.outer([1.0, -1.0], np.sqrt(squared_height) / area * normal)
    solution = min(solutions, key=lambda point: float(np.linalg.norm(point - np.asarray(approximate_point))))
    # Differentiate ``‖centre − P_t‖² = r_t²``: ``(centre − P_t)·(δcentre − δP_t) = r_t δr_t``
    arms = solution - targets
    inverse_arms = np.linalg.inv(arms)
    return solution, inverse_arms * radii, np.einsum("it,tj->itj", inverse_arms, arms)


PARALLEL_WITHIN = 1e-3
"""Angle of neighbouring axes [rad] below which a table takes them as parallel, unless stated otherwise."""

_LEAST_SIGNED_LENGTH = 1e-3  # length [m] of a perpendicular below which its sense is not reliable
_NO_DIRECTION = 1e-9  # length [m] of a vector without a reliable direction
_JUST_ABOVE_MINUS_PI = 1e-9 - np.pi  # [rad]
_RANDOM_POSTURES = 200


@dataclass(frozen=True, eq=False)
class FlangeConvention:
    """Convention that places the flange frame on the last link; the axes do not determine this frame.

    Without `targets`, the flange frame has the pose `frame_from_flange` in the perpendicular frame of the
    last two axes at model angle zero. With the default, the identity, z is the last axis; for a spherical
    wrist, the origin is then the wrist centre.
    """

    #: indices of three targets that define the flange frame: origin at the first, x towards the second, y
    #: towards the third; None places the frame relative to the last two axes
    targets: tuple[int, int, int] | None = None
    #: transform from the flange frame to the perpendicular frame of the last two axes
    frame_from_flange: pin.SE3 = field(default_factory=pin.SE3.Identity)

    @classmethod
    def from_chain(cls, chain: KinematicChain) -> FlangeConvention:
        """Return the convention that places the flange relative to the last two axes as a model does.

        Raises:
            MeasurementError: there are fewer than two axes, or they are nearly parallel.
        """
        axes, flange = list_chain_axes(chain)
        return cls(None, compute_perpendicular_frame(axes, "flange").inverse() * flange)

    def place(self, axes: Sequence[Axis], targets: FloatArray) -> pin.SE3:
        """Return the transform from the flange frame at angle zero to the frame of the axes' coordinates.

        Args:
            axes: n axes at model angle zero.
            targets: (T, 3) targets in the same frame as the axes [m].

        Raises:
            MeasurementError: the axes are nearly parallel, or the targets lie on a line.
        """
        if self.targets is None:
            return compute_perpendicular_frame(axes, "flange") * self.frame_from_flange
        points = targets[list(self.targets)]
        x, side = points[1] - points[0], points[2] - points[0]
        normal = cross(x, side)
        if np.linalg.norm(normal) <= 1e-3 * float(x @ x):
            raise MeasurementError(
                "the three targets lie on a line and do not define a flange frame",
                where="targets",
                remedy="choose three targets that form a triangle",
            )
        return build_right_handed_frame(x / np.linalg.norm(x), normal / np.linalg.norm(normal), points[0])


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """Kinematic chain of an identified robot, and the positions of the targets on its flange."""

    #: kinematics in R0, as a function of model joint angles; at angle zero all link frames are parallel to
    #: R0, with their origins on the axes
    chain: KinematicChain
    targets_in_flange: FloatArray  #: (T, 3) [m]
    targets_covariance: FloatArray  #: (T, 3, 3) [m²]; NaN for targets that the readings do not determine


def identify_model(
    identified: IdentifiedAxes,
    base: BaseFrame,
    flange: FlangeConvention,
    *,
    nominal: KinematicChain | None = None,
    name: str = "identified",
) -> IdentifiedModel:
    """Turn identified axes into a kinematic chain in R0, with the targets in its flange frame.

    Args:
        identified: the axes at model angle zero.
        base: placement of R0.
        flange: convention that places the flange frame.
        nominal: model that gives the names, the limits, and the points of the axes at which the link frames
            lie; None numbers the joints and links.
        name: name of the robot.

    Raises:
        RobotError: the nominal model has another number of joints, or a name is unfit.
        MeasurementError: the flange cannot be placed.
    """

    def locate_in_flange(axes: Sequence[Axis], points: FloatArray) -> FloatArray:
        """Return the targets (3 T,) [m] in the flange frame, from axes and targets in the tracker's frame."""
        return transform_points(flange.place(axes, points).inverse(), points).ravel()

    tracker_to_base = base.transform_tracker_to_base
    axes = [axis.transform(tracker_to_base) for axis in identified.axes]
    if nominal is not None:  # the link frames are at the points nearest to those of the nominal model
        nominal_axes, _ = _get_nominal_axes(nominal, len(axes))
        pairs = zip(axes, nominal_axes, strict=True)
        axes = [axis.represent_near(nominal_axis.point) for axis, nominal_axis in pairs]
    flange_pose = tracker_to_base * flange.place(identified.axes, identified.targets)
    # The chain of these axes, with the names and limits of the nominal model if there is one
    names = name_joints(nominal, len(axes))
    links = [f"link_{i + 1}" for i in range(len(axes))]
    limits: list[tuple[float, float] | None] = [None] * len(axes)
    base_link, flange_link = "base", "flange"
    if nominal is not None:
        links = [joint.child for joint in nominal.moving]
        limits = [joint.limits for joint in nominal.moving]
        base_link, flange_link = nominal.base, nominal.flange
        # The flange becomes a link of its own behind the last moving link, so the two need different names.
        links[-1] = f"{flange_link}_mount" if links[-1] == flange_link else links[-1]
    joints, origin = [], np.zeros(3)
    for joint, link, limit, axis in zip(names, links, limits, axes, strict=True):
        offset = axis.point - origin
        joints.append(ChainJoint(joint, "revolute", np.eye(3), offset, axis.direction, limit, link))
        origin = axis.point
    z_axis = np.array([0.0, 0.0, 1.0])
    offset = flange_pose.translation - origin
    joints.append(
        ChainJoint(f"{names[-1]}_flange", "fixed", flange_pose.rotation, offset, z_axis, None, flange_link)
    )
    return IdentifiedModel(
        chain=KinematicChain(name, base_link, flange_link, tuple(joints)),
        targets_in_flange=locate_in_flange(identified.axes, identified.targets).reshape(-1, 3),
        targets_covariance=identified.compute_covariances(
            identified.differentiate_quantity(locate_in_flange)
        ),
    )


def name_joints(nominal: KinematicChain | None, n: int) -> tuple[str, ...]:
    """Return the names of n joints: those of the nominal model, or joint_1, joint_2, … without a model."""
    return tuple(f"joint_{i + 1}" for i in range(n)) if nominal is None else nominal.joint_names


def _get_nominal_axes(nominal: KinematicChain, n: int) -> tuple[tuple[Axis, ...], pin.SE3]:
    """Return the n axes of a nominal model in R0, and its transform from flange to R0, both at angle zero.

    Raises:
        RobotError: the model has another number of revolute joints than n.
    """
    axes, flange = list_chain_axes(nominal)
    if len(axes) != n:
        raise RobotError(
            f"the nominal model has {len(axes)} revolute joints, but the sweeps show {n} axes",
            where="nominal",
            remedy="give the nominal model of the robot that was measured",
        )
    return axes, flange


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """Link lengths, twists, offsets and joint angles of a serial chain of n axes (Denavit-Hartenberg)."""

    a: FloatArray  #: (n - 1,) distances of neighbours along x [m], signed
    alpha: FloatArray  #: (n - 1,) twists about x [rad]
    beta: FloatArray  #: (n - 1,) second angle between neighbours meant to be parallel [rad]; 0 for other axes
    d: FloatArray  #: (n,) offsets along the axes, the first from frame 0, the last to the flange's origin [m]
    theta: FloatArray  #: (n,) angles about the axes at model angle zero, from frame 0 to frame n [rad]
    base: pin.SE3  #: transform from frame 0, whose z is axis 1, to the frame of the axes
    tool: pin.SE3  #: transform from the flange frame to frame n, whose z is axis n
    #: (n - 1,) senses of the perpendiculars x relative to z_i × z_{i+1}, or between parallel axes relative to
    #: the direction from one to the other
    signs: tuple[float, ...]

    @property
    def parameters(self) -> FloatArray:
        """Link parameters (5 n - 3,): all a [m], then all alpha, beta [rad], d [m] and theta [rad]."""
        return np.concatenate([self.a, self.alpha, self.beta, self.d, self.theta])


def compute_link_geometry(
    axes: Sequence[Axis],
    flange: pin.SE3,
    parallel: Sequence[bool],
    signs: Sequence[float] | None = None,
) -> LinkGeometry:
    """Compute lengths, twists, offsets and angles of the links between neighbouring axes.

    Args:
        axes: n axes at model angle zero, in R0.
        flange: transform from the flange frame to R0 at model angle zero.
        parallel: (n - 1,) true for neighbours that are meant to be parallel.
        signs: (n - 1,) senses ±1 of the perpendiculars x relative to z_i × z_{i+1}, or between parallel axes
            relative to the direction from axis i to axis i + 1. If None, each perpendicular points towards
            the next axis or, where the axes meet, at most 90° away from the perpendicular before.
    """
    directions = [axis.direction for axis in axes]
    perpendiculars = [_normalise_normal_part(np.eye(3)[0], directions[0], np.eye(3)[1])]
    # The perpendicular x[i + 1] runs from the point starts[i] on axis i to the point ends[i + 1] on axis
    # i + 1; ends[0] is the origin of frame 0.
    starts, ends, used_signs = [], [axes[0].nearest_point_to(np.zeros(3))], []
    for i, (first, second) in enumerate(pairwise(axes)):
        if parallel[i]:
            start, end = ends[-1], second.nearest_point_to(ends[-1])
            along = (end - start) - directions[i] * float((end - start) @ directions[i])
        else:
            start, end = find_common_perpendicular_feet(first, second)
            along = cross(directions[i], directions[i + 1])
        length = float(np.linalg.norm(along))
        along = along / length if length > _NO_DIRECTION else perpendiculars[-1]
        distance = float((end - start) @ along)
        sense = distance if abs(distance) > _LEAST_SIGNED_LENGTH else float(along @ perpendiculars[-1])
        used_signs.append((1.0 if sense >= 0.0 else -1.0) if signs is None else signs[i])
        perpendiculars.append(used_signs[-1] * along)
        starts.append(start)
        ends.append(end)
    # x_n and the origin of frame n: as near to the flange frame as frame n on the last axis can be
    perpendiculars.append(
        _normalise_normal_part(flange.rotation[:, 0], directions[-1], flange.rotation[:, 1])
    )
    starts.append(axes[-1].nearest_point_to(flange.translation))
    frame_n = build_right_handed_frame(perpendiculars[-1], directions[-1], starts[-1])
    tilts = [float(directions[i + 1] @ perpendiculars[i + 1]) for i in range(len(axes) - 1)]
    return LinkGeometry(
        a=np.array([(ends[i + 1] - starts[i]) @ perpendiculars[i + 1] for i in range(len(axes) - 1)]),
        alpha=np.array(
            [
                _signed_angle(directions[i], directions[i + 1], perpendiculars[i + 1])
                for i in range(len(axes) - 1)
            ]
        ),
        beta=np.arcsin(np.clip(tilts, -1.0, 1.0)),
        d=np.array([(starts[i] - ends[i]) @ directions[i] for i in range(len(axes))]),
        theta=np.array(
            [_signed_angle(perpendiculars[i], perpendiculars[i + 1], directions[i]) for i in range(len(axes))]
        ),
        base=build_right_handed_frame(perpendiculars[0], directions[0], ends[0]),
        tool=frame_n.inverse() * flange,
        signs=tuple(used_signs),
    )


def _normalise_normal_part(vector: FloatArray, normal: FloatArray, fallback: FloatArray) -> FloatArray:
    """Return the normalised part (3,) of `vector` that is perpendicular to the unit vector `normal`.

    If `vector` is nearly parallel to `normal`, `fallback` (3,) is used in place of `vector`.
    """
    normal_part = vector - normal * float(vector @ normal)
    if np.linalg.norm(normal_part) < 0.5:
        normal_part = fallback - normal * float(fallback @ normal)
    return np.asarray(normal_part / np.linalg.norm(normal_part))


def _signed_angle(first: FloatArray, second: FloatArray, about: FloatArray) -> float:
    """Return the angle in (−π, π] [rad] from `first` to `second` about a unit vector normal to them."""
    angle = np.arctan2(cross(first, second) @ about, first @ second)
    # An angle of −π is returned as π, also where rounding made −π slightly greater.
    return float(angle if angle > _JUST_ABOVE_MINUS_PI else angle + 2.0 * np.pi)


def compare_links(
    identified: IdentifiedAxes, base: BaseFrame, flange: FlangeConvention, nominal: KinematicChain
) -> list[LinkComparison]:
    """Compare the link parameters of the nominal model with the identified link parameters.

    Differences of angles are within ±π [rad]. The result omits d and theta of the first and the last joint,
    which only express where R0 and the flange frame were placed.

    Raises:
        RobotError: the nominal model has another number of joints.
    """
    n = identified.n
    axes, nominal_flange = _get_nominal_axes(nominal, n)
    parallel = [
        bool(np.linalg.norm(cross(first.direction, second.direction)) < LEAST_SINE)
        for first, second in pairwise(axes)
    ]
    expected = compute_link_geometry(axes, nominal_flange, parallel)

    def compute_link_parameters(axes: Sequence[Axis], points: FloatArray) -> FloatArray:
        """Return the link parameters (5 n - 3,) in R0, from axes and targets in the tracker's frame."""
        T = base.place(axes)
        flange_pose = T * flange.place(axes, points)
        return compute_link_geometry(
            [axis.transform(T) for axis in axes], flange_pose, parallel, expected.signs
        ).parameters

    def compute_parameter_changes(axes: Sequence[Axis], points: FloatArray) -> FloatArray:
        """Return the link parameters of displaced axes and targets, minus the identified values (5 n - 3,).

        The arctangent removes full turns from angles; it leaves lengths unchanged, as the differences are far
        below π.
        """
        gap = compute_link_parameters(axes, points) - values
        return np.arctan2(np.sin(gap), np.cos(gap))

    values = compute_link_parameters(identified.axes, identified.targets)
    uncertainties = identified.compute_standard_uncertainties(
        identified.differentiate_quantity(compute_parameter_changes)
    )
    # Quantity and index of the joint of each parameter, in the order of `LinkGeometry.parameters`
    labels = [(quantity, i) for quantity in ("a", "alpha", "beta") for i in range(n - 1)]
    labels += [(quantity, i) for quantity in ("d", "theta") for i in range(n)]
    omitted = {(quantity, i) for quantity in ("d", "theta") for i in (0, n - 1)}
    # Between parallel axes d is zero by definition, between other axes beta.
    omitted |= {("d" if is_parallel else "beta", i) for i, is_parallel in enumerate(parallel)}
    differences = values - expected.parameters
    return [
        LinkComparison(
            quantity=quantity,
            joint=nominal.joint_names[joint],
            unit="m" if quantity in {"a", "d"} else "rad",
            nominal=nominal_value,
            identified=value,
            difference=gap if quantity in {"a", "d"} else np.arctan2(np.sin(gap), np.cos(gap)),
            standard_uncertainty=uncertainty if np.isfinite(uncertainty) else None,
        )
        for (quantity, joint), value, nominal_value, gap, uncertainty in zip(
            labels, values, expected.parameters, differences, uncertainties, strict=True
        )
        if (quantity, joint) not in omitted
    ]


class NearlyParallel(NamedTuple):
    """Neighbouring axes that are nearly parallel."""

    joint: str  # joint of the first axis
    angle: float  # angle between the axes [rad]
    made_parallel: bool  # whether the Denavit-Hartenberg table treats the axes as parallel


def build_dh_table(
    chain: KinematicChain, convention: Convention, *, parallel_within: float = PARALLEL_WITHIN
) -> tuple[IdentifiedDh, list[NearlyParallel]]:
    """Convert a chain to a Denavit-Hartenberg table: flange to R0 = base · T_1(q_1) … T_n(q_n) · tool.

    T_i is the transform of row i at joint angle q_i. `base` is the identity if axis 1 is z of R0; `tool` is
    the identity if the last axis is z of the flange.

    Args:
        chain: kinematic chain with revolute joints only.
        convention: standard, or modified (Craig).
        parallel_within: neighbouring axes at a smaller angle [rad] are made parallel; 0 gives an exact table.

    Returns:
        (table, nearly_parallel): the table, whose `deviation` [m] is the greatest displacement of the flange
        because axes were made parallel; and the pairs of neighbouring axes that are nearly parallel.
    """
    axes, flange = list_chain_axes(chain)
    table_axes, nearly_parallel, made_parallel = [axes[0]], [], []
    for i, axis in enumerate(axes[1:]):
        previous_direction = table_axes[-1].direction
        sine = float(np.linalg.norm(cross(previous_direction, axis.direction)))
        is_replaced = sine < parallel_within or sine == 0.0
        if sine < LEAST_SINE:
            angle = float(np.arcsin(sine))
            nearly_parallel.append(
                NearlyParallel(joint=chain.joint_names[i], angle=angle, made_parallel=is_replaced)
            )
        made_parallel.append(is_replaced)
        sense = np.sign(previous_direction @ axis.direction)
        table_axes.append(Axis.through(axis.point, sense * previous_direction) if is_replaced else axis)
    geometry = compute_link_geometry(table_axes, flange, made_parallel)
    # Row i of a modified table has a and alpha of the link before axis i; row i of a standard table has a and
    # alpha of the link behind axis i.
    padding = (1, 0) if convention == "modified" else (0, 1)
    a, alpha = np.pad(geometry.a, padding), np.pad(geometry.alpha, padding)
    lower, upper = zip(*(joint.limits or (None, None) for joint in chain.moving), strict=True)
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (_RANDOM_POSTURES, len(axes)))
    # Positions of the flange in random postures, with the exact axes and with the axes of the table
    exact_positions, table_positions = (
        Motion(each, flange.translation[None], angles).points for each in (axes, table_axes)
    )
    table = IdentifiedDh(
        convention=convention,
        rows=build_messages(
            DhRow, a=a, alpha=alpha, d=geometry.d, theta=geometry.theta, lower=lower, upper=upper
        ),
        base=to_rigid(geometry.base),
        tool=to_rigid(geometry.tool),
        deviation=float(np.linalg.norm(exact_positions - table_positions, axis=-1).max()),
    )
    return table, nearly_parallel
