"""Progress of runs as server-sent events."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Final

from fastapi.concurrency import run_in_threadpool

from schemas.run import Run
from service.run_log import OPEN_STATES

__all__ = ["MAX_WAIT_SECONDS", "ended", "events"]

MAX_WAIT_SECONDS: Final = 60
_LOOK_SECONDS: Final = 0.1
_EVENT_SECONDS: Final = 0.5
"""Between two events: hundreds of clients that follow runs must not keep the others waiting."""
_QUIET_LOOKS: Final = 30
"""After so many looks without news a comment is sent, so that proxies keep the connection."""


async def ended(look: Callable[[], Run], wait: float) -> Run:
    """The run when it has ended, or as it is after `wait` seconds."""
    clock = asyncio.get_running_loop().time
    deadline = clock() + wait
    run = await run_in_threadpool(look)
    while run.state in OPEN_STATES and clock() < deadline:
        await asyncio.sleep(_LOOK_SECONDS)
        run = await run_in_threadpool(look)
    return run


async def events(look: Callable[[], Run]) -> AsyncIterator[str]:
    """`progress` events while the run goes on, then one `end` event with its final state."""
    told, quiet = "", 0
    while True:
        run = await run_in_threadpool(look)
        news = run.model_dump_json(include={"id", "state", "progress"})
        if run.state not in OPEN_STATES:
            yield f"event: end\ndata: {news}\n\n"
            return
        quiet = 0 if news != told else quiet + 1
        if news != told:
            yield f"event: progress\ndata: {news}\n\n"
        elif quiet % _QUIET_LOOKS == 0:
            yield ": still running\n\n"
        told = news
        await asyncio.sleep(_EVENT_SECONDS)
