"""Reading of files into observations, whose values are merged by label from all files.

A value that occurs twice, contradicts another value or cannot be used is reported as a fault.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.schemas.gearbox import StepReadings
from jointstiff.schemas.imports import MAX_PREVIEW_ROWS, FilePreview, ImportOptions, ImportPreview, State
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import MAX_TARGETS
from jointstiff.schemas.robot import Body
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, quote
from jointstiff.service.importing.gaps import drop_incomplete_readings, report_skipped_points
from jointstiff.service.importing.grammar import (
    Quantity,
    collapse_blanks,
    find_unit_of_readings,
    fits_header,
    name_unit,
    split_along_target,
)
from jointstiff.service.importing.grid import Grid
from jointstiff.service.importing.header import Columns
from jointstiff.service.importing.layout import Layout, understand_table
from jointstiff.service.importing.masses import is_mass_table, read_mass_table
from jointstiff.service.importing.merging import Merging
from jointstiff.service.importing.rows import NameReader, ObservationRecord, RowReader, TimesAndRoundings
from jointstiff.service.importing.same_quantities import check_same_quantities, skip_incomplete_observations
from jointstiff.service.importing.source_files import SourceFile, check_files
from jointstiff.service.importing.source_grids import read_grids
from jointstiff.service.importing.unusual_values import describe_unusual_values
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
_STATES: Final[tuple[State, ...]] = ("unloaded", "loaded", "unloaded_after", "deflection")
_SINGLE_STATES: Final[tuple[list[State], ...]] = (["unloaded"], ["loaded"])
"""Positions in one state only, without a deflection."""


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
        check_files(files)
        return reader.read(files)
    # `collect` has kept an error that ended the block: the answer has the faults.
    return reader.build_answer()


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
        merger = Merging(self._options, self._units, self._joint_kinds(), self._faults, self._notes)
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
            observations, skipped = skip_incomplete_observations(observations)
        targets = _list_targets(observations)
        check_same_quantities(observations, self._faults)
        states = _list_present_states(observations)
        # Positions in one state only show no deflection, so that their readings cannot be complete.
        has_readings = states not in _SINGLE_STATES
        if targets and has_readings:
            observations, notes_on_gaps = drop_incomplete_readings(
                observations, targets, self._faults, self._options
            )
            skipped += notes_on_gaps
        else:
            skipped += report_skipped_points(observations)
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
            unusual=(*unsure_numbers, *describe_unusual_values(observations)),
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
