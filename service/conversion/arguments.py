"""Units of arguments: every function of the Python library takes mm, deg, N and N·m, or those of `units=`.

Masses are in kg. Quantities that combine units, such as stiffnesses [N·m/rad], are in SI units. Messages,
such as `PlanOptions`, have the same units as over HTTP.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np

from jointstiff.schemas.fields import Message
from jointstiff.schemas.joints import JointKind
from jointstiff.service.conversion.units import SIZES
from jointstiff.solver.errors import MeasurementError

JointKinds = Callable[[], Mapping[str, JointKind]]
"""Function that returns joint name → kind, in the order of the joints; called only to convert positions."""

_QUANTITIES: Final = {"m": "length", "rad": "angle", "N": "force", "N.m": "moment"}
_DOCUMENTS: Final = frozenset({"robot", "joint_map"})
"""Options that are documents of their own, whose numbers are in the units of the document."""


def convert_to_si(
    message: type[Message],
    fields: Mapping[str, Any],
    units: Mapping[str, str],
    joint_kinds: JointKinds | None = None,
) -> dict[str, Any]:
    """Return fields of a message by name, with the numbers converted from the caller's units to SI units.

    Numbers of fields that the message states in its own `units` are returned unchanged, and so are messages.

    Args:
        message: type of the message, whose schema states the SI unit of each field.
        fields: values by name: numbers, arrays, sequences, mappings and messages.
        units: the caller's unit of each quantity by name.
        joint_kinds: returns the kinds of the joints, for fields with positions of joints.
    """
    converter = _Converter(message, units, joint_kinds)
    return {
        name: value if name in _DOCUMENTS else converter.convert_field(name, value)
        for name, value in fields.items()
    }


@lru_cache(maxsize=32)
def _read_schema(message: type[Message]) -> dict[str, Any]:
    """Return the JSON schema of a message; cached, as it takes time to build."""
    return message.model_json_schema()


class _Converter:
    """Conversion of the fields of one message from the caller's units."""

    def __init__(
        self, message: type[Message], units: Mapping[str, str], joint_kinds: JointKinds | None
    ) -> None:
        """Read the schema of the message, and the sizes of the units in SI units."""
        self._schema, self._joint_kinds = _read_schema(message), joint_kinds
        self._states_units = "units" in message.model_fields
        self._factors = {
            si_unit: SIZES[quantity][units[quantity]]
            for si_unit, quantity in _QUANTITIES.items()
            if quantity in units
        }

    def convert_field(self, name: str, value: Any) -> Any:  # noqa: ANN401 - values of any field
        """Return the value of a field of the message in SI units."""
        properties = self._schema["properties"]
        return self._convert(value, properties[name], {}) if name in properties else value

    def _convert(self, value: Any, schema: Mapping[str, Any], units: Mapping[str, str]) -> Any:  # noqa: ANN401
        """Return a value whose form and unit a schema states in SI units.

        `units` are those of the enclosing schema: "unit", and "unit_of_prismatic" of positions of joints.
        """
        if isinstance(value, np.ndarray | np.generic) or hasattr(value, "to_numpy"):
            value = np.asarray(value).tolist()
        if value is None or isinstance(value, Message | str | bool):
            return value
        units = self._read_units(schema, units)
        if "unit_of_prismatic" in units and units.get("unit") in _QUANTITIES:
            return self._convert_by_joint(value, units["unit"], units["unit_of_prismatic"])
        branches = list(self._list_branches(schema, units))
        if isinstance(value, Mapping):
            return self._convert_mapping(value, branches)
        if isinstance(value, Sequence):
            return self._convert_sequence(value, branches)
        unit = next((branch_units["unit"] for _, branch_units in branches if "unit" in branch_units), "")
        if unit not in _QUANTITIES or not isinstance(value, int | float):
            return value
        return _multiply(value, self._find_factor(unit))

    def _find_factor(self, unit: str) -> float:
        """Return the size, in an SI unit, of the caller's unit of the same quantity.

        Raises:
            MeasurementError: the caller states no unit of moments.
        """
        if unit not in self._factors:
            raise MeasurementError(
                "the unit of moments is missing",
                where="units",
                remedy="write units as in 'mm, deg, kN, kN.m'",
            )
        return self._factors[unit]

    def _read_units(self, schema: Mapping[str, Any], units: Mapping[str, str]) -> Mapping[str, str]:
        """Return the units that a schema states, or else those of the enclosing schema."""
        if "unit" in schema:
            return {name: schema[name] for name in ("unit", "unit_of_prismatic") if name in schema}
        # A tracker's sheet in a message without units is in SI units.
        description = schema.get("description", "")
        if not self._states_units and re.search(r"in (units\.|the set's unit of )length", description):
            return {"unit": "m"}
        return units

    def _list_branches(
        self, schema: Mapping[str, Any], units: Mapping[str, str]
    ) -> Iterator[tuple[Mapping[str, Any], Mapping[str, str]]]:
        """Yield each alternative of a schema, references and unions resolved, together with its units."""
        units = self._read_units(schema, units)
        if "$ref" in schema:
            definition = self._schema["$defs"][schema["$ref"].rpartition("/")[2]]
            yield from self._list_branches(definition, units)
        elif alternatives := schema.get("anyOf") or schema.get("oneOf"):
            for alternative in alternatives:
                yield from self._list_branches(alternative, units)
        else:
            yield schema, units

    def _convert_mapping(
        self, value: Mapping[Any, Any], branches: Sequence[tuple[Mapping[str, Any], Mapping[str, str]]]
    ) -> Any:  # noqa: ANN401
        """Return a mapping in SI units: the fields of a message, or values by name.

        `branches` are the alternatives of the JSON schema, each with the units of its numbers. The first
        alternative that fits is used; if none fits, the value is returned unchanged.
        """
        for schema, units in branches:
            if "additionalProperties" in schema and isinstance(schema["additionalProperties"], Mapping):
                return {
                    name: self._convert(each, schema["additionalProperties"], units)
                    for name, each in value.items()
                }
            properties = schema.get("properties", {})
            constants = {name: field["const"] for name, field in properties.items() if "const" in field}
            if set(value) <= set(properties) and all(
                value.get(name, constant) == constant for name, constant in constants.items()
            ):
                # Each field of a message states its own units.
                return {name: self._convert(each, properties[name], {}) for name, each in value.items()}
        return value  # not understood: the message refuses the value and says why

    def _convert_sequence(
        self, value: Sequence[Any], branches: Sequence[tuple[Mapping[str, Any], Mapping[str, str]]]
    ) -> list[Any]:
        """Return a sequence as a list in SI units; if no alternative fits, the values are unchanged.

        `branches` are the alternatives of the JSON schema, each with the units of its numbers. The first
        alternative that fits is used.
        """
        for schema, units in branches:
            parts = schema.get("prefixItems")
            if parts is not None and len(parts) == len(value):
                return [self._convert(each, part, units) for each, part in zip(value, parts, strict=True)]
            if "items" in schema:
                return [self._convert(each, schema["items"], units) for each in value]
        return list(value)

    def _convert_by_joint(self, value: Any, unit: str, unit_of_prismatic: str) -> Any:  # noqa: ANN401 - by joint
        """Return values of joints in SI units: by name, or arrays (..., n) in the order of the joints.

        Args:
            value: values by joint, such as positions.
            unit: SI unit for revolute joints, such as "rad".
            unit_of_prismatic: SI unit for prismatic joints, such as "m".
        """
        kinds = self._joint_kinds() if self._joint_kinds is not None else {}
        units = {"revolute": unit, "prismatic": unit_of_prismatic}
        if isinstance(value, Mapping):
            return {
                name: _scale(each, self._find_factor(units[kinds.get(name, "revolute")]))
                for name, each in value.items()
            }
        factors = [self._find_factor(units[kind]) for kind in kinds.values()]
        return _scale_joints(value, factors, self._find_factor(unit))


def _multiply(number: Any, factor: float) -> Any:  # noqa: ANN401 - of any field
    """Return a number times a factor; a factor below one divides, so that 1400 mm are exactly 1.4 m."""
    if not isinstance(number, int | float) or factor == 1.0:
        return number  # the message refuses what is no number
    divisor = round(1.0 / factor)
    return number / divisor if divisor > 1 and factor == 1.0 / divisor else number * factor


def _scale(value: Any, factor: float) -> Any:  # noqa: ANN401 - numbers and arrays
    """Return a number, or the numbers of a nested sequence, times a factor."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_scale(each, factor) for each in value]
    return _multiply(value, factor)


def _scale_joints(value: Any, factors: Sequence[float], otherwise: float) -> Any:  # noqa: ANN401 - arrays
    """Return an array (..., n) times the factors (n,) of its joints, or times `otherwise` if n differs."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, Sequence) or isinstance(value, str):
        return value
    if any(isinstance(each, Sequence | np.ndarray) for each in value):
        return [_scale_joints(each, factors, otherwise) for each in value]
    stated = factors if len(factors) == len(value) else [otherwise] * len(value)
    return [_scale(each, factor) for each, factor in zip(value, stated, strict=True)]
