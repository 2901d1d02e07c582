"""The frozen base of all messages; types of fields with units, and their forms on the command line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from hashlib import sha256
from typing import TYPE_CHECKING, Annotated, Any, Final, Generic, Literal, TypeVar

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError
from typing_extensions import TypeAliasType

from jointstiff.schemas.joints import JOINT_UNITS

FAR_POINT = 5.0
"""Distance of a point on the tool from the flange beyond which its unit is in doubt [m]."""

MAX_NAME_LENGTH = 200
MAX_MAGNITUDE = 1e12
"""Largest magnitude of a number; no quantity reaches it in a supported unit, and its square is finite."""


class Message(BaseModel):
    """Base of all messages: immutable, unknown fields refused, NaN and infinity refused."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, json_schema_serialization_defaults_required=True
    )

    if not TYPE_CHECKING:  # for a type checker, a message has its fields alone

        def __getattr__(self, name: str) -> object:
            """Return a private attribute of pydantic; for another name, list the fields of the message.

            Raises:
                AttributeError: the message has no such attribute.
            """
            try:
                return super().__getattr__(name)
            except AttributeError:
                if name.startswith("_"):
                    raise
                reason = f"a {type(self).__name__} has no `{name}`"
                fields = ", ".join(type(self).model_fields)
                raise AttributeError(f"{reason}; its fields are {fields}", name=name, obj=self) from None


def require_exactly_one(first: str, second: str) -> Any:  # noqa: ANN401 - what pydantic makes of a validator
    """Return a validator of a message that requires exactly one of two fields, given their names."""

    def check(message: Message) -> Message:
        """Return the message unchanged; refuse it if both fields, or neither field, are stated."""
        if (getattr(message, first) is None) == (getattr(message, second) is None):
            raise ValueError(f"give either `{first}` or `{second}`")
        return message

    return model_validator(mode="after")(check)


def make_fault(place: str | tuple[str | int, ...], reason: str) -> ValidationError:
    """Return the error for a fault in a field, to be raised by a validator of a message.

    Args:
        place: name of the field in the message, or the path to a part of the field.
        reason: what is wrong.
    """
    path = (place,) if isinstance(place, str) else place
    # The reason is no template: it may contain braces.
    fault = PydanticCustomError("value_error", "{reason}", {"reason": reason})
    return ValidationError.from_exception_data(
        reason, [InitErrorDetails(type=fault, loc=path, input=None)], hide_input=True
    )


def content_key(text: str) -> str:
    """Return an idempotency key made of a JSON text's SHA-256, so that equal texts are stored only once."""
    return f"content {sha256(text.encode()).hexdigest()}"


def _refuse_unprintable(text: str) -> str:
    """Return a text unchanged; refuse unprintable characters and blanks at its ends."""
    if not text.isprintable() or text != text.strip():
        raise ValueError("must be printable text without leading or trailing blanks")
    return text


Name = Annotated[str, Field(min_length=1, max_length=MAX_NAME_LENGTH), AfterValidator(_refuse_unprintable)]
"""Text for people: only printable characters, as databases and pages handle other characters differently."""

Identifier = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_-]+$")]
"""The identifier of a stored resource."""

Quantity = Annotated[float, Field(strict=True, ge=-MAX_MAGNITUDE, le=MAX_MAGNITUDE)]
"""A finite number, not a text of digits, whose square is finite too."""

Confidence = Annotated[
    float, Field(strict=True, ge=0.5, le=0.9999, description="Confidence of the intervals.")
]
"""The probability of an interval."""

Vector3 = TypeAliasType(
    "Vector3",
    Annotated[
        tuple[Quantity, Quantity, Quantity],
        Field(description="Three components along x, y and z, as stated by the user."),
    ],
)
"""Three components along x, y and z, which a description of the API states once and refers to."""

Point = TypeAliasType(
    "Point",
    Annotated[
        tuple[float, float, float],
        Field(description="Three components along x, y and z, as computed from the readings."),
    ],
)
"""Three components of a result."""

