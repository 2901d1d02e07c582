"""Logs for people, or as JSON lines for programs; each line of a request has its identifier."""

from __future__ import annotations

import json
import logging
import os
import re
from contextvars import ContextVar
from datetime import UTC, datetime
from enum import StrEnum
from typing import Final

FORMAT_VARIABLE: Final = "JOINTSTIFF_LOG_FORMAT"
"""Format of this process's log, and of those that it starts."""
ACCESS_LOGGER: Final = "jointstiff.access"
"""Logger of one line a request; silent in logs for people."""

REQUEST_ID: Final[ContextVar[str | None]] = ContextVar("REQUEST_ID", default=None)
"""Identifier of the request that is being answered."""

_UNSEEN: Final = re.compile("[\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters that steer a terminal, end a line or turn a text's direction; JSON leaves them as they are."""

_EXTRAS: Final = ("method", "path", "status", "seconds")


class LogFormat(StrEnum):
    """Format of a log."""

    TEXT = "text"
    JSON = "json"


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time, level, logger, message, and what belongs to a request."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record as a line."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        line |= {name: getattr(record, name) for name in _EXTRAS if hasattr(record, name)}
        if request_id := REQUEST_ID.get():
            line["request_id"] = request_id
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        text = json.dumps(line, ensure_ascii=False)
        return _UNSEEN.sub(lambda character: f"\\u{ord(character[0]):04x}", text)


def set_log_format(log_format: LogFormat) -> None:
    """Let this process, and those that it starts, log in a format to standard error."""
    os.environ[FORMAT_VARIABLE] = log_format
    if log_format is LogFormat.TEXT:
        return
    handler = logging.StreamHandler()
    handler.setFormatter(JsonFormatter())
    logging.basicConfig(handlers=[handler], level=logging.WARNING, force=True)
    logging.captureWarnings(capture=True)
    logging.getLogger(ACCESS_LOGGER).setLevel(logging.INFO)
