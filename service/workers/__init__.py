"""Workers: the queue, recovery and supervision."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.workers.doctor import examine
    from jointstiff.service.workers.queue import JobQueue
    from jointstiff.service.workers.supervisor import Supervisor
    from jointstiff.service.workers.worker import run_worker
else:
    __getattr__ = names_of(
        __name__,
        doctor="examine",
        queue="JobQueue",
        supervisor="Supervisor",
        worker="run_worker",
    )

__all__ = ["JobQueue", "Supervisor", "examine", "run_worker"]
