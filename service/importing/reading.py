"""Reading of files into observations, whose values are merged by label from all files.

A value that occurs twice, contradicts another value or cannot be used is reported as a fault.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, dist, sqrt
from os import PathLike
from pathlib import Path
from statistics import fmean, median, pstdev
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

from pydantic_core import from_json

from jointstiff.schemas.gearbox import StepReadings
from jointstiff.schemas.imports import (
    MAX_PREVIEW_ROWS,
    Delimiter,
    FilePreview,
    ImportOptions,
    ImportPreview,
    State,
)
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import MAX_OBSERVATIONS, MAX_TARGETS
from jointstiff.schemas.robot import Body
from jointstiff.service.importing import grid
from jointstiff.service.importing.adjacent_tables import split_adjacent
from jointstiff.service.importing.arrays import build_grids_of_matrices, read_arrays
from jointstiff.service.importing.axis_rows import join_axis_rows
from jointstiff.service.importing.blocks import read_blocks
from jointstiff.service.importing.cell_units import separate_units
from jointstiff.service.importing.certificates import read_certificate
from jointstiff.service.importing.encoding import decode, describe_encoding
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, quote
from jointstiff.service.importing.excel import read_workbook, split_sheets
from jointstiff.service.importing.forms import join_forms
from jointstiff.service.importing.grammar import (
    POINTS,
    Kind,
    Quantity,
    Vocabulary,
    collapse_blanks,
    find_unit_of_readings,
    fits_header,
    name_unit,
    split_along_target,
)
from jointstiff.service.importing.grid import Grid, file_type, read_lists, read_text
from jointstiff.service.importing.header import Columns
from jointstiff.service.importing.json_rows import read_json_rows
from jointstiff.service.importing.layout import Layout, understand_table
from jointstiff.service.importing.masses import is_mass_table, read_mass_table
from jointstiff.service.importing.matrices import find_matrices
from jointstiff.service.importing.opendocument import read_spreadsheet
from jointstiff.service.importing.rows import (
    NameReader,
    ObservationRecord,
    RowReader,
    TimesAndRoundings,
    Value,
)
from jointstiff.service.importing.sheets import choose_sheets, list_tables, note_others
from jointstiff.service.importing.val3 import read_joint_data
from jointstiff.service.importing.weight_steps import is_step_table, read_step_table
from jointstiff.service.importing.yaml_rows import read_yaml_rows

_USE_FEWER: Final = (
    "leave out rows, such as repeated readings of a posture, or identify all rows in Python from arrays, "
    "with `jointstiff.solver.identify` (docs/python.md): the runs of its parts do not replace one run"
)
"""What to do with too many observations."""
_NO_OPTIONS: Final = ImportOptions()
_Uncertainty = Literal["coordinate", "point"]
_U95: Final[Mapping[_Uncertainty, str]] = MappingProxyType(
    {
        "coordinate": "U(95) X, Y, Z was read as the expanded uncertainty of each coordinate: σ = U/1.96",
        "point": (
            "U(95) was read as the expanded uncertainty of each point, that is the root of the sum of the "
            "squares for x, y and z: σ = U/(1.96 √3); the σ of a reading is the root mean square over its "
            "two positions"
        ),
    }
)
_MAX_SPREADS: Final = 100.0
"""Distance of a value from its column's median, in spreads, beyond which the user has to confirm it."""
_MIN_VALUES: Final = 5
"""Fewest values of a column for which a spread is computed."""
_MAX_REPEAT: Final = 1e-4
"""Greatest distance [m] of a repeated reading from the mean of all readings of the point."""
_MAX_LISTED_LABELS: Final = 3
"""Labels named in a message."""
_STATES: Final[tuple[State, ...]] = ("unloaded", "loaded", "unloaded_after", "deflection")
_SINGLE_STATES: Final[tuple[list[State], ...]] = (["unloaded"], ["loaded"])
"""Positions in one state only, without a deflection."""


@dataclass(frozen=True)
class SourceFile:
    """A file as it was sent."""

    name: str  # without a folder; the name may contain target and state
    content: bytes
    is_table: bool = False  # whether the import wrote it: no cell makes a program or a report of it


def read_sources(files: Iterable[str | PathLike[str]]) -> list[SourceFile]:
    """Read files into memory.

    Of large files only so much is read that the import refuses them as too large.

    Raises:
        OSError: a file cannot be read.
    """
    sources, bytes_left = [], grid.MAX_FILE_BYTES
    for path in map(Path, files):
        with path.open("rb") as file:
            content = file.read(bytes_left + 1)  # one byte more than is allowed
        bytes_left = max(0, bytes_left - len(content))
        sources.append(SourceFile(path.name, content))
    return sources


@dataclass(frozen=True)
class Understood:
    """Content of files as far as it was understood: either faults, or all observations."""

    preview: ImportPreview
    faults: tuple[ImportFileError, ...]  # what was not understood; at most `MAX_FAULTS`
    # in order of appearance, checked against each other, with complete readings only, unless a state is
    # absent from all of them; none if there are faults
    observations: tuple[ObservationRecord, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)  # units by dimension, of all numbers that occur
    # times of the readings, and the count of uncertainties that were rounded to 0
    times_and_roundings: TimesAndRoundings = field(default_factory=TimesAndRoundings)
    bodies: tuple[Body, ...] = ()  # from tables of masses; joints as they are named or numbered there
    unusual: tuple[str, ...] = ()  # values to be confirmed, such as those far from all others of their column
    weight_step: StepReadings | None = None  # readings of two encoders, in place of observations
    skipped: tuple[str, ...] = ()  # sentences on incomplete readings that are left out
    are_columns_named: bool = False  # whether headers alone explain all tables: faults are those of cells

    @property
    def places(self) -> dict[str, str]:
        """Target → name of its place in the flange frame, for targets that were read as a deflection.

        A gauge's target names the place and the axis; other targets are places themselves.
        """
        read = (quantity for observation in self.observations for quantity in observation.values)
        return {
            target or "": split_along_target(target or "")[0] if kind == "along" else target or ""
            for kind, target, state in read
            if state == "deflection"
        }


def understand_files(
    files: Sequence[SourceFile], options: ImportOptions = _NO_OPTIONS, joints: Sequence[str] = ()
) -> Understood:
    """Read files of a campaign: tables, lists of points, or both, matched by label.

    `joints` are the names of the robot's joints, which columns may have; empty without a robot.

    Returns:
        The observations and a preview, or the faults: places that are not understood, contradictory or
        ambiguous.
    """
    faults = Faults()
    reader = _Reader(options, faults, joints)
    with faults.collect():
        _check_files(files)
        return reader.read(files)
    # `collect` has kept an error that ended the block: the answer has the faults.
    return reader.build_answer()


