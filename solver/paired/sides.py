"""Two campaigns with one kind of robot, and which of their configurations are the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

POSTURE_TOLERANCE: Final = 1e-3
"""Tolerance of each joint angle [rad]: it changes a lever of 3 m by a thousandth."""
LOAD_TOLERANCE: Final = 5e-3
"""Tolerance of the load, relative to its magnitude."""
LOAD_POINT_TOLERANCE: Final = 1e-3
"""Tolerance of the load point [m]."""
_MODEL_TOLERANCE: Final = 1e-9


@dataclass(frozen=True, eq=False)
class PairSide:
    """One of the two campaigns."""

    robot: Robot  #: n joints
    measurements: Measurements  #: N observations of T targets
    settings: Settings  #: how to identify


@dataclass(frozen=True, eq=False)
class Matches:
    """Observations of the same posture under the same load, in both campaigns."""

    first: IndexArray  #: (K,) their indices in the first campaign
    second: IndexArray  #: (K,) in the second
    present: BoolArray  #: (K, T) targets read in both; targets are those of both campaigns
    targets_first: IndexArray  #: (T,) index of each shared target in the first campaign
    targets_second: IndexArray  #: (T,) in the second
    unlike: tuple[str, ...]  #: labels that both have, with another posture or load, or no shared target


def refuse_other_joints(first: Robot, second: Robot) -> None:
    """Refuse robots whose joints do not correspond.

    Raises:
        RequestError: they differ in number or names.
    """
    if first.joint_names != second.joint_names:
        raise RequestError(
            f"the robots have different joints: {', '.join(first.joint_names)}, and "
            f"{', '.join(second.joint_names)}",
            where="second",
            remedy="compare sets of one robot, or of two robots of the same model with the same joint names",
        )


def models_differ(first: Robot, second: Robot) -> bool:
    """Return whether two robots of the same joints differ in geometry or joint map, seen in two postures."""
    postures = np.stack([np.zeros(first.n), np.linspace(0.3, 1.1, first.n)])
    angles = [robot.joint_map.model_angles(postures) for robot in (first, second)]
    one, two = Configurations(first, angles[0]), Configurations(second, angles[1])
    return any(
        bool((np.abs(a - b) > _MODEL_TOLERANCE).any())
        for a, b in (
            (angles[0], angles[1]),
            (one.jacobian, two.jacobian),
            (one.flange_rotation, two.flange_rotation),
            (one.flange_translation, two.flange_translation),
        )
    )


def match(first: PairSide, second: PairSide) -> Matches:
    """Find the observations of equal label, posture and load that share a target."""
    one, two = first.measurements, second.measurements
    shared = [name for name in one.targets if name in two.targets]
    t1 = np.array([one.targets.index(name) for name in shared], dtype=np.intp)
    t2 = np.array([two.targets.index(name) for name in shared], dtype=np.intp)
    place = {label: i for i, label in enumerate(two.labels)}
    pairs = [(i, place[label]) for i, label in enumerate(one.labels) if label in place]
    rows = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    along, other = (np.zeros(m.position.shape) if m.direction is None else m.direction for m in (one, two))
    along, other = along[rows[:, :1], t1], other[rows[:, 1:], t2]
    cosine = np.abs((along * other).sum(axis=-1))  # a gauge on the flange turns with the postures
    alike = (cosine > np.cos(2.0 * POSTURE_TOLERANCE)) | ~(along.any(axis=-1) | other.any(axis=-1))
    present = one.present[rows[:, :1], t1] & two.present[rows[:, 1:], t2] & alike
    kept = np.flatnonzero(_alike(one, two, rows) & present.any(axis=1))
    dropped = np.setdiff1d(np.arange(len(rows)), kept)
    return Matches(
        first=rows[kept, 0],
        second=rows[kept, 1],
        present=present[kept],
        targets_first=t1,
        targets_second=t2,
        unlike=tuple(one.labels[i] for i in rows[dropped, 0]),
    )


def _alike(one: Measurements, two: Measurements, rows: IndexArray) -> BoolArray:
    """(K,) whether postures and loads of the paired observations (K, 2) agree."""
    i, k = rows.T
    posture = np.abs(one.joints[i] - two.joints[k]).max(axis=1) <= POSTURE_TOLERANCE
    place = np.linalg.norm(one.load_point[i] - two.load_point[k], axis=1) <= LOAD_POINT_TOLERANCE
    alike = posture & (place | ~one.force[i].any(axis=1))
    for a, b in ((one.force[i], two.force[k]), (one.moment[i], two.moment[k])):
        size = np.maximum(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1))
        alike &= np.linalg.norm(a - b, axis=1) <= LOAD_TOLERANCE * size
    return np.asarray(alike, dtype=np.bool_)
