"""The formats of programs: the reader of all formats, its limits, and comments of the writer."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import PurePath
from types import MappingProxyType
from typing import Final

import numpy as np

from robotprograms import fanuc, krl, rapid, table, ur
from robotprograms.arrays import FloatArray
from robotprograms.errors import Fault, ProgramError, ReadMove, quote_text
from robotprograms.interpreter import Permissions, interpret
from robotprograms.language import Language
from robotprograms.notation import Notation, has_decimal_commas
from robotprograms.own_numbers import insert_numbers
from robotprograms.program import NUMBERS, ExternalAxes, OwnNumbers, Program, Source

MAX_PROGRAM_BYTES: Final = 32 * 1024 * 1024
"""All files of a program together."""
MAX_LINES: Final = 2_000_000
MAX_LINE: Final = 4096
"""Characters of a line."""
MAX_FILES: Final = 12
"""Most files of a program in KRL, RAPID or FANUC's language."""
_MOST_FILES: Final = dict.fromkeys(("krl", "rapid", "fanuc"), MAX_FILES)
"""Most files of a program, by its format; one in other formats."""
_UNSUPPORTED_SUFFIXES: Final = {".nc", ".cnc", ".mpf", ".apt", ".cls", ".aptsource", ".gcode"}


_MODULES: Final = {"csv": table, "krl": krl, "fanuc": fanuc, "rapid": rapid, "ur": ur}
FORMATS: Final[Mapping[str, Language]] = MappingProxyType(
    {name: module.LANGUAGE for name, module in _MODULES.items()}
)
_LANGUAGES: Final = {
    "krl": "KUKA's language",
    "fanuc": "FANUC's language",
    "rapid": "RAPID (ABB)",
    "ur": "URScript",
}
"""Name of a format → its language."""
_BEGINNING: Final = 20_000
"""Bytes of a file in which its language is sought."""
_BEGINNINGS: Final = {
    kind: re.compile(pattern, re.MULTILINE | re.IGNORECASE)
    for kind, pattern in {
        "krl": r"^[ \t]*(?:&ACCESS\b|(?:GLOBAL[ \t]+)?DEF[ \t]+\w+[ \t]*\([^)\n]*\)[ \t]*\r?$)",
        "fanuc": r"^/PROG\b",
        "rapid": r"^[ \t]*MODULE[ \t]+\w+",
        "ur": r"^[ \t]*def[ \t]+\w+[ \t]*\([^)\n]*\)[ \t]*:",
    }.items()
}
"""Name of a format → pattern of a line that only programs of this format have.

No pattern goes beyond its line: the search would take seconds in a file of empty lines."""


def read_program(
    files: Sequence[tuple[str, bytes]],
    name: str | None = None,
    leave_alone: Collection[str] = (),
    *,
    leave_others: bool = False,
    external_axes: ExternalAxes = ExternalAxes.MAY_CARRY,
    trust_routines: bool = False,
) -> Program:
    """Read a program: its targets, its moves that can be corrected, and its moves that are kept unchanged.

    Args:
        files: names and bytes of the files, first the one whose moves are corrected: for KUKA a .src, its
            .dat, $config.dat and files with its routines and points; for ABB the modules of a task;
            for FANUC the .LS and those of the programs that it calls.
        name: name of the format, one of FORMATS; if None, the first file's name decides.
        leave_alone: names of routines that neither move the robot nor change its frames.
        leave_others: whether moves that are not certain are kept unchanged; if not, they raise an error.
        external_axes: what the user states on external axes; moves with an axis away from zero are kept
            unchanged, unless the axes are joints of the robot or carry nothing.
        trust_routines: whether routines of other files are assumed to move neither robot, frames nor points;
            what the program hands to them by reference may change all the same.

    Raises:
        ProgramError: the text is not understood; or a move is not certain, and `leave_others` is false.
    """
    kind = _choose_format(files, name)
    sources = _read_sources(files)
    permissions = Permissions(leave_alone, trust_routines)
    program = _interpret_with_own_numbers(kind, sources, permissions, external_axes)
    if program.faults and not leave_others:
        raise ProgramError(program.faults, left=program.left_moves)
    return program


def _interpret_with_own_numbers(
    kind: str, sources: tuple[Source, ...], permissions: Permissions, external_axes: ExternalAxes
) -> Program:
    """Interpret a program, and write numbers into moves whose targets cannot be corrected otherwise.

    If `MoveL p1,...` is corrected but the declaration of p1 has to stay, the move gets numbers of its own in
    place of the name p1. The program is then read again, until no move needs further ones.

    Args:
        kind: name of the format.
        sources: files of the program, first the one whose moves are corrected.
        permissions: what the user permits the reader to assume on routines.
        external_axes: what the user states on external axes.
    """
    language = _choose_language(kind, sources[0])
    own_numbers: tuple[OwnNumbers, ...] = ()
    while True:
        # Names and states are not kept: they take as much memory as the targets built next.
        found = interpret(kind, sources, language, permissions, own_numbers)
        columns = found.columns
        columns.settle_targets(found.used, external_axes)
        own_numbers = columns.list_own_numbers()
        if not own_numbers or _exceed_limit(sources, own_numbers):
            return columns.build_program(found.causes)
        main_file, own_numbers = insert_numbers(sources[0], own_numbers)
        sources = (main_file, *sources[1:])


