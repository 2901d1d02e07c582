"""Results of `schemas` filled from arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from jointstiff.schemas.fields import Message, validated
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import Rigid

Built = TypeVar("Built", bound=Message)


def rows(kind: type[Built], /, **columns: Sequence[Any] | np.ndarray[Any, Any]) -> list[Built]:
    """Build one message for each row of columns of equal length, named by their fields."""
    return validated(kind, table(**columns))


def table(**columns: Sequence[Any] | np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    """Return the fields of such messages: arrays become lists; what is not finite becomes null."""
    values = zip(*map(_column, columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in values]


def finite(value: float | None) -> float | None:
    """Return a number as messages take it; None where it is not finite."""
    return None if value is None or not isfinite(value) else float(value)


def to_rigid(transform: pin.SE3) -> Rigid:
    """Return a transform as messages take it."""
    return Rigid(rotation=transform.rotation.tolist(), translation=point(transform.translation))


def point(vector: np.ndarray[Any, Any]) -> tuple[float, float, float]:
    """Return three components as messages take them."""
    x, y, z = vector.tolist()
    return x, y, z


def _column(values: Sequence[Any] | np.ndarray[Any, Any]) -> list[Any]:
    if isinstance(values, np.ndarray) and (values.dtype.kind != "f" or np.isfinite(values).all()):
        return list(values.tolist())
    return [_plain(value) for value in values]


def _plain(value: object) -> object:
    if value is None or isinstance(value, str | int | dict | Message):
        return value
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.kind != "f" or np.isfinite(value).all() else None
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return [_plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} is no part of a message")


def stated_kinds(names: Iterable[str], kinds: Iterable[JointKind]) -> dict[str, JointKind]:
    """Return the kinds of joints by name, as results state them: none where all turn."""
    by_name = dict(zip(names, kinds, strict=True))
    return by_name if "prismatic" in by_name.values() else {}
