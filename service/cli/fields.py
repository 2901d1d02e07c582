"""The fields of a message as options of a command: their form, their values, and their names in texts."""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType, NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Union, get_args, get_origin

import typer
from typing_extensions import TypeAliasType

from jointstiff.schemas.fields import Message, Terminal, parse_names
from jointstiff.schemas.options import METHODS_IN_SHORT
from jointstiff.service.cli import options as cli

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from jointstiff.schemas.finding import Problem, ProblemItem

_ALWAYS_REFUSED: Final = frozenset({"compensates_load"})
"""Words of options that every request refuses with a reason of their own; no remedy proposes them."""
Forms = Mapping[str, Terminal]
"""Field of a message → its form on the command line."""
NO_FORMS: Final[Forms] = MappingProxyType({})


class ParsedValue:
    """Placeholder type of options whose text is parsed by a function of Jointstiff, not by Typer."""


def field_options(message_class: type[Message], form_of_field: Forms = NO_FORMS) -> Iterator[tuple[str, Any]]:
    """Yield (name, Typer annotation) of each field of a message that has an option on the command line.

    All options may be omitted: missing fields are reported when the message is validated.

    Args:
        message_class: class of the message whose fields become options.
        form_of_field: forms of fields on the command line, in place of the forms that the class declares.
    """
    for name, field_info in message_class.model_fields.items():
        terminal = find_option_form(field_info, form_of_field.get(name))
        value = _choose_option_value(field_info, terminal)
        if terminal.hidden or value is None:
            continue
        flag = option_flag(message_class, name, form_of_field)
        if value.has_negative:
            flag += f"/--no-{name.replace('_', '-')}"
        text = terminal.text or " ".join((field_info.description or "").split())
        if value.is_repeatable:
            text += " Repeatable."
        yield name, Annotated[value.type | None, typer.Option(flag, help=text, **value.arguments)]


@dataclass(frozen=True)
class _OptionValue:
    """The value of an option on the command line."""

    type: Any  # of Python, such as float
    arguments: Mapping[str, Any] = field(default_factory=dict)  # for `typer.Option`, such as a parser
    is_repeatable: bool = False  # whether the option can be given several times
    has_negative: bool = False  # whether there is an option `--no-…`, too

    @classmethod
    def parsed(
        cls,
        parser: Callable[[str], Any],
        metavar: str,
        **arguments: Any,  # noqa: ANN401 - of Typer
    ) -> _OptionValue:
        """Return a value that a parser makes of a text; the help shows the form of the text by `metavar`."""
        return cls(ParsedValue, {"parser": parser, "metavar": metavar, **arguments})


def _choose_option_value(field_info: FieldInfo, terminal: Terminal) -> _OptionValue | None:
    """Return the value of the option of a field, whose form is `terminal`.

    Return None if the field cannot be an option, so that only a file of options can state it.
    """
    if terminal.flag:
        return _OptionValue(bool)
    if terminal.parse is None:
        return _choose_value_by_type(_unwrap_type(field_info.annotation), terminal.unit)
    value = _OptionValue.parsed(_keep_words_of_errors(terminal.parse), terminal.metavar)
    if terminal.gather == "one":
        return value
    return replace(value, type=list[ParsedValue], is_repeatable=True)


def option_flag(message_class: type[Message], name: str, form_of_field: Forms = NO_FORMS) -> str:
    """Return the command-line option of a field, such as `--load-point`.

    `form_of_field` maps names of fields to the forms of their options (spelling, unit, parser).
    Other fields have the form that `message_class` declares.
    """
    return (
        find_option_form(message_class.model_fields[name], form_of_field.get(name)).option
        or f"--{name.replace('_', '-')}"
    )


def gather_stated_fields(
    message_class: type[Message], values: Mapping[str, Any], form_of_field: Forms = NO_FORMS
) -> dict[str, Any]:
    """Return the fields of a message that a user stated with the options of a command, by name.

    Args:
        message_class: class of the message.
        values: values of all options of the command; None or [] for an option that was not given.
        form_of_field: forms of fields on the command line, in place of the forms that the class declares.
    """
    stated = {}
    for name, _ in field_options(message_class, form_of_field):
        if values[name] not in (None, []):
            terminal = find_option_form(message_class.model_fields[name], form_of_field.get(name))
            value = dict(values[name]) if terminal.gather == "dict" else values[name]
            stated[name] = terminal.flag or value  # an option without a value means the value `flag`
    return stated


