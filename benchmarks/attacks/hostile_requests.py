"""Requests that no client should send, in process: damaged URDFs, odd JSON, damaged uploads, odd addresses.

`python -m benchmarks hostile --part 2/8` sends the second eighth, in some two minutes.
"""

from __future__ import annotations

import asyncio
import json
import random
import re
import string
from collections import Counter
from collections.abc import Iterator
from copy import deepcopy
from typing import Any, Final

import httpx2

from benchmarks.attacks.urdf_mutations import corpus, damaged, judged, model_of
from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Part, Section
from jointstiff.service.app import create_app
from jointstiff.service.store.store import Store

__all__ = ["run"]

_REQUESTS: Final = 100_000
_URDFS: Final = 2_000
_UPLOADS: Final = 10_000
_BLOCK: Final = 2_500
"""Requests after which the application and its store are made anew."""
_MARK: Final = "@odd@"
_ODD: Final = (
    *("null", "true", "{}", "[]", '""', "[[]]", '{"a":1,"a":2}', '[{"a":[null]}]'),
    *("-1", "0.5", "1e308", "1e400", "-0", "NaN", "Infinity", "9" * 400, "18446744073709551616", "1e-320"),
    *('"\\ud800"', '"\\u0000"', '"\\u202e"', '"../../etc/passwd"', '"1"', '"%s"' % ("x" * 5_000)),
    *("tru", "'x'", "1_0", "01", "0x1", "[1,]", "/*x*/1", "[" * 3_000, "[" * 500 + "]" * 500),
)
"""Values as they stand in a body; some are no JSON."""
_TYPES: Final = (
    *("application/json", "application/json; charset=utf-16", "text/plain", ""),
    *("a/b;;=", "multipart/form-data"),
)
_POINTS: Final = "P10 unloaded {0} [mm];P10 loaded {0} [mm]"
_UPLOADED: Final = (
    (
        "readings.csv",
        "label;J1 [deg];J2 [deg];Fx [N];Fy [N];Fz [N];" + ";".join(map(_POINTS.format, "xyz")) + "\n"
        "c01;10.5;-20.25;0;0;-1471.5;1500.1;1500.2;10.5;10.6;700.3;699.1\n" * 3,
    ),
    ("points.txt", "c01_P10_u, 1.5, 2.25, 3.5\nc01_P10_l, 1.5, 2.25, 3.1\n" * 3),
    ("a.src", "DEF a()\nPTP {A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n"),
)
"""Sound uploads: a table, a list of points, a program."""
_WORDS: Final = ("limit", "cursor", "wait", "name", "deleted", "state", "x")
_METHODS: Final = ("GET", "GET", "GET", "DELETE", "PATCH", "PUT", "POST", "HEAD", "OPTIONS", "TRACE", "X")
_SENT_AS_THEY_ARE: Final = frozenset({"events"})  # streams, which end with their client
Random = random.Random
Request = tuple[str, str, dict[str, Any]]
"""Method, path and what else `httpx2` sends."""


