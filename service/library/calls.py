"""Calls of Python functions with wrong arguments: what was given, and the call that works."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from os import PathLike
from typing import Any, Final, NamedTuple, ParamSpec, TypeVar

from jointstiff.service.problems import (
    GIVE_NAME,
    CampaignError,
    describe_content,
    find_similar_name,
    http_problem,
    is_content,
)

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

_HIDDEN: Final = frozenset({"self", "cls", "backend"})
"""First parameters that no caller writes."""
_NAMED_FILES: Final = ("robot", "loads")
"""Arguments by name whose texts name files."""
_READ_TEXTS: Final = frozenset({"robot"})
"""Functions that accept the text of a file, such as that of a URDF."""
_LONGEST: Final = 40
"""Greatest length of an argument that a sentence repeats."""
_AXES: Final = 3
_ROBOT: Final = 'ROBOT is a file of a robot, or an arm such as "KUKA KR 210 R2700"'


class CallError(CampaignError, TypeError):
    """A function was called with other arguments than it has; the remedy is a call that works."""


def explain_calls(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return a function that refuses wrong arguments by a `CallError`.

    Arrays in the place of a campaign are refused, too. The first parameter of a method is `self`, `cls` or
    `backend`.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def call(*arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        """Call the function unless the arguments are not those of the function."""
        parameters = [each for name, each in signature.parameters.items() if name not in _HIDDEN]
        hidden = len(signature.parameters) - len(parameters)
        attempt = _Call(function, parameters, arguments[hidden:], named)
        try:
            bound = signature.bind(*arguments, **named)
        except TypeError as error:
            raise attempt.explain(str(error)) from None
        if error_of_values := attempt.explain_values(bound.arguments):
            raise error_of_values
        return function(*arguments, **named)

    return call


class _Call(NamedTuple):
    """Arguments that a caller gave to a function."""

    function: Callable[..., object]
    parameters: Sequence[inspect.Parameter]  # without a hidden one
    arguments: Sequence[Any]  # by position, without a hidden one
    named: Mapping[str, Any]  # by name

    def explain(self, reason: str) -> CallError:
        """Return the error of arguments that do not fit; `reason` is that of Python."""
        known = [each.name for each in self.parameters if each.kind is not each.VAR_KEYWORD]
        positional = [each for each in self.parameters if each.kind is each.POSITIONAL_ONLY]
        named_by_mistake = [each.name for each in positional if each.name in self.named]
        unknown = [name for name in self.named if name not in known]
        if named_by_mistake:
            name = named_by_mistake[0]
            remedy = f"give `{name}` without its name: {self._write_usage()}"
        elif unknown and f"'{unknown[0]}'" in reason:
            remedy = self._name_argument(unknown[0], known)
        else:
            remedy = self._advise()
        return self._refuse(reason, remedy)

    def explain_values(self, bound: Mapping[str, Any]) -> CallError | None:
        """Return the error of an array in the place of a source, or of wrong options; None without one.

        `bound` has the arguments by parameter. An array of a robot has rows of Denavit and Hartenberg, so
        that it has no row for each row of `joints`.
        """
        if self.arguments and _seems_array(self.arguments[0]):
            first = self.parameters[0].name
            rows = _find_shape(self.arguments[0])[:1]
            joints = _find_shape(bound.get("joints"))
            if first == "robot" and len(joints) == 2 and joints[0] == rows[0] != joints[1]:
                return self._refuse("the first argument is an array of readings, not a robot", self._advise())
            described = self._describe(first)
            if described and first != "robot" and "Denavit" not in described:
                remedy = self._advise()
                if "campaign" in described.casefold() and "from_arrays" not in remedy:
                    remedy += "; `jointstiff.Campaign.from_arrays` makes a campaign of arrays"
                return self._refuse(f"`{first}` is an array", remedy)
        return self._explain_content() or self._explain_files() or self._explain_options(bound.get("options"))

    def _explain_content(self) -> CallError | None:
        """Return the error of a file's content in the place of its name; None without one."""
        if self.function.__name__ in _READ_TEXTS:
            return None
        named = [self.named[name] for name in _NAMED_FILES if name in self.named]
        for value in (*self.arguments, *named):
            if isinstance(value, str) and is_content(value):
                return self._refuse(describe_content(value), GIVE_NAME)
        return None

    def _explain_files(self) -> CallError | None:
        """Return the error of an argument that is no name of a file, such as a list of names.

        None for a function without names of files, and for arguments that are names.
        """
        first = self.parameters[0]
        are_files = first.kind is first.VAR_POSITIONAL and "PathLike" in str(first.annotation)
        others = [each for each in self.arguments if not isinstance(each, str | PathLike)]
        if not are_files or not others:
            return None
        reason = f"it has `{type(others[0]).__name__}` in place of the name of a file"
        function = self.function.__name__
        remedy = f"give each file as an argument of its own, such as {function}(*{first.name})"
        return self._refuse(reason, remedy)

    def _explain_options(self, options: object) -> CallError | None:
        """Return the error of options that are no message; None without one."""
        message = next((each for each in self.parameters if each.name == "options"), None)
        if options is None or message is None or message.kind is message.VAR_KEYWORD:
            return None
        known = str(message.annotation).partition(" | ")[0]
        if known in {each.__name__ for each in type(options).__mro__}:
            return None
        names = "option=value"
        if isinstance(options, Mapping):
            names = ", ".join(f"{name}=…" for name in options)
        reason = f"`options` must be a {known}, not a {type(options).__name__}"
        return self._refuse(reason, f"give options by name, and no more sources: {self._write_call(names)}")

    def _name_argument(self, unknown: str, known: Sequence[str]) -> str:
        """Return the remedy for an argument with an unknown name."""
        if "unit" in unknown and "units" in known:
            return "state all units in `units`, such as units='mm, deg'"
        similar = find_similar_name(unknown, known)
        return f"give `{similar}` in its place" if similar else f"the arguments are {', '.join(known)}"

    def _advise(self) -> str:
        """Return the call with arrays that were given, or else the call that works."""
        return self._write_call_with_arrays() or self._write_usage()

    def _list_sources(self) -> list[inspect.Parameter]:
        """Return the parameters that are given by position."""
        kinds = {inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD}
        return [each for each in self.parameters if each.kind not in kinds and each.name != "options"]

    def _write_call(self, options: str) -> str:
        """Return a call with options, which are a text."""
        sources = self._list_sources()
        words = [f"*{each.name}" if each.kind is each.VAR_POSITIONAL else each.name for each in sources]
        return f"{self.function.__name__}({', '.join([*words, options])})"

    def _write_usage(self) -> str:
        """Return the call that works, and what each argument without a name is."""
        described = {each.name: self._describe(each.name) for each in self._list_sources()}
        words = [f"`{name}`: {text.rstrip('.')}" for name, text in described.items() if text]
        return "; ".join([f"call {self._write_call('option=value')}", *words])

    def _describe(self, parameter: str) -> str:
        """Return what the docstring says about a parameter, in one line; empty without a docstring."""
        text = inspect.getdoc(self.function) or ""
        found = re.search(rf"^ +{parameter}: (.*(?:\n {{8,}}.*)*)", text, re.MULTILINE)
        return " ".join(found[1].split()) if found else ""

    def _write_call_with_arrays(self) -> str:
        """Return the call that makes a campaign of the arrays that were given.

        The arrays are named as far as their shapes are certain. The text is empty without readings, and for
        a function that accepts no campaign, or arrays of its own.
        """
        shapes = {number: _find_shape(value) for number, value in enumerate(self.arguments, 1)}
        arrays = {number: shape for number, shape in shapes.items() if len(shape) > 1}
        name, sources = self.function.__name__, self._list_sources()
        only_campaigns = all("campaign" in self._describe(each.name).casefold() for each in sources)
        has_joints = len(arrays) > 1 and len(_find_tables_of_joints(arrays)) == 1
        are_readings = 1 in arrays or has_joints
        if not are_readings or not (only_campaigns or name in {"from_arrays", "identify"}):
            return ""
        is_robot_given = isinstance(self.arguments[0], str)
        robot = repr(self.arguments[0]) if is_robot_given else "ROBOT"
        call = f"jointstiff.Campaign.from_arrays({robot}, joints, forces, unloaded=…, loaded=…, load_point=…)"
        if name != "from_arrays":
            call = f"campaign = {call}, then {name}(campaign)"
        words = _name_arrays(arrays) + ([] if is_robot_given else [_ROBOT])
        return f"make a campaign of the arrays, {call}; {'; '.join(words)}"

    def _refuse(self, reason: str, remedy: str) -> CallError:
        """Return the error with what was given."""
        given = ", ".join([*map(_show, self.arguments), *[f"{name}=…" for name in self.named]])
        detail = f"{self.function.__name__}({given}): {reason}"
        return CallError(http_problem(422, detail, remedy))


