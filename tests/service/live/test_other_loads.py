"""A live campaign names a load with which the goal takes fewer readings, and goes on with a moved hook."""

from dataclasses import dataclass

import numpy as np
import pytest

from jointstiff.schemas.live import MeasurementSetPost
from jointstiff.schemas.measurement import Observation
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.live.campaign import Declaration, LiveCampaign
from jointstiff.service.live.declaration import complete_declaration
from jointstiff.simulator import default_arm, robot_document
from jointstiff.simulator.campaign import TARGETS
from jointstiff.simulator.equilibrium import deflections

ARM = default_arm()
SIGMA = 2e-5
NEAR_THE_AXIS = (0.0, 0.03, 0.1)
FAR_FROM_THE_AXIS = (0.0, 0.3, 0.1)


@dataclass
class Bench:
    """The arm of the examples under a load, with a hook that can be moved."""

    campaign: LiveCampaign
    hook: tuple[float, float, float]

    @classmethod
    def declare(cls, hook, goal=0.15, kind="dead_weight", fields=None):
        """Declare a campaign for each joint's stiffness within ± `goal`, under 750 N at `hook` [m]."""
        robot = prepare_robot(RobotDocument.model_validate(robot_document(ARM))).robot
        post = MeasurementSetPost.model_validate(
            {
                "robot_id": "arm",
                "name": "a hook near the last axis",
                "units": {"length": "m", "angle": "rad", "force": "N"},
                "encoders": "motor",
                "noise": {"sigma": SIGMA, "load_point": 1e-4, "grounds": {"load_point": "tracker"}},
                "load_point": hook,
                "open": {
                    "goal": {"kind": "joints", "relative": goal},
                    "load": {"kind": kind, "force": 750.0},
                    "targets": {name: list(place) for name, place in TARGETS.items()},
                }
                | (fields or {}),
            }
        )
        return cls(LiveCampaign(Declaration(robot, complete_declaration(post, post.open))), hook)

    def read_next(self, random):
        """Read the planned posture with the hook where it hangs, by exact springs and a tracker's noise."""
        planned = self.campaign.plan_next_reading()
        joints, force, point = (np.array([each]) for each in (planned.joints, planned.force, self.hook))
        places = deflections(ARM, joints, force, np.zeros((1, 3)), point, np.array(list(TARGETS.values())))
        unloaded, loaded = (each[0] + SIGMA * random.standard_normal((len(TARGETS), 3)) for each in places)
        observation = {
            "label": planned.label,
            "joints": planned.joints,
            "force": planned.force,
            "load_point": self.hook,
            "readings": [
                {"target": name, "unloaded": unloaded[t].tolist(), "loaded": loaded[t].tolist()}
                for t, name in enumerate(TARGETS)
            ],
        }
        return Observation.model_validate(observation)

    def read(self, count, random):
        """Read so many planned postures, or fewer if the goal is met before."""
        for _ in range(count):
            if self.campaign.progress.goal_is_met:
                return
            self.take(self.read_next(random))

    def take(self, observation):
        """Add an observation to the campaign."""
        self.campaign = self.campaign.with_entry(self.campaign.compare_with_prediction(observation))


@pytest.mark.parametrize("seed", range(3))
def test_whoever_moves_the_hook_as_advised_meets_the_goal_in_half_of_the_readings(seed):
    bench, random = Bench.declare(NEAR_THE_AXIS), np.random.default_rng(seed)
    bench.read(5, random)
    stays = bench.campaign.progress.still_needed
    other = bench.campaign.progress.other_load
    x, y, z = (1e3 * each for each in other.equipment.load_point)
    advice = f"with the load farther out, at {x:.4g}, {y:.4g}, {z:.4g} mm in the flange frame, about "
    assert advice in bench.campaign.state().message
    bench.hook = tuple(other.equipment.load_point.tolist())
    bench.read(stays // 2, random)
    assert bench.campaign.progress.goal_is_met


def test_a_goal_that_no_number_of_readings_meets_is_met_with_another_hook():
    bench, random = Bench.declare(NEAR_THE_AXIS, 0.1, "any_direction"), np.random.default_rng(0)
    bench.read(10, random)
    state = bench.campaign.state()
    assert state.state == "cannot"
    assert "mm in the flange frame" in state.message
    bench.hook = tuple(bench.campaign.progress.other_load.equipment.load_point.tolist())
    bench.read(10, random)
    assert bench.campaign.progress.goal_is_met


def test_no_other_load_is_advised_where_few_readings_are_left():
    bench, random = Bench.declare(FAR_FROM_THE_AXIS), np.random.default_rng(0)
    bench.read(5, random)
    assert bench.campaign.progress.other_load is None
    assert "would meet the goal" not in bench.campaign.state().message


def test_the_next_readings_are_planned_for_the_hook_of_the_last_one():
    """The next posture is that of a campaign that has the same readings, and declared this hook."""
    bench, random = Bench.declare(NEAR_THE_AXIS), np.random.default_rng(0)
    declared = Bench.declare(FAR_FROM_THE_AXIS).campaign
    for count in range(5):
        bench.hook = FAR_FROM_THE_AXIS if count == 4 else NEAR_THE_AXIS
        observation = bench.read_next(random)
        bench.take(observation)
        declared = declared.with_entry(declared.compare_with_prediction(observation))
    found, wanted = (each.progress.next for each in (bench.campaign, declared))
    assert (found.joints, found.missing) == (pytest.approx(wanted.joints), wanted.missing)


def test_a_reading_with_a_hook_that_no_posture_allows_leaves_the_campaign_readable():
    """The hook of the last reading was typed wrong, 3 m from the flange: no posture has it in the area."""
    area = {
        "goal": {"kind": "deflection", "uncertainty": 1e-4},
        "work_area": [[0.8, -0.6, 0.4], [1.9, 0.6, 1.6]],
    }
    bench, random = Bench.declare(NEAR_THE_AXIS, fields=area), np.random.default_rng(0)
    bench.read(3, random)
    bench.hook = (3.0, 0.0, 0.0)
    bench.take(bench.read_next(random))
    assert len(bench.campaign.entries) == 4
    assert bench.campaign.state().state == "measuring"
