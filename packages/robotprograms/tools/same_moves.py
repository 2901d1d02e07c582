"""Compare the moves and bytes that two versions of the readers make of the same programs.

    python same_moves.py record FOLDER FILE [PROGRAMS]   write digests of what the package in FOLDER reads
    python same_moves.py compare FILE FILE               print the programs that two versions read differently

FOLDER has the package `robotprograms`, as `src/` does in each commit. The programs are the samples, the forms
of people, those with each statement of `constructs/`, and PROGRAMS random ones of each language (2,560 unless
stated). Digests cover targets, frames, moves, remarks, faults, and the bytes with first coordinates moved.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random

TESTS = Path(__file__).parents[1] / "tests"
FILES = (
    *(["cell.src", "cell.dat"], ["CELL.LS"], ["calib.LS"], ["cell.mod"], ["cell.script"], ["cell.csv"]),
    *(["foreign.mod"], ["written.mod"]),
)

Files = list[tuple[str, bytes]]


def list_programs(count: int) -> Iterator[tuple[str, Files]]:
    """Yield title and files of each program, with `count` random ones of each language."""
    for names in FILES:
        yield " ".join(names), [(name, (TESTS / "samples" / name).read_bytes()) for name in names]
    yield from list_forms()
    yield from list_constructs()
    yield from list_random_programs(count)


def list_forms() -> Iterator[tuple[str, Files]]:
    """Yield title and files of the programs as people write them."""
    from program_support.program_forms import LANGUAGES, read_forms

    for language in LANGUAGES:
        for form in read_forms(language):
            yield f"form {form.title}", form.files


def list_constructs() -> Iterator[tuple[str, Files]]:
    """Yield title and files of the programs with each statement of `constructs/`."""
    from program_support.constructs import FOLDER, Constructs

    for path in sorted(FOLDER.glob("*.txt")):
        constructs = Constructs.read(path)
        for subject in constructs.subjects:
            for statement, _ in subject.statements:
                yield f"{path.stem} {subject.title}: {statement}", constructs.files(subject, statement)


def list_random_programs(count: int) -> Iterator[tuple[str, Files]]:
    """Yield title and files of random programs."""
    from program_support.random_programs import LANGUAGES

    for kind, language in LANGUAGES.items():
        for seed in range(count):
            text = language.make(Random(seed)).text
            yield f"random {kind} {seed}", [(language.name, text.encode())]


def describe(files: Files, *, trusted: bool) -> str:
    """Return all that a version reads of a program, as text."""
    import numpy as np
    from program_support.written_programs import moves_of, rewritten

    from robotprograms import ProgramError, read_program

    try:
        program = read_program(files, leave_others=True, trust_routines=trusted)
    except ProgramError as error:
        return repr((error.faults, error.count, error.left_moves))
    targets = program.targets
    shifted = targets.values[:, :7] + 0.125 * (np.arange(7) == 0)
    written = rewritten(program, np.arange(len(targets)), shifted)[0] if len(targets) else []
    # Rounding errors of poses are not compared.
    poses = [None if each.pose is None else np.round(each.pose, 9) + 0.0 for each in targets.frames]
    frames = [
        (each.name, None if pose is None else pose.tolist())
        for each, pose in zip(targets.frames, poses, strict=True)
    ]
    columns = targets.base.tolist(), targets.tool.tolist(), targets.spans.tolist(), targets.values.tolist()
    numbers = targets.names, targets.source.tolist(), targets.line.tolist(), targets.literals, frames, columns
    text = (numbers, moves_of(program), program.left_alone, program.left_moves, program.faults, written)
    return repr(text).replace("-0.0", "0.0")


def record(folder: str, file: str, count: int) -> None:
    """Write the digest of each program as a version in a folder reads it."""
    sys.path[:0] = [folder, str(TESTS)]
    digests = {}
    for title, files in list_programs(count):
        for trusted in (False, True):
            text = describe(files, trusted=trusted)
            digests[f"{title}, trusted: {trusted}"] = hashlib.sha256(text.encode()).hexdigest()
    Path(file).write_text(json.dumps(digests), encoding="utf-8")


def compare(first: str, second: str) -> int:
    """Print the programs whose digests differ; return how many these are."""
    before, after = (json.loads(Path(file).read_text(encoding="utf-8")) for file in (first, second))
    differ = [title for title in {**before, **after} if before.get(title) != after.get(title)]
    for title in differ[:20]:
        print(title)
    print(f"{len(differ)} of {len(before)} differ")
    return len(differ)


if __name__ == "__main__":
    if sys.argv[1] == "compare":
        sys.exit(bool(compare(*sys.argv[2:4])))
    record(*sys.argv[2:4], count=int([*sys.argv, "2560"][4]))
