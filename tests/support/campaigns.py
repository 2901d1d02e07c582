"""Campaigns for tests: the shared data, our simulator, and what the numerical core makes of them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
from support.shared_data import shared as shared

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.robot import DhModel
from jointstiff.schemas.run.options import RunOptions
from jointstiff.service.conversion.measurements import to_measurements
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.conversion.robots import build_robot, dh_kinematics
from jointstiff.service.kinds.run.settings import to_settings
from jointstiff.simulator import TARGETS, default_arm, simulate_campaign
from jointstiff.simulator.equilibrium import deflections
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.readings.measurements import CommonUncertainty, Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.urdf import read_urdf

METHODS = ("complete_pose", "partial_pose", "decoupled_partial_pose")


def prepare(document: dict[str, Any]) -> tuple[Robot, Measurements]:
    """A campaign document as the numerical core takes it; its load point is where it says."""
    campaign = Campaign.model_validate_json(json.dumps(document))
    model = campaign.robot.model
    if isinstance(model, DhModel):
        chain = dh_kinematics(model, campaign.robot.name)
    else:
        chain = read_urdf(model.urdf, model.base, model.flange)
    robot = build_robot(chain, campaign.robot.joint_map)
    readings = ReadingArrays.from_observations(campaign.measurement_set.observations)
    measurements = to_measurements(campaign.measurement_set, readings, robot)
    stated = measurements.common_uncertainty.stated
    return robot, replace(measurements, common_uncertainty=None if stated == CommonUncertainty() else stated)


def estimate(robot: Robot, measurements: Measurements, **options: Any) -> Estimate:
    """Identify with the options of a run, K_c neglected as in the paper unless they say otherwise."""
    return identify(robot, measurements, settings_of(robot, **options))


def settings_of(robot: Robot, **options: Any) -> Settings:
    """Settings by the options of a run, K_c neglected as in the paper unless they say otherwise."""
    return to_settings(RunOptions(**{"complementary_stiffness": "neglected"} | options), robot)


def only_deflections(measurements: Measurements) -> Measurements:
    """The same readings without positions: the targets' nominal places on the flange are given."""
    places = np.broadcast_to(np.array(list(TARGETS.values())), measurements.position.shape)
    return replace(measurements, position=places, in_flange=measurements.present)


def first_target(measurements: Measurements) -> Measurements:
    """The readings of the first target alone."""
    names = ("position", "deflection", "in_flange", "present")
    first = {name: getattr(measurements, name)[:, :1] for name in names}
    return replace(measurements, targets=measurements.targets[:1], **first)


def straight_wrist(angle: float):
    """Pulls with joint 5 at ± this angle [rad], by exact springs, without noise."""
    arm = default_arm()
    robot, campaign = prepare(simulate_campaign(arm, load="pull", seed=2))
    q = campaign.joints.copy()
    q[:, 4] = angle * np.where(np.arange(len(q)) % 2, 1, -1)
    points = np.array(list(TARGETS.values()))
    unloaded, loaded = deflections(arm, q, campaign.force, campaign.moment, campaign.load_point, points)
    return robot, replace(campaign, joints=q, position=unloaded, deflection=loaded - unloaded)
