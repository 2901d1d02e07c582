"""Settings of the service: the help text of each option describes its field."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from jointstiff.service.process import FORMAT_VARIABLE, LogFormat

DatabaseUrl = Annotated[
    str,
    typer.Option(
        envvar="JOINTSTIFF_DATABASE",
        metavar="URL",
        help="Database: sqlite:///FILE or postgresql://USER:PASSWORD@HOST/NAME.",
    ),
]
KeysFilePath = Annotated[
    Path | None,
    typer.Option(
        envvar="JOINTSTIFF_KEYS_FILE",
        metavar="FILE",
        help="File of access keys, such as a secret of a container; the file contains only hashes of the "
        "keys.",
    ),
]
LaboratoryFile = Annotated[
    Path | None,
    typer.Option(
        envvar="JOINTSTIFF_LABORATORY",
        metavar="FILE",
        help="TOML file that describes the laboratory that issues reports; default: none.",
    ),
]
NoUpgrade = Annotated[
    bool,
    typer.Option(
        "--no-upgrade",
        help="Refuse a database of an earlier layout; upgrade such a database by `jointstiff database "
        "upgrade`.",
    ),
]
LogLines = Annotated[
    LogFormat,
    typer.Option(
        envvar=FORMAT_VARIABLE,
        help="Format of the log: text, or JSON with one line per request.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of `jointstiff serve`."""

    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1"
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="Port on which the service listens; 0 chooses any free port."),
    ] = 8000
    database: DatabaseUrl = "sqlite:///jointstiff.db"
    workers: Annotated[
        int,
        typer.Option(
            min=0,
            max=64,
            help="Number of worker processes for long runs; 0 if the workers run elsewhere.",
        ),
    ] = 1
    allowed_host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Additional host name by which the service is addressed; '*' for any name, with "
            "--no-access-control. Repeatable.",
        ),
    ] = None
    no_access_control: Annotated[
        bool,
        typer.Option(
            "--no-access-control",
            help="Require no keys; use this option only behind an authenticating proxy. Needs "
            "--allowed-host.",
        ),
    ] = False
    quota: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="MEGABYTES",
            help="Quota of the database: the service refuses new resources (507) once the database has this "
            "size; default: none.",
        ),
    ] = None
    metrics_port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="Port for metrics in the format of Prometheus; default: none."),
    ] = None
    metrics_host: Annotated[
        str,
        typer.Option(
            help="Address on which the metrics port listens; everyone who reaches this address can read the "
            "metrics."
        ),
    ] = "127.0.0.1"
    log_format: LogLines = LogFormat.TEXT
    require_key: Annotated[
        bool,
        typer.Option(
            "--require-key",
            help="Require a key (`jointstiff keys create`) even for requests from this machine.",
        ),
    ] = False
    await_key: Annotated[
        bool,
        typer.Option(
            "--await-key",
            help="Start even without a valid key; other machines are refused (403) until a key is created.",
        ),
    ] = False
    no_upgrade: NoUpgrade = False
    keys_file: KeysFilePath = None
    laboratory: LaboratoryFile = None
