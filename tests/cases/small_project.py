"""A small project for tests: a column of soil on rock with one fault, in a regular grid."""

from verification.faults import GROUND

TEXT = """
title = "Small column"
assumed = ["signature.cavity", "joints.F1.cohesion_kpa"]

[mesh]
size_m = [60, 20, 30]
grid_cells = [6, 2, 3]
[[mesh.layers]]
material = "soil"
thickness_m = 10
[[mesh.layers]]
material = "rock"
[[mesh.faults]]
name = "F1"
dip_deg = 90
dip_direction_deg = 90
through_m = [30, 0, 0]

[materials.soil]
density_kg_per_m3 = 2000
bulk_mpa = 125
shear_mpa = 57.7
cohesion_kpa = 15
friction_angle_deg = 40
[materials.rock]
density_kg_per_m3 = 2660
young_mpa = 18720
poisson = 0.3

[joints.F1]
law = "coulomb"
kn_gpa_per_m = 0.114
ks_gpa_per_m = 0.025
cohesion_kpa = 20
friction_angle_deg = 25
tension_kpa = 0

[boundaries]
viscous = ["west", "east", "south", "north", "bottom"]
free = ["top"]

[damping]
ratio = 0.0112
frequency_hz = 4

[blast]
rows = 4
holes_per_row = 15
delay_ms = 40
charge_kg = 450
diameter_mm = 250
depth_m = 17
burden_m = 6.5
spacing_m = 7.5
position_m = [-39, 10, 30]

[signature.cavity]
material = "rock"
hole_m = [-39, 5, 20]
receiver_m = [0, 10, 30]
charge_kg = 450
radius_m = 3
peak_time_ms = 30

[input]
low_pass_hz = 20

[[receivers]]
name = "R1"
position_m = [55, 10]
azimuth_deg = 90

[run]
duration_s = 0.1
snapshots_s = [0.05]
"""

# One hole, ground and pulse of which the mesh carries all: the run holds the motion of its blast.
CARRIED = (
    ("bulk_mpa = 125\nshear_mpa = 57.7", "bulk_mpa = 15600\nshear_mpa = 7200"),
    ("grid_cells = [6, 2, 3]", "grid_cells = [12, 4, 6]"),
    ("peak_time_ms = 30", "peak_time_ms = 150"), ("rows = 4", "rows = 1"),
    ("holes_per_row = 15", "holes_per_row = 1"),
)  # fmt: skip

INSIDE = f"""{GROUND}[[receivers]]
name = "house"
position_m = [52, 10]
[run]
duration_s = 0.1
"""


def written(folder, *changes, text=TEXT):
    """Write the project into a folder with some pieces of its text replaced; return its path."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "project.toml"
    path.write_text(text, encoding="utf-8")
    return path
