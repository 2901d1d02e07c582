"""Sources of this repository as trees."""

import ast
from functools import cache
from pathlib import Path


@cache
def nodes(path: Path) -> list[ast.AST]:
    """Parse a file once for all tests."""
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
