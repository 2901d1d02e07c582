"""The HTTP API."""

from __future__ import annotations

from jointstiff.service.api.description import install_description
from jointstiff.service.api.errors import install_error_handlers
from jointstiff.service.api.events import Followers
from jointstiff.service.api.headers import AnswerHeaders
from jointstiff.service.api.limited import FORWARDED, Forwarded, LimitedChild
from jointstiff.service.api.limits import LARGE_BODIES, PARSERS, BodyLimits
from jointstiff.service.api.metrics import Metrics, metrics_server
from jointstiff.service.api.observed import Observed
from jointstiff.service.api.page import install_page
from jointstiff.service.api.posture import Posture, PostureGuard
from jointstiff.service.api.watch import Watch

__all__ = [
    "FORWARDED",
    "LARGE_BODIES",
    "PARSERS",
    "AnswerHeaders",
    "BodyLimits",
    "Followers",
    "Forwarded",
    "LimitedChild",
    "Metrics",
    "Observed",
    "Posture",
    "PostureGuard",
    "Watch",
    "install_description",
    "install_error_handlers",
    "install_page",
    "metrics_server",
]
