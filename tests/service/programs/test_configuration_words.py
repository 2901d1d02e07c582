"""Words of a configuration: what is written for an angle is read as a range that holds it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples

from jointstiff.service.kinds.program_path import _WORDS

EVERY = [(name, word) for name, words in _WORDS.items() for word in words]


@pytest.mark.parametrize(("name", "word"), EVERY, ids=[f"{name}-{word.joint}" for name, word in EVERY])
@examples(200)
@given(angle=st.floats(-9.0, 9.0).filter(lambda angle: abs(angle) > 1e-6), before=st.integers(0, 63))
def test_what_is_written_holds_the_angle(name, word, angle, before):
    number = word.rewritten(before, angle)
    ((low, high),) = word.ranges(np.array([float(number)]))
    assert low - 1e-9 <= angle <= high + 1e-9
    width = {"sign": np.inf, "quadrant": np.pi / 2, "turn": 2 * np.pi}[word.kind]
    assert high - low == pytest.approx(width)
    if word.bit is not None:
        assert (number ^ before) & ~(1 << word.bit) == 0
    assert word.ranges(np.array([np.nan])).tolist() == [[-np.inf, np.inf]]
