"""What the program costs, measured by commands that anyone can run."""

import pyblast.cli.blas  # noqa: F401  before numpy
