"""Fixtures and hooks of the core's tests, for these tests too (`tests` is on pytest's path)."""

from conftest import (
    _idle_processes,
    _plug_ins,
    _shared,
    build,
    pytest_collection_modifyitems,
    pytest_generate_tests,
    refused,
    third_party,
)

__all__ = [
    "_idle_processes",
    "_plug_ins",
    "_shared",
    "build",
    "pytest_collection_modifyitems",
    "pytest_generate_tests",
    "refused",
    "third_party",
]
