"""Build the application of the service from its parts. Importing this module starts nothing."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from functools import cache
from typing import Final

from anyio import CapacityLimiter
from anyio.to_thread import current_default_thread_limiter
from fastapi import APIRouter, Depends, FastAPI
from starlette.middleware.gzip import GZipMiddleware
from starlette.routing import BaseRoute

from jointstiff.service.api import admin, bridges, corrections, health, jobs, live, resources, runs
from jointstiff.service.api.answers import install_error_handlers, refuse_unknown_parameters
from jointstiff.service.api.description import DescribedApplication, describe_problems
from jointstiff.service.api.health import Metrics, Watch
from jointstiff.service.api.jobs import Followers
from jointstiff.service.api.middleware import COMPRESSED_BYTES, UNCOMPRESSED_TYPES, Guard, Methods, Observed
from jointstiff.service.api.page import install_description, install_page
from jointstiff.service.jobs import Enqueue, Parts
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.process import jointstiff_version
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.security.access import Audit, Gate, find_public_paths, make_operation_id
from jointstiff.service.security.admission import LARGE_BODIES, PARSERS, AccessPolicy, BodyLimits
from jointstiff.service.security.keys import Keyring
from jointstiff.service.store.store import Store
from jointstiff.service.workers.solver_check import SolverWatch

CONCURRENT_REQUESTS: Final = 8
"""Greatest number of requests that are answered at the same time; further requests wait."""
CONCURRENT_WORK: Final = 2
"""Greatest number of posted jobs that are computed at the same time.

Jobs are computed in separate threads, so that reads do not wait for them. More threads than processors
compete: of 1,000 posts at the same time, four threads answer a fifth fewer in a second than two threads.
"""

_DESCRIPTION = """Joint stiffness of industrial robots from laser-tracker readings.

Post a **robot**, then a **measurement set** of it, then a **run**: the answer has the stiffness of each joint
with its uncertainty, or the reason for none. Numbers are in SI units unless a set
declares others in its `units`; each field's unit is in its schema as `unit`.

Every error is a problem details document (RFC 9457) whose `where` names the field and whose `remedy` states
the correction.
"""


def create_app(
    store: Store,
    enqueue: Enqueue | None = None,
    policy: AccessPolicy | None = None,
    keyring: Keyring | None = None,
    laboratory: LaboratorySettings | None = None,
) -> FastAPI:
    """Build the application of the service on an open store; the caller closes the store.

    Args:
        store: where robots, measurement sets and runs are kept.
        enqueue: function that leaves a long job to workers; None to compute each job in its request.
        policy: rules for callers; None to answer only programs of this machine.
        keyring: valid keys, if the policy requires keys; None to use the keys in the store.
        laboratory: settings of the laboratory that issues reports; None if reports name no laboratory.

    Raises:
        UndeclaredRoleError: a route does not declare the role that it needs.
    """
    app = DescribedApplication(
        title="Jointstiff",
        version=jointstiff_version(),
        description=_DESCRIPTION,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        servers=[{"url": "/", "description": "This service"}],
        # `install_description` serves the API description; FastAPI's own pages load scripts from other hosts.
        openapi_url=None,
        separate_input_output_schemas=False,
        redirect_slashes=False,  # a redirect would repeat the Host header, whoever wrote it
        lifespan=_lifespan,
    )
    policy = policy or AccessPolicy()
    requires_keys = policy.access == "keys"
    keyring = keyring or Keyring(store)
    app.state.watch = watch = Watch(store, keyring if requires_keys else None)
    app.state.gate = gate = Gate(store, keyring, watch.require_recent_check, policy.access)
    app.state.access = policy.access
    app.state.laboratory = laboratory or LaboratorySettings()
    app.state.parts = Parts(store, enqueue)
    app.state.parts.find_reason = watch.find_reason
    app.state.answer_elsewhere = None  # function that lets another process answer requests with large bodies
    app.state.is_closing = lambda: False
    app.state.failing_workers = lambda: 0
    app.state.solver = SolverWatch()  # a server starts the check
    app.state.followers = Followers(lambda: app.state.is_closing())
    app.state.work = CapacityLimiter(CONCURRENT_WORK)
    app.state.large_bodies = CapacityLimiter(LARGE_BODIES)
    app.state.parsers = CapacityLimiter(PARSERS)
    app.add_middleware(BodyLimits)
    app.router.routes.extend(all_routes())
    install_description(app)
    install_page(app)
    install_error_handlers(app)
    app.add_middleware(
        GZipMiddleware,
        minimum_size=COMPRESSED_BYTES,
        compresslevel=5,
        exclude_content_types=UNCOMPRESSED_TYPES,
    )
    app.add_middleware(Methods, routes=app.routes)
    # Raises an error now if a route declares no role: middleware is made only with the first request.
    find_public_paths(app.routes)
    app.add_middleware(Guard, policy=policy, gate=gate, audit=Audit(store), routes=app.routes)
    app.state.metrics = metrics = Metrics()
    app.add_middleware(Observed, metrics=metrics)
    return app


@cache
def all_routes() -> Sequence[BaseRoute]:
    """Return the routes of all resources and kinds of jobs; cached, as FastAPI takes 0.1 s to build them."""
    # Without a declared answer 422, FastAPI would describe its own error format, which this API never uses.
    router_of_all = APIRouter(
        generate_unique_id_function=make_operation_id,
        responses=describe_problems(422),
        dependencies=[Depends(refuse_unknown_parameters)],
    )
    for router in (
        resources.robots,
        resources.trends,
        resources.sets,
        live.router,
        bridges.router,
        runs.router,
        runs.deflections,
        runs.imports,
        corrections.router,
        health.router,
        admin.sessions,
        admin.router,
        jobs.router,
        *(jobs.make_post_route(kind) for kind in KINDS if not kind.is_form),
    ):
        router_of_all.include_router(router)
    return router_of_all.routes


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Limit the threads that answer requests, and watch the store while the application runs."""
    current_default_thread_limiter().total_tokens = CONCURRENT_REQUESTS
    with app.state.watch:
        yield