def _check_files(files: Sequence[SourceFile]) -> None:
    """Refuse too many or too large files, and two files with the same name or the same content.

    Raises:
        ImportFileError: a limit is exceeded, or a file occurs twice.
    """
    if not 0 < len(files) <= grid.MAX_FILES:
        raise ImportFileError(NOWHERE, f"{len(files)} files were sent", f"send 1 to {grid.MAX_FILES} files")
    names: set[str] = set()
    byte_count = line_count = 0  # of all files so far
    for file in files:
        if file.name in names:
            raise ImportFileError(Place(file.name), "two files have this name", "send each file once")
        names.add(file.name)
        byte_count += len(file.content)
        _refuse_many_bytes(byte_count, file.name)
        line_count += _count_lines(file.content)
        _refuse_many_lines(line_count, file.name)
    if (copy := find_copy(files)) is not None:
        reason = f"the file is equal to {quote(copy.original)}, byte by byte"
        remedy = "send one of the two; if the second should have other readings, export these again"
        raise ImportFileError(Place(copy.name), reason, remedy)


class CopiedFile(NamedTuple):
    """Names of two files with the same content."""

    name: str
    original: str  # the first of both


def find_copy(files: Sequence[SourceFile]) -> CopiedFile | None:
    """Return the first file that is equal to an earlier file, such as a second download; None without one."""
    name_of_content: dict[bytes, str] = {}
    for file in files:
        original = name_of_content.setdefault(file.content, file.name)
        if original != file.name:
            return CopiedFile(file.name, original)
    return None


def _refuse_many_bytes(count: int, file: str) -> None:
    """Raise an `ImportFileError` if the files up to the one with the name `file` have too many bytes."""
    if count > grid.MAX_FILE_BYTES:
        limit = f"the files exceed {grid.MAX_FILE_BYTES // 1024**2} MiB together"
        raise ImportFileError(Place(file), limit, "import fewer files at once")


def _refuse_many_lines(count: int, file: str) -> None:
    """Raise an `ImportFileError` if the files up to the one with the name `file` have too many lines."""
    if count > grid.MAX_LINES:
        limit = (
            f"the files have more than {grid.MAX_LINES} lines together, including empty lines and comments"
        )
        remedy = "remove empty lines and comments, or import fewer files at once"
        raise ImportFileError(Place(file), limit, remedy)


def _count_lines(content: bytes) -> int:
    """Return the number of line ends in UTF-8 or UTF-16; a workbook contains few of these bytes by chance.

    A carriage return and a line feed together end one line.
    """
    single_ends = content.count(b"\n") + content.count(b"\r")
    double_ends = content.count(b"\r\n") + content.count(b"\r\0\n")
    return single_ends - double_ends


def _describe_weight_step(step: StepReadings) -> dict[str, object]:
    """Return field → value of the preview for the readings of a weight step."""
    labels = [posture.label for posture in step.observations]
    return {
        "observation_count": len(labels),
        "first_labels": labels[:MAX_PREVIEW_ROWS],
        "joint_count": len(step.observations[0].joints),
        "states": ["unloaded", "loaded"],
        "reading_count": sum(len(posture.encoder_readings) for posture in step.observations),
    }


def _names_targets(layout: Layout) -> bool:
    """Return whether headers or a column of a table name targets."""
    return "target" in layout.columns.texts or any(each.target for each in layout.columns.quantities)


class _Reader:
    """Reader of all files of an import, one after the other."""

    def __init__(self, options: ImportOptions, faults: Faults, joints: Sequence[str]) -> None:
        self._options, self._faults, self._joints = options, faults, joints
        self._layouts: list[Layout] = []  # of the files whose rows were found
        self._previews: list[FilePreview] = []  # of all files that were read, in their order
        self._bodies: list[Body] = []
        self._steps: list[StepReadings | None] = []  # of tables of a weight step; None for one with faults
        self._notes: list[str] = []
        self._units: dict[str, str] = {}
        self._are_columns_named = False
        self._times_and_roundings = TimesAndRoundings()

    def read(self, files: Sequence[SourceFile]) -> Understood:
        """Read all files; return their observations, or their faults.

        Raises:
            ImportFileError: the files cannot be used together, such as masses without readings.
        """
        for file in files:
            with self._faults.collect():
                for table in read_grids(file, self._options):
                    self._read_table(table)
        if self._steps:
            return self._conclude_weight_step()
        all_were_read = {preview.file for preview in self._previews} == {file.name for file in files}
        columns = [layout.columns for layout in self._layouts]
        have_positions = any(quantity.kind == "position" for each in columns for quantity in each.quantities)
        are_named = all_were_read and have_positions and all(each.are_all_named for each in columns)
        self._are_columns_named = are_named
        if all_were_read and not any(each.faulty for each in columns):
            self._refuse_masses_alone()
            self._check_options()
        observations = self._read_observations()
        return self.build_answer() if self._faults.found else self._check_and_assemble(observations)

    def _refuse_masses_alone(self) -> None:
        """Raise an `ImportFileError` if all files were read, and each is a table of masses."""
        if not self._layouts:
            remedy = "import the masses together with the readings of the robot"
            raise ImportFileError(NOWHERE, "the files contain masses, but no readings", remedy)

    def _read_observations(self) -> list[ObservationRecord]:
        """Read the rows of all tables; return one observation for each label.

        Rows of a table with an unclear header or decimal mark are not read, because their fault is reported.

        Raises:
            ImportFileError: there are too many observations.
        """
        readers = list[RowReader]()
        for layout in self._layouts:
            is_clear = layout.decimal_mark is not None and not layout.columns.faulty
            if is_clear:
                with self._faults.collect():
                    readers.append(self._build_row_reader(layout))
        records = (record for reader in readers for record in reader.read_records(self._faults))
        merger = _Merging(self._options, self._units, self._joint_kinds(), self._faults, self._notes)
        return merger.merge_by_label(records)

    def _build_row_reader(self, layout: Layout) -> RowReader:
        """Return the reader of the rows of a table, which names rows by columns, file and options.

        Raises:
            ImportFileError: the names of sheet and file contradict each other, or a template is invalid.
        """
        without_target = [each for each in self._layouts if "target" in each.columns.needed]
        is_only = len(without_target) == 1 and not any(map(_names_targets, self._layouts))
        names = NameReader(layout, self._options, self._notes, has_one_target=is_only)
        allow_missing = self._options.allow_missing
        return RowReader(layout, names, self._times_and_roundings, allow_missing=allow_missing)

    def _conclude_weight_step(self) -> Understood:
        """Return the readings of the one table of a weight step.

        Raises:
            ImportFileError: there are further tables.
        """
        if len(self._previews) > 1:
            remedy = "import the table of the weight step alone"
            raise ImportFileError(NOWHERE, "a weight step was sent with further tables", remedy)
        understood, step = self.build_answer(), self._steps[0]
        if self._faults.found or step is None:
            return understood
        preview = understood.preview.model_copy(update=_describe_weight_step(step))
        return replace(understood, preview=preview, weight_step=step)

    def _read_table(self, table: Grid) -> None:
        """Read and store a weight step, the bodies of a table of masses, or the header of any other table."""
        if is_step_table(table):
            step, preview = read_step_table(table, self._options, self._faults, self._joints)
            self._steps.append(step)
            self._previews.append(preview)
            return
        if is_mass_table(table):
            bodies, preview = read_mass_table(table, self._options, self._faults)
            self._bodies += bodies
            self._previews.append(preview)
            return
        self._layouts.append(understand_table(table, self._options, self._faults, self._joints))
        self._previews.append(self._layouts[-1].preview)
        self._compare_with_others(self._layouts[-1])

    def _check_and_assemble(self, observations: list[ObservationRecord]) -> Understood:
        """Check the observations of all files against each other; return them with the final preview.

        If there are faults, the result has only the faults and the previews of the files.
        """
        quantities = (quantity for observation in observations for quantity in observation.values)
        if any(quantity.state == "deflection" for quantity in quantities):
            from jointstiff.service.importing.differences import omit_differences  # imports numpy

            observations, notes = omit_differences(observations)
            self._notes += notes
        skipped = list[str]()
        if self._options.allow_missing:
            observations, skipped = _skip_incomplete_observations(observations)
        targets = _list_targets(observations)
        _check_same_quantities(observations, self._faults)
        states = _list_present_states(observations)
        # Positions in one state only show no deflection, so that their readings cannot be complete.
        has_readings = states not in _SINGLE_STATES
        if targets and has_readings:
            observations, notes_on_gaps = _drop_and_report_incomplete_readings(
                observations, targets, self._faults, self._options
            )
            skipped += notes_on_gaps
        else:
            skipped += _report_skipped_points(observations)
        self._notes += skipped
        counts = _check_sigmas(observations, self._faults)
        self._notes += _describe_uncertainties(counts)
        if self._faults.found:
            return self.build_answer()
        self._notes += [*self._times_and_roundings.notes, *_describe_held_out(observations)]
        summary = {
            "targets": targets,
            "states": states,
            "reading_count": sum(len(each.points) for each in observations) if has_readings else 0,
            "uncertainty": next(iter(counts), None),
        }
        return replace(self._assemble(observations, summary), skipped=tuple(skipped))

    def _assemble(
        self, observations: Sequence[ObservationRecord], summary: Mapping[str, object]
    ) -> Understood:
        """Return observations without faults, with the final preview of all files.

        `summary` is field → value of the preview for targets, states, readings and their uncertainty.
        """
        joints = observations[0].vector("joint") if observations else None
        update = {
            **summary,
            "observation_count": len(observations),
            "first_labels": [observation.label for observation in observations[:MAX_PREVIEW_ROWS]],
            "joint_count": None if joints is None else len(joints),
            "joint_kinds": self._joint_kinds(),
            "assumptions": self._notes,
        }
        unsure_numbers = [layout.unsure_number for layout in self._layouts if layout.unsure_number]
        return Understood(
            preview=self.build_answer().preview.model_copy(update=update),
            faults=(),
            observations=tuple(observations),
            units={kind: find_unit_of_readings(unit).name for kind, unit in self._units.items()},
            times_and_roundings=self._times_and_roundings,
            bodies=tuple(self._bodies),
            unusual=(*unsure_numbers, *_find_unusual_values(observations)),
        )

    def _joint_kinds(self) -> list[JointKind]:
        """Return the kind of each joint: prismatic if its column's unit is a length; [] without joints."""
        for columns in (layout.columns for layout in self._layouts):
            if indices := columns.quantities.get(Quantity("joint")):
                dimensions = [columns.meanings[index].dimension for index in indices]
                return ["prismatic" if dimension == "length" else "revolute" for dimension in dimensions]
        return []

    def build_answer(self) -> Understood:
        """Return the previews of the files that were read so far, and the faults."""
        preview = ImportPreview(files=[self._add_fault_rows(each) for each in self._previews])
        are_named = self._are_columns_named
        return Understood(preview, tuple(self._faults.found), are_columns_named=are_named)

    def _add_fault_rows(self, preview: FilePreview) -> FilePreview:
        """Return the preview of a file, extended by rows with faults that the preview does not show yet."""
        shown_lines = {*preview.header_lines, *preview.first_lines}
        fault_places = (fault.place for fault in self._faults.found)
        lines = {place.line for place in fault_places if place.file == preview.file} - shown_lines
        grids = (layout.grid for layout in self._layouts if layout.grid.file == preview.file)
        found = [(grid, row) for grid in grids for row in grid.rows if row.line in lines]
        rows = [row for _, row in found]
        cells = [grid.show_cells(row) for grid, row in found]
        return preview.model_copy(update={"fault_rows": cells, "fault_lines": [row.line for row in rows]})

    def _check_options(self) -> None:
        """Report options that no file needs, and options that name a header that no file has."""
        tables_needing_names = [layout.columns for layout in self._layouts if layout.columns.needed]
        self._check_name_template("point_name", self._options.point_name, tables_needing_names)
        self._check_name_template("file_name", self._options.file_name, tables_needing_names)
        if self._options.state and not any("state" in table.needed for table in tables_needing_names):
            reason = "the state of all positions is given by headers or columns"
            self._faults.report(NOWHERE, reason, "omit `state`", "state")
        if self._options.header and all(layout.preview.header_lines for layout in self._layouts):
            reason = "the header that is stated is not needed: every file has a known header of its own"
            self._faults.report(NOWHERE, reason, "omit `header`, or remove the header of the file", "header")
        self._check_named_headers()

    def _check_name_template(self, option: str, template: str | None, tables: Sequence[Columns]) -> None:
        """Report a template such as `{label}_{target}_{state}` that gives what all tables have already.

        Args:
            option: option that has the template: `point_name` or `file_name`.
            template: the template; None if the option is not used.
            tables: columns of the tables whose names have to give target or state.
        """
        if not template:
            return
        kinds = [kind for kind in ("target", "state") if f"{{{kind}}}" in template]
        # Headers give a kind that a table neither needs from names nor has as a column.
        given_by_headers = [
            kind for kind in kinds for table in tables if kind not in {*table.needed, *table.texts}
        ]
        if given_by_headers or not tables:
            kind_words = " and ".join(given_by_headers or ["target", "state"])
            reason = f"the template {quote(template)} is not needed: headers or columns give the {kind_words}"
            self._faults.report(NOWHERE, reason, f"correct the template, or omit `{option}`", option)

    def _check_named_headers(self) -> None:
        """Report headers that the options `columns` and `ignore` name, but that no file has."""
        columns = [column for layout in self._layouts for column in layout.preview.columns]
        known_headers = {collapse_blanks(column.header) for column in columns}
        if self._options.layouts or "" in known_headers:
            return
        unknown = [
            ("columns", header) for header in self._options.columns if not _is_named(header, known_headers)
        ]
        unknown += [
            ("ignore", header) for header in self._options.ignore if not _fits_any(header, known_headers)
        ]
        for option, header in unknown:
            reason = f"`{option}` names the header {quote(header)}, but no file has this header"
            remedy = f"write the header in `{option}` exactly as in the file"
            self._faults.report(NOWHERE, reason, remedy, option)

    def _compare_with_others(self, layout: Layout) -> None:
        """Report a file whose units or frame differ from those of the files that were read before."""
        place = Place(layout.grid.file)
        for dimension, unit in layout.columns.units.items():
            if self._units.setdefault(dimension, unit) != unit:
                other = name_unit(self._units[dimension])
                reason = f"the unit of {dimension} is {name_unit(unit)}, but {other} in other files"
                self._faults.report(place, reason, "use one unit for every quantity")
        if not _has_positions(layout):
            return
        first_layout = next(filter(_has_positions, self._layouts))
        if first_layout.frame != layout.frame:
            frames = layout.frame or "not named", first_layout.frame or "not named"
            reason = f"the frame is {frames[0]}, but {frames[1]} in other files"
            remedy = "export all files in one frame; add a line `# Frame: NAME` to a file that names no frame"
            self._faults.report(place, reason, remedy)


