"""Files that were damaged: parsed right or refused, never misread, never another exception.

What is right is told by readers that share no code with the importer: for text, `_strict` below, which knows
the dialect and the columns of the file before it was damaged and takes nothing but plain numbers; for Excel,
openpyxl. A file that is accepted must have been read as they read it.
"""

import html
import io
import itertools
import random
import re
import warnings
import zipfile
from dataclasses import dataclass, field

import openpyxl
import pytest
from support.importing_samples import CAMPAIGN, DELIMITERS, MM, POINTS, Dialect, points_of, read, values_of

from jointstiff.service.importing.errors import ImportFileError

TABLE = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
UNDERSCORED = [cell.replace(" ", "_") for cell in TABLE[0]]
LIST = [line.split(";") for line in POINTS.splitlines()]
LONG = [
    ["label", "J1 [deg]", "Fx [N]", "Fy [N]", "Fz [N]", "target", "dx [mm]", "dy [mm]", "dz [mm]"],
    ["c01", "10.5", "0", "0", "-1471.5", "P10", "0.1115", "-0.2031", "-1.2160"],
    ["c01", "10.5", "0", "0", "-1471.5", "P11", "0.0915", "-0.1031", "-1.3160"],
    ["c02", "-7.25", "0", "0", "-1471.5", "P10", "0.2115", "0.2031", "-1.1161"],
    ["c02", "-7.25", "0", "0", "-1471.5", "P11", "0.3115", "0.1331", "-1.0161"],
]


@dataclass(frozen=True)
class Sample:
    """A file before it is damaged."""

    name: str
    rows: list[list[str]]
    dialect: Dialect
    options: dict[str, object] = field(default_factory=dict)

    @property
    def content(self) -> bytes:
        return self.dialect.write(self.rows)


SAMPLES = [
    Sample("table.csv", TABLE, Dialect("semicolon", ".")),
    Sample("table.csv", TABLE, Dialect("semicolon", ",", "latin-1", "\r\n")),
    Sample("table.csv", TABLE, Dialect("comma", ".")),
    Sample("table.txt", TABLE, Dialect("tab", ",", "utf-16")),
    Sample("table.txt", TABLE, Dialect("comma", ",", "utf-8-sig", quote=True)),
    Sample("table.txt", [UNDERSCORED, *TABLE[1:]], Dialect("whitespace", ".")),
    Sample("long.csv", LONG, Dialect("semicolon", ".")),
    Sample("long.csv", LONG, Dialect("comma", ".")),
    Sample("list.txt", LIST, Dialect("semicolon", "."), {"units": MM}),
    Sample("list.txt", LIST, Dialect("whitespace", ","), {"units": MM}),
    Sample("list.txt", LIST, Dialect("comma", "."), {"units": MM}),
    Sample("list.txt", [["y", "name", "z", "x"], *([r[2], r[0], r[3], r[1]] for r in LIST)],
           Dialect("semicolon", "."), {"units": MM}),
]  # fmt: skip

# ---- the independent reading ------------------------------------------------------------------------------

PLAIN = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
WORD = re.compile(r"[^\W\d_]+|\d+|°")
COLUMNS = {
    "".join(WORD.findall(cell.casefold())): cell
    for sample in SAMPLES
    if not PLAIN.fullmatch(sample.rows[0][-1])
    for cell in sample.rows[0]
}
COLUMNS |= {  # what docs/import.md allows besides: other words for the states, any order
    "".join(words) + "mm": f"P10 {state} {axis} [mm]"
    for axis in "xyz"
    for state, synonyms in (("unloaded", "unloaded unload ul u"), ("loaded", "loaded load ld l"))
    for synonym in synonyms.split()
    for words in itertools.permutations(("p", "10", synonym, axis))
}
COLUMNS |= {  # a state may be named twice
    f"{state[0]}p10{state}{axis}mm": f"P10 {state} {axis} [mm]"
    for axis in "xyz"
    for state in ("unloaded", "loaded")
}


STATES = {"unloaded": "unloaded", "unload": "unloaded", "u": "unloaded", "d": "deflection"}
STATES |= dict.fromkeys(("loaded", "load", "l"), "loaded")


class UnclearError(Exception):
    """The strict reader does not know either."""


