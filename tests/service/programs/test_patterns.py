"""Patterns that read what others write, beside plain readings of the same rules: every Python splits alike.

Python before 3.11.5 keeps what a possessive group took before it failed: it read 7E as a number.
"""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples

from jointstiff import schemas, service, solver
from jointstiff.service.programs import fanuc, krl, rapid, ur
from jointstiff.service.programs.formats import read_program
from jointstiff.service.programs.notation import Numerals
from jointstiff.service.security import admission

DIGITS = "0123456789"


def run(text, place, signs, most=math.inf):
    """Return the end of a run of signs."""
    end = place
    while end < len(text) and text[end] in signs and end - place < most:
        end += 1
    return end


def scan(text, *rules):
    """Return first and last + 1 character of all that a rule finds, from the left, the first rule first."""
    place, spans = 0, []
    while place < len(text):
        end = next((end for rule in rules if (end := rule(text, place))), 0)
        if end:
            spans.append((place, end))
        place = end or place + 1
    return spans


def number(text, place):
    """A sign, digits, a fraction, an exponent; no letter before it, and at least one digit."""
    if text[place] not in "+-." + DIGITS or (place and (text[place - 1].isalnum() or text[place - 1] == "_")):
        return 0
    begin = place + (text[place] in "+-")
    end = run(text, begin, DIGITS, 15)
    point = end < len(text) and text[end] == "."
    if end > begin:
        end = run(text, end + 1, DIGITS, 20) if point else end
    elif not point or (end := run(text, begin + 1, DIGITS, 20)) == begin + 1:
        return 0
    if end < len(text) and text[end] in "eE":
        sign = run(text, end + 1, "+-", 1)
        exponent = run(text, sign, DIGITS, 3)
        end = exponent if exponent > sign else end
    return end


def binary(text, place):
    """KUKA's 'B010'."""
    end = run(text, place + 2, "01", 16)
    return end + 1 if text.startswith("'B", place) and end > place + 2 and text.startswith("'", end) else 0


def line_end(text, place):
    return next((end for end in range(place, len(text)) if text[end] in "\r\n"), len(text))


def remark(text, place):
    return line_end(text, place) if text[place] == "!" else 0


def header(text, place):
    """`%%% VERSION:1 LANGUAGE:ENGLISH %%%` at the begin of a line."""
    if not text.startswith("%%%", place) or (place and text[place - 1] not in "\r\n"):
        return 0
    rest = text[place + 3 :].lstrip()
    while rest.startswith(("VERSION", "LANGUAGE")):
        rest = rest.removeprefix("VERSION") if rest[0] == "V" else rest.removeprefix("LANGUAGE")
        word = rest.lstrip().removeprefix(":").lstrip()
        if not rest.lstrip().startswith(":") or not word or not (word[0].isalnum() or word[0] == "_"):
            return 0
        rest = word[
            next((i for i, sign in enumerate(word) if not (sign.isalnum() or sign == "_")), len(word)) :
        ]
        rest = rest.lstrip()
    return len(text) - len(rest) + 3 if rest.startswith("%%%") else 0


def quoted(text, place):
    end = text.find('"', place + 1)
    return end + 1 if text[place] == '"' and 0 < end < line_end(text, place) else 0


def semicolon(text, place):
    return place + 1 if text[place] == ";" else 0


def position(text, place):
    """A position of /POS, up to the first `};`."""
    end = text.find("};", place + 1)
    return end + 2 if text[place] == "P" and end > 0 else 0


def other(text, place):
    end = text.find("P", place + 1)
    return 0 if text[place].isspace() else end if end > 0 else len(text)


def json_string(text, place):
    """A string of JSON, whether it ends or not, and the colon behind it."""
    if text[place] != '"':
        return 0
    place += 1
    while place < len(text) and text[place] != '"':
        if text[place] == "\\" and place + 1 == len(text):
            return place
        place += 1 + (text[place] == "\\")
    if place == len(text):
        return place
    end = run(text, place + 1, " \t\n\r\f\v")
    return end + text.startswith(":", end)


def texts(*parts):
    return st.lists(st.sampled_from(parts), max_size=14).map("".join)


NUMBERS = texts(*"0179.+-eE' B_a\n", "7E", "1e5", "+E+", "'B01'", "1" * 14, "²", ".5", "e1234")


@pytest.mark.parametrize(
    ("lexicon", "rules"),
    [(krl.LANGUAGE, (number, binary)), *((each.LANGUAGE, (number,)) for each in (rapid, fanuc, ur))],
    ids=["krl", "rapid", "fanuc", "ur"],
)
@examples(1000)
@given(text=NUMBERS)
def test_numbers(lexicon, rules, text):
    spans = [match.span() for match in lexicon.numbers.finditer(text)]
    assert spans == scan(text, *rules)
    numerals = Numerals.of(text, lexicon.number)
    assert [*zip(numerals.starts.tolist(), numerals.ends.tolist(), strict=True)] == spans
    plain = (text[start:end] for start, end in spans)
    assert numerals.values.tolist() == [int(t[2:-1], 2) if t[0] == "'" else float(t) for t in plain]


@pytest.mark.parametrize(
    ("pattern", "rules", "strategy"),
    [
        (re.compile(rapid.LANGUAGE.comment), (header, remark),
         texts("%%%", "\n", "% ", "VERSION", "LANGUAGE", ":", "1", "E_1", "!", "\r\n", "\n%%%\nVERSION:1")),
        (rapid._ENDS, (quoted, remark, semicolon), texts(*'";!\n\r a', '"a"', '";"', "!;", "x := 1;")),
        (fanuc._POSITION, (position, other), texts(*"P{}; \na", "};", "P[1]{", "GP1: }")),
        (admission._STRING, (json_string,), texts(*'"\\: a\n', '\\"', "\\\\", '"a":', '""', '" :')),
    ],
    ids=["rapid comments", "rapid statements", "fanuc positions", "json strings"],
)  # fmt: skip
def test_patterns(pattern, rules, strategy):
    @examples(1500)
    @given(strategy)
    def split_alike(text):
        spans = [
            match.span()
            for match in pattern.finditer(text.encode() if pattern is admission._STRING else text)
        ]
        assert spans == scan(text, *rules)

    split_alike()


def test_a_comment_with_a_revision_is_no_number():
    text = "DEF a()\n; revision 7E\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0} ; 7E+\nEND\n"
    assert read_program([("a.src", text.encode())]).targets.values[0, :6].tolist() == [1, 2, 3, 0, 0, 0]


def test_no_group_is_possessive():
    """But for one whose text is compared above: nothing in it fails behind its first character and a run."""
    possessive = re.compile(r"(?<!\\)\)(?:[?*+]|\{[\d,]+\})\+")
    found = [
        f"{path.relative_to(folder)}: {line.strip()}"
        for package in (schemas, solver, service)
        for folder in map(Path, package.__path__)
        for path in folder.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if possessive.search(line)
    ]
    assert [line.split(":")[0] for line in found] == ["security/admission.py"]