def _has_positions(layout: Layout) -> bool:
    """Return whether a table has columns of positions."""
    return any(quantity.kind == "position" for quantity in layout.columns.quantities)


def _is_named(header: str, known_headers: Collection[str]) -> bool:
    """Return whether a file has a header; blanks of different length are equal."""
    return collapse_blanks(header) in known_headers


def _fits_any(header: str, known_headers: Collection[str]) -> bool:
    """Return whether a file has a header of the option `ignore`, which may be a pattern such as `U95*`."""
    return _is_named(header, known_headers) or any(fits_header(header, known) for known in known_headers)


def read_grids(file: SourceFile, options: ImportOptions, *, every_length: bool = False) -> list[Grid]:
    """Read a workbook, a file of arrays, a certificate or a text file as rows of cells.

    There is a table for each sheet.

    With `every_length`, for a proposal, the arrays of each number of rows in a file of arrays make a table;
    so do matrices in a text, and tables side by side. Units are taken out of cells.

    Raises:
        ImportFileError: the file is empty, of another type, or cannot be read.
    """
    if not file.content.strip():
        raise ImportFileError(Place(file.name), "the file is empty", "export the file again")
    kind = file_type(file.content, file.name)
    if kind is not None and kind in grid.ARRAYS:
        sheets = split_sheets(options.sheet)
        arrays = read_arrays(file.name, file.content, grid.ARRAYS[kind], sheets, every_length=every_length)
        return _mark_sheets(arrays)
    if kind == grid.CERTIFICATE:
        return read_certificate(file.name, file.content)
    if kind == grid.VAL3:
        return _mark_sheets(read_joint_data(file.name, file.content))
    if kind in grid.WORKBOOKS:
        grids = _read_sheets(file, options, every_length=every_length)
    else:
        grids = list(map(_note_encoding, _read_text_grids(file, kind, options, every_length=every_length)))
    if every_length:
        adjacent = [table for each in grids for table in split_adjacent(each)]
        grids = _mark_sheets(adjacent) if len(adjacent) > len(grids) else grids
    joined = [join_axis_rows(each, Vocabulary(options), with_nominal=every_length) for each in grids]
    return list(map(separate_units, joined)) if every_length else joined


def read_sheets(file: SourceFile, stated: str | None) -> list[Grid]:
    """Return the sheets of a workbook of Excel or OpenDocument; `stated` are their names, None for all.

    Raises:
        ImportFileError: the workbook cannot be read, or has no sheet of a name.
    """
    read = read_workbook if file_type(file.content) == grid.WORKBOOK else read_spreadsheet
    return read(file.name, file.content, stated)


def _read_sheets(file: SourceFile, options: ImportOptions, *, every_length: bool) -> list[Grid]:
    """Read the sheets of a workbook that the options state, or those whose numbers can be read together.

    With `every_length`, for a proposal, forms of one posture each are one table.

    Raises:
        ImportFileError: the workbook cannot be read, or the choice of the sheets is not clear.
    """
    sheets = read_sheets(file, options.sheet)
    tables = list_tables(sheets) if options.sheet is None else sheets
    forms = join_forms(tables, Vocabulary(options)) if every_length else None
    if forms is not None:
        chosen = [forms]
    elif options.sheet is None:
        chosen = choose_sheets(tables, options.state_words)
    else:
        chosen = tables
    others = [sheet for sheet in sheets if sheet not in tables]
    return note_others(_mark_sheets(chosen), others)


def _mark_sheets(sheets: Sequence[Grid]) -> list[Grid]:
    """Return sheets or groups of a file, which know whether they are several."""
    names = {sheet.preview.sheet for sheet in sheets}
    return [replace(sheet, is_one_of_several=len(names) > 1) for sheet in sheets]


def _note_encoding(table: Grid) -> Grid:
    """Return a table with the note that its encoding was assumed, unless the bytes show the encoding."""
    notes = [*describe_encoding(table.preview.encoding), *table.preview.assumptions]
    return replace(table, preview=table.preview.model_copy(update={"assumptions": notes}))


def _read_text_grids(
    file: SourceFile, kind: str | None, options: ImportOptions, *, every_length: bool
) -> list[Grid]:
    """Read a text file, whose type may be JSON, as rows of cells; arguments as of `read_grids`.

    Raises:
        ImportFileError: the file is of another type, or cannot be read.
    """
    if file.is_table:
        return [read_text(file.name, file.content, options.delimiter, is_table=True)]
    is_text = kind in (None, grid.JSON)  # a matrix without a name begins as a list of JSON does
    objects = _read_objects(file, kind) if is_text else None
    if objects is not None:
        return [objects]
    matrices = _read_matrices(file) if is_text else []
    if every_length and matrices:
        return matrices
    lists = read_lists(file.name, file.content) if is_text else None
    if lists is not None:
        return [lists]
    if kind is not None:
        raise _build_type_error(file, kind)
    if every_length:
        blocks = read_blocks(file.name, file.content, options.delimiter)
        if blocks:
            return blocks
    return [read_text(file.name, file.content, options.delimiter, are_marks_literal=every_length)]


def _read_objects(file: SourceFile, kind: str | None) -> Grid | None:
    """Return the objects of a file of JSON or YAML as a table; None of another text.

    Raises:
        ImportFileError: the text is damaged, or the table is too large.
    """
    read = read_json_rows if kind == grid.JSON else read_yaml_rows
    return read(file.name, file.content)


def _read_matrices(file: SourceFile) -> list[Grid]:
    """Return the matrices of a text file as tables; none of another text.

    Raises:
        ImportFileError: the text computes with a matrix.
    """
    text, encoding = decode(file.name, file.content)
    matrices = find_matrices(file.name, text)
    return build_grids_of_matrices(file.name, encoding, matrices) if matrices else []


def _build_type_error(file: SourceFile, kind: str) -> ImportFileError:
    """Return the error that a file of this type is no table."""
    remedy = "export the readings as CSV, text or .xlsx"
    if kind == grid.JSON:
        try:
            document = from_json(file.content.removeprefix(b"\xef\xbb\xbf"))
        except ValueError as error:
            reason = f"Invalid JSON: {error}"
            remedy = "correct the JSON at this place; the file must be UTF-8"
            return ImportFileError(Place(file.name), reason, remedy)
        remedy = "a campaign needs no import: use `jointstiff identify FILE`"
        if isinstance(document, dict) and "model" in document:
            kind = "a robot"
            remedy = "give this file as the robot of readings: `jointstiff import READINGS --robot FILE`"
    return ImportFileError(Place(file.name), f"the file is {kind}, not a table", remedy).mark_document()


def detect_delimiter(file: SourceFile) -> Delimiter | None:
    """Return the delimiter of a text file; None for other files, and if the delimiter is not certain."""
    if file_type(file.content, file.name) is not None:
        return None
    try:
        return read_text(file.name, file.content, None).preview.delimiter
    except ImportFileError:
        return None