def _strict(sample, content):
    """Numbers by label, and points, as the damaged text gives them when nothing is tolerated."""
    delimiter, comma = DELIMITERS[sample.dialect.delimiter], sample.dialect.mark == ","
    rows = []
    for line in re.split(r"\r\n|\r|\n", _decoded(content, sample.dialect.encoding)):
        if not line.strip() or line.strip().startswith(("#", "//", "%")):
            continue
        plain = re.split("[ \t]+", line.strip(" \t")) if delimiter == " " else line.split(delimiter)
        quoted = r'(?:"[^"]*"|[^"%s])+|(?<=%s)|^(?=%s)' % ((delimiter,) * 3)
        cells = (re.findall(quoted, line) if '"' in line else None) or plain
        rows.append([cell.strip().strip('"').strip() for cell in cells])
    rows = [row for row in rows if any(row)]
    alike = len({len(row) for row in rows}) == 1
    if alike and len(rows[0]) > 1 and not any(row[-1] for row in rows):
        rows = [row[:-1] for row in rows]
    if PLAIN.fullmatch(rows[0][-1].replace(",", ".")):
        header = ["name", "x", "y", "z"]
        if len(rows[0]) != 4:
            raise UnclearError
    else:
        header = [COLUMNS.get("".join(WORD.findall(cell.casefold()))) for cell in rows.pop(0)]
    return _gathered(header, rows, comma)


def _decoded(content, encoding):
    for mark, known in ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if content.startswith(mark):
            return content[len(mark) :].decode(known)
    if b"\0" in content[:4]:
        return content.decode("utf-16-le" if content[0] else "utf-16-be")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        try:
            return content.decode("cp1252" if any(0x80 <= byte < 0xA0 for byte in content) else "latin-1")
        except UnicodeDecodeError:
            return content.decode("latin-1")


def _gathered(header, rows, comma):
    values, points = {}, {}
    for row in rows:
        if len(row) != len(header):
            raise UnclearError
        texts = dict(zip(header, row, strict=True))
        label = texts.get("label", texts.get("name"))
        for name in set(texts) - {"label", "name", "target", None}:
            number = _number(texts[name], comma)
            key, axis = _key(name, label, texts)
            store = points if len(key) == 3 else values
            if store.setdefault(key, {}).setdefault(axis, number) != number:
                raise UnclearError
    return _vectors(values), _vectors(points)


def _number(text, comma):
    if comma and "." in text:
        raise UnclearError
    plain = text.replace(",", ".") if comma else text
    if not PLAIN.fullmatch(plain):
        raise UnclearError
    return float(plain)


def _key(name, label, texts):
    words = name.split("[")[0].replace("_", " ").split()
    if name[0] == "J":
        return (label, "joint"), int(words[0][1:])
    if name[0] == "F":
        return (label, "force"), words[0][1]
    if words[0] in ("dx", "dy", "dz"):
        return (label, texts["target"], "deflection"), words[0][1]
    if len(words) == 1:
        parts = label.split("::") if "::" in label else label.split("_")
        found = [part for part in parts if part.casefold() in STATES]
        if len(found) != 1 or len(parts) != 3:
            raise UnclearError
        rest = [part for part in parts if part not in found]
        return (rest[0], rest[1], STATES[found[0].casefold()]), words[0]
    return (label, words[0], words[1]), words[2]


def _vectors(store):
    return {key: tuple(axes[axis] for axis in sorted(axes)) for key, axes in store.items()}


# ---- damage -----------------------------------------------------------------------------------------------

CHARACTERS = [c.encode() for c in ",.;:\t \"'#-+eE0123456789%/_[]()xyzul\n\r"]
CHARACTERS += [bytes([byte]) for byte in (0, 0xFF, 0x80, 0xC3, 0xA0)]


def _damaged(random_, content):
    for _ in range(random_.choice((1, 1, 1, 2, 3))):
        content = random_.choice(DAMAGES)(random_, content)
    return content


def _replace(random_, content):
    at = random_.randrange(len(content))
    return content[:at] + random_.choice(CHARACTERS) + content[at + 1 :]


def _insert(random_, content):
    at = random_.randrange(len(content) + 1)
    return content[:at] + random_.choice(CHARACTERS) + content[at:]


def _delete(random_, content):
    at = random_.randrange(len(content))
    return content[:at] + content[at + random_.choice((1, 1, 1, 2, 5, 20)) :] or b"x"


def _flip(random_, content):
    at = random_.randrange(len(content))
    return content[:at] + bytes([content[at] ^ 1 << random_.randrange(8)]) + content[at + 1 :]


def _truncate(random_, content):
    return content[: random_.randrange(1, len(content) + 1)]


