"""The page's types, which are made from the service as it is now; `scripts/check` compiles them."""

from __future__ import annotations

from support.browsing import DASHBOARD, run_npm


def test_types_of_the_api_are_made_anew(node_modules):
    types = DASHBOARD / "src" / "api" / "schema.d.ts"
    types.write_text("export interface components { schemas: {} }", encoding="utf-8")  # of another service
    done = run_npm("run", "--silent", "precheck")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "MeasurementSet" in types.read_text(encoding="utf-8")
