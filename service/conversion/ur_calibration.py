"""Robots from the calibration of a Universal Robots arm: `calibration.conf`, or the YAML file of ROS.

The file of the controller has deviations from the nominal Denavit-Hartenberg parameters. Axes 2 to 4 are
almost parallel, so that these parameters place frames hundreds of metres away; the URDF made here has its
frames on the same axes, next to the nominal ones.
"""

from __future__ import annotations

import configparser
import json
import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pinocchio as pin

from jointstiff.schemas.robot import DhRow, RobotDocument
from jointstiff.service.conversion.catalogue import find_arm
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.mechanics.chain import ChainJoint, KinematicChain
from jointstiff.solver.mechanics.postures import flange_poses
from jointstiff.solver.mechanics.urdf import write_urdf

_LINKS: Final = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_JOINTS: Final = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
    "wrist_3_joint",
)  # fmt: skip
_PARTS: Final = ("x", "y", "z", "roll", "pitch", "yaw")
_DELTAS: Final = ("theta", "a", "d", "alpha")
_MOST_CHARACTERS: Final = 65_536
"""Characters of a file: a calibration has a few thousand."""
_GREATEST: Final = np.array([3.0] * 3 + [2.0 * math.pi] * 3)
"""Greatest coordinates [m] and angles [rad] of a joint in the frame before: an arm reaches 1.75 m."""
_FARTHEST_FLANGE: Final = 0.02
"""Greatest distance [m] by which a calibration moves the flange: tolerances move it by millimetres."""
_POSTURES: Final = ((0.0,) * 6, (0.5, -1.2, 1.4, -0.9, 1.3, 0.4), (-1.1, -0.6, -1.5, 0.8, -1.2, 2.0))
"""Joint angles [rad] at which the flange of a calibration is compared with the nominal one."""


def convert_calibration(stem: str, text: str) -> dict[str, Any]:
    """Return the fields of the robot in a calibration.

    Args:
        stem: name of the file without its ending, which begins with the arm, such as `ur10e calibration`;
            needed for the file of a controller, which does not name the arm.
        text: text of the file.

    Raises:
        RobotError: the text is no calibration, or the name of the file names no arm of the catalogue.
    """
    if len(text) > _MOST_CHARACTERS:
        raise _refuse(f"the file has more than {_MOST_CHARACTERS:,} characters")
    if any(line.startswith("kinematics:") for line in text.splitlines()):
        return {"name": stem, "model": _make_model([*_read_origins(text), pin.SE3.Identity()])}
    deltas = _read_deltas(text)
    try:
        arm = find_arm(re.split(r"[\s_-]*calibration", stem)[0], "robot")
    except RequestError as error:
        raise _refuse(f"the name of the file names no arm: {error.reason}") from None
    fields = {
        "name": f"{arm.name} (calibrated)",
        "model": _make_model(_place_frames_on_axes(arm.model.rows, deltas)),
        "payload": arm.payload,
    }
    nominal = prepare_robot(RobotDocument(name=arm.name, model=arm.model)).robot
    calibrated = prepare_robot(RobotDocument.model_validate(fields)).robot
    nominal_places, places = (
        flange_poses(robot, np.array(_POSTURES))[:, :3, 3] for robot in (nominal, calibrated)
    )
    distance = float(np.linalg.norm(places - nominal_places, axis=1).max())
    if not distance <= _FARTHEST_FLANGE:  # also if the distance is no number
        raise _refuse(
            f"the calibration moves the flange of a {arm.name} by {1e3 * distance:.3g} mm, so the "
            "calibration belongs to another arm, or its numbers are wrong"
        )
    return fields


def _refuse(reason: str) -> RobotError:
    """Return the error about a file that is no calibration of a known arm."""
    return RobotError(
        reason,
        where="robot",
        remedy="give `calibration.conf` of the controller, named by its arm as `ur10e_calibration.conf`, or "
        "the YAML file that `ur_calibration` of ROS writes",
    )


