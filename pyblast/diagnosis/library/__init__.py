"""Library of hypotheses, by the part of the model that they change; its import fills LIBRARY."""

from importlib import import_module
from pkgutil import iter_modules

for _file in iter_modules(__path__):
    import_module(f".{_file.name}", __name__)
