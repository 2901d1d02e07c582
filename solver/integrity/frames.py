"""Frames and scales of positions, fitted in closed form as for tables without names (method.md §17)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.finding import FindingCode
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.integrity.explain import Correction
from jointstiff.solver.integrity.parts import name_axes
from jointstiff.solver.integrity.places import LARGEST_MODEL_ERROR, Places
from jointstiff.solver.integrity.values import InstrumentFrame, View
from jointstiff.solver.meaning.decision import (
    LARGEST_PART,
    LARGEST_RESIDUAL,
    LEAST_FREEDOM,
    LEAST_SHARE,
    MIRRORED_SIGNS,
    compute_plausible_scale_error,
)
from jointstiff.solver.meaning.refinement import RigidFit, fit_frame
from jointstiff.solver.meaning.screening import FlangePlaces, LinearFit, choose_subsets, fit_all
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import figure, length_text

_MOST_ROWS: Final = 150
_MOST_TARGETS: Final = 4
"""Targets that suffice to find a frame: those that were read most often."""
_SAME_AXES: Final = 0.03
"""Largest difference of a rotation from exchanged axes [rad]."""
_SIZES_OF_LENGTHS: Final = {"m": (1.0, 4), "mm": (1e-3, 1)}
"""Unit of a set's lengths → its size [m], and decimals that show a tenth of a millimetre."""
_LEAST_TURN: Final = 0.1
"""Least change of the flange's orientation [rad] that shows where the origin of a frame is."""
_BY_RESIDUAL: Final = 3.0
"""Least change of the positions by a scale, relative to the residual that is left."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """Frame of the positions in which the targets keep their places on the flange."""

    fit: RigidFit
    movement: float  # largest standard deviation of a coordinate [m]
    factor: float  # factor on the positions before the fit
    shown: FloatArray  # (D, 3) directions in R0 along which the postures show the place of the origin

    @property
    def origin(self) -> FloatArray:
        """Origin (3,) of the frame in R0 [m]; zero along the directions that the postures do not show."""
        return np.asarray(self.shown.T @ (self.shown @ self.fit.frame.origin))

    def apply(self, given: Measurements) -> Measurements:
        """Return measurements with positions in R0."""
        rotation = self.factor * self.fit.frame.rotation
        position = given.position @ rotation.T + self.fit.frame.origin
        read = given.present[..., None]
        return replace(
            given,
            position=np.where(read, position, 0.0),
            deflection=np.where(read, given.deflection @ rotation.T, 0.0),
        )


def list_frames(view: View) -> Iterator[Correction]:
    """Yield the frame in which the positions are, or the exchange of their axes.

    A flange that keeps its orientation, such as that of linear axes, does not show whether a frame or the
    targets are elsewhere: only a turn of the frame is named then.
    """
    found = _fit(view)
    if found is None:
        return
    axes, corrected = name_exchanged_axes(view, found), found.apply(view.measurements)
    mirrored = found.fit.frame.is_mirrored
    code: FindingCode = "frame_left_handed" if mirrored else "frame_mistaken"
    if axes is not None:
        cause = f"the axes of the positions are exchanged: x, y, z of R0 are {axes} of the readings"
        yield Correction(code, corrected, cause, "these axes", f"give the positions as {axes}")
    elif mirrored:
        yield _describe_left_handed(view, corrected)
    else:
        cause, remedy = _describe(view, found)
        yield Correction(code, corrected, cause, "this frame", remedy)


def name_exchanged_axes(view: View, found: _Frame) -> str | None:
    """Return which coordinates are x, y and z of R0, such as `z, y, −x`; None unless axes are exchanged.

    None for readings in a stated frame, whose axes are not those of R0.
    """
    nearest = np.round(found.fit.frame.rotation)
    is_exchange = np.abs(found.fit.frame.rotation - nearest).max() <= _SAME_AXES
    if view.frame is not None or not is_exchange or np.array_equal(nearest, np.eye(3)):
        return None
    if np.linalg.norm(found.origin) > 2.0 * LARGEST_MODEL_ERROR:
        return None
    return name_axes(nearest)


def _describe(view: View, found: _Frame) -> tuple[str, str]:
    """Return cause and remedy of positions in another frame, with the frame to state."""
    fitted = InstrumentFrame(found.fit.frame.rotation, found.origin)
    turn = np.degrees(np.arccos(np.clip(0.5 * (np.trace(fitted.rotation) - 1.0), -1.0, 1.0)))
    distance = length_text(float(np.linalg.norm(fitted.translation)))
    against = "R0" if view.frame is None else "the stated `frame`"
    cause = (
        f"the positions are not in R0: they are in a frame that is turned by {turn:.3g}° against {against}"
    )
    fitted, stated = fitted.after(view.frame), "state the `frame` of the readings"
    rows = ", ".join(f"[{', '.join(f'{each:.5f}' for each in row)}]" for row in fitted.rotation)
    if len(found.shown) < 3:
        fitting = f"`rotation` [{rows}] fits, and these orientations of the flange do not show `translation`"
        return cause, f"{stated}: {fitting}, or identify the frame by `geometry`"
    cause += f", and whose origin is {distance} from that of {against}"
    inverse = None if view.frame is None else view.frame.inverse
    if inverse is not None and _are_alike(fitted, inverse):
        fitted, stated = inverse, "state the `frame` from the readings to R0"
        cause = "the stated `frame` is the inverse: it leads from R0 to the frame of the readings"
        rows = ", ".join(f"[{', '.join(f'{each:.5f}' for each in row)}]" for row in fitted.rotation)
    size, digits = _SIZES_OF_LENGTHS[view.length_unit]
    place = ", ".join(f"{each / size:.{digits}f}" for each in fitted.translation)
    fitting = f"`rotation` [{rows}] and `translation` [{place}] {view.length_unit} fit"
    return cause, f"{stated}: {fitting}, or identify the frame by `geometry`"


def _are_alike(first: InstrumentFrame, second: InstrumentFrame) -> bool:
    """Return whether two frames differ by no more than the error of a fit."""
    distance = float(np.linalg.norm(first.translation - second.translation))
    is_same_turn = np.abs(first.rotation - second.rotation).max() <= _SAME_AXES
    return bool(is_same_turn and distance <= 2.0 * LARGEST_MODEL_ERROR)


def _describe_left_handed(view: View, corrected: Measurements) -> Correction:
    """Return the correction of positions in a left-handed frame; the arm may be mirrored instead.

    An arm whose axes are in a plane at zero is its own mirror image after the signs of joints 1, 4 and 6 are
    reversed: the readings then fit as well in a right-handed frame, and cannot decide.
    """
    cause = "the positions are in a left-handed frame"
    remedy = "reverse the sign of y of all positions, and check the set again, which then states its frame"
    if view.robot.n == len(MIRRORED_SIGNS):
        mirrored = replace(view.measurements, joints=view.measurements.joints * MIRRORED_SIGNS)
        twin = _fit(replace(view, measurements=mirrored))
        if twin is not None and not twin.fit.frame.is_mirrored:
            names = ", ".join(np.array(view.robot.joint_names)[MIRRORED_SIGNS < 0.0])
            cause += f", or {names} are reversed and the positions are in another frame than R0"
            remedy += f"; or, if the axes of the instrument are right, change the signs of {names}"
    return Correction("frame_left_handed", corrected, cause, "one axis of the positions reversed", remedy)


def list_scales(view: View) -> Iterator[Correction]:
    """Yield the factor by which all lengths differ from those of the model, if arms differ by less."""
    found = _fit(view, scale_is_free=True)
    if found is None:
        return
    change, plausible = abs(found.factor - 1.0), compute_plausible_scale_error(found.movement)
    is_clear = change > plausible and change * found.movement > _BY_RESIDUAL * found.fit.typical
    if is_clear and np.allclose(found.fit.frame.rotation, np.eye(3), atol=_SAME_AXES):
        yield Correction(
            "lengths_differ",
            found.apply(view.measurements),
            f"the lengths of the readings are {figure(1.0 / found.factor)} times those of the robot's "
            "model, all alike; "
            f"up to {100 * plausible:.1g} % is plausible",
            "this factor",
            "check which robot was measured, and the scale of the tracker: its unit, its scale bar, "
            "temperature and air "
            "pressure",
        )


def measure_residual(robot: Robot, given: Measurements, found: Places) -> float:
    """Return the residual [m] of the rows that a robot explains after a fit of R0; infinite if R0 is off."""
    postures = Postures(robot, robot.joint_map.model_angles(given.joints[found.near]))
    read = (given.present & ~given.in_flange)[found.near]
    points = np.where(read[..., None], given.position[found.near], np.nan)[:, np.isfinite(found.flange[:, 0])]
    targets = found.flange[np.isfinite(found.flange[:, 0])]
    fit = fit_frame(postures.flange_rotation, postures.flange_translation, points, np.eye(3), targets)
    decides = fit.degrees_of_freedom >= LEAST_FREEDOM and fit.frame.is_base
    return fit.residual if decides else float("inf")


def _fit(view: View, *, scale_is_free: bool = False) -> _Frame | None:
    """Fit the frame of the positions; return None if the targets do not keep their places."""
    rows = np.flatnonzero(view.measured.any(axis=1))
    sample = rows[np.unique(np.linspace(0, len(rows) - 1, _MOST_ROWS).round().astype(int))]
    most_read = np.argsort(-view.measured[sample].sum(axis=0), kind="stable")[:_MOST_TARGETS]
    known = view.measured[np.ix_(sample, most_read)]
    if known.sum() * 3 < LEAST_FREEDOM + 12 + 3 * len(most_read):
        return None
    points = np.where(known[..., None], view.measurements.position[np.ix_(sample, most_read)], np.nan)
    points = points[:, known.any(axis=0)]
    rotation, place = view.postures.flange_rotation[sample], view.postures.flange_translation[sample]
    linear = _fit_linear(rotation, place, points)
    if linear is None:
        return None
    fit = fit_frame(rotation, place, points, linear.matrix, linear.targets)
    factor = fit.free_scale if scale_is_free else 1.0
    if scale_is_free:
        fit = fit_frame(rotation, place, factor * points, linear.matrix / factor, linear.targets)
    movement = fit.frame.scale * float(np.nanstd(points - np.nanmean(points, axis=0), axis=0).max())
    share = float(np.mean(fit.distances[np.isfinite(fit.distances)] <= 2.0 * LARGEST_RESIDUAL))
    is_near = fit.typical <= min(LARGEST_RESIDUAL, LARGEST_PART * movement) and share >= LEAST_SHARE
    if not is_near or fit.degrees_of_freedom < LEAST_FREEDOM or fit.unit != "m":
        return None
    # Origin and targets can be moved together along a direction that all rotations of the flange keep.
    changes = (rotation - rotation[0]).swapaxes(1, 2).reshape(-1, 3)
    _, sizes, directions = np.linalg.svd(changes, full_matrices=False)
    return _Frame(fit, movement, factor, directions[sizes > _LEAST_TURN * np.sqrt(len(rotation))])


def _fit_linear(rotation: FloatArray, place: FloatArray, points: FloatArray) -> LinearFit | None:
    """Fit positions (M, K, 3) in closed form, in all rows and in subsets of them; return the best fit."""
    fits: list[LinearFit] = []
    for chosen in (np.arange(len(points)), *choose_subsets(len(points))):
        flange = FlangePlaces(rotation[None, chosen], place[None, chosen])
        found = fit_all(flange.stack_columns(points.shape[1]), points[chosen])
        if found and found[0].residual < LARGEST_RESIDUAL:
            return found[0]
        fits += found
    return min(fits, key=lambda fit: fit.residual, default=None)
