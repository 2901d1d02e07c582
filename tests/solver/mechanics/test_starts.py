"""Starts of paths: a unit is doubted only if the numbers can hardly be in the stated unit."""

import numpy as np
import pytest

from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics, follow_poses
from jointstiff.solver.mechanics.postures import flange_poses

FIRST = [5.0, -40.0, 70.0, 10.0, 60.0, -20.0]
TURNED = [60.0, -40.0, 70.0, 10.0, 60.0, -20.0]
NEAR = [3.0, -45.0, 70.0, 0.0, 65.0, 0.0]


@pytest.fixture(scope="module")
def inverse():
    campaign = simulate_campaign(default_arm(), load="pull", configurations=6, seed=1)
    return InverseKinematics(prepare_robot(RobotDocument.model_validate(campaign["robot"])).robot)


def follow(inverse, first, start):
    poses = flange_poses(inverse.arm, np.radians([first, np.add(first, 0.1)]))
    return follow_poses(inverse, poses, start)


@pytest.mark.parametrize(
    ("first", "start"),
    [
        (FIRST, [0.07, 0.04, 0.11, -0.09, 0.06, -0.03]),  # home, as a controller shows zero
        ([0.0, 12.0, -9.0, 5.0, 18.0, 3.0], [0.0, -45.0, 90.0, 0.0, 45.0, 0.0]),  # path near zero
        (TURNED, [0.1, -0.8, 1.2, 0.0, 1.1, 0.0]),  # to a tenth, as the remedy says
    ],
)
def test_a_start_in_degrees_is_not_refused(inverse, first, start):
    follow(inverse, first, np.radians(start))


@pytest.mark.parametrize(
    ("first", "start", "cause"),
    [
        (FIRST, np.radians(np.radians(NEAR)), "in radians, not in degrees.*65, 0$"),
        (TURNED, np.radians([0.11, -0.8, 1.2, 0.0, 1.1, 0.0]), "in radians.*to a tenth of a degree$"),
        (FIRST, np.array(NEAR), "in degrees, not in radians"),
    ],
)
def test_a_start_in_the_other_unit_is_named(inverse, first, start, cause):
    with pytest.raises(RequestError, match=cause):
        follow(inverse, first, start)
