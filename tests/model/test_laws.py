"""The rows of laws: what they say is read once; what they must not say is refused."""

import numpy as np
import pytest

from pyblast import core
from pyblast.laws import StressLaw, TractionLaw, of_laws, read_laws
from pyblast.units import FACTORS, PROPERTY_UNITS
from verification.contact import properties
from verification.zone import MATERIALS

SPRINGS = "kn[Pa/m] > 0, ks[Pa/m] > 0"
SEATED = f"seated: {SPRINGS}, seat[m] > 0, kn_seated[Pa/m] >= kn = 10*kn | stiffens |"
STICKS = "slip_x=0 slip_y=0 slip_z=0 failed status gap"


def laws(*rows, kind=TractionLaw):
    return read_laws(kind, [*rows, ""], 400, 12, 12)


def test_a_row_says_unit_range_and_default_of_each_property():
    law = laws(SEATED)["seated"]

    assert list(law.properties) == ["kn", "ks", "seat", "kn_seated"]
    assert law.properties["seat"].key == "seat_mm"
    assert law.complete("J", {"kn": 1e9, "ks": 1e9, "seat": 1e-3})["kn_seated"] == 1e10
    assert (law.stiffens, law.linear, law.superposes, law.opens) == (True, False, False, False)


def test_a_length_is_given_as_a_length_and_a_stiffness_as_a_stiffness():
    law = laws(SEATED)["seated"]

    assert set(law.properties["seat"].file_units) == {"mm", "m"}
    assert set(law.properties["kn_seated"].file_units) == {"gpa_per_m", "mpa_per_m", "pa_per_m"}


def test_a_row_may_choose_the_customary_unit():
    law = laws(f"rough: {SPRINGS}, jcs[Pa] in MPa > 0 | | ")["rough"]

    assert law.properties["jcs"].key == "jcs_mpa"
    assert set(law.properties["jcs"].file_units) == {"mpa", "kpa", "pa"}


def test_all_units_of_properties_have_a_factor():
    suffixes = {suffix for units in PROPERTY_UNITS.values() for suffix in units}

    assert suffixes - {"", "angle_deg"} <= set(FACTORS)


@pytest.mark.parametrize(
    ("row", "told"),
    [
        (SEATED.replace("[m]", "[feet]"), "unknown unit; use one of Pa/m, .* or add it"),
        (SEATED.replace("[m] >", "[m] in kPa >"), "project files have no such unit; use one of"),
        (SEATED.replace("seat[m]", "seat_s[1]"), "take the end of its name for a unit; rename it"),
        (SEATED.replace("seat[m]", "seat"), "a property is 'NAME.UNIT. in FILE RULES = DEFAULT'"),
        (SEATED.replace("10*kn", "10*kp"), "a default is a number, inf, a property that stands"),
        (SEATED.replace("10*kn", "ten*kn"), "a default is a number, inf, a property that stands"),
        (SEATED.replace(">= kn", ">= kp"), "kn_seated: has no property 'kp'"),
        (SEATED.replace("stiffens", "stiff"), "is not 'stiff'; a kind is one of flows, linear"),
        (SEATED.replace("stiffens |", ""), "a row is 'NAME: PROPERTIES | KIND | STATE'"),
        (SEATED.replace("ks[Pa/m] > 0", "ks[Pa/m] >= 0"), "must begin with kn and ks above zero"),
        (f"{SEATED} gap", "status and gap must be states 5 and 6"),
        (f"a: {SPRINGS} | sticks | {STICKS}", "one that sticks has cohesion, friction, tension"),
        (f"{SEATED} {' '.join(f's{n}' for n in range(13))}", "has 13 states, the kernels hold 12"),
        (SEATED + 400 * "x", "its row may be cut; increase n_row"),
    ],
)
def test_a_row_that_is_not_of_the_grammar_is_refused_with_what_it_may_be(row, told):
    with pytest.raises(ValueError, match=r"^law '\w+'.*") as raised:
        laws(row)

    assert raised.match(told.replace("|", r"\|"))


def test_a_law_stands_once_in_its_table():
    with pytest.raises(ValueError, match="law 'seated': stands twice"):
        laws(SEATED, SEATED)


def test_laws_of_numbers_answer_together():
    answers = of_laws(core.JOINT_LAWS, np.array([0, 1, 1, 7]), "linear")

    assert answers.tolist() == [True, False, False, True]


@pytest.mark.parametrize("name", core.JOINT_LAWS)
def test_the_properties_of_tests_keep_the_row_of_their_joint_law(name):
    given = properties(name)

    assert core.JOINT_LAWS[name].complete("J", given) == given


@pytest.mark.parametrize("name", core.ZONE_LAWS)
def test_the_properties_of_materials_keep_the_row_of_their_law(name):
    given = MATERIALS[name].law.properties(MATERIALS[name])

    assert core.ZONE_LAWS[name].complete("material", given) == given


@pytest.mark.parametrize("name", core.ZONE_LAWS)
def test_ground_that_yields_has_a_memory(name):
    law = core.ZONE_LAWS[name]

    assert bool(law.state) == law.yields == (not law.linear)
    assert bool(core._core.pyblast_zone_laws.has_memory(law.number + 1)) == law.yields
    assert not laws(f"{name}: | linear |", kind=StressLaw)[name].yields
