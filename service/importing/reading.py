"""Files to readings: the way through all of this package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from jointstiff.schemas.importing import ImportOptions
from jointstiff.service.importing.assembly import Assembly, assemble
from jointstiff.service.importing.columns import spoken
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.file_types import JSON, WORKBOOK, file_type
from jointstiff.service.importing.grid import Grid
from jointstiff.service.importing.header import collapsed
from jointstiff.service.importing.layout import Layout, lay_out
from jointstiff.service.importing.limits import MAX_FILE_BYTES, MAX_FILES, MAX_LINES
from jointstiff.service.importing.names import labels_in_order, names_of
from jointstiff.service.importing.records import RowReader
from jointstiff.service.importing.surroundings import Surroundings
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

    assembly: Assembly  # the observations
    units: Mapping[str, str]  # units by dimension, of all numbers that occur
    surroundings: Surroundings  # times and temperatures


@dataclass(frozen=True)
class Understood:
    """Content of files as far as it was understood."""

    layouts: tuple[Layout, ...]  # layouts of the files whose rows were found
    faults: tuple[ImportFileError, ...]  # what was not; at most `MAX_FAULTS`
    imported: Imported | None  # their content, if there are no faults


def understand_files(files: Sequence[SourceFile], options: ImportOptions = _NO_OPTIONS) -> Understood:
    """Understand files of readings: tables of a campaign, lists of points, or both, matched by label.

    Returns:
        What was understood, and what is not understood, contradictory or ambiguous, each with its place.
    """
    faults = Faults()
    reader = _Reader(options, faults)
    assembly = None
    with faults.collected():
        if not 0 < len(files) <= MAX_FILES:
            raise ImportFileError(Place(), f"{len(files)} files", f"send 1 to {MAX_FILES} files")
        names: set[str] = set()
        total = lines = 0
        for file in files:
            if file.name in names:
                raise ImportFileError(Place(file.name), "two files have this name", "send each file once")
            names.add(file.name)
            total += len(file.content)
            if total > MAX_FILE_BYTES:
                limit = f"the files exceed {MAX_FILE_BYTES // 1024**2} MiB together"
                raise ImportFileError(Place(file.name), limit, "import fewer files at once")
            lines += _line_ends(file.content)
            if lines > MAX_LINES:
                limit = f"the files have more than {MAX_LINES} lines together, empty ones and comments too"
                raise ImportFileError(Place(file.name), limit, "remove those, or import fewer files at once")
        assembly = reader.read(files)
    imported = None if assembly is None else Imported(assembly, reader.units, reader.surroundings)
    return Understood(tuple(reader.layouts), tuple(faults.found), imported)


class _Reader:
    """All files of an import, one after the other."""

    def __init__(self, options: ImportOptions, faults: Faults) -> None:
        self._options, self._faults = options, faults
        self._frames: dict[str, str | None] = {}
        self.layouts: list[Layout] = []  # of the files whose rows were found
        self.units: dict[str, str] = {}  # by dimension, of all numbers that occur
        self.surroundings = Surroundings()

    def read(self, files: Sequence[SourceFile]) -> Assembly | None:
        """Read all files; None if there are faults."""
        for file in files:
            with self._faults.collected():
                self.layouts.append(lay_out(_grid(file, self._options), self._options, self._faults))
                self._compare(self.layouts[-1])
        sound = all(not one.columns.faulty for one in self.layouts) and len(self.layouts) == len(files)
        if sound:
            self._check_options()
        labels = labels_in_order(self.layouts, self._faults) if sound and self._options.by_order else []
        notes: list[str] = []
        readers = []
        for layout in self.layouts:
            columns = layout.columns
            if layout.mark is not None and not columns.faulty and (labels or "name" in columns.texts):
                with self._faults.collected():
                    names = names_of(layout, self._options, notes)
                    readers.append(RowReader(layout, names, labels, self.surroundings))
        records = (record for reader in readers for record in reader.records(self._faults))
        if self.units.get("length") == "in":
            self.units["length"] = "mm"
        content = assemble(records, self._faults, allow_missing=self._options.allow_missing)
        notes = [*notes, *(content.assumptions if content else ()), *self.surroundings.notes]
        if content and content.held_out:
            notes.append(f"held out from the fit, to judge it: {', '.join(content.held_out)}")
        doubts = [layout.doubt for layout in self.layouts if layout.doubt]
        return content and replace(content, assumptions=tuple(notes), unusual=(*doubts, *content.unusual))

    def _check_options(self) -> None:
        """Refuse what the caller states of names and headers that no file has."""
        naming = [layout.columns for layout in self.layouts if layout.columns.needed]
        for option in ("point_name", "file_name"):
            text = getattr(self._options, option) or ""
            kinds = [kind for kind in ("target", "state") if f"{{{kind}}}" in text]
            twice = [kind for kind in kinds for one in naming if kind not in {*one.needed, *one.texts}]
            if text and (twice or not naming):
                what = " and ".join(twice or ["target", "state"])
                reason = f"the template {shown(text)} is not needed: headers or columns give the {what}"
                self._faults.report(Place(), reason, f"correct it, or omit `{option}`", option)
        known = {collapsed(header) for layout in self.layouts for header in layout.headers}
        if self._options.layouts or "" in known:
            return
        for option in ("columns", "ignore"):
            for header in getattr(self._options, option):
                if collapsed(header) not in known:
                    reason = f"no file has the header {shown(header)}, which `{option}` names"
                    self._faults.report(Place(), reason, "write it as the file does", option)

    def _compare(self, layout: Layout) -> None:
        """Refuse a file in other units or in another frame than those before it."""
        place = Place(layout.grid.file)
        for dimension, unit in layout.columns.units.items():
            if self.units.setdefault(dimension, unit) != unit:
                other = spoken(self.units[dimension])
                reason = f"the unit of {dimension} is {spoken(unit)}, but {other} in other files"
                self._faults.report(place, reason, "use one unit for every quantity")
        if any(quantity.kind == "position" for quantity in layout.columns.quantities):
            before = self._frames.setdefault("frame", layout.frame)
            if before != layout.frame:
                frames = layout.frame or "not named", before or "not named"
                reason = f"the frame is {frames[0]}, but {frames[1]} in other files"
                remedy = "export all in one frame; add a line `# Frame: NAME` to a file that names none"
                self._faults.report(place, reason, remedy)


def _grid(file: SourceFile, options: ImportOptions) -> Grid:
    if not file.content.strip():
        raise ImportFileError(Place(file.name), "the file is empty", "check the export")
    kind = file_type(file.content)
    if kind == WORKBOOK:
        return read_workbook(file.name, file.content, options.sheet)
    if kind is not None:
        remedy = "export the readings as CSV, text or .xlsx"
        if kind == JSON:
            remedy = "a campaign needs no import: `jointstiff identify` runs it, `jointstiff post` posts it"
        raise ImportFileError(Place(file.name), f"the file is {kind}, not a table", remedy)
    return read_text(file.name, file.content, options.delimiter)


def _line_ends(content: bytes) -> int:
    """Return the line ends of a text, in UTF-16 as well; a workbook's bytes have few by chance."""
    return sum(map(content.count, (b"\n", b"\r"))) - sum(map(content.count, (b"\r\n", b"\r\0\n")))
