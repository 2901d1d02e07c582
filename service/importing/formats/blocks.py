"""Texts of several blocks: a table in each, or a block for each posture with rows of joints and targets."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final, NamedTuple

from jointstiff.schemas.imports import Delimiter, FilePreview
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import lacks_number
from jointstiff.service.importing.grid import (
    COORDINATES,
    LEAST_NUMBERS,
    Grid,
    NumberedLine,
    Row,
    count_numbers,
    find_delimiter,
    is_comment,
    looks_like_a_number,
    split_line,
    strip_comment_mark,
)
from jointstiff.service.importing.texts.encoding import decode
from jointstiff.service.importing.texts.joint_positions import name_angles
from jointstiff.service.importing.texts.time_stamps import split_time_stamp

_LEAST_BLOCKS: Final = 3
"""Postures, at least, each with a block."""
_LEAST_ROWS: Final = 3
"""Rows of a table in a block."""
_MOST_NOT_ALIKE: Final = 0.34
"""Largest fraction of the blocks that may differ from the others, as incomplete postures do."""
_LEAST_VALUES: Final = 4
"""Numbers that titles of a block name, at least: an arm has four joints or more."""
_MOST_CHARACTERS: Final = 2000
"""Characters of a line in which names, numbers and lists are sought."""
_MISSING: Final = "NaN"
"""Mark of a number of a row that is missing."""
_SIGNS_OF_VALUES: Final = "=:"
"""Signs that may be between a name and its number."""
_SIGN: Final = re.compile(r"(?<![\w.])([^\W\d]\w{0,15})[=:](?=[ \t]{0,3}[-+]?\d)")
"""A name with its sign before a number."""
_UNIT_BEHIND: Final = re.compile(
    r"(?<![\w.])([^\W\d]\w{0,15})[=:][ \t]{0,3}([-+]?\d[\d.,]{0,30})[ \t]{0,3}(mm|m|deg|°|rad)(?!\w)"
)
"""A name, its sign and number, and a unit."""
_SEPARATOR: Final = re.compile(r"[;|]|,(?=\s)")
_VALUE_SEPARATOR: Final = re.compile(r"[;|=\s]+|(?<!\d):|,(?=\s)|(?<=[^\W\d]),|,(?=[^,\s]*\.[^,\s]*(?:,|$))")
"""Separators of names and numbers in a title, such as a comma between digits if points are decimal."""
_RANGE: Final = re.compile(
    r"(?P<name>[^\W\d]{1,8})(?P<first>[01])\s?(?:-|–|…|\.{2,3}|to|bis)\s?(?P=name)?(?P<last>\d)(?P<rest>.{0,20})"
)
"""Names of joints, such as `J1-J6 [deg]` or `A1…6`."""
_SLASHED: Final = re.compile(
    r"[(\[{][ \t]{0,3}"
    r"([-+]?\d[\d.,]{0,20}(?:[ \t]{0,3}[/|][ \t]{0,3}[-+]?\d[\d.,]{0,20}){3,31})"
    r"[ \t]{0,3}[)\]}]"
)
"""Four numbers or more between slashes in brackets, as in `J = (34,2 / 22,7 / 58,4 / -31,5)`."""
_DECIMAL_COMMA: Final = re.compile(r"[-+]?\d+,\d+")
_SLASH: Final = re.compile(r"[ \t]*[/|][ \t]*")
_ADORNMENT: Final = " \t-=*~_<>+"
"""Signs around a title."""
_NUMBER: Final = re.compile(r"[-+]?\d+(?:[.,]\d+)?")


@dataclass(frozen=True)
class _Block:
    """Lines of a text without a blank line between them."""

    titles: tuple[Row, ...]  # rows above the data, with fewer than three numbers, and comments
    rows: tuple[tuple[Row, Row | None], ...]  # rows of data, each with the row of texts above it
    values: Row | None = None  # numbers that titles name, each behind its name

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells with numbers in each row of data."""
        return tuple(len(_pick_numbers(row)) for row, _ in self.rows)

    @property
    def widths(self) -> set[int]:
        """Numbers of cells of the rows of data."""
        return {len(row.cells) for row, _ in self.rows}

    @property
    def header(self) -> Row | None:
        """Row of texts above the first row of data, if it has as many cells."""
        first, above = self.rows[0]
        return above if above is not None and len(above.cells) == len(first.cells) else None

    @property
    def title(self) -> str:
        """Text of the last title that is no header; empty without one."""
        titles = [row for row in self.titles if row is not self.header]
        return " ".join(cell for cell in titles[-1].cells if cell) if titles else ""


