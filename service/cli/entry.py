"""Entry point of the command `jointstiff`.

Imports take a few seconds; Ctrl-C during this time ends the command without a traceback.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
from contextlib import suppress
from typing import NoReturn

from jointstiff.service.process import collect_rarely, use_one_thread


def main() -> None:
    """Run the command `jointstiff`.

    Ctrl-C during the imports ends it without a traceback. A failed write to the standard output ends it with
    status 2; the reason is printed unless the reader has closed the pipe.
    """
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # nohup ignores the signal
    if interruptible:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    use_one_thread()
    collect_rarely()
    # Imported only now, after the handling of Ctrl-C is set, as this import takes seconds.
    from jointstiff.service.cli.app import app

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # a failed flush when Python ends would print a traceback
    except OSError as error:
        is_of_named_file = error.filename is not None
        if is_of_named_file:
            raise
        _end_after_failed_write(error)


def _end_after_failed_write(error: OSError) -> NoReturn:
    """End the command with status 2 after a failed write to the standard output, and print the reason."""
    # Text left in the buffer goes to /dev/null, so that Python prints no traceback when it ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    reader_has_closed = error.errno == errno.EPIPE  # such as `head`, which needs no message
    if not reader_has_closed:
        reason = error.strerror or error
        with suppress(OSError):
            print(f"cannot write: {reason}\n  remedy: free space for the output", file=sys.stderr)  # noqa: T201
    sys.exit(2)
