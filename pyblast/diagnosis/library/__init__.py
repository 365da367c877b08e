"""The hypotheses, by what they speak of; importing this fills the library from every file in it."""

from importlib import import_module
from pkgutil import iter_modules

for _file in iter_modules(__path__):
    import_module(f".{_file.name}", __name__)
