"""The contract: what the OpenAPI description promises is what the service does, whatever is sent.

Each part takes every `PARTS`th operation; its cases are made when it runs. PostgreSQL has them each night.
"""

import pytest
from hypothesis import HealthCheck, Phase
from support.examples import examples

pytestmark = pytest.mark.process
PARTS = 24


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

    @examples(60, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck))
    def keeps(case):
        case.call_and_validate(base_url=service.url, session=session, checks=promised, timeout=60)

    schema = schemathesis.openapi.from_dict(openapi)
    labels = [each.ok().label for each in schema.get_all_operations()][part::PARTS]
    for each in get_all_tests(
        schema=schema.include(name=labels), test_func=keeps, settings=None, given_kwargs={}
    ):
        each.ok()[1]()
    session.close()
