"""Run a worker that its supervisor started: `python -m jointstiff.service.workers NAME`."""

from __future__ import annotations

import os
import sys

from jointstiff.service.process import FORMAT_VARIABLE, LogFormat, collect_rarely, set_log_format

if __name__ == "__main__":
    collect_rarely()
    from jointstiff.service.workers.supervisor import DATABASE_VARIABLE
    from jointstiff.service.workers.worker import run_worker

    set_log_format(LogFormat(os.environ.get(FORMAT_VARIABLE, LogFormat.TEXT)))
    output = sys.stdout.fileno()
    os.set_blocking(output, False)  # a stopped service does not read signs of life: do not wait for it
    run_worker(os.environ[DATABASE_VARIABLE], sys.argv[1], sys.stdin.fileno(), output)
