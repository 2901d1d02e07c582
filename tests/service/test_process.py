"""Linear algebra has one thread in every process that we start."""

import os
import subprocess
import sys

import pytest

from jointstiff.service.process import ONE_THREAD

PROGRAM = """
import os, sys
import jointstiff.service.cli.entry as entry
assert "numpy" not in sys.modules, "it has read the environment already"
sys.argv = ["jointstiff", "--version"]
try:
    entry.main()
finally:
    import numpy as np
    np.linalg.solve(np.eye(500), np.ones(500))
    print(len(os.listdir("/proc/self/task")) if sys.platform == "linux" else 1)
"""


@pytest.mark.process
def test_the_command_computes_with_one_thread():
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines()[-1] == "1", done.stdout + done.stderr
