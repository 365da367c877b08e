"""What is told of a plan of delays, in sentences."""


def delay_lines(table) -> list[str]:
    """Say which delays are best, what they are worth and what houses feel.

    Parameters
    ----------
    table : dict
        Of `summarise_delays`.
    """
    best, gained = table["delays_s"], table["severity"]
    band = "all frequencies" if table["band_hz"] is None else "{:g} to {:g} Hz".format(
        *table["band_hz"]
    )  # fmt: skip
    low, high = gained["reduction_90"]
    told = [
        f"best of {len(table['tried'])} plans at {band}: {1e3 * best['between_holes']:.3g} ms "
        f"between holes, {1e3 * best['between_rows']:.3g} ms between rows",
        f"largest PPV over its limit that {100 * table['share']:.3g} % of blasts stay below: "
        f"{gained['after']:.3g}, as planned {gained['before']:.3g}; {100 * gained['reduction']:.3g}"
        f" % less, by the number of draws between {100 * low:.3g} and {100 * high:.3g} %",
    ]
    for house in table["houses"]:
        told.append(f"{house['name']}: limit {1e3 * house['limit']:.3g} mm/s{_curve(house)}")
        for name, words in (("before", "as planned"), ("after", "best delays")):
            one = house[name]
            levels = " ".join(f"{1e3 * level:.3g}" for level in one["levels"].values())
            bands = ", ".join(
                f"{1e3 * least:.3g} to {1e3 * most:.3g}" for least, most in one["bands"].values()
            )
            told.append(
                f"  {words}: PPV that 50, 90, 95 % stay below {levels} mm/s; 50, 90, 95 % within "
                f"{bands} mm/s; {100 * one['kept']:.3g} % keep the limit"
            )
    return told


def _curve(house):
    """Say which curve a limit is of, and whether anybody compared it with the standard."""
    if house["curve"] is None:
        return ""
    verified = "" if house["curve_verified"] else ", not verified"
    return f" ({house['curve']}{verified}, its lowest value in the band)"
