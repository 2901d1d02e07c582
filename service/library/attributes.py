"""Words of other packages for the attributes of results."""

from __future__ import annotations

import re
from collections.abc import Sequence
from types import MappingProxyType
from typing import Final

from jointstiff.service.problems import find_similar_name

_WORDS_OF_ATTRIBUTES: Final = MappingProxyType(
    {
        "stiffness": "coef coefficients estimate joint_stiffness joint_stiffnesses k k_joint k_joints "
        "stiffnesses x",
        "compliance": "c compliances",
        "bse": "se std stderr stdev standard_errors sigma uncertainties uncertainty",
        "conf_int()": "ci confidence_interval confidence_intervals interval intervals",
        "conf_int('stiffness')": "stiffness_interval stiffness_intervals",
        "covariance": "cov covariance_matrix pcov",
        "resid": "error errors fun residual residuals",
        "rsquared": "r2 r_squared rsq score",
        "result.assessment": "assessment",
        "verdict": "quality status success verdict",
        "reasons": "faults findings messages problems warnings",
        "state": "converged done message",
        "campaign": "data dataset measurement_set measurements observations readings",
        "joints": "by_joint joint joint_names joint_results names",
        "displacement": "deflection deflections displacements dx values",
        "to_frame()": "dataframe df frame table to_dataframe to_df to_pandas",
        "save(path)": "dump export to_csv to_excel to_html to_json to_pdf write",
        "model_dump()": "as_dict dict to_dict",
        "plot()": "draw figure show",
        "summary()": "describe report",
        "predict(postures, forces=…, at=…)": "deflect forecast predict_deflection",
    }
)
"""Attribute of a result → words of other packages for the same thing."""


def find_attribute(name: str, known: Sequence[str]) -> str | None:
    """Return the attribute that a word means, with its arguments; None if no known attribute is meant.

    Args:
        name: name of an attribute that the result does not have.
        known: names of the attributes that the result has.
    """
    word = name.casefold().rstrip("_")
    for attribute, words in _WORDS_OF_ATTRIBUTES.items():
        first_name = re.split(r"\W", attribute)[0]
        if word in words.split() and first_name in known:
            return attribute
    return find_similar_name(word, known)
