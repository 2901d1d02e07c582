"""Load cases of a prediction, from a CSV file, messages or arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict

from jointstiff.schemas.deflection import DeflectionOptions
from jointstiff.schemas.fields import Message
from jointstiff.schemas.joints import JointKind
from jointstiff.service.problems import naming_file, naming_missing_file
from jointstiff.service.resources.documents import parse_document
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from jointstiff.schemas.deflection import LinkMass
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.verb import Vector
    from jointstiff.service.library.campaigns import Numbers
    from jointstiff.solver.arrays import FloatArray

AnyPostures = Any
"""CSV file of postures and loads, load cases as in the API, or an array (N, n) of postures."""
_ROUND: Final = 1e-6
"""Greatest distance of ten times an angle from a whole number at which the angle has one decimal."""
_MAX_ANGLE: Final = 4 * pi
"""Greatest joint angle that is accepted, two turns [rad]; a greater one is probably in another unit."""


class PredictFields(TypedDict, total=False):
    """Options of `predict`."""

    absolute: bool
    masses: Sequence[LinkMass | Mapping[str, Any]]
    confidence: float
    units: AnyUnits
    load_point: Vector | None
    place: Vector | None
    at: Vector
    moments: Numbers


@naming_missing_file()
def make_load_cases(
    postures: AnyPostures,
    joints: Mapping[str, JointKind],
    forces: Numbers | None,
    options: Mapping[str, Any],
) -> DeflectionOptions:
    """Return the load cases and options of a prediction, as the API takes them, without the id of a run.

    Args:
        postures: CSV file, cases, or array (N, n).
        joints: kinds of the robot's n joints (revolute or prismatic) by name, in order.
        forces: (N, 3), or (3,) for all postures; only with an array of postures.
        options: fields of `DeflectionOptions`, in mm, deg and N unless `units` states others; also `at`,
            which sets both load point and place; with arrays also `moments`.

    Raises:
        RequestError: the table is not understood, or an angle is in another unit.
        MeasurementError: an array has a wrong shape.
        CampaignError: the cases or the options cannot be used.
    """
    from jointstiff.service.conversion.units import complete_units
    from jointstiff.service.runs.deflection import read_load_cases

    fields = dict(options)
    at = fields.pop("at", None)
    if at is not None:
        point = _read_point(at)
        fields = {"load_point": point, "place": point} | fields
    states_units = fields.get("units") is not None
    fields["units"] = units = complete_units(fields.get("units"))
    if isinstance(postures, str | PathLike):
        text = Path(postures).read_text(encoding="utf-8-sig", errors="replace")
        with naming_file(Path(postures)):
            return read_load_cases(text, joints, **_convert_points(fields))
    if forces is None and isinstance(postures, Sequence) and isinstance(postures[0], Mapping | Message):
        cases = list(postures)
    else:
        cases = _cases_from_arrays(postures, forces, fields.pop("moments", None), joints, units)
    request = parse_document({**fields, "cases": cases}, DeflectionOptions)
    if not states_units:
        _refuse_doubtful_angles([case.joints for case in request.cases], joints)
    return request


def _cases_from_arrays(
    postures: AnyPostures,
    forces: object,
    moments: object,
    joints: Mapping[str, JointKind],
    units: Mapping[str, str],
) -> list[dict[str, Any]]:
    """Return a load case, as a dictionary for JSON, for each row of an array of postures (N, n).

    Forces and moments are (N, 3), or (3,) for all postures; moments may be None. `units` has the unit of each
    quantity by name.

    Raises:
        RequestError: forces are missing, or an angle exceeds two turns.
        MeasurementError: an array has a wrong shape, or columns with names.
    """
    from jointstiff.service.conversion.arrays import to_number_array, to_vectors

    q = to_number_array(postures, "postures")
    q = q.reshape(1, -1) if q.ndim == 1 else q
    if forces is None:
        remedy = (
            "give joints and forces as two arrays, `forces` (N, 3) or (3,): predict(run, q, "
            "forces=(0, 0, -500), at=(0, 0, 120))"
        )
        raise RequestError(
            "`forces` are missing: without a load, the arm does not deflect",
            where="forces",
            remedy=remedy,
        )
    _refuse_large_angles(q, joints, units)
    columns = {"joints": q.tolist(), "force": to_vectors(forces, len(q), "forces").tolist()}
    if moments is not None:
        columns["moment"] = to_vectors(moments, len(q), "moments").tolist()
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _refuse_large_angles(q: FloatArray, joints: Mapping[str, JointKind], units: Mapping[str, str]) -> None:
    """Refuse postures (N, n) with an angle beyond two turns, because its unit is probably another one.

    Raises:
        RequestError: the greatest angle exceeds two turns.
    """
    from jointstiff.service.conversion.units import ANGLE

    revolute = [j for j, kind in enumerate(joints.values()) if kind == "revolute" and j < q.shape[1]]
    greatest_angle = ANGLE[units["angle"]] * max(map(abs, q[:, revolute].ravel().tolist()), default=0.0)
    if greatest_angle > _MAX_ANGLE:
        raise RequestError(
            f"a joint angle of {greatest_angle:.4g} rad exceeds two turns",
            where="postures",
            remedy="state the unit of the angles, such as units='mm, rad, N'",
        )


def _refuse_doubtful_angles(postures: Sequence[Sequence[float]], joints: Mapping[str, JointKind]) -> None:
    """Refuse angles without a stated unit that are all within ±π, because they may be radians.

    Tenths of degrees are accepted: such an arm is near its zero.

    Raises:
        RequestError: the angles may be radians.
    """
    revolute = [j for j, kind in enumerate(joints.values()) if kind == "revolute"]
    angles = [posture[j] for posture in postures for j in revolute if j < len(posture)]
    greatest = max(map(abs, angles), default=0.0)
    are_round = all(abs(10.0 * angle - round(10.0 * angle)) < _ROUND for angle in angles)
    if greatest <= pi and not are_round:
        raise RequestError(
            f"all joint angles are within ±{greatest:.3g}: without a stated unit they would be degrees, but "
            "they seem to be radians",
            where="postures",
            remedy="state the unit of the angles: units='mm, rad, N', or, if they are degrees, "
            "units='mm, deg, N'",
        )


def _read_point(at: object) -> list[float]:
    """Return the argument `at` as the coordinates of a point.

    Raises:
        RequestError: the argument is not three numbers.
    """
    from jointstiff.service.conversion.arrays import read_numbers

    remedy = "give three coordinates in the flange frame, such as at=(0, 0, 100)"
    numbers = read_numbers(at, "at")
    if numbers.shape != (3,):
        raise RequestError(f"`at` has the shape {numbers.shape}", where="at", remedy=remedy)
    return [float(number) for number in numbers]


def _convert_points(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return options whose points, of any array type, are converted to tuples of floats."""
    return {
        name: tuple(map(float, value)) if name in {"load_point", "place"} and value is not None else value
        for name, value in fields.items()
    }