Square3 = TypeAliasType(
    "Square3", Annotated[tuple[Point, Point, Point], Field(description="Square matrix, row by row.")]
)
"""A matrix of a result."""

Interval = TypeAliasType(
    "Interval", Annotated[tuple[float, float], Field(description="Lower and upper end.")]
)
"""An interval of a result, with both ends."""

Value = TypeVar("Value")

Metres = Annotated[Value, Field(json_schema_extra={"unit": "m"})]
Kilograms = Annotated[Value, Field(json_schema_extra={"unit": "kg"})]
Radians = Annotated[Value, Field(json_schema_extra={"unit": "rad"})]
Newtons = Annotated[Value, Field(json_schema_extra={"unit": "N"})]
RotationalCompliance = Annotated[Value, Field(json_schema_extra={"unit": "rad/(N.m)"})]
TranslationalCompliance = Annotated[Value, Field(json_schema_extra={"unit": "m/N"})]
TranslationPerMoment = Annotated[Value, Field(json_schema_extra={"unit": "m/(N.m)"})]
RotationPerForce = Annotated[Value, Field(json_schema_extra={"unit": "rad/N"})]
LinearStiffness = Annotated[Value, Field(json_schema_extra={"unit": "N/m"})]
Torque = Annotated[Value, Field(json_schema_extra={"unit": "N.m"})]
SquareCompliance = Annotated[Value, Field(json_schema_extra={"unit": "rad2/(N.m)2"})]
SquareMetres = Annotated[Value, Field(json_schema_extra={"unit": "m2"})]
CubicMetres = Annotated[Value, Field(json_schema_extra={"unit": "m3"})]
Seconds = Annotated[Value, Field(json_schema_extra={"unit": "s"})]
Pascals = Annotated[Value, Field(json_schema_extra={"unit": "Pa"})]
Inertia = Annotated[Value, Field(json_schema_extra={"unit": "kg.m2"})]
MixedSquares = Annotated[Value, Field(json_schema_extra={"unit": "m2, m.rad, rad2"})]
Dimensionless = Annotated[Value, Field(json_schema_extra={"unit": "1"})]
StatedUnit = Annotated[Value, Field(json_schema_extra={"unit": "see `unit`"})]
"""A value of any shape in this unit, which is in the JSON schema: `Metres[float | None]`."""

_ANGLES, _LENGTHS = JOINT_UNITS["revolute"], JOINT_UNITS["prismatic"]
Positions = Annotated[
    Value, Field(json_schema_extra={"unit": _ANGLES.position, "unit_of_prismatic": _LENGTHS.position})
]
JointSpeeds = Annotated[
    Value,
    Field(
        json_schema_extra={
            "unit": f"{_ANGLES.position}/s",
            "unit_of_prismatic": f"{_LENGTHS.position}/s",
        }
    ),
]
Effort = Annotated[
    Value, Field(json_schema_extra={"unit": _ANGLES.effort, "unit_of_prismatic": _LENGTHS.effort})
]
Stiffness = Annotated[
    Value, Field(json_schema_extra={"unit": _ANGLES.stiffness, "unit_of_prismatic": _LENGTHS.stiffness})
]
Compliance = Annotated[
    Value, Field(json_schema_extra={"unit": _ANGLES.compliance, "unit_of_prismatic": _LENGTHS.compliance})
]
"""A number of a joint, whose unit depends on the kind of the joint."""

Timestamp = datetime
"""A time in UTC; in JSON it ends with `Z`."""
_FIRST_YEAR, _LAST_YEAR = 1980, 2200


def _refuse_number(value: object) -> object:
    """Return a time unchanged; refuse a number, as it may mean seconds, milliseconds or a date."""
    if isinstance(value, int | float) or (isinstance(value, str) and value.strip().lstrip("+-").isdecimal()):
        raise ValueError("must be a date and a time with its zone, such as 2026-11-20T14:30:00+01:00")
    return value


