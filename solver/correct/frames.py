"""Poses and joints of one path: whether they agree, and the frames with which they would agree.

A pose X of the tool in the base, joints q, the tool T in the flange frame and the base B in R0 belong
together if ``F(q) = B X T⁻¹``, with F the forward kinematics. A controller whose world or flange frame
differs gives ``F(q) = W (B X T⁻¹) V`` with constant W and V. They follow from some poses by least squares:
first the rotations, a linear problem in both together, then the translations (Shah, *Solving the
robot-world/hand-eye calibration problem using the Kronecker product*, 2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from math import ceil, log10
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.postures import Postures, rotation_vectors
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import figure

AGREED_DISTANCE: Final = 0.5e-3
"""Distance between a pose and its joints that rounded numbers can cause [m]."""
AGREED_ANGLE: Final = 2e-3
"""Angle between a pose and its joints that rounded numbers can cause [rad]."""
_MOST_ROWS: Final = 200
"""Rows from which frames are proposed."""
_LEAST_ROWS: Final = 3
"""Rows that are needed before an agreement of frames is no coincidence."""
_LEAST_AGREEMENT: Final = 0.9
"""Fraction of the rows that agree with a proposal; single other rows may have a mistake of their own."""
_MOST_FITS: Final = 10
"""Fits of a frame, each without the rows that agree least with the fit before."""
_MOST_NAMED_ROWS: Final = 5
"""Rows that a message names."""
_DEFINITE: Final = 1e-3
"""Ratio of singular values below which the orientations do not determine a frame."""
_ANGLES: Final = {
    "degrees where radians are stated": np.pi / 180.0,
    "radians where degrees are stated": 180.0 / np.pi,
}
_FAR_UNIT: Final = 0.02
"""Ratio of the differences with the right and with the stated unit of lengths that shows a mistaken unit."""
_NEARLY: Final = 0.02
"""Greatest difference [m] of poses and joints that may remain with the right unit of lengths."""
_LENGTHS: Final = {
    "mm where m are stated": 1e-3,
    "m where mm are stated": 1e3,
    "inches where mm are stated": 25.4,
    "mm where inches are stated": 1.0 / 25.4,
}
_ORIENTATIONS: Final = {
    "ZYX": "A, B, C of KUKA (about z, y′, x″)",
    "xyz": "W, P, R of FANUC (about x, y, z of the base: roll, pitch, yaw)",
    "XYZ": "Rx, Ry, Rz of Stäubli (about x, y′, z″)",
    "ZYZ": "O, A, T of Kawasaki (about z, y′, z″)",
}
"""Order of three angles, as SciPy names it → controller that shows such angles."""
_POSITION: Final = ("x", "y", "z")
_ROTATION: Final = ("rx", "ry", "rz")
_OTHER_ORDERS: Final = tuple(permutations(range(3)))[1:]
"""Orders of three columns other than their own."""
_WHOLE_TURNS: Final = (0.0, -1.0, 1.0, -2.0)
"""Whole turns by which a vector of three angles, up to 360° each, may be longer than its rotation vector."""


@dataclass(frozen=True, eq=False)
class FrameGaps:
    """Differences between N poses and the poses of their joints."""

    distance: FloatArray  #: (N,) [m]
    angle: FloatArray  #: (N,) [rad]

    @classmethod
    def measure(cls, wanted: FloatArray, reached: Postures) -> FrameGaps:
        """Measure how far flange poses (N, 4, 4) [m] are from the flange of N postures."""
        distance = np.linalg.norm(reached.flange_translation - wanted[:, :3, 3], axis=1)
        vectors = rotation_vectors(wanted[:, :3, :3], reached.flange_rotation)
        return cls(np.asarray(distance), np.asarray(np.linalg.norm(vectors, axis=1)))

    @property
    def agree(self) -> BoolArray:
        """(N,) mask of the rows whose pose and joints agree."""
        return np.asarray((self.distance <= AGREED_DISTANCE) & (self.angle <= AGREED_ANGLE))

    def select(self, rows: BoolArray) -> FrameGaps:
        """Return the differences of some rows, by their mask (N,)."""
        return FrameGaps(self.distance[rows], self.angle[rows])

    @property
    def size(self) -> FloatArray:
        """(N,) differences relative to those that rounding can cause."""
        return self.distance / AGREED_DISTANCE + self.angle / AGREED_ANGLE


class Decimals(NamedTuple):
    """Decimals with which a pose is shown."""

    lengths: int  # of lengths in mm
    angles: int  # of angles in degrees

    @classmethod
    def from_gaps(cls, gaps: FrameGaps) -> Decimals:
        """Return the decimals above the residual: digits below it are noise of the rows."""
        distance = 1e3 * np.sqrt(np.mean(np.square(gaps.distance)))
        angle = np.degrees(np.sqrt(np.mean(np.square(gaps.angle))))
        return cls(_count_decimals(distance, FINEST.lengths), _count_decimals(angle, FINEST.angles))

    def list_finer(self) -> list[Decimals]:
        """Return these decimals and all finer ones, those with fewest digits first."""
        finer = [
            Decimals(lengths, angles)
            for lengths, angles in product(
                range(self.lengths, FINEST.lengths + 1), range(self.angles, FINEST.angles + 1)
            )
        ]
        return sorted(finer, key=lambda each: (each.lengths + each.angles, each.angles))

    def round_pose(self, pose: FloatArray) -> FloatArray:
        """Return the rounded numbers (6,) of a pose (4, 4) [m]: position [mm], rotation vector [deg]."""
        position = np.round(1e3 * pose[:3, 3], self.lengths)
        vector = np.round(Rotation.from_matrix(pose[:3, :3]).as_rotvec(degrees=True), self.angles)
        return np.concatenate([position, vector]) + 0.0  # no negative zero


FINEST: Final = Decimals(lengths=4, angles=5)
"""Decimals that a controller shows at most."""


def _count_decimals(size: float, most: int) -> int:
    """Return the most decimals, up to `most`, whose last digit is not less than a size."""
    if size < 10.0**-most:
        return most
    return max(0, -ceil(log10(size)))


@dataclass(frozen=True, eq=False)
class FrameProposal:
    """Tool, base and units with which poses and joints agree."""

    #: what is probably wrong: `joints`, `lengths` or both, `units`, for their unit, `orientation` for angles
    #: that were read as a rotation vector, `columns` for columns in another order, or the frames
    cause: Literal["joints", "lengths", "units", "orientation", "columns", "base", "tool", "base_and_tool"]
    tool: FloatArray  #: (4, 4) tool in the flange frame [m]
    base: FloatArray  #: (4, 4) base in R0 [m]
    unit: str = ""  #: words for the units, such as `mm where m are stated`, if a unit is wrong
    orders: tuple[str, ...] = ()  #: orders of three angles that agree, such as `ZYX`, for `orientation`
    columns: tuple[tuple[str, str], ...] = ()  #: columns, each with the one whose numbers it needs
    decimals: Decimals = FINEST  #: decimals that the rows determine
    compared: int = 0  #: number of rows that were compared
    others: tuple[int, ...] = ()  #: compared rows that do not agree, from 1

    @property
    def remedy(self) -> str:
        """Words that say what to state, and which rows do not agree."""
        if not self.others:
            return self._correction
        named = ", ".join(map(str, self.others[:_MOST_NAMED_ROWS]))
        more = ", …" if len(self.others) > _MOST_NAMED_ROWS else ""
        return f"{self._correction}; check pose and joints of row {named}{more}, too"

    @property
    def _correction(self) -> str:
        """Words that say what to state."""
        if self.cause == "joints":
            return f"correct the unit of the joints: the numbers are {self.unit}"
        if self.cause == "lengths":
            return f"correct the unit of the lengths: the numbers are {self.unit}"
        if self.cause == "units":
            return f"correct the units of lengths and joints: the numbers are {self.unit}"
        if self.cause == "orientation":
            return self._correction_of_angles
        if self.cause == "columns":
            return self._correction_of_columns
        stated = []
        if self.cause != "tool":
            stated.append(f"`base` {describe_pose(self.decimals.round_pose(self.base))}")
        if self.cause != "base":
            stated.append(f"`tool` {describe_pose(self.decimals.round_pose(self.tool))}")
        agreeing = f"{self.compared - len(self.others)} of {self.compared}" if self.others else "all"
        return f"{agreeing} rows agree with {' and '.join(stated)}: check, and state these numbers"

    @property
    def _correction_of_angles(self) -> str:
        """Words that say how to state angles that were read as a rotation vector."""
        angles = " or ".join(_ORIENTATIONS[order] for order in self.orders)
        columns = "columns `a`, `b`, `c` in place of `rx`, `ry`, `rz`, or " if "ZYX" in self.orders else ""
        return (
            f"the orientations agree if they are {angles}, not a rotation vector: give {columns}matrices "
            f"(N, 4, 4), which SciPy's rotations make of Euler angles in the order {self.orders[0]}; a "
            "`tool` and a `base` with such angles need a matrix, too"
        )

    @property
    def _correction_of_columns(self) -> str:
        """Words that say which columns have the numbers of others."""
        needed = ", ".join(f"as `{column}` those of `{source}`" for column, source in self.columns)
        return f"the rows agree if columns are exchanged: give {needed}"


class FramesError(RequestError):
    """Error that poses and joints contradict each other, with the frames that would agree.

    Attributes:
        proposal: what would agree; None if nothing was found.
    """

    def __init__(self, gaps: FrameGaps, proposal: FrameProposal | None) -> None:
        self.proposal = proposal
        wrong, row = int((~gaps.agree).sum()), int(np.argmax(gaps.distance))
        remedy = "check tool, base, units, and that the joints are those that the controller shows"
        super().__init__(
            f"poses and joints differ by up to {figure(1e3 * gaps.distance[row], '.3g')} mm and "
            f"{figure(np.degrees(gaps.angle.max()), '.3g')}° ({wrong} of {len(gaps.distance)} rows)",
            where="joints",
            remedy=remedy if proposal is None else proposal.remedy,
        )


def describe_pose(numbers: FloatArray) -> str:
    """Return the numbers (6,) of a pose, position [mm] and rotation vector [deg], as text."""
    texts = [figure(each, ".9g") for each in numbers.tolist()]
    return f"{', '.join(texts[:3])} mm, rotation vector {', '.join(texts[3:])}°"


def propose_frames(
    robot: Robot, poses: FloatArray, joints: FloatArray, tool: FloatArray, base: FloatArray
) -> FrameProposal | None:
    """Find a unit, a frame or two frames with which poses and joints agree; None if nothing is found.

    What all rows agree with comes first, then what most rows agree with.

    Args:
        robot: n joints.
        poses: (N, 4, 4) poses of the tool in the base [m].
        joints: (N, n) controller's joints [rad or m].
        tool: (4, 4) tool in the flange frame, as stated [m].
        base: (4, 4) base in R0, as stated [m].
    """
    rows = np.unique(np.linspace(0, len(poses) - 1, _MOST_ROWS).astype(np.intp))
    if len(rows) < _LEAST_ROWS:
        return None
    comparison = _Comparison(robot, poses[rows], joints[rows], tool, base)
    for least_agreement in (1.0, _LEAST_AGREEMENT):
        proposal = (
            comparison.try_units(least_agreement)
            or comparison.try_both_units(least_agreement)
            or comparison.try_orientations(least_agreement)
            or comparison.try_columns(least_agreement)
            or comparison.try_frames(least_agreement)
        )
        if proposal is not None:
            others = tuple(1 + int(rows[k]) for k in proposal.others)
            return replace(proposal, compared=len(rows), others=others)
    return comparison.try_far_units()


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Poses and joints of N rows that disagree, with the frames that are stated."""

    robot: Robot
    poses: FloatArray  # (N, 4, 4) poses of the tool in the base [m]
    joints: FloatArray  # (N, n) controller's joints [rad or m]
    tool: FloatArray  # (4, 4) tool in the flange frame [m]
    base: FloatArray  # (4, 4) base in R0 [m]

    def try_units(self, least_agreement: float) -> FrameProposal | None:
        """Return the unit with which a fraction of the rows agree; None if there is none.

        Its `others` are indices of rows.
        """
        for unit, factor in _ANGLES.items():
            joints = np.where(self.robot.prismatic, self.joints, factor * self.joints)
            gaps = _measure_gaps(self.robot, joints, self.poses, self.tool, self.base)
            if gaps.agree.mean() >= least_agreement:
                return FrameProposal("joints", self.tool, self.base, unit, others=_list_others(gaps))
        for unit, factor in _LENGTHS.items():
            poses, tool, base = (_scale(each, factor) for each in (self.poses, self.tool, self.base))
            alone = f"{unit}, in the poses alone"
            for words, own_tool, own_base in ((unit, tool, base), (alone, self.tool, self.base)):
                gaps = _measure_gaps(self.robot, self.joints, poses, own_tool, own_base)
                if gaps.agree.mean() >= least_agreement:
                    return FrameProposal("lengths", own_tool, own_base, words, others=_list_others(gaps))
        return None

    def try_both_units(self, least_agreement: float) -> FrameProposal | None:
        """Return the units of lengths and angles with which a fraction of the rows agree, or None.

        Results of Python are in m and rad, which is easily forgotten for both. `others` are indices of rows.
        """
        for angle_words, angle_factor in _ANGLES.items():
            joints = np.where(self.robot.prismatic, self.joints, angle_factor * self.joints)
            for words, factor in _LENGTHS.items():
                unit = words.partition(" ")[0]
                poses, tool, base = (_scale(each, factor) for each in (self.poses, self.tool, self.base))
                both = f"{words}, and {angle_words}"
                in_frames = f"{both}; state `tool` and `base` in {unit}, too"
                for note, own_tool, own_base in ((both, tool, base), (in_frames, self.tool, self.base)):
                    gaps = _measure_gaps(self.robot, joints, poses, own_tool, own_base)
                    if gaps.agree.mean() >= least_agreement:
                        return FrameProposal("units", own_tool, own_base, note, others=_list_others(gaps))
        return None

    def try_orientations(self, least_agreement: float) -> FrameProposal | None:
        """Return the orders of three angles, given as rotation vectors, with which a fraction of rows agree.

        None is returned if there are none. `others` are indices of rows.
        """
        found = dict[str, FrameGaps]()
        for order in _ORIENTATIONS:
            tool, base = (_read_as_angles(each, order, 0.0) for each in (self.tool, self.base))
            for own_tool, own_base in ((self.tool, self.base), (tool, base)):
                trials = [
                    _measure_gaps(
                        self.robot, self.joints, _read_as_angles(self.poses, order, turns), own_tool, own_base
                    )
                    for turns in _WHOLE_TURNS
                ]
                # A row agrees if it does with one of the vectors that have its rotation.
                best = np.argmin([gaps.size for gaps in trials], axis=0), np.arange(len(self.poses))
                gaps = FrameGaps(
                    np.stack([each.distance for each in trials])[best],
                    np.stack([each.angle for each in trials])[best],
                )
                if gaps.agree.mean() >= least_agreement:
                    found.setdefault(order, gaps)
        if not found:
            return None
        others = _list_others(next(iter(found.values())))
        return FrameProposal("orientation", self.tool, self.base, orders=tuple(found), others=others)

    def try_columns(self, least_agreement: float) -> FrameProposal | None:
        """Return an order of x, y, z or of rx, ry, rz with which a fraction of the rows agree, or None.

        A rotation vector that is longer by whole turns has the same direction, so that its order is found,
        too. `others` are indices of rows.
        """
        for names, reorder in ((_POSITION, _reorder_position), (_ROTATION, _reorder_rotation)):
            for order in _OTHER_ORDERS:
                poses = reorder(self.poses, order)
                gaps = _measure_gaps(self.robot, self.joints, poses, self.tool, self.base)
                if gaps.agree.mean() >= least_agreement:
                    sources = tuple(
                        (names[k], names[source]) for k, source in enumerate(order) if k != source
                    )
                    return FrameProposal(
                        "columns", self.tool, self.base, columns=sources, others=_list_others(gaps)
                    )
        return None

    def try_far_units(self) -> FrameProposal | None:
        """Return the unit of lengths with which the rows nearly agree, and without which they do not."""
        given = _measure_gaps(self.robot, self.joints, self.poses, self.tool, self.base)
        for unit, factor in _LENGTHS.items():
            poses, tool, base = (_scale(each, factor) for each in (self.poses, self.tool, self.base))
            alone = f"{unit}, in the poses alone"
            for words, own_tool, own_base in ((unit, tool, base), (alone, self.tool, self.base)):
                gaps = _measure_gaps(self.robot, self.joints, poses, own_tool, own_base)
                if gaps.distance.max() <= min(_FAR_UNIT * given.distance.max(), _NEARLY):
                    return FrameProposal("lengths", own_tool, own_base, words)
        return None

    def try_frames(self, least_agreement: float) -> FrameProposal | None:
        """Return another base, another tool, or both, with which a fraction of the rows agree, or None.

        Its `others` are indices of rows.
        """
        postures = Postures(self.robot, self.robot.joint_map.model_angles(self.joints))
        for fit in (_fit_base, _fit_tool, _fit_base_and_tool):
            kept = np.ones(len(self.poses), dtype=np.bool_)
            for _ in range(_MOST_FITS):
                candidate = fit(postures.flange_pose[kept], self.poses[kept], self.tool, self.base)
                if candidate is None:
                    break
                gaps = _measure_gaps(self.robot, self.joints, self.poses, candidate.tool, candidate.base)
                agree = gaps.agree
                if agree.mean() >= least_agreement and (agree[kept].all() or least_agreement == 1.0):
                    own = gaps.select(agree)
                    decimals = _find_decimals(
                        self.robot, self.joints[agree], self.poses[agree], candidate, own
                    )
                    return replace(candidate, decimals=decimals, others=_list_others(gaps))
                if least_agreement == 1.0:
                    break
                kept = _choose_closest(gaps, least_agreement)
        return None


