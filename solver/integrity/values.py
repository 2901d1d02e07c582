"""Numbers that no robot, tracker or controller gives: units, limits, loads, names, copies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jointstiff.solver.finding import M_AS_MM, MM_AS_M, NOISE_SIGMAS, Finding, length_text
from jointstiff.solver.integrity.view import View

LARGEST_DEFLECTION: Final = 0.02
"""Largest plausible deflection [m]: more is a mistake in a unit or a label."""
SMALLEST_DEFLECTION: Final = 5e-6
"""Smallest deflection that a tracker sees [m]; if all are smaller, the lengths have another unit."""
LARGEST_SIGMA: Final = 1e-3
"""Largest standard uncertainty of a tracker [m]."""
FLANGE_LENGTHS: Final = (2e-3, 10.0)
"""Load points and targets in the flange frame [m]: none is as near the flange as all of a set in metres
taken for millimetres would be, none as far as in the other case."""
FORCES: Final = (5.0, 5e4)
"""Plausible forces [N]: less deflects nothing, more is twice the payload of the largest robots."""
RARE_TARGET: Final = 0.1
"""Share of observations below which a target's name is likely misspelt."""
_LIMIT_MARGIN: Final = 1e-3
_MANY_TURNS: Final = 4 * np.pi
_SMALL_DEGREES: Final = 2 * np.pi
_NUMBERS_OF_CHANCE: Final = 3
"""Number of values that may agree in two observations by chance, when rounded."""


def inspect_values(view: View) -> Iterator[Iterator[Finding]]:
    """Look at the numbers as such, without asking how they hang together."""
    yield _angle_unit(view)
    yield _limits(view)
    yield _rare_targets(view)
    yield _sigma(view)
    yield _zero_load(view)
    yield _force_unit(view)
    yield _flange_lengths(view)
    yield _size(view)
    yield _below_noise(view)
    yield _duplicates(view)


def _angle_unit(view: View) -> Iterator[Finding]:
    largest = float(np.abs(view.measurements.joints).max())
    if not view.degrees and largest > _MANY_TURNS:
        yield Finding(
            "angle_unit_suspect",
            None,
            f"the largest joint angle is {largest:.4g} rad, more than two turns",
            "set `units.angle` to deg: the angles look like degrees",
            "error",
        )
    posted = float(np.rad2deg(largest))
    if view.degrees and 0 < posted <= _SMALL_DEGREES and len(view.measurements) > 1:
        yield Finding(
            "angle_unit_suspect",
            None,
            f"no joint turns by more than {posted:.3g}° in {len(view.measurements)} observations",
            "set `units.angle` to rad: the angles look like radians",
            "error",
        )


def _limits(view: View) -> Iterator[Finding]:
    robot = view.robot
    q = robot.joint_map.model_angles(view.measurements.joints)
    lower, upper = robot.limits.T
    outside = (q < lower - _LIMIT_MARGIN) | (q > upper + _LIMIT_MARGIN)
    for i, j in zip(*np.nonzero(outside), strict=True):
        yield Finding(
            "joint_outside_limits",
            int(i),
            f"the model angle of {robot.joint_names[j]} is {q[i, j]:.4g} rad, outside its limits "
            f"[{lower[j]:.4g}, {upper[j]:.4g}] rad",
            "check `units.angle`, the joint map, and the order of the angles",
        )


def _rare_targets(view: View) -> Iterator[Finding]:
    present = view.measurements.present
    count = present.sum(axis=0)
    for t in np.flatnonzero(count < RARE_TARGET * len(present)):
        yield Finding(
            "target_name_suspect",
            int(np.flatnonzero(present[:, t])[0]),
            f"target '{view.targets[t]}' is read in only {count[t]} of {len(present)} observations",
            "check the spelling of its name",
        )


def _sigma(view: View) -> Iterator[Finding]:
    sigma = view.measurements.sigma
    if sigma is not None and sigma > LARGEST_SIGMA:
        yield Finding(
            "sigma_suspect",
            None,
            f"the stated standard uncertainty of a reading is {length_text(sigma)}, more than any tracker's",
            "check the stated noise: it is in `units.length`",
            "error",
        )