def _find_tables_of_joints(arrays: Mapping[int, tuple[int, ...]]) -> list[int]:
    """Return the numbers of the arrays with a column for each joint; other tables have x, y and z."""
    return [number for number, shape in arrays.items() if len(shape) == 2 and shape[1] != _AXES]


def _name_arrays(arrays: Mapping[int, tuple[int, ...]]) -> list[str]:
    """Return what each array is, as far as shapes are certain; `arrays` has shapes by number of argument."""
    joints = _find_tables_of_joints(arrays)
    forces = [number for number, shape in arrays.items() if len(shape) == 2 and shape[1] == _AXES]
    positions = [number for number, shape in arrays.items() if len(shape) == _AXES]
    words = ["joints (N, n)", "forces (N, 3)", "positions without and with load (N, T, 3)"]
    if len(joints) == 1 and len(arrays) > 1:  # one table alone may be that of a robot
        words[0] = f"joints is argument {joints[0]}, {arrays[joints[0]]}"
    if len(forces) == 1:
        words[1] = f"forces is argument {forces[0]}, {arrays[forces[0]]}"
    if len(positions) == 2:
        first, second = positions
        words[2] = f"unloaded and loaded are arguments {first} and {second}, {arrays[first]}"
    return words


def _show(value: Any) -> str:  # noqa: ANN401 - any argument
    """Return an argument in words: the shape of an array, a short value, or the type."""
    if shape := _find_shape(value):
        return f"array {shape}"
    text = repr(value)
    is_plain = isinstance(value, str | int | float | None)
    return text if is_plain and len(text) <= _LONGEST else type(value).__name__


def _seems_array(value: Any) -> bool:  # noqa: ANN401 - any argument
    """Return whether a value is an array, a data frame, or a list of numbers or lists."""
    if isinstance(value, list | tuple):
        return bool(value) and isinstance(value[0], int | float | list | tuple)
    return bool(getattr(value, "shape", ()))


def _find_shape(value: Any) -> tuple[int, ...]:  # noqa: ANN401 - any argument
    """Return the shape of an array, a data frame, or a list of numbers or lists; () of other values."""
    if not _seems_array(value):
        return ()
    if isinstance(value, list | tuple):
        import numpy as np

        try:
            return np.shape(value)
        except ValueError:  # rows of several lengths
            return (len(value),)
    return tuple(value.shape)
