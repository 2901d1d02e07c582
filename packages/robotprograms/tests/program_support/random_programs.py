"""Random robot programs, and what a controller does that runs them.

Both come from `random_programs.txt`, which says of each statement what it does; no program is parsed. What a
program does not say (conditions, what unknown routines change, when interrupts come) is drawn.
"""

import re
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

STEPS = 400
"""Most statements of a run."""
SLOT = re.compile(r"<([^<>\s][^<>]*)>")


class Seen(NamedTuple):
    """A move that was carried out."""

    line: int
    targets: list[Any]
    bases: list[Any]  # of each target: a first coordinate, or a name
    tools: list[Any]


@dataclass(eq=False)
class Statement:
    """A statement of a program, with what it does; `<x>` stands for its coordinate."""

    text: str
    does: str = ""
    nest: "Nest | None" = None
    line: int = 0

    @property
    def targets(self) -> list[str]:
        """Names of the targets of a move."""
        moved = re.match(r"(?:maybe )?see ([^/]*) / ", self.does)
        return re.findall(r"[a-zA-Z]\d", moved[1]) if moved else []


@dataclass(eq=False)
class Nest:
    """A branch or a loop."""

    kind: str  # branch, loop, once: a loop that is carried out once at least, or forever: one without an end
    opens: Statement
    closes: Statement
    turns: Statement | None = None


class Stopped(Exception):  # noqa: N818
    """The controller stops the program."""


@dataclass(frozen=True)
class Language:
    """The statements of a language, as `random_programs.txt` has them."""

    name: str  # name of the file
    coordinate: str
    is_numbered: bool
    parts: dict[str, list[str]]

    @classmethod
    def of(cls, text: str) -> "Language":
        """Read the text of a language."""
        head, *parts = re.split(r"^--- ", text.strip("\n"), flags=re.MULTILINE)
        _, name, coordinate, *numbered = head.split()
        named = (part.strip("\n").split("\n") for part in parts)
        return cls(name, coordinate, bool(numbered), {name: lines for name, *lines in named})

    def part(self, name: str) -> str:
        """Return a part of one line, or nothing."""
        return self.parts.get(name, [""])[0]

    def make(self, draw: Random) -> "Program":
        """Draw a program."""
        has_beside, statements = draw.random() < 0.2, list[Statement]()
        for line in self.parts["program"]:
            share = int(found[1]) if (found := re.match(r"(\d+)% ", line)) else 100
            only, plain = line.startswith("beside "), re.sub(r"^(\d+% |beside )", "", line)
            if 100 * draw.random() >= share or (only and not has_beside):
                continue
            if plain != "...":
                statements.append(self._statement(draw, plain))
                continue
            block = self._block(draw, has_beside=has_beside)
            if label := self.part("label"):
                block.insert(draw.randint(0, len(block)), Statement(label, "label"))
            statements += block
        return Program(self, statements)

    def _statement(self, draw: Random, line: str, nest: Nest | None = None) -> Statement:
        text, _, does = line.partition("  |  ")
        drawn = list[str]()

        def slot(found: re.Match[str]) -> str:
            if found[1] == "x":
                return f"<{self.coordinate.format(draw.randint(1, 999))}>"
            first, _, last = found[1].partition("-")
            choices = found[1].split("|")
            drawn.append(str(draw.randint(int(first), int(last))) if last else draw.choice(choices))
            return drawn[-1]

        text = SLOT.sub(slot, text.replace("\\n", "\n").replace("\\t", "\t"))
        return Statement(text, re.sub(r"#(\d)", lambda found: drawn[int(found[1]) - 1], does), nest)

    def _block(self, draw: Random, depth: int = 0, *, has_beside: bool) -> list[Statement]:
        statements = list[Statement]()
        lines = [re.split(r"(?<=\d) ", line, maxsplit=1) for line in self.parts["statements"]]
        lines = [each for each in lines if has_beside or "|  beside" not in each[1]]
        for _ in range(draw.randint(1, 5)):
            if depth == 3 or draw.random() >= 0.25:
                (line,) = draw.choices(lines, [int(weight) for weight, _ in lines])
                statements.append(self._statement(draw, line[1]))
                continue
            kind, words = draw.choice(self.parts["nests"]).split(": ", 1)
            opens, turns, closes = (self._statement(draw, each) for each in words.split(" /"))
            nest = Nest(kind, opens, closes)
            statements += [opens, *self._block(draw, depth + 1, has_beside=has_beside)]
            if turns.text.strip() and draw.random() < 0.6:
                nest.turns = turns
                statements += [turns, *self._block(draw, depth + 1, has_beside=has_beside)]
            statements.append(closes)
            for each in (opens, turns, closes):
                each.nest, each.text = nest, each.text.removeprefix(" ")
        return statements


