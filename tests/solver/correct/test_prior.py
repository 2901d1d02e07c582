"""The prior stiffness of an arm that nobody has measured, compared with arms that were measured."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots

from jointstiff.solver.correct.prior import PRIOR_ARMS, build_prior_model
from jointstiff.solver.errors import RobotError
from jointstiff.solver.evidence.payload import payload_torque
from jointstiff.solver.mechanics.postures import measure_reach


def test_the_prior_of_a_measured_arm_is_within_a_factor_of_two_of_it():
    robot = next(each.robot for each in build_nominal_robots() if each.name == "KUKA KR 210 R2700 extra")
    prior = 1.0 / build_prior_model(robot).compliance
    scale = payload_torque(210, measure_reach(robot))
    assert np.exp(np.log(prior[1:] / scale).mean()) == pytest.approx(98.4, abs=1.0)  # 93 and 104
    for arm in PRIOR_ARMS:
        ratio = prior[1:] / scale / arm.ratios()
        assert (ratio > 0.5).all()
        assert (ratio < 2.0).all()


def test_an_arm_without_payload_has_no_prior():
    robot = next(each.robot for each in build_nominal_robots())
    with pytest.raises(RobotError, match="no payload"):
        build_prior_model(robot.with_payload(None))
