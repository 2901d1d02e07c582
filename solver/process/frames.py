"""Poses and joints of one path: whether they agree, and the frames with which they would agree.

A pose X of the tool in the base, joints q, the tool T in the flange frame and the base B in R0 belong
together if ``F(q) = B X T⁻¹``, with F the forward kinematics. A controller whose world or flange frame
differs gives ``F(q) = W (B X T⁻¹) V`` with constant W and V. They follow from some poses by least squares:
first the rotations, a linear problem in both together, then the translations (Shah, *Solving the
robot-world/hand-eye calibration problem using the Kronecker product*, 2013).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

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
_DEFINITE: Final = 1e-3
"""Ratio of singular values below which the orientations do not determine a frame."""
_ANGLES: Final = {
    "degrees where radians are stated": np.pi / 180.0,
    "radians where degrees are stated": 180.0 / np.pi,
}
_LENGTHS: Final = {
    "mm where m are stated": 1e-3,
    "m where mm are stated": 1e3,
    "inches where mm are stated": 25.4,
    "mm where inches are stated": 1.0 / 25.4,
}


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


@dataclass(frozen=True, eq=False)
class FrameProposal:
    """Tool, base and units with which poses and joints agree."""

    #: what is probably wrong: `joints` or `lengths` for their unit, or the frames
    cause: Literal["joints", "lengths", "base", "tool", "base_and_tool"]
    tool: FloatArray  #: (4, 4) tool in the flange frame [m]
    base: FloatArray  #: (4, 4) base in R0 [m]
    unit: str = ""  #: words for the units, such as `mm where m are stated`, if a unit is wrong

    @property
    def remedy(self) -> str:
        """Words that say what to state."""
        if self.cause == "joints":
            return f"correct the unit of the joints: the numbers are {self.unit}"
        if self.cause == "lengths":
            return f"correct the unit of the lengths: the numbers are {self.unit}"
        stated = []
        if self.cause != "tool":
            stated.append(f"`base` {describe_pose(self.base)}")
        if self.cause != "base":
            stated.append(f"`tool` {describe_pose(self.tool)}")
        return f"all rows agree with {' and '.join(stated)}: check, and state these numbers"


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


def describe_pose(pose: FloatArray) -> str:
    """Return position [mm] and rotation vector [deg] of a pose (4, 4) [m] as text."""
    position = [figure(round(1e3 * each, 4) + 0.0, ".9g") for each in pose[:3, 3].tolist()]
    vector = Rotation.from_matrix(pose[:3, :3]).as_rotvec(degrees=True)
    rotation = [figure(round(each, 5) + 0.0, ".9g") for each in vector.tolist()]
    return f"{', '.join(position)} mm, rotation vector {', '.join(rotation)}°"


def propose_frames(
    robot: Robot, poses: FloatArray, joints: FloatArray, tool: FloatArray, base: FloatArray
) -> FrameProposal | None:
    """Find a unit, a frame or two frames with which poses and joints agree; None if nothing is found.

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
    poses, joints = poses[rows], joints[rows]
    if (proposal := _try_units(robot, poses, joints, tool, base)) is not None:
        return proposal
    reached = Postures(robot, robot.joint_map.model_angles(joints)).flange_pose
    for candidate in _list_frames(reached, poses, tool, base):
        if _agree(robot, joints, poses, candidate.tool, candidate.base):
            return candidate
    return None


def _try_units(
    robot: Robot, poses: FloatArray, joints: FloatArray, tool: FloatArray, base: FloatArray
) -> FrameProposal | None:
    """Return the unit with which poses and joints agree; None if there is none."""
    for unit, factor in _ANGLES.items():
        scaled_joints = np.where(robot.prismatic, joints, factor * joints)
        if _agree(robot, scaled_joints, poses, tool, base):
            return FrameProposal("joints", tool, base, unit)
    for unit, factor in _LENGTHS.items():
        scaled_poses, scaled_tool, scaled_base = (_scale(each, factor) for each in (poses, tool, base))
        if _agree(robot, joints, scaled_poses, scaled_tool, scaled_base):
            return FrameProposal("lengths", scaled_tool, scaled_base, unit)
        if _agree(robot, joints, scaled_poses, tool, base):
            return FrameProposal("lengths", tool, base, f"{unit}, in the poses alone")
    return None


def _list_frames(
    reached: FloatArray, poses: FloatArray, tool: FloatArray, base: FloatArray
) -> Iterator[FrameProposal]:
    """Yield proposals: another base, another tool, then both."""
    yield FrameProposal("base", tool, _average(reached @ tool @ invert_poses(poses)))
    yield FrameProposal("tool", _average(invert_poses(reached) @ base @ poses), base)
    fitted = _fit_both(reached, base @ poses @ invert_poses(tool))
    if fitted is not None:
        world, flange = fitted
        yield FrameProposal("base_and_tool", invert_poses(flange) @ tool, world @ base)


def _agree(robot: Robot, joints: FloatArray, poses: FloatArray, tool: FloatArray, base: FloatArray) -> bool:
    """Return whether all poses agree with their joints."""
    postures = Postures(robot, robot.joint_map.model_angles(joints))
    return bool(FrameGaps.measure(base @ poses @ invert_poses(tool), postures).agree.all())


def _scale(poses: FloatArray, factor: float) -> FloatArray:
    """Return poses (..., 4, 4) whose positions are multiplied by a factor."""
    scaled = poses.copy()
    scaled[..., :3, 3] *= factor
    return scaled


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
    if np.linalg.det(solution[:9].reshape(3, 3)) < 0.0:
        solution = -solution
    world, flange = np.eye(4), np.eye(4)
    flange[:3, :3] = Rotation.from_matrix(solution[:9].reshape(3, 3)).as_matrix().T
    world[:3, :3] = Rotation.from_matrix(solution[9:].reshape(3, 3)).as_matrix()
    # t_r = W (R_w t_V + t_w) + t_W
    columns = np.concatenate(
        [world[:3, :3] @ wanted[:, :3, :3], np.tile(identity, (len(wanted), 1, 1))], axis=2
    )
    right = reached[:, :3, 3] - wanted[:, :3, 3] @ world[:3, :3].T
    positions, *_ = np.linalg.lstsq(columns.reshape(-1, 6), right.reshape(-1), rcond=None)
    flange[:3, 3], world[:3, 3] = positions[:3], positions[3:]
    return world, flange
