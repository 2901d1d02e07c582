"""Digital calibration certificates (DCC, PTB's XML schema), read as tables of their quantities.

Lists of values (`si:realListXMLList`) of one length are the columns of a table. Lists (`dcc:list`) of single
values (`si:real`) with the same names are its rows. Of a quantity in several units (`si:hybrid`) the first is
read, which the schema requires to be in SI units. Uncertainties are not read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.imports import FilePreview
from jointstiff.service.importing import grid, limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.formats.elements import Element, read_elements
from jointstiff.service.importing.grid import Grid, Row, write_ascii_minus

_DCC: Final = "https://ptb.de/dcc "
_SI: Final = "https://ptb.de/si "
_ROOT: Final = f"{_DCC}digitalCalibrationCertificate"
_QUANTITY: Final = f"{_DCC}quantity"
_LIST: Final = f"{_DCC}list"
_RESULT: Final = f"{_DCC}result"
_LEAST_ROWS: Final = 3
_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        r"\metre": "m",
        r"\milli\metre": "mm",
        r"\inch": "in",
        r"\radian": "rad",
        r"\degree": "deg",
        r"\newton": "N",
        r"\kilo\newton": "kN",
        r"\newton\metre": "N.m",
        r"\kilogram": "kg",
    }
)
"""Units of the D-SI data model as headers have them."""


@dataclass(frozen=True)
class _Column:
    """Values of a quantity."""

    name: str
    result: str  # name of its result
    unit: str  # in brackets after a blank, as in a header; empty without one
    values: tuple[str, ...]


def read_certificate(file: str, content: bytes) -> list[Grid]:
    """Return the tables of a certificate: one for each number of rows.

    Raises:
        ImportFileError: the XML is damaged or beyond a limit, lists differ in length or unit, or there is no
            table.
    """
    root = read_elements(file, content)
    if root.tag != _ROOT:
        remedy = "export the readings as CSV, text or .xlsx"
        raise ImportFileError(Place(file, root.line), "the file is no calibration certificate", remedy)
    tables = [*_read_columns(file, root), *_read_rows(file, root)]
    if not tables:
        reason = f"the certificate has no list of {_LEAST_ROWS} values"
        raise ImportFileError(Place(file), reason, "check that this is the right file")
    return [_build_grid(file, table, is_only=len(tables) == 1) for table in tables]


def _read_columns(file: str, root: Element) -> Iterator[list[tuple[str, ...]]]:
    """Yield the tables of lists: for each length a header and rows."""
    columns = [column for result in root.walk(_RESULT) for column in _read_lists(file, result)]
    counts = {len(column.values) for column in columns if len(column.values) >= _LEAST_ROWS}
    for count in sorted(counts, reverse=True):
        alike = [column for column in columns if len(column.values) == count]
        names = Counter(column.name for column in alike)
        header = []
        for column in alike:
            is_repeated = names[column.name] > 1
            name = f"{column.result} {column.name}" if is_repeated else column.name
            header.append(f"{name}{column.unit}")
        _refuse_repeated(file, header)
        yield [tuple(header), *zip(*(column.values for column in alike), strict=True)]


def _read_lists(file: str, result: Element) -> Iterator[_Column]:
    """Yield the quantities of a result that are lists of values.

    Raises:
        ImportFileError: quantities of one list have different numbers of values.
    """
    for parent in result.walk(_LIST):
        lengths = set()
        for quantity in (child for child in parent.children if child.tag == _QUANTITY):
            column = _read_list(file, quantity, _name_of(result))
            if column is not None and len(column.values) > 1:
                lengths.add(len(column.values))
                yield column
        if len(lengths) > 1:
            counts = " and ".join(map(str, sorted(lengths)))
            reason = f"quantities of one list have {counts} values"
            raise ImportFileError(Place(file, parent.line), reason, "export the certificate again")


def _read_list(file: str, quantity: Element, result: str) -> _Column | None:
    """Return the values of a quantity; None if it has no list."""
    texts = quantity.find(f"{_DCC}charsXMLList")
    if texts is not None:
        values, unit = tuple(texts.text.split()), ""
    else:
        numbers = _find_value(quantity, f"{_SI}realListXMLList")
        if numbers is None:
            return None
        values = tuple(_text_of(numbers, f"{_SI}valueXMLList").split())
        unit = _read_unit(file, numbers, _text_of(numbers, f"{_SI}unitXMLList").split())
    return _Column(_name_of(quantity), result, unit, values)


def _read_rows(file: str, root: Element) -> Iterator[list[tuple[str, ...]]]:
    """Yield the tables of single values: a row for each list with the same names.

    Raises:
        ImportFileError: a quantity has several units.
    """
    tables: dict[tuple[str, ...], dict[tuple[str, ...], list[tuple[str, ...]]]] = {}
    for parent in root.walk(_LIST):
        names, header, values = ["name"], ["name"], [_name_of(parent)]
        for quantity in (child for child in parent.children if child.tag == _QUANTITY):
            single = _find_value(quantity, f"{_SI}real")
            if single is not None:
                unit = _read_unit(file, single, [_text_of(single, f"{_SI}unit")])
                names.append(_name_of(quantity))
                header.append(f"{_name_of(quantity)}{unit}")
                values.append(_text_of(single, f"{_SI}value"))
        if len(names) > 1:
            tables.setdefault(tuple(names), {}).setdefault(tuple(header), []).append(tuple(values))
    for headers in tables.values():
        if len(headers) > 1:
            reason = f"quantities have several units: {quote('; '.join(map(', '.join, headers)))}"
            raise ImportFileError(Place(file), reason, "export each quantity in one unit")
        header_of_all, rows = next(iter(headers.items()))
        if len(rows) >= _LEAST_ROWS:
            _refuse_repeated(file, header_of_all)
            yield [header_of_all, *rows]


def _find_value(quantity: Element, tag: str) -> Element | None:
    """Return the element with the values of a quantity; the first of a hybrid one."""
    hybrid = quantity.find(f"{_SI}hybrid")
    return (quantity if hybrid is None else hybrid).find(tag)


def _name_of(element: Element) -> str:
    """Return the name of a quantity, list or result, the first of its languages; empty without one."""
    names = element.find(f"{_DCC}name")
    content = None if names is None else names.find(f"{_DCC}content")
    return "" if content is None else " ".join(content.text.split())


def _text_of(parent: Element, tag: str) -> str:
    """Return the text of a child; empty without such a child."""
    child = parent.find(tag)
    return "" if child is None else child.text


def _read_unit(file: str, values: Element, units: Sequence[str]) -> str:
    """Return a unit in brackets, as in a header; a unit that headers do not have is kept as it is written.

    Raises:
        ImportFileError: the values have several units.
    """
    stated = sorted(set(units) - {""})
    if len(stated) > 1:
        reason = f"a quantity has several units: {quote(', '.join(stated))}"
        raise ImportFileError(Place(file, values.line), reason, "export each quantity in one unit")
    if not stated or stated[0] == r"\one":
        return ""
    return f" [{_UNITS.get(stated[0], stated[0].replace(chr(92), ' ').strip())}]"


def _refuse_repeated(file: str, header: Sequence[str]) -> None:
    """Refuse two columns with the same header.

    Raises:
        ImportFileError: a header occurs twice.
    """
    name, count = Counter(header).most_common(1)[0]
    if count > 1:
        reason = f"two quantities have the name {quote(name)}"
        raise ImportFileError(Place(file), reason, "give each quantity, or its result, a name of its own")


def _build_grid(file: str, table: Sequence[tuple[str, ...]], *, is_only: bool) -> Grid:
    """Return a table as a grid.

    Raises:
        ImportFileError: the table or a cell is too large.
    """
    width, count = len(table[0]), len(table)
    if width > limits.MAX_COLUMNS or width * count > limits.MAX_CELLS or count > limits.MAX_ROWS:
        raise grid.too_large_error(file, 1)
    for number, cells in enumerate(table, 1):
        longest = max(cells, key=len)
        if len(longest) > limits.MAX_CELL_LENGTH:
            reason = f"a cell has more than {limits.MAX_CELL_LENGTH} characters: {quote(longest)}"
            raise ImportFileError(Place(file, number), reason, "shorten the name or value")
    note = f"{count - 1} rows of the quantities of a calibration certificate were read, without uncertainties"
    sheet = None if is_only else f"{count - 1} rows of {width} quantities"
    preview = FilePreview(file=file, format="text", encoding="utf-8", sheet=sheet, assumptions=[note])
    rows = (Row(number, tuple(map(write_ascii_minus, cells))) for number, cells in enumerate(table, 1))
    return Grid(preview, tuple(rows))
