"""Pages: templates, and numbers as pages show them."""

import math
from importlib import resources

from jinja2 import Environment, FunctionLoader, StrictUndefined

from ..units import plain_number
from .plots import tables


def page(name):
    """Return the template of a page, which escapes every name that users give."""
    environment = Environment(
        loader=FunctionLoader(_part), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters |= {
        "number": shown_number,
        "scaled": shown_in_unit,
        "angle": angle,
        "plain": plain_number,
        "share": share_of_limit,
        "tables": tables,
    }
    return environment.get_template(name)


def _part(name):
    """Return the text of a part of a page; a script of others as it is."""
    text = resources.files("pyblast.report").joinpath("templates", name).read_text(encoding="utf-8")
    return f"{{% raw %}}{text}{{% endraw %}}" if name.endswith(".min.js") else text


def shown_number(value, digits=3):
    """Show a number with some digits, a dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if not isinstance(value, float):
        return str(value)
    return plain_number(value, digits) if abs(value) < 1e9 else f"{value:.{digits}g}"


def shown_in_unit(value, factor, digits=3):
    """Show an SI value in another unit, ``factor`` of them per SI unit."""
    return shown_number(None if value is None else float(value) * factor, digits)


def share_of_limit(value):
    """Show a share of a limit in percent, above 10 as a factor."""
    if value is None:
        return "–"
    return f"{plain_number(value)} ×" if value >= 10.0 else f"{plain_number(100.0 * value)} %"


def angle(tangent):
    """Show the angle in degrees of a tangent."""
    return shown_number(None if tangent is None else math.degrees(math.atan(tangent)))
