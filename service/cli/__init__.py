"""The command line: `jointstiff`. A module for each group of commands."""
