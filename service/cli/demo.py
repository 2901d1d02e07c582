"""The first five minutes: a service, and a client in a thread of it that knows nothing but its address."""

from __future__ import annotations

import os
import signal
from typing import Final

from jointstiff.service.kinds.comparison import COMPARISON
from jointstiff.service.kinds.run import RUN
from jointstiff.service.library.client import Client
from jointstiff.service.library.errors import RefusedError
from jointstiff.service.reports.job import job_parts
from jointstiff.service.server import run_server
from jointstiff.service.tables.table import Line
from jointstiff.service.tables.terminal import console, printed, problem_text
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
    """Post the example, print what comes back, and the page's address if it stays.

    Each is posted once: of two demonstrations, one after the other or at the same time, both show what the
    first stored.
    """
    out = console()
    try:
        with Client(address) as client:
            client.ping()
            campaign = simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)
            robot, stored = client.post_campaign(campaign)
            counted = f"{len(stored.observations)} observations, {len(stored.warnings)} warnings"
            out.print(f"robot {robot.id} and measurement set {stored.id} ({counted})\n", soft_wrap=True)
            request = {"measurement_set_id": stored.id}
            run, comparison = client.runs.once(request), client.comparisons.once(request)
            run, comparison = client.runs.wait(run), client.comparisons.wait(comparison)
    except RefusedError as refused:
        console(stderr=True).print(problem_text(refused.problem))
        return _FAILED
    parts = job_parts(RUN, run)
    others = [part for part in job_parts(COMPARISON, comparison) if part not in parts]
    out.print(printed([*parts, Line(""), *others]))
    # with --once, the address ends with the service
    last = "Run {id}; to open its page: the same command without --once" if once else "Open the page: {page}"
    out.print("\n" + last.format(id=run.id, page=f"{address}/#/runs/{run.id}"), markup=False, soft_wrap=True)
    return 0
