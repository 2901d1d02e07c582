"""Files to readings: the way through all of this package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Final, Literal, cast

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.importing import DecimalMark, FilePreview, ImportOptions, ImportPreview
from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument, Observation, Reading, Units
from jointstiff.schemas.measurement.noise import Noise
from jointstiff.service.importing.assembly import Assembly, Gathered, assemble
from jointstiff.service.importing.columns import spoken
from jointstiff.service.importing.errors import Faults, ImportFileError, Place
from jointstiff.service.importing.file_types import WORKBOOK, file_type
from jointstiff.service.importing.grid import Grid
from jointstiff.service.importing.header import Kind
from jointstiff.service.importing.layout import Layout, lay_out
from jointstiff.service.importing.limits import MAX_FILE_BYTES, MAX_FILES
from jointstiff.service.importing.names import labels_in_order, names_of
from jointstiff.service.importing.preview import preview_all, preview_file
from jointstiff.service.importing.records import RowReader, Surroundings, read_mark
from jointstiff.service.importing.text import read_text
from jointstiff.service.importing.workbook import read_workbook

_NO_OPTIONS: Final = ImportOptions()


@dataclass(frozen=True)
class SourceFile:
    """A file as it was sent."""

    name: str  # without a folder; it may say target and state
    content: bytes  # its bytes


@dataclass(frozen=True)
class Imported:
    """Content of the files, in their units."""

    preview: ImportPreview  # what was understood, for people
    assembly: Assembly  # the observations
    units: Mapping[str, str]  # by dimension, of all numbers that occur
    surroundings: Surroundings = field(default_factory=Surroundings)  # times and temperatures

    @property
    def complete(self) -> bool:
        """Return whether the files give all that only measuring can give."""
        return "joint" in self.assembly.observations[0].values and (
            bool(self.assembly.states) and not self.assembly.one_state
        )

    def document(
        self,
        name: str,
        encoders: Literal["motor", "secondary"],
        noise: Noise | None = None,
        flange_targets: Mapping[str, Vector3] | None = None,
        load_point: Vector3 | None = None,
        force: Vector3 | None = None,
        force_unit: str | None = None,
    ) -> MeasurementSetDocument:
        """The measurement set, with what no file tells.

        Args:
            name: of the set.
            encoders: which of them close the position loop.
            noise: of a reading, in the files' unit of length.
            flange_targets: places of targets in the flange frame, in the files' unit of length.
            load_point: where the force acts, flange frame, in the files' unit of length.
            force: on the robot in every observation, unless columns have it.
            force_unit: of that force.

        Raises:
            ImportFileError: joint angles, forces or readings are missing.
        """
        stated = "force" in self.assembly.observations[0].values
        if not self.complete or not (stated or (force is not None and force_unit is not None)):
            raise ImportFileError(
                Place(),
                "the files do not make a complete measurement set",
                f"add {'; '.join(self.preview.missing)}",
            )
        return MeasurementSetDocument(
            name=name,
            units=Units.model_validate({"force": force_unit, **self.units}),
            encoders=encoders,
            noise=noise,
            flange_targets=dict(flange_targets or {}),
            load_point=load_point,
            measured_at=self.surroundings.measured_at,
            conditions=self.surroundings.conditions,
            observations=[_observation(one, force) for one in self.assembly.observations],
        )


@dataclass(frozen=True)
class Understood:
    """Content of files as far as it was understood."""

    preview: ImportPreview  # as far as they were understood
    faults: tuple[ImportFileError, ...]  # what was not; at most `MAX_FAULTS`
    imported: Imported | None  # their content, if there are no faults


def understand_files(files: Sequence[SourceFile], options: ImportOptions = _NO_OPTIONS) -> Understood:
    """Understand files of readings: tables of a campaign, lists of points, or both, matched by label.

    Args:
        files: text or Excel, in any order.
        options: what they do not say themselves.

    Returns:
        What was understood, and what is not understood, contradictory or ambiguous, each with its place.
    """
    faults = Faults()
    reader = _Reader(options, faults)
    assembly = None
    with faults.collected():
        _check_sizes(files)
        assembly = reader.read(files)
    previews, units = reader.previews, reader.units
    preview = preview_all(previews, assembly)
    imported = None if assembly is None else Imported(preview, assembly, units, reader.surroundings)
    return Understood(preview, tuple(faults.found), imported)


class _Reader:
    """All files of an import, one after the other."""

    def __init__(self, options: ImportOptions, faults: Faults) -> None:
        self._options, self._faults = options, faults
        self._frames: dict[str, str] = {}
        self.previews: list[FilePreview] = []  # of the files whose rows were found
        self.units: dict[str, str] = {}  # by dimension, of all numbers that occur
        self.surroundings = Surroundings()

    def read(self, files: Sequence[SourceFile]) -> Assembly | None:
        """Read all files; None if there are faults."""
        tables = []
        for file in files:
            with self._faults.collected():
                grid = _grid(file, self._options)
                tables.append((grid, lay_out(grid, self._options, self._faults)))
        marks = [self._understood(*table) for table in tables]
        sound = all(not layout.columns.faulty for _, layout in tables) and len(tables) == len(files)
        labels = labels_in_order(tables, self._faults) if sound and self._options.by_order else []
        notes: list[str] = []
        readers = []
        for (grid, layout), mark in zip(tables, marks, strict=True):
            columns = layout.columns
            if mark is not None and not columns.faulty and (labels or "name" in columns.texts):
                with self._faults.collected():
                    names = names_of(grid, layout, self._options, notes)
                    readers.append(RowReader(grid, layout, mark, names, labels, self.surroundings))
        records = (record for reader in readers for record in reader.records(self._faults))
        if self.units.get("length") == "in":
            self.units["length"] = "mm"
        found = assemble(records, self._faults, allow_missing=self._options.allow_missing)
        return found and replace(found, assumptions=(*notes, *found.assumptions, *self.surroundings.notes))

    def _understood(self, grid: Grid, layout: Layout) -> DecimalMark | None:
        """Return the decimal mark of a file, if it is clear; add its preview, units and frame."""
        mark, notes = None, (*grid.assumptions, *layout.assumptions)
        with self._faults.collected():
            mark, assumed = read_mark(grid, layout, self._options)
            notes += (assumed,) if assumed else ()
        if "name" not in layout.columns.texts and self._options.by_order:
            notes += ("rows were matched to observations by their order, as `by_order` asks",)
        self.previews.append(preview_file(grid, layout, mark, notes))
        for dimension, unit in layout.columns.units.items():
            self._agree(grid, self.units, dimension, unit, f"the unit of {dimension}")
        if layout.frame is not None:
            self._agree(grid, self._frames, "frame", layout.frame, "the frame")
        return mark

    def _agree(self, grid: Grid, known: dict[str, str], key: str, value: str, what: str) -> None:
        if known.setdefault(key, value) != value:
            self._faults.report(
                Place(grid.file),
                f"{what} is {spoken(value)}, but {spoken(known[key])} in other files",
                "use one unit for every quantity, and one frame for all positions",
            )


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
    kind = file_type(file.content)
    if kind == WORKBOOK:
        return read_workbook(file.name, file.content, options.sheet)
    if kind is not None:
        raise ImportFileError(
            Place(file.name), f"the file is {kind}, not a table", "export the readings as CSV, text or .xlsx"
        )
    return read_text(file.name, file.content, options.delimiter)


def _observation(one: Gathered, force: Vector3 | None) -> Observation:
    def vector(kind: Kind) -> Vector3 | None:
        return cast(Vector3, one.values[kind][0]) if kind in one.values else None

    return Observation(
        label=one.label,
        joints=list(one.values["joint"][0]),
        force=cast(Vector3, vector("force") or force),
        moment=vector("moment"),
        load_point=vector("load point"),
        readings=[_reading(one, target) for target in one.points],
    )


def _reading(one: Gathered, target: str) -> Reading:
    """A reading; uncertainties of coordinates are covariances, of points one sigma for both states."""
    points = one.points[target]
    vectors = {
        state: cast(Vector3, point.vector) for state, point in points.items() if point.vector is not None
    }
    sigmas = {state: point.sigma for state, point in points.items() if point.sigma is not None}
    if not sigmas or all(point.by_point for point in points.values()):
        squares = [sigma[0] ** 2 for sigma in sigmas.values()]
        return Reading(target=target, sigma=sqrt(sum(squares) / len(squares)) if squares else None, **vectors)
    covariances = {
        f"{state}_covariance": [[sigma[i] ** 2 if i == j else 0.0 for j in range(3)] for i in range(3)]
        for state, sigma in sigmas.items()
    }
    return Reading.model_validate({"target": target, **vectors, **covariances})
