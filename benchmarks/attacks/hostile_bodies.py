"""Bodies and files that cost a parser most."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

__all__ = ["bodies", "imports"]


def bodies(limit: int) -> Iterator[tuple[str, bytes]]:
    """Yield bodies of a measurement set, legal in size, of every shape that costs memory."""
    objects, keys, values = 59_000, 290_000, 990_000
    yield "empty observations", _set("[" + ",".join(["{}"] * objects) + "]")
    yield "numbers as observations", _set("[" + ",".join(["1"] * values) + "]")
    yield "unknown keys, few different", _set("[" + ",".join(['{"a":1,"b":2,"c":3,"d":4}'] * objects) + "]")
    yield "unknown keys, 3,900 different", json.dumps({f"k{i}": i for i in range(3_900)}).encode()
    yield "299,000 different keys", json.dumps({f"k{i}": i for i in range(299_000)}).encode()
    yield "one key, 290,000 times", ("{" + ",".join(['"a":1'] * keys) + "}").encode()
    yield "nested lists", _set("[" + ",".join(["[[[[[[[[]]]]]]]]"] * 100_000) + "]")
    yield "lists of lists", _set("[" + ",".join(["[]"] * values) + "]")
    yield "one long text", _set('"' + "x" * (limit - 100) + '"')
    yield "a long text of escapes", _set('"' + "\\u00e9" * (limit // 6 - 50) + '"')
    yield "texts as observations", _set("[" + ",".join(['"xx"'] * values) + "]")
    one = '{"label":"a","joints":[1,1,1,1,1,1],"force":[1,1,1],"targets":{"t":{"unloaded":[1,1,1]}}}'
    yield "half an observation", _set("[" + ",".join([one] * 25_000) + "]")
    yield "numbers as vectors", _set('[{"joints":[' + ",".join(["1e400"] * values) + "]}]")


def _set(observations: str) -> bytes:
    return ('{"robot_id":"r","name":"n","encoders":"motor","observations":' + observations + "}").encode()


def imports() -> Iterator[tuple[str, str, bytes]]:
    """Yield files: what they are, their name, their content."""
    row = "c1,0,0,0,0,0,0,0,0,-100,t,1.0,2.0,3.0,1.0,2.0,3.1\n"
    header = "label,q1,q2,q3,q4,q5,q6,fx,fy,fz,target,x0,y0,z0,x1,y1,z1\n"
    yield "a table of 8 MiB", "a.csv", (header + row * ((8 * 1024 * 1024 - 200) // len(row))).encode()
    yield "320,000 short rows", "a.csv", ("a,b\n" + "1,2\n" * 319_000).encode()
    yield "1,000,000 cells", "a.csv", (",".join("x" * 250) + "\n").encode() * 3_990
    yield "8 MiB of one line", "a.csv", b"1," * (4 * 1024 * 1024 - 2)
    yield "8 MiB of blank lines", "a.csv", b"\n" * (8 * 1024 * 1024 - 2)
    yield "8 MiB of quotes", "a.csv", b'"' * (8 * 1024 * 1024 - 2)
    yield "a workbook of empty cells", "a.xlsx", _workbook(_sheet('<c r="A{0}"/>', 490_000))
    yield "a workbook of numbers", "a.xlsx", _workbook(_sheet('<c r="A{0}"><v>1</v></c>', 490_000))
    texts = "".join("<si><t>x</t></si>" for _ in range(800_000))
    yield "a workbook of shared texts", "a.xlsx", _workbook(_sheet('<c r="A{0}"><v>1</v></c>', 10), texts)
    yield "64 MiB of one text", "a.xlsx", _workbook(_sheet("", 0), f"<si><t>{'x' * 60_000_000}</t></si>")


def _sheet(cell: str, rows: int) -> str:
    return "".join(f'<row r="{n}">{cell.format(n)}</row>' for n in range(1, rows + 1))


def _workbook(rows: str, texts: str = "") -> bytes:
    import io
    import zipfile

    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    relations = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    parts: dict[str, Any] = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"><Default Extension="xml" '
        'ContentType="application/xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{relations}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{relations}"><sheets>'
        '<sheet name="s" sheetId="1" r:id="r1"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{relations}/worksheet" Target="worksheets/sheet1.xml"/><Relationship Id="r2" '
        f'Type="{relations}/sharedStrings" Target="sharedStrings.xml"/></Relationships>',
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{main}"><sheetData>{rows}</sheetData></worksheet>',
        "xl/sharedStrings.xml": f'<sst xmlns="{main}">{texts}</sst>',
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return buffer.getvalue()
