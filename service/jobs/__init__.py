"""Kinds of jobs, and the life of a job."""

from __future__ import annotations

from jointstiff.schemas.job import Job
from jointstiff.service.computation import Span
from jointstiff.service.jobs.kinds import AnyKind, Quick, Stepped
from jointstiff.service.jobs.life import Enqueue, Jobs
from jointstiff.service.jobs.registry import KINDS, Parts

__all__ = ["KINDS", "AnyKind", "Enqueue", "Job", "Jobs", "Parts", "Quick", "Span", "Stepped"]