# ---- records of all files, put together by label


class _JointDifference(NamedTuple):
    """Difference of one joint between two files; `max` finds the greatest relative to its tolerance."""

    relative: float  # difference divided by the tolerance
    joint: int  # index of the joint
    absolute: float  # difference in the unit of the joint


@dataclass(frozen=True)
class _JointComparison:
    """Tolerances within which the joints of one observation may differ between files."""

    tolerances: Sequence[float]  # of each joint, in its unit
    units: Sequence[str]  # of each joint, as written behind numbers: `°`, ` rad`, ` mm` or ` m`

    @classmethod
    def from_units(
        cls, tolerance: float, units: Mapping[str, str], kinds: Sequence[JointKind]
    ) -> _JointComparison:
        """Return the comparison of joints with a tolerance in degrees or mm, in the units of the files.

        Args:
            tolerance: tolerance of each joint [deg or mm].
            units: units of the files by `angle` and `length`.
            kinds: kind of each joint, `revolute` or `prismatic`.
        """
        in_radians, in_metres = units.get("angle") == "rad", units.get("length") == "m"
        tolerance_of_kind = {
            "revolute": tolerance / (degrees(1.0) if in_radians else 1.0),
            "prismatic": tolerance / (1e3 if in_metres else 1.0),
        }
        unit_of_kind = {
            "revolute": " rad" if in_radians else "°",
            "prismatic": f" {units.get('length', 'mm')}",
        }
        return cls([tolerance_of_kind[kind] for kind in kinds], [unit_of_kind[kind] for kind in kinds])

    def find_greatest(self, first: Sequence[float], second: Sequence[float]) -> _JointDifference:
        """Return the greatest difference between the joints (n,) of two files, relative to its tolerance."""
        absolute = [abs(one - other) for one, other in zip(first, second, strict=True)]
        relative = [each / most for each, most in zip(absolute, self.tolerances, strict=False)]
        return max(_JointDifference(relative[k], k, absolute[k]) for k in range(len(relative)))

    def describe(self, joint: int, number: float) -> str:
        """Return a difference of a joint with its unit in words, such as `0.02°`."""
        return f"{number:.4g}{self.units[joint]}"


class _Merging:
    """Merging of the records of each label into one observation."""

    def __init__(
        self,
        options: ImportOptions,
        units: Mapping[str, str],
        joint_kinds: Sequence[JointKind],
        faults: Faults,
        notes: list[str],
    ) -> None:
        """Prepare to merge records; `units` has the units by dimension, assumptions are added to `notes`."""
        self._options, self._faults, self._notes = options, faults, notes
        self._joints = _JointComparison.from_units(options.joint_tolerance, units, joint_kinds)
        self._metre = 1.0 if units.get("length") == "m" else 1e3  # one metre in the unit of positions
        self._joint_difference = 0.0  # greatest difference between two files, relative to the tolerance
        # difference beyond the tolerance that is the greatest, with its fault
        self._worst_joints: tuple[float, ImportFileError] | None = None
        self._repeats: dict[tuple[str, Quantity], list[Value]] = {}  # readings of points that are repeated
        # file and sheet of each value that a later record added; those that are repeated in another one
        self._tables: dict[tuple[str, Quantity], str] = {}
        self._in_two_tables: set[tuple[str, Quantity]] = set()

    def merge_by_label(self, records: Iterable[ObservationRecord]) -> list[ObservationRecord]:
        """Return one observation for each label; contradictory values are faults.

        Raises:
            ImportFileError: there are too many observations.
        """
        observations: dict[str, ObservationRecord] = {}
        first_places: dict[tuple[str, str], Place] = {}  # of each label in each file and sheet
        for record in records:
            first_place = first_places.setdefault((record.table, record.label), record.place)
            observation = observations.setdefault(record.label, record)
            is_repeated = record.whole and first_place is not record.place
            if is_repeated and not self._options.mean_of_repeats:
                _report_duplicate(f"the label {quote(record.label)}", record.place, first_place, self._faults)
            elif observation is not record:
                self._merge_record(observation, record)
            if len(observations) > MAX_OBSERVATIONS:
                reason = f"there are more than {MAX_OBSERVATIONS} observations"
                raise ImportFileError(record.place, reason, _USE_FEWER)
        self._conclude_joints()
        self._conclude_repeats(observations)
        return list(observations.values())

    def _merge_record(self, observation: ObservationRecord, record: ObservationRecord) -> None:
        """Add the values of a record to the observation with the same label; report values that differ.

        A force of zero in rows without load gives way to the force of rows under load. Of joints that differ
        within the tolerance, those of the record with unloaded positions are kept.
        """
        observation.held_out |= record.held_out
        has_no_load, had_no_load = _is_without_load(record), _is_without_load(observation)
        has_unloaded_only = _list_states_of_record(record) == {"unloaded"}
        for quantity, value in record.values.items():
            first_value = observation.values.setdefault(quantity, value)
            are_joints = quantity.kind == "joint" and first_value.vector and value.vector
            if quantity.kind in POINTS:
                self._note_repeat(observation, record, quantity, first_value)
            elif first_value.vector == value.vector or (has_no_load and _is_no_load(quantity, value)):
                continue
            elif had_no_load and _is_no_load(quantity, first_value):
                observation.values[quantity] = value
            elif not are_joints:
                self._report_difference(record, quantity, first_value)
            elif self._are_equal_joints(record.label, first_value, value) and has_unloaded_only:
                observation.values[quantity] = value

    def _report_difference(self, record: ObservationRecord, quantity: Quantity, first: Value) -> None:
        """Report that a quantity of a record, such as the force, differs from `first` of the same label."""
        reason = f"the {quantity.kind} of {quote(record.label)} differs from the value at {first.place}"
        remedy = "give each observation a unique label, or correct one of the two values"
        self._faults.report(record.place, reason, remedy)

    def _note_repeat(
        self, observation: ObservationRecord, record: ObservationRecord, quantity: Quantity, first: Value
    ) -> None:
        """Note that a record repeats a reading of its observation, and whether in the same table.

        `first` is the observation's reading: the record's own, if there was none before.
        """
        value, key = record.values[quantity], (record.label, quantity)
        first_table = self._tables.setdefault(key, record.table if first is value else observation.table)
        if first is not value:
            self._repeats.setdefault(key, [first]).append(value)
            self._in_two_tables |= {key} if record.table != first_table else set()

    def _are_equal_joints(self, label: str, first: Value, second: Value) -> bool:
        """Return whether joints of two files agree within the tolerance; keep the worst disagreement."""
        if not (first.vector and second.vector) or len(first.vector) != len(second.vector):
            return False
        difference = self._joints.find_greatest(first.vector, second.vector)
        if difference.relative <= 1.0 + 1e-9:
            self._joint_difference = max(self._joint_difference, difference.relative)
            return True
        if self._worst_joints is None or difference.relative > self._worst_joints[0]:
            fault = self._build_joint_fault(label, first, second, difference)
            self._worst_joints = difference.relative, fault
        return False

    def _build_joint_fault(
        self, label: str, first: Value, second: Value, difference: _JointDifference
    ) -> ImportFileError:
        """Return the fault that joints of an observation, `first` and `second`, differ between two files."""
        joint = difference.joint
        found = self._joints.describe(joint, difference.absolute)
        plausible = self._joints.describe(joint, self._joints.tolerances[joint])
        reason = (
            f"the joint angles of {quote(label)} differ by {found} from those at {first.place}, at joint "
            f"{joint + 1}; up to {plausible} is plausible"
        )
        remedy = (
            "give each observation a unique label, correct one of the two rows, or raise "
            "`joint_tolerance` (in ° or mm)"
        )
        return ImportFileError(second.place, reason, remedy, "joint_tolerance")

    def _conclude_joints(self) -> None:
        """Report the joints that differ most between files, or note the greatest difference."""
        if self._worst_joints is not None:
            self._faults.add(self._worst_joints[1])
        elif self._joint_difference:
            greatest = self._joint_difference * self._options.joint_tolerance
            self._notes.append(
                f"joints of the same observation differ between files by up to {greatest:.2g} (deg or "
                "mm): the joints of the unloaded readings were used"
            )

    def _conclude_repeats(self, observations: Mapping[str, ObservationRecord]) -> None:
        """Replace repeated readings by their means if the options allow this; else report them as faults."""
        spread = _Spread()
        for (label, quantity), values in self._repeats.items():
            fault = self._find_repeat_fault(label, quantity, values)
            if fault is not None:
                self._faults.add(fault)
                continue
            mean = _average_readings(values)
            spread.add(mean)
            observations[label].values[quantity] = replace(values[0], vector=mean.vector)
        if spread.degrees_of_freedom:
            deviation = f"{1e6 / self._metre * spread.deviation:.3g} µm"
            greatest = f"{1e6 / self._metre * spread.greatest_distance:.3g} µm"
            self._notes.append(
                f"the mean of repeated readings was used for {len(self._repeats)} points; by their spread, "
                f"one reading has a standard deviation of {deviation} in each coordinate; the greatest "
                f"distance from a mean is {greatest}"
            )

    def _find_repeat_fault(
        self, label: str, quantity: Quantity, values: Sequence[Value]
    ) -> ImportFileError | None:
        """Return why the readings of a point have no mean; None if their mean can be used.

        Readings in two tables may be of two loads, and readings that are far from their mean of two points.
        """
        what, place = f"{quantity.target} {quantity.state} of {quote(label)}", values[1].place
        is_in_two_tables = (label, quantity) in self._in_two_tables
        if not is_in_two_tables and not (
            self._options.mean_of_repeats and all(value.vector for value in values)
        ):
            reason = f"{what} occurs twice, first at {values[0].place}"
            remedy = (
                "rename or remove one of the two readings, or use `mean_of_repeats` for repeated readings"
            )
            return ImportFileError(place, reason, remedy, "mean_of_repeats")
        if is_in_two_tables:
            reason = f"{what} occurs in two files or sheets, first at {values[0].place}"
            remedy = "rename or remove one of the two readings, or put repeated readings into one table"
            return ImportFileError(place, reason, remedy)
        distance = sqrt(max(_average_readings(values).squares))
        if distance > _MAX_REPEAT * self._metre:
            reason = (
                f"readings of {what} are up to {1e3 * distance / self._metre:.3g} mm from their mean; for "
                f"repeated readings, at most {1e3 * _MAX_REPEAT:g} mm is plausible"
            )
            remedy = "correct the names of the readings, or give one mean of readings that scatter more"
            return ImportFileError(place, reason, remedy)
        return None


