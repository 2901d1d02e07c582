"""`jointstiff watch`: post the finished files of a folder as measurements of a robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jointstiff.service.cli.answers import warn
from jointstiff.service.cli.options import file_option

if TYPE_CHECKING:
    from jointstiff.service.library.folder import WatchedFolder


def watch(
    folder: Annotated[
        Path,
        typer.Argument(
            exists=True,
            file_okay=False,
            metavar="FOLDER",
            help="Folder to take finished files from; they go to its done/ or rejected/.",
        ),
    ],
    *,
    robot: Annotated[str, typer.Option(metavar="ID", help="Id of the robot on the service.")],
    template: Annotated[
        Path | None,
        file_option("JSON file with the import options for tables; default: only JSON files are read."),
    ] = None,
    server: Annotated[
        str,
        typer.Option(
            "--server",
            "--url",
            envvar="JOINTSTIFF_SERVER",
            metavar="ADDRESS",
            help="Address of a running service.",
        ),
    ] = "http://127.0.0.1:8000",
    key: Annotated[
        str | None, typer.Option(envvar="JOINTSTIFF_KEY", metavar="KEY", help="Key with the role operator.")
    ] = None,
    interval: Annotated[
        float, typer.Option(min=0.1, metavar="SECONDS", help="Time between two checks of the folder, in s.")
    ] = 5.0,
    settle: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="Time in s after which an unchanged file that is not understood is rejected.",
        ),
    ] = 60.0,
    once: Annotated[bool, typer.Option("--once", help="End when all files are processed.")] = False,
) -> None:
    """Post and identify the files of a folder as they arrive.

    A file is finished when two looks find it unchanged. Programs that write slowly should write under another
    name, such as .part, and rename.
    """
    import time

    from jointstiff.schemas.imports import ImportRequest
    from jointstiff.service.library.campaigns import read_document
    from jointstiff.service.library.client import Client
    from jointstiff.service.library.delivery import Delivery
    from jointstiff.service.library.errors import AwayError
    from jointstiff.service.library.folder import WatchedFolder
    from jointstiff.service.tables.terminal import console

    try:
        options = None if template is None else read_document(template, ImportRequest)
        with Client(server, key, patience=0.0) as client:
            delivery = Delivery(client, robot, options)
            try:
                delivery.check()
            except AwayError as error:
                warn(f"{error.problem.detail}; files stay until it answers")
            watched = WatchedFolder(folder, delivery, clock=time.monotonic, settle=settle)
            console().print(f"watching {folder}; Ctrl-C ends", markup=False, soft_wrap=True)
            _look(watched, folder)
            while not (once and watched.is_idle):
                time.sleep(interval)
                _look(watched, folder)
    except KeyboardInterrupt:
        return


def _look(watched: "WatchedFolder", folder: Path) -> None:
    """Look once, and say what happened."""
    from jointstiff.service.tables.terminal import console

    for event in watched.look():
        line = f"{event.file or folder}: {event.message}".replace("\n", "; ")
        line = "".join(character if character.isprintable() else "\ufffd" for character in line)
        if event.kind == "taken":
            console().print(line, markup=False, soft_wrap=True)
        else:
            warn(line)
