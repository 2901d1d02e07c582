"""Files to readings: the way through all of this package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, cast

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.importing import FilePreview, ImportOptions, ImportPreview
from jointstiff.schemas.measurement import MeasurementSetDocument, Noise, Observation, Reading, Units
from jointstiff.service.importing.assembly import Assembly, Gathered, assemble
from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.file_types import file_type
from jointstiff.service.importing.grid import Grid
from jointstiff.service.importing.header import Kind
from jointstiff.service.importing.layout import lay_out
from jointstiff.service.importing.limits import MAX_FILE_BYTES, MAX_FILES
from jointstiff.service.importing.preview import preview_all, preview_file
from jointstiff.service.importing.records import Record, read_mark, read_records
from jointstiff.service.importing.text import read_text
from jointstiff.service.importing.units import Dimension
from jointstiff.service.importing.workbook import XLSX_MAGIC, read_workbook

_NO_OPTIONS: Final = ImportOptions()


@dataclass(frozen=True)
class SourceFile:
    """A file as it was sent.

    Attributes:
        name: without a folder; it may say target and state.
        content: its bytes.
    """

    name: str
    content: bytes


@dataclass(frozen=True)
class Imported:
    """Content of the files, in their units.

    Attributes:
        preview: what was understood, for people.
        assembly: the observations.
        units: by dimension, of all numbers that occur.
    """

    preview: ImportPreview
    assembly: Assembly
    units: Mapping[Dimension, str]

    @property
    def complete(self) -> bool:
        """Return whether the files give all that only measuring can give."""
        values = self.assembly.observations[0].values
        return (
            {"joint", "force"} <= set(values) and bool(self.assembly.states) and not self.assembly.one_state
        )

    def document(
        self,
        name: str,
        encoders: Literal["motor", "secondary"],
        noise: Noise | None = None,
        flange_targets: Mapping[str, Vector3] | None = None,
        load_point: Vector3 | None = None,
    ) -> MeasurementSetDocument:
        """The measurement set, with what no file tells.

        Args:
            name: of the set.
            encoders: which of them close the position loop.
            noise: of a reading, in the files' unit of length.
            flange_targets: places of targets in the flange frame, in the files' unit of length.
            load_point: where the force acts, flange frame, in the files' unit of length.

        Raises:
            ImportFileError: joint angles, forces or readings are missing.
        """
        if not self.complete:
            raise ImportFileError(
                Place(),
                "the files do not make a complete measurement set",
                f"add {'; '.join(self.preview.missing)}",
            )
        return MeasurementSetDocument(
            name=name,
            units=Units.model_validate(dict(self.units)),
            encoders=encoders,
            noise=noise,
            flange_targets=dict(flange_targets or {}),
            load_point=load_point,
            observations=[_observation(one) for one in self.assembly.observations],
        )


def read_files(files: Sequence[SourceFile], options: ImportOptions = _NO_OPTIONS) -> Imported:
    """Understand files of readings: tables of a campaign, lists of points, or both, matched by label.

    Args:
        files: text or Excel, in any order.
        options: what they do not say themselves.

    Raises:
        ImportFileError: something is not understood, contradictory, missing or ambiguous: with file, line,
            column and remedy.
    """
    _check_sizes(files)
    previews: list[FilePreview] = []
    units: dict[Dimension, str] = {}
    records = (record for file in files for record in _records(file, options, previews, units))
    assembly = assemble(records, allow_missing=options.allow_missing)
    return Imported(preview_all(previews, assembly), assembly, units)


def _records(
    file: SourceFile, options: ImportOptions, previews: list[FilePreview], units: dict[Dimension, str]
) -> Iterator[Record]:
    """Yield the records of a file; add its preview and its units to those of the files before it."""
    grid = _grid(file, options)
    layout = lay_out(grid, options)
    mark, assumed = read_mark(grid, layout, options)
    for dimension, unit in layout.columns.units.items():
        if units.setdefault(dimension, unit) != unit:
            raise ImportFileError(
                Place(file.name),
                f"the unit of {dimension} is {unit}, but {units[dimension]} in other files",
                f"use one unit for every {dimension}",
            )
    notes = (*grid.assumptions, *layout.assumptions, *((assumed,) if assumed else ()))
    previews.append(preview_file(grid, layout, mark, notes))
    yield from read_records(grid, layout, mark, options)


def _check_sizes(files: Sequence[SourceFile]) -> None:
    if not 0 < len(files) <= MAX_FILES:
        raise ImportFileError(Place(), f"{len(files)} files", f"send 1 to {MAX_FILES} files")
    names: set[str] = set()
    total = 0
    for file in files:
        if file.name in names:
            raise ImportFileError(Place(file.name), "two files have this name", "send each file once")
        names.add(file.name)
        total += len(file.content)
        if total > MAX_FILE_BYTES:
            limit = f"the files exceed {MAX_FILE_BYTES // 1024**2} MiB together"
            raise ImportFileError(Place(file.name), limit, "import fewer files at once")
        if not file.content.strip():
            raise ImportFileError(Place(file.name), "the file is empty", "check the export")


def _grid(file: SourceFile, options: ImportOptions) -> Grid:
    if file.content.startswith(XLSX_MAGIC):
        return read_workbook(file.name, file.content, options.sheet)
    kind = file_type(file.content)
    if kind is not None:
        raise ImportFileError(
            Place(file.name), f"the file is {kind}, not a table", "export the readings as CSV, text or .xlsx"
        )
    return read_text(file.name, file.content, options.delimiter)


def _observation(one: Gathered) -> Observation:
    def vector(kind: Kind) -> Vector3 | None:
        return cast(Vector3, one.values[kind][0]) if kind in one.values else None

    return Observation(
        label=one.label,
        joints=list(one.values["joint"][0]),
        force=cast(Vector3, vector("force")),
        moment=vector("moment"),
        load_point=vector("load point"),
        readings=[_reading(one, target) for target in one.points],
    )


def _reading(one: Gathered, target: str) -> Reading:
    vectors = {
        state: cast(Vector3, point.vector)
        for state, point in one.points[target].items()
        if point.vector is not None
    }
    return Reading(target=target, **vectors)
