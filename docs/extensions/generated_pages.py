"""Write the pages that are made from the code before Sphinx reads the others: the whole reference."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from http_reference import messages_page, operations_page
from pydantic.fields import FieldInfo

from jointstiff.schemas.meanings import MEANINGS
from jointstiff.service.app import create_app
from jointstiff.service.store.store import Store

if TYPE_CHECKING:
    from sphinx.application import Sphinx

__all__ = ["findings_page", "python_pages", "setup"]

ROOMS = ("jointstiff.solver", "jointstiff.service.library", "jointstiff.simulator", "jointstiff.schemas")
"""Packages that Python code uses from outside, with the packages in them."""

_INDEX = """# Python reference

Each page shows the public names of one package, module by module.

```{{toctree}}
{names}
```
"""
_FINDINGS = """# Findings

Codes of findings, sorted by subject. The verdict in italics is the best verdict of a run with the finding. A
finding itself has its `weight`, its numbers and its remedy. [How to read a
result](../reading-a-result.md) explains verdicts.
"""
_PAGE = """# {name}

```{{eval-rst}}
{modules}
```
"""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("config-inited", lambda app, _: _write(Path(app.srcdir) / "reference"))
    app.connect("autodoc-process-docstring", _protect)
    plain = FieldInfo.__repr__  # Sphinx prints it as markup, in which `9_` of a pattern is a reference
    FieldInfo.__repr__ = lambda field: plain(field).replace("_", r"\_")  # type: ignore[method-assign]
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def python_pages() -> dict[str, str]:
    """Return the pages of the Python reference by name: one a package, module by module, and their index."""
    names = [name for room in ROOMS for name in _packages(room)]
    pages = {name: _PAGE.format(name=name, modules=_modules(name)) for name in names}
    return pages | {"python": _INDEX.format(names="\n".join(names))}


def findings_page() -> str:
    """Return the page of all codes of findings with their meanings."""
    parts = [
        f"\n## {title}\n\n" + "\n".join(f"* `{code}`: {meaning}" for code, meaning in meanings.items())
        for title, meanings in MEANINGS.items()
    ]
    return _FINDINGS + "\n".join(parts) + "\n"


def _packages(name: str) -> list[str]:
    """Return the package and the packages in it, at any depth."""
    inner = [one.name for one in _children(name) if one.ispkg]
    return [name, *(package for child in inner for package in _packages(f"{name}.{child}"))]


def _modules(name: str) -> str:
    """Return the directives that document a package and the public modules in it."""
    public = [one.name for one in _children(name) if not one.ispkg and not one.name.startswith("_")]
    return "\n\n".join(map(_directive, [name, *(f"{name}.{one}" for one in public)]))


def _directive(name: str) -> str:
    """Return the directive that documents a module, and a list of the names that it has from others."""
    module = importlib.import_module(name)
    imported = {
        alias.asname or alias.name
        for node in ast.walk(ast.parse(inspect.getsource(module)))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("jointstiff.")
        for alias in node.names
    }
    offered = sorted(imported & set(getattr(module, "__all__", ())))
    if not offered:
        return f".. automodule:: {name}"
    listed = ", ".join(f"`{one}`" for one in offered)
    return (
        f".. automodule:: {name}\n   :exclude-members: {', '.join(offered)}\n\n"
        f"Also from here, documented in the modules that define them: {listed}."
    )


def _children(name: str) -> list[pkgutil.ModuleInfo]:
    """Return the modules and packages that lie in a package."""
    return list(pkgutil.iter_modules(importlib.import_module(name).__path__))


def _write(folder: Path) -> None:
    with Store.open("sqlite://") as store:
        document = create_app(store).openapi()
    pages = python_pages() | {
        "http": operations_page(document),
        "messages": messages_page(document),
        "findings": findings_page(),
    }
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.md"):
        if old.stem not in pages:
            old.unlink()
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def _protect(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Keep absolute values in docstrings, such as |F|, from being read as markup."""
    lines[:] = [
        "`".join(
            part.replace("|", r"\|") if index % 2 == 0 else part for index, part in enumerate(line.split("`"))
        )
        for line in lines
    ]