def _choose_language(kind: str, main_file: Source) -> Language:
    """Return the language of a format; a table (CSV) may be written with decimal commas, as in `1,5;2,0`."""
    if kind == "csv" and has_decimal_commas(main_file.text):
        return table.DECIMAL_COMMAS
    return FORMATS[kind]


def _read_sources(files: Sequence[tuple[str, bytes]]) -> tuple[Source, ...]:
    """Return the files of a program, given by names and bytes: the first one, others, and files of data last.

    Raises:
        ProgramError: the files are too large, or a file is not plain text.
    """
    if sum(len(content) for _, content in files) > MAX_PROGRAM_BYTES:
        first_name, _ = files[0]
        reason = f"the files of the program have more than {MAX_PROGRAM_BYTES // 2**20} MiB"
        _refuse(first_name, None, reason, "split the program")
    programs_and_data = sorted(files, key=lambda file: file[0].lower().endswith(".dat"))
    return tuple(_read_source(name, content) for name, content in programs_and_data)


def _choose_format(files: Sequence[tuple[str, bytes]], stated: str | None) -> str:
    """Return the name of the format of a program: `krl` for the file `part.src`.

    Args:
        files: names and bytes of its files.
        stated: name of the format that the user states; if None, the first file's name decides.

    Raises:
        ProgramError: there is no file, the format is not known, or a program has fewer files.
    """
    if not files:
        _refuse("program", None, "no file was sent", "send a program")
    first_name, _ = files[0]
    if stated is None:
        _refuse_unsupported_suffix(first_name)
    kind = stated or _find_format_of_suffix(first_name)
    if kind not in FORMATS:
        reason = "the file's name does not show the format"
        _refuse(first_name, None, reason, f"give `format`: one of {', '.join(FORMATS)}")
    _refuse_other_language(files[0], kind)
    _refuse_further_files(files, kind)
    return kind


def _refuse_other_language(file: tuple[str, bytes], kind: str) -> None:
    """Refuse a file that begins as a program of another language than its suffix, or the user, states.

    Args:
        file: name and bytes of the file whose moves are corrected.
        kind: name of the format.

    Raises:
        ProgramError: the file is in another language.
    """
    name, content = file
    beginning = content[:_BEGINNING].decode("utf-8", "replace")
    languages = [other for other, pattern in _BEGINNINGS.items() if pattern.search(beginning)]
    if not languages or kind in languages or kind == "csv":
        return
    other = languages[0]
    suffix = FORMATS[other].suffixes.split()[0]
    reason = f"the file is a program in {_LANGUAGES[other]}, but was read as {_LANGUAGES[kind]}"
    remedy = f"give the file its own suffix, {suffix}, or state `format`: {other}"
    _refuse(name, None, reason, remedy)


def _refuse_unsupported_suffix(file: str) -> None:
    """Refuse a file with the suffix of a format that cannot be read, such as `part.gcode`.

    Raises:
        ProgramError: the suffix is such a one.
    """
    if PurePath(file.lower()).suffix in _UNSUPPORTED_SUFFIXES:
        remedy = "write the program in the controller's own language, or as a table of targets (CSV)"
        _refuse(file, None, "programs in the formats CNC, APT and CLS cannot be read", remedy)


def _find_format_of_suffix(file: str) -> str:
    """Return the name of the format whose files have the suffix of a file; empty if there is none."""
    suffix = PurePath(file.lower()).suffix
    for kind, language in FORMATS.items():
        if suffix in language.suffixes.split():
            return kind
    return ""


def _refuse_further_files(files: Sequence[tuple[str, bytes]], kind: str) -> None:
    """Refuse more files than one program of a format has.

    Raises:
        ProgramError: there are more files.
    """
    if len(files) <= _MOST_FILES.get(kind, 1):
        return
    last_name, _ = files[-1]
    remedy = (
        "send one program: for KUKA a .src with its .dat and $config.dat, for ABB the modules of one "
        "task, for FANUC the .LS and those that it calls"
    )
    _refuse(last_name, None, "more files were sent than one program has", remedy)


def _exceed_limit(sources: Sequence[Source], own: Sequence[OwnNumbers]) -> bool:
    """Return whether the files of a program would be too large with own numbers of moves."""
    added = sum(len(each.numbers) for each in own)
    return sum(len(each.text) for each in sources) + added > MAX_PROGRAM_BYTES


