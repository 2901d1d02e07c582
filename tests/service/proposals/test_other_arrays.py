"""Arrays beside a campaign in one file that are no readings: left out with a remark, or refused."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

pytestmark = pytest.mark.process

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=31, configurations=10)
FIRST = 1e3 * READINGS.position[:, 0]
SAG = np.array([0.01, 0.02, -0.5])
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}


def read(folder, **others):
    arrays = {"q": READINGS.joints, "before": FIRST, "loaded": FIRST + SAG}
    np.savez(folder / "a.npz", **arrays, **others)
    return js.read(folder / "a.npz", robot=ARM, **STATED)


@pytest.mark.parametrize("name", ["K", "stiffness", "covariance"])
def test_a_square_matrix_beside_a_campaign_is_left_out_with_a_remark(name, tmp_path):
    matrix = np.diag(np.linspace(1e5, 6e5, 6)) + 2.5
    proposal = read(tmp_path, **{name: matrix})
    assert f"{name}1" in str(proposal).partition("not read: ")[2]
    observations = proposal.accept().campaign.measurement_set.observations
    shifts = [np.subtract(each.loaded, each.unloaded) for own in observations for each in own.readings]
    assert shifts == pytest.approx(np.tile(SAG, (10, 1)), abs=2e-3)


def test_points_of_some_postures_beside_a_campaign_are_never_left_out(tmp_path):
    with pytest.raises(js.CampaignError, match="it has 6 rows for 10 postures"):
        read(tmp_path, repeated=FIRST[:6] + SAG)
