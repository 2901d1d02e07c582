"""Entry point of the command: Ctrl-C during the imports, a few seconds, ends it silently."""

from __future__ import annotations

import errno
import os
import signal
import sys
from contextlib import suppress

from jointstiff.service.process import collect_rarely, use_one_thread


def main() -> None:
    """Entry point of the command."""
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not so under nohup
    if interruptible:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    use_one_thread()
    collect_rarely()
    from jointstiff.service.cli.app import app  # here, as this is what takes long

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # Python's own at the end would print a traceback
    except OSError as error:
        if error.filename is not None:  # not the output
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if error.errno != errno.EPIPE:  # whoever read the output had enough
            with suppress(OSError):
                print(f"cannot write: {error.strerror or error}\n  remedy: make room", file=sys.stderr)  # noqa: T201
        sys.exit(2)
