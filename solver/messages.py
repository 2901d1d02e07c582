"""Functions that fill messages of `schemas` from arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from jointstiff.schemas.fields import Message, validate_list
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import Rigid

Built = TypeVar("Built", bound=Message)


def build_messages(kind: type[Built], /, **columns: Sequence[Any] | np.ndarray[Any, Any]) -> list[Built]:
    """Build messages of one class from a table: one message for each row, with a column for each field.

    Args:
        kind: class of the messages.
        columns: list of values of each field of the messages, by the field's name; all have the same length.
    """
    return validate_list(kind, build_row_dictionaries(**columns))


def build_row_dictionaries(**columns: Sequence[Any] | np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    """Turn named columns of equal length into a list of rows, each a dictionary by the columns' names.

    In the rows, arrays become lists, and numbers that are not finite become None.
    """
    values = zip(*map(_to_json_list, columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in values]


def finite_or_none(value: float | None) -> float | None:
    """Return a number as a plain float; None where the number is missing or not finite."""
    return None if value is None or not isfinite(value) else float(value)


def to_rigid(transform: pin.SE3) -> Rigid:
    """Convert a rigid transform of pinocchio to a message: rotation matrix, and translation [m]."""
    return Rigid(rotation=transform.rotation.tolist(), translation=point(transform.translation))


def point(vector: np.ndarray[Any, Any]) -> tuple[float, float, float]:
    """Return the three components of a vector (3,) as plain floats."""
    x, y, z = vector.tolist()
    return x, y, z


def _to_json_list(values: Sequence[Any] | np.ndarray[Any, Any]) -> list[Any]:
    """Return the values of a column as plain Python values; None for numbers that are not finite."""
    if isinstance(values, np.ndarray) and (values.dtype.kind != "f" or np.isfinite(values).all()):
        return list(values.tolist())
    return [_to_json_value(value) for value in values]


def _to_json_value(value: object) -> object:
    """Convert a value to plain Python numbers, strings and lists; None where a number is not finite."""
    if value is None or isinstance(value, str | int | dict | Message):
        return value
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.kind != "f" or np.isfinite(value).all() else None
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return [_to_json_value(item) for item in value]
    raise TypeError(f"a value of type {type(value).__name__} cannot be written to JSON")


def list_joint_kinds(names: Iterable[str], kinds: Iterable[JointKind]) -> dict[str, JointKind]:
    """Return the kind (revolute or prismatic) of each joint, in a dictionary by the joint's name.

    The dictionary is empty if all joints are revolute, because results then do not list the kinds.
    """
    by_name = dict(zip(names, kinds, strict=True))
    return by_name if "prismatic" in by_name.values() else {}
