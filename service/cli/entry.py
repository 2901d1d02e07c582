"""Entry point of the command `jointstiff`.

Imports take a few seconds; Ctrl-C during this time ends the command without a traceback.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
from contextlib import suppress

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
        if error.filename is not None:  # an error of a named file, not of the standard output
            raise
        # Text left in the buffer goes to /dev/null, so that Python prints no traceback when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if error.errno != errno.EPIPE:  # EPIPE: the reader, such as `head`, has closed the pipe
            with suppress(OSError):
                reason = error.strerror or error
                print(f"cannot write: {reason}\n  remedy: free space for the output", file=sys.stderr)  # noqa: T201
        sys.exit(2)
