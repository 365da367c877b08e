import random

import pytest
from small_project import TEXT, written

from pyblast.config.config import read_config
from pyblast.errors import InputError, PyblastError, ReadError
from pyblast.project.project import load_project

DEEP = "x = " + 3000 * "[" + 3000 * "]"

# What is wrong, the text it replaces, the replacement, what the one sentence must say.
MALFORMED = [
    ("key of earlier versions", "duration_s = 0.1", "duration_s = 0.1\nadded_mass = 0.01",
     "run: added_mass: small zones are implicit now and take no mass; remove it"),
    ("negative stiffness", "kn_gpa_per_m = 0.114", "kn_gpa_per_m = -1",
     "joints.F1.kn_gpa_per_m: must be positive, got -1"),
    ("misspelled key", "density_kg_per_m3 = 2000", "densty_kg_per_m3 = 2000",
     "materials.soil.densty_kg_per_m3: unknown key; did you mean 'density_kg_per_m3'?"),
    ("unknown table", "[damping]", "[dampning]", "dampning: unknown key; did you mean 'damping'?"),
    ("text for number", "ratio = 0.0112", 'ratio = "much"', "damping.ratio: must be a number"),
    ("number for text", 'material = "soil"', "material = 3", "layers[1].material: must be text"),
    ("fraction for count", "rows = 4", "rows = 4.5", "blast.rows: must be a whole number, got 4.5"),
    ("yes for true", "frequency_hz = 4", "frequency_hz = 4\nmass = 1", "mass: must be true"),
    ("not a number", "duration_s = 0.1", "duration_s = nan", "run.duration_s: must be finite"),
    ("infinite", "charge_kg = 450\ndia", "charge_kg = inf\ndia", "blast.charge_kg: must be finite"),
    ("missing key", "duration_s = 0.1", "", "run.duration_s: missing; add it"),
    ("missing title", 'title = "Small column"', "", "title: missing"),
    ("two values for three", "size_m = [60, 20, 30]", "size_m = [60, 20]",
     "mesh.size_m: must have at least 3 values"),
    ("zero size", "size_m = [60, 20, 30]", "size_m = [60, 0, 30]", "size_m[2]: must be positive"),
    ("steep dip", "dip_deg = 90", "dip_deg = 91", "mesh.faults[1].dip_deg: must be at most 90"),
    ("half a pair", "shear_mpa = 57.7", "", "materials.soil: shear_mpa is missing beside bulk_mpa"),
    ("two pairs", "shear_mpa = 57.7", "shear_mpa = 57.7\npoisson = 0.3",
     "materials.soil: give one of bulk_mpa and shear_mpa"),
    ("unit not known", "ks_gpa_per_m = 0.025", "ks_psi = 0.025",
     "joints.F1.ks_psi: unknown key; did you mean 'ks_gpa_per_m'?"),
    ("joint without stiffness", "ks_gpa_per_m = 0.025", "", "joints.F1.ks_gpa_per_m: missing"),
    ("negative cohesion", "cohesion_kpa = 20", "cohesion_kpa = -2",
     "joints.F1.cohesion_kpa: must not be negative, got -2"),
    ("steep friction", "friction_angle_deg = 25", "friction_angle_deg = 95",
     "must lie between 0 and 84 degrees, got 95"),
    ("unknown law", 'law = "coulomb"', 'law = "columb"', "joints.F1.law: must be one of elastic"),
    ("fault without joint", 'name = "F1"', 'name = "F9"', "joints.F9: missing; the joint surface"),
    ("layer without material", 'material = "soil"', 'material = "clay"',
     "mesh.layers[1].material: must be one of soil, rock, got 'clay'"),
    ("surface in two lists", 'free = ["top"]', 'free = ["top"]\nfixed = ["bottom"]',
     "boundaries: the surface 'bottom' stands in two lists"),
    ("assumed what is not there", '"signature.cavity"', '"signature.cavty"',
     "assumed: 'signature.cavty' must name a key"),
    ("rows without delay", "delay_ms = 40", "", "blast: delay_ms is missing beside rows"),
    ("negative delay", "delay_ms = 40", "delay_ms = -40", "blast.delay_ms: must not be negative"),
    ("two signatures", "[signature.cavity]", '[signature.recorded]\nfile = "a"\n[signature.cavity]',
     "signature: give one of recorded; cavity"),
    ("slash in a name", 'name = "R1"', 'name = "a/b"', "receivers[1].name: must be 1 to 60"),
    ("list for a table", "[damping]\nratio = 0.0112\nfrequency_hz = 4", "[[damping]]\nratio = 0.1",
     "damping: must be a table"),
    ("no TOML", "[mesh]", "[mesh", "not valid TOML"),
    ("key given twice", "rows = 4", "rows = 4\nrows = 5", "not valid TOML"),
    ("deep nesting", 'title = "Small column"', f'title = "a"\n{DEEP}', "nested too deeply"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "told"), [row[1:] for row in MALFORMED],
                         ids=[row[0] for row in MALFORMED])  # fmt: skip
def test_a_malformed_project_is_refused_in_one_sentence(tmp_path, old, new, told):
    path = written(tmp_path, (old, new))

    with pytest.raises(InputError) as found:
        load_project(path)

    text = str(found.value)
    assert text.startswith("project.toml: ")
    assert told in text
    assert "\n" not in text


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "project.toml"
    path.write_bytes("title".encode("utf-16"))

    with pytest.raises(ReadError, match="must be UTF-8"):
        read_config(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ReadError, match=r"can't be read \(No such file"):
        read_config(tmp_path / "absent.toml")


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(ReadError, match="is a folder; name a project file in it"):
        read_config(tmp_path)


def test_a_huge_file_is_refused_before_it_is_parsed(tmp_path):
    path = tmp_path / "project.toml"
    path.write_text("#" * 1_100_000)

    with pytest.raises(ReadError, match="at most 1 MB"):
        read_config(path)


def test_a_byte_order_mark_is_ignored(tmp_path):
    path = tmp_path / "project.toml"
    path.write_text(TEXT, encoding="utf-8-sig")

    assert read_config(path).title == "Small column"


def test_the_table_full_overrides_single_keys(tmp_path):
    path = written(tmp_path, text=TEXT + "\n[full.mesh]\ngrid_cells = [12, 4, 6]\n")

    assert read_config(path).mesh.grid_cells == [6, 2, 3]
    assert read_config(path, full=True).mesh.grid_cells == [12, 4, 6]
    assert read_config(path, full=True).mesh.size_m == [60, 20, 30]


def test_full_is_refused_where_the_file_has_none(tmp_path):
    with pytest.raises(InputError, match="has no table"):
        read_config(written(tmp_path), full=True)


def message_of(path):
    try:
        load_project(path)
    except PyblastError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_project_never_raises_anything_else(tmp_path, seed):
    chance = random.Random(seed)
    letters = list(TEXT)
    for _ in range(6):
        letters[chance.randrange(len(letters))] = chance.choice('[]{}"=.-9eé\x00\n')
    path = tmp_path / "project.toml"
    path.write_text("".join(letters), encoding="utf-8")

    assert "\n" not in message_of(path)


@pytest.mark.parametrize("through", ["[300, 0, 0]", "[-1, 0, 5]"])
def test_a_fault_outside_the_box_is_refused_as_such(tmp_path, through):
    path = written(tmp_path, ("through_m = [30, 0, 0]", f"through_m = {through}"))

    with pytest.raises(InputError, match=r"faults.F1: its plane passes the box .* move through_m"):
        load_project(path)
