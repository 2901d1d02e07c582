"""Secrets and signatures of webhooks, by Standard Webhooks."""

from __future__ import annotations

import hashlib
import hmac
from base64 import b64decode, b64encode
from secrets import token_bytes
from typing import Final

_PREFIX: Final = "whsec_"


def new_secret() -> str:
    """Return the secret of a new webhook."""
    return _PREFIX + b64encode(token_bytes(32)).decode()


def signature(secret: str, message_id: str, timestamp: int, document: str) -> str:
    """Return the signature of a message, version 1."""
    key = b64decode(secret.removeprefix(_PREFIX))
    signed = f"{message_id}.{timestamp}.{document}".encode()
    return f"v1,{b64encode(hmac.digest(key, signed, hashlib.sha256)).decode()}"
