"""Keys: made, known and recognised; wrong ones slow down."""

from __future__ import annotations

from jointstiff.service.access.key_text import Minted, digest, mint, mint_token, without_keys
from jointstiff.service.access.keyring import Keyring, described
from jointstiff.service.access.keys_file import KeysFile, KeysFileError
from jointstiff.service.access.throttle import Throttle

__all__ = [
    "Keyring",
    "KeysFile",
    "KeysFileError",
    "Minted",
    "Throttle",
    "described",
    "digest",
    "mint",
    "mint_token",
    "without_keys",
]
