"""Robot programs: bytes in, targets out, and the same bytes with other numbers (docs/method.md section 12).

formats        the format by the file's name; which reader takes it
├── krl  fanuc  rapid  ur  table          one module a format
reader         what was read so far, and all that was not understood
program        targets with where their numbers stand; rewriting
configuration  what is said of the arm's configuration
notation       numbers to poses in SI units, and back
"""
