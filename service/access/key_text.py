"""The text of a key: `jst_<id>_<256 random bits>_<crc32>`.

The check sum tells a mistyped key from a wrong one, without a look at any other. It is no secret.
"""

from __future__ import annotations

import hashlib
import re
import secrets
import string
import zlib
from datetime import datetime
from typing import Final, NamedTuple

from jointstiff.schemas.access import Role
from jointstiff.service.problems.errors import KeyRefusedError
from jointstiff.service.store.records import AccessKey

_ALPHABET: Final = string.ascii_letters + string.digits
"""62 characters: a double click selects the whole key."""
_LENGTH: Final = 43
"""62^43 > 2^256."""
_KEY: Final = re.compile(r"(jst_([0-9a-f]{10})_[A-Za-z0-9]{43})_([0-9a-f]{8})", re.ASCII)
_SECRETS: Final = re.compile(r"(jst|jsl)_[A-Za-z0-9_%-]*", re.ASCII)
_REMEDY: Final = "copy the whole key, from jst_ to its last character; it was shown once, when it was created"


class Minted(NamedTuple):
    """A new key."""

    text: str  # text that its holder keeps; nothing else does
    record: AccessKey  # record that is stored


def mint(name: str, role: Role, now: datetime, expires_at: datetime | None) -> Minted:
    """Make a key."""
    key_id = secrets.token_hex(5)
    body = f"jst_{key_id}_{_random()}"
    text = f"{body}_{_check(body)}"
    record = AccessKey(
        id=key_id,
        name=name,
        role=role,
        key_hash=digest(text),
        created_at=now,
        expires_at=expires_at,
        revoked_at=None,
        last_used_at=None,
    )
    return Minted(text, record)


def mint_token(kind: str) -> str:
    """Return a random text of 256 bits for a cookie or a link, with a word that says for which."""
    return f"{kind}_{_random()}"


def id_in(text: str) -> str:
    """Return the id in a key.

    Raises:
        KeyRefusedError: the text is no key, or is mistyped.
    """
    match = _KEY.fullmatch(text)
    if match is None:
        raise KeyRefusedError("the text sent is not a key", _REMEDY)
    if _check(match[1]) != match[3]:
        raise KeyRefusedError("the key is mistyped: its check sum does not fit", _REMEDY)
    return match[2]


def digest(text: str) -> str:
    """Return the SHA-256 of a key or token, which is all that is stored of it.

    A slow hash would protect a password that people choose. Nobody guesses 256 random bits.
    """
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def without_keys(text: str) -> str:
    """Return a text in which nothing is left of keys and links, for those who keep it."""
    return _SECRETS.sub(r"\1_…", text)


def _random() -> str:
    return "".join(secrets.choice(_ALPHABET) for _ in range(_LENGTH))


def _check(body: str) -> str:
    return f"{zlib.crc32(body.encode()):08x}"
