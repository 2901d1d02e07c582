"""Read documents from files: campaigns, robots and requests.

If a file is a document of another known kind, the error names the kind.
"""

from __future__ import annotations

import json
import shlex
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ConfigDict

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.parsing import (
    MAX_SET_BYTES,
    NOT_JSON,
    USE_ARRAYS,
    MalformedError,
    parse,
)
from jointstiff.service.problems import (
    CampaignError,
    ContentError,
    as_campaign_error,
    http_problem,
    is_content,
    naming_missing_file,
    problem_from_error,
    problem_from_faults,
)
from jointstiff.solver.errors import RequestError, RobotError

Document = TypeVar("Document", bound=BaseModel)
AnyCampaign = Campaign | Mapping[str, Any] | str | PathLike[str]
"""A campaign as a message, as a document (mapping), or as the name of a file."""


def read_campaign(campaign: AnyCampaign) -> Campaign:
    """Return a campaign, read from a file or from a mapping; a message is returned unchanged.

    The file may also be a saved run, which contains its campaign.

    Raises:
        CampaignError: this is no campaign, or the file is too large.
        OSError: the file cannot be read.
    """
    if isinstance(campaign, Campaign):
        return campaign
    if isinstance(campaign, Mapping):
        return parse_document(campaign, Campaign)
    if not isinstance(campaign, str | PathLike):
        reason = f"a campaign is a file, a document, a `Campaign` or a run, not `{type(campaign).__name__}`"
        remedy = "make a campaign of arrays by `jointstiff.Campaign.from_arrays`"
        if isinstance(campaign, list | tuple) and campaign and not any(map(_is_numeric, campaign)):
            remedy = "give each campaign as an argument of its own, such as compare(first, second)"
        if isinstance(campaign, BaseModel):  # a result of another function
            remedy = "give the campaign itself, or the run that `identify` makes of it"
        raise CampaignError(http_problem(422, reason, remedy))
    if is_content(str(campaign)):
        raise ContentError(str(campaign))
    path = Path(campaign)
    if not path.exists() and (problem := explain_arm(str(campaign))):
        raise CampaignError(problem)
    return read_document(path, Campaign, section="campaign")


def explain_arm(text: str) -> Problem | None:
    """Return a problem that says what an arm of the catalogue needs where readings are expected.

    None if `text` is no name of one arm, such as the name of a missing file.
    """
    from jointstiff.service.conversion.catalogue import find_arm

    if Path(text).suffix in _ENDINGS_OF_DOCUMENTS:
        return None
    try:
        name = shlex.quote(find_arm(text, "robot").name)
    except RequestError:
        return None
    remedy = (
        f"give a campaign of readings, which `jointstiff import READINGS --robot {name}` makes of tables; "
        "`jointstiff plan` lists what to measure"
    )
    return http_problem(422, f"'{text}' is an arm of the catalogue, which has no readings", remedy)


def _is_numeric(value: object) -> bool:
    """Return whether a value is a number, a list or an array."""
    return isinstance(value, int | float | list | tuple) or hasattr(value, "__array__")


def read_document(path: Path, message_class: type[Document], section: str | None = None) -> Document:
    """Read a JSON file and validate it as a message.

    Args:
        path: path of the file.
        message_class: class of the message.
        section: key of the message in a larger document, such as `robot` in a campaign; the file may also
            hold the message alone.

    Raises:
        CampaignError: the file is too large, or holds no such message.
        OSError: the file cannot be read.
    """
    return parse_content(read_content(path), message_class, path, section)


