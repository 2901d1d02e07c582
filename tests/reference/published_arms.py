"""Joints of nominal arms as the ROS-Industrial support packages publish them, and their makers' reaches.

From the URDF macros that `service/resources/arms.json` names: origin [mm] and axis of each joint in the
frame of the one before, then the flange. The kinematics here share no code with the solver.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

FORWARD_X_UP = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Flange of FANUC and Yaskawa at zero: z forward, x up (rpy π, −π/2, 0)."""
FORWARD_X_DOWN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Flange of KUKA and ABB at zero: z forward, x down (rpy 0, π/2, 0)."""
UPRIGHT = np.eye(3)

FANUC_AXES = ("z", "y", "-y", "-x", "-y", "-x")
KUKA_AXES = ("-z", "y", "y", "-x", "y", "-x")
ABB_AXES = ("z", "y", "y", "x", "y", "x")
STAUBLI_AXES = ("z", "y", "y", "z", "y", "z")


@dataclass(frozen=True)
class PublishedArm:
    """Joints of an arm, and its reach.

    Attributes:
        origins: of joints 1 to 6 and of the flange, each in the frame before, all parallel at zero [mm].
        axes: of the joints, by which the controller counts.
        flange: rotation of the flange at zero.
        base: height of the controller's frame above that of the first joint's parent [mm].
        j3_from_horizontal: whether the controller's third angle is that of the forearm.
        reach: as the maker states it [mm].
    """

    origins: tuple[tuple[float, float, float], ...]
    axes: tuple[str, ...]
    flange: Floats
    base: float
    reach: float
    j3_from_horizontal: bool = False

    def flange_at(self, controller: Floats) -> tuple[Floats, Floats]:
        """Return origin [m] and rotation of the flange in the controller's frame."""
        angles = controller.copy()
        if self.j3_from_horizontal:
            angles[2] += controller[1]  # its axis is against that of the second joint
        place, turned = np.array([0.0, 0.0, -self.base]), np.eye(3)
        for origin, axis, angle in zip(self.origins, self.axes, angles, strict=False):
            place = place + turned @ np.array(origin)
            turned = turned @ _rotation(axis, float(angle))
        return (place + turned @ np.array(self.origins[-1])) / 1e3, turned @ self.flange


def _rotation(axis: str, angle: float) -> Floats:
    signed = -angle if axis.startswith("-") else angle
    c, s = np.cos(signed), np.sin(signed)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis[-1]]
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = c
    rotation[i, j], rotation[j, i] = -s, s
    return rotation


def _upright(
    axes: tuple[str, ...], flange: Floats, lengths: tuple[float, ...], base: float, reach: float
) -> PublishedArm:
    """Return an arm whose upper arm stands at zero: heights of axes 2 and 4, the lengths forward."""
    d1, a1, a2, a3, d4, d6 = lengths
    origins = ((0, 0, d1), (a1, 0, 0), (0, 0, a2), (0, 0, a3), (d4, 0, 0), (0, 0, 0), (d6, 0, 0))
    return PublishedArm(origins, axes, flange, base, reach)


def _fanuc(*lengths: float, reach: float) -> PublishedArm:
    arm = _upright(FANUC_AXES, FORWARD_X_UP, lengths, lengths[0], reach)
    return replace(arm, j3_from_horizontal=True)


def _yaskawa(*lengths: float, reach: float) -> PublishedArm:
    return _upright(FANUC_AXES, FORWARD_X_UP, lengths, lengths[0], reach)


def _abb(*lengths: float, reach: float) -> PublishedArm:
    return _upright(ABB_AXES, FORWARD_X_DOWN, lengths, 0.0, reach)


def _kuka(*lengths: float, reach: float) -> PublishedArm:
    d1, a1, a2, a3, d4, d6 = lengths
    origins = ((0, 0, d1), (a1, 0, 0), (a2, 0, 0), (0, 0, a3), (d4, 0, 0), (0, 0, 0), (d6, 0, 0))
    return PublishedArm(origins, KUKA_AXES, FORWARD_X_DOWN, 0.0, reach)


