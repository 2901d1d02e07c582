"""Reports: the laboratory that issues them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from jointstiff.schemas.fields import Message, Name
from jointstiff.schemas.measurement import Notes

Lines = Annotated[list[Name], Field(max_length=8)]


class Party(Message):
    """A laboratory or a customer, with postal address."""

    name: Name
    address: Lines = Field(default_factory=list, description="Lines of the address.")
    contact: Name | None = Field(
        default=None, description="Telephone number, mail address or name of a contact person."
    )


class Laboratory(Party):
    """Settings of a laboratory that issues reports, in a TOML file."""

    place: Name | None = Field(
        default=None, description="Place of the measurement; default: the laboratory's address."
    )
    accreditation: Name | None = Field(
        default=None,
        description="Accreditation of the laboratory with its number. Without this field, reports state "
        "no accreditation.",
    )
    traceability: Notes | None = Field(
        default=None,
        description="Traceability of tracker and force to standards: certificates, their numbers and dates.",
    )
    conditions: Name | None = Field(
        default=None,
        description="Conditions of the measurement, for measurement sets that state no conditions.",
    )
    method: Notes | None = Field(
        default=None,
        description="Number of the laboratory's procedure, stated together with the method of this software.",
    )
    customer: Party | None = Field(default=None, description="Customer of the reports.")
    logo: Name | None = Field(
        default=None,
        description="Name of a PNG or JPEG file in the same folder as this file, without a path.",
    )
