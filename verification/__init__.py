"""Verification of pyblast: a suite of problems with known answers, and an independent program."""

import pyblast.cli  # noqa: F401  before numpy
