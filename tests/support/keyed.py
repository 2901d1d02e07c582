"""A service that requires keys, a key of each role, and sessions."""

from datetime import UTC, datetime, timedelta
from typing import Any

from support.in_process import Client

from jointstiff.service.security.admission import AccessPolicy
from jointstiff.service.security.keys import hash_secret, make_key, make_secret_token
from jointstiff.service.store.store import Store

NOW = datetime.now(UTC)
ROLES = ("viewer", "operator", "admin")
KEYS = {role: make_key(f"{role}'s key", role, NOW, None) for role in ROLES}


def bearer(role: str | None) -> dict[str, str]:
    """Return the header with the key of a role."""
    return {} if role is None else {"Authorization": f"Bearer {KEYS[role].text}"}


def opened(store: Store, address: str = "127.0.0.1") -> Client:
    """Store a key of each role; return a client at an address of a service that requires them."""
    for minted in KEYS.values():
        store.keys.add(minted.record)
    posture = AccessPolicy.from_address("127.0.0.1", (), access_control=True, require_key=True)
    return Client(store, posture, address=address)


def offered(
    store: Store, key_id: str = KEYS["viewer"].record.id, lasts: timedelta = timedelta(minutes=10)
) -> str:
    """Store a one-time link; its time runs from now, however long the suite has run before."""
    token, now = make_secret_token("jsl"), datetime.now(UTC)
    store.sessions.offer(hash_secret(token), key_id, now, now + lasts)
    return token


def signed_in(client: Client, role: str = "viewer", **headers: Any) -> str:
    """Sign in with the key of a role; return the cookie."""
    answer = client.request("POST", "/v1/session", json={"key": KEYS[role].text}, headers=headers)
    assert answer.status_code == 201, answer.text
    assert answer.json()["role"] == role
    return answer.headers["Set-Cookie"].partition(";")[0]