def read_blocks(file: str, content: bytes, delimiter: Delimiter | None) -> list[Grid]:
    """Return a table for each block of a text, or one table of blocks that are a posture each.

    No table is returned of a text that is no such list of blocks.

    Raises:
        ImportFileError: a posture has other rows than the others.
    """
    text, encoding = decode(file, content)
    numbered = enumerate(re.split(r"\r\n|\n|\r", text), 1)
    lines = [(number, part) for number, line in numbered for part in _write_slashed_list(line)]
    filled = [line for line in lines if line[1].strip() and not is_comment(line[1])]
    if not filled:
        return []
    return _read_split_blocks(file, encoding, lines, filled, delimiter) or _read_log(file, encoding, lines)


def _write_slashed_list(line: str) -> Iterator[str]:
    """Yield a line with a list between slashes as its title, and as the name of the list with its numbers.

    `Pose 1: J = (1,5 / 2,5 / …)` gives `Pose 1:` and `J 1,5 2,5 …`; any other line is yielded unchanged.
    """
    found = _SLASHED.search(line[:_MOST_CHARACTERS])
    if found is None:
        yield line
        return
    title, _, name = line[: found.start()].rstrip(" \t=:").rpartition(" ")
    if title.strip():
        yield title
    yield f"{name} {_SLASH.sub(' ', found[1])} {line[found.end() :]}".strip()


def _read_split_blocks(
    file: str,
    encoding: str,
    lines: Sequence[NumberedLine],
    filled: Sequence[NumberedLine],
    delimiter: Delimiter | None,
) -> list[Grid]:
    """Return the tables of blocks between blank lines, or else below titles; `filled` are lines with texts.

    Raises:
        ImportFileError: a posture has other rows than the others.
    """
    for split in (_split_blocks, _split_at_titles):
        try:
            chosen = _choose_lines_of_numbers(filled) or filled
            if delimiter is None and _have_decimal_commas(chosen):
                delimiter = "whitespace"
            delimiter = delimiter or find_delimiter(file, chosen, are_marks_literal=True)
            blocks = [_read_block(file, block, delimiter) for block in split(lines)]
        except ImportFileError:
            return []
        preview = FilePreview(file=file, format="text", encoding=encoding, delimiter=delimiter)
        with_data = [block for block in blocks if block.rows]
        grids = (
            _join_postures(preview, with_data)
            or _join_postures(preview, _add_values(with_data))
            or _list_tables(preview, _add_lone_titles(blocks))
        )
        if grids:
            return grids
    return []


def _read_log(file: str, encoding: str, lines: Sequence[NumberedLine]) -> list[Grid]:
    """Return one table of a log with a joint position as robots write it, and lines of targets below it.

    Time stamps at the start of lines are no part of the names of rows.

    Raises:
        ImportFileError: a posture has other rows than the others.
    """
    lines = [(number, split_time_stamp(line)[1]) for number, line in lines]
    angles = {number: named for number, line in lines if (named := name_angles(line)) is not None}
    if len(angles) < _LEAST_BLOCKS:
        return []
    plain = [(number, angles.get(number) or _write_plainly(line)) for number, line in lines]
    parts = list(_split_at_titles(plain)) or _split_at(plain, angles)
    try:
        blocks = [_read_block(file, part, "whitespace") for part in parts]
    except ImportFileError:
        return []
    with_data = [block for block in blocks if block.rows]
    if not with_data or any(COORDINATES not in block.shape for block in with_data):
        return []
    return _join_postures(
        FilePreview(file=file, format="text", encoding=encoding), _order_rows(file, with_data)
    )


def _order_rows(file: str, blocks: Sequence[_Block]) -> list[_Block]:
    """Return blocks whose rows have the order of those of the first block, by the words of the rows.

    Blocks with other numbers of rows, or with a row twice, are returned unchanged.

    Raises:
        ImportFileError: a block with as many rows has a row with other words.
    """
    order = _list_words(blocks[0])
    ordered = list[_Block]()
    for block in blocks:
        words = _list_words(block)
        if len(set(words)) < len(words) or len(words) != len(order):
            return list(blocks)
        row_of_words = dict(zip(words, block.rows, strict=True))
        other = next((each for each in words if each not in order), None)
        if other is not None:
            place = Place(file, row_of_words[other][0].line)
            reason = f"the first block has no row {quote(' '.join(other))}"
            raise ImportFileError(place, reason, "give all postures the same rows")
        ordered.append(_Block(block.titles, tuple(row_of_words[each] for each in order)))
    return ordered


