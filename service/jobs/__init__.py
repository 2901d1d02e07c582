"""Kinds of jobs, and the life of a job."""

from __future__ import annotations

from jointstiff.service.jobs.kinds import Job
from jointstiff.service.jobs.life import Announce, AnyJobs
from jointstiff.service.jobs.registry import Parts
from jointstiff.service.jobs.work import Span

__all__ = ["Announce", "AnyJobs", "Job", "Parts", "Span"]
