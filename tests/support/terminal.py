"""The commands, run in this process."""

from typing import Any

from click.testing import Result
from typer.testing import CliRunner

from jointstiff.service.cli.app import app


def terminal(*arguments: object, width: int = 80, **options: Any) -> Result:
    """Run `jointstiff` with arguments, in a terminal of so many columns and without colours."""
    words = [str(argument) for argument in arguments]
    return CliRunner().invoke(app, words, env={"COLUMNS": str(width), "NO_COLOR": "1"}, **options)