def _list_words(block: _Block) -> list[tuple[str, ...]]:
    """Return the texts of each row of data that are no numbers."""
    return [
        tuple(cell for cell in row.cells if not looks_like_a_number(cell) and cell != _MISSING)
        for row, _ in block.rows
    ]


def _split_at(lines: Sequence[NumberedLine], starts: Collection[int]) -> list[list[NumberedLine]]:
    """Return the lines of each block, which begin at the lines with some numbers; no blank lines."""
    blocks = list[list[NumberedLine]]()
    for number, line in lines:
        if number in starts:
            blocks.append([])
        if blocks and line.strip():
            blocks[-1].append((number, line))
    return blocks


def _write_plainly(line: str) -> str:
    """Return a line with blanks for separators and signs: `T1: X=1.5 mm; Y=…` gives `T1: X[mm] 1.5 Y…`.

    A title is returned without the signs that adorn it, as in `--- Pose 1 ---`.
    """
    if is_comment(line):
        return line
    if len(_NUMBER.findall(line)) < LEAST_NUMBERS:
        return line.strip(_ADORNMENT)
    return _SIGN.sub(r"\1 ", _UNIT_BEHIND.sub(r"\1[\3] \2", _SEPARATOR.sub(" ", line)))


def _have_decimal_commas(lines: Sequence[NumberedLine]) -> bool:
    """Return whether blanks separate the numbers of lines, three at least, and each comma is in a number."""
    cells_of_lines = [line.split() for _, line in lines]
    with_comma = [cell for cells in cells_of_lines for cell in cells if "," in cell]
    have_numbers = all(sum(map(looks_like_a_number, cells)) >= LEAST_NUMBERS for cells in cells_of_lines)
    return have_numbers and bool(with_comma) and all(map(_DECIMAL_COMMA.fullmatch, with_comma))


def _choose_lines_of_numbers(lines: Sequence[NumberedLine]) -> list[NumberedLine]:
    """Return the lines with more digits than letters: commas in titles are no delimiters."""
    return [
        (number, line)
        for number, line in lines
        if sum(map(str.isdigit, line)) > sum(map(str.isalpha, line))
        and len(_NUMBER.findall(line)) >= LEAST_NUMBERS
    ]


def write_postures(files: Sequence[tuple[str, bytes]]) -> tuple[str, bytes] | None:
    """Return one text of the texts of postures, a block for each; None unless they are alike.

    Args:
        files: name and content of each file, one for each posture; their names have different numbers.
    """
    numbered = _decode_numbered(files)
    if numbered is None:
        return None
    texts = list[str]()
    for name, text in numbered.texts.items():
        lines = [line for line in re.split(r"\r\n|\n|\r", text) if line.strip()]
        texts.append("\n".join([f"# {name.rpartition('.')[0] or name}", *_drop_comments_within(lines)]))
    joined = "\n\n".join(texts).encode()
    grids = read_blocks(numbered.name, joined, None)
    are_postures = len(grids) == 1 and len(grids[0].rows) == len(files) + 1
    return (numbered.name, joined) if are_postures else None


def join_numbered_texts(files: Sequence[tuple[str, bytes]]) -> tuple[str, bytes] | None:
    """Return one text of texts whose names differ in numbers, below each other; None of other files.

    Args:
        files: name and content of each file.
    """
    numbered = _decode_numbered(files)
    if numbered is None:
        return None
    return numbered.name, "\n\n".join(numbered.texts.values()).encode()


class _NumberedTexts(NamedTuple):
    """Texts of files whose names differ in numbers."""

    name: str  # of all files
    texts: Mapping[str, str]  # by the names of the files, in the order of their numbers


