"""Logs of a controller as files: a column of angles for each encoder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import ValidationError

from jointstiff.schemas.motion import MotionLog
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.service.library.robots import read_joint_kinds, robot
from jointstiff.service.problems import as_campaign_error
from jointstiff.service.runs.deflection import parse_unit_factor
from jointstiff.solver.errors import MeasurementError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jointstiff.schemas.joints import JointKind
    from jointstiff.schemas.measurement import AngleUnit, LengthUnit
    from jointstiff.solver.arrays import FloatArray

_STEADY: Final = 0.01
"""Relative deviation of an interval of time, beyond which the samples are not at equal intervals."""
_TIMES: Final = {"s": 1.0, "ms": 1e-3}
_EXAMPLE: Final = "`t [s]`, `motor_1 [deg]`, …, `link_1 [deg]`, …"


def read_log(
    file: str | Path,
    /,
    source: object,
    *,
    label: str | None = None,
    angle: AngleUnit = "deg",
    length: LengthUnit = "mm",
) -> MotionLog:
    """Read a controller's log from a CSV or Parquet file with a column for each encoder.

    Headers are ``t [s]``, ``motor_1 [deg]`` and ``link_1 [deg]``; a joint has its number from the base, or
    its name, as in ``motor_A1 [deg]``. Other columns are left out.

    Args:
        file: path of the file.
        source: robot: anything that `jointstiff.robot` reads.
        label: label of the log; default: name of the file.
        angle: unit of the angles in the result, as in `units` of the request.
        length: unit of positions of joints that slide.

    Raises:
        CampaignError: the file is not a table of numbers, a column is missing, its unit is not known, or the
            times are not equally spaced.
        OSError: the file cannot be read.
    """
    from jointstiff.service.tables.reading import read_number_table

    path = Path(file)
    kinds = read_joint_kinds(robot(source))
    with as_campaign_error(path.name):
        columns = read_number_table(path.read_bytes()).columns
        return _build_log(columns, kinds, label or path.stem, ANGLE[angle], LENGTH[length])


def _build_log(
    columns: Mapping[str, FloatArray], kinds: Mapping[str, JointKind], label: str, angle: float, length: float
) -> MotionLog:
    """Return the log of columns (N,) by header, in units of `angle` [rad] and `length` [m].

    Raises:
        MeasurementError: a column is missing, or the times are not equally spaced.
        RequestError: the unit of a column is not known.
    """
    # Encoder → joint → positions
    encoders: dict[str, dict[str, list[float]]] = {"motor": {}, "link": {}}
    for header, values in columns.items():
        name = header.partition("[")[0].strip()
        encoder, _, joint_text = name.partition("_")
        joint = _find_name(joint_text, list(kinds), header) if encoder in encoders else None
        if joint is None:
            continue
        if joint in encoders[encoder]:
            raise MeasurementError(
                f"the log has two columns for the {encoder} of {joint}",
                where=header,
                remedy="keep one of both",
            )
        sizes, size_in_log = (ANGLE, angle) if kinds[joint] == "revolute" else (LENGTH, length)
        size = parse_unit_factor(header, sizes)
        encoders[encoder][joint] = (values * size / size_in_log).tolist()
    return _check_log(label, _find_period(columns), encoders)


def _check_log(label: str, period: float, encoders: Mapping[str, Any]) -> MotionLog:
    """Return a log with a sampling period [s] and positions of each joint by both encoders.

    Raises:
        MeasurementError: an encoder has no positions, or the log does not suit an identification.
    """
    if not encoders["motor"] or not encoders["link"]:
        raise MeasurementError(
            "the log has no columns with angles of motors and links",
            where="motor_1",
            remedy=f"use the headers {_EXAMPLE}",
        )
    try:
        return MotionLog(label=label, period=period, **encoders)
    except ValidationError as error:
        fault = error.errors()[0]
        raise MeasurementError(
            f"the log cannot be used: {fault['msg']}",
            where=".".join(map(str, fault["loc"])) or "log",
            remedy="log all encoders at equal intervals of at most 20 ms, without gaps",
        ) from error


def _find_name(text: str, joints: list[str], header: str) -> str | None:
    """Return the joint of a name, or of a number from the base; None for another quantity of a motor.

    Raises:
        MeasurementError: the robot has no such joint.
    """
    if text in joints:
        return text
    if text.isdecimal() and 1 <= int(text) <= len(joints):
        return joints[int(text) - 1]
    if not text.isdecimal():
        return None
    raise MeasurementError(
        f"the robot has no joint '{text}'",
        where=header,
        remedy=f"use a number, or one of {', '.join(joints)}",
    )


def _find_period(columns: Mapping[str, FloatArray]) -> float:
    """Return the interval of the times [s] in a column `t` or `time`.

    Raises:
        MeasurementError: there are no times, or they are not equally spaced.
        RequestError: the unit of the times is not known.
    """
    for header, values in columns.items():
        if header.partition("[")[0].strip() not in ("t", "time"):
            continue
        steps = parse_unit_factor(header, _TIMES) * np.diff(values)
        period = float(np.mean(steps)) if len(steps) else 0.0
        if not period > 0.0 or np.abs(steps - period).max() > _STEADY * period:
            raise MeasurementError(
                "the samples are not at equal intervals of time",
                where=header,
                remedy="log at the controller's cycle, or interpolate the log to equal intervals",
            )
        return round(period, 9)
    raise MeasurementError("the log has no column of times", where="t", remedy=f"use the headers {_EXAMPLE}")
