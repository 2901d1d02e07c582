"""The child process that answers large bodies for a service."""

from __future__ import annotations

from jointstiff.service.limited.child import run_child

__all__ = ["run_child"]