class Program:
    """A program, and its routines."""

    def __init__(self, language: Language, statements: list[Statement]) -> None:
        """Number the lines, and divide the statements."""
        self.language, self.statements = language, statements
        self.first, self.routines = list[Statement](), dict[str, list[Statement]]()
        here, line = self.first, 1
        for each in statements:
            verb, _, name = each.does.partition(" ")
            if verb == "routine":
                here = self.routines.setdefault(name, [])
            elif verb == "end":
                here = self.first
            else:
                here.append(each)
                if language.is_numbered and here is not self.first:
                    each.text = f"{len(here):4d}:{each.text} ;"
            each.line = line
            line += 1 + each.text.count("\n")
        self.text = "\n".join(re.sub(r"<([\d.]+)>", r"\1", each.text) for each in statements)

    def coordinates(self, text: str) -> dict[Any, float]:
        """Return the coordinate of each statement in a text that has other ones, and is else the same.

        Where a move has numbers in place of the name of its target, they are found by statement and name.
        """
        lines, found = text.split("\n"), dict[Any, float]()
        for each in self.statements:
            own = "\n".join(lines[each.line - 1 : each.line + each.text.count("\n")])
            pattern = re.escape(re.sub(r"<[\d.]+>", "<x>", each.text)).replace("<x>", r" *(?P<x>-?\d+\.\d+)")
            for name in each.targets:
                numbers = rf"p?[\[{{][\[X ]*(?P<{name}>-?\d+\.\d+)[\w,\[\] .-]*[\]}}]"
                pattern = re.sub(
                    rf"(?<!\w){name}(?!\w)", lambda _, n=numbers, m=name: f"(?:{m}|{n})", pattern
                )
            match = re.fullmatch(pattern, own)
            assert match, f"{own!r} is not {each.text!r}"
            drawn = match.groupdict()
            found[each] = float(drawn.pop("x", 0.0))
            found |= {(each, name): float(value) for name, value in drawn.items() if value}
        return found

    def runs(self, text: str, seed: int, times: int = 2) -> list[Seen]:
        """Return the moves of the program that runs some times, with the numbers of a text."""
        return Cell(self, self.coordinates(text), Random(seed)).carried_out(times)  # noqa: S311


