"""The commands, run in this process."""

from copy import copy
from functools import cache
from typing import Any

import typer.testing
from typer.testing import CliRunner, Result

from jointstiff.service.cli.app import app

_made = cache(typer.testing._get_command)


def _fresh(program: typer.Typer) -> Any:
    """Return the commands as they are before the first is called; to make them takes 20 ms."""
    group = copy(_made(program))
    group.commands = dict(group.commands)
    return group


typer.testing._get_command = _fresh


def terminal(*arguments: object, width: int = 80, **options: Any) -> Result:
    """Run `jointstiff` with arguments, in a terminal of so many columns and without colours."""
    words = [str(argument) for argument in arguments]
    return CliRunner().invoke(app, words, env={"COLUMNS": str(width), "NO_COLOR": "1"}, **options)
