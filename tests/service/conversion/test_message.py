"""Messages from objects: an attribute that is missing is no default."""

from types import SimpleNamespace

import pytest

from jointstiff.schemas.fields import Message
from jointstiff.solver.messages import message


class Inner(Message):
    value: float | None
    pair: tuple[float, float | None] | None = None


class Outer(Message):
    inner: list[Inner]


def test_a_missing_attribute_is_an_error_although_the_field_has_a_default():
    bare = SimpleNamespace(value=1.0)
    for kind, source in ((Inner, bare), (Outer, SimpleNamespace(inner=[bare]))):
        with pytest.raises((AttributeError, TypeError, ValueError), match="pair"):
            message(kind, source)
    assert message(Inner, bare, pair=None) == Inner(value=1.0)
