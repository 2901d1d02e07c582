"""Time of the program readers on hostile lines: at 2n characters over n, for each language's rules."""

from __future__ import annotations

import gc
import random
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from types import ModuleType
from typing import Final

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.service.kinds.correction.loads import read_load_table
from jointstiff.service.problems import FilesError
from robotprograms import fanuc, krl, rapid, ur
from robotprograms.language import Misread
from robotprograms.notation import Numerals

_CHARACTERS: Final = 100_000
_READERS: Final[dict[str, tuple[ModuleType, str]]] = {
    "krl": (
        krl,
        "LIN {|LIN P1|CIRC {X 1},|x=|x[|DECL E6POS P1=|$BASE=|$VEL=|FDAT_ACT=|BASE_DATA[1]=|IF |"
        "FOR i=|WAIT FOR |"
        "INTERRUPT DECL 3 WHEN |TRIGGER WHEN DISTANCE=|BAS(|f(|DEF a(|EXT a|SPLINE WITH $VEL=|"
        "SWITCH |CASE |L:",
    ),
    "rapid": (
        rapid,
        "MoveL [[|MoveL p1,|MoveL p1,v1,z1,t1\\|MoveC p1,p2,|CONST robtarget a:=[[|"
        "PERS tooldata t:=[TRUE,[[|n:=|"
        "n{|IF |FOR i FROM |WHILE |TEST n CASE |ERROR (|MODULE a(|PROC a(|FUNC num a(|RECORD a |"
        "sub |Incr |%%%",
    ),
    "fanuc": (
        fanuc,
        "L P[1] |L P[|C P[1] P[2] |L P[1] 5mm/sec FINE |L P[1] TB 1sec,|R[|R[1]=|DO[1]=|IF |"
        "SELECT R[1]=|=2,|WAIT |"
        "FOR R[1]=|CALL A(|UFRAME_NUM=|OVERRIDE=|LBL[|MESSAGE[|P[1]{ GP1: UF : 1,|P[1]{ CONFIG : '",
    ),
    "ur": (
        ur,
        "movel(p[|movel(|movel(pose_trans(|movec(p1,|movej(get_inverse_kin(|x = |x[|if |while |"
        "return |set_tcp(p[|"
        "def a(|f(|sleep(|$ 1 |global x = ",
    ),
}
"""Each language with the beginnings of its statements."""
_TAILS: Final = (
    *" \t([{)]},.-!;#%\\:=/_E*&$",
    *("1 ", "1,", "1.", "+ ", "a ", "a,", "a(", "a.", "'", '"', '"a', "\\a", ":=", "==", "//"),
    *("é", "[1:", "1e", "P[", "x="),
)
_LOADS: Final = (" ", "[", "Fx [", "x ]", '"', ",", "Fx [ N ] ")


def run(*, quick: bool, part: Part) -> list[Section]:
    """Time pairs of heads and tails, and headers of the table of loads."""
    pairs = [
        (module, head, tail)
        for module, heads in _READERS.values()
        for head in heads.split("|")
        for tail in _TAILS
    ]
    random.Random(1).shuffle(pairs)  # noqa: S311 - a sample
    chosen = pairs[:40] if quick else [pairs[i] for i in part.of(len(pairs))]
    ratios = [_growth(partial(_parse, module), head, tail) for module, head, tail in chosen]
    loads = [_growth(_read_loads, "point,Fx [", tail) for tail in _LOADS]
    rows = (
        (f"{len(ratios)} pairs of a rule's beginning and hostile text", f"{max(ratios):.2f}"),
        (f"{len(loads)} hostile headers of the table of loads", f"{max(loads):.2f}"),
    )
    figures = (
        Figure("time at 2n over n, rules of the languages", max(ratios), "at most", 2.5),
        Figure("time at 2n over n, table of loads", max(loads), "at most", 2.5),
    )
    title = f"Hostile lines of {_CHARACTERS:,} characters: time beside half of them"
    return [Section(title, ("what", "greatest ratio"), rows, figures)]


def _growth(read: Callable[[str], None], head: str, tail: str) -> float:
    """Return the ratio of times, the least of some: noise only adds."""
    short, long = (head + tail * (count // len(tail)) for count in (_CHARACTERS // 2, _CHARACTERS))
    best = float("inf")
    for repeats in (1, 2, 4):
        times = [min(_seconds(read, text) for _ in range(repeats)) for text in (short, long)]
        best = min(best, times[1] / times[0])
        if best <= 2.2:
            break
    return best


def _seconds(read: Callable[[str], None], text: str) -> float:
    gc.disable()  # it would look through all else in some of them
    begin = time.process_time()
    read(text)
    took = time.process_time() - begin
    gc.enable()
    return max(took, 1e-4)


def _parse(module: ModuleType, text: str) -> None:
    with suppress(Misread):
        module.LANGUAGE.translate(module.LANGUAGE.numbers.sub("\0", text))
    Numerals.from_text(text, module.LANGUAGE.number)


def _read_loads(text: str) -> None:
    with suppress(FilesError):
        read_load_table(text.encode(), np.arange(1, 200_001), (), lambda: np.zeros(0))
