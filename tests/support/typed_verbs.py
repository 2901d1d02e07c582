"""The typed verbs of `import jointstiff` and `Client`, made of the messages of the kinds.

    python tests/support/typed_verbs.py --write

writes `service/library/typed.pyi`, which only editors and type checkers read; a test compares it.
"""

import subprocess
import sys
from datetime import datetime
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from typing_extensions import TypeAliasType

from jointstiff.schemas.deflection import DeflectionOptions
from jointstiff.schemas.fields import Message
from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import ROOMS, kind_of

FILE = Path(__file__).parents[2] / "service" / "library" / "typed.pyi"
SOURCES = {
    "measurement_set": "campaign: Source, /",
    "run": "run: Source, /",
    "campaigns": "first: Source, second: Source | None = None, /",
    "sets": "*campaigns: Source",
    "robot_or_set": "source: Source | RobotDocument, /",
    "readings": "readings: File | Mapping[str, Any] | Message | None = None, /",
    "files": "*files: File",
}
EXTRAS = {
    "IdentifyFields": {"leave_out": "Sequence[str]"},
    "CompensateFields": {"force": "Vector"},
    "PredictFields": {"at": "Vector", "moments": "Numbers"},
    "GeometryFields": {"robot": "File | RobotDocument | Mapping[str, Any]"},
}
"""Options beside the fields of the message, or with other types than these."""

HEAD = """# Verbs with the types of their options, for type checkers. tests/support/typed_verbs.py writes it.

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from datetime import datetime
from os import PathLike
from typing import Any, Literal, TypedDict, Unpack

import numpy.typing as npt

from jointstiff.schemas.fields import Message
{imports}
from jointstiff.service.library.campaigns import Campaign, Numbers
from jointstiff.service.library.cases import AnyPostures
from jointstiff.service.library.verbs import Cancel, OnProgress
from jointstiff.service.library.results import Prediction, TabledRun

File = str | PathLike[str]
Source = File | Mapping[str, Any] | messages.Campaign | messages.Run
Vector = Sequence[float] | npt.NDArray[Any]
Matrix = Sequence[Sequence[float]] | npt.NDArray[Any]
Cube = Sequence[Sequence[Sequence[float]]] | npt.NDArray[Any]
"""


class Types:
    """Types as source text; the messages among them are imported."""

    def __init__(self) -> None:
        self.imported: dict[str, set[str]] = {}

    def name(self, message: type) -> str:
        self.imported.setdefault(message.__module__, set()).add(message.__name__)
        return message.__name__

    def text(self, annotation: Any) -> str:  # noqa: C901 - one case a line
        origin, parts = get_origin(annotation), get_args(annotation)
        if isinstance(annotation, TypeAliasType):
            return self.text(annotation.__value__)
        if origin is Annotated:
            return self.text(parts[0])
        if origin in {Union, UnionType}:
            texts = [text for part in parts for text in self.text(part).split(" | ")]
            return " | ".join(dict.fromkeys(texts))
        if origin is Literal:
            return f"Literal[{', '.join(repr(part).replace(chr(39), chr(34)) for part in parts)}]"
        if origin in {list, tuple}:
            inner = {self.text(part) for part in parts if part is not Ellipsis}
            one = inner.pop() if len(inner) == 1 else "Any"
            rows = {"float": "Vector", "Vector": "Matrix", "Matrix": "Cube"}
            return rows.get(one, f"Sequence[{one}]")
        if origin is dict:
            return f"Mapping[str, {self.text(parts[1])}]"
        if annotation in {float, int, bool, str, datetime}:
            return annotation.__name__
        if annotation is NoneType:
            return "None"
        if isinstance(annotation, type) and issubclass(annotation, Message):
            return f"{self.name(annotation)} | Mapping[str, Any]"
        return "Any"

    def options(self, name: str, message: type[Message], omitted: frozenset[str] = frozenset()) -> str:
        fields = {
            key: self.text(field.annotation)
            for key, field in message.model_fields.items()
            if key not in omitted
        }
        if "units" in fields:
            fields["units"] = f"str | {fields['units']}"
        if "goal" in fields:
            fields["goal"] = f"str | {fields['goal']}"
        if "loads" in fields:
            fields["loads"] = "File | None"
        lines = [f"    {key}: {text}" for key, text in (fields | EXTRAS.get(name, {})).items()]
        return f"class {name}(TypedDict, total=False):\n" + "\n".join(lines) + "\n"


def method(types: Types, kind: AnyKind, awaited: str) -> str:
    verb = ROOMS[kind.name].command
    options, result = types.name(kind.options), kind.message.__name__
    result = "TabledRun" if result == "Run" else types.name(kind.message)
    positional = ", ".join(SOURCES[source] for source in kind.sources)
    if not {"files", "sets"} & set(kind.sources):
        positional += f", options: {options} | None = None, *"
        stated = ""
    else:
        stated = f"options: {options} | None = None, "
    width = "" if awaited else "executor: Executor | None = None, "
    return (
        f"    {awaited}def {verb}(self, {positional}, {stated}on_progress: OnProgress | None = None, "
        f"cancel: Cancel | None = None, {width}**fields: Unpack[{verb.title()}Fields]) -> {result}: ...\n"
    )


def source_text() -> str:
    types, kinds = Types(), [kind_of(name) for name in ROOMS]
    types.imported["jointstiff.schemas.robot"] = {"RobotDocument"}
    document = "File | RobotDocument | Mapping[str, Any]"
    classes = [types.options(f"{ROOMS[kind.name].command.title()}Fields", kind.options) for kind in kinds]
    classes.append(types.options("PredictFields", DeflectionOptions, frozenset({"cases"})))
    classes.append(types.options("ImportFields", ImportRequest))
    for name, awaited in (("Verbs", ""), ("AsyncVerbs", "async ")):
        methods = [method(types, kind, awaited) for kind in kinds]
        methods += [
            f"    {awaited}def predict(self, run: Source, postures: AnyPostures, /, "
            "forces: Numbers | None = None, **options: Unpack[PredictFields]) -> Prediction: ...\n",
            f"    {awaited}def import_files(self, *files: File, robot: {document} "
            f"| None = None, **options: Unpack[ImportFields]) -> {types.name(ImportAnswer)}: ...\n",
        ]
        classes.append(f"class {name}:\n" + "\n".join(methods))
    imports = [
        f"from {module} import {', '.join(sorted(names))}" for module, names in sorted(types.imported.items())
    ]
    imports.insert(0, "from jointstiff.schemas import run as messages")
    return HEAD.format(imports="\n".join(imports)) + "\n\n" + "\n\n".join(classes)


def formatted() -> str:
    """Return the text as it stands in the repository."""
    text, root = source_text(), FILE.parents[2]
    for arguments in (["check", "--select", "I,F401", "--fix", "-q"], ["format"]):
        command = [str(Path(sys.prefix, "bin", "ruff")), *arguments, "--stdin-filename", str(FILE), "-"]
        text = subprocess.run(
            command, input=text, capture_output=True, text=True, check=True, cwd=root
        ).stdout
    return text


if __name__ == "__main__" and "--write" in sys.argv:
    FILE.write_text(formatted(), encoding="utf-8")
