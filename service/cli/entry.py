"""Entry point of the command: Ctrl-C during the imports, a few seconds, ends it silently."""

from __future__ import annotations

import signal

from jointstiff.service.threads import use_one_thread


def main() -> None:
    """Entry point of the command."""
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not so under nohup
    if interruptible:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    use_one_thread()
    from jointstiff.service.cli.app import app  # here, as this is what takes long

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    app()