def _swap(random_, content):
    at = random_.randrange(max(1, len(content) - 1))
    return content[:at] + content[at + 1 : at + 2] + content[at : at + 1] + content[at + 2 :]


def _lines(random_, content):
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


def _cells(random_, content):
    """Two cells, anywhere, change places; or one takes the place of another."""
    marks = [match.span() for match in re.finditer(rb"[^;,\t\r\n ]+", content)]
    if len(marks) < 2:
        return content
    (a, b), (c, d) = sorted(random_.sample(marks, 2))
    first, second = content[a:b], content[c:d]
    kept = first if random_.random() < 0.7 else second
    return content[:a] + second + content[b:c] + kept + content[d:]


DAMAGES = [_replace, _replace, _insert, _insert, _delete, _flip, _truncate, _swap, _lines, _cells, _cells]


def _check_refusal(error, name):
    assert error.reason
    assert error.remedy
    assert error.place.file == name


def _check_text(random_, counts):
    sample = random_.choice(SAMPLES)
    content = _damaged(random_, sample.content)
    try:
        imported = read((sample.name, content), **sample.options)
    except ImportFileError as error:
        _check_refusal(error, sample.name)
        counts["refused"] += 1
        return
    try:
        expected = _strict(sample, content)
    except (UnclearError, KeyError, UnicodeDecodeError) as error:
        pytest.fail(f"accepted, though the strict reader refuses ({error!r}):\n{sample}\n{content!r}")
    assert (values_of(imported), points_of(imported)) == expected, (sample, content)
    assert not imported.preview.assumptions
    counts["same" if content == sample.content else "read"] += 1


def _workbook():
    book = openpyxl.Workbook()
    for row in TABLE:
        book.active.append([_value(cell) for cell in row])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def _value(cell):
    return float(cell) if PLAIN.fullmatch(cell) else cell


WORKBOOK = _workbook()
PARTS = ["xl/worksheets/sheet1.xml"] * 4 + ["xl/workbook.xml", "xl/_rels/workbook.xml.rels", "xl/styles.xml"]


def _check_excel(random_, counts):
    """Bytes of the archive, or of a part of it with checksums that are right again."""
    if random_.random() < 0.3:
        content = _damaged(random_, WORKBOOK)
    else:
        content = _with_part(random_.choice(PARTS), lambda data: _damaged(random_, data))
    try:
        imported = read(("a.xlsx", content))
    except ImportFileError as error:
        _check_refusal(error, "a.xlsx")
        counts["refused"] += 1
        return
    assert (values_of(imported), points_of(imported)) == _by_openpyxl(content)
    counts["read"] += 1


def _by_openpyxl(content):
    """What openpyxl reads; where it fails, what it reads of the cells alone, in a sound workbook."""
    try:
        sheet = openpyxl.load_workbook(io.BytesIO(content)).worksheets[0]
    except Exception:  # noqa: BLE001 - a dozen kinds
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            cells = re.search(rb"<sheetData>.*</sheetData>", archive.read(PARTS[0]), re.DOTALL)[0]
        main = b"http://schemas.openxmlformats.org/spreadsheetml/2006/main"
        whole = b'<worksheet xmlns="%s">%s</worksheet>' % (main, cells)
        sheet = openpyxl.load_workbook(io.BytesIO(_with_part(PARTS[0], lambda _: whole))).active
    header, *rows = (
        [("" if cell is None else str(cell)) for cell in row] for row in sheet.iter_rows(values_only=True)
    )
    header = [COLUMNS.get("".join(WORD.findall(cell.casefold()))) for cell in header]
    return _gathered(header, [row for row in rows if any(row) and row[0][:1] not in "#%/"], comma=False)


# ---- documents: what a reader of a few lines sees in the damaged page or text


def _page():
    rows = "\n".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in TABLE)
    return f"<html><body>\n<table>\n{rows}\n</table>\n</body></html>\n".encode()


def _latex():
    rows = "\n".join(" & ".join(_in_mathematics(cell) for cell in row) + r" \\" for row in TABLE)
    return f"\\begin{{tabular}}{{l}}\n{rows}\n\\end{{tabular}}\n".encode()


def _in_mathematics(cell):
    return f"${cell.replace('.', '{,}')}$" if PLAIN.fullmatch(cell) else cell


