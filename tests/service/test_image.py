"""What the package is built from reaches the image; Docker leaves out what `.dockerignore` does not name."""

import json
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
HOOK = WHEEL["hooks"]["custom"].get("path", "hatch_build.py")
NEEDED = [
    *(name.split("/")[0] for name in WHEEL["only-include"]),
    HOOK,
    "dashboard",
    PROJECT["project"]["readme"],
    *PROJECT["project"]["license-files"],
    "pyproject.toml",
    "requirements.lock",
    "requirements-docs.lock",
    "docs",
    "docker/README.md",
    "CHANGELOG.md",
    "docker/build.lock",
]


def test_the_image_awaits_a_key_and_the_proxy_insists_on_tls():
    """Whoever publishes the image's port on all addresses opens nothing."""
    docker = ROOT / "docker"
    (command,) = re.findall(r"^CMD (.*)$", (docker / "Dockerfile").read_text(encoding="utf-8"), re.MULTILINE)
    assert json.loads(command) == ["serve", "--host", "0.0.0.0", "--port", "8000", "--await-key"]  # noqa: S104
    assert "header Strict-Transport-Security max-age=" in (docker / "Caddyfile").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NEEDED)
def test_what_the_wheel_is_built_from_reaches_the_image(name):
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert (ROOT / name).exists()
    assert f"!{name}" in lines
