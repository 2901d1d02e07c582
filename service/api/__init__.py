"""The HTTP API."""

from __future__ import annotations

from jointstiff.service.api.bodies import LARGE_BODIES, MAX_SET_BYTES
from jointstiff.service.api.errors import install_error_handlers
from jointstiff.service.api.events import Watches
from jointstiff.service.api.page import install_page

__all__ = ["LARGE_BODIES", "MAX_SET_BYTES", "Watches", "install_error_handlers", "install_page"]
