"""Transcripts: sessions with the service as text, replayed and compared whole.

    .venv/bin/python tests/support/transcripts.py [WORD]              compare; WORD selects rooms by name
    .venv/bin/python tests/support/transcripts.py --record [WORD]     write anew what is answered today

A room is a file in `tests/recorded/transcripts/`: statements of Python behind `>>>` and `...`, each followed
by all that is said. Words are equal; a number with a point may differ by one in its last printed digit. Ids,
hashes, versions and times of this moment are placeholders. A new case is a statement: `--record` adds what is
said.
"""

import io
import json
import math
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import chdir, closing, redirect_stdout
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from html import unescape
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl

from jointstiff.service.process import versions
from jointstiff.service.store.store import Store

FOLDER = Path(__file__).parents[1] / "recorded" / "transcripts"
LONG, WIDE, SHOWN, FEW, LINES = 8, 110, 3, 3, 24
FEWEST = 3  # significant digits of a number that rounding may change
"""Numbers that a list prints, characters of a line, and what is printed of longer lists and of tables."""
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_ID = re.compile(r"(?<![\w.])(?=\d*[a-f])(?:[0-9a-f]{64}|[0-9a-f]{32})\b")
_EXACT = re.compile(r"(?<![\w.])(?=[\d.]{9})\d+\.\d+(?:e[-+]?\d+)?(?![\w.])")
"""Numbers that are written with more digits than are compared."""
_MOMENT = re.compile(rf"{_ID.pattern}|\\d{{4}}-\\d\\d-\\d\\dT[\\d:]+\\.\\d+Z")
_TIME = re.compile(r"\b(\d{4}-\d\d-\d\d)(?:[T ](\d\d:\d\d)(?::\d\d(?:\.\d+)?)?(?:Z|\+00:00)?)?")


@dataclass(frozen=True)
class Step:
    """A statement, and what was said."""

    source: str
    said: str


