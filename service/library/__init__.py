"""Use from Python: campaigns in process, and a client of the service."""

from __future__ import annotations

from jointstiff.service.library.campaigns import CampaignError, read_campaign, read_document
from jointstiff.service.library.client import RefusedError, ServiceClient

__all__ = ["CampaignError", "RefusedError", "ServiceClient", "read_campaign", "read_document"]
