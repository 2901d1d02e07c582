"""The page's own checks: types, which are made from the service as it is now, and unit tests."""

from __future__ import annotations

from support.browsing import DASHBOARD, run_npm


def test_types_of_the_api_are_made_anew_and_hold(node_modules):
    types = DASHBOARD / "src" / "api" / "schema.d.ts"
    types.write_text("export interface components { schemas: {} }", encoding="utf-8")  # of another service
    done = run_npm("run", "--silent", "check")
    assert done.returncode == 0, done.stdout + done.stderr


def test_pure_modules(node_modules):
    done = run_npm("run", "--silent", "test")
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout
