"""What pyblast is measured against: the ladder, and an independent program."""

import pyblast.cli  # noqa: F401  before numpy
