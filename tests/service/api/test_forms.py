"""Forms of programs and imports: refused with the place, in few bytes, and nothing is stored."""

import gzip
import json

import pytest
from support.api import post, posted
from support.importing_samples import CAMPAIGN
from support.kinds import TEXT
from support.outcomes import counts, outcome_of
from support.programs import options
from support.workbooks import table_of

from jointstiff.schemas.imports import ImportAnswer
from jointstiff.service.imports.formats import EXPORT
from jointstiff.service.problems import MAX_PROBLEM_BYTES
from jointstiff.simulator import default_arm, simulate_campaign

PROGRAM = options("krl")
SOURCE = ("a.src", TEXT.encode("latin-1"))
TABLE = ("a.csv", CAMPAIGN.encode())
WRITTEN = "send multipart/form-data as browsers, curl -F and HTTP libraries do"
NOT_A_FORM = (
    "send a form of the fields `files` and `options`, as curl -F does, with the header Content-Type: "
    "multipart/form-data"
)
FILE_NAME = "a file has no name, or a name that cannot be displayed"
NO_TABLE = f"the file has no table of numbers | {EXPORT}"
ONCE = "send each file once"
FEWER = "send less data in one request"
NAMED = "send the file with a `filename` of 1 to 200 printable characters"


@pytest.fixture(scope="module")
def run(local):
    return posted(local, simulate_campaign(default_arm(), load="pull", configurations=6, seed=1))


@pytest.mark.parametrize(
    ("files", "stated", "wanted"),
    [
        (
            [SOURCE],
            "{",
            "422 invalid-request | options | Invalid JSON: EOF while parsing an object at line 1 column 1 | "
            "send valid JSON with finite numbers and at most 200 levels",
        ),
        ([SOURCE], None, "422 invalid-request | options | required field is missing | add this field"),
        (
            [],
            {},
            "415 unsupported-media-type | - | "
            "the body has the Content-Type 'application/x-www-form-urlencoded' | send a file in a form of "
            "the fields `files` and `options`, as curl -F does (multipart/form-data); or send columns as "
            "JSON, with the header Content-Type: application/json",
        ),
        ([SOURCE, SOURCE], {}, f"422 invalid-request | files | two files have the same name | {ONCE}"),
        (
            [SOURCE],
            {"run_id": "nobody"},
            "422 invalid-request | run_id | there is no run 'nobody' | "
            "check the id; list the existing ids with GET /v1/jobs?kind=run",
        ),
        (
            [SOURCE],
            {"tools": []},
            "422 invalid-request | tools | the program uses the frame 'TOOL_DATA[1]', but does not "
            "define its numbers | "
            "give the name 'TOOL_DATA[1]' and the numbers in `tools`",
        ),
        (
            [SOURCE],
            {"force": None},
            "422 invalid-request | force | the load is missing | "
            "state the load of the process: one of `force`, `segments`, `loads` and `cut`",
        ),
        (
            [SOURCE],
            {"segments": [{"force": [0.0, 0.0, -500.0], "first_line": 1, "last_line": 2}]},
            "422 invalid-request | options.segments | the load is stated by `force`, too; omit one of both | "
            "correct the field as the reason says",
        ),
        (
            [SOURCE],
            {"accuracy_option": None},
            "422 invalid-request | accuracy_option | the accuracy option of the controller is missing | "
            "give `accuracy_option`: one of off, same_as_measured",
        ),
        (
            [SOURCE],
            {"tool": [0.0, 0.0, 200.0, 0.0, 0.0, 0.0]},
            "422 invalid-request | tool | `tool` does not concern a program | "
            "omit it; state frames of a program in `tools` and `bases`",
        ),
        (
            [SOURCE],
            {"run_id": None, "robot_id": "nobody"},
            "422 invalid-request | robot_id | a program needs a run | "
            "give `run_id`: the model of a run corrects a program",
        ),
        (
            [("poses.csv", b"x [mm],y [mm],z [mm]\n1,2,3\n")],
            {},
            "422 invalid-request | tools | `tools` does not concern a table of poses | omit it",
        ),
        (
            [SOURCE],
            {"tools": PROGRAM["tools"] + [{"name": "TOOL_DATA[9]", "values": [0.0] * 6}]},
            "422 invalid-request | tools[1].name | the program does not use the frame 'TOOL_DATA[9]' | "
            "omit this frame, or correct its name",
        ),
        (
            [SOURCE],
            {"format": "gcode"},
            "422 invalid-request | options.format | must be 'csv', 'krl', 'fanuc', 'rapid' or 'ur' | "
            "use one of these words exactly as written",
        ),
        (
            [("a.src", b"DEF a()\nEND")],
            {},
            "422 invalid-file | 'a.src' | 'a.src': the program has no target | "
            "send a program with moves to targets given by numbers",
        ),
    ],
)
def test_a_program_is_refused_with_its_place_and_stores_nothing(files, stated, wanted, local, run):
    before = counts(local)
    data = {"options": stated} if isinstance(stated, str) else {}
    if isinstance(stated, dict):
        data = {"options": json.dumps(PROGRAM | {"run_id": run["id"]} | stated)}
    answer = local.request(
        "POST", "/v1/corrections", files=[("files", each) for each in files] or None, data=data
    )
    assert outcome_of(answer) == wanted
    assert counts(local) == before


