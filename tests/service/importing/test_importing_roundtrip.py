"""Whatever numbers are written, in whatever dialect, are read again, to the last bit."""

import io

import openpyxl
from hypothesis import assume, given
from hypothesis import strategies as st
from support.examples import examples
from support.importing_samples import Dialect, points_of, read, values_of

from jointstiff.service.importing.errors import ImportFileError

NUMBERS = st.one_of(
    st.floats(-1e12, 1e12, allow_nan=False),
    st.floats(-3000, 3000, allow_nan=False),
    st.integers(-10_000, 10_000).map(float),
    st.decimals(-3000, 3000, places=4).map(float),
)
NAMES = st.text(st.characters(codec="latin-1", categories=("L", "N")), min_size=1, max_size=8).map(
    lambda text: "n" + text
)
DIALECTS = st.builds(
    Dialect,
    delimiter=st.sampled_from(["comma", "semicolon", "tab", "whitespace"]),
    mark=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    quote=st.booleans(),
)


@st.composite
def campaigns(draw):
    """A header in some order, and numbers by label and meaning."""
    labels = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    targets = draw(st.lists(NAMES, max_size=3, unique_by=str.casefold))
    assume(not any(word in "sigma nominal" for word in targets))
    vectors = {"force": [f"F{axis} [N]" for axis in "xyz"]}
    vectors["joint"] = [f"J{number} [deg]" for number in range(1, 1 + draw(st.integers(1, 7)))]
    for target in targets:
        for state in ("unloaded", "loaded") if draw(st.booleans()) else ("deflection",):
            vectors[target, state] = [f"{target}_{state}_{axis} [mm]" for axis in "xyz"]
    header = draw(st.permutations(["label", *(name for names in vectors.values() for name in names)]))
    table = {label: {name: draw(NUMBERS) for name in header if name != "label"} for label in labels}
    return header, vectors, table


def expected(vectors, table):
    values, points = {}, {}
    for label, cells in table.items():
        for key, names in vectors.items():
            vector = tuple(cells[name] for name in names)
            if isinstance(key, str):
                values[label, key] = vector
            else:
                points[label, *key] = vector
    return values, points


@given(campaigns(), DIALECTS)
@examples(60)
def test_text(campaign, dialect):
    header, vectors, table = campaign
    rows = [
        header,
        *([label, *(repr(table[label][name]) for name in header if name != "label")] for label in table),
    ]
    place = header.index("label")
    rows = [header, *([*row[1 : place + 1], row[0], *row[place + 1 :]] for row in rows[1:])]
    content = dialect.write(rows)
    try:
        imported = read(("a.csv", content))
    except ImportFileError as error:
        if "thousands separator" not in error.reason:
            raise
        imported = read(("a.csv", content), decimal_mark="comma")
    assert (values_of(imported), points_of(imported)) == expected(vectors, table)
    file = imported.preview.files[0]
    assert file.delimiter == dialect.delimiter
    assert imported.preview.observation_count == len(table)


@given(campaigns())
@examples(20)
def test_excel(campaign):
    header, vectors, table = campaign
    book = openpyxl.Workbook()
    book.active.append(header)
    for label, cells in table.items():
        book.active.append([label if name == "label" else cells[name] for name in header])
    output = io.BytesIO()
    book.save(output)
    # openpyxl writes 16 digits, of which it reads these numbers again
    sheet = openpyxl.load_workbook(io.BytesIO(output.getvalue())).active
    stored = [dict(zip(header, row, strict=True)) for row in sheet.iter_rows(min_row=2, values_only=True)]
    imported = read(("a.xlsx", output.getvalue()))
    by_label = {row["label"]: row for row in stored}
    assert (values_of(imported), points_of(imported)) == expected(vectors, by_label)


@given(
    st.dictionaries(st.tuples(NAMES, NAMES, st.sampled_from(["unloaded", "loaded"])),
                    st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=8),
    DIALECTS, st.sampled_from(["_", "::"]),
)  # fmt: skip
@examples(60)
def test_points(points, dialect, separator):
    rows = [[separator.join(key), *map(repr, vector)] for key, vector in points.items()]
    options = {"units": {"length": "mm", "angle": "deg", "force": "N"}, "allow_missing": True}
    one_state = len({state for _, _, state in points}) == 1
    complete = {
        key: vector for key, vector in points.items()
        if one_state or {(*key[:2], "unloaded"), (*key[:2], "loaded")} <= set(points)
    }  # fmt: skip
    try:
        imported = read(("a.txt", dialect.write(rows)), **options)
    except ImportFileError as error:
        if "thousands separator" not in error.reason:
            if complete or "no observation has a reading" not in error.reason:
                raise
            return
        imported = read(("a.txt", dialect.write(rows)), decimal_mark="comma", **options)
    assert points_of(imported) == complete
