"""Shared fixtures; which tests are run, and which draw their figures in full."""

import os
from base64 import b64decode
from pathlib import Path

import pytest

import pyblast.cli  # noqa: F401  before numpy

DOT = b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJg"
    "gg=="
)


def pytest_addoption(parser):
    parser.addoption("--all", action="store_true", help="run the tests marked as long, too")


def pytest_collection_modifyitems(config, items):
    """Leave out the long tests unless all are asked for, or one is named."""
    if config.option.all or any("::" in argument for argument in config.args):
        return
    chosen = {True: [], False: []}
    for item in items:
        chosen[item.get_closest_marker("long") is None].append(item)
    config.hook.pytest_deselected(items=chosen[False])
    items[:] = chosen[True]


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Draw figures to the last pixel, half a second each, only in tests marked with figures."""
    with pytest.MonkeyPatch.context() as patch:
        if not item.config.option.all and item.get_closest_marker("figures") is None:
            patch.setattr("matplotlib.figure.Figure.savefig", dot)
        yield


def dot(_figure, stream, **_options):
    """Write a picture of one pixel."""
    stream.write(DOT)


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