def _convert_to_utc(value: datetime) -> datetime:
    """Return a time in UTC; refuse a time of an implausible year."""
    # Years next to the first and the last one of all dates have no time in UTC.
    if _FIRST_YEAR - 1 <= value.year <= _LAST_YEAR + 1:
        in_utc = value.astimezone(UTC)
        if _FIRST_YEAR <= in_utc.year <= _LAST_YEAR:
            return in_utc
    raise ValueError(f"must lie between {_FIRST_YEAR} and {_LAST_YEAR}")


Moment = Annotated[AwareDatetime, BeforeValidator(_refuse_number), AfterValidator(_convert_to_utc)]
"""A time that was stated with its zone; kept in UTC."""

LEAST_PAYLOAD, GREATEST_PAYLOAD = 0.1, 1e4
Payload = Kilograms[Annotated[float, Field(strict=True, ge=LEAST_PAYLOAD, le=GREATEST_PAYLOAD)]]
"""The largest payload of a robot by its maker."""

Item = TypeVar("Item", bound=Message)


class ResourceChange(Message):
    """Changes of a resource other than a job. Omitted fields remain unchanged."""

    name: Name | None = Field(default=None, description="New name; null: unchanged.")
    deleted: StrictBool | None = Field(
        default=None,
        description="True deletes the resource; false restores a resource that was deleted within the "
        "last 30 days.",
    )


MOST_COUNTED: Final = 10_000
"""Greatest number of resources on all pages that a listing counts."""


class Page(Message, Generic[Item]):
    """One page of a listing."""

    items: list[Item]
    next: str | None = Field(description="Value of `cursor` for the next page; null on the last page.")
    total: int | None = Field(
        default=None,
        description=f"Number on all pages ({MOST_COUNTED + 1}: more); null from page 2 on.",
    )


def validate_list(kind: type[Item], documents: Sequence[dict[str, Any]]) -> list[Item]:
    """Validate many documents as messages of a class, five times faster than one after the other."""
    return _list_adapter(kind).validate_python(documents, from_attributes=True)


@lru_cache(maxsize=64)
def _list_adapter(kind: type[Item]) -> TypeAdapter[list[Item]]:
    """Return pydantic's validator of lists of messages of a class; cached, as it takes time to build."""
    return TypeAdapter(list[kind])  # type: ignore[valid-type]


@dataclass(frozen=True)
class Terminal:
    """Form of a field on the command line, if name and type of the field do not determine the form."""

    option: str = ""  # name, such as `--prior`; if empty, made from the name of the field
    metavar: str = ""  # form of the value in the help
    parse: Callable[[str], Any] | None = None  # converts text to JSON; raises a ValueError
    gather: Literal["one", "list", "dict"] = "one"  # collection of the values of a repeated option
    unit: str = ""  # unit of the option's numbers: m, deg or N
    hidden: bool = False  # whether the field has no option: it comes from a file of options
    flag: str = ""  # value of the field if the option is stated; then the option takes no value
    text: str = ""  # help text, if the description of the field is not right for the command line


def parse_prior(text: str) -> tuple[str, dict[str, float]]:
    """Parse `JOINT=STIFFNESS:UNCERTAINTY`; return (name of the joint, fields of its prior)."""
    name, _, numbers = text.rpartition("=")
    stiffness, _, uncertainty = numbers.partition(":")
    try:
        return name, {"stiffness": float(stiffness), "standard_uncertainty": float(uncertainty)}
    except ValueError:
        raise ValueError(
            f"'{text}' must state joint, stiffness and standard uncertainty, such as joint_5=4e5:4e4"
        ) from None


def parse_stiffness(text: str) -> tuple[str, float]:
    """Parse `JOINT=STIFFNESS` in N·m/rad; return (name of the joint, stiffness)."""
    name, _, number = text.rpartition("=")
    try:
        return name, float(number)
    except ValueError:
        raise ValueError(f"'{text}' must state joint and stiffness in N·m/rad, such as joint_2=3e6") from None


def parse_cause(text: str) -> dict[str, str | None]:
    """Parse `NAME[:FIRST]`; return the fields of a cause: its name, and the label of an observation."""
    name, _, first_label = text.partition(":")
    return {"name": name, "first": first_label or None}


