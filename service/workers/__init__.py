"""Workers: the queue, recovery and supervision."""

from __future__ import annotations

from jointstiff.service.workers.queue import Ledger
from jointstiff.service.workers.supervisor import Supervisor
from jointstiff.service.workers.worker import run_worker

__all__ = ["Ledger", "Supervisor", "run_worker"]
