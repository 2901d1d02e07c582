"""The page's own checks: types, unit tests, and the API's types as the service describes them now."""

from __future__ import annotations

import json

from support.browsing import DASHBOARD, run_npm


def test_types_of_the_api_are_those_of_the_service(node_modules, tmp_path, openapi):
    document, written = tmp_path / "openapi.json", tmp_path / "schema.d.ts"
    document.write_text(json.dumps(openapi), encoding="utf-8")
    done = run_npm("run", "--silent", "types", "--", str(document), "--output", str(written))
    assert done.returncode == 0, done.stdout + done.stderr
    kept = (DASHBOARD / "src" / "api" / "schema.d.ts").read_text(encoding="utf-8")
    assert written.read_text(encoding="utf-8") == kept, "the API has changed: scripts/api-types"


def test_types_hold(node_modules):
    done = run_npm("run", "--silent", "check")
    assert done.returncode == 0, done.stdout + done.stderr


def test_pure_modules(node_modules):
    done = run_npm("run", "--silent", "test")
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout
