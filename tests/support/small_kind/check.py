"""Add the small kind, and find all that it has without another line. usage: check.py CAMPAIGN"""

import json
import sys
from pathlib import Path

import jointstiff.service.kinds

jointstiff.service.kinds.__path__.append(str(Path(__file__).parent))

from fastapi.testclient import TestClient  # noqa: E402
from typer.testing import CliRunner  # noqa: E402

from jointstiff.service.app import create_app  # noqa: E402
from jointstiff.service.cli.app import app  # noqa: E402
from jointstiff.service.library.client import Client  # noqa: E402
from jointstiff.service.store.store import Store  # noqa: E402

campaign = sys.argv[1]
found: dict[str, object] = {}

with Store.open("sqlite://") as store:
    service = create_app(store)
    with TestClient(service, base_url="http://127.0.0.1") as http:
        with Client("http://127.0.0.1", transport=http._transport) as client:
            posted = client.count(campaign)
            found["client"] = posted.result.readings
            found["text"] = "Readings of the set" in str(posted)
            listed = client.smalls.list(measurement_set_id=posted.request.measurement_set_id)
            found["listing"] = [each.id for each in listed] == [posted.id]
        address = f"/v1/jobs/{posted.id}"
        files = f"{address}/files"
        found["route"] = http.get(address).json()["result"]["readings"]
        found["csv"] = http.get(f"{files}/counts.csv").text
        found["report"] = "Count of readings" in http.get(f"{files}/report.html").text
        found["described"] = "/v1/smalls" in service.openapi()["paths"]
        found["filtered"] = len(http.get("/v1/jobs?kind=small").json()["items"]) == 1
        found["deleted"] = http.patch(address, json={"deleted": True}).status_code

help_text = CliRunner().invoke(app, ["count", "--help"], env={"COLUMNS": "100"}).output
found["help"] = "Least number of targets" in help_text and "--least" in help_text
found["command"] = json.loads(CliRunner().invoke(app, ["count", campaign, "--json"]).stdout)["result"][
    "readings"
]
found["printed"] = CliRunner().invoke(app, ["count", campaign, "--csv", "--least", "99"]).stdout

import jointstiff as js  # noqa: E402

found["python"] = js.count(campaign).result.readings
sys.stdout.write(json.dumps(found))