class _Mean(NamedTuple):
    """Mean of K readings of a point."""

    vector: tuple[float, ...]  # coordinates
    squares: list[float]  # (K,) squared distance of each reading from the mean


def _average_readings(values: Sequence[Value]) -> _Mean:
    """Return the mean of K readings of a point; all of them have their coordinates."""
    vectors = [value.vector for value in values if value.vector]
    mean = tuple(fmean(coordinates) for coordinates in zip(*vectors, strict=True))
    return _Mean(mean, [dist(vector, mean) ** 2 for vector in vectors])


@dataclass
class _Spread:
    """Spread of repeated readings about their means, over all points; lengths in the unit of positions."""

    squares: float = 0.0  # sum of the squared distances from the means
    greatest_square: float = 0.0  # greatest of these squared distances
    degrees_of_freedom: int = 0

    def add(self, mean: _Mean) -> None:
        """Add the readings of a point; K readings of 3 coordinates have 3 (K - 1) degrees of freedom."""
        self.squares += sum(mean.squares)
        self.greatest_square = max(self.greatest_square, *mean.squares)
        self.degrees_of_freedom += len(mean.vector) * (len(mean.squares) - 1)

    @property
    def deviation(self) -> float:
        """Standard deviation of a coordinate of one reading."""
        return sqrt(self.squares / self.degrees_of_freedom)

    @property
    def greatest_distance(self) -> float:
        """Greatest distance of a reading from the mean of its point."""
        return sqrt(self.greatest_square)


def _list_states_of_record(record: ObservationRecord) -> set[State]:
    """Return the states, such as `unloaded`, in which a record has positions."""
    return {quantity.state for quantity in record.values if quantity.state}


def _is_without_load(record: ObservationRecord) -> bool:
    """Return whether a record has positions, and all were read without load."""
    states = _list_states_of_record(record)
    return bool(states) and states <= {"unloaded", "unloaded_after"}


def _is_no_load(quantity: Quantity, value: Value) -> bool:
    """Return whether a value is a force, a mass or a moment of zero, as tables have it in unloaded rows."""
    return quantity.kind in ("force", "mass", "moment") and bool(value.vector) and not any(value.vector or ())


def _report_duplicate(what: str, place: Place, first_place: Place, faults: Faults) -> None:
    """Report that something occurs at a place, and occurred before at `first_place`.

    `what` is its name in words.
    """
    faults.report(
        place, f"{what} occurs twice, first at {first_place}", "rename or remove one of the two rows"
    )


def _list_targets(observations: Iterable[ObservationRecord]) -> list[str]:
    """Return the names of all targets in the order of their first readings.

    Raises:
        ImportFileError: there are too many targets.
    """
    targets: dict[str, None] = {}
    for quantity, value in (
        (quantity, observation.values[quantity])
        for observation in observations
        for quantity in observation.values
    ):
        if quantity.target is not None:
            targets.setdefault(quantity.target)
        if len(targets) > MAX_TARGETS:
            reason = f"there are more than {MAX_TARGETS} targets: {quote(', '.join(targets))}"
            remedy = "check which part of a name is the target; use `point_name` or `file_name`"
            raise ImportFileError(value.place, reason, remedy)
    return list(targets)


def _check_same_quantities(observations: list[ObservationRecord], faults: Faults) -> None:
    """Report observations that lack joint angles, a force or a quantity that others have."""
    for kind in _list_kinds_of_quantities(observations):
        with_kind = [observation for observation in observations if observation.vector(kind) is not None]
        without_kind = [observation for observation in observations if observation.vector(kind) is None]
        if without_kind:
            _report_lacking_quantity(kind, without_kind, with_kind, faults)
        _report_other_counts(kind, with_kind, faults)