def _rows_of_page(text):
    """Rows of cells, as browsers show them: a tag ends what is open."""
    table = re.fullmatch(r".*?<table\b[^>]*>(.*)</table\b[^>]*>.*", text, re.DOTALL | re.IGNORECASE)
    if table is None or "<!--" in text:
        raise UnclearError
    cells = []
    rows = [cells]
    for part in re.split(r"(<[/?!a-zA-Z][^>]*>)", table[1]):
        if re.match(r"</?tr[\s/>]", part, re.IGNORECASE):
            cells = []
            rows.append(cells)
        elif re.match(r"<t[dh][\s/>]", part, re.IGNORECASE):
            cells.append("")
        elif not re.match(r"<[/?!a-zA-Z]", part) and (cells or part.strip()):
            if not cells:
                raise UnclearError
            cells[-1] += html.unescape(part)
    return [[" ".join(cell.split()) for cell in row] for row in rows], "."


def _rows_of_latex(text):
    """Rows of cells, as LaTeX prints them; no command but those of the table is known."""
    body = re.search(r"\\begin\s*\{tabular\}\s*\{[^{}]*\}(.*?)\\end\s*\{tabular\}", text, re.DOTALL)
    if body is None:
        raise UnclearError
    printed = re.sub(r"(?<!\\)((?:\\\\)*)%[^\n]*\n?[ \t]*", r"\1", body[1])
    rows = re.split(r"\\\\(?:\s*\[[^\[\]{}\n]*\])?", printed)
    cells = [re.split(r"(?<!\\)&", row) for row in rows]
    plain = [
        [re.sub(r"~|\\[ ,;:\n\t]", " ", re.sub(r"[{}$]|\\[-/!()]", "", cell)) for cell in row]
        for row in cells
    ]
    return [[" ".join(cell.split()) for cell in row] for row in plain], ","


DOCUMENTS = {"a.htm": (_page(), _rows_of_page), "a.tex": (_latex(), _rows_of_latex)}


def _check_document(random_, counts):
    name = random_.choice(list(DOCUMENTS))
    whole, rows_of = DOCUMENTS[name]
    content = _damaged(random_, whole)
    try:
        imported = read((name, content))
    except ImportFileError as error:
        _check_refusal(error, name)
        counts["refused"] += 1
        return
    try:
        rows, mark = rows_of(_decoded(content, "utf-8"))
        is_remark_named = any("rows of remarks" in note for note in imported.preview.files[0].assumptions)
        filled = [row for row in rows if any(row)]
        header, *rows = [row for row in filled if len(row) > 1 or not is_remark_named]
        header = [COLUMNS.get("".join(WORD.findall(cell.casefold()))) for cell in header]
        expected = _gathered(header, rows, comma=mark == ",")
    except (UnclearError, KeyError, UnicodeDecodeError) as error:
        pytest.fail(f"accepted, though the small reader refuses ({error!r}):\n{content!r}")
    assert (values_of(imported), points_of(imported)) == expected, content
    counts["same" if content == whole else "read"] += 1


def _with_part(name, change):
    output = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(WORKBOOK)) as old, zipfile.ZipFile(output, "w") as new:
        for part in old.namelist():
            data = old.read(part)
            new.writestr(part, change(data) if part == name else data)
    return output.getvalue()


def _run(check, seed, count):
    counts = dict.fromkeys(("refused", "read", "same"), 0)
    random_ = random.Random(seed)  # noqa: S311
    for _ in range(count):
        check(random_, counts)
    assert counts["read"] > 0.05 * count  # what is accepted is tested too
    assert counts["refused"] > 0.3 * count


def test_the_strict_reader_reads_what_is_not_damaged():
    for sample in SAMPLES:
        imported = read((sample.name, sample.content), **sample.options)
        assert (values_of(imported), points_of(imported)) == _strict(sample, sample.content)


@pytest.mark.parametrize(
    ("seed", "count"), [(0, 250), (1, 250), pytest.param(20_261_120, 10_000, marks=pytest.mark.slow)]
)
def test_damaged_texts(seed, count):
    _run(_check_text, seed, count)


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 100), pytest.param(20_261_120, 3_000, marks=pytest.mark.slow)]
)
def test_damaged_workbooks(seed, count):
    with warnings.catch_warnings():  # openpyxl's, of damaged files
        warnings.simplefilter("ignore")
        _run(_check_excel, seed, count)


@pytest.mark.parametrize(
    ("seed", "count"), [(2, 200), pytest.param(20_261_130, 10_000, marks=pytest.mark.slow)]
)
def test_damaged_documents(seed, count):
    _run(_check_document, seed, count)