def run(*, quick: bool, part: Part) -> list[Section]:
    """Send each kind of request, and judge the models that come of URDFs."""
    total = _BLOCK if quick else _REQUESTS
    statuses, models, raised = Counter[tuple[str, int]](), Counter[str](), list[str]()
    for first in part.of(total // _BLOCK):
        asyncio.run(_send_block(first, statuses, models, raised))
    return [_section(statuses, models, raised, part)]


async def _send_block(
    block: int, statuses: Counter[tuple[str, int]], models: Counter[str], raised: list[str]
) -> None:
    generator = random.Random(f"hostile {block}")  # noqa: S311
    with Store.open("sqlite://") as store:
        app = create_app(store)
        transport = httpx2.ASGITransport(app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
            seeds = await _seeds(client, app.openapi())
            for kind, (method, path, options) in _requests(generator, seeds, models):
                try:
                    answer = await client.request(method, path, **options)
                except Exception as error:  # noqa: BLE001 - what gets through is what is counted
                    raised.append(f"{method} {path[:40]}: {type(error).__name__}: {error}"[:200])
                else:
                    statuses[kind, answer.status_code] += 1
                    if answer.status_code >= 500:
                        raised.append(f"{method} {path[:40]}: {answer.status_code} {answer.text[:120]}")


async def _seeds(client: httpx2.AsyncClient, openapi: dict[str, Any]) -> list[tuple[str, str, Any]]:
    """Return method, path and body of sound requests: the examples of the API, about what is stored."""
    document = small_campaign(configurations=19).document
    robot = (await client.post("/v1/robots", json=document["robot"])).raise_for_status().json()["id"]
    readings = document["measurement_set"] | {"robot_id": robot}
    stored = (await client.post("/v1/measurement-sets", json=readings)).raise_for_status().json()["id"]
    run = (await client.post("/v1/runs", json={"measurement_set_id": stored})).raise_for_status().json()["id"]
    ids = {"robot_id": robot, "measurement_set_id": stored, "set_id": stored, "run_id": run}
    found = [
        ("POST", "/v1/measurement-sets", readings | {"observations": readings["observations"][:2]}),
        ("POST", "/v1/runs", {"measurement_set_id": stored}),
        ("POST", "/v1/kinematics", {"robot_id": robot, "joints": [[0.0] * 6]}),
        ("GET", "/health", None),
    ]
    for path, operations in openapi["paths"].items():
        if path.rsplit("/", 1)[-1] in _SENT_AS_THEY_ARE:
            continue
        address = path
        for name, value in ids.items():
            address = address.replace(f"{{{name}}}", value)
        for method, operation in operations.items():
            content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
            bodies = [each["value"] for each in content.get("examples", {}).values()] or [None]
            found += [(method.upper(), address, _about(body, ids)) for body in bodies]
    return found


def _about(body: Any, ids: dict[str, str]) -> Any:  # noqa: ANN401 - JSON
    if isinstance(body, dict):
        return {key: ids.get(key, _about(value, ids)) for key, value in body.items()}
    return [_about(value, ids) for value in body] if isinstance(body, list) else body


def _requests(
    generator: Random, seeds: list[tuple[str, str, Any]], models: Counter[str]
) -> Iterator[tuple[str, Request]]:
    urdfs = _BLOCK * _URDFS // _REQUESTS
    uploads = _BLOCK * _UPLOADS // _REQUESTS
    arms = corpus()
    sorts = [[seed for seed in seeds if (seed[2] is None) == empty] for empty in (True, False, False)]
    for _ in range(urdfs):
        arm = generator.choice(arms)
        model = model_of(arm, damaged(generator, arm.urdf))
        models[judged(generator, model)] += 1
        yield "URDF", ("POST", "/v1/robots", {"json": {"name": "r", "model": model}})
    for _ in range(uploads):
        yield "upload", _upload(generator)
    for _ in range(_BLOCK - urdfs - uploads):
        method, path, body = generator.choice(generator.choice(sorts))
        if body is None:
            yield "address", (generator.choice((method, *_METHODS)), _odd_path(generator, path), {})
        else:
            headers = {"Content-Type": generator.choice((*["application/json"] * 20, *_TYPES))}
            yield "JSON", (method, path, {"content": _odd_body(generator, body), "headers": headers})


def _upload(generator: Random) -> Request:
    """Return a table of readings or a program, its cells exchanged and its bytes damaged."""
    name, text = generator.choice(_UPLOADED)
    cells = re.split(r"([;,\n ])", text)
    for _ in range(generator.randrange(4)):
        cells[generator.randrange(len(cells))] = generator.choice((*cells, *_ODD))
    files = [("files", (_odd_name(generator, name), _spoilt(generator, "".join(cells).encode())))]
    options = b"{}" if generator.random() < 0.9 else _odd_body(generator, {"name": "day"})
    path = generator.choice(("/v1/imports",) * 9 + ("/v1/corrections",))
    return "POST", path, {"files": files, "data": {"options": options.decode("latin-1")}}


def _odd_name(generator: Random, name: str) -> str:
    return generator.choice((name,) * 40 + ("", "../x", "a" * 300 + ".csv", "a.xlsx", "a.csv\0", "ü.csv"))


def _spoilt(generator: Random, content: bytes) -> bytes:
    if generator.random() < 0.5 or not content:
        return content
    place = generator.randrange(len(content))
    middle = bytes(generator.randrange(256) for _ in range(generator.randrange(4)))
    return (
        content[:place]
        + middle
        + (content[place + generator.randrange(4) :] if generator.random() < 0.8 else b"")
    )


def _odd_path(generator: Random, path: str) -> str:
    parts = [_odd_word(generator) if part.startswith("{") else part for part in path.split("/")]
    if generator.random() < 0.2:
        parts[generator.randrange(1, len(parts))] = _odd_word(generator)
    query = "&".join(
        f"{generator.choice(_WORDS)}={_odd_word(generator)}" for _ in range(generator.randrange(3))
    )
    return "/".join(parts) + "?" * bool(query) + query


def _odd_word(generator: Random) -> str:
    """Return text for an address, with what an address cannot hold written in %."""
    odd = ("%00", "%ff", "%2e%2e%2f", "..", "-1", "1e9", "", "true", "%F0%9F%92%A5", "0" * 32, "x" * 300, "1")
    letters = generator.choices(string.ascii_letters + string.digits, k=8)
    return generator.choice((*odd, "".join(letters)))


def _odd_body(generator: Random, body: Any) -> bytes:  # noqa: ANN401 - JSON
    """Return a body with up to three odd values or keys; one of five is damaged as bytes, too."""
    body = deepcopy(body)
    for _ in range(generator.choice((0, 1, 1, 2, 3))):
        places = list(_places(body))
        holder, key = generator.choice(places) if places else (body, None)
        change = generator.choice(("value", "value", "value", "lost", "added"))
        if change == "lost" and key is not None:
            del holder[key]
        elif change == "added" and isinstance(holder, dict):
            holder[generator.choice(("", "id", "__proto__", "x" * 300, "\ud800", "name"))] = _MARK
        elif key is not None:
            holder[key] = _MARK
    pieces = json.dumps(body).split(json.dumps(_MARK))
    text = pieces[0] + "".join(generator.choice(_ODD) + piece for piece in pieces[1:])
    content = text.encode(generator.choice(("utf-8",) * 20 + ("utf-16", "utf-8-sig")))
    return _spoilt(generator, content) if generator.random() < 0.2 else content


def _places(value: Any) -> Iterator[tuple[Any, Any]]:  # noqa: ANN401 - JSON
    keys: Any = (
        list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    )
    for key in keys:
        yield value, key
        yield from _places(value[key])


def _section(
    statuses: Counter[tuple[str, int]], models: Counter[str], raised: list[str], part: Part
) -> Section:
    kinds = sorted({kind for kind, _ in statuses})
    failed = sum(count for (_, status), count in statuses.items() if status >= 500)
    answers = {
        kind: ", ".join(f"{n:,} × {status}" for (k, status), n in sorted(statuses.items()) if k == kind)
        for kind in kinds
    }
    taken = ", ".join(f"{count:,} {how}" for how, count in sorted(models.items()))
    return Section(
        title=f"{statuses.total():,} hostile requests in process; part {part.number} of {part.count}",
        columns=("requests", "answers"),
        rows=tuple(answers.items()),
        figures=(
            Figure.none("hostile requests: exceptions that nothing handles", len(raised) - failed),
            Figure.none("hostile requests: answers of class 5xx", failed),
            Figure.none("damaged URDFs: models that are not those of Pinocchio's reader", models["WRONG"]),
        ),
        notes=(
            f"damaged URDFs: {taken}; `alone`: Pinocchio's reader refuses it, so it is compared with nothing",
            "hostile URDFs one by one: tests/solver/mechanics/test_robot.py",
            "uploads that are misread: tests/service/imports/test_damaged_files.py",
            *raised[:5],
        ),
        data={"answers": answers, "models": dict(models)},
    )
