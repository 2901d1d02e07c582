"""Rows of the elastic model at any place of the flange: its displacement and the flange's rotation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.conic import to_matrix
from jointstiff.solver.links.model import ElasticColumns, elastic_blocks
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations, joint_frames, skew
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.links import products


@dataclass(frozen=True, eq=False)
class ElasticPlaces:
    """B places under B loads."""

    columns: ElasticColumns  #: columns of the compliances
    jacobian: FloatArray  #: (B, 6, n) jacobian of the places [m/rad, then rad/rad], axes of R0
    moves: FloatArray  #: (B, n, 6, 6) moves of the places with each joint's frame: translation, then rotation
    torque: FloatArray  #: (B, n) torque of the joints [N·m]
    wrench: FloatArray  #: (B, n, 6) wrench of the load in each joint's frame [N, then N·m]

    @classmethod
    def of(
        cls,
        robot: Robot,
        columns: ElasticColumns,
        configurations: Configurations,
        load: tuple[FloatArray, FloatArray, FloatArray],
        place: FloatArray,
    ) -> ElasticPlaces:
        """Compute kinematics and loads.

        Args:
            robot: n joints.
            columns: which links bend.
            configurations: kinematics of the B unloaded postures.
            load: force (B, 3) [N] and moment (B, 3) [N·m], axes of R0, and load point (B, 3) in the flange
                frame [m].
            place: (B, 3) in the flange frame [m].
        """
        force, moment, load_point = load
        R, origin = joint_frames(robot, configurations.q)
        at, loaded = (configurations.to_base(point[:, None]) for point in (place, load_point))
        angular = configurations.angular_jacobian
        jacobian = np.concatenate([configurations.jacobian_at(at)[:, 0], angular], axis=1)
        load_jacobian = configurations.jacobian_at(loaded)[:, 0]
        moves = np.zeros((*R.shape[:2], 6, 6))
        moves[..., :3, :3] = moves[..., 3:, 3:] = R
        moves[..., :3, 3:] = -skew(at - origin) @ R
        about = moment[:, None] + np.cross(loaded - origin, force[:, None])
        wrench = np.concatenate([force[:, None, None] @ R, about[:, :, None] @ R], axis=-1)[:, :, 0]
        torque = configurations.joint_torque(load_jacobian, force, moment)
        return cls(columns, jacobian, moves, torque, wrench)

    @property
    def rows(self) -> FloatArray:
        """(B, 6, P) that take the compliances to displacement [m] and rotation [rad]."""
        rows = np.empty((len(self.torque), 6, self.columns.width))
        rows[..., self.columns.joints] = self.jacobian * self.torque[:, None]
        rows[..., self.columns.coupling] = products(self.jacobian, self.torque[:, None])
        for joint in self.columns.links:
            own = products(self.moves[:, joint], self.wrench[:, joint, None])
            rows[..., self.columns.link(joint)] = own
        return rows

    def deflection(self, compliances: FloatArray) -> FloatArray:
        """(B, 6) displacement [m] and rotation [rad] by compliances (P,), without their rows."""
        turned = self.torque @ self._of_joints(compliances)
        out: FloatArray = (self.jacobian @ turned[..., None])[..., 0]
        for joint in self.columns.links:
            bent = self.wrench[:, joint] @ to_matrix(compliances[self.columns.link(joint)], 6)
            out = out + (self.moves[:, joint] @ bent[..., None])[..., 0]
        return out

    def _of_joints(self, compliances: FloatArray) -> FloatArray:
        columns = self.columns
        coupling = to_matrix(compliances[columns.coupling], columns.n)
        return np.asarray(np.diag(compliances[columns.joints]) + coupling)

    def compliance(self, compliances: FloatArray) -> FloatArray:
        """(B, 6, 6) answer of the places to a wrench at the place, by compliances (P,), axes of R0."""
        columns, J = self.columns, self.jacobian
        out: FloatArray = J @ self._of_joints(compliances) @ J.transpose(0, 2, 1)
        for joint in columns.links:
            moves = self.moves[:, joint]
            out = out + moves @ to_matrix(compliances[columns.link(joint)], 6) @ moves.transpose(0, 2, 1)
        return out


def elastic_residuals(
    robot: Robot, measurements: Measurements, columns: ElasticColumns, compliances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (K, 3) [m] and rows (K, 3, P) of the K targets that were read.

    Args:
        robot: n joints.
        measurements: N observations.
        columns: which links bend.
        compliances: (P,).
    """
    residuals, rows = [], []
    for block, columns_of in elastic_blocks(robot, measurements, columns):
        part = block.measurements
        rows.append(columns_of[part.present][..., :-1])
        residuals.append(part.deflection[part.present] - rows[-1] @ compliances)
    return np.concatenate(residuals), np.concatenate(rows)
