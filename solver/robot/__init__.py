"""Robots: kinematic chains, DH tables, URDFs, joint maps and configurations."""

from __future__ import annotations

from jointstiff.solver.robot.chain import ChainJoint, KinematicChain
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.dh import Convention, DhRow, dh_chain
from jointstiff.solver.robot.joint_map import JointMap
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.skeleton import Skeleton
from jointstiff.solver.robot.urdf import read_urdf, write_urdf
from jointstiff.solver.robot.wrist import WRIST_JOINTS, WRIST_TOLERANCE, Wrist, find_wrist

__all__ = [
    "WRIST_JOINTS",
    "WRIST_TOLERANCE",
    "ChainJoint",
    "Configurations",
    "Convention",
    "DhRow",
    "JointMap",
    "KinematicChain",
    "Robot",
    "Skeleton",
    "Wrist",
    "dh_chain",
    "find_wrist",
    "read_urdf",
    "write_urdf",
]
