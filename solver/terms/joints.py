"""Joints as springs: deflections as a linear function of their compliances (method.md §2)."""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.terms.block import RegressorBlock
from jointstiff.solver.terms.term import Motion, Term


def _joints(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # linear
    """Return ``A = J diag(τ)``, and ``diag(τ)`` behind the gearboxes."""
    if block.measurements.encoders is None:
        return Motion(block.A)
    return Motion(block.A, block.torque[..., None] * np.eye(block.torque.shape[1]))


JOINTS = Term("joints", "rad/(N·m)", _joints)