def _choose_closest(gaps: FrameGaps, least_agreement: float) -> BoolArray:
    """Return the mask (N,) of the rows that agree, or of the fraction of rows that agree best."""
    if gaps.agree.mean() >= least_agreement:
        return gaps.agree
    kept = np.zeros(len(gaps.distance), dtype=np.bool_)
    kept[np.argsort(gaps.size)[: ceil(least_agreement * len(kept))]] = True
    return kept


def _list_others(gaps: FrameGaps) -> tuple[int, ...]:
    """Return the indices of the rows that do not agree."""
    return tuple(np.flatnonzero(~gaps.agree).tolist())


def _find_decimals(
    robot: Robot, joints: FloatArray, poses: FloatArray, proposal: FrameProposal, gaps: FrameGaps
) -> Decimals:
    """Return the decimals above the residual, or more if all rows agree only then.

    A base far from its poses needs more decimals of its rotation than the residual has.
    """
    for decimals in Decimals.from_gaps(gaps).list_finer():
        tool, base = proposal.tool, proposal.base
        if proposal.cause != "base":
            tool = _read_pose(decimals.round_pose(tool))
        if proposal.cause != "tool":
            base = _read_pose(decimals.round_pose(base))
        if _agree(robot, joints, poses, tool, base):
            return decimals
    return FINEST