@naming_missing_file()
def read_content(path: Path) -> bytes:
    """Return the content of a file of at most `MAX_SET_BYTES`, without parsing it.

    Raises:
        CampaignError: the file is too large, or empty.
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:  # reads one byte more than allowed, as a pipe does not tell its size
        content = file.read(MAX_SET_BYTES + 1)
    if len(content) > MAX_SET_BYTES:
        limit = f"{MAX_SET_BYTES // 1024**2} MiB"
        raise CampaignError(http_problem(413, f"{path} exceeds {limit}", USE_ARRAYS))
    if not content.strip():
        raise CampaignError(http_problem(422, f"{path} is empty", "give a file that was saved completely"))
    return content


def parse_content(
    content: bytes, message_class: type[Document], path: Path | None = None, section: str | None = None
) -> Document:
    """Validate the content of a file as a message.

    Args:
        content: bytes of the file.
        message_class: class of the message.
        path: file named in the texts of errors; None if the content is not from a file.
        section: key under which a larger document has this message, such as `robot` in a campaign. Content
            that is the message alone is accepted as well. None if no larger document has the message.

    Raises:
        CampaignError: the content is no such message.
    """
    return _validate_content(message_class, content.removeprefix(BOM_UTF8), section, path)


def read_object(path: Path) -> dict[str, Any]:
    """Read a JSON file as a dictionary, without checking its fields.

    Raises:
        CampaignError: the file is too large, or holds no JSON object.
    """
    return read_document(path, _AnyObject).model_dump(mode="json")


class _AnyObject(BaseModel):
    """A JSON object with any fields."""

    model_config = ConfigDict(extra="allow")


def parse_document(document: Mapping[str, Any], message_class: type[Document]) -> Document:
    """Validate a document as a message; its values may be messages and arrays.

    Raises:
        CampaignError: the document is no such message, or holds values that JSON cannot represent.
    """
    return _validate_content(message_class, encode_document(document))


def encode_document(document: Mapping[str, Any]) -> bytes:
    """Return a document as JSON, encoded in UTF-8; its values may be messages and arrays.

    Raises:
        CampaignError: the document holds values that JSON cannot represent.
    """
    try:
        return to_json_text(document).encode()
    except (TypeError, ValueError) as error:
        remedy = "use only strings, numbers, lists, arrays and dictionaries"
        raise CampaignError(
            http_problem(422, f"the document cannot be written as JSON: {error}", remedy)
        ) from None


def to_json_text(document: object) -> str:
    """Return a document of plain values, messages and arrays as JSON text.

    Raises:
        TypeError: the document holds a value of another type.
        ValueError: a list or dictionary contains itself.
    """
    return json.dumps(document, default=_plain_value)


def _plain_value(value: Any) -> Any:  # noqa: ANN401 - anything in a document
    """Convert a message, mapping or array to plain values for `json.dumps`; raise TypeError otherwise."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, Mapping):
        return dict(value)
    array = value.to_numpy() if hasattr(value, "to_numpy") else value  # a column of a data frame
    if hasattr(array, "tolist"):
        return array.tolist()
    raise TypeError(f"{type(value).__name__} is neither a number, a text, a list nor an array")


def _validate_content(
    message_class: type[Document], content: bytes, section: str | None = None, path: Path | None = None
) -> Document:
    """Validate JSON as a message.

    Raises:
        CampaignError: the JSON is no such message. The error names the kind of the document if it is another
            known kind, else the faults.
    """
    try:
        return parse(message_class, content, section)
    except MalformedError as error:
        wrong_kind_problem = _explain_other_document(message_class, content, error, str(path or "the file"))
        problem = wrong_kind_problem or problem_from_faults(error.faults)
        if path is not None and wrong_kind_problem is None:
            named = {"title": f"{path} does not match the schema", "where": f"{path}: {problem.where}"}
            problem = problem.model_copy(update=named)
        raise CampaignError(problem) from None


def _explain_other_document(
    message_class: type[BaseModel], content: bytes, error: MalformedError, name: str
) -> Problem | None:
    """Return a problem that names the kind of a document that is not the expected message.

    Args:
        message_class: class of the expected message.
        content: bytes of the document.
        error: failure of the validation as the expected message.
        name: name of the file, for people.

    Returns:
        The problem; None if the document is of no other known kind.
    """
    if error.keys is NOT_JSON:
        return _explain_text(content, error, name)
    for keys, kind, remedy in _OTHER_DOCUMENTS:
        if keys <= error.keys and not keys <= set(message_class.model_fields):
            if remedy == _GIVE_CAMPAIGN and not issubclass(message_class, Campaign | RobotDocument):
                remedy = _GIVE_READINGS
            return http_problem(422, f"{name} is {kind}", remedy)
    return None


