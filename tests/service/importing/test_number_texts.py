"""Signs and separators of thousands that people's programs write: read as the number, or refused."""

import pytest
from support.importing_samples import CAMPAIGN, CAMPAIGN_NUMBERS, JOINTS, answered, numbers_of, refusals
from support.workbooks import ROWS, arrays, parquet, workbook

MINUS_SIGNS = {"minus": "\u2212", "en dash": "\u2013", "full width": "\uff0d", "small": "\ufe63"}


@pytest.mark.parametrize("sign", MINUS_SIGNS.values(), ids=MINUS_SIGNS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_other_signs_of_minus_are_read_in_text_files(sign, encoding):
    text = CAMPAIGN.replace(";-", f";{sign}")
    assert numbers_of(answered(("a.csv", text.encode(encoding)))) == CAMPAIGN_NUMBERS


def test_a_dash_in_a_name_is_part_of_the_name():
    answer = answered(("a.csv", CAMPAIGN.replace("c01", "c\u20131")))
    assert numbers_of(answer)[0][0] == "c\u20131"


def texts(sign):
    """Return the rows of a campaign, with all numbers as texts with this minus."""
    return [ROWS[0], *([row[0], *(cell.replace("-", sign) for cell in row[1:])] for row in ROWS[1:])]


def in_columns(rows):
    return {name: [row[k] for row in rows[1:]] for k, name in enumerate(rows[0])}


@pytest.mark.parametrize(
    "content",
    [
        lambda: workbook(texts("\u2212")),
        pytest.param(lambda: parquet(in_columns(texts("\u2212"))), marks=pytest.mark.process),
        pytest.param(
            lambda: arrays(
                **{f"c{k}": [row[k] for row in texts("\u2212")[1:]] for k in range(len(ROWS[0]))},
            ),
            marks=pytest.mark.process,
        ),
    ],
    ids=["Excel", "Parquet", "MATLAB"],
)
def test_other_signs_of_minus_are_read_in_texts_of_sheets_and_arrays(content):
    file = "a.bin", content()
    columns = {f"c{k}": name for k, name in enumerate(ROWS[0])}
    is_matlab = file[1].startswith(b"MATLAB")
    assert numbers_of(
        answered(file, decimal_mark="point", **({"columns": columns} if is_matlab else {}))
    ) == (CAMPAIGN_NUMBERS)


def with_thousands(separator, mark):
    """Return the campaign with separators of thousands and this decimal mark, all numbers with decimals."""
    rows = []
    for line in CAMPAIGN.splitlines()[2:]:
        label, *cells = line.split(";")
        numbers = [f"{float(cell):,.4f}" for cell in cells]
        rows.append(";".join([label, *(n.translate({44: separator, 46: mark}) for n in numbers)]))
    return "\n".join([*CAMPAIGN.splitlines()[:2], *rows, ""])


@pytest.mark.parametrize(
    ("separator", "mark"),
    [(".", ","), (",", "."), ("'", "."), ("\u2019", ","), ("\u202f", ","), ("\xa0", ","), (" ", ",")],
)
def test_thousands_are_read_where_decimals_make_them_certain(separator, mark):
    text = with_thousands(separator, mark)
    assert f"1{separator}471{mark}5000" in text
    answer = answered(("a.csv", text))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].decimal_mark == {",": "comma", ".": "point"}[mark]
    stated = answered(("a.csv", text), decimal_mark=answer.files[0].decimal_mark)
    assert numbers_of(stated) == CAMPAIGN_NUMBERS


def test_thousands_in_texts_of_a_sheet_need_the_decimal_mark():
    rows = [line.split(";") for line in with_thousands(".", ",").splitlines()[1:]]
    file = "a.xlsx", workbook(rows)
    assert refusals(file)[-1].endswith("[decimal_mark]")
    assert numbers_of(answered(file, decimal_mark="comma")) == CAMPAIGN_NUMBERS


@pytest.mark.parametrize(
    ("cell", "fault"),
    [
        ("1.29,99", "decimal points and decimal commas"),
        ("1.299", "decimal points and decimal commas"),
        ("1,299.5", "decimal points and decimal commas"),
        ("1.299.5", "decimal points and decimal commas"),
        ("1299,5", "decimal points and decimal commas"),
        ("1'299", "is not a number with a decimal comma"),
    ],
)
def test_thousands_that_are_not_certain_are_refused(cell, fault):
    text = with_thousands(".", ",").replace("-1.471,5000", cell, 1)
    assert fault in refusals(("a.csv", text))[0]


def test_joints_of_two_files_are_compared_in_one_unit():
    in_radians = JOINTS.replace("deg", "rad").replace("10.5", "0.1").replace("-20.25", "-0.3")
    in_radians = in_radians.replace("-15", "-0.2").replace("-35.125", "-0.5")
    moved = (
        in_radians.replace("0.1,", "0.15,").replace(",Fx [N],Fy [N],Fz [N]", "").replace(",0,0,-1471.5", "")
    )
    (said,) = [
        each for each in refusals(("a.csv", in_radians), ("b.csv", moved)) if "joint_tolerance" in each
    ]
    assert "the joint angles of 'c01' differ by 0.05 rad from those at 'a.csv', line 2, at joint 1" in said
    assert "; up to 0.0001745 rad is plausible" in said
