"""CPU time and peak memory of commands beside bare imports, and the memory of an idle service."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Final

import httpx2

from benchmarks.report import Figure, Section, times_table
from benchmarks.services import Service, post_campaign
from benchmarks.timing import Times

__all__ = ["run"]

TERMINAL: Final = "python -c 'import typer, rich'"
NUMERICS: Final = "python -c 'import numpy, pinocchio, cvxpy'"
IDENTIFY: Final = "identify, 19 configurations"

# A small process between: a child inherits the peak of a large parent (Linux books it at exec).
_LAUNCHER: Final = """
import json, os, sys
null = [(os.POSIX_SPAWN_OPEN, each, os.devnull, os.O_WRONLY, 0) for each in (1, 2)]
pid = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=null)
_, status, used = os.wait4(pid, 0)
print(json.dumps([status, used.ru_utime + used.ru_stime, used.ru_maxrss]))
"""
_SETTLE_SECONDS: Final = 5.0
_MEGABYTES: Final = 1 / 1024
"""In a kibibyte."""


def run(*, quick: bool) -> list[Section]:
    """Compare the commands with what they cannot do without; then look at an idle service."""
    with tempfile.TemporaryDirectory() as folder:
        campaign = str(Path(folder) / "campaign.json")
        _cost(_jointstiff("simulate", campaign))
        commands = {
            TERMINAL: [sys.executable, "-c", "import typer, rich"],
            "--help": _jointstiff("--help"),
            "--version": _jointstiff("--version"),
            "identify --help": _jointstiff("identify", "--help"),
            NUMERICS: [sys.executable, "-c", "import numpy, pinocchio, cvxpy"],
            IDENTIFY: _jointstiff("identify", campaign),
            "compare, 19 configurations": _jointstiff("compare", campaign),
            "simulate": _jointstiff("simulate", campaign, "--overwrite"),
        }
        return [_commands(commands, rounds=1 if quick else 5), _idle(f"sqlite:///{folder}/idle.db")]


def _jointstiff(*arguments: str) -> list[str]:
    return [str(Path(sys.executable).with_name("jointstiff")), *arguments]


def _commands(commands: dict[str, list[str]], rounds: int) -> Section:
    costs = [{name: _cost(command) for name, command in commands.items()} for _ in range(rounds)]
    times = Times({name: [cost[name][0] for cost in costs] for name in commands}, {})
    peaks = {name: f"{median(cost[name][1] for cost in costs):.0f} MB" for name in commands}
    relative = {name: f"{times.ratio(name, NUMERICS):.2f}" for name in commands}
    extra = [("/ numpy, pinocchio, cvxpy", relative), ("peak memory", peaks)]
    columns, rows = times_table(times, TERMINAL, extra)
    what = f"{IDENTIFY}: CPU / import numpy, pinocchio, cvxpy"
    return Section(
        title="CPU time of commands, each in a fresh process, with bytecode",
        columns=("process", "CPU / typer, rich", *columns[2:]),
        rows=rows,
        figures=(
            Figure("--help: CPU / import typer, rich", times.ratio("--help", TERMINAL), "at most", 1.5, "×"),
            Figure(what, times.ratio(IDENTIFY, NUMERICS), "at most", 1.5, "×"),
        ),
        notes=("user and system time of the process, medians of rounds in which all take turns",),
        data={"seconds": times.seconds},
    )


def _cost(command: list[str]) -> tuple[float, float]:
    """CPU time [s] and peak resident memory [MB] of a process."""
    launcher = [sys.executable, "-c", _LAUNCHER, *command]
    done = subprocess.run(launcher, check=True, stdout=subprocess.PIPE, text=True)
    status, seconds, kilobytes = json.loads(done.stdout)
    if status != 0:
        raise RuntimeError(f"{' '.join(command)} ended with status {status}")
    return seconds, kilobytes * _MEGABYTES


def _idle(database: str) -> Section:
    """Sum the memory of service and worker once both have computed, and so hold cvxpy."""
    with Service(database, 1) as service, httpx2.Client(base_url=service.url, timeout=120.0) as client:
        request: dict[str, object] = {"measurement_set_id": post_campaign(client, 19)}
        client.post("/v1/runs", json=request).raise_for_status()
        request["resampling"] = {"size": 10, "repetitions": 2000}
        run_id = client.post("/v1/runs", json=request, params={"wait": 0}).raise_for_status().json()["id"]
        while client.get(f"/v1/jobs/{run_id}").json()["state"] in {"queued", "running"}:
            time.sleep(0.2)
        time.sleep(_SETTLE_SECONDS)
        processes = {"service": service.process.pid}
        processes |= {f"worker {n}": pid for n, pid in enumerate(service.workers(), 1)}
        found = {name: (_memory(pid, "Rss"), _memory(pid, "Pss")) for name, pid in processes.items()}
    total = tuple(map(sum, zip(*found.values(), strict=True)))
    rows = [(name, *(f"{each:.0f} MB" for each in sizes)) for name, sizes in (found | {"sum": total}).items()]
    return Section(
        title="Memory of an idle service and its worker after a run in each",
        columns=("process", "RSS", "PSS"),
        rows=tuple(rows),
        figures=(Figure("idle service and worker, with cvxpy: RSS", total[0], "at most", 550, " MB"),),
        notes=("RSS counts what processes share once for each, PSS once; no other process waits for them",),
        data={name: list(sizes) for name, sizes in found.items()},
    )


def _memory(pid: int, name: str) -> float:
    """A sum over the mappings of a process [MB]."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    found = re.search(rf"^{name}:\s+(\d+) kB$", rollup, re.MULTILINE)
    if found is None:
        raise RuntimeError(f"no {name} of process {pid}")
    return int(found[1]) * _MEGABYTES
