"""The hypotheses, by family; importing this fills the library."""

from . import instruments, paths, sources, surfaces

__all__ = ["instruments", "paths", "sources", "surfaces"]
