"""Command lines as they are typed, and what they say."""

import json
import shlex
from typing import Any

from support.terminal import terminal


def typed(line: str, *, status: int = 0, width: int = 120, **options: Any) -> str:
    """Type a command line that ends with a status; return all words of output, then of errors."""
    result = terminal(*shlex.split(line), width=width, **options)
    assert result.exit_code == status, result.output
    return " ".join(f"{result.stdout} {result.stderr}".split())


def refused(line: str, **options: Any) -> str:
    """Type a command line that is refused; return the words of the error, without the usage."""
    result = terminal(*shlex.split(line), width=120, **options)
    assert result.exit_code == 2, result.output
    return " ".join(result.stderr.partition("--help' for help.")[2].split() or result.stderr.split())


def answered(line: str, **options: Any) -> Any:
    """Type a command line with `--json`; return its document."""
    result = terminal(*shlex.split(line), "--json", **options)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def assert_said(words: str, *sentences: str) -> None:
    """Assert that all sentences stand in what was said, in their order."""
    start = 0
    for sentence in sentences:
        found = words.find(sentence, start)
        assert found >= 0, f"{sentence!r} is not in {words[start:]!r}"
        start = found + len(sentence)