def parse_names(text: str) -> list[str]:
    """Parse `NAME,NAME,...`, such as names of joints; return the names without blanks around them."""
    return [name.strip() for name in text.split(",")]


def parse_resampling(text: str) -> dict[str, int]:
    """Parse `SIZE[:REPETITIONS[:SEED]]`; return the stated fields of a resampling."""
    parts, names = text.split(":"), ("size", "repetitions", "seed")
    if len(parts) > len(names) or not all(part.isdecimal() for part in parts):
        raise ValueError(f"'{text}' must be whole numbers, such as 10:1000:1")
    return dict(zip(names, map(int, parts), strict=False))


def parse_planned_load(text: str) -> dict[str, Any]:
    """Parse `KIND:NEWTONS`, `dead_weight:150kg` or `own_weight`; return the fields of a planned load."""
    kind, _, force = text.partition(":")
    if text == "own_weight":
        return {"kind": text}
    try:
        if kind == "dead_weight" and force.endswith("kg"):
            return {"kind": kind, "mass": float(force.removesuffix("kg"))}
        return {"kind": kind, "force": float(force)}
    except ValueError:
        raise ValueError(
            f"'{text}' must state the kind of load (dead_weight or any_direction) and its force in newtons, "
            "such as any_direction:1500"
        ) from None


def parse_planned_step(text: str) -> dict[str, Any]:
    """Parse `MASS[±UNCERTAINTY]` in kg; return the fields of a planned weight step."""
    mass, sign, uncertainty = text.replace("+-", "±").partition("±")
    try:
        step: dict[str, Any] = {"mass": float(mass)}
        return step | {"mass_uncertainty": float(uncertainty)} if sign else step
    except ValueError:
        raise ValueError(f"'{text}' must be a mass in kg, such as 100.2±0.1") from None


def parse_target(text: str) -> tuple[str, list[float]]:
    """Parse `NAME=X,Y,Z` in mm; return (name of the target, its place in the flange frame [m])."""
    name, _, numbers = text.rpartition("=")
    place = parse_numbers(numbers)
    if not name or len(place) != 3:
        raise ValueError(
            f"'{text}' must state the name of a target and its place on the flange in mm, such as "
            "P10=147,55,50"
        )
    return name.strip(), [1e-3 * part for part in place]


def parse_box(text: str) -> list[list[float]]:
    """Parse two corners of a box, `X,Y,Z,X,Y,Z` in mm; return [least corner, greatest corner] [m]."""
    numbers = [1e-3 * part for part in parse_numbers(text)]
    if len(numbers) != 6:
        raise ValueError(
            f"'{text}' must state two opposite corners of a box in mm, such as 800,-600,400,1900,600,1600"
        )
    ranges = [sorted(pair) for pair in zip(numbers[:3], numbers[3:], strict=True)]  # along x, y and z
    return [[least for least, _ in ranges], [greatest for _, greatest in ranges]]


def parse_force(text: str) -> dict[str, list[float]]:
    """Parse `X,Y,Z` in N; return the fields of a load without moment."""
    return {"force": parse_numbers_in_newtons(text)}


def parse_numbers_in_newtons(text: str) -> list[float]:
    """Parse the components of a force in N, separated by commas or blanks; return the numbers."""
    try:
        return parse_numbers(text)
    except ValueError:
        raise ValueError(
            f"'{text}' must be numbers in N, such as 0,0,-490.3 for 50 kg: 1 kg weighs 9.80665 N"
        ) from None


def parse_frame(text: str) -> dict[str, Any]:
    """Parse `[NAME=]NUMBERS`; return the fields of a frame, whose name may be None."""
    name, _, numbers = text.rpartition("=")
    return {"name": name or None, "values": parse_numbers(numbers)}


def parse_numbers(text: str) -> list[float]:
    """Parse numbers that are separated by commas or blanks; return the numbers."""
    try:
        return [float(number) for number in text.replace(",", " ").split()]
    except ValueError:
        raise ValueError(f"'{text}' must be numbers, such as 0,0,215.5") from None