_ENDINGS_OF_DOCUMENTS: Final = frozenset((".json", ".csv", ".txt", ".xlsx"))
"""Endings of files, which no name of an arm has."""
_IMPORT_HINT: Final = "to read tables and point lists use `jointstiff import FILE`"


def _explain_text(content: bytes, error: MalformedError, name: str) -> Problem:
    """Return a problem that names what a text that is not JSON is: UTF-16, a URDF, a table, or broken JSON.

    Args:
        content: bytes of the text.
        error: failure of reading the text as JSON.
        name: name of the file, for people.
    """
    if content.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return http_problem(422, f"{name} is a text in UTF-16, not a JSON document", "save the file as UTF-8")
    message = str(error.faults[0]["msg"])
    first = content.lstrip()[:1]
    if first in (b"{", b"["):
        remedy = f"correct the JSON at this place; {_IMPORT_HINT}"
        return http_problem(422, f"{name}: {message}", remedy)
    if first == b"<" and b"<robot" in content:
        file = shlex.quote(name)
        remedy = (
            f"identify needs readings: `jointstiff plan {file}` plans them, and "
            f"`jointstiff import FILE --robot {file}` reads them"
        )
        return http_problem(422, f"{name} is a URDF, not a campaign", remedy)
    if any(sign.encode() in content for sign in _SIGNS_OF_TABLES):
        return http_problem(422, f"{name} is a table that jointstiff printed, not a document", _GIVE_CAMPAIGN)
    correction = f"to correct a robot program use `jointstiff correct CAMPAIGN {shlex.quote(name)}`"
    remedy = f"{_IMPORT_HINT}; {correction}"
    return http_problem(422, f"{name} is a text, not a JSON document", remedy)


_GIVE_CAMPAIGN: Final = (
    "give the campaign; `jointstiff identify FILE --save RUN` writes a run with its campaign"
)
_GIVE_READINGS: Final = (
    "give readings, not a result: `jointstiff examples FOLDER` writes examples of such files"
)
_SIGNS_OF_TABLES: Final = ("│", "┃", "━━")
"""Signs of tables that commands print at the terminal."""

_OTHER_DOCUMENTS: Final = (
    ({"motion"}, "logs of a motion", "use `jointstiff gearbox FILE`"),
    ({"observations", "load"}, "a weight step", "use `jointstiff gearbox FILE`"),
    (
        {"observations"},
        "a measurement set without a robot",
        'make a campaign of it: {"robot": …, "measurement_set": …}, or use `jointstiff import FILE --robot '
        "ROBOT`",
    ),
    (
        {"kind", "result", "provenance"},
        "a result without a campaign",
        _GIVE_CAMPAIGN,
    ),
    ({"sweeps"}, "a set of sweeps", "use `jointstiff geometry FILE`"),
    ({"robot", "measurement_set"}, "a campaign", "use `jointstiff identify FILE`"),
    (
        {"model", "name"},
        "a robot without readings",
        "measure the robot first: `jointstiff plan FILE` plans what to measure, and `jointstiff import "
        "READINGS --robot FILE` makes a campaign of the readings",
    ),
)
"""Kinds of documents: keys by which a document of the kind is recognised, its name, and the remedy."""


CALIBRATION_ENDINGS: Final = frozenset((".conf", ".yaml", ".yml"))
"""Endings of files with the calibration of a Universal Robots arm."""
URDF_ENDINGS: Final = frozenset((".urdf", ".xacro", ".xml"))
"""Endings of files with a URDF."""


