"""Commands that write a database to an archive, and restore an archive into a database."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jointstiff.service.settings import DatabaseUrl

if TYPE_CHECKING:
    from jointstiff.service.archive.restoring import Restored
    from jointstiff.service.archive.writing import Keys

ArchivePath = Annotated[Path, typer.Argument(metavar="FILE.zip", help="The archive.")]


def archive(
    file: ArchivePath,
    *,
    database: DatabaseUrl = "sqlite:///jointstiff.db",
    with_key_hashes: Annotated[
        bool,
        typer.Option(
            "--with-key-hashes",
            help="Archive also the hashes of access keys, so that the keys open the restored service.",
        ),
    ] = False,
    without_keys: Annotated[
        bool, typer.Option("--without-keys", help="Archive no access keys, not even their names.")
    ] = False,
) -> None:
    """Write all records of a database to a zip file of JSON lines, which every language reads.

    The database may have any layout from 0018 on, and is not changed. Services may go on meanwhile.
    """
    from jointstiff.service.archive.writing import write_archive

    if with_key_hashes and without_keys:
        raise typer.BadParameter("give --with-key-hashes or --without-keys, not both")
    keys: Keys = "hashes" if with_key_hashes else "names"
    if without_keys:
        keys = "none"
    archived = write_archive(database, file, keys, typer.echo)
    for sentence in archived.damaged:
        typer.echo(sentence, err=True)
    kilobytes = file.stat().st_size / 1e3
    typer.echo(f"wrote {file}: layout {archived.manifest.layout}, {kilobytes:,.0f} kB")
    if archived.damaged:
        raise typer.Exit(1)


def restore(
    file: ArchivePath,
    *,
    database: DatabaseUrl = "sqlite:///jointstiff.db",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only print what would be restored; change nothing.")
    ] = False,
) -> None:
    """Add the records of an archive to a database, which is created if it does not exist.

    Records keep their ids; records that the database has already are left as they are. If the command ends
    early, run it again. Exit status 1: some records cannot be restored, and are named.
    """
    from jointstiff.service.archive.restoring import restore_archive
    from jointstiff.service.problems import StoreError

    if not file.is_file():
        raise StoreError(f"there is no file {file}", "give a file that `jointstiff archive` wrote")
    restored = restore_archive(file, database, dry_run=dry_run, notify=typer.echo)
    _print_outcome(restored)
    if restored.refused:
        raise typer.Exit(1)


def _print_outcome(restored: Restored) -> None:
    """Print what an archive of an earlier layout has, and this version has no place for."""
    for outcome in restored.tables.values():
        for sentence in outcome.reasons:
            typer.echo(sentence, err=True)
    if restored.dropped:
        typer.echo("fields without a place in this version, which remain in the archive (documents):")
        for name, count in sorted(restored.dropped.items()):
            typer.echo(f"  {name} ({count})")
