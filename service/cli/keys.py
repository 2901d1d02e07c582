"""Commands that make, list and revoke keys, on the database itself or in a file of keys."""

from __future__ import annotations

from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import TYPE_CHECKING, Annotated, Final, Literal

import typer

from jointstiff.service.cli import options as cli
from jointstiff.service.settings import DatabaseUrl, KeysFilePath

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from jointstiff.schemas.access import Key
    from jointstiff.service.security.keys import KeysFile
    from jointstiff.service.store.access import AccessKeys
    from jointstiff.service.store.store import Store
    from jointstiff.service.store.tables import AccessKey
    from jointstiff.service.tables.table import Table

    WriteAudit = Callable[[AccessKey, str, str, int], object]

LINK_TIME: Final = timedelta(minutes=10)
"""Time for which a link can be used."""

keys = typer.Typer(help="Create, list and revoke the keys that open a service.", no_args_is_help=True)


KeyId = Annotated[str, typer.Argument(metavar="ID", help="Id of the key; see `jointstiff keys list`.")]


@keys.command()
def create(
    name: Annotated[
        str, typer.Argument(help="Person or device that holds the key, such as 'tablet hall 3'.")
    ],
    *,
    role: Annotated[
        Literal["viewer", "operator", "admin"],
        typer.Option(
            help="Role of the key: viewer reads; operator also posts and deletes; admin also issues keys "
            "and reads the audit."
        ),
    ],
    expires: Annotated[
        datetime | None,
        typer.Option(
            formats=["%Y-%m-%d"],
            help="First day (UTC) on which the key is no longer valid; default: the key is always valid.",
        ),
    ] = None,
    database: DatabaseUrl = "sqlite:///jointstiff.db",
    keys_file: KeysFilePath = None,
) -> None:
    """Create a key, and print it once."""
    from pydantic import ValidationError

    from jointstiff.schemas.access import KeyRequest
    from jointstiff.service.security.keys import make_key

    now = datetime.now(UTC)
    expires_at = None if expires is None else expires.replace(tzinfo=UTC)
    try:
        request = KeyRequest(name=name, role=role, expires_at=expires_at)
    except ValidationError as error:
        raise typer.BadParameter("must be 1 to 200 printable characters", param_hint="NAME") from error
    if expires_at is not None and expires_at <= now:
        raise typer.BadParameter("must be in the future", param_hint="--expires")
    text, record = make_key(request.name, request.role, now, expires_at)
    with _open_keys(database, keys_file, is_new=True) as (stored_keys, write_audit):
        stored_keys.add(record)
        write_audit(record, "POST", "createKey", 201)
    typer.echo(text)
    cli.warn(f"the key is not shown again; to revoke the key: jointstiff keys revoke {record.id}")


@keys.command("list")
def list_keys(*, database: DatabaseUrl = "sqlite:///jointstiff.db", keys_file: KeysFilePath = None) -> None:
    """List all keys, including revoked ones."""
    from jointstiff.service.security.keys import describe_key
    from jointstiff.service.tables.terminal import console, lay_out_parts

    with _open_keys(database, keys_file) as (stored_keys, _):
        found = [describe_key(key, is_in_file=keys_file is not None) for key in stored_keys.all()]
    console().print(lay_out_parts([make_keys_table(found, datetime.now(UTC))]))


@keys.command()
def revoke(
    key_id: KeyId, *, database: DatabaseUrl = "sqlite:///jointstiff.db", keys_file: KeysFilePath = None
) -> None:
    """Revoke a key, and end its sessions."""
    with _open_keys(database, keys_file) as (stored_keys, write_audit):
        revoked = stored_keys.revoke(key_id, datetime.now(UTC))
        write_audit(revoked, "DELETE", "revokeKey", 200)
    typer.echo(f"revoked {revoked.id}, {revoked.name}; running services refuse this key within a second")


