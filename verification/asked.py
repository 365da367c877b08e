"""What was asked of each quantity before it was measured: tolerance and mesh.

The numbers are those of the plan of verification; they change only with the plan. A quantity that
misses them on the mesh asked for fails, whatever finer meshes show.
"""

from fnmatch import fnmatchcase
from typing import NamedTuple

ROUNDING = 1e-12  # what a quantity may miss of which nothing at all is asked


class Asked(NamedTuple):
    """Tolerance asked for, and on which mesh (None: on the finest of the study)."""

    tolerance: float
    mesh: float | None = None


# by case and quantity; patterns are tried in order, quantities that match none were not asked for
ASKED = {
    "1": {
        "discrete formula*": Asked(1e-10, 10.0),
        "speed*": Asked(0.009, 10.0),
    },
    "2": {
        "slowest P, six*": Asked(0.033, 10.0),
        "fastest S, six*": Asked(0.042, 10.0),
        "slowest P, five*": Asked(0.021, 10.0),
        "fastest S, five*": Asked(0.018, 10.0),
    },
    "3": {"amplitude*": Asked(0.038, 10.0)},
    "4": {"*": Asked(0.01, 10.0)},
    "5": {
        "|T| at k/zw 0.1,*": Asked(0.048, 10.0),
        "|T| at k/zw 0.3,*": Asked(0.034, 10.0),
        "|T| at k/zw 1,*": Asked(0.002, 10.0),
        "delay*": Asked(0.02, 10.0),
    },
    "6": {"energy*": Asked(0.01, 10.0), "*": Asked(0.05, 10.0)},
    "7": {
        "|T|*": Asked(0.05, 12.0),
        "speed*": Asked(0.01, 12.0),
    },
    "8": {
        "T at*": Asked(0.02, 20.0),
        "R at strength 0.9": Asked(0.05, 10.0),
        "*": Asked(0.05, 10.0),
    },
    "9": {"slip*": Asked(0.055, 10.0)},
    "10": {
        "T at the*": Asked(0.03, 20.0),
        "T at twice*": Asked(0.03, 20.0),
        "peak*": Asked(0.035, 20.0),
    },
    "11": {
        "|T| of the layer*": Asked(0.05, 10.0),
        "T of*": Asked(0.05, 10.0),
        "*driven alone": Asked(0.01, 10.0),
    },
    "12": {
        "P at 0 deg": Asked(1e-4, 10.0),
        "SH at 0 deg": Asked(1e-4, 10.0),
        "*": Asked(0.02, 10.0),
    },
    "13": {"*1 wavelengths": Asked(0.15, 10.0)},
    "14": {"motion*": Asked(0.1, 10.0)},
    "15": {"speed": Asked(0.015, 10.0)},
    "16": {"speed*": Asked(0.02, 10.0)},
    "17": {
        "amplitude*": Asked(0.05, 10.0),
        "band*": Asked(0.05, 10.0),
    },
    "18": {"velocity*": Asked(0.05, 8.0)},
    "19": {"*": Asked(0.001)},
    "20": {"yielded radius": Asked(0.05)},
    "21": {"bearing pressure": Asked(0.03)},
    "22": {"frequency 1,*": Asked(0.01, 5.0), "peak 1,*": Asked(0.05, 5.0)},
    "23": {"*": Asked(0.05, 4.0)},
    "24": {"ratio*": Asked(0.01), "growth*": Asked(0.5)},
    "25": {"Q of*": Asked(0.05, 10.0), "1/Q of the body*": Asked(0.05)},
    "26": {"elastic*": Asked(0.001), "joints*": Asked(0.001), "*slip*": Asked(0.01)},
    "27": {
        "turned model": Asked(1e-12),
        "*": Asked(1e-12),
    },
    "28": {"acceleration*": Asked(0.005)},
    "29": {"swing*": Asked(0.005), "growth*": Asked(0.5)},
    "30": {"rupture time": Asked(0.02, 3.10395)},
    "31": {"*": Asked(1e-6)},
    "33": {"*": Asked(1e-10)},
    "34": {"largest difference*": Asked(3.0)},
    "35": {"*": Asked(1e-10)},
    "L1": {
        "fastest wave": Asked(0.01, 15.0),
        "slower waves": Asked(0.01, 15.0),
        "speed across joints": Asked(0.033, 15.0),
    },
    "L2": {"*": Asked(0.05, 10.0)},
    "L3": {"delay": Asked(0.005, 10.0), "amplitude": Asked(0.02, 10.0)},
    "L4": {"*": Asked(0.02, 10.0)},
    "L5": {"*": Asked(0.05, 10.0)},
    "L6": {
        "|T|*": Asked(0.01),
        "*": Asked(0.001),
    },
    "L7": {"*": Asked(0.05, None)},
    "L8": {"*": Asked(0.02, 10.0)},
    "L9": {"*": Asked(0.01, 5.0)},
    "L10": {"*": Asked(0.001)},
    "L11": {"*": Asked(0.01, 10.0)},
    "L12": {"*": Asked(ROUNDING)},
}  # fmt: skip

NOT_MEASURED = {
    "2": ("speed on unstructured tetrahedra, 12 edges: 1 %",),
    "7": ("2 to 8 joints from 1 to 40 Hz: 3 %",),
    "12": ("P at 75 and 80 deg", "SV at 20 and 75 deg"),
    "14": ("arrival of the Rayleigh wave: 1 %",),
    "30": ("TPV5",),
    "L3": ("gradient column against Bessel functions: 2 %",),
}


def asked_of(number: str, quantity: str) -> Asked | None:
    """Return what is asked of a quantity of a case, or None."""
    for pattern, asked in ASKED.get(number, {}).items():
        if fnmatchcase(quantity, pattern.replace("[", "[[]")):
            return asked
    return None
