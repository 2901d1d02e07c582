"""Which observation, target and state a point's name, or a file's, stands for.

A template such as `{label}_{target}_{state}` is what people can write safely: no field may contain a
character that begins a literal text between fields, so a name fits in one way or in none.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from jointstiff.schemas.fields import MAX_NAME_LENGTH
from jointstiff.schemas.importing import State
from jointstiff.service.importing.errors import Fault, shown
from jointstiff.service.importing.header import state_named

_FIELD: Final = re.compile(r"\{([^{}]*)\}")
_FIELDS: Final = ("label", "target", "state", "any")


@dataclass(frozen=True)
class Naming:
    """Parts of a name; None where the name has no such part."""

    label: str | None = None
    target: str | None = None
    state: State | None = None


class Template:
    """A template that was checked."""

    def __init__(self, text: str) -> None:
        """Check a template.

        Raises:
            Fault: unknown or repeated fields, or two without a text between them.
        """
        self.text = text
        literals, fields = _FIELD.split(text)[::2], _FIELD.findall(text)
        named = [field for field in fields if field != "any"]
        faulty = not set(fields) <= set(_FIELDS) or not named or len(set(named)) != len(named)
        if faulty or any(not literal for literal in literals[1:-1]) or "{" in "".join(literals):
            raise Fault(
                f"the template {shown(text)} is invalid",
                "use each of {label}, {target}, {state} at most once, {any} for the rest, with a text such "
                "as _ between them",
            )
        excluded = "".join({literal[0] for literal in literals if literal})
        part = f"([^{re.escape(excluded)}]+)" if excluded else "(.+)"
        pattern = part.join(re.escape(literal) for literal in literals)
        self._fields = fields
        self._pattern = re.compile(pattern, re.DOTALL)

    def parse(self, name: str, state_words: Mapping[str, State]) -> Naming:
        """Take a name apart.

        Raises:
            Fault: the name does not fit.
        """
        match = self._pattern.fullmatch(name)
        parts = dict(zip(self._fields, match.groups(), strict=True)) if match else {}
        state = state_named(parts["state"], state_words) if "state" in parts else None
        if match is None or (state is None and "state" in parts):
            raise Fault(
                f"the name {shown(name)} does not fit the template {shown(self.text)}",
                "change the template or rename the point; states are `unloaded`, `loaded`, `deflection`, "
                "and the words in `state_words`",
            )
        return Naming(parts.get("label"), parts.get("target"), state)


def check_name(text: str) -> None:
    """Refuse what no label or target can be.

    Raises:
        Fault: empty, too long, or not printable.
    """
    if not text.isprintable() or text != text.strip() or not 0 < len(text) <= MAX_NAME_LENGTH:
        raise Fault(
            f"{shown(text)} is not a valid name",
            f"give 1 to {MAX_NAME_LENGTH} printable characters, without blanks at the ends",
        )


def default_point(name: str, needed: frozenset[str], words: Mapping[str, State]) -> Naming:
    """Without a template: parts between `::`, else `_`; the word for a state anywhere, label before target.

    Raises:
        Fault: the parts are more than is needed, or not clear.
    """
    if not needed:
        return Naming(label=name)
    parts, state = _parts(name, words)
    wants = {"label", *needed}
    if len(parts) == 1 and (state is None or "state" in wants):
        return Naming(label=parts[0], state=state)
    if len(parts) == 2 and "target" in wants and (state is None or "state" in wants):
        return Naming(parts[0], parts[1], state)
    raise Fault(
        f"the name {shown(name)} does not show which observation, target and state it is",
        "give a template `point_name`, such as {label}_{target}_{state}",
        "point_name",
    )


def default_file(stem: str, needed: frozenset[str], words: Mapping[str, State]) -> Naming:
    """Return what points of a file have in common, from its name: `P10_loaded`, `loaded` or `P10`.

    Raises:
        Fault: the name does not say just that.
    """
    parts, state = _parts(stem, words)
    target = parts[0] if len(parts) == 1 else None
    said = {kind for kind, value in (("target", target), ("state", state)) if value is not None}
    if len(parts) > 1 or not needed <= said:
        raise Fault(
            f"the {_listed(needed)} is given neither by the table nor by the names of points or the file",
            "name points as in `c01_P10_loaded`, or the file as in `P10_loaded.txt`, or give templates "
            "`point_name` or `file_name`",
            "point_name",
        )
    return Naming(None, target, state)


def _parts(name: str, words: Mapping[str, State]) -> tuple[list[str], State | None]:
    """The parts of a name without the one that is a word for a state."""
    parts = name.split("::") if "::" in name else name.split("_")
    if not all(parts):
        return [name], None
    states = [state_named(part, words) for part in parts]
    found = [state for state in states if state is not None]
    if len(found) != 1:
        return parts, None
    return [part for part, state in zip(parts, states, strict=True) if state is None], found[0]


def _listed(needed: frozenset[str]) -> str:
    return " and the ".join(sorted(needed, reverse=True)) if needed else "label"
