"""The first five minutes: a server of our own, and a client that knows nothing but its address."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import httpx

from jointstiff.service.library import Client, RefusedError
from jointstiff.service.render import comparison_table, console, problem_text, run_report
from jointstiff.simulator import default_arm, simulate_campaign

_START_SECONDS: Final = 60.0


def run_demo(*, port: int, database: str, once: bool) -> int:
    """Start a service, post an example campaign, print what it answers.

    Args:
        port: TCP port, 0 for a free one.
        database: URL of the store.
        once: end the service after the tables instead of leaving it running.

    Returns:
        Exit status.
    """
    with _service(port, database) as (process, address):
        with Client(address) as client:
            status = _tour(client)
        if status == 0 and not once:
            try:
                console().print(f"\nThe service runs at [bold]{address}[/]; its runs: {address}/v1/runs")
                console().print("Ctrl-C ends it.")
                return process.wait()
            except KeyboardInterrupt:
                return 0
    return status


def _tour(client: Client) -> int:
    """Post the example, print what comes back."""
    out = console()
    campaign = simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)
    try:
        robot, stored = client.post_campaign(campaign)
        out.print(
            f"posted robot {robot.id} and measurement set {stored.id} "
            f"({len(stored.observations)} observations, {len(stored.warnings)} warnings)\n"
        )
        request = {"measurement_set_id": stored.id}
        run = client.runs.wait(client.runs.create(request))
        comparison = client.comparisons.wait(client.comparisons.create(request))
    except RefusedError as refused:
        console(stderr=True).print(problem_text(refused.problem))
        return 1
    out.print(run_report(run))
    out.print()
    out.print(comparison_table(comparison))
    return 0


@contextmanager
def _service(port: int, database: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A service process, ended when the block is left."""
    command = [sys.executable, "-m", "jointstiff", "serve", "--port", str(port), "--database", database]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            yield process, _address(process)
        finally:
            process.terminate()
            process.wait()


def _address(process: subprocess.Popen[str]) -> str:
    """The address, from the line that the service prints once it listens.

    Raises:
        SystemExit: the service ended instead; it has said why itself.
    """
    line = process.stdout.readline() if process.stdout else ""
    found = re.search(r"http://[^\s,]+", line)
    if found is None:
        raise SystemExit(process.wait() or 1)
    where = process.stdout.readline() if process.stdout else ""
    console().print(f"{line}{where}".rstrip(), markup=False, soft_wrap=True)
    address = found[0]
    deadline = time.monotonic() + _START_SECONDS
    while time.monotonic() < deadline:
        try:
            if httpx.get(f"{address}/health", timeout=5.0).is_success:
                return address
        except httpx.TransportError:
            time.sleep(0.05)
    raise SystemExit(1)
