"""Robot programs: bytes in, moves out, and the same bytes with other numbers.

    program = read_program([("part.src", content)])
    program.targets.values      numbers of the targets, as the program writes them
    program.moves.visits        indices of the targets in the order of the moves
    program.left_moves          moves that are not certain, with reason and remedy
    Rewriting(program)          the files with other numbers

formats        the format by the file's name; which module reads it; comments of a writer
├── krl  fanuc  rapid  ur  table   one module a format: statements translated, facts of the controller
├── language     words of the intermediate language; statements in normal form
├── interpreter  which moves are certain; the modules of its steps
├── columns      targets and moves as columns; moves that share numbers are certain together
program        targets as columns, with the places of their numbers; rewriting
notation       all numbers of a text, and others in their place; numbers to poses in SI units, and back
"""

from robotprograms.errors import Fault, ProgramError, ReadMove, quote_text
from robotprograms.formats import (
    FORMATS,
    MAX_FILES,
    choose_frame_notation,
    insert_comment,
    list_moves,
    read_program,
)
from robotprograms.notation import Edit, Notation, Orientation
from robotprograms.program import (
    BLOCK,
    NUMBERS,
    ExternalAxes,
    FrameName,
    Literal,
    Motion,
    Moves,
    Program,
    Remark,
    Rewriting,
    Source,
    Targets,
)

__all__ = [
    "BLOCK",
    "FORMATS",
    "MAX_FILES",
    "NUMBERS",
    "Edit",
    "ExternalAxes",
    "Fault",
    "FrameName",
    "Literal",
    "Motion",
    "Moves",
    "Notation",
    "Orientation",
    "Program",
    "ProgramError",
    "ReadMove",
    "Remark",
    "Rewriting",
    "Source",
    "Targets",
    "choose_frame_notation",
    "insert_comment",
    "list_moves",
    "quote_text",
    "read_program",
]
