"""Robots from the calibration of a Universal Robots arm: `calibration.conf`, or the YAML file of ROS.

The file of the controller has deviations from the nominal Denavit-Hartenberg parameters. Axes 2 to 4 are
almost parallel, so that these parameters place frames hundreds of metres away; the URDF made here has its
frames on the same axes, next to the nominal ones.
"""

from __future__ import annotations

import configparser
import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.robot import Arm, RobotDocument
from jointstiff.service.conversion.catalogue import find_arm
from jointstiff.solver.errors import RequestError, RobotError

if TYPE_CHECKING:
    from jointstiff.solver.arrays import FloatArray

_LINKS: Final = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_JOINTS: Final = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
    "wrist_3_joint",
)  # fmt: skip
_PARTS: Final = ("x", "y", "z", "roll", "pitch", "yaw")
_DELTAS: Final = ("theta", "a", "d", "alpha")
_NUMBER: Final = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,3})?", re.ASCII)
_MOST_CHARACTERS: Final = 65_536
"""Characters of a file: a calibration has a few thousand."""
_LONGEST_LINK: Final = 3.0
"""Greatest coordinate of a joint in the frame before [m]: the longest arm reaches 1.75 m."""
_FARTHEST_FLANGE: Final = 0.02
"""Greatest distance [m] by which a calibration moves the flange: tolerances move it by millimetres."""
_POSTURES: Final = ((0.0,) * 6, (0.5, -1.2, 1.4, -0.9, 1.3, 0.4), (-1.1, -0.6, -1.5, 0.8, -1.2, 2.0))
"""Joint angles [rad] at which the flange of a calibration is compared with the nominal one."""
_NO_CALIBRATION: Final = (
    "give `calibration.conf` of the controller, or the YAML file that `ur_calibration` of ROS writes"
)


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
        reason = f"a calibration has at most {_MOST_CHARACTERS:,} characters"
        raise RobotError(reason, where="robot", remedy=_NO_CALIBRATION)
    if any(line.startswith("kinematics:") for line in text.splitlines()):
        return {"name": stem, "model": _make_model(_read_origins(text), None)}
    if "delta_theta" not in text:
        raise RobotError("the file has no calibration", where="robot", remedy=_NO_CALIBRATION)
    return _convert_deltas(_find_calibrated_arm(stem), _read_deltas(text))


def _find_calibrated_arm(stem: str) -> Arm:
    """Return the arm of the catalogue that the name of a file, without its ending, begins with.

    Raises:
        RobotError: there is no such arm.
    """
    try:
        return find_arm(re.split(r"[\s_-]*calibration", stem)[0], "robot")
    except RequestError as error:
        raise RobotError(
            "neither the calibration of the controller nor the name of its file names the arm: "
            f"{error.reason}",
            where="robot",
            remedy="rename the file, such as `ur10e_calibration.conf`",
        ) from None


