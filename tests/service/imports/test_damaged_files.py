"""Damaged tables: read right, refused or asked about, never misread, never another exception.

What is right is known by a reader that shares no code with the importer, knows the dialect of the file before
the damage, and accepts nothing but plain numbers below undamaged headers. Excel files are read by openpyxl.
"""

import csv
import io
import random
import re
import warnings
import zipfile
from collections import defaultdict
from dataclasses import dataclass

import openpyxl
import pytest
from support.importing_samples import CAMPAIGN, LONG, answered

from jointstiff.solver.errors import RequestError

TABLE = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
ROWS = [line.split(";") for line in LONG.splitlines()]
WORDS = ("label", "target", "state")
HEADERS = {*TABLE[0], *ROWS[0], *(f"J{number} [mm]" for number in range(1, 4))}
LARGEST_SPREAD = 0.1
"""Repeated readings of a position differ by less [mm]."""
PLAIN = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Sample:
    """A file before the damage."""

    rows: list[list[str]]
    delimiter: str
    mark: str = "."
    encoding: str = "utf-8"
    end: str = "\n"
    quoting: int = csv.QUOTE_MINIMAL

    @property
    def content(self):
        output = io.StringIO()
        writer = csv.writer(output, delimiter=self.delimiter, lineterminator=self.end, quoting=self.quoting)
        for row in self.rows:
            writer.writerow([cell.replace(".", self.mark) if PLAIN.fullmatch(cell) else cell for cell in row])
        return output.getvalue().encode(self.encoding)


SAMPLES = [
    Sample(TABLE, ";"),
    Sample(TABLE, ";", ",", end="\r\n"),
    Sample(TABLE, ","),
    Sample(TABLE, "\t", ",", "utf-16"),
    Sample(TABLE, ",", ",", "utf-8-sig", quoting=csv.QUOTE_ALL),
    Sample(ROWS, ";"),
    Sample(ROWS, ","),
    Sample(ROWS, "\t", ","),
]


class UnclearError(Exception):
    """The strict reader cannot read the file either."""


def strict_text(sample, content):
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    text = content.decode(encoding)
    lines = [line for line in text.splitlines() if line.strip() and line.strip()[0] not in "#%!/"]
    rows = [next(csv.reader([line], delimiter=sample.delimiter)) for line in lines]
    rows = [[cell.strip() for cell in row] for row in rows]
    comma = sample.mark == ","
    if comma and any(PLAIN.fullmatch(cell) and "." in cell for row in rows[1:] for cell in row[1:]):
        raise UnclearError
    # Lines without numbers, and lines of one cell, are remarks.
    plain = [[cell.replace(",", ".") if comma else cell for cell in row] for row in rows[1:]]
    return gather(rows[0], [row for row in plain if len(row) > 1 and any(map(PLAIN.fullmatch, row))])


def gather(header, rows):
    """Return all numbers of a table by label, target, state and axis, as the headers say."""
    header = [
        " ".join(name.replace("[", " [").replace("[ ", "[").replace(" ]", "]").split()) for name in header
    ]
    if not HEADERS.issuperset(header):
        raise UnclearError
    found = defaultdict(lambda: defaultdict(list))
    for row in rows:
        cells = dict(zip(header, row + [""] * (len(header) - len(row)), strict=True))
        texts = defaultdict(dict)
        for name in header:
            if name not in WORDS:
                key, axis = key_and_axis(name, cells)
                texts[key][axis] = cells[name]
        for key, axes in texts.items():
            if not any(axes.values()):
                continue  # a position without numbers was not read
            for axis, text in axes.items():
                found[key][axis].append(number(text))
    return {key: tuple(map(join, (axes[axis] for axis in sorted(axes)))) for key, axes in found.items()}


def number(text):
    if not PLAIN.fullmatch(text):
        raise UnclearError
    return float(text)


def join(repeats):
    """Return the mean of repeated numbers, which may differ as docs/import.md says."""
    if max(repeats) - min(repeats) > LARGEST_SPREAD:
        raise UnclearError
    return sum(repeats) / len(repeats)


def as_name(cell):
    """Return a name as spreadsheets write names that are numbers."""
    return f"{float(cell):.12g}" if PLAIN.fullmatch(cell) else cell


def key_and_axis(name, cells):
    """Return what a header names: label, quantity or target, and state; then the joint or the axis."""
    words = name.split()
    if words[0][0] in "JF":
        return (as_name(cells["label"]), words[0][0]), words[0][1]
    if len(words) == 2:
        return (as_name(cells["label"]), as_name(cells["target"]), cells["state"].lower()), words[0]
    return (as_name(cells["label"]), words[0], words[1]), words[2]


def numbers(answer):
    """Return all numbers of a measurement set in the same form."""
    found = {}
    for one in answer.measurement_set.observations:
        label = as_name(one.label)
        found[label, "J"], found[label, "F"] = tuple(one.joints), tuple(one.force)
        for reading in one.readings:
            for state in ("unloaded", "loaded", "unloaded_after"):
                if (position := getattr(reading, state)) is not None:
                    found[label, as_name(reading.target), state] = tuple(position)
    return found


CHARACTERS = [c.encode() for c in ",.;:\t \"'#-+eE0123456789%/_[]()xyzul\n\r"]
CHARACTERS += [bytes([byte]) for byte in (0, 0xFF, 0x80, 0xC3, 0xA0)]