@naming_missing_file()
def read_urdf_file(path: Path, base: str | None = None, flange: str | None = None) -> dict[str, Any]:
    """Return the fields of the robot in a file with a URDF, also of xacro, by the links `base` and `flange`.

    Raises:
        CampaignError: the file is not a URDF, or several links may be the base or the flange.
        OSError: the file cannot be read.
    """
    from jointstiff.service.conversion.urdf_links import convert_urdf

    with as_campaign_error("robot"):
        try:
            urdf = path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError:
            raise RobotError(
                f"{path.name} is not encoded in UTF-8", where="robot", remedy="save the file as UTF-8"
            ) from None
        # Owners of robots name files of xacro `.urdf`, too.
        if path.suffix.lower() == ".xacro" or "<xacro:" in urdf:
            from jointstiff.service.conversion.xacro import expand_xacro

            urdf = expand_xacro(path)
    with as_campaign_error("robot"):
        return {"name": path.stem.removesuffix(".urdf"), "model": convert_urdf(urdf, base, flange)}


def _read_calibration_file(path: Path) -> RobotDocument:
    """Return the robot in a file with the calibration of a Universal Robots arm.

    Raises:
        CampaignError: the file is no calibration, or its name does not name the arm.
    """
    from jointstiff.service.conversion.ur_calibration import convert_calibration

    with as_campaign_error("robot"):
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        return parse_document(convert_calibration(path.stem, text), RobotDocument)


def read_robot(text: str, where: str = "robot") -> RobotDocument:
    """Return the robot in a file, or else the catalogue's arm `text`.

    The file has a robot, a campaign, a URDF, or the calibration of a Universal Robots arm. The link behind
    `#`, as in `arm.urdf#tool0`, is the flange of a URDF. `where` is the argument or option that holds the
    text, for errors.

    Raises:
        CampaignError: the file contains no robot, or neither a file nor an arm has this name.
    """
    from jointstiff.service.conversion.catalogue import find_arm, nominal_robot

    if is_content(text):
        raise ContentError(text)
    file, mark, flange = text.rpartition("#")
    if mark and not Path(text).exists() and Path(file).suffix.lower() in URDF_ENDINGS:
        return parse_document(read_urdf_file(Path(file), flange=flange), RobotDocument)
    if Path(text).is_file() and Path(text).suffix.lower() in URDF_ENDINGS:
        return parse_document(read_urdf_file(Path(text)), RobotDocument)
    if Path(text).is_file() and Path(text).suffix.lower() in CALIBRATION_ENDINGS:
        return _read_calibration_file(Path(text))
    if Path(text).is_file():
        return read_document(Path(text), RobotDocument, section="robot")
    try:
        return nominal_robot(find_arm(text, where))
    except RequestError as error:
        problem = problem_from_error(error)
        detail = f"there is no file '{text}', and {problem.detail}"
        raise CampaignError(problem.model_copy(update={"detail": detail})) from error


def read_plan_source(source: Any) -> Any:  # noqa: ANN401 - robot, campaign or run
    """Return the robot, campaign or run for which a campaign is planned.

    A message is returned unchanged; documents and files are read as a robot or a campaign; any other text is
    the name of an arm in the catalogue.

    Raises:
        CampaignError: the file is too large, or has no robot or campaign; or no file or arm has this name.
    """
    if isinstance(source, Mapping):
        return parse_document(source, Campaign if "measurement_set" in source else RobotDocument)
    if not isinstance(source, str | PathLike):
        return source
    path = Path(source)
    is_robot = path.suffix.lower() in URDF_ENDINGS | CALIBRATION_ENDINGS
    if is_content(str(source)) or is_robot or not path.is_file():
        return read_robot(str(source))
    try:
        is_campaign = bool({"measurement_set", "campaign"} & json.loads(path.read_bytes()).keys())
    except (ValueError, AttributeError):
        is_campaign = True  # the file is no JSON object: reading it as a campaign raises the proper error
    return read_campaign(path) if is_campaign else read_document(path, RobotDocument)
