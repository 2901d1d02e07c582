"""Bodies of JSON that mean harm, URDFs among them: each is refused in few bytes, with place and remedy."""

import json
import re

import pytest
from fastapi import HTTPException
from support.api import post
from support.hostile_urdfs import HOSTILE
from support.outcomes import counts, outcome_of

from jointstiff.service.conversion.parsing import USE_ARRAYS
from jointstiff.service.problems import MAX_PROBLEM_BYTES
from jointstiff.service.security.admission import refuse_structure

PATHS = ["/v1/robots", "/v1/measurement-sets", "/v1/runs"]
AN_OBJECT = "give its fields by name, in braces"
JSON = "send valid JSON with finite numbers and at most 200 levels"
SPLIT = "split the body into several requests"
NO_OBJECT = [f"422 invalid-request | body | must be an object | {AN_OBJECT}"] * 3
LARGE = f"413 request-entity-too-large | - | the body exceeds 64 KiB | {SPLIT}"
KEYS = (
    "413 request-entity-too-large | - | the body has more than 4000 different keys | "
    "check the names of the fields"
)
ADD = "add this field"
ADD_ID = "add this field, with an id, not a name: GET /v1/measurement-sets lists the ids with the names"
MISSING = ["name | 3 faults", "name | 5 faults", "measurement_set_id | 2 faults"]


def invalid(reason):
    return f"422 invalid-request | body | Invalid JSON: {reason} | {JSON}"


def missing(*places):
    """The first field that is missing, of a robot, a set and a run."""
    return [
        f"422 invalid-request | {place}: required field is missing | {ADD_ID if 'set_id' in place else ADD}"
        for place in places
    ]


(NAME_OF_A_RUN,) = missing("measurement_set_id | 2 faults")
DEEP = invalid("recursion limit exceeded at line 1 column 202")
DEEPER = invalid("recursion limit exceeded at line 1 column 1006")
PRINTABLE = "must be printable text without leading or trailing blanks | correct the field as the reason says"
BODIES = {
    "empty": (
        b"",
        ["422 invalid-request | body | the body is empty | send a JSON document as the body"] * 3,
    ),
    "not json": (b"{1: 1}", [invalid("key must be a string at line 1 column 2")] * 3),
    "printed by Python": (b"{'a': 1}", [invalid("key must be a string at line 1 column 2")] * 3),
    "null": (b"null", NO_OBJECT),
    "number": (b"1", NO_OBJECT),
    "nested lists": (b"[" * 100_000, [DEEP, DEEP, LARGE]),
    "nested objects": (b'{"a":' * 50_000, [DEEPER, DEEPER, LARGE]),
    "balanced nesting": (b"[" * 5_000 + b"]" * 5_000, [DEEP] * 3),
    "long integer": (b"1" * 60_000, [invalid("number out of range at line 1 column 4302")] * 3),
    "long exponent": (b"1e" + b"9" * 1_000, NO_OBJECT),
    "invalid utf-8": (
        b'{"name": "\xff\xfe"}',
        [
            "422 invalid-request | body | the body of the request is not a text in UTF-8 | send "
            "the JSON document in UTF-8"
        ]
        * 3,
    ),
    "lone surrogate": (
        b'{"name": "\\ud800"}',
        [invalid("unexpected end of hex escape at line 1 column 17")] * 3,
    ),
    "not a number": (
        b'{"name": NaN}',
        [
            "422 invalid-request | name | 2 faults: must be a text | give a text, in quotes",
            "422 invalid-request | name | 4 faults: must be a text | give a text, in quotes",
            NAME_OF_A_RUN,
        ],
    ),
    "nul": (
        b'{"name": "\\u0000"}',
        [
            f"422 invalid-request | name | 2 faults: {PRINTABLE}",
            f"422 invalid-request | name | 4 faults: {PRINTABLE}",
            NAME_OF_A_RUN,
        ],
    ),
    "byte order mark": (
        b"\xef\xbb\xbf{}",
        [
            *missing("name | 2 faults", "name | 4 faults"),
            f"422 invalid-request | measurement_set_id | required field is missing | {ADD_ID}",
        ],
    ),
    "long key": (b'{"' + b"k" * 60_000 + b'": 1}', missing(*MISSING)),
    "markup in key": (b'{"<script>alert(1)</script>\\u0007": 1}', missing(*MISSING)),
    "many wrong members": (b"{" + b",".join(b'"k%d":0' % i for i in range(5_000)) + b"}", [KEYS] * 3),
    "wide characters": (
        ("{" + ",".join(f'"{i}{"漢" * 280}":0' for i in range(40)) + "}").encode(),
        missing("name | 42 faults", "name | 44 faults", "measurement_set_id | 41 faults"),
    ),
    "many wrong items": (b'{"observations": [' + b"0," * 20_000 + b"0]}", missing(*MISSING)),
    "wrong items of a row": (
        b'{"model": {"format": "dh", "rows": [' + b"{}," * 10_000 + b"{}]}}",
        missing(*MISSING),
    ),
}


