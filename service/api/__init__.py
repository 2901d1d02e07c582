"""The HTTP API."""

from __future__ import annotations

from jointstiff.service.api.errors import install_error_handlers
from jointstiff.service.api.events import Followers
from jointstiff.service.api.limits import LARGE_BODIES, BodyLimits
from jointstiff.service.api.page import install_page

__all__ = [
    "LARGE_BODIES",
    "BodyLimits",
    "Followers",
    "install_error_handlers",
    "install_page",
]
