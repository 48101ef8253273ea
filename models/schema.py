"""The published JSON schema of a mechanism."""

from __future__ import annotations

import json

from pydantic import BaseModel

from .mechanism import Mechanism


def mechanism_schema() -> str:
    """JSON schema of a mechanism as text, as it stands in models/schemas/."""
    return schema_text(Mechanism)


def schema_text(model: type[BaseModel]) -> str:
    """JSON schema (draft 2020-12) of a described type, in the form the repository publishes."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **model.model_json_schema()}
    return json.dumps(schema, indent=2) + "\n"
