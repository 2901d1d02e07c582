"""Vectors on the command line: one form, lengths in mm, and a question where a length is implausible."""

from __future__ import annotations

import sys

import pytest
import typer

from jointstiff.service.cli.options import point_of, vector_of


def test_a_point_is_given_in_millimetres():
    assert point_of("0,-12.5,120") == pytest.approx((0.0, -0.0125, 0.12), abs=1e-15)
    assert vector_of("0,300,-500") == (0.0, 300.0, -500.0)


@pytest.mark.parametrize("text", ["1,2", "0 0 120", "a,b,c", "1,2,3,4", ""])
def test_what_is_no_vector_is_refused(text):
    with pytest.raises(typer.BadParameter, match=r"three numbers, such as 0,0,120\.5"):
        point_of(text)


@pytest.mark.parametrize(
    ("text", "answer", "taken"),
    [
        ("0,0,5000", False, True),
        ("0,0,5001", True, True),
        ("0,0,5001", False, False),
        ("0,0,nan", True, False),
    ],
)
def test_a_point_beyond_5_m_is_asked_about(monkeypatch, text, answer, taken):
    asked = []
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("typer.confirm", lambda question, **_: (asked.append(question), answer)[1])
    if taken:
        assert point_of(text)[2] == 1e-3 * float(text.split(",")[2])
    else:
        with pytest.raises(typer.BadParameter, match="give X,Y,Z in mm"):
            point_of(text)
    assert asked == (
        ["'0,0,5001' in mm is 5.001 m from the flange. Is that right?"] if "5001" in text else []
    )


def test_nobody_to_ask_is_no_consent(monkeypatch):
    monkeypatch.setattr(sys.stdin, "isatty", lambda: False, raising=False)
    with pytest.raises(typer.BadParameter, match="120 m from the flange"):
        point_of("0,0,120000")
