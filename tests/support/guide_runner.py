"""Run commands and programs of the guides, each in a process that has imported everything already.

The Python of an installed wheel starts it, and it imports nothing of the repository. Each line of its input
is a JSON object with `folder`, `environment`, `log`, and `command` (arguments of `jointstiff`), `code` or
`shell`. It answers each with the exit status.
"""

import json
import os
import sys
import traceback
from importlib import import_module
from typing import Any

WARM = (
    "cvxpy",
    "jointstiff.service.cli.app",
    "jointstiff.service.library.client",
    "matplotlib.figure",
    "typst",
)


def carry_out(task: dict[str, Any]) -> int:
    """Run a command or a program; return its exit status."""
    output = os.open(task["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(task["folder"])
    os.environ.update(task["environment"])
    try:
        if "code" in task:
            exec(compile(task["code"], "<guide>", "exec"), {"__name__": "__main__"})  # noqa: S102
            return 0
        if "shell" in task:
            os.execvp("bash", ["bash", "-euo", "pipefail", "-c", task["shell"]])  # noqa: S606
        sys.argv = ["jointstiff", *task["command"]]
        import_module("jointstiff.service.cli.entry").main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # noqa: BLE001 - as Python itself would
        traceback.print_exc()
        return 1
    return 0


def main() -> None:
    """Import what takes long once; then answer each line."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    for name in WARM:
        import_module(name)
    simulator = import_module("jointstiff.simulator")
    campaign = simulator.simulate_campaign(simulator.default_arm())
    import_module("jointstiff").identify(campaign)  # which states convex programs that are kept
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            status = carry_out(json.loads(line))
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
