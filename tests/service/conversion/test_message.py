"""Messages from objects: by the names of their attributes, arrays as lists, null for what is not finite."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from jointstiff.schemas.fields import Message
from jointstiff.solver.messages import message, rows


class Inner(Message):
    value: float | None
    pair: tuple[float, float | None] | None = None


class Outer(Message):
    name: str
    inner: list[Inner]
    matrix: list[list[float]] | None


@dataclass
class Source:
    value: Any = 1.0
    pair: Any = None
    name: Any = "a"
    inner: Any = ()
    matrix: Any = None


def test_objects_within_objects():
    found = message(Outer, Source(inner=(Source(np.float64(2.0), (1.0, np.inf)),), matrix=np.eye(2)))
    assert found == Outer(name="a", inner=[Inner(value=2.0, pair=(1.0, None))], matrix=[[1, 0], [0, 1]])


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_null(number):
    assert message(Inner, Source(number)).value is None
    assert message(Outer, Source(matrix=np.array([[1.0, number]]))).matrix is None


def test_a_missing_attribute_is_an_error_although_the_field_has_a_default():
    class Bare:
        value = 1.0

    for build in (lambda: message(Inner, Bare()), lambda: message(Outer, Source(inner=[Bare()]))):
        with pytest.raises((TypeError, ValueError), match="pair"):
            build()
    assert message(Inner, Bare(), pair=None) == Inner(value=1.0)


def test_rows_of_columns():
    found = rows(Inner, value=np.array([1.0, np.nan]), pair=np.array([[1.0, 2.0], [np.nan, 3.0]]))
    assert found == [Inner(value=1.0, pair=(1.0, 2.0)), Inner(value=None)]
    with pytest.raises(ValueError, match="shorter"):
        rows(Inner, value=np.ones(2), pair=[None])
