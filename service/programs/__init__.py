"""Robot programs: bytes in, targets out, and the same bytes with other numbers (docs/method.md section 12).

formats        the format by the file's name; which module reads it; the mark of a compensated program
├── krl  fanuc  rapid  ur  table          one module a format: the statements that are understood
├── forms      statements beside moves and frames, as tables
├── reader     statements in order: names, frames, branches, and all that was not understood
├── scanner    text to tokens in linear time; expressions
program        targets as columns with where their numbers stand; rewriting
numerals       all numbers of a text, and others in their place
configuration  what is said of the arm's configuration
notation       numbers to poses in SI units, and back
"""