@keys.command()
def link(
    key_id: KeyId,
    *,
    server: cli.ServerAddress = "http://127.0.0.1:8000",
    database: DatabaseUrl = "sqlite:///jointstiff.db",
    keys_file: KeysFilePath = None,
) -> None:
    """Print a link, with a QR code, that signs one browser in with a key: once, within ten minutes."""
    import segno

    from jointstiff.service.security.keys import hash_secret, make_secret_token
    from jointstiff.service.store.store import Store

    now, token = datetime.now(UTC), make_secret_token("jsl")
    with _open_keys(database, keys_file) as (stored_keys, _):
        found = {key.id: key for key in stored_keys.all()}.get(key_id)
    if found is None or not found.is_live(now):
        raise cli.print_failure(f"no valid key has the id {key_id!r}", "see `jointstiff keys list`")
    with Store.open(database) as store:
        store.sessions.offer(hash_secret(token), key_id, now, now + LINK_TIME)
        _record_in_audit(store, found, "POST", "createLink", 201)
    # Browsers do not send the part after #, so that no server and no log gets the token.
    address = f"{server.rstrip('/')}/#/sign-in/{token}"
    segno.make(address, error="l", micro=False).terminal(compact=True)
    typer.echo(address)
    cli.warn(
        f"the link works once, and signs one browser in as {found.name} ({found.role}), until "
        f"{now + LINK_TIME:%H:%M} UTC"
    )


@contextmanager
def _open_keys(
    database: str, keys_file: Path | None, *, is_new: bool = False
) -> Iterator[tuple[KeysFile | AccessKeys, WriteAudit]]:
    """Open the keys of a file or of a database; yield (keys, function that writes an entry of the audit).

    A missing database is created only if `is_new`. For a file of keys the function does nothing.

    Raises:
        StoreError: the database is missing or cannot be used.
        typer.Exit: the block names a key that does not exist.
    """
    from jointstiff.service.problems import NotFoundError
    from jointstiff.service.security import keys as filed
    from jointstiff.service.store.database import open_existing
    from jointstiff.service.store.store import Store

    try:
        if keys_file is not None:
            yield filed.KeysFile(keys_file), lambda *_: None  # a file has no audit
            return
        if not is_new:
            open_existing(database).close()
        with Store.open(database) as store:
            yield store.keys, partial(_record_in_audit, store)
    except NotFoundError as error:
        raise cli.print_failure(error.reason, "see `jointstiff keys list` for the ids") from error


def _record_in_audit(store: Store, key: AccessKey, method: str, operation: str, status: int) -> None:
    """Write into the audit that a command at the terminal carried out an operation on a key."""
    from jointstiff.service.store.tables import AuditEntry

    store.audit.add(
        AuditEntry(
            at=datetime.now(UTC),
            key_id=None,
            key_name=None,
            address="terminal",
            method=method,
            operation=operation,
            path=f"/v1/keys/{key.id}",
            status=status,
        )
    )


def make_keys_table(keys: Sequence[Key], now: datetime) -> Table:
    """Return a table with a row for each key: id, name, role, validity, and times in UTC."""
    from jointstiff.service.tables.table import Column, Table

    columns: dict[str, list[str]] = {
        "id": [key.id for key in keys],
        "name": [key.name for key in keys],
        "role": [key.role for key in keys],
        "state": [_describe_validity(key, now) for key in keys],
        "made": [_format_time(key.created_at) for key in keys],
        "last used": [_format_time(key.last_used_at) for key in keys],
    }
    return Table(
        [Column(name, cells, text=True) for name, cells in columns.items()], title="Keys, times in UTC"
    )


def _describe_validity(key: Key, now: datetime) -> str:
    """Return whether a key is valid, expired or revoked as a text, with the time of the end, if any."""
    if key.revoked_at is not None:
        return f"revoked {_format_time(key.revoked_at)}"
    if key.expires_at is None:
        return "valid"
    return f"{'valid until' if now < key.expires_at else 'expired'} {_format_time(key.expires_at)}"


def _format_time(time: datetime | None) -> str:
    """Return a time to the minute as text; a dash for None."""
    return "—" if time is None else f"{time:%Y-%m-%d %H:%M}"