def _decode_numbered(files: Sequence[tuple[str, bytes]]) -> _NumberedTexts | None:
    """Return the texts of files whose names differ in numbers; None of other files, or of too few."""
    forms = {_NUMBER.sub("0", name) for name, _ in files}
    if len(files) < _LEAST_BLOCKS or len(forms) != 1:
        return None
    in_order = sorted(files, key=lambda file: [int(number) for number in re.findall(r"\d+", file[0])])
    try:
        texts = {name: decode(name, content)[0] for name, content in in_order}
    except ImportFileError:
        return None
    return _NumberedTexts(next(iter(forms)).replace("0", "…", 1), texts)


def _drop_comments_within(lines: Sequence[str]) -> Iterator[str]:
    """Yield lines without the comments below the first line that is no comment."""
    is_above = True
    for line in lines:
        is_remark = is_comment(line)
        is_above = is_above and is_remark
        if is_above or not is_remark:
            yield line


def _split_blocks(lines: Sequence[NumberedLine]) -> Iterator[list[NumberedLine]]:
    """Yield the lines of each block: blank lines are between blocks, and comments begin one."""
    block: list[NumberedLine] = []
    has_data = False  # whether the block has lines that are no comments
    for number, line in lines:
        is_remark = is_comment(line)
        if block and (not line.strip() or (is_remark and has_data)):
            yield block
            block, has_data = [], False
        if line.strip():
            block.append((number, line))
            has_data = has_data or not is_remark
    if block:
        yield block


def _split_at_titles(lines: Sequence[NumberedLine]) -> Iterator[list[NumberedLine]]:
    """Yield the lines of each block that begins with a title such as `Pose 1`; nothing without titles."""
    filled = [(number, line) for number, line in lines if line.strip()]
    forms = [_NUMBER.sub("0", line.strip()) for _, line in filled]
    has_letter = [any(map(str.isalpha, form)) and len(_NUMBER.findall(form)) == 1 for form in forms]
    titles = Counter(form for form, is_title in zip(forms, has_letter, strict=True) if is_title)
    title, count = titles.most_common(1)[0] if titles else ("", 0)
    if count < _LEAST_BLOCKS:
        return
    starts = [index for index, form in enumerate(forms) if form == title]
    for start, end in zip(starts, [*starts[1:], len(filled)], strict=True):
        yield filled[start:end]


def _read_block(file: str, lines: Sequence[NumberedLine], delimiter: Delimiter) -> _Block:
    """Return the rows of a block.

    Raises:
        ImportFileError: a line cannot be split into cells.
    """
    titles: list[Row] = []
    rows: list[tuple[Row, Row | None]] = []
    above: Row | None = None
    for number, line in lines:
        if is_comment(line):
            titles.append(Row(number, (strip_comment_mark(line.strip()),)))
            continue
        row = split_line(file, number, _write_blanks(line), delimiter, are_marks_literal=True)
        if count_numbers(row) >= LEAST_NUMBERS:
            rows.append((row, above))
            above = None
            continue
        if any(cell and lacks_number(cell) for cell in row.cells[1:]):
            continue
        above = row
        if not rows:
            titles.append(row)
    return _Block(tuple(titles), tuple(rows), _name_values_above(lines))


def _name_values_above(lines: Sequence[NumberedLine]) -> Row | None:
    """Return a row of the numbers that comments, and lines such as `J1 = 12.3`, name above the rows of data.

    Each number has its name before it. None without enough numbers with different names.
    """
    values = dict[str, str]()
    for _, line in lines:
        is_remark = is_comment(line)
        named = _name_values(strip_comment_mark(line.strip()) if is_remark else line)
        if not is_remark and len(named) >= LEAST_NUMBERS:
            break
        if any(name in values for name, _ in named):
            return None
        values.update(named)
    has_enough = len(values) >= _LEAST_VALUES
    return Row(lines[0][0], tuple(chain.from_iterable(values.items()))) if has_enough else None


def _name_values(text: str) -> list[tuple[str, str]]:
    """Return name and text of each number of a line; `J1-J3 [deg]; 1,5; 2,5; 3,5` names each joint."""
    words, numbers, named = list[str](), list[str](), list[tuple[str, str]]()
    for part in [*filter(None, _VALUE_SEPARATOR.split(text[:_MOST_CHARACTERS])), ""]:
        bare = part.strip("[](){}°,;")
        if looks_like_a_number(bare):
            numbers.append(bare)
            continue
        if numbers:
            named += zip(_count_names(" ".join(words), len(numbers)), numbers, strict=True)
            words, numbers = [], []
        words.append(part)
    return named