LONG = f"413 request-entity-too-large | - | Part exceeded maximum size of 64KB. | {FEWER}"
MANY = f"413 request-entity-too-large | - | Too many files. Maximum number of files is 65. | {FEWER}"
ONE = ("files", ("a.csv", b"1"))
OPTIONS = ("options", (None, b"{}"))


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        ([OPTIONS], "422 invalid-request | files | required field is missing | add this field"),
        (
            [ONE, ("other", (None, b"1"))],
            "422 invalid-request | body | the form has an unknown field 'other' | "
            "send only the fields `files` and `options`; `options` is one JSON object of all options, such "
            'as {"other": …}',
        ),
        (
            [ONE, OPTIONS, OPTIONS],
            "422 invalid-request | options | the field `options` is given twice | "
            "send one JSON document in `options`",
        ),
        (
            [ONE, ("options", (None, b'{"mapping": {"encoders": "both"}}'))],
            "422 invalid-request | options.mapping.encoders | must be 'motor' or 'secondary' | "
            "give `motor` if the controller closes the position loop by the encoders at the motors, "
            "`secondary` if by encoders behind the gearboxes; absolute or incremental makes no difference",
        ),
        (
            [("files", (None, b"1"))],
            "422 invalid-request | files | a file has no name | send the file with a `filename`",
        ),
        ([("files", ("a" * 201, b"1"))], f"422 invalid-request | files | {FILE_NAME} | {NAMED}"),
        ([ONE, ONE], f"422 invalid-file | a.csv | a file was sent twice | {ONCE}"),
        ([ONE, ("options", (None, b" " * 70_000))], LONG),
        (
            [("files", ("a.csv", b"1;2\n" * (2 << 20)))],
            "413 request-entity-too-large | - | the body exceeds 8192 KiB | split the body into several "
            "requests",
        ),
        (
            [("files", ("a.csv", b"no table\n")), OPTIONS],
            f"422 invalid-file | a.csv | {NO_TABLE}",
        ),
    ],
)
def test_an_import_is_refused_with_its_place(fields, wanted, local):
    assert outcome_of(local.request("POST", "/v1/imports", files=list(fields))) == wanted


