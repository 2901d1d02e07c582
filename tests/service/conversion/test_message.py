"""Messages from objects: by the names of their attributes, arrays as lists, null for what is not finite."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from jointstiff.schemas.fields import Message
from jointstiff.solver.messages import message


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


def test_a_missing_attribute_is_an_error_although_the_field_has_a_default():
    class Bare:
        value = 1.0

    for build in (lambda: message(Inner, Bare()), lambda: message(Outer, Source(inner=[Bare()]))):
        with pytest.raises((TypeError, ValueError), match="pair"):
            build()
    assert message(Inner, Bare(), pair=None) == Inner(value=1.0)
