"""Slow twins of the kernels in plain NumPy, written from the formulae and not from the Fortran."""

import numpy as np


def zone_frame(points):
    """Return volume and the gradients (4, 3) of the shape functions of a tetrahedron (4, 3)."""
    system = np.column_stack([np.ones(4), points])
    return abs(np.linalg.det(system)) / 6.0, np.linalg.inv(system)[1:].T


def stress_of(gradient, first_lame, shear):
    """Return the stress (3, 3) of a displacement gradient (3, 3) by Hooke's law."""
    strain = 0.5 * (gradient + gradient.T)
    return first_lame * np.trace(strain) * np.eye(3) + 2.0 * shear * strain


def zone_forces(points, zones, first_lame, shear, beta, displacement, velocity):
    """Return nodal forces (n_nodes, 3), strain energy and power of the stiffness damping."""
    force, energy, power = np.zeros_like(points), 0.0, 0.0
    for z, zone in enumerate(zones):
        volume, shape = zone_frame(points[zone])
        gradient, rate = displacement[zone].T @ shape, velocity[zone].T @ shape
        stress = stress_of(gradient, first_lame[z], shear[z])
        extra = beta[z] * stress_of(rate, first_lame[z], shear[z])
        energy += 0.5 * volume * np.sum(stress * gradient)
        power += volume * np.sum(extra * rate)
        np.add.at(force, zone, -volume * shape @ (stress + extra))
    return force, energy, power


def zone_matrix(points, first_lame, shear):
    """Return volume and stiffness (12, 12) of one tetrahedron (4, 3)."""
    volume, shape = zone_frame(points)
    columns = []
    for place in range(12):
        unit = np.zeros((4, 3))
        unit[place // 3, place % 3] = 1.0
        columns.append((volume * shape @ stress_of(unit.T @ shape, first_lame, shear)).ravel())
    return volume, np.array(columns).T
