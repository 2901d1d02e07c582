"""Texts that are no JSON documents: hostile ones are explained in one pass over their bytes."""

import pytest

from jointstiff.service.conversion.parsing import explain_broken_text

COMMENT = "begins with a comment"


@pytest.mark.timeout(30)
@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (b"a=" + b"&a=" * 5000 + b"{", None),
        (b"/* */" * 5000 + b"x", None),
        (b"#\n" * 5000 + b"x", None),
        (b"//\n \n" * 5000 + b"x", None),
        (b"a." * 5000 + b"!", None),
        (b"/* a */ // b\n# c\n[1", COMMENT),
        (b"/* a * / b */ {}", COMMENT),
        (b"name=a&robot=b", "is a list of `name=value` pairs"),
    ],
    ids=lambda value: value[:8].decode() if isinstance(value, bytes) else None,
)
def test_a_hostile_text_is_explained_soon(content, cause):
    """Patterns that match a text in many ways took minutes for 30 comments or pairs."""
    broken = explain_broken_text(content, "expected value at line 1 column 1")
    assert (broken is None) if cause is None else broken.cause.startswith(cause)
