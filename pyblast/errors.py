"""What pyblast raises, and nothing else does."""


class PyblastError(Exception):
    """Every error that pyblast raises on purpose."""


class InputError(PyblastError, ValueError):
    """A value breaks a rule; the message says where, which rule, the value and what to do."""


class ReadError(PyblastError, OSError):
    """A file can't be read; the message names the file, the line or field and what was expected."""


class SolverError(PyblastError, RuntimeError):
    """The march through time failed; the message says when, where and the likely cause."""


class PyblastWarning(UserWarning):
    """Physics that is doubtful but can be computed."""
