"""Robot programs: bytes in, targets out, and the same bytes with other numbers (docs/method.md section 12).

formats        the format by the file's name; which module reads it; the mark of a compensated program
├── krl  fanuc  rapid  ur  table   one module a format: statements translated, facts of the controller
├── language     words of the intermediate language; statements in normal form
├── interpreter  control flow; constants propagated over all ways; which moves are certain
├── columns      targets and moves as columns; moves that share numbers are certain together
program        targets as columns with where their numbers stand; rewriting
notation       all numbers of a text, and others in their place; numbers to poses in SI units, and back
"""
