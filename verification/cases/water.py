"""Slip of a joint below a water table. Case L24."""

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import InSitu, Model
from pyblast.solver.preparation import prepare
from verification.suite import Curve, Reading, case

ROCK = Material.from_speeds(2500.0, 4000.0, 2000.0)
HEIGHT, JOINT, GRAVITY, WATER = 100.0, 60.0, 9.81, 1000.0
COHESION, FRICTION, SHEAR = 2e4, 0.5, 6e5
HEADS = np.array([0.0, 15.0, 30.0, 45.0])  # m of water above the joint


def resistance(table):
    """Return the mean shear traction in Pa of a joint that slips under initial shear."""
    mesh = structured_box((2, 2, 10), (20.0, 20.0, HEIGHT), planes={"J": ("z", JOINT)})
    law = {"kn": 1e9, "ks": 5e8, "cohesion": COHESION, "friction": FRICTION, "tension": 0.0}
    model = Model(
        mesh.split(["J"]), {"rock": ROCK}, joints=[Joint("J", "coulomb", law)],
        boundaries=[
            *[Fixed(side, ("north", "vertical")) for side in ("west", "east")],
            *[Fixed(side, ("north",)) for side in ("south", "north")],
            Fixed("bottom"), Fixed("top", ("east", "north")),
        ],
        insitu=InSitu(GRAVITY, 0.0, (0.0, 0.0, 0.0, 0.0, SHEAR, 0.0), table, WATER),
    )  # fmt: skip
    traction, contacts = prepare(model, 0.01).constants["contact_initial"], model.mesh.contacts
    normal = np.einsum("ci,ci->c", traction, contacts.normal)
    shear = np.linalg.norm(traction - normal[:, None] * contacts.normal, axis=1)
    return np.average(shear, weights=contacts.area)


@case(
    "L24",
    "Joint that slips below a water table",
    source="Terzaghi's effective stress: c + (rho g d - rho_w g h) tan phi",
    gate="C",
    tolerance={f"strength under {head:g} m of water": 0.005 for head in HEADS},
    quick=True,
    note="A joint 40 m deep under 600 kPa of initial shear relaxes to its strength in the static "
    "stage; the water stands 0, 15, 30 and 45 m above it, the last above the ground.",
)
def water_table():
    """Compare the shear that a joint keeps with its strength under four water tables."""
    heads = HEADS
    weight = ROCK.density * GRAVITY * (HEIGHT - JOINT)
    strength = COHESION + FRICTION * (weight - WATER * GRAVITY * heads)
    measured = np.array([resistance(JOINT + head) for head in heads])
    readings = [
        Reading.relative(f"strength under {head:g} m of water", wanted, shear)
        for head, wanted, shear in zip(heads, strength, measured, strict=True)
    ]
    curve = Curve("joint 40 m deep", heads, 1e-3 * strength, 1e-3 * measured,
                  "water above the joint, m", "shear strength, kPa")  # fmt: skip
    return readings, [curve]
