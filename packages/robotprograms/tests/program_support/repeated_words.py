"""Texts that a pattern matches at first and not to the end, with one of its repeated parts many times."""

import re
from collections.abc import Iterable, Iterator
from re import _constants as constants  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from types import ModuleType
from typing import Any


def patterns_of(modules: Iterable[ModuleType]) -> dict[str, re.Pattern[str]]:
    """Return the patterns of modules, and those of the rules of their languages, by where they are."""
    found: dict[str, re.Pattern[str]] = {}
    for module in modules:
        name = module.__name__.rpartition(".")[2]
        for variable, value in vars(module).items():
            if isinstance(value, re.Pattern) and isinstance(value.pattern, str):
                found[f"{name}.{variable}"] = value
            elif hasattr(value, "rules") and not isinstance(value, type):
                rules = [rule for rule, _ in value._rules]
                found |= {f"{name}.{variable} rule {i}": rule for i, rule in enumerate(rules)}
    return found


def repeated_in(pattern: re.Pattern[str]) -> list[tuple[str, str]]:
    """Return what a pattern matches before each of its repeated parts, and what it repeats there."""
    return list(_walked(parser.parse(pattern.pattern, pattern.flags), ""))


def text_of(before: str, part: str, count: int, end: str) -> str:
    """Return a text with a part so many times, and an end that does not fit."""
    return before + part * count + end


def _walked(items: Any, before: str) -> Iterator[tuple[str, str]]:
    for item in items:
        yield from _inside(item, before)
        before += _sample([item])


def _inside(item: Any, before: str) -> Iterator[tuple[str, str]]:
    kind, value = item
    if kind in {constants.MAX_REPEAT, constants.MIN_REPEAT, constants.POSSESSIVE_REPEAT}:
        _, most, body = value
        if most > 16:
            yield before, _sample(body) or "a"
        yield from _walked(body, before)
    elif kind is constants.SUBPATTERN:
        yield from _walked(value[3], before)
    elif kind is constants.BRANCH:
        for branch in value[1]:
            yield from _walked(branch, before)
    elif kind is constants.ATOMIC_GROUP:
        yield from _walked(value, before)


def _sample(items: Any) -> str:
    """Return a short text that parts of a pattern match."""
    return "".join(_one(kind, value) for kind, value in items)


def _one(kind: Any, value: Any) -> str:
    if kind is constants.LITERAL:
        return chr(value)
    if kind is constants.NOT_LITERAL:
        return "b" if value == ord("a") else "a"
    if kind is constants.ANY:
        return "a"
    if kind is constants.IN:
        return _of_set(value)
    if kind in {constants.MAX_REPEAT, constants.MIN_REPEAT, constants.POSSESSIVE_REPEAT}:
        least, _, body = value
        return _sample(body) * max(least, 0)
    if kind is constants.SUBPATTERN:
        return _sample(value[3])
    if kind is constants.BRANCH:
        return _sample(value[1][0])
    return _sample(value) if kind is constants.ATOMIC_GROUP else ""


def _of_set(items: Any) -> str:
    negated = items[0][0] is constants.NEGATE
    return next(sign for sign in _SIGNS if any(_is_in(each, sign) for each in items) != negated)


_SIGNS = "a1 ,+\"'#$({[=:;*%" + "".join(map(chr, range(33, 127))) + "\t\n\r\0"
_CATEGORIES = {
    constants.CATEGORY_DIGIT: r"\d",
    constants.CATEGORY_NOT_DIGIT: r"\D",
    constants.CATEGORY_SPACE: r"\s",
    constants.CATEGORY_NOT_SPACE: r"\S",
    constants.CATEGORY_WORD: r"\w",
    constants.CATEGORY_NOT_WORD: r"\W",
}


def _is_in(item: Any, sign: str) -> bool:
    kind, value = item
    if kind is constants.LITERAL:
        return value == ord(sign)
    if kind is constants.RANGE:
        return bool(value[0] <= ord(sign) <= value[1])
    return kind is constants.CATEGORY and re.fullmatch(_CATEGORIES[value], sign) is not None
