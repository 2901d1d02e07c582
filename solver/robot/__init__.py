"""Build robots from DH tables and URDFs, and compute their kinematics."""

from __future__ import annotations

from jointstiff.solver.robot.axis_displacement import displaced_axis
from jointstiff.solver.robot.chain import ChainJoint, KinematicChain
from jointstiff.solver.robot.configuration import Configurations, joint_frames
from jointstiff.solver.robot.configuration_choice import (
    ChosenPostures,
    Unreached,
    choose_postures,
)
from jointstiff.solver.robot.dh import Convention, DhRow, dh_chain
from jointstiff.solver.robot.inverse import InverseKinematics, flange_poses
from jointstiff.solver.robot.joint_map import JointMap
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.urdf import read_urdf, write_urdf
from jointstiff.solver.robot.wrist import WRIST_JOINTS, Wrist, find_wrist

__all__ = [
    "WRIST_JOINTS",
    "ChainJoint",
    "ChosenPostures",
    "Configurations",
    "Convention",
    "DhRow",
    "InverseKinematics",
    "JointMap",
    "KinematicChain",
    "Robot",
    "Unreached",
    "Wrist",
    "choose_postures",
    "dh_chain",
    "displaced_axis",
    "find_wrist",
    "flange_poses",
    "joint_frames",
    "read_urdf",
    "write_urdf",
]
