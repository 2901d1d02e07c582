"""Mistaken joint positions: signs, exchanged columns, shifted rows, other countings, zeros."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from jointstiff.schemas.finding import AdvisedAction, FindingCode
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.integrity.explain import BETTER, LEAST_ROWS_OF_MANY, Correction
from jointstiff.solver.integrity.places import (
    LARGEST_MODEL_ERROR,
    change_positions,
    compute_median_places,
    greatest_distances,
    see_from_flange,
)
from jointstiff.solver.integrity.response import Springs
from jointstiff.solver.integrity.values import View, median
from jointstiff.solver.mechanics.block import get_whole_block
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import figure

_MOST_REVERSED: Final = 7
"""Most joints of a robot for which all sets of reversed joints are tried."""
_LARGEST_ZERO: Final = 0.1
"""Largest error of a joint's zero that is searched [rad]: quarter turns are searched elsewhere."""
_LEAST_ZERO: Final = 5e-3
"""Least error of a joint's zero that is reported [rad]: marks and gauges set zeros to a tenth of it."""


_COUPLED: Final = ((-1.0, "minus"), (1.0, "plus"))
"""Sign and word of the angle of joint 2 in that of joint 3."""

LinearMap = tuple[FloatArray, FloatArray]
"""Matrix (n, n) and offset (n,) of joint positions."""


