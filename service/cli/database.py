"""Commands that look after a database: `backup`, `restore`, `doctor`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jointstiff.service.cli.options import DatabaseUrl

if TYPE_CHECKING:
    from jointstiff.service.store.backups import Manifest

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of the backup.")]


def backup(folder: Folder, *, database: DatabaseUrl) -> None:
    """Copy a database to a new folder; the service may run."""
    from jointstiff.service.store.backups import back_up
    from jointstiff.service.tables.terminal import console

    manifest = back_up(database, folder)
    console().print(f"{folder}: {_counts(manifest)}", markup=False, soft_wrap=True)


def restore(
    folder: Folder,
    *,
    database: DatabaseUrl,
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite",
            help="Replace a database that is not empty; an SQLite file is renamed.",
        ),
    ] = False,
) -> None:
    """Restore a backup to a database that no service uses."""
    from jointstiff.service.store.backups import restore as put_back
    from jointstiff.service.tables.terminal import console

    manifest = put_back(database, folder, overwrite=overwrite)
    origin = f"made {manifest.made_at:%Y-%m-%d %H:%M} UTC by Jointstiff {manifest.jointstiff}"
    console().print(f"{_counts(manifest)}; {origin}", markup=False, soft_wrap=True)


def doctor(*, database: DatabaseUrl) -> None:
    """Check a database for faults; exit status 1 if it has any."""
    from jointstiff.service.tables.terminal import console
    from jointstiff.service.workers.doctor import examine

    examination = examine(database)
    for fault in examination.faults:
        line = f"{fault.code}: {fault.where}: {fault.reason}\n  remedy: {fault.remedy}"
        console().print(line, markup=False, soft_wrap=True)
    counted = ", ".join(f"{count:,} × {name}" for name, count in examination.counted.items()) or "nothing"
    console().print(f"read {counted}; faults: {len(examination.faults)}", markup=False, soft_wrap=True)
    raise typer.Exit(1 if examination.faults else 0)


def _counts(manifest: "Manifest") -> str:
    shown = ("robots", "measurement_sets", "jobs")
    return ", ".join(f"{manifest.tables[name].rows:,} {name.replace('_', ' ')}" for name in shown)