def _count_names(words: str, count: int) -> list[str]:
    """Return a name for each number behind some words: `J1-J6 [deg]` gives `J1 [deg]`, `J2 [deg]`, …."""
    found = _RANGE.fullmatch(words)
    if found is not None and int(found["last"]) - int(found["first"]) + 1 == count:
        return [f"{found['name']}{int(found['first']) + n}{found['rest']}" for n in range(count)]
    return [words] if count == 1 else [f"{words} {number}".strip() for number in range(1, count + 1)]


def _write_blanks(line: str) -> str:
    """Return a line with blanks for the signs between names and numbers: `J1=24.3` gives `J1 24.3`."""
    return _SIGN.sub(r"\1 ", line) if len(_SIGN.findall(line)) >= LEAST_NUMBERS else line


def _add_lone_titles(blocks: Sequence[_Block]) -> list[_Block]:
    """Return the blocks with data; a block of titles alone belongs to the block below it."""
    joined, titles = list[_Block](), tuple[Row, ...]()
    for block in blocks:
        if block.rows:
            joined.append(_Block((*titles, *block.titles), block.rows))
            titles = ()
        else:
            titles = block.titles
    return joined


def _add_values(blocks: Sequence[_Block]) -> list[_Block]:
    """Return the blocks with the numbers of their titles as the first row; none unless all have such numbers.

    The numbers are joints only if enough of them vary.
    """
    values = [block.values.cells[1::2] for block in blocks if block.values is not None]
    if len(values) < len(blocks) or len({len(own) for own in values}) != 1:
        return []
    varying = sum(len(set(column)) > 1 for column in zip(*values, strict=True))
    if varying < LEAST_NUMBERS:
        return []
    return [
        _Block(block.titles, ((block.values, None), *block.rows))
        for block in blocks
        if block.values is not None
    ]


# ---- a table in each block


def _list_tables(preview: FilePreview, blocks: Sequence[_Block]) -> list[Grid]:
    """Return a table for each block, if the blocks have other columns or other titles; else none."""
    are_tables = all(len(block.rows) >= _LEAST_ROWS and len(block.widths) == 1 for block in blocks)
    if len(blocks) < 2 or not are_tables:
        return []
    headers = {block.header.cells if block.header else tuple(block.widths) for block in blocks}
    titles = [block.title for block in blocks]
    if len(headers) == 1 and len(set(titles)) < len(titles):
        return []
    names = Counter(titles)
    grids = []
    for number, block in enumerate(blocks, 1):
        name = (
            block.title
            if block.title and names[block.title] == 1
            else f"block {number} {block.title}".strip()
        )
        above = [] if block.header is None else [block.header]
        rows = (*above, *(row for row, _ in block.rows))
        grids.append(Grid(preview.model_copy(update={"sheet": name}), rows))
    return grids


# ---- a block for each posture


def _join_postures(preview: FilePreview, blocks: Sequence[_Block]) -> list[Grid]:
    """Return one table with a row for each block, if its rows differ and the blocks are alike; else none.

    Raises:
        ImportFileError: a block has other rows than the others.
    """
    shapes = Counter(block.shape for block in blocks)
    shape, count = shapes.most_common(1)[0] if shapes else ((), 0)
    is_each_posture = len(shape) > 1 and len(set(shape)) > 1 and count >= _LEAST_BLOCKS
    if not is_each_posture or count < (1.0 - _MOST_NOT_ALIKE) * len(blocks):
        return []
    usual = next(block for block in blocks if block.shape == shape)
    blocks = [block if block.shape == shape else _fill_up(block, usual) for block in blocks]
    other = next((block for block in blocks if block.shape != shape), None)
    if other is not None:
        place = Place(preview.file, other.rows[0][0].line)
        reason = f"this block has {len(other.shape)} rows of numbers, and the others have {len(shape)}"
        if len(other.shape) == len(shape):
            reason = "the rows of this block have other numbers of cells than those of the others"
        raise ImportFileError(place, reason, "complete the block, or remove it")
    headers: list[str] = []
    for number in range(len(shape)):
        headers += _name_columns([block.rows[number] for block in blocks])
    labels = _list_labels(blocks)
    rows = []
    for number, block in enumerate(blocks):
        cells = [cell for row, _ in block.rows for cell in _pick_numbers(row)]
        own_label = [labels[number]] if labels else []
        rows.append(Row(block.rows[0][0].line, (*own_label, *cells)))
    header = Row(rows[0].line, (*(["label"] if labels else []), *headers))
    note = f"{len(blocks)} blocks of {len(shape)} rows were read as postures"
    return [Grid(preview.model_copy(update={"assumptions": [note]}), (header, *rows))]


