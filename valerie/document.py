"""The base class of every document that VALERIE reads, writes or stores, and the documents to start from."""

from __future__ import annotations

from importlib import resources

from pydantic import BaseModel, ConfigDict


class Document(BaseModel):
    """A frozen document: refuses unknown fields and numbers that are not finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def template(package: str) -> str:
    """Return the commented ``template.yaml`` of a package."""
    return resources.files(package).joinpath("template.yaml").read_text(encoding="utf-8")
