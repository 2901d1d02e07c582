"""Joints of nominal arms as the ROS-Industrial support packages publish them, and their makers' reaches.

From the URDF macros that `service/conversion/arms.json` names; of the arms of Universal Robots, UR3e and UR5e
as compas_fab has them, UR10e as the ROS description of the maker (commit 2ca6f2d) does, which rounds to
millimetres, and UR3, UR5 and UR10 as ros-industrial/universal_robot (`default_kinematics.yaml`) has them. The
macro of FANUC's M-20iD/25 turns the frame of link 3 and leaves the flange's x down, against the maker's other
arms. The kinematics here share no code with the solver.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

FLANGES = {
    "x up": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),  # z forward, rpy π, −π/2, 0
    "x down": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),  # z forward, rpy 0, π/2, 0
    "upright": np.eye(3),
}
"""Rotations of the flange at zero: FANUC and Yaskawa; KUKA and ABB; the others."""


@dataclass(frozen=True)
class PublishedArm:
    """Joints of an arm, and its reach."""

    origins: list[list[float]]  # of joints 1 to 6 and of the flange, each in the frame before [mm]
    axes: str  # of the joints, by which the controller counts
    flange: str = "upright"
    base: float = 0.0  # height of the controller's frame above that of the first joint's parent [mm]
    reach: float | None = None  # as the maker states it [mm]
    j3_from_horizontal: bool = False  # whether the controller's third angle is that of the forearm
    rolls: tuple[float, ...] = (0.0,) * 6  # turns about x before each joint [degrees]

    def flange_at(self, controller: Floats) -> tuple[Floats, Floats]:
        """Return origin [m] and rotation of the flange in the controller's frame."""
        angles = controller.copy()
        if self.j3_from_horizontal:
            angles[2] += controller[1]  # its axis is against that of the second joint
        place, turned = np.array([0.0, 0.0, -self.base]), np.eye(3)
        for origin, axis, roll, angle in zip(
            self.origins, self.axes.split(), self.rolls, angles, strict=False
        ):
            place = place + turned @ np.array(origin)
            turned = turned @ _rotation("x", np.radians(roll)) @ _rotation(axis, float(angle))
        return (place + turned @ np.array(self.origins[-1])) / 1e3, turned @ FLANGES[self.flange]


def _rotation(axis: str, angle: float) -> Floats:
    signed = -angle if axis.startswith("-") else angle
    c, s = np.cos(signed), np.sin(signed)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis[-1]]
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = c
    rotation[i, j], rotation[j, i] = -s, s
    return rotation


PUBLISHED = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
ARMS, UR_ORIGINS = (
    {name: PublishedArm(**arm) for name, arm in PUBLISHED[makers].items()} for makers in ("arms", "ur")
)


def ur_flange_at(name: str, angles: Floats) -> tuple[Floats, Floats]:
    """Return origin [m] and rotation of the flange of a UR arm, by its joints' origins and rolls."""
    return UR_ORIGINS[name].flange_at(angles)
