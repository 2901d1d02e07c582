"""Statements of robot programs, and what becomes of the moves around them.

    cd packages/robotprograms/tests
    python -m program_support.constructs [WORD]          print what changed
    python -m program_support.constructs --write [WORD]  write it, too

WORD selects files of `constructs/` by name. A file has, line by line:

    POSE = {X 1,Y 2}            an abbreviation
    unknown {a}: '{a}' is …     words of a fault and its remedy behind their short form; … is any text
    # Loops                     a subject
    in frame.src [TEXT]          the program around its statements: … is the statement, § what it has behind §
    LIN P9 → 5 7, left 6; 6: …  a statement (⏎ ends a line, ⇥ is a tab, ++ begins another file), its outcome

An outcome names lines: those of moves that are corrected; `left` ones, which are not certain; `kept` ones, to
places of the controller; and faults. A corrected move is described where it is none of the program around
(motion, name, numbers, base, tool, words of the configuration), or is `as` that of another line.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from difflib import unified_diff
from pathlib import Path

from program_support.written_programs import moves_of, targets_of

from robotprograms.errors import Fault, ProgramError, ReadMove
from robotprograms.formats import read_program
from robotprograms.program import FrameName, Program

PROGRAMS = Path(__file__).parents[1]
FOLDER = PROGRAMS / "constructs"
ARROW = " → "


@dataclass
class Subject:
    """Statements in one program around them."""

    title: str
    file: str = ""
    around: str = "…"
    statements: list[tuple[str, str]] = field(default_factory=list)  # each with its outcome


@dataclass
class Constructs:
    """A file of statements."""

    head: list[str]
    abbreviations: dict[str, str]
    words: dict[str, re.Pattern[str]]  # of faults, by their short form
    subjects: list[Subject]

    @classmethod
    def read(cls, path: Path) -> Constructs:
        """Read a file."""
        head, _, rest = path.read_text(encoding="utf-8").partition("\n# ")
        found = cls(head.rstrip("\n").splitlines(), {}, {}, [])
        for line in found.head:
            if name := re.match(r"([A-Z]+) = ", line):
                found.abbreviations[name[1]] = line[name.end() :]
            elif ": " in line:
                short, _, sentence = line.partition(": ")
                found.words[short] = _pattern(found.unfolded(sentence))
        for line in f"# {rest}".splitlines():
            if line.startswith("# "):
                found.subjects.append(Subject(line[2:]))
            elif line.startswith("in "):
                name, _, text = line[3:].partition(" ")
                subject = found.subjects[-1]
                subject.file = name
                subject.around = text or (PROGRAMS / "samples" / name).read_text()
            elif line:
                statement, _, outcome = line.rpartition("→")
                found.subjects[-1].statements.append((statement.strip(), outcome.strip()))
        return found

    def unfolded(self, text: str) -> str:
        """Return a text with what its abbreviations stand for."""
        for name, long in self.abbreviations.items():
            text = re.sub(rf"(?<![A-Z_]){name}(?![A-Z_])", lambda _, long=long: long, text)
        return text

    def answers(self, subject: Subject) -> Iterator[tuple[str, str, str]]:
        """Yield each statement, its outcome, and what becomes of it today."""
        bare = self._read(subject, "")[0]
        before = subject.around.partition("…")[0]
        place = before.count("\n") + before.count("⏎") + 1
        for statement, outcome in subject.statements:
            own = _moved(bare, place, statement.partition("§")[0].count("⏎"))
            yield statement, outcome, self._told(*self._read(subject, statement), own if statement else {})

    def files(self, subject: Subject, statement: str) -> list[tuple[str, bytes]]:
        """Return names and bytes of the program with a statement of a subject."""
        body, _, behind = statement.partition("§")
        text = subject.around.replace("…", body.strip(" ")).replace("§", behind.strip(" "))
        first, *others = self.unfolded(text).replace("⏎", "\n").replace("⇥", "\t").split(" ++ ")
        files = [(subject.file, first), *(tuple(each.split(": ", 1)) for each in others)]
        return [(name, part.encode("latin-1")) for name, part in files]

    def _read(self, subject: Subject, statement: str) -> tuple[Moves, list[str]]:
        try:
            program = read_program(self.files(subject, statement), leave_others=True)
        except ProgramError as error:
            return {}, ["refused", *self._faults(subject, error.faults, error.left_moves)]
        kept = [f"kept {each.line} {each.target}".rstrip() for each in program.left_alone]
        return _described(program), [*self._faults(subject, program.faults, program.left_moves), *kept]

    def _faults(
        self, subject: Subject, faults: tuple[Fault, ...], left: tuple[ReadMove, ...]
    ) -> Iterator[str]:
        if left:
            yield f"left {' '.join(str(each.line) for each in left)}"
        for fault in faults:
            file = "" if fault.file == subject.file else f"{fault.file} "
            yield f"{file}{fault.line}: {self._short(f'{fault.reason}; {fault.remedy}')}"

    def _short(self, sentence: str) -> str:
        for short, pattern in self.words.items():
            if found := pattern.fullmatch(sentence):
                return re.sub(r"\{(\w)\}", lambda place, found=found: found[place[1]], short)
        return sentence

    def _told(self, moves: Moves, rest: list[str], own: Moves) -> str:
        same = [str(line) for line, each in moves.items() if own.get(line) == each]
        known, other = {each: line for line, each in own.items()}, []
        for line, each in moves.items():
            if own.get(line) != each:
                other.append(f"{line} {f'as {known[each]}' if each in known else each}")
                known.setdefault(each, line)
        return "; ".join([*([" ".join(same)] if same else []), *other, *rest])

    def written(self) -> str:
        """Return the file with what becomes of its statements today."""
        lines = [*self.head, ""]
        for subject in self.subjects:
            path = PROGRAMS / "samples" / subject.file
            is_sample = path.is_file() and path.read_text() == subject.around
            around = subject.file if is_sample else f"{subject.file} {subject.around}"
            lines += [f"# {subject.title}", f"in {around}"]
            lines += [f"{each}{ARROW}{now}".lstrip() for each, _, now in self.answers(subject)]
            lines.append("")
        return "\n".join(lines)


Moves = dict[int, str]
"""Corrected moves by their lines: motions, targets and frames."""


def _described(program: Program) -> Moves:
    targets, moves = targets_of(program), Moves()
    for move in moves_of(program):
        parts = []
        for each in (targets[index] for index in move.targets):
            source = program.sources[each.source].text
            words = [each.letters, *(f"{name} {source[start:end]}" for name, start, end in each.words)]
            name = f"{each.name} of line {each.line}, " if each.name else ""
            numbers = " ".join(f"{x:.7g}" for x in each.values)
            frames = f"in {_framed(each.base)} with {_framed(each.tool)}"
            parts.append(" ".join([f"{name}{numbers}", frames, *filter(None, words)]))
        before = f"{moves[move.line]}, then " if move.line in moves else ""
        moves[move.line] = f"{before}{move.motion.value} {' and '.join(parts)}"
    return moves


def _framed(frame: FrameName) -> str:
    place = "" if frame.pose is None else " " + ",".join(f"{x:.6g}" for x in frame.pose[:3, 3])
    return f"{frame.name}{place}"


def _moved(moves: Moves, place: int, lines: int) -> Moves:
    """Return moves where they stand once a statement has more lines than one."""

    def later(line: int) -> int:
        return line + lines * (line > place)

    return {
        later(line): re.sub(r"(?<=of line )\d+", lambda found: str(later(int(found[0]))), each)
        for line, each in moves.items()
    }


def _pattern(sentence: str) -> re.Pattern[str]:
    """Return the pattern of a sentence with places `{a}`, each the same text, and `…`, any text."""
    pattern, seen = "", set[str]()
    for part in re.split(r"(\{\w\}|…)", sentence):
        if part == "…":
            pattern += ".*"
        elif re.fullmatch(r"\{\w\}", part):
            pattern += f"(?P={part[1]})" if part in seen else f"(?P<{part[1]}>.+?)"
            seen.add(part)
        else:
            pattern += re.escape(part)
    return re.compile(pattern)


def main(*words: str) -> int:
    """Print what changed, and write it if asked; return how many files have changed."""
    chosen, count = [word for word in words if word != "--write"], 0
    for path in sorted(FOLDER.glob("*.txt")):
        if chosen and not any(word in path.stem for word in chosen):
            continue
        then, now = path.read_text(encoding="utf-8"), Constructs.read(path).written()
        sys.stdout.writelines(
            unified_diff(then.splitlines(True), now.splitlines(True), path.name, "today", n=0)
        )
        count += then != now
        if "--write" in words:
            path.write_text(now, encoding="utf-8")
    return count


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]) > 0)
