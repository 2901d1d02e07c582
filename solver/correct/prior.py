"""Prior stiffness of an arm that nobody has measured: from its payload and reach.

Makers build joints for the torque of the payload at the reach. Of two arms with published stiffnesses the
ratio of each joint's stiffness to this torque follows, with a payload and a reach that are assumed here.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.errors import RobotError
from jointstiff.solver.evidence.payload import R_2000IC, MeasuredArm, payload_torque
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel

PRIOR_ARMS: Final = (
    # Ambiehl, Garnier, Subrin, Furet, IROS 2017, Table II: decoupled partial pose, encoders inactive. Payload
    # and reach of the arm are assumed.
    MeasuredArm("arm of the paper", 240.0, 2.69, (3.2e6, 2.6e6, 0.42e6, 0.23e6, 0.089e6)),
    # The source names no variant of the arm. The payload is assumed: that of the heavy variants.
    MeasuredArm("FANUC R-2000iC", 240.0, 2.687, R_2000IC),
)
"""Arms from which the prior is derived. Other assumed payloads move it by less than its factor."""
FACTOR: Final = 2.0
"""Factor within which a prior stiffness is expected to be right, at 95 %."""
_DEVIATION: Final = 0.5 * float(np.log(FACTOR))
"""Relative standard deviation of a prior compliance."""
_SIX: Final = 6


def build_prior_model(robot: Robot) -> JointModel:
    """Build the model of an arm with six revolute joints from its payload and its reach.

    The ratio of joint 1 is taken as the geometric mean of those of joints 2 and 3, because a dead weight does
    not twist joint 1, so that neither of the two arms has its stiffness.

    Raises:
        RobotError: the payload is unknown, or the arm has other joints.
    """
    if robot.payload is None:
        raise RobotError(
            "the prior of the stiffness follows from the payload, but the robot states no payload",
            where="payload",
            remedy="state `payload` of the robot [kg], or identify the stiffness of the robot",
        )
    if robot.n != _SIX or robot.prismatic.any():
        raise RobotError(
            "a prior of the stiffness exists only for arms with six revolute joints",
            where="robot",
            remedy="identify the stiffness of the robot",
        )
    ratios = np.exp(np.mean([np.log(arm.ratios()) for arm in PRIOR_ARMS], axis=0))  # of joints 2 to 6
    ratios = np.concatenate([[np.sqrt(ratios[0] * ratios[1])], ratios])
    compliance = 1.0 / (ratios * payload_torque(robot.payload, measure_reach(robot)))
    likelihood = Likelihood(np.arange(_SIX), compliance, np.diag(np.square(_DEVIATION * compliance)))
    return JointModel(robot, compliance, likelihood, Constraints(Bounds.positive(_SIX)))
