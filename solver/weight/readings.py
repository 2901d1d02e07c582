"""Positions of a robot that bends under its own weight, unloaded or under known loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.model.poses import Poses
from jointstiff.solver.weight.bodies import Burden


@dataclass(frozen=True, eq=False)
class WeightReadings:
    """N observations of absolute positions. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, or a number is not finite.
    """

    poses: Poses  #: angles and positions; their frame is that of forces and gravity, too
    burden: Burden  #: links, tool, payloads, balancers
    carried: FloatArray  #: (N, bodies) 1 where a body hangs on, else 0
    force: FloatArray  #: (N, 3) known force on the robot [N]; zero without load
    moment: FloatArray  #: (N, 3) known moment about the load point [N·m]
    load_point: FloatArray  #: (N, 3) where the force acts, flange frame [m]

    def __post_init__(self) -> None:
        count = len(self.poses.angles)
        shapes = {"carried": (count, len(self.burden.bodies))}
        shapes |= dict.fromkeys(("force", "moment", "load_point"), (count, 3))
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                raise MeasurementError(
                    f"the shape is {array.shape} instead of {shape}, or a number is not finite",
                    where=name,
                    remedy="give finite numbers for each observation",
                )
            array.setflags(write=False)
        joints = [body.joint for body in self.burden.bodies]
        joints += [balancer.joint for balancer in self.burden.balancers]
        if not joints or not 0 <= min(joints) <= max(joints) < self.poses.joint_map.n:
            raise MeasurementError(
                f"no body is stated, or one on none of the {self.poses.joint_map.n} joints",
                where="masses",
                remedy="state mass and centre of mass of each link, by the joint that carries it",
            )

    @classmethod
    def unloaded(cls, poses: Poses, burden: Burden) -> WeightReadings:
        """Return the readings of a robot that carries all bodies in all observations, and nothing else."""
        nothing = np.zeros((len(poses.angles), 3))
        carried = np.ones((len(poses.angles), len(burden.bodies)))
        return cls(poses, burden, carried, nothing, nothing.copy(), nothing.copy())
