"""Vectors on the command line: one form, lengths in mm."""

from __future__ import annotations

import pytest
import typer

from jointstiff.service.cli.options import point_of


@pytest.mark.parametrize("text", ["1,2", "0 0 120", "a,b,c", "1,2,3,4", ""])
def test_what_is_no_vector_is_refused(text):
    with pytest.raises(typer.BadParameter, match=r"three numbers, such as 0,0,120\.5"):
        point_of(text)
