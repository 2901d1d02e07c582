"""The first five minutes: a service, and a client in a thread of it that knows nothing but its address."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from typing import Any, Final

from jointstiff.schemas.comparison import ComparisonSummary
from jointstiff.schemas.measurement.measurement_set import MeasurementSetSummary
from jointstiff.schemas.run.run import RunSummary
from jointstiff.service.kinds.comparison import COMPARISON
from jointstiff.service.kinds.report import job_report
from jointstiff.service.kinds.run import RUN
from jointstiff.service.library.client import Client
from jointstiff.service.library.errors import RefusedError
from jointstiff.service.server import run_server
from jointstiff.service.tables.terminal import console, problem_text
from jointstiff.simulator import default_arm, simulate_campaign

_FAILED: Final = 1


def run_demo(*, port: int, database: str, once: bool) -> int:
    """Serve, and show an example campaign; what an earlier demonstration stored is shown again.

    The service is this process, not a child of it, so that no signal can leave one without the other.

    Args:
        port: TCP port, 0 for a free one.
        database: URL of the store.
        once: end the service after the tables instead of leaving it running.

    Returns:
        Exit status.

    Raises:
        StoreError: the database cannot be used.
        ServerError: the address cannot be listened on.
    """
    statuses = [0]

    def show(address: str) -> None:
        statuses.append(_FAILED)  # unless it gets to its end
        try:
            statuses.append(_tour(address, once=once))
        finally:
            if once or statuses[-1]:
                os.kill(os.getpid(), signal.SIGTERM)
        if not once and not statuses[-1]:
            console().print("Ctrl-C ends the service.")

    try:
        run_server("127.0.0.1", port, database, workers=1, then=show)
    except KeyboardInterrupt:
        return statuses[-1]
    except SystemExit as ended:  # of the handler that heard SIGTERM, or of a server that could not start
        if ended.code:
            raise
    return statuses[-1]


def _tour(address: str, *, once: bool) -> int:
    """Post the example if it is not there, print what comes back, and the page's address if it stays."""
    out = console()
    try:
        with Client(address) as client:
            client.ping()
            campaign = simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)
            request = {"measurement_set_id": _posted_set(client, campaign)}
            runs: Iterator[RunSummary] = client.runs.list(**request)
            found = next(runs, None)
            run = client.runs.create(request) if found is None else client.runs.get(found.id)
            comparisons: Iterator[ComparisonSummary] = client.comparisons.list(**request)
            other = next(comparisons, None)
            comparison = (
                client.comparisons.create(request) if other is None else client.comparisons.get(other.id)
            )
            run, comparison = client.runs.wait(run), client.comparisons.wait(comparison)
    except RefusedError as refused:
        console(stderr=True).print(problem_text(refused.problem))
        return _FAILED
    out.print(job_report(RUN, run))
    out.print()
    out.print(job_report(COMPARISON, comparison))
    # with --once, the address ends with the service
    last = "Run {id}; to open its page: the same command without --once" if once else "Open the page: {page}"
    out.print("\n" + last.format(id=run.id, page=f"{address}/#/runs/{run.id}"), markup=False, soft_wrap=True)
    return 0


def _posted_set(client: Client, campaign: dict[str, Any]) -> str:
    """Return the id of the example's measurement set."""
    name = campaign["measurement_set"]["name"]
    sets: Iterator[MeasurementSetSummary] = client.measurement_sets.list()
    found = next((each for each in sets if each.name == name), None)
    if found is not None:
        console().print(f"found measurement set {found.id} of an earlier demonstration\n")
        return found.id
    robot, stored = client.post_campaign(campaign)
    console().print(
        f"posted robot {robot.id} and measurement set {stored.id} "
        f"({len(stored.observations)} observations, {len(stored.warnings)} warnings)\n"
    )
    return stored.id
