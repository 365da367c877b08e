"""Defects of quiet faces that show before a run: sides that drain a plane wave, jointed ground."""

import math

import numpy as np

from .findings import Finding

LITTLE = 0.7
MISMATCH = 0.1
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))


def drained(face, sides, share):
    """Return what quiet sides leave of a long plane wave that runs along them, (3,).

    Parameters
    ----------
    face : (3, 3) float64, N s/m
        Impedance of the whole input face.
    sides : (3, 3) float64, N s/m
        Impedance of all dashpots on surfaces along the way.
    share : float
        Of the way along the sides that the wave has gone.

    Notes
    -----
    The wave carries the power v Z v through the face, the dashpots take v D v, spread along the
    way: amplitude falls about as ``exp(-share D / (2 Z))`` where the wave is longer than the model
    is wide; shorter waves keep more in the middle. theory.md section 4.1.
    """
    return np.exp(-0.5 * share * np.diag(sides) / np.diag(face))


def draining_sides(surfaces, left, receiver, from_below):
    """D23: quiet sides along the way of a plane wave; None where they take little.

    Parameters
    ----------
    surfaces : sequence of str
    left : (3,) float64
        Of `drained`, east, north, vertical.
    receiver : str
        Where.
    from_below : bool
        Whether the wave runs up: free-field sides are then the cure.
    """
    if not len(surfaces) or min(left) > LITTLE:
        return None
    listed = "/".join(f"{100.0 * value:.2g}" for value in left)
    cure = (
        "make it wider, compare with rollers on these sides, or let the wave come from below, "
        "where boundaries.free_field keeps it"
    )
    if from_below:
        cure = "name these sides in boundaries.free_field, so that they see the ground beside move"
    return Finding(
        "D23",
        "Quiet sides drain the wave that runs along them",
        f"The dashpots on {', '.join(surfaces)} leave as little as {listed} % of a long wave "
        f"(east/north/vertical) on its way to {receiver}, where the width of the model then sets "
        f"the amplitude; {cure}.",
        numbers=dict(zip(("east", "north", "vertical"), map(float, left), strict=True)),
    )


def jointed_stiffness(material, joint_sets):
    """Return the stiffness (3, 3, 3, 3) in Pa of rock with joints closer than waves are long.

    Parameters
    ----------
    material : Material
    joint_sets : sequence of (normal (3,), kn, ks, spacing)
        SI.

    Notes
    -----
    Strain is that of the rock plus ``sym(jump n) / spacing`` of each set, the jump being traction
    over stiffness: Schoenberg (1980).
    """
    compliance = np.zeros((6, 6))
    for column, stress in enumerate(_BASIS):
        strain = stress / (2.0 * material.shear)
        poisson = material.poisson / (2.0 * material.shear * (1.0 + material.poisson))
        strain = strain - poisson * np.trace(stress) * np.eye(3)
        for normal, kn, ks, spacing in joint_sets:
            traction = stress @ normal
            push = (traction @ normal) * normal
            jump = push / kn + (traction - push) / ks
            strain = strain + (np.outer(jump, normal) + np.outer(normal, jump)) / (2.0 * spacing)
        compliance[:, column] = np.einsum("bij,ij->b", _BASIS, strain)
    return np.einsum("aij,ab,bkl->ijkl", _BASIS, np.linalg.inv(compliance), _BASIS)


def _basis():
    """Return the six unit stresses (6, 3, 3), orthonormal."""
    basis = np.zeros((6, 3, 3))
    for tensor, (i, j) in zip(basis, _PAIRS, strict=True):
        tensor[i, j] = tensor[j, i] = 1.0 if i == j else math.sqrt(0.5)
    return basis


_BASIS = _basis()


def jointed_face(group, material, joint_sets, direction):
    """D24: dashpots and stress input of intact rock on a face of jointed rock; None if alike.

    Parameters
    ----------
    group : str
    material : Material
    joint_sets : sequence of (normal (3,), kn, ks, spacing)
        Those that cut the group, SI.
    direction : (3,) float64
        Normal of the face.

    Notes
    -----
    Waves much longer than the spacing meet the impedance rho c' of the jointed rock. A face that is
    driven and damped with rho c then moves by 2 c / (c + c') of what is wanted, and its dashpots
    return (c - c') / (c + c'). theory.md section 4.2.
    """
    stiffness = jointed_stiffness(material, joint_sets)
    christoffel = np.einsum("ijkl,j,l->ik", stiffness, direction, direction)
    moduli, axes = np.linalg.eigh(christoffel)
    along = int(np.argmax(np.abs(direction @ axes)))
    ratio_p = math.sqrt(moduli[along] / material.density) / material.cp
    ratio_s = math.sqrt(np.delete(moduli, along).min() / material.density) / material.cs
    excess = [2.0 / (1.0 + ratio) - 1.0 for ratio in (ratio_p, ratio_s)]
    if max(excess) < MISMATCH:
        return None
    return Finding(
        "D24",
        f"Quiet faces see '{group}' without its joints",
        f"Waves much longer than the spacing run at {ratio_p:.2f} (P) and {ratio_s:.2f} (S) of the "
        f"speed of the intact rock, but stress input and dashpots take that of the intact rock: "
        f"the motion that enters is {100 * excess[0]:.0f} % (P) and up to {100 * excess[1]:.0f} % "
        "(S) larger than asked for, and as much of the amplitude comes back from quiet faces; "
        "boundaries.jointed_faces = true lets the faces know of the joints.",
        numbers={"speed_p": ratio_p, "speed_s": ratio_s, "excess_p": excess[0],
                 "excess_s": excess[1]},
    )  # fmt: skip
