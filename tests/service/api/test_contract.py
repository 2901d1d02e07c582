"""The contract: what the OpenAPI description promises is what the service does, whatever is sent.

Its cases are made when it is collected, for seconds; `tests/support/lanes.py` says when it is not.
"""

from __future__ import annotations

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)
from support.examples import examples

from jointstiff.service.app import create_app
from jointstiff.service.store.store import Store

pytestmark = pytest.mark.process
CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
]

with Store.open("sqlite://") as store:
    schema = schemathesis.openapi.from_dict(create_app(store).openapi())


@schema.parametrize()
@examples(60, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck))
def test_the_service_keeps_its_contract(case, service):
    case.call_and_validate(base_url=service.url, checks=CHECKS)