def _convert_deltas(arm: Arm, deltas: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Return the fields of the robot of an arm with deviations of its Denavit-Hartenberg parameters.

    `deltas` is name of a parameter → its six deviations [m or rad].

    Raises:
        RobotError: the deviations are of another arm.
    """
    origins = _place_frames_on_axes(arm.model.rows, deltas)
    *joints, flange = origins
    fields = {"name": f"{arm.name} (calibrated)", "model": _make_model(joints, flange)}
    nominal = RobotDocument(name=arm.name, model=arm.model)
    _refuse_other_arm(nominal, RobotDocument.model_validate(fields))
    return fields if arm.payload is None else fields | {"payload": arm.payload}


def _read_origins(text: str) -> list[list[float]]:
    """Return x, y, z [m], roll, pitch and yaw [rad] of each link in the YAML file of ROS.

    Raises:
        RobotError: the file is not YAML, or a number is missing, is none, or is no length of an arm.
    """
    try:
        import yaml
    except ImportError:
        raise RobotError(
            "the calibration is a YAML file, and PyYAML is not installed",
            where="robot",
            remedy="pip install pyyaml, or give `calibration.conf` of the controller",
        ) from None
    try:
        links = yaml.safe_load(text)["kinematics"]
        return [[_read_part(links[link][part], link, part) for part in _PARTS] for link in _LINKS]
    except KeyError as error:
        reason = f"the calibration has no {error.args[0]}"
    except (yaml.YAMLError, TypeError, RecursionError):
        reason = "the file is not YAML with `kinematics` and the six links of an arm"
    raise RobotError(reason, where="robot", remedy=_NO_CALIBRATION)


def _read_part(value: object, link: str, part: str) -> float:
    """Return a coordinate [m] or an angle [rad] of a link.

    Raises:
        RobotError: the value is no number, or too great.
    """
    greatest = _LONGEST_LINK if part in ("x", "y", "z") else 2.0 * math.pi
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= greatest:  # no NaN
        return float(value)
    reason = f"{part} of {link} is {str(value)[:40]!r}, which is no number of m or rad of an arm"
    raise RobotError(reason, where="robot", remedy=_NO_CALIBRATION)


def _read_deltas(text: str) -> dict[str, list[float]]:
    """Return the deviations of Denavit-Hartenberg parameters in a controller's file: name → six [m or rad].

    Raises:
        RobotError: the file is not what a controller writes, or a list does not have six numbers.
    """
    import numpy as np

    file = configparser.ConfigParser(interpolation=None)
    try:
        file.read_string(text)
    except configparser.Error as error:
        reason = f"the calibration cannot be read: {error.message.splitlines()[0]}"
        raise RobotError(reason, where="robot", remedy=_NO_CALIBRATION) from None
    stated = {name: value for section in file.sections() for name, value in file[section].items()}
    deltas = dict[str, list[float]]()
    for name in _DELTAS:
        cells = re.split(r"[,\s]+", stated.get(f"delta_{name}", "").strip("[] \t\r\n"))
        deltas[name] = [float(cell) for cell in cells if _NUMBER.fullmatch(cell)]
        are_six_numbers = len(cells) == len(deltas[name]) == len(_LINKS) and np.isfinite(deltas[name]).all()
        if not are_six_numbers:
            reason = f"`delta_{name}` of the calibration does not have six numbers"
            raise RobotError(reason, where="robot", remedy=_NO_CALIBRATION)
    return deltas


def _refuse_other_arm(nominal: RobotDocument, calibrated: RobotDocument) -> None:
    """Refuse a calibration that moves the flange farther than the tolerances of any arm do.

    Raises:
        RobotError: the calibration is of another arm, or its numbers are wrong.
    """
    import numpy as np

    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.solver.mechanics.postures import flange_poses

    robots = [prepare_robot(document).robot for document in (nominal, calibrated)]
    places = [flange_poses(robot, np.array(_POSTURES))[:, :3, 3] for robot in robots]
    distance = float(np.linalg.norm(places[1] - places[0], axis=1).max())
    if not distance <= _FARTHEST_FLANGE:  # also if the distance is no number
        raise RobotError(
            f"the calibration moves the flange of a {nominal.name} by {1e3 * distance:.3g} mm, so the "
            "calibration belongs to another arm, or its numbers are wrong",
            where="robot",
            remedy="rename the file by its own arm, such as `ur10e_calibration.conf`, or export it again",
        )


def _place_frames_on_axes(rows: Sequence[Any], deltas: Mapping[str, Sequence[float]]) -> list[list[float]]:
    """Return the origins (7, 6) of the six joints, and of the flange behind them, each in the frame before.

    The frame of a joint has its axis as z axis, and its origin where the nominal one is nearest to the axis.

    Args:
        rows: nominal Denavit-Hartenberg parameters of each joint [m, rad].
        deltas: name of a parameter → its six deviations from the nominal ones [m or rad].
    """
    import numpy as np

    nominal = true = np.eye(4)  # transforms to the base: the nominal one, and with the deviations
    frames = [np.eye(4)]
    for i, row in enumerate(rows):
        frames.append(_move_along_axis(true, nominal[:3, 3]))
        nominal = nominal @ _make_step(row.theta, row.a, row.d, row.alpha)
        parameters = [getattr(row, name) + deltas[name][i] for name in _DELTAS]
        true = true @ _make_step(*parameters)
    frames.append(true)
    steps = [
        np.asarray(np.linalg.solve(first, second), dtype=np.float64) for first, second in pairwise(frames)
    ]
    return [_list_parts(step) for step in steps]


def _move_along_axis(frame: FloatArray, point: FloatArray) -> FloatArray:
    """Return a frame (4, 4) whose origin was moved along its z axis to where a point (3,) [m] is nearest."""
    moved = frame.copy()
    axis = frame[:3, 2]
    moved[:3, 3] += axis * (axis @ (point - frame[:3, 3]))
    return moved


def _make_step(theta: float, a: float, d: float, alpha: float) -> FloatArray:
    """Return the transform (4, 4) of a row of the standard convention [m, rad]."""
    import numpy as np

    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _list_parts(step: FloatArray) -> list[float]:
    """Return x, y, z [m], roll, pitch and yaw [rad] of a transform (4, 4)."""
    rotation = step[:3, :3]
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    if math.hypot(rotation[0, 0], rotation[1, 0]) > 1e-9:
        roll = math.atan2(rotation[2, 1], rotation[2, 2])
        yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    else:  # roll and yaw turn about one axis
        roll, yaw = 0.0, math.atan2(-rotation[0, 1], rotation[1, 1])
    return [*step[:3, 3].tolist(), roll, pitch, yaw]


def _make_model(origins: Sequence[Sequence[float]], end: Sequence[float] | None) -> dict[str, Any]:
    """Return the model of a robot: a URDF whose joints have these origins; `end` is that of the flange."""
    links = ["base", *(f"{link}_link" for link in _LINKS)]
    parts = [f'<link name="{link}"/>' for link in links]
    limit = f'<limit lower="{-2 * math.pi!r}" upper="{2 * math.pi!r}" effort="0" velocity="0"/>'
    for i, (joint, origin) in enumerate(zip(_JOINTS, origins, strict=True)):
        ends = f'<parent link="{links[i]}"/><child link="{links[i + 1]}"/>'
        place = _write_origin(origin)
        parts.append(f'<joint name="{joint}" type="revolute">{ends}{place}<axis xyz="0 0 1"/>{limit}</joint>')
    ends = f'<parent link="{links[-1]}"/><child link="flange"/>'
    place = _write_origin(end or [0.0] * len(_PARTS))
    parts.append(f'<link name="flange"/><joint name="flange" type="fixed">{ends}{place}</joint>')
    urdf = f'<robot name="ur">{"".join(parts)}</robot>'
    return {"format": "urdf", "urdf": urdf, "base": "base", "flange": "flange"}


def _write_origin(parts: Sequence[float]) -> str:
    """Return the origin of a joint in a URDF."""
    xyz, rpy = (" ".join(map(repr, each)) for each in (parts[:3], parts[3:]))
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'