def replaced(random_, content):
    at = random_.randrange(len(content))
    return content[:at] + random_.choice(CHARACTERS) + content[at + 1 :]


def inserted(random_, content):
    at = random_.randrange(len(content) + 1)
    return content[:at] + random_.choice(CHARACTERS) + content[at:]


def deleted(random_, content):
    at = random_.randrange(len(content))
    return content[:at] + content[at + random_.choice((1, 1, 1, 2, 5, 20)) :] or b"x"


def truncated(random_, content):
    return content[: random_.randrange(1, len(content) + 1)]


def with_other_lines(random_, content):
    lines = content.split(b"\n")
    one, other = random_.randrange(len(lines)), random_.randrange(len(lines))
    kind = random_.randrange(4)
    if kind == 0:
        lines[one], lines[other] = lines[other], lines[one]
    elif kind == 1:
        lines.insert(one, lines[other])
    elif kind == 2 and len(lines) > 1:
        del lines[one]
    else:
        lines[one] += lines[other]
    return b"\n".join(lines) or b"x"


def with_other_cells(random_, content):
    """Exchange two cells, or put one in the place of another."""
    marks = [match.span() for match in re.finditer(rb"[^;,\t\r\n ]+", content)]
    if len(marks) < 2:
        return content
    (a, b), (c, d) = sorted(random_.sample(marks, 2))
    first, second = content[a:b], content[c:d]
    kept = first if random_.random() < 0.7 else second
    return content[:a] + second + content[b:c] + kept + content[d:]


DAMAGES = (replaced, replaced, inserted, inserted, deleted, truncated, with_other_lines, with_other_cells)


def damaged(random_, content):
    for _ in range(random_.choice((1, 1, 1, 2, 3))):
        content = random_.choice(DAMAGES)(random_, content)
    return content


def check(name, content, strict):
    """Import a file; return whether the numbers were accepted, which must be those of the strict reader."""
    try:
        answer = answered((name, content))
    except RequestError:
        return False
    if answer.questions or answer.faults or "were not read" in answer.sentence:
        return False
    try:
        expected = strict(content)
    except (UnclearError, KeyError, UnicodeDecodeError, csv.Error) as error:
        pytest.fail(f"accepted, though the strict reader refuses ({error!r}):\n{content[:2000]!r}")
    found = numbers(answer)
    assert found.keys() == expected.keys(), f"{found.keys() ^ expected.keys()} {content[:2000]!r}"
    for key, vector in expected.items():
        assert found[key] == pytest.approx(vector, rel=1e-12, abs=0.02 if key[1] == "J" else 1e-12), (
            key,
            content[:2000],
        )
    return True


@pytest.mark.parametrize("number", range(len(SAMPLES)))
def test_the_strict_reader_reads_undamaged_files(number):
    assert check("a.csv", SAMPLES[number].content, lambda content: strict_text(SAMPLES[number], content))


@pytest.mark.parametrize(
    ("seed", "count"), [(0, 400), pytest.param(20_261_201, 4_000, marks=pytest.mark.slow)]
)
def test_a_damaged_text_is_never_read_as_other_numbers(seed, count):
    random_ = random.Random(seed)  # noqa: S311
    accepted = 0
    for _ in range(count):
        sample = random_.choice(SAMPLES)
        content = damaged(random_, sample.content)
        accepted += check("a.csv", content, lambda content, sample=sample: strict_text(sample, content))
    assert 0.05 * count < accepted < 0.7 * count


def workbook():
    book = openpyxl.Workbook()
    for row in TABLE:
        book.active.append([float(cell) if PLAIN.fullmatch(cell) else cell for cell in row])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


SHEET = "xl/worksheets/sheet1.xml"


def with_part(content, name, change):
    """Return a workbook with one part changed, whose checksums are right."""
    output = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as old,
        zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for part in old.namelist():
            data = old.read(part)
            new.writestr(part, change(data) if part == name else data)
    return output.getvalue()


def strict_workbook(content):
    """Return what openpyxl reads; of a file that openpyxl refuses, the numbers before the damage."""
    try:
        sheet = openpyxl.load_workbook(io.BytesIO(content)).worksheets[0]
        cells = list(sheet.iter_rows(values_only=True))
    except Exception:  # noqa: BLE001 - openpyxl raises a dozen kinds of errors
        return gather(TABLE[0], TABLE[1:])
    header, *rows = [[("" if cell is None else str(cell)) for cell in row] for row in cells]
    return gather(header, [row for row in rows if any(row)])


@pytest.mark.process
@pytest.mark.parametrize(
    ("seed", "count"), [(1, 40), pytest.param(20_261_201, 2_000, marks=pytest.mark.slow)]
)
def test_a_damaged_workbook_is_never_read_as_other_numbers(seed, count):
    random_ = random.Random(seed)  # noqa: S311
    book = workbook()
    accepted = 0
    with warnings.catch_warnings():  # openpyxl warns of damaged files
        warnings.simplefilter("ignore")
        for _ in range(count):
            content = with_part(book, SHEET, lambda data: damaged(random_, data))
            accepted += check("a.xlsx", content, strict_workbook)
    assert accepted < count