FORM = "multipart/form-data; boundary=XyZ"
HEAD = b'--XyZ\r\nContent-Disposition: form-data; name="files"; filename="a.csv"\r\n\r\n'
PART, END = HEAD + b"1;2\r\n", b"--XyZ--\r\n"
FIELD = PART.replace(b'"files"; filename="a.csv"', b'"options"')
AS_FILE = PART.replace(b'"files"', b'"options"').replace(b"1;2", b"{}")
BROKEN = f"422 invalid-request | body | Invalid multipart data. | {WRITTEN}"
ENDLESS = f"422 invalid-request | body | The form does not end with its boundary. | {WRITTEN}"
NAMELESS = f"422 invalid-request | files | {FILE_NAME} | {NAMED}"
HOSTILE = {
    "empty": (b"", ENDLESS),
    "another boundary": (HEAD.replace(b"XyZ", b"abc") + b"1\r\n--abc--\r\n", BROKEN),
    "no end": (HEAD + CAMPAIGN.encode(), ENDLESS),
    "cut short": ((HEAD + CAMPAIGN.encode() + b"\r\n--XyZ--")[:-3], ENDLESS),
    "thousands of parts": ((HEAD + b"\r\n") * 20_000 + b"--XyZ--", MANY),
    "boundaries only": (b"--XyZ\r\n" * 500_000 + b"--XyZ--", BROKEN),
    "almost boundaries": (
        HEAD + b"\r\n--Xy" * 1_000_000 + b"\r\n--XyZ--",
        "422 invalid-file | a.csv | the file has more than 400,000 lines | split the file",
    ),
    "a megabyte of headers": (HEAD[:-2] + b"X-A: b\r\n" * 150_000 + b"\r\n1\r\n--XyZ--", BROKEN),
    "one long header": (HEAD.replace(b"a.csv", b"a" * 1_000_000) + b"1\r\n--XyZ--", BROKEN),
    "backslashes": (HEAD.replace(b"a.csv", b"\\" * 3_999) + b"1\r\n--XyZ--", NAMELESS),
    "headers in latin-1": (
        HEAD.replace(b"a.csv", b"\xe9.csv") + b"1\r\n--XyZ--",
        "200",
    ),
    "nul in a name": (HEAD.replace(b"a.csv", b"a\x00.csv") + b"1\r\n--XyZ--", NAMELESS),
    "markup in a name": (HEAD.replace(b"a.csv", b"<script>\x07") + b"1\r\n--XyZ--", NAMELESS),
    "base64": (
        HEAD[:-2] + b"Content-Transfer-Encoding: base64\r\n\r\nMTsy\r\n--XyZ--",
        f"422 invalid-request | body | a file has an unsupported Content-Transfer-Encoding | {WRITTEN}",
    ),
    "another charset": (
        HEAD[:-2] + b"Content-Type: text/csv; charset=utf-7\r\n\r\n+AGE-\r\n--XyZ--",
        f"422 invalid-file | a.csv | {NO_TABLE}",
    ),
    "a form in a form": (
        HEAD + HEAD.replace(b"XyZ", b"abc") + b"1\r\n--abc--\r\n--XyZ--",
        "200",
    ),
    "gzip": (gzip.compress(HEAD + b"1\r\n--XyZ--"), BROKEN),
    "64 files of one name": (
        PART * 64 + END,
        f"422 invalid-file | a.csv | a file was sent twice | {ONCE}",
    ),
    "65 files": (
        PART * 65 + END,
        "422 invalid-request | files | must have at most 64 items, but has 65 | send fewer items, or split "
        "the items into several resources",
    ),
    "50,000 files": (PART * 50_000 + END, MANY),
    "20 fields": (
        FIELD * 20 + END,
        f"413 request-entity-too-large | - | Too many fields. Maximum number of fields is 8. | {FEWER}",
    ),
    "long options": (FIELD.replace(b"1;2", b" " * 65_537) + END, LONG),
    "options alone, as a file": (
        AS_FILE + END,
        "422 invalid-request | files | required field is missing | add this field",
    ),
    "options of no text": (
        AS_FILE.replace(b"{}", b"\xff") + END,
        "422 invalid-request | options | the options are not UTF-8 | send one JSON document in `options`",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_form_that_means_harm_is_refused_in_few_bytes(name, local):
    body, wanted = HOSTILE[name]
    answer = local.request("POST", "/v1/imports", content=body, headers={"Content-Type": FORM})
    assert outcome_of(answer) == wanted
    assert len(answer.content) <= MAX_PROBLEM_BYTES
    assert "\x07" not in answer.text


@pytest.mark.parametrize(
    ("kind", "wanted"),
    [
        ("multipart/form-data; boundary=" + "x" * 257, BROKEN),
        ("multipart/form-data", f"422 invalid-request | body | Missing boundary in multipart. | {WRITTEN}"),
        ("multipart/form-data; boundary=", BROKEN),
        (
            "application/json",
            "415 unsupported-media-type | - | the body has the Content-Type 'application/json' | "
            f"{NOT_A_FORM}",
        ),
    ],
)
def test_a_form_says_its_boundary(kind, wanted, local):
    answer = local.request("POST", "/v1/imports", content=PART + END, headers={"Content-Type": kind})
    assert outcome_of(answer) == wanted


WEIGHTS = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)


@pytest.fixture(scope="module")
def robot(local):
    return post(local, "/v1/robots", WEIGHTS["robot"])["id"]


def imported(local, table, robot):
    """Import a table of readings of a stored robot."""
    point = [1e3 * part for part in WEIGHTS["measurement_set"]["load_point"]]
    options = {"mapping": {"encoders": "motor", "load_point": point}, "robot_id": robot}
    fields = [("files", ("a.csv", table)), ("options", (None, json.dumps(options)))]
    return local.request("POST", "/v1/imports", files=fields)


def states_exchanged(table):
    return table.replace(b"unloaded", b"UN").replace(b"loaded", b"unloaded").replace(b"UN", b"loaded")


def without_the_sixth_column(table):
    rows = [line.split(b";") for line in table.split(b"\n")]
    return b"\n".join(b";".join([*row[:6], *row[7:]]) for row in rows)


def test_an_import_finds_no_fault_in_a_table_without_one_and_stores_nothing(local, robot):
    before = counts(local)
    answer = imported(local, table_of(WEIGHTS), robot)
    assert (answer.status_code, answer.json()["findings"]) == (200, [])
    assert counts(local) == before


def test_an_import_finds_exchanged_states_before_anything_is_stored(local, robot):
    answer = ImportAnswer.model_validate(imported(local, states_exchanged(table_of(WEIGHTS)), robot).json())
    assert answer.faults == [
        "the targets move against the force: the states are exchanged, or the force is reversed"
    ]
    (finding,) = answer.findings
    assert (finding.code, finding.weight) == ("force_sign_suspect", "do_not_use")
    assert finding.action.kind == "exchange_readings"
    assert finding.message == (
        "the work of the load on the joints is -32.7 J, but must be positive; "
        "the targets moved against the force in 6 of 6 observations"
    )
    assert finding.remedy == (
        "change the sign of every force, because forces are those on the robot; or exchange the unloaded "
        "and the "
        "loaded readings"
    )
    body = answer.measurement_set.model_dump(mode="json", exclude_none=True)
    stored = post(local, "/v1/measurement-sets", body | {"robot_id": robot})
    assert stored["warnings"] == [finding.model_dump(mode="json")]


def test_a_table_without_a_joint_is_no_template_and_the_robot_asks_for_roles(local, robot):
    answer = imported(local, without_the_sixth_column(table_of(WEIGHTS)), robot).json()
    assert answer["measurement_set"] is None
    assert [each["field"] for each in answer["questions"]] == ["tables"]


def test_an_unknown_robot_is_refused(local):
    assert outcome_of(imported(local, table_of(WEIGHTS), "none")) == (
        "404 not-found | - | there is no robot 'none' | check the id; list the existing ids with GET "
        "/v1/robots"
    )