def list_joint_mistakes(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield signs, exchanged columns, shifted rows, a transposed array, and other countings of the joints."""
    yield from (_reverse(robot, given, [joint]) for joint in range(robot.n))
    yield from _list_exchanged_columns(robot, given)
    yield from _list_shifted_rows(robot, given)
    if robot.prismatic.any() or len(given) < LEAST_ROWS_OF_MANY:
        return
    for count in range(2, robot.n + 1 if robot.n <= _MOST_REVERSED else 2):
        yield from (_reverse(robot, given, joints) for joints in combinations(range(robot.n), count))
    yield from _list_countings(robot, given)


def _map_joints(
    code: FindingCode, robot: Robot, given: Measurements, joint_map: LinearMap, change: str, remedy: str
) -> Correction:
    """Return the correction of joint positions q to M q + b, with the action of another joint map."""
    matrix, offset = joint_map
    joints = given.joints @ matrix.T + offset
    return Correction(
        code, replace(given, joints=joints), "", change, remedy, advise_joint_map(robot, matrix, offset)
    )


def _reverse(robot: Robot, given: Measurements, joints: Sequence[int]) -> Correction:
    """Return the correction of joints with the wrong sign."""
    words = ", ".join(robot.joint_names[joint] for joint in joints)
    noun = "the sign of the angle of" if len(joints) == 1 else "the signs of the angles of"
    signs = np.where(np.isin(np.arange(robot.n), joints), -1.0, 1.0)
    remedy = f"change the sign of {words} in every observation, or in the joint map"
    change = f"{noun} {words} reversed"
    return _map_joints(
        "joint_sign_suspect", robot, given, (np.diag(signs), np.zeros(robot.n)), change, remedy
    )


def _list_exchanged_columns(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield exchanged columns of two joints, and rows taken for columns."""
    names = robot.joint_names
    for j, k in combinations(range(robot.n), 2):
        order = np.arange(robot.n)
        order[[j, k]] = k, j
        yield Correction(
            "joints_swapped",
            replace(given, joints=given.joints[:, order]),
            "",
            f"the angles of {names[j]} and {names[k]} exchanged",
            f"exchange the columns of {names[j]} and {names[k]} in every observation",
            AdvisedAction.of("exchange_columns", joints=(names[j], names[k])),
        )
    if len(given) == robot.n:  # only a square array hides that it is transposed
        change = "rows and columns of the joints exchanged"
        remedy = "transpose the array of the joints: a row for each observation, a column for each joint"
        yield Correction("joints_swapped", replace(given, joints=given.joints.T.copy()), "", change, remedy)


def _list_shifted_rows(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield the angles of the row before, and of the row after."""
    rows = np.arange(len(given))
    for shift, neighbour in ((-1, "before"), (1, "after")):
        kept = rows[(rows + shift >= 0) & (rows + shift < len(rows))]
        if len(kept):
            side, remedy = _name_shifted_side(robot, given, kept, shift)
            yield Correction(
                "observations_out_of_order",
                change_positions(given[kept], joints=given.joints[kept + shift]),
                "",
                f"the angles of the row {neighbour}{side}",
                remedy or f"shift the readings by one row: each belongs to the angles of the row {neighbour}",
            )


def _list_countings(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield joints counted from the other end, joint 3 counted with joint 2, and zeros right angles away."""
    names, n = robot.joint_names, robot.n
    eye, none = np.eye(n), np.zeros(n)
    remedy = f"reverse the order of the columns: {names[-1]} was given as {names[0]}, and so on"
    yield _map_joints(
        "joints_swapped", robot, given, (eye[::-1], none), "the joints in reverse order", remedy
    )
    for sign, word in _COUPLED if n > 2 else ():
        matrix = np.eye(n)
        matrix[2, 1] = sign
        change = f"{names[2]} {word} {names[1]} as the angle of {names[2]}"
        remedy = f"use the suggested joint map: the controller counts {names[2]} together with {names[1]}"
        yield _map_joints("joints_counted_otherwise", robot, given, (matrix, none), change, remedy)
    half_turns = np.where(given.joints.mean(axis=0) > 0.0, -180, 180)  # towards zero, within the limits
    for joint in range(n):
        for turn in (-90, 90, int(half_turns[joint])):
            offset = np.radians(turn) * eye[joint]
            change = f"{turn:+d}° added to {names[joint]}"
            remedy = f"use the suggested joint map: the zero of {names[joint]} is {abs(turn)}° away"
            yield _map_joints("joints_counted_otherwise", robot, given, (eye, offset), change, remedy)


def list_joint_maps(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield joint maps with reversed joints and joint 3 counted together with joint 2."""
    names, n = robot.joint_names, robot.n
    if robot.prismatic.any() or not 2 < n <= _MOST_REVERSED or len(given) < LEAST_ROWS_OF_MANY:
        return
    for (sign, word), count in product(_COUPLED, range(1, n + 1)):
        for joints in combinations(range(n), count):
            matrix = np.diag(np.where(np.isin(np.arange(n), joints), -1.0, 1.0))
            matrix[2, 1] = sign
            words = ", ".join(names[joint] for joint in joints)
            yield _map_joints(
                "joints_counted_otherwise",
                robot,
                given,
                (matrix, np.zeros(n)),
                f"{words} reversed, and the angle of {names[2]} taken {word} that of {names[1]}",
                "use the suggested joint map: check signs and coupling against the controller's manual",
            )


def _name_shifted_side(robot: Robot, given: Measurements, kept: IndexArray, shift: int) -> tuple[str, str]:
    """Return cause and remedy of shifted rows; empty unless springs show to which side the forces belong."""
    if not given.force.any() or int(given[kept].coordinates.sum()) < 6 * robot.n:
        return "", ""
    by_readings = replace(given[kept], joints=given.joints[kept + shift])
    by_angles = replace(by_readings, force=given.force[kept + shift], moment=given.moment[kept + shift])
    readings, angles = (
        Springs.fit(get_whole_block(robot, each)).unexplained for each in (by_readings, by_angles)
    )
    if min(readings, angles) > BETTER * max(readings, angles):
        return "", ""
    is_up = (shift > 0) == (readings < angles)
    direction, end = ("up", "last") if is_up else ("down", "first")
    way = f"{direction} by one row, and leave out the {end} observation"
    if readings < angles:
        return (
            "; the forces belong to the readings, so that the angles are shifted",
            f"move the joint angles alone {way}",
        )
    return "; the forces belong to the angles, so that the readings are shifted", f"move all readings {way}"


def advise_joint_map(robot: Robot, matrix: FloatArray, offset: FloatArray) -> AdvisedAction:
    """Return the action that corrects joint positions q to M q + b by another joint map."""
    joint_map = robot.joint_map
    changed = np.abs(matrix - np.eye(len(matrix))).any(axis=1) | (offset != 0.0)
    return AdvisedAction.of(
        "apply_joint_map",
        joints=[robot.joint_names[joint] for joint in np.flatnonzero(changed)],
        joint_map=(joint_map.matrix @ matrix).tolist(),
        offset=(joint_map.matrix @ offset + joint_map.offset).tolist(),
    )


def list_missing_signs(view: View) -> Iterator[Correction]:
    """Yield the angles with those signs in each row that bring most rows to the same places."""
    robot, given = view.robot, view.measurements
    if (
        robot.n > _MOST_REVERSED
        or len(given) < LEAST_ROWS_OF_MANY
        or robot.prismatic.any()
        or (given.joints < 0.0).any()
    ):
        return
    signs = np.array(list(product((1.0, -1.0), repeat=robot.n)))
    seen = np.stack(
        [see_from_flange(_pose(robot, given.joints * each), given)[0] for each in signs]
    )  # (S, N, 2, T, 3)
    anchors = (seen[:, 0, 0]).reshape(-1, *seen.shape[-2:])  # places of the first row with each of its signs
    by_anchor = [np.stack([greatest_distances(each, places) for each in seen]) for places in anchors]
    best = max(by_anchor, key=lambda distances: int((distances.min(axis=0) <= LARGEST_MODEL_ERROR).sum()))
    yield Correction(
        "joint_sign_suspect",
        replace(given, joints=given.joints * signs[best.argmin(axis=0)]),
        "no joint angle is negative, and the signs are missing",
        "signs of each observation's own",
        "give the angles of all observations with their signs",
    )


def _pose(robot: Robot, joints: FloatArray) -> Postures:
    return Postures(robot, robot.joint_map.model_angles(joints))


def list_zeros(view: View) -> Iterator[Correction]:
    """Yield the best zero of each joint but the last, which turns all targets alike."""
    robot, given = view.robot, view.measurements
    some = given[np.unique(np.linspace(0, len(given) - 1, 150).round().astype(int))]
    for joint in np.flatnonzero(~robot.prismatic[:-1]).tolist():
        direction = np.eye(robot.n)[joint]

        def measure(offset: float, direction: FloatArray = direction) -> float:
            seen, _ = see_from_flange(_pose(robot, some.joints + offset * direction), some)
            places = compute_median_places(seen.reshape(-1, *seen.shape[-2:]))
            return median(greatest_distances(seen, places))

        bounds = (-_LARGEST_ZERO, _LARGEST_ZERO)
        offset = float(minimize_scalar(measure, bounds=bounds, method="bounded", options={"xatol": 1e-5}).x)
        if abs(offset) < _LEAST_ZERO:
            continue
        name = robot.joint_names[joint]
        unit, size = ("°", np.degrees(offset)) if view.degrees else (" rad", offset)
        yield Correction(
            "joints_counted_otherwise",
            replace(given, joints=given.joints + offset * direction),
            "",
            f"{figure(size, '.2g')}{unit} added to {name} in every observation",
            f"check the zero of {name}, its mastering or its offset in the joint map",
            advise_joint_map(robot, np.eye(robot.n), offset * direction),
        )
