"""Robot programs: bytes in, targets out, and the same bytes with other numbers (docs/method.md section 13).

formats        the format by the file's name; which reader takes it
├── krl  fanuc  rapid  ur  apt  table     one module a format
reader         what was read so far, and all that was not understood
program        targets with where their numbers stand; rewriting
configuration  what is said of the arm's configuration
notation       numbers to poses in SI units, and back
"""

from jointstiff.service.programs.configuration import StatedConfigurations
from jointstiff.service.programs.errors import MAX_FAULTS, Fault, ProgramError, shown
from jointstiff.service.programs.formats import FORMATS, MAX_PROGRAM_BYTES, frame_notation, read_program
from jointstiff.service.programs.notation import Notation, Orientation
from jointstiff.service.programs.program import FrameName, Motion, Move, Program, Target

__all__ = [
    "FORMATS",
    "MAX_FAULTS",
    "MAX_PROGRAM_BYTES",
    "Fault",
    "FrameName",
    "Motion",
    "Move",
    "Notation",
    "Orientation",
    "Program",
    "ProgramError",
    "StatedConfigurations",
    "Target",
    "frame_notation",
    "read_program",
    "shown",
]