def list_moves(
    files: Sequence[tuple[str, bytes]],
    name: str | None = None,
    leave_alone: Collection[str] = (),
    external_axes: ExternalAxes = ExternalAxes.MAY_CARRY,
    *,
    trust_routines: bool = False,
) -> list[ReadMove]:
    """Return all moves of a program in order of lines, with target, base, tool and whether each is corrected.

    The arguments are those of `read_program`. If no move can be corrected, the moves are those that the error
    of reading has.

    Raises:
        ProgramError: the text of the program is not understood.
    """
    try:
        program = read_program(
            files,
            name,
            leave_alone,
            leave_others=True,
            external_axes=external_axes,
            trust_routines=trust_routines,
        )
    except ProgramError as error:
        if not error.left_moves:
            raise
        return list(error.left_moves)
    moves = [*program.left_moves, *_list_moves_to_stored(program), *_list_corrected_moves(program)]
    return sorted(moves, key=lambda move: move.line)


def _list_moves_to_stored(program: Program) -> Iterator[ReadMove]:
    """Yield the moves of a program to positions that are stored in the controller, such as `PTP HOME`."""
    for remark in program.left_alone:
        is_move_to_stored_position = bool(remark.target)
        if is_move_to_stored_position:
            yield ReadMove(remark.line, remark.target, base="", tool="", reason=remark.text)


def _list_corrected_moves(program: Program) -> Iterator[ReadMove]:
    """Yield the moves of a program that are corrected, each with its last target: name, or numbers."""
    targets, moves = program.targets, program.moves
    last_targets = moves.visits[moves.ends - 1]
    for line, target in zip(moves.line.tolist(), last_targets.tolist(), strict=True):
        shown_target = targets.names[target] or _show_numbers(targets.values[target, :NUMBERS])
        base = targets.frames[targets.base[target]]
        tool = targets.frames[targets.tool[target]]
        yield ReadMove(line, shown_target, base.name, tool.name, corrected=True)


def _show_numbers(numbers: FloatArray) -> str:
    """Return the numbers of a target for a message, such as `100, 200.5, 0`; NaN is left out."""
    stated_numbers = numbers[np.isfinite(numbers)].tolist()
    return ", ".join(f"{number:g}" for number in stated_numbers)


def _read_source(name: str, content: bytes) -> Source:
    """Return a file of a program, after checks of its text.

    Raises:
        ProgramError: the file is not plain text, or exceeds a limit.
    """
    if b"\0" in content:
        reason = "the file is not text with one byte per character"
        _refuse(name, None, reason, "save the file as plain text, not as UTF-16 or binary")
    if content.count(b"\n") + content.count(b"\r") > MAX_LINES:
        _refuse(name, None, f"the file has more than {MAX_LINES:,} lines", "split the program")
    source = Source.from_bytes(name, content)
    # These lengths count the characters that end a line, too.
    for index in np.flatnonzero(source.ends - source.starts > MAX_LINE).tolist():
        line = source.text[source.starts[index] : source.ends[index]].rstrip("\r\n")
        if len(line) > MAX_LINE:
            reason = f"a line has more than {MAX_LINE} characters"
            _refuse(name, index + 1, reason, "break the line into several lines")
    return source


def _refuse(file: str, line: int | None, reason: str, remedy: str) -> None:
    """Refuse a program because of one fault, on a line of a file or in the whole file.

    Raises:
        ProgramError: always.
    """
    shown_name = file if file.isprintable() else quote_text(file)
    raise ProgramError([Fault(shown_name, line, reason, remedy)])


def choose_frame_notation(program: Program) -> Notation:
    """Return the notation in which users of the program's format write frames.

    If the format states no notation, the notation of the program's poses is returned, else that of KUKA.
    """
    pose_notations = (notation for notation in program.targets.notations if notation.has_pose)
    return FORMATS[program.format].pose or next(pose_notations, krl.POSE)


def insert_comment(kind: str, content: bytes, parts: Sequence[str]) -> bytes:
    """Insert a comment behind the head of a program, and return the new bytes.

    The comment is one line; in a FANUC program it is a remark for each part, which has 32 characters at most.

    Args:
        kind: name of the format.
        content: bytes of the program's first file.
        parts: parts of the comment.
    """
    language = FORMATS[kind]
    lines = [f"{language.remark} {', '.join(parts)}"]
    if kind == "fanuc":
        lines = [f"{language.remark}{part} ;" for part in parts]
    line_end = "\r\n" if b"\r\n" in content else "\n"
    comment = "".join(line + line_end for line in lines).encode("ascii", "replace")
    place = _find_end_of_head(language, content)
    return content[:place] + comment + content[place:]


def _find_end_of_head(language: Language, content: bytes) -> int:
    """Return the index behind the head line of a program, such as `DEF name()`; 0 if it has none."""
    if not language.head:
        return 0
    head_line = rf"^{language.head}[^\r\n]*+(?:\r\n|\n|\r)".encode()
    head = re.search(head_line, content, re.MULTILINE)
    return head.end() if head else 0
