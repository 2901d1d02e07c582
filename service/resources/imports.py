"""Imports: files in, a preview and the measurement set that they make out. Nothing is stored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from pydantic import ValidationError

from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.service.importing import (
    Imported,
    ImportFileError,
    Place,
    SourceFile,
    missing_from,
    read_files,
)
from jointstiff.service.problems import FilesError, reworded


def import_files(files: Sequence[SourceFile], request: ImportRequest) -> ImportAnswer:
    """Understand files of readings, and make a measurement set of them if nothing is missing.

    Args:
        files: text or Excel, in any order.
        request: what they do not say themselves.

    Raises:
        FilesError: something in them is not understood, contradictory or ambiguous.
    """
    try:
        imported = read_files(files, request)
        missing = missing_from(
            imported.assembly, request.flange_targets, load_point=request.load_point is not None
        )
        if request.encoders is None:
            missing.append("the encoders that close the position loop (`encoders`): motor or secondary")
        document = None if missing else _document(imported, request, files[0].name)
    except ImportFileError as error:
        raise FilesError(error.reason, remedy=error.remedy, where=_where(error.place)) from error
    return ImportAnswer(preview=imported.preview, missing=missing, measurement_set=document)


def _document(imported: Imported, request: ImportRequest, first: str) -> MeasurementSetDocument:
    """The measurement set.

    Raises:
        FilesError: it would break a limit that the files do not have.
    """
    if request.encoders is None:
        raise ValueError("which encoders close the loop is not known")
    try:
        return imported.document(
            name=request.name or PurePath(first).stem.strip(),
            encoders=request.encoders,
            noise=request.noise,
            flange_targets=request.flange_targets,
            load_point=request.load_point,
        )
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        path = ".".join(map(str, fault["loc"]))
        raise FilesError(
            f"the readings do not make a valid measurement set: {path} {reworded(fault)}",
            remedy="check the limits of measurement sets",
        ) from error


def _where(place: Place) -> str:
    parts = [part for part in (place.file, place.line, place.column) if part is not None]
    return ":".join(map(str, parts)) or "files"
