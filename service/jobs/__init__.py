"""Kinds of jobs, and the life of a job."""