@dataclass
class Cell:
    """What a controller holds while a program runs."""

    program: Program
    coordinates: dict[Any, float]
    draw: Random
    values: dict[str, Any] = field(default_factory=dict)  # first coordinates of points and frames, by name
    own: list[dict[str, Any]] = field(default_factory=list)  # those of the routines that run, innermost last
    kept: set[str] = field(default_factory=set)  # names that others cannot change
    seen: list[Seen] = field(default_factory=list)
    steps: int = 0
    beside: str = ""  # routine that may run at any time

    def carried_out(self, times: int) -> list[Seen]:
        """Run the program some times; frames from outside are those that people state when it begins."""
        language = self.program.language
        self.does(Statement("", language.part("first")))
        for each in self.program.first:
            self.does(each)
        for _ in range(times):
            self.steps, self.beside, self.own = 0, "", []
            for name in language.part("outside").split(", "):
                if is_junk(self.values.get(name)):
                    del self.values[name]
            self.does(Statement("", language.part("again")))
            for each in (
                self.program.first if language.part("loaded") else ()
            ):  # data have their file's values
                self.does(each)
            with suppress(Stopped):
                self.routine("a")
        return self.seen

    def routine(self, name: str, depth: int = 0) -> None:
        """Carry out a routine."""
        if depth > 6:
            raise Stopped
        self.own.append({})
        statements, place = self.program.routines[name], 0
        while place < len(statements):
            self.steps += 1
            if self.steps > STEPS:
                raise Stopped
            if self.beside and depth < 5 and self.draw.random() < 0.15:
                self.routine(self.beside, 5)
            place = 1 + self.step(statements, place, depth)
        self.own.pop()

    def step(self, statements: list[Statement], place: int, depth: int) -> int:
        """Carry out a statement; return the place behind which it goes on."""
        each = statements[place]
        verb, _, called = each.does.removeprefix("maybe ").partition(" ")
        if each.nest:
            return statements.index(self.after(each, each.nest))
        if each.does.startswith("maybe ") and self.draw.random() < 0.5:
            return place
        if verb == "goto":
            return next(k for k, other in enumerate(statements) if other.does == "label")
        if verb in {"leave", "again"} and (ends := self.ends_of_loops(statements, place)):
            return ends[0] - (verb == "again")
        if verb == "stop":
            raise Stopped
        if verb in {"return", "leave", "again"}:
            return len(statements)
        if verb == "call":
            self.routine(called, depth + 1)
        else:
            self.does(each)
        return place

    def ends_of_loops(self, statements: list[Statement], place: int) -> list[int]:
        """Return the places of the ends of the loops around a statement, the innermost first."""
        nests = {id(each.nest): each.nest for each in statements if each.nest and each.nest.kind != "branch"}
        spans = [(statements.index(each.opens), statements.index(each.closes)) for each in nests.values()]
        return sorted(end for begin, end in spans if begin < place < end)

    def after(self, here: Statement, nest: Nest) -> Statement:
        """Return the begin, turn or end of a branch or loop behind which it goes on."""
        if here is nest.opens and nest.kind not in {"once", "forever"} and self.draw.random() < 0.5:
            return nest.turns or nest.closes
        if here is nest.turns:  # behind a branch that was taken
            return nest.closes
        if here is nest.closes and (
            nest.kind == "forever" or (nest.kind != "branch" and self.draw.random() < 0.6)
        ):
            return nest.opens
        return here

    def does(self, each: Statement) -> None:
        """Carry out what a statement does."""
        x = self.coordinates.get(each, 0.0)
        for clause in filter(None, each.does.removeprefix("maybe ").split("; ")):
            name, equals, value = clause.partition(" = ")
            verb, _, rest = clause.partition(" ")
            if verb == "own":
                self.own[-1][name.removeprefix("own ")] = self.value(value, x)
            elif equals:
                self.give(name, self.value(value, x))
            elif verb == "see":
                self.see(each, x, *(part.split(", ") for part in rest.split(" / ")))
            elif verb == "at":
                self.at(each.line, rest.split(", "))
            else:
                self.change(verb, rest)

    def change(self, verb: str, rest: str) -> None:
        """Let others change names, or keep one from them; begin what runs beside."""
        if verb == "change":
            for name in rest.split(", "):
                plain = name.removeprefix("written ")
                written = plain in _names_written_by(self.program.statements)
                if plain not in self.kept and (plain == name or written):
                    self.values[plain] = self.junk()
        elif verb == "keep":
            name, _, kind = rest.partition(" if ")
            self.kept |= {name} if kind != "PERS" else set()
        elif verb == "beside":
            self.beside = rest
        else:
            assert verb == "label", verb

    def see(self, each: Statement, x: float, targets: list[str], base: list[str], tool: list[str]) -> None:
        """Move to targets, by their names or to numbers of its own."""
        values = [self.coordinates.get((each, target), self.value(target, x)) for target in targets]
        frames = ([self.value(name, x)] * len(values) for name in (*base, *tool))
        self.seen.append(Seen(each.line, values, *frames))

    def at(self, line: int, names: list[str]) -> None:
        """Move to positions of FANUC; it stops where their frames are not the active ones."""
        numbers = [name for name in names if name != "increment"]
        frames = dict[str, list[Any]]()
        for kind, active in (("UF", self.value("UFRAME")), ("UT", self.value("UTOOL"))):
            stated = [self.value(f"{kind}{number}") for number in numbers]
            if not active.startswith("active") and not {*stated} <= {f"{kind} F", active}:
                raise Stopped  # INTP-252, INTP-253
            real = [active if own == f"{kind} F" else own for own in stated]
            frames[kind] = [self.values.get("data of frames", own) for own in real]
        places = [self.value("P" + number) for number in numbers]
        self.seen.append(Seen(line, [*places, *names[len(numbers) :]], frames["UF"], frames["UT"]))

    def value(self, text: str, x: float = 0.0) -> Any:
        """Return what a value or a name has, of the routine or of all; the name where it has nothing."""
        if text in (known := {"x": x, "0": 0.0}):
            return known[text]
        if text == "junk":
            return self.junk()
        if " or " in text:
            return self.draw.choice(text.split(" or "))
        if text.startswith("name "):
            return text.removeprefix("name ")
        if text.startswith("*"):
            name = self.value(text[1:])
            return self.value(name) if isinstance(name, str) else name
        own = self.own[-1] if self.own else {}
        return own.get(text, self.values.get(text, text))

    def give(self, name: str, value: Any) -> None:
        """Let a name have something."""
        (self.own[-1] if self.own and name in self.own[-1] else self.values)[name] = value

    def junk(self) -> float:
        """Return a coordinate that stands nowhere in a program."""
        return -self.draw.randint(10_000, 99_999)


def is_junk(value: Any) -> bool:
    """Tell whether a value came from outside of a program."""
    return not isinstance(value, str | None) and value < 0


def languages() -> dict[str, Language]:
    """Return the languages by name."""
    _, *texts = re.split(r"^=== ", Path(__file__).with_suffix(".txt").read_text(), flags=re.MULTILINE)
    return {text.split()[0]: Language.of(text) for text in texts}


LANGUAGES = languages()


def _names_written_by(statements: list[Statement]) -> set[str]:
    """Return the names that statements of routines write, without those that are a routine's own."""
    written, own = set[str](), set[str]()
    for each in statements:
        if each.does.startswith("routine "):
            own = set()
        elif not re.match(r"(?:CONST|(?:LOCAL )?PERS|VAR) ", each.text):  # declarations of RAPID
            own |= set(re.findall(r"\bown (\S+) = ", each.does))
            written |= set(re.findall(r"(?<!own )(?<![\w\]])([\w\[\]]+) = ", each.does)) - own
        else:
            own |= set(re.findall(r"\bown (\S+) = ", each.does))
    return written