def _read_pose(numbers: FloatArray) -> FloatArray:
    """Return the pose (4, 4) [m] of six numbers: position [mm], rotation vector [deg]."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(numbers[3:], degrees=True).as_matrix()
    pose[:3, 3] = 1e-3 * numbers[:3]
    return pose


def _fit_base(reached: FloatArray, poses: FloatArray, tool: FloatArray, base: FloatArray) -> FrameProposal:
    """Fit another base to flange poses (k, 4, 4) of the joints and poses (k, 4, 4) of the tool."""
    del base
    return FrameProposal("base", tool, _average(reached @ tool @ invert_poses(poses)))


def _fit_tool(reached: FloatArray, poses: FloatArray, tool: FloatArray, base: FloatArray) -> FrameProposal:
    """Fit another tool to flange poses (k, 4, 4) of the joints and poses (k, 4, 4) of the tool."""
    del tool
    return FrameProposal("tool", _average(invert_poses(reached) @ base @ poses), base)


def _fit_base_and_tool(
    reached: FloatArray, poses: FloatArray, tool: FloatArray, base: FloatArray
) -> FrameProposal | None:
    """Fit another base and another tool; None if the orientations do not determine them."""
    fitted = _fit_both(reached, base @ poses @ invert_poses(tool))
    if fitted is None:
        return None
    world, flange = fitted
    return FrameProposal("base_and_tool", invert_poses(flange) @ tool, world @ base)


def _agree(robot: Robot, joints: FloatArray, poses: FloatArray, tool: FloatArray, base: FloatArray) -> bool:
    """Return whether all poses agree with their joints."""
    return bool(_measure_gaps(robot, joints, poses, tool, base).agree.all())


def _measure_gaps(
    robot: Robot, joints: FloatArray, poses: FloatArray, tool: FloatArray, base: FloatArray
) -> FrameGaps:
    """Measure how far poses (N, 4, 4) of a tool in a base are from their joints (N, n)."""
    postures = Postures(robot, robot.joint_map.model_angles(joints))
    return FrameGaps.measure(base @ poses @ invert_poses(tool), postures)


def _scale(poses: FloatArray, factor: float) -> FloatArray:
    """Return poses (..., 4, 4) whose positions are multiplied by a factor."""
    scaled = poses.copy()
    scaled[..., :3, 3] *= factor
    return scaled


def _reorder_position(poses: FloatArray, order: Sequence[int]) -> FloatArray:
    """Return poses (..., 4, 4) with the coordinates of their positions in another order."""
    read = poses.copy()
    read[..., :3, 3] = poses[..., order, 3]
    return read


def _reorder_rotation(poses: FloatArray, order: Sequence[int]) -> FloatArray:
    """Return poses (..., 4, 4) with the coordinates of their rotation vectors in another order."""
    vectors = Rotation.from_matrix(poses[..., :3, :3]).as_rotvec()
    read = poses.copy()
    read[..., :3, :3] = Rotation.from_rotvec(vectors[..., order]).as_matrix()
    return read


def _read_as_angles(poses: FloatArray, order: str, turns: float) -> FloatArray:
    """Return poses (..., 4, 4) whose rotation vectors, longer by whole turns, are read as three angles."""
    vectors = Rotation.from_matrix(poses[..., :3, :3]).as_rotvec()
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    longer = vectors * (1.0 + 2.0 * np.pi * turns / np.where(size > 0.0, size, np.inf))
    read = poses.copy()
    read[..., :3, :3] = Rotation.from_euler(order, longer).as_matrix()
    return read


def invert_poses(poses: FloatArray) -> FloatArray:
    """Return the inverses (..., 4, 4) of poses."""
    return RigidTransform.from_matrix(poses).inv().as_matrix()


def _average(poses: FloatArray) -> FloatArray:
    """Return the mean (4, 4) of poses: of rotations by least squares, and of positions."""
    return RigidTransform.from_matrix(poses).mean().as_matrix()


def _fit_both(reached: FloatArray, wanted: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Fit W and V of ``reached = W · wanted · V`` to N poses; None if the orientations do not determine them.

    With rotations ``R_r Vᵀ = W R_w``, the entries of W and Vᵀ are a null vector of a linear system.
    """
    identity = np.eye(3)
    # vec(R_r Vᵀ) − vec(W R_w) = 0, with rows stacked: (R_r ⊗ I) vec(Vᵀ) − (I ⊗ R_wᵀ) vec(W)
    rows = [
        np.hstack([np.kron(each[:3, :3], identity), -np.kron(identity, other[:3, :3].T)])
        for each, other in zip(reached, wanted, strict=True)
    ]
    _, sizes, vectors = np.linalg.svd(np.vstack(rows), full_matrices=False)
    if sizes[-2] < _DEFINITE * sizes[0]:
        return None
    solution = vectors[-1]
    turns = np.stack([solution[:9].reshape(3, 3), solution[9:].reshape(3, 3)])
    determinants = np.linalg.det(turns)
    if determinants.prod() <= 0.0:
        return None  # one of them is a reflection: no two rotations solve the system
    rotations = Rotation.from_matrix(np.sign(determinants[0]) * turns).as_matrix()
    world, flange = np.eye(4), np.eye(4)
    flange[:3, :3] = rotations[0].T
    world[:3, :3] = rotations[1]
    # t_r = W (R_w t_V + t_w) + t_W
    columns = np.concatenate(
        [world[:3, :3] @ wanted[:, :3, :3], np.tile(identity, (len(wanted), 1, 1))], axis=2
    )
    right = reached[:, :3, 3] - wanted[:, :3, 3] @ world[:3, :3].T
    positions, *_ = np.linalg.lstsq(columns.reshape(-1, 6), right.reshape(-1), rcond=None)
    flange[:3, 3], world[:3, 3] = positions[:3], positions[3:]
    return world, flange