def _keep_words_of_errors(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a parser that raises BadParameter with the message of a ValueError of `parse`.

    Without this, Click would replace the message by the text that was parsed.
    """

    def parse_option(text: str) -> Any:  # noqa: ANN401 - JSON
        """Parse the text of an option, and report an error in the words of `parse`."""
        try:
            return parse(text)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return parse_option


def find_option_form(field_info: FieldInfo, form: Terminal | None = None) -> Terminal:
    """Return the form of a field on the command line.

    `form` takes precedence, then the form that the field declares, then a form that only has the field's
    unit.
    """
    if form is not None:
        return form
    extra = field_info.json_schema_extra
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    return next((each for each in field_info.metadata if isinstance(each, Terminal)), Terminal(unit=unit))


def _choose_value_by_type(field_type: Any, unit: str) -> _OptionValue | None:  # noqa: ANN401 - a type
    """Return the value of an option for a field with a type and a unit.

    Return None if the field cannot be an option, so that only a file of options can state it.
    """
    if field_type is bool:
        return _OptionValue(bool, has_negative=True)
    if field_type is int:
        return _OptionValue(int)
    if field_type is str:
        return _OptionValue(str, {"metavar": "TEXT"})
    if field_type is float:
        return _choose_number_value(unit)
    if get_origin(field_type) is Literal:
        return _choose_word_value(get_args(field_type))
    item_types = [_unwrap_type(each) for each in get_args(field_type)]
    if get_origin(field_type) is tuple and item_types == [float] * 3:
        return _choose_vector_value(unit)
    if get_origin(field_type) is list and (item_types[0] is str or get_origin(item_types[0]) is Literal):
        return _OptionValue.parsed(parse_names, "NAME,NAME,...")
    return None


def _choose_number_value(unit: str) -> _OptionValue:
    """Return the value of an option with a number, whose field has a unit: lengths are typed in mm."""
    if unit not in _UNITS_AT_TERMINAL:
        return _OptionValue(float, {"metavar": "NUMBER"})
    terminal_unit, factor = _UNITS_AT_TERMINAL[unit]
    return _OptionValue.parsed(lambda text: factor * float(text), f"NUMBER[{terminal_unit}]")


def _choose_word_value(words: Sequence[str]) -> _OptionValue:
    """Return the value of an option with one of the words of a field, which the shell can complete."""
    return _OptionValue.parsed(
        _keep_words_of_errors(_make_word_parser(words)),
        f"<{'|'.join(words)}>",
        autocompletion=lambda incomplete: [word for word in words if word.startswith(incomplete)],
    )


def _choose_vector_value(unit: str) -> _OptionValue:
    """Return the value of an option with three numbers, whose field has a unit: points are typed in mm."""
    if unit == "m":
        return _OptionValue.parsed(cli.parse_point, "X,Y,Z[mm]")
    if unit in {"", "1"}:
        return _OptionValue.parsed(cli.parse_vector, "X,Y,Z")
    return _OptionValue.parsed(partial(cli.parse_vector, unit=unit), f"X,Y,Z[{unit}]")


def _make_word_parser(words: Sequence[str]) -> Callable[[str], str]:
    """Return a parser that accepts the words of an API field and the abbreviations of methods.

    Hyphens may replace the underscores of a word.
    """

    def parse(text: str) -> str:
        """Return the word of the API that a text names; raise UnknownWordError for another text."""
        word = METHODS_IN_SHORT.get(text.upper(), text.replace("-", "_"))
        if word not in words:
            raise cli.UnknownWordError(text, words)
        return word

    return parse


_UNITS_AT_TERMINAL: Final[Mapping[str, tuple[str, float]]] = {
    "m": ("mm", 1e-3),
    "rad": ("deg", math.pi / 180.0),
    "deg": ("deg", 1.0),
}
"""Unit in the API → (unit on the command line, factor that converts a number to the unit in the API)."""


def _unwrap_type(annotation: Any) -> Any:  # noqa: ANN401 - a type
    """Return the plain type that an alias, an `Annotated` or an optional type contains."""
    if isinstance(annotation, TypeAliasType):
        return _unwrap_type(annotation.__value__)
    origin = get_origin(annotation)
    if origin is Annotated:
        return _unwrap_type(get_args(annotation)[0])
    if origin in {Union, UnionType}:
        others = [each for each in get_args(annotation) if each is not NoneType]
        return _unwrap_type(others[0]) if len(others) == 1 else annotation
    return annotation


_FIELD_IN_TEXT: Final = re.compile(
    r"`(?:open\.)?(\w+)(?:: (\w+|\[[^`\]]*\]))?`(?:: (\[[^`\]]*\]|\{(?:[^\"`{}]|\"(?:[^\"\\`]|\\.)*\")*\}))?"
)
"""A field in backquotes, with a word, a list or an object as its value: `field`, `field: word`, `field: [A]`,
`field`: [A] or `field`: {"A": "B"}; of a live campaign, `open.field`, too."""


def _read_pairs(value: str) -> dict[str, str] | None:
    """Return the object of a text in JSON; None for another text, such as one of a user's file."""
    try:
        pairs = json.loads(value)
    except ValueError:
        return None
    return pairs if isinstance(pairs, dict) else None


def name_options_in_text(message_class: type[Message], text: str, form_of_field: Forms = NO_FORMS) -> str:
    """Return a text in which the fields of a message are replaced by the options of a command.

    A field in backquotes, such as `load_point`, becomes `--load-point`; a field with a value, such as
    `method: pose`, becomes `--method pose`; `leave_alone: ['A', 'B']` becomes `--leave-alone A,B`, and an
    option that may be repeated is repeated for each value, such as `--flange-target P1=0,0,9` for
    `flange_targets`: {"P1": [0, 0, 9]}.

    Args:
        message_class: class of the message that has the fields.
        text: text for a user.
        form_of_field: forms of fields on the command line, in place of the forms that the class declares.
    """
    fields_with_option = dict(field_options(message_class, form_of_field))

    def replace_field(match: re.Match[str]) -> str:
        """Return the option for a matched field; the unchanged text if the field has no option."""
        name, value = match[1], match[2] or match[3]
        if name not in fields_with_option:
            return match[0]
        flag = option_flag(message_class, name, form_of_field)
        field_info = message_class.model_fields[name]
        form = find_option_form(field_info, form_of_field.get(name))
        if value is None or form.flag:
            return f"`{flag}`"
        if _unwrap_type(field_info.annotation) is bool:
            return f"`{flag}`" if value == "true" else f"`--no-{name.replace('_', '-')}`"
        values = _write_option_values(value, form)
        return match[0] if values is None else f"`{' '.join(f'{flag} {each}' for each in values)}`"

    return _FIELD_IN_TEXT.sub(replace_field, text)


def _write_option_values(value: str, form: Terminal) -> list[str] | None:
    """Return the value of a field as texts for the command line, one for each time that the option is given.

    `["A", "B"]` → "A,B" if the option has one text, else "A" and "B"; `{"pre": "unloaded"}` → "pre=unloaded";
    `{"length": "mm", "force": "N"}` → "length=mm,force=N" if the option has one text.
    Return None for a value that is not understood.
    """
    if value.startswith("{"):
        pairs = _read_pairs(value)
        if pairs is None:
            return None
        texts = [f"{key}={meaning}" for key, meaning in pairs.items()]
        return [shlex.quote(text) for text in (texts if form.gather == "dict" else [",".join(texts)])]
    values = [each.strip(" '\"") for each in value.strip("[]").split(",")]
    return [",".join(values)] if form.gather == "one" else values


def name_options_in_problem(
    message_class: type[Message], problem: Problem, form_of_field: Forms = NO_FORMS
) -> Problem:
    """Return a problem whose texts name the command's options in place of the request's fields.

    Args:
        message_class: class of the request.
        problem: problem with the fields of the request.
        form_of_field: forms of fields on the command line, in place of the forms that the class declares.
    """
    items = [_name_options_in_item(message_class, item, form_of_field) for item in problem.errors]
    title = problem.title
    if items and all(re.split(r"\W", item.where)[0] in message_class.model_fields for item in items):
        title = "Options are missing or wrong"
    if problem.remedy in {item.remedy for item in problem.errors}:
        remedy = items[0].remedy
    else:
        remedy = problem.remedy and name_options_in_text(message_class, problem.remedy, form_of_field)
    detail = name_options_in_text(message_class, problem.detail, form_of_field)
    return problem.model_copy(update={"title": title, "detail": detail, "remedy": remedy, "errors": items})


def _name_options_in_item(
    message_class: type[Message], item: ProblemItem, form_of_field: Forms
) -> ProblemItem:
    """Return one fault of a request, whose texts name options; arguments as `name_options_in_problem`."""
    from jointstiff.service.problems import MISSING

    reason = name_options_in_text(message_class, item.reason, form_of_field)
    if item.reason == MISSING and item.where in message_class.model_fields:
        remedy: str | None = _explain_missing_option(message_class, item.where, form_of_field)
    else:
        remedy = item.remedy and name_options_in_text(message_class, item.remedy, form_of_field)
    return item.model_copy(update={"reason": reason, "remedy": remedy})


def _explain_missing_option(message_class: type[Message], name: str, form_of_field: Forms) -> str:
    """Return the remedy for a missing field: "give `--encoders`: one of motor, secondary"."""
    if name not in dict(field_options(message_class, form_of_field)):
        return "state the option in the JSON file of `--options`"
    remedy = f"give `{option_flag(message_class, name, form_of_field)}`"
    field_type = _unwrap_type(message_class.model_fields[name].annotation)
    if get_origin(field_type) is not Literal:
        return remedy
    words = [word for word in get_args(field_type) if word not in _ALWAYS_REFUSED]
    return f"{remedy}: one of {', '.join(words)}"


@contextmanager
def naming_options(message_class: type[Message], form_of_field: Forms = NO_FORMS) -> Iterator[None]:
    """Change errors raised in the block: their texts name the command's options in place of fields.

    Args:
        message_class: class of the request.
        form_of_field: forms of fields on the command line, in place of the forms that the class declares.
    """
    from jointstiff.service.problems import CampaignError, FilesError, problem_from_error

    try:
        yield
    except FilesError as error:
        problem = problem_from_error(error)
        raise CampaignError(name_options_in_problem(message_class, problem, form_of_field)) from error
    except CampaignError as error:
        problem = name_options_in_problem(message_class, error.problem, form_of_field)
        raise CampaignError(problem) from error
