"""What a check says about a project: one finding per defect."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Finding:
    """Something doubtful about a project.

    Parameters
    ----------
    code : str
        D1 to D35.
    title, text : str
        What it is, in words; what it is here, in numbers.
    failed : bool
        Whether a result can't be trusted unless this is changed.
    numbers : dict of str to float
        SI.
    """

    code: str
    title: str
    text: str
    failed: bool = False
    numbers: dict[str, float] = field(default_factory=dict)


def by_wave(pairs):
    """Name the numbers of P and S waves, ``{"rock": (1, 2)}`` as ``{"p_rock": 1, "s_rock": 2}``."""
    return {f"{w}_{n}": v for n, pair in pairs.items() for w, v in zip("ps", pair, strict=True)}
