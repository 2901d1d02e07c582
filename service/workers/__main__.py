"""Run a worker that its supervisor started: `python -m jointstiff.service.workers NAME`."""

from __future__ import annotations

import os
import sys

from jointstiff.service.workers.supervisor import DATABASE_VARIABLE
from jointstiff.service.workers.worker import run_worker

if __name__ == "__main__":
    run_worker(os.environ[DATABASE_VARIABLE], sys.argv[1], sys.stdin.fileno())
