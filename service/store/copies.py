"""Copies of an SQLite file before an upgrade: `FILE.before-NNNN` (number of the layout after the step).

The name of a copy ends in `.part` until the step is committed, so that the copy of a killed step is replaced.
"""

from __future__ import annotations

import glob
import os
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Final

from jointstiff.service.store.layouts import number_of

_PART: Final = ".part"  # ends the name of a copy until its step is committed


def make_part_path(path: Path, layout: str) -> Path:
    """Return the path of the copy of an SQLite file while the step to a layout is carried out."""
    return path.with_name(f"{path.name}.before-{layout[:4]}{_PART}")


def name_copy(part: Path) -> Path:
    """Remove `.part` from the name of a copy, as the step is committed; return the path of the copy.

    Earlier copies are kept.
    """
    stem = part.with_name(part.name.removesuffix(_PART))
    names = (stem if number == 1 else Path(f"{stem}-{number}") for number in count(1))
    try:
        copy = next(name for name in names if not name.exists())
        part.rename(copy)
    except FileNotFoundError:  # another process found the step committed, and has named the copy
        return stem
    except OSError:  # the upgrade is done, and the copy is complete
        return part
    sync_folder(copy.parent)
    return copy


def name_left_copies(path: Path, layout: str) -> None:
    """Name copies of an SQLite file whose process was killed between the end of its step and the new name.

    Args:
        path: path of the file.
        layout: present layout of the file. A step to a later layout is not committed: its copy is left alone.
    """
    begin = f"{path.name}.before-"
    for part in path.parent.glob(f"{glob.escape(begin)}*{_PART}"):
        number = part.name.removeprefix(begin).removesuffix(_PART)
        is_committed = number.isdecimal() and int(number) <= number_of(layout)
        if is_committed:
            with suppress(FileNotFoundError):  # another process has named the copy meanwhile
                _name_or_remove(part)


def _name_or_remove(part: Path) -> None:
    """Name a copy that is complete; remove one that a process was killed in writing.

    Raises:
        FileNotFoundError: another process has named the copy.
    """
    _, journal = files_of(part)
    is_complete = part.stat().st_size > 0 and not journal.exists()
    if is_complete:
        name_copy(part)
    else:
        remove_part(part)


def files_of(part: Path) -> tuple[Path, Path]:
    """Return the paths of a copy and of SQLite's journal of this copy."""
    return part, Path(f"{part}-journal")


def remove_part(part: Path) -> None:
    """Remove a copy whose step was not carried out."""
    for left in files_of(part):
        with suppress(OSError):
            left.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Write the entries of a folder to the disk, so that a new name outlasts a failure of the power."""
    with suppress(OSError):  # some file systems cannot
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