def _read_origins(text: str) -> list[pin.SE3]:
    """Return the frame of each joint in the frame before [m], from the YAML file of ROS.

    Raises:
        RobotError: the file is not YAML, or a number is missing, is none, or is too great for an arm.
    """
    try:
        import yaml
    except ImportError:
        raise _refuse("the calibration is a YAML file, and PyYAML is not installed") from None
    try:
        links = yaml.safe_load(text)["kinematics"]
        origins = np.array([[float(links[link][part]) for part in _PARTS] for link in _LINKS])
    except (yaml.YAMLError, LookupError, TypeError, ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0]
        raise _refuse(f"the file does not have x, y, z, roll, pitch, yaw of six links: {reason}") from None
    is_plausible = np.abs(origins) <= _GREATEST  # false for NaN
    if not is_plausible.all():
        link, part = np.argwhere(~is_plausible)[0].tolist()
        raise _refuse(
            f"{_PARTS[part]} of {_LINKS[link]} is {origins[link, part]:g} m or rad, too much for an arm"
        )
    return [pin.SE3(pin.rpy.rpyToMatrix(*origin[3:]), origin[:3]) for origin in origins]


def _read_deltas(text: str) -> dict[str, FloatArray]:
    """Return the deviations of Denavit-Hartenberg parameters in a controller's file: name → six [m or rad].

    Raises:
        RobotError: the file is not what a controller writes, or a list does not have six numbers.
    """
    file = configparser.ConfigParser(interpolation=None)
    deltas = dict[str, FloatArray]()
    try:
        file.read_string(text)
        stated = {name: value for section in file.sections() for name, value in file[section].items()}
        for name in _DELTAS:
            deltas[name] = np.array(json.loads(stated[f"delta_{name}"]), dtype=np.float64)
    except (configparser.Error, LookupError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise _refuse(f"the file has no calibration: {reason}") from None
    for name, numbers in deltas.items():
        if numbers.shape != (len(_LINKS),) or not np.isfinite(numbers).all():
            raise _refuse(f"`delta_{name}` of the calibration does not have six numbers")
    return deltas


def _place_frames_on_axes(rows: Sequence[DhRow], deltas: Mapping[str, FloatArray]) -> list[pin.SE3]:
    """Return the frames of the six joints, and of the flange behind them, each in the frame before.

    The frame of a joint has its axis as z axis, and its origin where the nominal one is nearest to the axis.

    Args:
        rows: nominal Denavit-Hartenberg parameters of each joint [m, rad].
        deltas: name of a parameter → its six deviations from the nominal ones [m or rad].
    """
    nominal = true = pin.SE3.Identity()  # frames in the base: the nominal one, and with the deviations
    frames = [pin.SE3.Identity()]
    for i, row in enumerate(rows):
        axis = true.rotation[:, 2]
        along = float(axis @ (nominal.translation - true.translation))
        frames.append(pin.SE3(true.rotation, true.translation + along * axis))
        nominal = nominal * _make_step(row.theta, row.a, row.d, row.alpha)
        true = true * _make_step(*(getattr(row, name) + deltas[name][i] for name in _DELTAS))
    frames.append(true)
    return [before.actInv(frame) for before, frame in pairwise(frames)]


def _make_step(theta: float, a: float, d: float, alpha: float) -> pin.SE3:
    """Return the transform of a row of the standard convention [m, rad]."""
    about_z = pin.SE3(pin.utils.rotate("z", theta), np.array([0.0, 0.0, d]))
    about_x = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, 0.0]))
    return about_z * about_x


def _make_model(frames: Sequence[pin.SE3]) -> dict[str, Any]:
    """Return the model of a robot: a URDF of six joints and the flange with these frames."""
    z, limits = np.array([0.0, 0.0, 1.0]), (-2.0 * math.pi, 2.0 * math.pi)
    joints = [
        ChainJoint(name, "revolute", frame.rotation, frame.translation, z, limits, f"{link}_link")
        for name, link, frame in zip(_JOINTS, _LINKS, frames[:-1], strict=True)
    ]
    end = frames[-1]
    joints.append(ChainJoint("flange", "fixed", end.rotation, end.translation, z, None, "flange"))
    chain = KinematicChain("ur", "base", "flange", tuple(joints))
    return {"format": "urdf", "urdf": write_urdf(chain), "base": "base", "flange": "flange"}
