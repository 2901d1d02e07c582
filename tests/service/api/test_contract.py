"""The contract: what the OpenAPI description promises is what the service does, whatever is sent.

Each part takes every `PARTS`th operation; its cases are made when it runs. PostgreSQL has them each night.
"""

from itertools import count

import pytest
from hypothesis import HealthCheck, Phase
from support.examples import examples, is_full

pytestmark = pytest.mark.process
PARTS = 24
STRIDE = 5
"""By day every fifth case at the bounds of fields is sent, of thousands; each night all of them."""


@pytest.mark.parametrize(
    ("part", "service"),
    [
        pytest.param(part, database, marks=pytest.mark.slow if database == "postgresql" else ())
        for database in ("postgresql", "sqlite")
        for part in range(PARTS)
    ],
    indirect=["service"],
)
def test_the_service_keeps_its_contract(part, service, openapi):
    import requests
    import schemathesis
    from schemathesis.checks import not_a_server_error
    from schemathesis.generation.meta import TestPhase
    from schemathesis.pytest.lazy import get_all_tests
    from schemathesis.specs.openapi import checks

    promised = [
        not_a_server_error,
        checks.status_code_conformance,
        checks.content_type_conformance,
        checks.response_schema_conformance,
    ]

    session = requests.Session()
    session.trust_env = False  # a look at all variables for each case

    bounds, stride = count(), 1 if is_full() else STRIDE

    @examples(60, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck))
    def keeps(case):
        if case.meta.phase.name is TestPhase.COVERAGE and next(bounds) % stride:
            return
        case.call_and_validate(base_url=service.url, session=session, checks=promised, timeout=60)

    schema = schemathesis.openapi.from_dict(openapi)
    labels = [each.ok().label for each in schema.get_all_operations()][part::PARTS]
    for each in get_all_tests(
        schema=schema.include(name=labels), test_func=keeps, settings=None, given_kwargs={}
    ):
        each.ok()[1]()
    session.close()