def _staubli(d1: float, a1: float, d3: float, a2: float, d4: float, d6: float, reach: float) -> PublishedArm:
    origins = ((0, 0, d1), (a1, 0, 0), (0, d3, a2), (0, 0, 0), (0, 0, d4), (0, 0, 0), (0, 0, d6))
    return PublishedArm(origins, STAUBLI_AXES, UPRIGHT, d1, reach)


ARMS = {
    "FANUC R-2000iC/165F": _fanuc(670, 312, 1075, 225, 1280, 215, reach=2655),
    "FANUC R-2000iC/210F": _fanuc(670, 312, 1075, 225, 1280, 215, reach=2655),
    # Its macro turns the frame of link 3 and leaves the flange's x down, against the maker's other arms.
    "FANUC M-20iD/25": _fanuc(425, 75, 840, 215, 890, 90, reach=1831),
    "FANUC LR Mate 200iD": _fanuc(330, 50, 330, 35, 335, 80, reach=717),
    "KUKA KR 210 R2700 extra": _kuka(675, 350, 1150, -41, 1200, 215, reach=2696),
    "KUKA KR 6 R900 sixx": _kuka(400, 25, 455, 35, 420, 80, reach=901.5),
    "ABB IRB 6640-185/2.8": _abb(780, 320, 1075, 200, 1392, 200, reach=2800),
    "ABB IRB 6700-200/2.60": _abb(780, 320, 1125, 200, 1142.5, 200, reach=2600),
    "ABB IRB 4600-60/2.05": _abb(495, 175, 900, 175, 960, 135, reach=2050),
    "ABB IRB 120-3/0.6": _abb(290, 0, 270, 70, 302, 72, reach=580),
    "Yaskawa GP12": _yaskawa(450, 155, 614, 200, 640, 100, reach=1440),
    "Yaskawa GP25": _yaskawa(505, 150, 760, 200, 795, 100, reach=1730),
    "Yaskawa GP180": _yaskawa(650, 325, 1150, 300, 1225, 225, reach=2702),
    "Stäubli TX2-60": _staubli(375, 0, 20, 290, 310, 70, reach=670),
    "Stäubli TX2-90": _staubli(478, 50, 50, 425, 425, 100, reach=1000),
}

UR_ORIGINS = {
    # Origins of joints 1 to 6: z, x, x and z, y, y [mm]. UR3e and UR5e as compas_fab has them, UR10e as
    # the ROS description of Universal Robots (commit 2ca6f2d) does, which rounds to millimetres.
    "Universal Robots UR3e": (151.85, -243.55, -213.2, 131.05, -85.35, 92.1),
    "Universal Robots UR5e": (162.5, -425.0, -392.2, 133.3, -99.7, 99.6),
    "Universal Robots UR10e": (180.7, -612.7, -571.55, 174.15, -119.85, 116.55),
}


def ur_flange_at(name: str, angles: Floats) -> tuple[Floats, Floats]:
    """Return origin [m] and rotation of the flange of a UR arm, by its joints' origins and rolls.

    The description turns joints 2 and 5 by +π/2, joint 6 by −π/2 about x; every joint turns about its z.
    """
    z1, x3, x4, z4, y5, y6 = UR_ORIGINS[name]
    origins = ((0, 0, z1), (0, 0, 0), (x3, 0, 0), (x4, 0, z4), (0, y5, 0), (0, y6, 0))
    rolls = (0.0, np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2)
    place, turned = np.zeros(3), np.eye(3)
    for origin, roll, angle in zip(origins, rolls, angles, strict=True):
        place = place + turned @ np.array(origin, dtype=float)
        turned = turned @ _rotation("x", roll) @ _rotation("z", float(angle))
    return place / 1e3, turned
