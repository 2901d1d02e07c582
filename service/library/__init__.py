"""Use from Python: campaigns in process, and a client of the service."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.library.campaigns import read_campaign, read_document
    from jointstiff.service.library.client import Client
    from jointstiff.service.library.errors import CampaignError, RefusedError
    from jointstiff.service.library.robots import read_robot
    from jointstiff.service.library.tabled_run import TabledRun, identify
else:
    __getattr__ = names_of(
        __name__,
        campaigns="read_campaign read_document",
        client="Client",
        errors="CampaignError RefusedError",
        robots="read_robot",
        tabled_run="TabledRun identify",
    )

__all__ = [
    "CampaignError",
    "Client",
    "RefusedError",
    "TabledRun",
    "identify",
    "read_campaign",
    "read_document",
    "read_robot",
]
