"""Caddy in front of services of our own, with the file that the containers use."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx2
import pytest
from support.processes import free_port, until

CADDYFILE = Path(__file__).parents[2] / "docker" / "Caddyfile"
REQUIRE_CADDY = "JOINTSTIFF_REQUIRE_CADDY"


def caddy() -> str:
    """Return the program, or skip the test."""
    found = shutil.which("caddy")
    if found is None:
        reason = "no Caddy here: apt-get install caddy"
        if os.environ.get(REQUIRE_CADDY) == "1":
            pytest.fail(f"{reason} ({REQUIRE_CADDY}=1)")
        pytest.skip(reason)
    return found


@contextmanager
def proxied(folder: Path, *services: str) -> Iterator[str]:
    """Start Caddy on the loopback address in front of services; yield its own address."""
    url = f"http://localhost:{free_port()}"
    stated = {
        "JOINTSTIFF_SITE": url,
        "JOINTSTIFF_SERVICES": " ".join(service.removeprefix("http://") for service in services),
        "JOINTSTIFF_TLS": "bind 127.0.0.1",  # a line of the site, as `tls internal` is
        "HOME": str(folder),
    }
    command = [caddy(), "run", "--config", str(CADDYFILE), "--adapter", "caddyfile"]
    with (folder / "caddy.log").open("w+") as log:
        process = subprocess.Popen(command, env=os.environ | stated, stdout=log, stderr=log)
        try:
            until(lambda: process.poll() is not None or _answers(url), 30.0)
            assert process.poll() is None, (folder / "caddy.log").read_text()
            yield url
        finally:
            process.terminate()
            process.wait(20)


def _answers(url: str) -> bool:
    try:
        return httpx2.get(f"{url}/live").status_code == 204
    except httpx2.TransportError:
        return False