def _zero_load(view: View) -> Iterator[Finding]:
    for i in np.flatnonzero(~view.loaded):
        yield Finding(
            "zero_load",
            int(i),
            "force and moment are zero, so the observation carries no information on stiffness",
            "give the load, or remove the observation",
        )


def _force_unit(view: View) -> Iterator[Finding]:
    sizes = np.linalg.norm(view.measurements.force, axis=1)
    if not sizes.any():
        return
    typical, (least, greatest) = float(np.median(sizes[sizes > 0.0])), FORCES
    if typical > greatest or (typical < least and not view.measurements.moment.any()):
        yield Finding(
            "force_unit_suspect",
            None,
            f"the median force is {typical:.3g} N, outside the plausible {least:g} N to {greatest:g} N",
            "check `units.force`: kN read as N, or N as kN? (kgf read as N is not detected)",
            "error",
        )


def _flange_lengths(view: View) -> Iterator[Finding]:
    m = view.measurements
    lengths = np.concatenate(
        [
            np.linalg.norm(m.load_point, axis=1),
            np.linalg.norm(m.position, axis=2)[m.present & m.in_flange],
        ]
    )
    greatest, (near, far) = float(lengths.max()), FLANGE_LENGTHS
    if greatest > far or 0.0 < greatest < near:
        yield Finding(
            "length_unit_suspect",
            None,
            f"the load points and targets given in the flange frame are up to {length_text(greatest)} "
            "from it",
            MM_AS_M if greatest > far else M_AS_MM,
            "error",
        )


def _size(view: View) -> Iterator[Finding]:
    length = np.linalg.norm(view.measurements.deflection, axis=2)
    for i in np.flatnonzero(length.max(axis=1) > LARGEST_DEFLECTION):
        t = int(length[i].argmax())
        yield Finding(
            "deflection_implausibly_large",
            int(i),
            f"target '{view.targets[t]}' moved by {length_text(length[i, t])}",
            "check `units.length`, and that unloaded and loaded readings belong together",
            "error",
        )
    if length.max() < SMALLEST_DEFLECTION and view.loaded.any():
        yield Finding(
            "deflection_implausibly_small",
            None,
            f"no target moved by more than {length_text(float(length.max()))}",
            "check `units.length`, and that the loaded readings were taken with the load applied",
            "error",
        )


def _below_noise(view: View) -> Iterator[Finding]:
    noise = np.sqrt(2.0) * (view.measurements.sigma or 0.0)
    length = np.linalg.norm(view.measurements.deflection, axis=2).max(axis=1)
    for i in np.flatnonzero((length <= NOISE_SIGMAS * noise) & view.loaded):
        yield Finding(
            "deflection_below_noise",
            int(i),
            f"no target moved by more than {length_text(length[i])}; the noise of a deflection is "
            f"{length_text(noise)}",
            "increase the load; check that the loaded readings were taken with the load applied, and "
            "check the stated noise",
        )


def _duplicates(view: View) -> Iterator[Finding]:
    """Two measurements never agree in every digit: a row that does is a copy."""
    m = view.measurements
    count = len(m)
    read = np.concatenate([m.position * view.measured[..., None], m.deflection], axis=1).reshape(count, -1)
    first: dict[bytes, int] = {}
    for i, key in enumerate(row.tobytes() for row in read + 0.0):  # no negative zeros
        j = first.setdefault(key, i)
        few = np.count_nonzero(read[i]) <= _NUMBERS_OF_CHANCE
        if j == i or (few and not np.array_equal(m.joints[i], m.joints[j])):
            continue
        same = "joint angles and " if np.array_equal(m.joints[i], m.joints[j]) else ""
        yield Finding(
            "duplicated_observation",
            i,
            f"its {same}readings equal those of observations[{j}] to the last digit",
            "remove one of the two, or give the readings that belong to it",
            "error",
        )