def rooms(word: str = "") -> dict[str, Path]:
    """Return the rooms whose name has a word."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.txt")) if word in path.stem}


def steps_of(text: str) -> list[Step]:
    """Return the steps of a room."""
    steps = list[Step]()
    for block in re.split(r"^(?=>>> )", text, flags=re.MULTILINE)[1:]:
        source, said = list[str](), list[str]()
        for line in block.splitlines():
            is_source = not said and line.startswith((">>> ", "... ", "...") if source else ">>> ")
            (source if is_source else said).append(line)
        steps.append(Step("\n".join(source), "\n".join(said).strip("\n")))
    return steps


@dataclass
class Session:
    """A service of its own in memory, and the folder that its files are in."""

    store: Store
    folder: Path
    known: dict[str, str] = field(default_factory=dict)  # placeholders of ids and hashes
    names: dict[str, Any] = field(default_factory=dict)  # what statements see

    def said(self, step: Step) -> str:
        """Return what a statement says today."""
        source = "\n".join(line[4:] for line in step.source.splitlines())
        with redirect_stdout(io.StringIO()) as output:
            try:
                exec(compile(source, "<transcript>", "exec"), self.names)  # noqa: S102 - our own files
            except Exception as error:  # noqa: BLE001 - what is raised is said, too
                print(f"{type(error).__name__}: {error}")  # noqa: T201
        return self._with_placeholders(output.getvalue())

    def _with_placeholders(self, text: str) -> str:
        text = text.replace(str(self.folder), "<folder>")
        for name, version in versions().items():
            text = text.replace(f'"{name}": "{version}"', f'"{name}": "<version>"')
            text = re.sub(rf"(\b{name}(?:,| )){re.escape(version)}\b", r"\1<version>", text)
        text = re.sub(r"<(\w+) [0-9a-f]{8},", r"<\1 <short id>,", text)
        text = re.sub(r"(\.\w+: )[\d,]+ bytes", r"\1<size>", text)
        text = _ID.sub(lambda found: self._placeholder(found[0]), text)
        text = re.sub(r'("request_id": )"\w+"', r'\1"<request>"', text)
        text = re.sub(r'("stored_bytes": )\d+', r"\1<size>", text)  # ids are packed with what names them
        text = _TIME.sub(_now_or_stated, text)
        text = _EXACT.sub(lambda found: number(float(found[0]), 6), text)
        text = re.sub(r"([━─═])\1{2,}", r"\1", re.sub(r"(?<=\S) {3,}", "  ", text))
        return "\n".join(map(_without_rounding, text.splitlines())).strip("\n")

    def _placeholder(self, text: str) -> str:
        kind = "id" if len(text) == 32 else "hash"
        count = sum(known.startswith(f"<{kind}") for known in self.known.values())
        return self.known.setdefault(text, f"<{kind} {count + 1}>")


def _without_rounding(line: str) -> str:
    """Return a line with 0 in place of rounding errors; a covariance of compliances may be small."""
    least = "2[5-9]|[3-9]\\d" if "covariance" in line else "1[2-9]|[2-9]\\d"
    line = re.sub(rf"(?<![\w.])-?\d(?:\.\d+)?e-(?:{least})\b", "0.0", line)
    return re.sub(r"(?<![\w.>])-(0(?:\.0+)?)(?![\w.])", r"\1", line).rstrip()


def _now_or_stated(found: re.Match[str]) -> str:
    now = datetime.now(UTC)
    try:
        day = datetime.fromisoformat(f"{found[1]}T{found[2] or f'{now:%H:%M}'}").replace(tzinfo=UTC)
    except ValueError:
        return found[0]
    for name, shift in (("now", 0), ("in 8 h", 8), ("in 10 min", 1 / 6), ("in 90 days", 24 * 90)):
        if abs(now + timedelta(hours=shift) - day) < timedelta(minutes=5):
            return f"<{name}>"
    return found[0]


def replayed(path: Path) -> Iterator[tuple[Step, str]]:
    """Yield each step of a room with what is said today."""
    from support import transcript_words

    with tempfile.TemporaryDirectory() as place, Store.open("sqlite://") as store, chdir(place):
        session = Session(store, Path(place).resolve())
        session.names |= transcript_words.words(store)
        for step in steps_of(path.read_text(encoding="utf-8")):
            yield step, session.said(step)


def differences(path: Path) -> Iterator[str]:
    """Yield what is said otherwise than recorded."""
    for step, said in replayed(path):
        lines = zip_longest(step.said.splitlines(), said.splitlines(), fillvalue="<nothing>")
        other = [f"  - {then}\n  + {now}" for then, now in lines if not same(then, now)]
        if other:
            yield "\n".join([f"{path.stem}: {step.source[:300]}", *other[:6]])


def same(then: str, now: str) -> bool:
    """Return whether two lines say the same."""
    if then == now:
        return True
    numbers = zip(_NUMBER.findall(then), _NUMBER.findall(now), strict=False)
    return _NUMBER.sub("#", then) == _NUMBER.sub("#", now) and all(_close(a, b) for a, b in numbers)


def _close(then: str, now: str) -> bool:
    """Return whether two numbers are equal to 1e-6, or differ by one in the last digit of the finer one.

    Zeros at the end of a number are not printed, so one of fewer than three digits is taken as exact.
    """
    if not ("." in then and "." in now):
        return then == now
    if math.isclose(float(then), float(now), rel_tol=1e-6):
        return True
    finer = min(then, now, key=_last_digit)
    digits = finer.lower().partition("e")[0].replace(".", "").strip("0")
    return len(digits) >= FEWEST and abs(float(then) - float(now)) <= 1.01 * _last_digit(finer)


def _last_digit(number: str) -> float:
    mantissa, _, exponent = number.lower().partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def record(path: Path) -> None:
    """Write a room with what is said today."""
    blocks = [f"{step.source}\n{said}\n" if said else f"{step.source}\n" for step, said in replayed(path)]
    path.write_text("\n".join(blocks), encoding="utf-8")


def printed(value: Any, indent: str = "") -> str:
    """Return a value of JSON: numbers by five digits, short parts in a line, of long lists the first."""
    if isinstance(value, float):
        return number(value)
    if isinstance(value, str):
        return json.dumps(shortened(value), ensure_ascii=False)
    if isinstance(value, list) and (numbers := _numbers_in(value)):
        value = _without_noise(value, max(abs(each or 0.0) for each in numbers))
    if isinstance(value, list) and len(numbers := _numbers_in(value)) > LONG:
        first = ", ".join(map(number, numbers[:SHOWN]))
        return f"[{first}, … {summed(numbers)}]"
    if not isinstance(value, dict | list):
        return json.dumps(value)
    parts = (
        [*(printed(part, indent + "  ") for part in value[:FEW]), *beyond(value)]
        if isinstance(value, list)
        else [f'"{key}": {printed(part, indent + "  ")}' for key, part in value.items()]
    )
    opening, ending = "[]" if isinstance(value, list) else "{}"
    line = _without_rounding(f"{opening}{', '.join(parts)}{ending}")
    if len(indent) + len(line) <= WIDE and "\n" not in line:
        return line
    inner = f",\n{indent}  ".join(parts)
    return f"{opening}\n{indent}  {inner}\n{indent}{ending}"


def beyond(entries: list[Any]) -> list[str]:
    """Return in a line what the entries of a long list have beyond the first: their numbers and words."""
    rest = list(_leaves(entries[FEW:]))
    numbers = [each for each in rest if isinstance(each, float | int) and not isinstance(each, bool)]
    counted = Counter(
        _MOMENT.sub("<id or time>", shortened(each, 60)) for each in rest if isinstance(each, str)
    )
    words = ", ".join(f"{count} × {word}" for word, count in sorted(counted.items()))
    return [f"… {len(entries[FEW:])} more: {summed(numbers)}; {shortened(words, 2000)}"] if rest else []


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _leaves(part)
    else:
        yield value


def number(value: Any, digits: int = 5) -> str:
    """Return a number with a point, by so many digits."""
    if not isinstance(value, float) or (value == int(value) and abs(value) < 1e6):
        return json.dumps(value)
    text = f"{value:.{digits}g}"
    if "." in text or not math.isfinite(value):
        return text
    return text.replace("e", ".0e") if "e" in text else f"{text}.0"


def summed(numbers: list[Any]) -> str:
    """Return how many numbers there are, their sum, and the sum of their sizes in order."""
    known = [float(each) for each in numbers if isinstance(each, int | float) and math.isfinite(each)]
    size = sum(map(abs, known))
    total = 0.0 if abs(sum(known)) < 1e-9 * size else sum(known)
    ordered = sum(abs(each) * (1 + i % 7) for i, each in enumerate(known))
    sums = ", ".join(number(float(each), 6) for each in (total, size, ordered))
    return f"{len(numbers)} numbers: {sums}"


def _without_noise(value: Any, greatest: float) -> Any:
    """Return nested lists with 0 in place of numbers that are rounding errors beside the others."""
    if isinstance(value, list):
        return [_without_noise(part, greatest) for part in value]
    return 0.0 if isinstance(value, float) and abs(value) < max(1e-6 * greatest, 1e-30) else value


def _numbers_in(value: Any) -> list[Any]:
    """Return the numbers of nested lists that have nothing else."""
    if isinstance(value, list):
        parts = [_numbers_in(part) for part in value]
        return [] if any(not part for part in parts) else [each for part in parts for each in part]
    return [value] if isinstance(value, float | int) and not isinstance(value, bool) else []


def shortened(text: str, most: int = 400) -> str:
    """Return a text, or the beginning of a long one and the number of its lines."""
    if len(text) > most and " " not in text:
        return "<packed>"
    if len(text) <= most:
        return text
    # Rounding errors first: their digits would move the cut.
    return f"{_without_rounding(text)[:80]}… {len(text.splitlines())} lines"


def text_of_table(text: str) -> str:
    """Return the lines of a table, of a long one the first, and the sums of the others."""
    lines = text.splitlines()
    if len(lines) <= LINES:
        return text
    rest = "\n".join(lines[LINES:])
    words = Counter(re.findall(r"[^\W\d_]{3,}", rest))
    counted = ", ".join(f"{count} {word}" for word, count in sorted(words.items()))
    numbers = summed([float(each) for each in _NUMBER.findall(rest)])
    return "\n".join([*lines[:LINES], f"… {len(lines) - LINES} more lines: {numbers}; {counted[:1000]}"])


def text_of_page(page: str) -> str:
    """Return the words of an HTML page, one block a line; pictures by their words and their numbers."""
    page = re.sub(r"<(style|script)\b.*?</\1>", "", page, flags=re.DOTALL)
    page = re.sub(r"<svg\b.*?</svg>", lambda found: _picture(found[0]), page, flags=re.DOTALL)
    page = re.sub(r"<(a|img|input)\b([^>]*)>", r"[\1\2]", page)
    page = re.sub(r"</t[hd]>", " | ", page)
    page = re.sub(r"</?(b|i|em|strong|span|code|sup|sub|t[hd]|a|small)\b[^>]*>", "", page)
    lines = (" ".join(line.split()) for line in unescape(re.sub(r"<[^>]*>", "\n", page)).splitlines())
    return "\n".join(line for line in lines if line)


def _picture(svg: str) -> str:
    words = [unescape(each) for each in re.findall(r">([^<>]*\S[^<>]*)<", svg)]
    svg = re.sub(r"#[0-9a-fA-F]{3,6}", "", svg)
    numbers = [float(each) for each in re.findall(r"-?\d+\.?\d*", re.sub(r">[^<]*<", "><", svg))]
    marks = re.findall(r"<(\w+)", svg)
    counted = ", ".join(f"{marks.count(mark)} {mark}" for mark in dict.fromkeys(marks))
    return f"\npicture: {counted}; {summed(numbers)}; {' / '.join(words)}\n"


def text_of_workbook(content: bytes) -> str:
    """Return the cells of a workbook with the formats of their numbers."""
    lines = []
    with closing(openpyxl.load_workbook(io.BytesIO(content))) as book:
        for sheet in book:
            widths = [round(each.width) for each in sheet.column_dimensions.values()]
            lines.append(f"sheet {sheet.title}, {sheet.freeze_panes}, widths {sum(widths)}")
            for row in sheet.iter_rows():
                cells = [_of_cell(each.value) for each in row]
                formats = [
                    "" if each.number_format == "General" else f" ({each.number_format})" for each in row
                ]
                lines.append(" | ".join(map("".join, zip(cells, formats, strict=True))))
    return "\n".join(lines)


def _of_cell(value: Any) -> str:
    if isinstance(value, float) or (value == 0 and value is not False):  # a workbook's 0.0 is read as 0
        return number(float(value))
    return "" if value is None else str(value)


def text_of_arrays(content: bytes) -> str:
    """Return the arrays of a file of NumPy: their shapes and their numbers."""
    with np.load(io.BytesIO(content)) as arrays:
        return "\n".join(
            f"{name} {each.shape} {summed(each.ravel().tolist())}" for name, each in sorted(arrays.items())
        )


def main(*words: str) -> int:
    """Compare, or record anew; return how many steps differ."""
    recording, count = "--record" in words, 0
    for path in rooms(*(word for word in words if word != "--record")).values():
        if recording:
            record(path)
            continue
        for difference in differences(path):
            count += 1
            sys.stdout.write(f"{difference}\n")
    return count


if __name__ == "__main__":
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":  # as the tests have it: read when NumPy is loaded
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | {"OPENBLAS_NUM_THREADS": "1"})  # noqa: S606
    sys.path.insert(0, str(Path(__file__).parents[1]))
    sys.exit(main(*sys.argv[1:]) > 0)
