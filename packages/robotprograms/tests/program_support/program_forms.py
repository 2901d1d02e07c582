"""Programs in the forms of people: templates with numbers drawn, and the truth of each move.

A file of templates has programs after `=== title`, and their files after `--- name`. In a template

* `@` is a pose and `@j` are joint angles, for which numbers are drawn and written in the language;
* `8* ` before a line repeats the line, with other numbers each time;
* `P[2..9]` repeats a line of FANUC for each of these positions;
* ` => base tool` behind a line says that the line moves to numbers, with this base and this tool; `?` is a
  frame that the files do not state. A line without the mark does not move to numbers.

A template of FANUC has instructions without numbers and ends of lines, which are added. After /POS,
`positions 1-4 UF 3 UT 2` (or `joints ...`) becomes the blocks of these positions; a move to one of them is
marked by ` =>` alone, because the position has the frames.

The numbers come from here and not from the reader, whose answers are compared with them.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

import numpy as np

from robotprograms.errors import ProgramError
from robotprograms.formats import read_program
from robotprograms.program import FrameName

from .written_programs import moves_of, targets_of

FOLDER = Path(__file__).parents[1] / "forms"
LANGUAGES = ("krl", "rapid", "urscript", "fanuc")
_MARK = " =>"
_TAB = ",\t"
_NAMED = re.compile(r"([$\w]+(?:\[\d+\])?)(?:\[\])?\s?:?=\s?(?:\{(?:\w+:)?\s?)?@")
_WORD = re.compile(r"[$\w]+(?:\[\d+\])?")
_NOT_TARGET = re.compile(r"qnear\s*=\s*\w+|pose_trans\(\s*\w+")
_POSITIONS = re.compile(r"(positions|joints) (\S+) UF (\w+) UT (\w+)(.*)")
_QUATERNIONS = (
    (0.0, 0.0, 1.0, 0.0),
    (0.707106781, 0.0, 0.707106781, 0.0),
    (0.5, -0.5, 0.5, 0.5),
    (0.000560976, 0.707046881, 0.707166231, 0.000560881),
)
Numbers = tuple[float, ...]


class Truth(NamedTuple):
    """Targets of a move to numbers in their order, its base and its tool; `?` for a frame nobody states."""

    targets: tuple[Numbers, ...]
    base: str
    tool: str


class Form(NamedTuple):
    """A program: its files, and the truth of its moves to numbers by their lines in the first file."""

    title: str
    files: list[tuple[str, bytes]]
    truth: dict[int, Truth]


def read_forms(language: str) -> Iterator[Form]:
    """Yield the programs of a language with numbers drawn, the same in each run."""
    for part in (FOLDER / f"{language}.txt").read_text(encoding="utf-8").split("\n=== ")[1:]:
        title, _, rest = part.partition("\n")
        _, *texts = re.split(r"^--- (.*)\n", rest, flags=re.MULTILINE)
        yield _Drawing(language, title).fill(list(zip(texts[::2], texts[1::2], strict=True)))


class Judgement(NamedTuple):
    """Moves of a program by their lines in the first file: to numbers, known, and known wrongly."""

    literal: frozenset[int]
    known: frozenset[int]
    wrong: tuple[str, ...]


def judge(form: Form, *, trust_routines: bool) -> Judgement:
    """Compare what the reader knows of a program with the truth."""
    literal = frozenset(form.truth)
    try:
        program = read_program(form.files, leave_others=True, trust_routines=trust_routines)
    except ProgramError as error:
        if not error.left_moves:
            raise
        return Judgement(literal, frozenset(), ())
    targets, known, wrong = targets_of(program), set[int](), list[str]()
    for move in moves_of(program):
        own = [targets[i] for i in move.targets]
        found = Truth(tuple(each.values for each in own), _plain(own[-1].base), _plain(own[-1].tool))
        truth = form.truth.get(move.line, Truth((), "?", "?"))
        if (found.base, found.tool) != (truth.base, truth.tool) or not (
            len(found.targets) == len(truth.targets)
            and all(
                np.allclose(*pair, rtol=0, atol=1e-9) for pair in zip(*found[:1], *truth[:1], strict=True)
            )
        ):
            wrong.append(f"{form.title}, line {move.line}: {found}, not {truth}")
        known.add(move.line)
    return Judgement(literal, frozenset(known & literal), tuple(wrong))


def _plain(frame: FrameName) -> str:
    """Return the name of a frame as the truth writes it, without the line that gave its numbers."""
    if frame.name.startswith("active TCP of") and frame.pose is not None:
        return "tcp:" + ",".join(f"{each:g}" for each in (frame.pose[:3, 3].round(9) + 0.0).tolist())
    name = frame.name.partition(" of line")[0].removeprefix("active ")
    return "base" if name == "robot base" else name


class _Drawing:
    """A template of a program in which places get numbers."""

    def __init__(self, language: str, title: str) -> None:
        self._language, self._title, self._random = language, title, Random(title)  # noqa: S311
        self._places = self._random.choice((4, 6, 12)) if language == "urscript" else 3
        self._comma = self._random.choice((",", ", "))
        self._named = dict[str, Numbers]()  # numbers of each name that gets numbers
        self._frames = dict[str, tuple[str, str]]()  # base and tool of FANUC's positions

    def fill(self, templates: list[tuple[str, str]]) -> Form:
        """Return the program of a template."""
        files = []
        for name, text in templates:
            lines = self._write_fanuc(text) if self._language == "fanuc" else text.rstrip("\n").split("\n")
            files.append((name, [self._fill_line(each) for line in lines for each in _repeat(line)]))
        truth = {
            number: self._find_truth(line, mark, drawn)
            for number, (line, mark, drawn) in enumerate(files[0][1], 1)
            if mark is not None
        }
        texts = [(name, "".join(f"{line}\n" for line, *_ in lines).encode()) for name, lines in files]
        return Form(self._title, texts, truth)

    def _find_truth(self, line: str, mark: str, drawn: list[Numbers]) -> Truth:
        """Return the truth of a marked line, whose targets are drawn on the line or have names."""
        if self._language == "fanuc":  # an arc names its second position on the next line
            line, mark = re.sub(r":[^\[\]]*\]", "]", line.partition(":")[2] + mark), ""
        names = [each for each in _WORD.findall(_NOT_TARGET.sub("", line)) if each in self._named]
        base, tool = mark.split() or self._frames[names[-1]]
        return Truth(tuple(drawn or map(self._named.__getitem__, names)), base, tool)

    def _fill_line(self, text: str) -> tuple[str, str | None, list[Numbers]]:
        """Return a line with numbers in its places, what its mark says, and the numbers drawn for it."""
        plain, marked, mark = text.partition(_MARK)
        pieces = re.split(r"@(j?)", plain)
        drawn = [self._draw(joints=bool(each)) for each in pieces[1::2]]
        pieces[1::2] = [self._write(*each) for each in zip(drawn, map(bool, pieces[1::2]), strict=True)]
        if name := _NAMED.search(plain):
            self._named[name[1]] = drawn[0]
        targets = [
            each for each, text in zip(drawn, pieces[::2], strict=False) if not text.endswith("qnear=")
        ]
        return "".join(pieces), mark if marked else None, targets

    def _draw(self, *, joints: bool) -> Numbers:
        """Return joint angles, or a pose as the language states it."""
        draw, is_ur = self._random.uniform, self._language == "urscript"
        if joints:
            angles = [
                draw(*each) for each in ((-60, 60), (-80, -40), (40, 100), (-50, 50), (20, 80), (-90, 90))
            ]
            return tuple(round(each / 57.3 if is_ur else each, self._places) for each in angles)
        place = draw(400, 900), draw(-400, 400), draw(200, 700)
        if self._language == "rapid":
            return (*(round(each, 2) for each in place), *self._random.choice(_QUATERNIONS))
        if is_ur:
            turn = draw(-1, 1), draw(-3, 3), draw(-1, 1)
            return tuple(round(each, self._places) for each in (*(each / 1e3 for each in place), *turn))
        return tuple(round(each, 3) for each in (*place, draw(-90, 90), draw(-30, 30), draw(150, 179)))

    def _write(self, values: Numbers, joints: bool) -> str:
        """Return a pose or joint angles in the language."""
        comma = self._comma
        texts = [str(each) if self._random.random() < 0.5 else f"{each:.12f}" for each in values]
        if self._language == "krl":
            names = [f"A{i}" for i in range(1, 7)] if joints else list("XYZABC")
            return comma.join(f"{name} {each}" for name, each in zip(names, texts, strict=True))
        if self._language == "urscript":
            return f"{'' if joints else 'p'}[{comma.join(texts)}]"
        axes = f"[{comma.join([self._random.choice(('9E9', '9E+09'))] * 6)}]"
        if joints:
            return f"[[{comma.join(texts)}]{comma}{axes}]"
        turns = self._random.choice(("[0,0,0,0]", "[-1,0,-1,0]", "[0,-1,1,1]"))
        place, turn = comma.join(texts[:3]), comma.join(texts[3:])
        return f"[[{place}]{comma}[{turn}]{comma}{turns}{comma}{axes}]"

    def _write_fanuc(self, text: str) -> Iterator[str]:
        """Yield the lines of a program of FANUC, as the controller writes them."""
        head, _, rest = text.partition("/MN\n")
        body, _, positions = rest.partition("/POS\n")
        yield from head.splitlines()
        yield "/MN"
        for number, line in enumerate((each for row in body.splitlines() for each in _count(row)), 1):
            plain, marked, _ = line.partition(_MARK)
            blanks = "" if re.match(r"[JLCAS] P", plain) else "  "
            first, arc, second = plain.partition("\\")  # an arc continues on a second line
            if arc:
                yield f"{number:4}:{blanks}{first}    {_MARK + second if marked else ''}"
                yield f"    :  {second} ;"
            else:
                yield f"{number:4}:{blanks}{plain} ;{_MARK if marked else ''}"
        yield "/POS"
        for line in positions.splitlines():
            match = _POSITIONS.fullmatch(line)
            yield from self._write_positions(*match.groups()) if match else [line]
        yield "/END"

    def _write_positions(self, kind: str, numbers: str, base: str, tool: str, more: str) -> Iterator[str]:
        """Yield the blocks of positions with these numbers, and note their numbers and frames."""
        is_joints = kind == "joints"
        names = [f"J{i}" for i in range(1, 7)] if is_joints else list("XYZWPR")
        units = ["deg"] * 6 if is_joints else ["mm"] * 3 + ["deg"] * 3
        config = "" if is_joints else "\tCONFIG : 'N U T, 0, 0, 0',"
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", numbers):
            for n in range(int(first), int(last or first) + 1):
                name, values = f"P[{n}]", self._draw(joints=is_joints)
                self._named[name], self._frames[name] = values, (f"UF {base}", f"UT {tool}")
                fields = [
                    f"{name}{'=' if is_joints else ' ='} {value:9.3f} {unit:>3}"
                    for name, value, unit in zip(names, values, units, strict=True)
                ]
                yield from (f"{name}{{", "   GP1:", f"\tUF : {base}, UT : {tool},\t{config}")
                yield f"\t{_TAB.join(fields[:3])},"
                yield f"\t{_TAB.join(fields[3:])}{more}"
                yield "};"


def _repeat(line: str) -> list[str]:
    """Return a line as often as the number before its star says."""
    match = re.match(r"( *)(\d+)\* ", line)
    return [match[1] + line[match.end() :]] * int(match[2]) if match else [line]


def _count(line: str) -> list[str]:
    """Return a line of FANUC for each of the positions `P[2..9]` that it names."""
    match = re.search(r"P\[(\d+)\.\.(\d+)\]", line)
    if match is None:
        return [line]
    numbers = range(int(match[1]), int(match[2]) + 1)
    return [f"{line[: match.start()]}P[{n}]{line[match.end() :]}" for n in numbers]
