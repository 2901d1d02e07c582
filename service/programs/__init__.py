"""Robot programs: bytes in, targets out, and the same bytes with other numbers (docs/method.md section 13).

formats        the format by the file's name; which reader takes it
├── krl  fanuc  rapid  ur  apt  table     one module a format
reader         what was read so far, and all that was not understood
program        targets with where their numbers stand; rewriting
notation       numbers to poses in SI units, and back
"""

from jointstiff.service.programs.errors import Fault, ProgramError
from jointstiff.service.programs.formats import FORMATS, MAX_PROGRAM_BYTES, read_program
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Motion, Move, Program, Target

__all__ = [
    "FORMATS",
    "MAX_PROGRAM_BYTES",
    "Fault",
    "FrameName",
    "Motion",
    "Move",
    "Notation",
    "Orientation",
    "Program",
    "ProgramError",
    "Target",
    "read_program",
]