def _skip_incomplete_observations(
    observations: Sequence[ObservationRecord],
) -> tuple[list[ObservationRecord], list[str]]:
    """Return the observations with all quantities, such as joint angles, that others have; and notes."""
    kinds = _list_kinds_of_quantities(observations)
    complete, notes = list[ObservationRecord](), list[str]()
    for observation in observations:
        lacking = [kind for kind in kinds if observation.vector(kind) is None]
        if lacking:
            notes.append(f"{observation.label}: no {' and no '.join(lacking)}; the observation was skipped")
        else:
            complete.append(observation)
    return (complete, notes) if complete else (list(observations), [])


def _list_kinds_of_quantities(observations: Iterable[ObservationRecord]) -> list[Kind]:
    """Return the kinds of quantities of whole observations, not of targets, that occur."""
    quantities = (quantity for observation in observations for quantity in observation.values)
    return list(dict.fromkeys(quantity.kind for quantity in quantities if quantity.target is None))


def _report_lacking_quantity(
    kind: Kind, without: list[ObservationRecord], others: list[ObservationRecord], faults: Faults
) -> None:
    """Report that the observations `without` lack a quantity, such as the force, that `others` have."""
    first = quote(without[0].label)
    lack = f"{first} and {len(without) - 1} others have" if len(without) > 1 else f"{first} has"
    reason = f"{lack} no {kind}, but other labels have: {_list_labels(others)}"
    remedy = (
        f"add the {kind} of these labels, spell labels alike in all files, or use `allow_missing` to skip "
        f"them; these labels have no {kind}: {_list_labels(without)}"
    )
    for dates, numbers in ((without, others), (others, without)):
        if all(_DATE.fullmatch(each.label) for each in dates) and all(
            _PARTS_OF_DATE.fullmatch(each.label) for each in numbers
        ):
            reason += (
                f"; a spreadsheet seems to have turned labels such as {quote(numbers[0].label)} into dates "
                f"such as {quote(dates[0].label)}"
            )
            remedy = (
                "give the column of labels the format of texts in the spreadsheet, and write the labels "
                f"again: {_list_labels(numbers)}"
            )
    faults.report(without[0].place, reason, remedy, "allow_missing")


_MONTH: Final = (
    "(?:jan|ene|gen|feb|fév|fev|mar|mär|mrz|apr|avr|abr|may|mai|mag|jun|juin|giu|jul|juil|lug|aug|aoû|ago|sep|set|"
    "oct|okt|ott|out|nov|dec|dez|déc|dic)[^\\W\\d]{0,7}[.]?"
)
_DATE: Final = re.compile(
    rf"\d{{1,2}}[-. /]{{1,2}}{_MONTH}(?:[-. /]\d{{2,4}})?|{_MONTH}[-. /]\d{{1,4}}"
    r"|\d{4}-\d\d-\d\d(?:[ T]00:00:00)?|\d{1,2}[./]\d{1,2}[./]\d{4}",
    re.IGNORECASE,
)
"""A date, as spreadsheets show the date that they made of a label."""
_PARTS_OF_DATE: Final = re.compile(r"\d{1,2}[-./]\d{1,2}")
"""A label that spreadsheets take as a day and a month."""


def _report_other_counts(kind: Kind, observations: list[ObservationRecord], faults: Faults) -> None:
    """Report observations that have another number of joint angles than the first of them.

    Other quantities than joint angles always have three numbers, or one.
    """
    count = len(observations[0].vector(kind) or ())
    for observation in observations:
        value = observation.values[Quantity(kind)]
        own_count = len(value.vector or ())
        if own_count != count:
            reason = f"this observation has {own_count} joint angles, but other observations have {count}"
            faults.report(value.place, reason, "check the columns of joints")


def _list_labels(observations: list[ObservationRecord]) -> str:
    """Return the first three labels of some observations in one text."""
    names = ", ".join(quote(observation.label) for observation in observations[:_MAX_LISTED_LABELS])
    return names + ", …" * (len(observations) > _MAX_LISTED_LABELS)


class _Gap(NamedTuple):
    """Reading of a target that is missing or incomplete."""

    target: str
    is_empty: bool  # whether nothing of the reading was found
    place: Place  # of a value of the reading, else of its observation
    sentence: str  # what the reading lacks, after the label of its observation


def _drop_and_report_incomplete_readings(
    observations: list[ObservationRecord], targets: list[str], faults: Faults, options: ImportOptions
) -> tuple[list[ObservationRecord], list[str]]:
    """Return the observations without their incomplete readings, and a note on each omitted reading.

    Unless `allow_missing` is set, each omitted reading is also reported as a fault. The target at the hook
    needs a position in one observation only, and no load.
    """
    kept_observations, gaps, notes = list[ObservationRecord](), list[_Gap](), list[str]()
    required = _list_required_targets(observations, targets)
    for observation in observations:
        own_gaps = _find_gaps(observation, targets, required, options.load_point_target, faults)
        gaps += own_gaps
        omitted = {gap.target for gap in own_gaps}
        omitted.update(_list_unread_hook(observation.points, options.load_point_target))
        values = {key: value for key, value in observation.values.items() if key.target not in omitted}
        if any(quantity.target for quantity in values):
            kept_observations.append(replace(observation, values=values))
        else:
            notes.append(f"{observation.label}: no reading is complete; the observation was skipped")
    if not options.allow_missing:
        _report_gaps(gaps, faults)
    if not kept_observations:
        place = observations[0].place
        faults.report(place, "no observation has a reading", "correct the names of points and files")
    return kept_observations, [*(f"{gap.sentence}; skipped" for gap in gaps), *notes]


def _list_required_targets(observations: Iterable[ObservationRecord], targets: Iterable[str]) -> set[str]:
    """Return the targets that must have a reading in each observation: all except those of gauges.

    A gauge need not be read in each posture.
    """
    quantities = (quantity for observation in observations for quantity in observation.values)
    gauges = {quantity.target for quantity in quantities if quantity.kind == "along"}
    return set(targets) - gauges


def _find_gaps(
    observation: ObservationRecord,
    targets: Sequence[str],
    required: Collection[str],
    hook: str | None,
    faults: Faults,
) -> list[_Gap]:
    """Return the missing and incomplete readings of an observation; report contradictory readings.

    Args:
        observation: observation with its readings.
        targets: targets of the set, in the order of the gaps.
        required: targets that must have a reading in each observation.
        hook: target at the hook, which gives the load point; None if no target does.
        faults: faults of all files.
    """
    points = observation.points
    without_gap = [*_list_unread_hook(points, hook), *_list_targets_without_load(points, hook)]
    gaps = []
    for target in targets:
        is_expected = target in points or target in required
        if not is_expected or target in without_gap:
            continue
        states = points.get(target, {})
        with faults.collect():
            lack = _describe_gap(observation, target, states)
            if lack is not None:
                place = next((point.place for point in states.values()), observation.place)
                gaps.append(_Gap(target, not states, place, f"{observation.label}: {lack}"))
    return gaps


