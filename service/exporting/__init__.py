"""Identified models as files that other programs load: tables, workbooks, URDF, SDF and MJCF."""
