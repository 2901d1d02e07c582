"""Reading of files into observations, whose values are merged by label from all files.

A value that occurs twice, contradicts another value or cannot be used is reported as a fault.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, dist, sqrt
from statistics import fmean, median, pstdev
from types import MappingProxyType
from typing import Final, Literal

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
from jointstiff.service.importing.arrays import build_grids_of_matrices, read_arrays
from jointstiff.service.importing.certificates import read_certificate
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, quote
from jointstiff.service.importing.excel import read_workbook, split_sheets
from jointstiff.service.importing.grammar import (
    POINTS,
    Quantity,
    collapse_blanks,
    fits_header,
    name_unit,
    split_along_target,
)
from jointstiff.service.importing.grid import Grid, decode, file_type, read_text
from jointstiff.service.importing.layout import Layout, understand_table
from jointstiff.service.importing.masses import is_mass_table, read_mass_table
from jointstiff.service.importing.matrices import Matrix, find_matrices
from jointstiff.service.importing.rows import (
    NameReader,
    ObservationRecord,
    RowReader,
    TimesAndRoundings,
    Value,
)
from jointstiff.service.importing.weight_steps import is_step_table, read_step_table

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
    """Refuse too many or too large files, and two files with the same name.

    Raises:
        ImportFileError: a limit is exceeded, or a name occurs twice.
    """
    if not 0 < len(files) <= grid.MAX_FILES:
        raise ImportFileError(NOWHERE, f"{len(files)} files were sent", f"send 1 to {grid.MAX_FILES} files")
    names: set[str] = set()
    total = lines = 0
    for file in files:
        place = Place(file.name)
        if file.name in names:
            raise ImportFileError(place, "two files have this name", "send each file once")
        names.add(file.name)
        total += len(file.content)
        if total > grid.MAX_FILE_BYTES:
            limit = f"the files exceed {grid.MAX_FILE_BYTES // 1024**2} MiB together"
            raise ImportFileError(place, limit, "import fewer files at once")
        # Line ends are counted in UTF-8 and UTF-16; the bytes of a workbook contain few of them by chance.
        line_ends, double_line_ends = (b"\n", b"\r"), (b"\r\n", b"\r\0\n")
        lines += sum(map(file.content.count, line_ends)) - sum(map(file.content.count, double_line_ends))
        if lines > grid.MAX_LINES:
            count = f"{grid.MAX_LINES} lines together"
            limit = f"the files have more than {count}, including empty lines and comments"
            raise ImportFileError(
                place, limit, "remove empty lines and comments, or import fewer files at once"
            )


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
        self._times_and_roundings = TimesAndRoundings()

    def read(self, files: Sequence[SourceFile]) -> Understood:
        """Read all files; return their observations, or their faults.

        Raises:
            ImportFileError: the files cannot be used together, such as masses without readings.
        """
        faults = self._faults
        for file in files:
            with faults.collect():
                for table in read_grids(file, self._options):
                    self._read_table(table)
        if self._steps:
            return self._conclude_weight_step()
        all_were_read = {preview.file for preview in self._previews} == {file.name for file in files}
        if all(not layout.columns.faulty for layout in self._layouts) and all_were_read:
            if not self._layouts:  # all files were read, and each is a table of masses
                remedy = "import the masses together with the readings of the robot"
                raise ImportFileError(NOWHERE, "the files contain masses, but no readings", remedy)
            self._check_options()
        readers = []
        for layout in self._layouts:
            # Rows of a table with an unclear header or decimal mark are not read; the fault is reported.
            if layout.decimal_mark is not None and not layout.columns.faulty:
                with faults.collect():
                    names = NameReader(layout, self._options, self._notes)
                    reader = RowReader(
                        layout,
                        names,
                        self._times_and_roundings,
                        allow_missing=self._options.allow_missing,
                    )
                    readers.append(reader)
        records = (record for reader in readers for record in reader.read_records(faults))
        merger = _Merging(self._options, self._units, self._joint_kinds(), faults, self._notes)
        observations = merger.merge_by_label(records)
        return self.build_answer() if faults.found else self._check_and_assemble(observations)

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
        labels = [posture.label for posture in step.observations]
        update = {
            "observation_count": len(labels),
            "first_labels": labels[:MAX_PREVIEW_ROWS],
            "joint_count": len(step.observations[0].joints),
            "states": ["unloaded", "loaded"],
            "reading_count": sum(len(posture.encoder_readings) for posture in step.observations),
        }
        preview = understood.preview.model_copy(update=update)
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
        faults, notes = self._faults, self._notes
        targets = _list_targets(observations)
        _check_same_quantities(observations, faults)
        states_present = {quantity.state for observation in observations for quantity in observation.values}
        states = [state for state in _STATES if state in states_present]
        # Positions in one state only show no deflection, so that their readings cannot be complete.
        has_readings = states not in _SINGLE_STATES
        if targets and has_readings:
            observations, notes_on_gaps = _drop_and_report_incomplete_readings(
                observations, targets, faults, self._options
            )
            notes += notes_on_gaps
        else:
            notes += _report_skipped_points(observations)
        sigmas = _check_sigmas(observations, faults)
        for kind, count in sigmas.items():
            notes.append(f"{_U95[kind]}{f' ({count} points)' if len(sigmas) > 1 else ''}")
        if faults.found:
            return self.build_answer()
        notes += self._times_and_roundings.notes
        held_out = [observation.label for observation in observations if observation.held_out]
        if held_out:
            notes.append(f"observations held out from the fit, to check the fit: {', '.join(held_out)}")
        joints = observations[0].vector("joint") if observations else None
        preview = self.build_answer().preview.model_copy(
            update={
                "observation_count": len(observations),
                "first_labels": [observation.label for observation in observations[:MAX_PREVIEW_ROWS]],
                "joint_count": None if joints is None else len(joints),
                "joint_kinds": self._joint_kinds(),
                "targets": targets,
                "states": states,
                "reading_count": sum(len(observation.points) for observation in observations)
                if has_readings
                else 0,
                "assumptions": notes,
                "uncertainty": next(iter(sigmas), None),
            }
        )
        units = {kind: "mm" if unit == "in" else unit for kind, unit in self._units.items()}
        unsure_numbers = [layout.unsure_number for layout in self._layouts if layout.unsure_number]
        unusual = (*unsure_numbers, *_find_unusual_values(observations))
        bodies = tuple(self._bodies)
        return Understood(preview, (), tuple(observations), units, self._times_and_roundings, bodies, unusual)

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
        return Understood(preview, tuple(self._faults.found))

    def _add_fault_rows(self, preview: FilePreview) -> FilePreview:
        """Return the preview of a file, extended by rows with faults that the preview does not show yet."""
        shown_lines = {*preview.header_lines, *preview.first_lines}
        fault_places = (fault.place for fault in self._faults.found)
        lines = {place.line for place in fault_places if place.file == preview.file} - shown_lines
        grids = (layout.grid for layout in self._layouts)
        rows = [row for each in grids if each.file == preview.file for row in each.rows if row.line in lines]
        cells = [list(row.cells) for row in rows]
        return preview.model_copy(update={"fault_rows": cells, "fault_lines": [row.line for row in rows]})

    def _check_options(self) -> None:
        """Report options that no file needs, and options that name a header that no file has."""
        tables_needing_names = [layout.columns for layout in self._layouts if layout.columns.needed]
        for option in ("point_name", "file_name"):
            text = getattr(self._options, option) or ""
            kinds = [kind for kind in ("target", "state") if f"{{{kind}}}" in text]
            # Headers give a kind that a table neither needs from names nor has as a column.
            kinds_given_elsewhere = [
                kind
                for kind in kinds
                for table in tables_needing_names
                if kind not in {*table.needed, *table.texts}
            ]
            if text and (kinds_given_elsewhere or not tables_needing_names):
                kind_words = " and ".join(kinds_given_elsewhere or ["target", "state"])
                reason = f"the template {quote(text)} is not needed: headers or columns give the {kind_words}"
                self._faults.report(NOWHERE, reason, f"correct the template, or omit `{option}`", option)
        if self._options.state and not any("state" in table.needed for table in tables_needing_names):
            reason = "the state of all positions is given by headers or columns"
            self._faults.report(NOWHERE, reason, "omit `state`", "state")
        if self._options.header and all(layout.preview.header_lines for layout in self._layouts):
            reason = "the header that is stated is not needed: every file has a known header of its own"
            self._faults.report(NOWHERE, reason, "omit `header`, or remove the header of the file", "header")
        self._check_named_headers()

    def _check_named_headers(self) -> None:
        """Report headers that the options `columns` and `ignore` name, but that no file has."""
        known_headers = {
            collapse_blanks(column.header) for layout in self._layouts for column in layout.preview.columns
        }
        if self._options.layouts or "" in known_headers:
            return
        for option in ("columns", "ignore"):
            for header in getattr(self._options, option):
                is_known = collapse_blanks(header) in known_headers
                if not is_known and not (
                    option == "ignore" and any(fits_header(header, known) for known in known_headers)
                ):
                    reason = f"`{option}` names the header {quote(header)}, but no file has this header"
                    self._faults.report(
                        NOWHERE, reason, f"write the header in `{option}` exactly as in the file", option
                    )

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


def read_grids(file: SourceFile, options: ImportOptions, *, every_length: bool = False) -> list[Grid]:
    """Read a workbook, a file of arrays, a certificate or a text file as rows of cells.

    There is a table for each sheet.

    With `every_length`, the arrays of each number of rows in a file of arrays make a table; so do matrices
    in a text.

    Raises:
        ImportFileError: the file is empty, of another type, or cannot be read.
    """
    if not file.content.strip():
        raise ImportFileError(Place(file.name), "the file is empty", "export the file again")
    kind = file_type(file.content, file.name)
    if kind == grid.WORKBOOK:
        sheets = split_sheets(options.sheet)
        return [read_workbook(file.name, file.content, sheet) for sheet in sheets]
    if kind is not None and kind in grid.ARRAYS:
        sheets = split_sheets(options.sheet)
        return read_arrays(file.name, file.content, grid.ARRAYS[kind], sheets, every_length=every_length)
    if kind == grid.CERTIFICATE:
        return read_certificate(file.name, file.content)
    is_text = kind in (None, grid.JSON)  # a matrix without a name begins as a list of JSON does
    matrices = _find_matrices(file) if is_text else []
    if every_length and matrices:
        return build_grids_of_matrices(file.name, matrices)
    if kind is not None:
        raise _build_type_error(file, kind)
    return [read_text(file.name, file.content, options.delimiter)]


def _find_matrices(file: SourceFile) -> list[Matrix]:
    """Return the matrices of a text file.

    Raises:
        ImportFileError: the text computes with a matrix.
    """
    return find_matrices(file.name, decode(file.name, file.content)[0])


def _build_type_error(file: SourceFile, kind: str) -> ImportFileError:
    """Return the error that a file of this type is no table."""
    remedy = "export the readings as CSV, text or .xlsx"
    if kind == grid.JSON:
        try:
            from_json(file.content.removeprefix(b"\xef\xbb\xbf"))
        except ValueError as error:
            reason = f"Invalid JSON: {error}"
            remedy = "correct the JSON at this place; the file must be UTF-8"
            return ImportFileError(Place(file.name), reason, remedy)
        remedy = "a campaign needs no import: use `jointstiff identify FILE`"
    return ImportFileError(Place(file.name), f"the file is {kind}, not a table", remedy)


def detect_delimiter(file: SourceFile) -> Delimiter | None:
    """Return the delimiter of a text file; None for other files, and if the delimiter is not certain."""
    if file_type(file.content, file.name) is not None:
        return None
    try:
        return read_text(file.name, file.content, None).preview.delimiter
    except ImportFileError:
        return None


# ---- records of all files, put together by label


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
        per_degree = degrees(1.0) if units.get("angle") == "rad" else 1.0
        per_mm = 1e3 if units.get("length") == "m" else 1.0
        self._joint_tolerances = [  # in the unit of each joint
            options.joint_tolerance / (per_mm if kind == "prismatic" else per_degree) for kind in joint_kinds
        ]
        angle_unit = " rad" if units.get("angle") == "rad" else "°"
        self._joint_units = [  # as they are written behind numbers
            f" {units.get('length', 'mm')}" if kind == "prismatic" else angle_unit for kind in joint_kinds
        ]
        self._metre = 1.0 if units.get("length") == "m" else 1e3  # one metre in the unit of positions
        self._joint_difference = 0.0  # greatest difference between two files, relative to the tolerance
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
                raise ImportFileError(record.place, reason, "split the campaign into several sets")
        self._conclude_joints()
        self._conclude_repeats(observations)
        return list(observations.values())

    def _merge_record(self, observation: ObservationRecord, record: ObservationRecord) -> None:
        """Add the values of a record to the observation with the same label; report values that differ.

        Of joints that differ within the tolerance, those of the record with unloaded positions are kept.
        """
        observation.held_out |= record.held_out
        states, former_states = (
            {quantity.state for quantity in each.values if quantity.state} for each in (record, observation)
        )
        has_no_load, had_no_load = (
            bool(each) and each <= {"unloaded", "unloaded_after"} for each in (states, former_states)
        )
        for quantity, value in record.values.items():
            first_value = observation.values.setdefault(quantity, value)
            if quantity.kind in POINTS:
                self._note_repeat(observation, record, quantity, first_value)
            elif first_value.vector == value.vector or (has_no_load and _is_no_load(quantity, value)):
                continue
            elif had_no_load and _is_no_load(quantity, first_value):
                observation.values[quantity] = value
            elif quantity.kind != "joint" or not (first_value.vector and value.vector):
                reason = (
                    f"the {quantity.kind} of {quote(record.label)} differs from the value at "
                    f"{first_value.place}"
                )
                remedy = "give each observation a unique label, or correct one of the two values"
                self._faults.report(record.place, reason, remedy)
            elif self._are_equal_joints(record.label, first_value, value) and states == {"unloaded"}:
                observation.values[quantity] = value

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
        differences = [abs(one - other) for one, other in zip(first.vector, second.vector, strict=True)]
        relative_difference, joint = max(
            (difference / tolerance, joint)
            for joint, (difference, tolerance) in enumerate(
                zip(differences, self._joint_tolerances, strict=False)
            )
        )
        if relative_difference <= 1.0 + 1e-9:
            self._joint_difference = max(self._joint_difference, relative_difference)
            return True
        if self._worst_joints is None or relative_difference > self._worst_joints[0]:
            unit = self._joint_units[joint]
            reason = (
                f"the joint angles of {quote(label)} differ by {differences[joint]:.4g}{unit} from those at "
                f"{first.place}, at joint {joint + 1}; up to {self._joint_tolerances[joint]:.4g}{unit} is "
                "plausible"
            )
            remedy = (
                "give each observation a unique label, correct one of the two rows, or raise "
                "`joint_tolerance` (in ° or mm)"
            )
            fault = ImportFileError(second.place, reason, remedy, "joint_tolerance")
            self._worst_joints = relative_difference, fault
        return False

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
        squares, degrees_of_freedom, greatest = 0.0, 0, 0.0
        for (label, quantity), values in self._repeats.items():
            vectors = [value.vector for value in values if value.vector]
            reading_text = f"{quantity.target} {quantity.state} of {quote(label)}"
            if not self._options.mean_of_repeats or len(vectors) < len(values):
                reason = f"{reading_text} occurs twice, first at {values[0].place}"
                remedy = (
                    "rename or remove one of the two readings, or use `mean_of_repeats` for repeated readings"
                )
                self._faults.report(values[1].place, reason, remedy, "mean_of_repeats")
                continue
            if (label, quantity) in self._in_two_tables:  # perhaps of another load
                reason = f"{reading_text} occurs in two files or sheets, first at {values[0].place}"
                remedy = "rename or remove one of the two readings, or put repeated readings into one table"
                self._faults.report(values[1].place, reason, remedy)
                continue
            mean = tuple(fmean(numbers) for numbers in zip(*vectors, strict=True))
            errors = [dist(vector, mean) ** 2 for vector in vectors]  # squared distances from the mean
            if sqrt(max(errors)) > _MAX_REPEAT * self._metre:
                distance = f"{1e3 * sqrt(max(errors)) / self._metre:.3g} mm from their mean"
                reason = (
                    f"readings of {reading_text} are up to {distance}; for repeated readings, at most "
                    f"{1e3 * _MAX_REPEAT:g} mm is plausible"
                )
                remedy = "correct the names of the readings, or give one mean of readings that scatter more"
                self._faults.report(values[1].place, reason, remedy)
                continue
            squares += sum(errors)
            greatest = max(greatest, *errors)
            degrees_of_freedom += len(mean) * (len(vectors) - 1)
            observations[label].values[quantity] = replace(values[0], vector=mean)
        if degrees_of_freedom:
            deviation_text, greatest_text = (
                f"{1e6 / self._metre * sqrt(each):.3g} µm"
                for each in (squares / degrees_of_freedom, greatest)
            )
            self._notes.append(
                f"the mean of repeated readings was used for {len(self._repeats)} points; by their spread, "
                f"one reading has a standard deviation of {deviation_text} in each coordinate; the greatest "
                f"distance from a mean is {greatest_text}"
            )


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
    kinds = (
        quantity.kind
        for observation in observations
        for quantity in observation.values
        if quantity.target is None
    )
    for kind in dict.fromkeys(kinds):
        with_kind = [observation for observation in observations if observation.vector(kind) is not None]
        without_kind = [observation for observation in observations if observation.vector(kind) is None]
        if without_kind:
            others = f" and {len(without_kind) - 1} others have" if len(without_kind) > 1 else " has"
            reason = (
                f"{quote(without_kind[0].label)}{others} no {kind}, but other labels have: "
                f"{_list_labels(with_kind)}"
            )
            remedy = (
                f"spell labels alike in all files; these labels have no {kind}: {_list_labels(without_kind)}"
            )
            faults.report(without_kind[0].place, reason, remedy)
        count = len(with_kind[0].vector(kind) or ())
        for value in (observation.values[Quantity(kind)] for observation in with_kind):
            if len(value.vector or ()) != count:
                counts = (
                    f"this observation has {len(value.vector or ())} joint angles, but other "
                    f"observations have {count}"
                )
                faults.report(value.place, f"{counts}", "check the columns of joints")


def _list_labels(observations: list[ObservationRecord]) -> str:
    """Return the first three labels of some observations in one text."""
    names = ", ".join(quote(observation.label) for observation in observations[:_MAX_LISTED_LABELS])
    return names + ", …" * (len(observations) > _MAX_LISTED_LABELS)


def _drop_and_report_incomplete_readings(
    observations: list[ObservationRecord], targets: list[str], faults: Faults, options: ImportOptions
) -> tuple[list[ObservationRecord], list[str]]:
    """Return the observations without their incomplete readings, and a note on each omitted reading.

    Unless `allow_missing` is set, each omitted reading is also reported as a fault. The target at the hook
    needs a position in one observation only, and no load.
    """
    kept_observations, notes = [], []
    # A gauge need not be read in each posture; any other target must have a reading of each observation.
    gauges = {
        target for observation in observations for kind, target, _ in observation.values if kind == "along"
    }
    gaps: list[tuple[bool, Place, str]] = []  # (True if nothing was read, place, sentence)
    for observation in observations:
        points = observation.points
        omitted_hook = _list_unread_hook(points, options.load_point_target)
        incomplete = list(omitted_hook)
        without_gap = [*omitted_hook, *_list_targets_without_load(points, options.load_point_target)]
        read_targets = [target for target in targets if target in points or target not in gauges]
        for target in [target for target in read_targets if target not in without_gap]:
            with faults.collect():
                states = points.get(target, {})
                gap = _describe_gap(observation, target, states)
                if gap is not None:
                    incomplete.append(target)
                    place = next((point.place for point in states.values()), observation.place)
                    gaps.append((not states, place, f"{observation.label}: {gap}"))
        values = {key: value for key, value in observation.values.items() if key.target not in incomplete}
        if any(quantity.target for quantity in values):
            kept_observations.append(replace(observation, values=values))
        else:
            notes.append(f"{observation.label}: no reading is complete; the observation was skipped")
    if not options.allow_missing:
        remedy = "add the reading, check the spelling of names, or use `allow_missing`"
        # Readings with some of their values come first, because they show better what is wrong.
        for _, place, reason in sorted(gaps, key=lambda entry: entry[0]):
            faults.report(place, reason, remedy, "allow_missing")
    if not kept_observations:
        faults.report(
            observations[0].place, "no observation has a reading", "correct the names of points and files"
        )
    return kept_observations, [*(f"{reason}; skipped" for _, _, reason in gaps), *notes]


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
        return f"a coordinate of target {target} {_describe_states(partly_read)} is empty"
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
    """Return a note on each point that is skipped because a coordinate is empty."""
    return [
        f"{observation.label}: a coordinate of target {target} is empty; skipped"
        for observation in observations
        for target, states in observation.points.items()
        if any(point.lacks_coordinate for point in states.values())
    ]


def _check_sigmas(observations: list[ObservationRecord], faults: Faults) -> dict[_Uncertainty, int]:
    """Return the number of points with an uncertainty of their coordinates, and of points with one for all.

    The keys are `coordinate` and `point`; a kind without points is left out. A fault is reported if some
    positions have an uncertainty and others have none.
    """
    counts: dict[_Uncertainty, int] = {}
    places_without: list[Place] = []
    for quantity, value in (
        (key, value) for observation in observations for key, value in observation.values.items()
    ):
        if value.sigma is not None:
            kind: _Uncertainty = "point" if value.by_point else "coordinate"
            counts[kind] = counts.get(kind, 0) + 1
        elif value.vector is not None and quantity.kind == "position":
            places_without.append(value.place)
    if counts and places_without:
        reason = "the point has no uncertainty, but other points have one"
        faults.report(
            places_without[0],
            reason,
            "add the uncertainty of this point, or skip the columns of U(95) with `ignore`",
        )
    return dict(sorted(counts.items()))


def _find_unusual_values(observations: list[ObservationRecord]) -> Iterator[str]:
    """Yield a sentence for each value that is farther than 100 spreads from the median of its column.

    The spread is the standard deviation of the nine tenths of the values that are nearest to the median, or
    the size of the median if these values are all equal.
    """
    columns: dict[str, list[tuple[float, Place]]] = {}
    for (kind, target, state), value in (
        item for observation in observations for item in observation.values.items()
    ):
        name = f"{target} {state}" if target else kind
        for axis, number in enumerate(value.vector or ()):
            part = str(axis + 1) if kind == "joint" else "xyz"[axis]
            columns.setdefault(f"{name} {part}", []).append((number, value.place))
    for name, values in columns.items():
        if len(values) < _MIN_VALUES:
            continue
        median_value = median(value for value, _ in values)
        sorted_by_distance = sorted(values, key=lambda entry: abs(entry[0] - median_value))
        nearest = sorted_by_distance[: -max(1, len(sorted_by_distance) // 10)]
        spread = pstdev(value for value, _ in nearest) or abs(median_value)
        for number, place in sorted_by_distance[len(nearest) :]:
            spreads = abs(number - median_value) / spread if spread else 0.0
            # 0.99: a value whose distance is the limit itself is listed despite rounding.
            if spreads > 0.99 * _MAX_SPREADS:
                distance = (
                    f"{spreads:.0f} times the spread of the other values away from the median (up to "
                    f"{_MAX_SPREADS:g} times is plausible)"
                )
                yield f"{name} {number:g} ({place}) is {distance}"
