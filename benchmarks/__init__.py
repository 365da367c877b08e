"""What the program costs, measured by commands that anyone can run."""

import pyblast.cli  # noqa: F401  before numpy
