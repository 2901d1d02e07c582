"""Run the child of a service: `python -m jointstiff.service.limited DESCRIPTOR`, of the pipe to it."""

from __future__ import annotations

import os
import sys

from jointstiff.service.limited.child import run_child
from jointstiff.service.logs import FORMAT_VARIABLE, LogFormat, set_log_format

if __name__ == "__main__":
    set_log_format(LogFormat(os.environ.get(FORMAT_VARIABLE, LogFormat.TEXT)))
    run_child(int(sys.argv[1]))