def sent(client, path, content, kind="application/json"):
    answer = client.request("POST", path, content=content, headers={"Content-Type": kind})
    assert len(answer.content) <= MAX_PROBLEM_BYTES
    assert "\x07" not in answer.text
    return outcome_of(answer)


@pytest.mark.parametrize("name", BODIES)
def test_a_body_that_means_harm_is_refused_in_few_bytes(name, local):
    body, wanted = BODIES[name]
    assert [sent(local, path, body) for path in PATHS] == wanted


@pytest.mark.parametrize(
    ("path", "most"), [("/v1/robots", 4096), ("/v1/measurement-sets", 8192), ("/v1/runs", 64)]
)
def test_a_body_is_as_large_as_its_kind_needs(path, most, local):
    body = b'{"name": "' + b"a" * (most << 10) + b'"}'
    remedy = USE_ARRAYS if path == "/v1/measurement-sets" else SPLIT
    assert sent(local, path, body) == (
        f"413 request-entity-too-large | - | the body exceeds {most} KiB | {remedy}"
    )
    assert sent(local, path, body[: most << 10]).startswith(
        "422 invalid-request | body | Invalid JSON: EOF while parsing a string"
    )


@pytest.mark.parametrize(
    ("filler", "most"), [(b"{},", "60000 '{'"), (b"0,", "1000000 ','"), (b'"a":0,', "300000 ':'")]
)
def test_a_body_has_few_parts(filler, most, local):
    body = b'{"observations": [' + filler * ((7 << 20) // len(filler)) + b"0]}"
    assert sent(local, "/v1/measurement-sets", body) == (
        f"413 request-entity-too-large | - | the body has more than {most} | {USE_ARRAYS}"
    )


@pytest.mark.parametrize("kind", ["text/plain", "application/xml", "application/x-www-form-urlencoded", ""])
def test_a_body_of_another_type_is_refused(kind, local):
    found = f"the Content-Type '{kind}'" if kind else "no Content-Type"
    assert sent(local, "/v1/runs", b"{}", kind) == (
        f"415 unsupported-media-type | - | the body has {found} | "
        "send JSON, with the header Content-Type: application/json"
    )


def keys(count):
    return {f'k"{i}': "" for i in range(count)}


@pytest.mark.parametrize(
    "body",
    [
        b'{"name": "' + b"\\".join(b'\\"k%d\\": ' % i for i in range(10_000)) + b'"}',
        json.dumps({"text": ["a", {"b": [f'"k{i}": "' for i in range(10_000)]}]}).encode(),
        json.dumps([keys(4_000)] * 2, indent=2).encode(),
    ],
    ids=["within one text", "within many texts", "the same keys again"],
)
def test_text_that_looks_like_keys_counts_for_nothing(body):
    refuse_structure(body)


def test_the_4001st_key_is_too_many():
    refuse_structure(json.dumps(keys(4_000)).encode())
    with pytest.raises(HTTPException, match="more than 4000 different keys"):
        refuse_structure(json.dumps({"a": keys(4_000)}, indent=2).encode())


@pytest.mark.parametrize(("length", "named"), [(10, 20), (100, 20), (300, 12), (900, 12)])
def test_of_many_faults_twenty_are_named_or_as_many_as_fit(length, named, local):
    fields = {f"{number:02d}" + "é" * length: 1 for number in range(30)}
    answer = local.request("POST", "/v1/robots", json=fields)
    faults = answer.json()["errors"]
    assert len(faults) == named
    assert answer.json()["detail"].startswith("32 faults; first: name: ")
    room = MAX_PROBLEM_BYTES - len(answer.content)
    largest = max(len(json.dumps(each, ensure_ascii=False).encode()) for each in faults)
    assert room >= 0
    assert named == 20 or room < 2 * largest


REMEDIES = {
    "is not a finite decimal number": "write the number like 0.35 or -1.2e-3",
    "is outside ±": "check the number and its unit: lengths in m, angles in rad",
    "not well-formed XML": "check the document with an XML tool",
    "document type declaration": "remove <!DOCTYPE …> and write the entities out",
    "control character": "send plain text in UTF-8 without this character",
    "this is not XML": "send the document itself, not its file name",
    "moving joints$": "use at most 32: choose a base and a flange closer to each other",
    "some links form a cycle": "a URDF is a tree: give one of these links another parent",
    "two joints have this link as child": "a URDF is a tree: keep one of the two joints",
    "links have no parent": "join all links into one tree with one root",
    "name is missing or empty": "give a name",
    "invisible characters": "use printable characters and no space at either end",
    "second joint of this name": "give each joint a unique name",
    "second link of this name": "give each link a unique name",
    "^the name has": "use at most 200 characters",
    "levels of nesting|in one name or attribute|attributes of one element|more than 20000 elements": (
        "send only links and joints"
    ),
    "^the robot has 1001 joints": "at most 1000 are supported: send only the arm",
    "^the robot has 1002 links": "at most 1001 are supported: send only the arm",
    "robot has no link": "add links and joints",
    "needs <limit>": "give the limits in rad, or make the joint continuous",
    "leave no range": "give a finite lower limit below the upper limit, or no limits; make a joint that "
    "cannot move a fixed joint",
    "there is a (floating|planar) joint": (
        "only revolute, continuous, prismatic and fixed joints are supported between base and flange: "
        "make this joint fixed at its position, or choose another base or flange"
    ),
    "unknown joint type": "use one of revolute, continuous, fixed, prismatic, floating, planar",
    "mimic joint": "make this joint fixed, and describe the coupling of the others in `joint_map`",
    "exactly 3 numbers are needed": "write decimal numbers separated by spaces",
    "unknown attribute": "use only xyz and rpy",
    "no attribute xyz": "add the attribute xyz",
    "^the axis ": "give a unit vector, such as 0 0 1",
    "is given 2 times": "keep one <axis>",
    "there is no link 'c'": "use one of the links 'a', 'b'",
    "the root element is": "send a URDF document, not SDF or MJCF",
    "second <robot>|content after the end": "send one robot per document",
    "there is no moving joint": "choose a base and a flange with moving joints between base and flange",
    "processing instruction": "remove the instruction",
    "unexpanded xacro": "expand the document first: xacro robot.urdf.xacro > robot.urdf",
    "must have at least 1 character": "write a longer text",
    "must have at most 2097152 characters": "write a shorter text",
    "the body exceeds 4096 KiB": SPLIT,
}


@pytest.mark.parametrize("name", sorted(HOSTILE.keys() - {"lone surrogate"}))
def test_a_urdf_that_means_harm_is_refused_with_its_place_and_the_remedy(name, local):
    """The reasons are those of the solver (test_robot.py); too large ones do not reach it."""
    text, where, reason = HOSTILE[name]
    before = counts(local)
    model = {"format": "urdf", "urdf": text, "base": "a", "flange": "b"}
    said = sent(local, "/v1/robots", json.dumps({"name": "r", "model": model})).split(" | ")
    if name not in {"empty", "too large", "too large in bytes"}:
        assert said[:2] == ["422 invalid-robot", f"model.urdf: {where}"]
        assert reason in said[2]
    (remedy,) = [each for pattern, each in REMEDIES.items() if re.search(pattern, said[2])]
    assert said[3] == remedy
    assert counts(local) == before


def absurd(force, shift):
    """Three readings of a robot of 32 joints, each number as large as it may be."""
    return [
        {
            "label": str(i),
            "joints": [1e12 / (i + 1)] * 32,
            "force": [force, -force, force],
            "moment": [force] * 3,
            "readings": [
                {"target": f"P1{k}", "unloaded": [k * 5e11, i, k], "loaded": [k * 5e11, i + shift, k]}
                for k in range(3)
            ],
        }
        for i in range(3)
    ]


@pytest.mark.parametrize(
    ("force", "sigma", "shift", "ended"),
    [
        (1e9, 1e-9, 1e11, "do_not_use"),
        (1e-160, 1e-9, 1e-3, "do_not_use"),
        (1e-300, 1e3, 1e-300, "no target moved, so no compliance can be identified"),
        (-1e12, 1e-9, 0.0, "no target moved, so no compliance can be identified"),
    ],
)
def test_numbers_at_the_edge_of_what_is_allowed_are_never_for_use(force, sigma, shift, ended, local):
    rows = [{"a": 1e-300, "alpha": 0.0, "d": 100.0, "theta": 6.0}] * 32
    model = {"format": "dh", "convention": "standard", "rows": rows}
    stated = {
        "robot_id": post(local, "/v1/robots", {"name": "edge", "model": model})["id"],
        "name": "edge",
        "units": {"length": "m", "angle": "rad", "force": "kN"},
        "encoders": "motor",
        "load_point": [1e12, -1e12, 1e12],
        "noise": {"sigma": sigma},
        "observations": absurd(force, shift),
    }
    made = post(local, "/v1/measurement-sets", stated)
    forbidding = {each["code"] for each in made["warnings"] if each["weight"] == "do_not_use"}
    assert (
        "target_off_model" in forbidding
    )  # where targets were read, they decide, not the size of the angles
    of_set = {"measurement_set_id": made["id"]}
    run = post(local, "/v1/runs", of_set | {"method": "partial_pose"})
    said = run["result"]["assessment"]["verdict"] if run["result"] else run["error"]["detail"]
    assert said == ended
    for method, reason in (
        ("complete_pose", "the targets lie on a line"),
        ("decoupled_partial_pose", "a robot with 32 joints has no arm with a spherical wrist"),
    ):
        refused = sent(local, "/v1/runs", json.dumps(of_set | {"method": method}))
        assert refused.startswith("422 unsupported-method | ")
        assert reason in refused


def test_a_body_that_matches_in_many_ways_is_refused_at_once(local):
    for body in ("a=" + "&a=" * 100 + " x", "/**/" * 100 + "x"):
        refusal = "422 invalid-request | body | Invalid JSON: expected value at line 1 column 1"
        assert sent(local, "/v1/robots", body).startswith(refusal)
