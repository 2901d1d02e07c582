"""Tables for people: the terminal, files and reports."""
