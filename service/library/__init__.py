"""Use from Python: campaigns in process, and a client of the service."""

from __future__ import annotations

from jointstiff.service.library.answers import RefusedError
from jointstiff.service.library.campaigns import CampaignError, read_campaign, read_document
from jointstiff.service.library.client import Client
from jointstiff.service.library.tabled_run import TabledRun, identify

__all__ = [
    "CampaignError",
    "Client",
    "RefusedError",
    "TabledRun",
    "identify",
    "read_campaign",
    "read_document",
]
