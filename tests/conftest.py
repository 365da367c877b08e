"""Shared fixtures."""

import os
from pathlib import Path

import pytest

import pyblast.cli  # noqa: F401  before numpy


@pytest.fixture(scope="session")
def recordings():
    named = os.environ.get("PYBLAST_RECORDINGS")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "recordings"
    if not folder.is_dir():
        pytest.skip("real recordings are absent; name their folder in PYBLAST_RECORDINGS")
    return folder


@pytest.fixture(scope="session")
def cases():
    named = os.environ.get("PYBLAST_CASES")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "cases"
    if not folder.is_dir():
        pytest.skip("cases of the independent program are absent; name them in PYBLAST_CASES")
    return folder


@pytest.fixture(scope="session")
def corpus():
    return Path(__file__).parent / "corpus"
