"""What an effect may belong to: the whole site, its joints, blasts, receivers."""

from .case import Case

OF_BLAST = " of blast "


def whole_site(case: Case) -> tuple[str, ...]:
    """Return the one target of effects that belong to nothing smaller."""
    del case
    return ("",)


def joints(case: Case) -> tuple[str, ...]:
    """Return the names of the listed joints."""
    return tuple(j.joint.surface for j in case.site.joints)


def blasts(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts that are looked at."""
    return case.blasts


def blasts_of_many_holes(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts in which holes can differ."""
    return tuple(name for name in case.blasts if len(case.site.blasts[name].charge) > 1)


def holes(case: Case) -> tuple[str, ...]:
    """Return each hole of the blasts of many holes, with its blast."""
    return tuple(
        dict.fromkeys(
            f"{hole}{OF_BLAST}{name}"
            for name in blasts_of_many_holes(case)
            for hole in case.site.blasts[name].hole_ids
        )
    )


def blast_and_hole(target: str) -> tuple[str, str]:
    """Return the blast of a target, and its hole where it is a hole of a blast."""
    hole, _, blast = target.rpartition(OF_BLAST)
    return blast, hole


def receivers(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers with records."""
    return case.receivers


TARGETS = {"site": whole_site, "joint": joints, "blast": blasts, "receiver": receivers}