def _fill_up(block: _Block, usual: _Block) -> _Block:
    """Return a block with an empty row for each target that the block lacks, by the words of its rows.

    Any other block is returned unchanged, as is one that lacks its only row of a number of cells: joints.
    """
    words, usual_words = _list_words(block), _list_words(usual)
    row_of_words = dict(zip(words, block.rows, strict=True))
    present = [each for each in usual_words if each in row_of_words]
    are_named = len(set(usual_words)) == len(usual_words) and words == present
    lacking = {len(_pick_numbers(row)) for row, _ in usual.rows} - set(block.shape)
    if not are_named or lacking:
        return block
    line = block.rows[0][0].line
    rows = [
        row_of_words.get(own_words, (Row(line, tuple(map(_clear_number, row.cells))), above))
        for own_words, (row, above) in zip(usual_words, usual.rows, strict=True)
    ]
    return replace(block, rows=tuple(rows))


def _clear_number(cell: str) -> str:
    """Return a mark for a missing number in place of a number; other texts unchanged."""
    return _MISSING if looks_like_a_number(cell) else cell


def _pick_numbers(row: Row) -> list[str]:
    """Return the cells of a row that are numbers, or marked as missing in place of another row's."""
    return [cell for cell in row.cells if looks_like_a_number(cell) or cell == _MISSING]


def _name_columns(rows: Sequence[tuple[Row, Row | None]]) -> list[str]:
    """Return the headers of the numbers in one row of each block: its common texts, and those above it."""
    first, above = rows[0]
    is_headed = above is not None and len(above.cells) == len(first.cells)
    common = [
        cell
        for column, cell in enumerate(first.cells)
        if cell and not looks_like_a_number(cell) and all(_has_cell(row, column, cell) for row, _ in rows)
    ]
    columns = [column for column, cell in enumerate(first.cells) if looks_like_a_number(cell)]
    names_before = [
        [cell for cell in first.cells[:column] if cell.strip(_SIGNS_OF_VALUES)][-1:] for column in columns
    ]
    own_names = [name for each in names_before for name in each]
    are_named = len(set(own_names)) == len(columns) and set(own_names) <= set(common)
    if are_named:
        before = " ".join(cell for cell in common if cell not in own_names and cell.strip(_SIGNS_OF_VALUES))
        return [f"{before.rstrip(':')} {name}".strip() for name in own_names]
    words = " ".join(common)
    words = words.rstrip(":")
    if is_headed and above is not None:
        return [f"{words} {above.cells[column]}".strip() for column in columns]
    if len(columns) == COORDINATES and words:
        return [f"{words} {axis}" for axis in "xyz"]
    return [f"{words} {number}".strip() if words else "" for number in range(1, len(columns) + 1)]


def _has_cell(row: Row, column: int, text: str) -> bool:
    """Return whether a row has a text in a column."""
    return column < len(row.cells) and row.cells[column] == text


def _list_labels(blocks: Sequence[_Block]) -> list[str]:
    """Return a title of each block, if they differ; else no labels.

    It is the first one, or that in the form of most first titles: a remark of the file may be above it.
    """
    titles = [_list_titles(block) or [""] for block in blocks]
    usual, _ = Counter(_NUMBER.sub("0", own[0]) for own in titles).most_common(1)[0]
    labels = [next((each for each in own if _NUMBER.sub("0", each) == usual), own[0]) for own in titles]
    return labels if all(labels) and len(set(labels)) == len(labels) else []


def _list_titles(block: _Block) -> list[str]:
    """Return the texts of the titles without numbers that they name: `Pos 2: A1=-37.44 …` gives `Pos 2`."""
    titles = []
    for row in block.titles:
        text = " ".join(filter(None, row.cells))
        signs = list(_SIGN.finditer(text[:_MOST_CHARACTERS]))
        name = text[: signs[0].start()].strip(" ,;:") if len(signs) >= _LEAST_VALUES else ""
        titles.append(name or text)
    return titles
