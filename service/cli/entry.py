"""Where the command begins: Ctrl-C while the libraries are read, a few seconds, ends it without a word."""

from __future__ import annotations

import os
import signal
import sys

from jointstiff.service.workers import ONE_THREAD

__all__ = ["main"]


def main() -> None:
    """Entry point of the command."""
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not so under nohup
    if interruptible:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.argv[1:2] == ["worker"]:
        os.environ.update(ONE_THREAD)
    from jointstiff.service.cli.app import app  # here, as this is what takes long

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    app()
