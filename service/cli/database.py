"""Commands for the database of a service: upgrade to the layout of this version, status, check."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Annotated

import typer

from jointstiff.service.settings import DatabaseUrl

if TYPE_CHECKING:
    from jointstiff.service.store.store import Store

database = typer.Typer(help="Upgrade and check the database of a service.", no_args_is_help=True)


@database.command()
def upgrade(
    *,
    database: DatabaseUrl = "sqlite:///jointstiff.db",
    no_copy: Annotated[
        bool,
        typer.Option("--no-copy", help="Do not copy an SQLite file to FILE.before-NNNN before the upgrade."),
    ] = False,
) -> None:
    """Upgrade a database to the layout of this version, and rewrite documents of earlier forms.

    Services and workers do so by themselves when they start, unless a step removes what older versions need.
    """
    from jointstiff.service.store.store import Store
    from jointstiff.service.store.upgrading import upgrade_tables

    upgrade_tables(database, typer.echo, copied=not no_copy)
    with Store.open(database) as store:
        while store.old_documents.rewrite(_REPORT_SECONDS):
            typer.echo(f"documents of an earlier form: {store.old_documents.count()} left")
        typer.echo(_describe(store))


_REPORT_SECONDS = 2.0  # between two lines of progress


@database.command()
def status(*, database: DatabaseUrl = "sqlite:///jointstiff.db") -> None:
    """Print the layout of a database, the steps that are due, and the number of documents to rewrite."""
    from jointstiff.service.store.layouts import LAYOUT, can_upgrade
    from jointstiff.service.store.store import Store

    layout = _read_layout_of(database)
    if layout is None:
        typer.echo(f"the database has no tables yet; this version will make layout {LAYOUT}")
    elif can_upgrade(layout):
        typer.echo(_describe_earlier(layout))
    else:
        with Store.open(database) as store:
            typer.echo(_describe(store))


@database.command()
def check(*, database: DatabaseUrl = "sqlite:///jointstiff.db") -> None:
    """Check tables and references, and read each row as a restore does; exit with status 1 after a fault.

    Nothing is changed. A database of an earlier layout is checked, too, if this version can upgrade it.
    """
    from jointstiff.service.archive.checking import check_database
    from jointstiff.service.store.database import open_existing
    from jointstiff.service.store.layouts import can_upgrade, refuse_unusable

    layout = _read_layout_of(database)
    if layout is None:
        typer.echo("the database has no tables yet: there is nothing to check")
        return
    if can_upgrade(layout):
        typer.echo(f"{_describe_earlier(layout)}; the tables are compared after an upgrade")
    else:
        with closing(open_existing(database)) as opened:
            refuse_unusable(layout, opened.dialect)
    checked = check_database(database)
    for sentence in checked.remarks + checked.faults:
        typer.echo(sentence)
    typer.echo(f"{checked.documents} documents read, {len(checked.faults)} faults")
    if checked.faults:
        raise typer.Exit(1)


def _read_layout_of(url: str) -> str | None:
    """Return the name of the layout of an existing database; None if it has no tables of ours."""
    from jointstiff.service.store.database import open_existing
    from jointstiff.service.store.tables import read_layout

    with closing(open_existing(url)) as opened, opened.reading() as connection:
        return read_layout(connection)


def _describe_earlier(layout: str) -> str:
    """Return the state of a database of an earlier layout in words, with what an upgrade would do."""
    from jointstiff.service.store.steps import list_due_steps

    due = ", ".join(step.layout for step in list_due_steps(layout))
    return f"layout {layout} of an earlier version; `jointstiff database upgrade` would lead to: {due}"


def _describe(store: Store) -> str:
    """Return the state of an opened store in words."""
    from jointstiff.service.store.layouts import LAYOUT

    return f"layout {LAYOUT}; documents of an earlier form: {store.old_documents.count()}"