def _report_gaps(gaps: Sequence[_Gap], faults: Faults) -> None:
    """Report readings that are missing or incomplete.

    Readings with some of their values come first, because they show better what is wrong.
    """
    remedy = "add the reading, check the spelling of names, or use `allow_missing`"
    for gap in sorted(gaps, key=lambda each: each.is_empty):
        faults.report(gap.place, gap.sentence, remedy, "allow_missing")


def _list_states(states: dict[State, Value]) -> set[State]:
    """Return the states of a target that have numbers."""
    return {state for state, point in states.items() if point.vector is not None}


def _list_unread_hook(points: dict[str, dict[State, Value]], hook: str | None) -> list[str]:
    """Return the target at the hook if an observation has no reading of this target; else no target."""
    if hook is None:
        return []
    states = points.get(hook, {})
    is_partly_read = any(point.lacks_coordinate for point in states.values())
    return [] if is_partly_read or _list_states(states) else [hook]


def _list_targets_without_load(points: dict[str, dict[State, Value]], hook: str | None) -> list[str]:
    """Return the targets of an observation whose positions without load are complete readings.

    These are the target at the hook and, in an observation without any load, the targets read with it.

    Args:
        points: target → state → value of an observation.
        hook: target at the hook; None if no target gives the load point.
    """
    if hook is None or "unloaded" not in _list_states(points.get(hook, {})):
        return []
    states_of_others = [_list_states(states) for target, states in points.items() if target != hook]
    has_load = any(states & {"loaded", "deflection"} for states in states_of_others)
    if has_load:
        return [hook]
    return [target for target, states in points.items() if "unloaded" in _list_states(states)]


def _describe_gap(observation: ObservationRecord, target: str, states: dict[State, Value]) -> str | None:
    """Return in words what the reading of a target lacks; None if the reading is complete.

    Raises:
        ImportFileError: the target has both positions and a deflection.
    """
    if not states:
        return f"target {target} has no reading"
    partly_read = [state for state, point in states.items() if point.lacks_coordinate]
    if partly_read:
        return f"a coordinate of target {target} {_describe_states(partly_read)} has no number"
    present = _list_states(states)
    if "deflection" in present and len(present) > 1:
        reason = f"{quote(observation.label)}: target {target} has both positions and a deflection"
        remedy = "omit the positions or the deflection, for instance with `ignore`"
        raise ImportFileError(states["deflection"].place, reason, remedy)
    if present - {"unloaded_after"} in ({"deflection"}, {"unloaded", "loaded"}):
        return None
    if not present:
        return f"the cells of target {target} are empty"
    return f"target {target} was read only {_describe_states(present)}"


def _describe_states(states: Iterable[State]) -> str:
    """Return states in words, such as `loaded and unloaded after`."""
    return " and ".join(sorted(states)).replace("_", " ")


def _report_skipped_points(observations: list[ObservationRecord]) -> list[str]:
    """Return a note on each point that is skipped because a coordinate has no number."""
    return [
        f"{observation.label}: a coordinate of target {target} has no number; skipped"
        for observation in observations
        for target, states in observation.points.items()
        if any(point.lacks_coordinate for point in states.values())
    ]


def _list_present_states(observations: Iterable[ObservationRecord]) -> list[State]:
    """Return the states, such as `unloaded`, that any observation has, in their usual order."""
    present = {quantity.state for observation in observations for quantity in observation.values}
    return [state for state in _STATES if state in present]


def _describe_uncertainties(counts: Mapping[_Uncertainty, int]) -> list[str]:
    """Return notes on how the uncertainties of points were read; `counts` are the numbers of their points."""
    if len(counts) == 1:
        return [_U95[kind] for kind in counts]
    return [f"{_U95[kind]} ({count} points)" for kind, count in counts.items()]


def _describe_held_out(observations: Iterable[ObservationRecord]) -> list[str]:
    """Return a note on the observations that are held out from the fit; no note without such observations."""
    labels = [observation.label for observation in observations if observation.held_out]
    if not labels:
        return []
    return [f"observations held out from the fit, to check the fit: {', '.join(labels)}"]


def _check_sigmas(observations: list[ObservationRecord], faults: Faults) -> dict[_Uncertainty, int]:
    """Return the number of points with an uncertainty of their coordinates, and of points with one for all.

    The keys are `coordinate` and `point`; a kind without points is left out. A fault is reported if some
    positions have an uncertainty and others have none.
    """
    counts: dict[_Uncertainty, int] = {}
    places_without: list[Place] = []
    items = (item for observation in observations for item in observation.values.items())
    for quantity, value in items:
        if value.sigma is not None:
            kind: _Uncertainty = "point" if value.by_point else "coordinate"
            counts[kind] = counts.get(kind, 0) + 1
        elif value.vector is not None and quantity.kind == "position":
            places_without.append(value.place)
    if counts and places_without:
        reason = "the point has no uncertainty, but other points have one"
        remedy = "add the uncertainty of this point, or skip the columns of U(95) with `ignore`"
        faults.report(places_without[0], reason, remedy)
    return dict(sorted(counts.items()))


class _PlacedNumber(NamedTuple):
    """Number of a file, and where it is."""

    number: float
    place: Place


def _find_unusual_values(observations: Iterable[ObservationRecord]) -> Iterator[str]:
    """Yield a sentence for each value that is farther than 100 spreads from the median of its column."""
    for name, numbers in _list_numbers_by_column(observations).items():
        if len(numbers) >= _MIN_VALUES:
            yield from _find_unusual_numbers(name, numbers)


def _list_numbers_by_column(
    observations: Iterable[ObservationRecord],
) -> dict[str, list[_PlacedNumber]]:
    """Return column, such as `joint 2` or `P1 loaded x`, → its numbers in all observations."""
    columns: dict[str, list[_PlacedNumber]] = {}
    items = (item for observation in observations for item in observation.values.items())
    for (kind, target, state), value in items:
        name = f"{target} {state}" if target else kind
        for axis, number in enumerate(value.vector or ()):
            part = str(axis + 1) if kind == "joint" else "xyz"[axis]
            columns.setdefault(f"{name} {part}", []).append(_PlacedNumber(number, value.place))
    return columns


def _find_unusual_numbers(name: str, numbers: Sequence[_PlacedNumber]) -> Iterator[str]:
    """Yield a sentence for each number of the column `name` that is farther than 100 spreads from the median.

    The spread is the standard deviation of the nine tenths of the values that are nearest to the median, or
    the size of the median if these values are all equal.
    """
    middle = median(each.number for each in numbers)
    nearest_first = sorted(numbers, key=lambda each: abs(each.number - middle))
    far_count = max(1, len(numbers) // 10)
    nearest, farthest = nearest_first[:-far_count], nearest_first[-far_count:]
    spread = pstdev(each.number for each in nearest) or abs(middle)
    for number, place in farthest:
        spreads = abs(number - middle) / spread if spread else 0.0
        # 0.99: a value whose distance is the limit itself is listed despite rounding.
        if spreads > 0.99 * _MAX_SPREADS:
            distance = (
                f"{spreads:.0f} times the spread of the other values away from the median (up to "
                f"{_MAX_SPREADS:g} times is plausible)"
            )
            yield f"{name} {number:g} ({place}) is {distance}"
