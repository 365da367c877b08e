"""Anisotropic and effective media: layered, schistose, jointed and saturated rock."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..units import check_modulus
from .material import Material

VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
NAMES = [(i, j) for i in range(6) for j in range(i, 6)]


@dataclass(frozen=True, eq=False)
class Anisotropic:
    """Anisotropic linear elasticity of any symmetry and orientation.

    Parameters
    ----------
    stiffness : (6, 6) float64, Pa
        In the axes of the model; strains xx yy zz and engineering shears yz zx xy.

    Raises
    ------
    InputError
        If the stiffness is not symmetric and positive definite.

    Notes
    -----
    theory.md (2.19). A factor on the shear modulus of a zone scales the whole stiffness.
    """

    stiffness: np.ndarray
    name: ClassVar[str] = "anisotropic"
    branches = ()  # no relaxation

    def __post_init__(self) -> None:
        """Check symmetry and positive definiteness."""
        matrix = np.array(self.stiffness, dtype=np.float64)
        if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
            raise InputError(f"stiffness: must be 6 x 6 finite numbers, got shape {matrix.shape}")
        largest = np.abs(matrix).max()
        if np.abs(matrix - matrix.T).max() > 1e-9 * largest:
            raise InputError(
                f"stiffness: must be symmetric, differs by {np.abs(matrix - matrix.T).max():.3g} Pa"
            )
        least = np.linalg.eigvalsh(matrix)[0]
        if not least > 1e-12 * largest:
            raise InputError(
                f"stiffness: every strain must store energy, least eigenvalue is {least:.3g} Pa; "
                "check the moduli and Poisson's ratios"
            )
        object.__setattr__(self, "stiffness", 0.5 * (matrix + matrix.T))

    def properties(self, material: Material) -> dict[str, float]:
        """Return the 21 constants over the shear modulus of the material."""
        relative = self.stiffness / material.shear
        return {f"c{i + 1}{j + 1}": relative[i, j] for i, j in NAMES}

    def moduli(self, material: Material) -> tuple[float, float]:
        """Return first Lame modulus and shear modulus of the material, Pa."""
        return material.first_lame, material.shear

    def turned(self, rotation: ArrayLike) -> "Anisotropic":
        """Return the medium rotated by a matrix (3, 3)."""
        return Anisotropic(turned_stiffness(self.stiffness, rotation))


def turned_stiffness(stiffness: np.ndarray, rotation: ArrayLike) -> np.ndarray:
    """Return a stiffness (6, 6) rotated by a matrix (3, 3): theory.md (2.20)."""
    full = np.empty((3, 3, 3, 3))
    for i, (a, b) in enumerate(VOIGT):
        for j, (c, d) in enumerate(VOIGT):
            for pair in ((a, b), (b, a)):
                full[(*pair, c, d)] = full[(*pair, d, c)] = stiffness[i, j]
    turned = np.einsum("ia,jb,kc,ld,abcd->ijkl", *[np.asarray(rotation)] * 4, full)
    return np.array([[turned[a, b, c, d] for c, d in VOIGT] for a, b in VOIGT])


def axes_with_normal(normal: ArrayLike) -> np.ndarray:
    """Return a rotation matrix (3, 3) from the z axis to a normal (3,) of any length.

    Raises
    ------
    InputError
        If the normal is zero.
    """
    normal = np.asarray(normal, dtype=float)
    length = np.linalg.norm(normal)
    if normal.shape != (3,) or not (np.isfinite(length) and length > 0.0):
        raise InputError(f"normal: must be three numbers, not all zero, got {normal}")
    third = normal / length
    first = np.cross(np.eye(3)[int(np.abs(third).argmin())], third)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=1)


def anisotropic(density: float, stiffness: ArrayLike, **strength: float) -> Material:
    """Return an anisotropic material.

    Parameters
    ----------
    density : float, kg/m3
    stiffness : (6, 6) float, Pa
        In the axes of the model; strains xx yy zz and engineering shears yz zx xy.
    **strength : float
        Cohesion, friction, tension of `Material`.

    Returns
    -------
    Material
        Its bulk and shear modulus are the Voigt (1928) averages, used for mesh sizes and the
        absorbing layer.

    Raises
    ------
    InputError
        If the stiffness is not symmetric and positive definite.
    """
    law = Anisotropic(np.asarray(stiffness, dtype=float))
    c = law.stiffness
    bulk = c[:3, :3].sum() / 9.0
    shear = (np.trace(c[:3, :3]) - 3.0 * bulk) / 10.0 + np.trace(c[3:, 3:]) / 5.0
    return Material(density, bulk, shear, law=law, **strength)


def transverse(
    density: float,
    normal: ArrayLike,
    *,
    young: float,
    young_normal: float,
    poisson: float,
    poisson_normal: float,
    shear_normal: float,
    **strength: float,
) -> Material:
    """Return a transversely isotropic material: isotropic in the planes across a normal.

    Parameters
    ----------
    density : float, kg/m3
    normal : (3,) float
    young, young_normal : float, Pa
        Young's modulus in the planes and along the normal.
    poisson, poisson_normal : float
        Poisson's ratio within the planes, and for tension along the normal.
    shear_normal : float, Pa
        Shear modulus of planes that slide on one another.
    **strength : float
        Cohesion, friction, tension of `Material`.

    Raises
    ------
    InputError
        If a modulus is not positive or the stiffness not positive definite.
    """
    compliance = np.zeros((6, 6))
    for name, value in (
        ("young", young), ("young_normal", young_normal), ("shear_normal", shear_normal),
    ):  # fmt: skip
        if not 0.0 < value < np.inf:
            raise InputError(f"material.{name}: must be positive, got {value:g} Pa")
        check_modulus(f"material.{name}", value)
    if not -1.0 < poisson < 1.0:
        raise InputError(f"material.poisson: must lie between -1 and 1, got {poisson:g}")
    compliance[:3, :3] = [
        [1.0 / young, -poisson / young, -poisson_normal / young_normal],
        [-poisson / young, 1.0 / young, -poisson_normal / young_normal],
        [-poisson_normal / young_normal, -poisson_normal / young_normal, 1.0 / young_normal],
    ]
    shears = (1.0 / shear_normal, 1.0 / shear_normal, 2.0 * (1.0 + poisson) / young)
    compliance[range(3, 6), range(3, 6)] = shears
    if not np.linalg.eigvalsh(compliance)[0] > 0.0:
        raise InputError(
            f"material.poisson_normal: {poisson_normal:g} with poisson {poisson:g} is not "
            "positive definite; 2 poisson_normal^2 young/young_normal must stay below "
            "1 - poisson"
        )
    stiffness = turned_stiffness(np.linalg.inv(compliance), axes_with_normal(normal))
    return anisotropic(density, stiffness, **strength)


def jointed(
    material: Material, normal: ArrayLike, spacing: float, kn: float, ks: float
) -> Material:
    """Return the effective medium of rock with parallel joints, for wavelengths of ten spacings.

    Parameters
    ----------
    material : Material
        The rock between the joints; may be an effective medium of other joints.
    normal : (3,) float
        Of the joints.
    spacing : float, m
    kn, ks : float, Pa/m

    Returns
    -------
    Material
        Anisotropic, of the same density and strength.

    Raises
    ------
    InputError
        If a value is not positive, or the material is neither elastic nor anisotropic.

    Notes
    -----
    Compliances add: Schoenberg (1980), Schoenberg & Sayers (1995); theory.md (2.21).
    """
    for name, value in (("spacing", spacing), ("kn", kn), ("ks", ks)):
        if not 0.0 < value < np.inf:
            raise InputError(f"jointed.{name}: must be positive, got {value:g}")
    axes = axes_with_normal(normal)
    across = np.linalg.inv(turned_stiffness(stiffness_of(material), axes.T))
    across[2, 2] += 1.0 / (kn * spacing)
    across[3, 3] += 1.0 / (ks * spacing)
    across[4, 4] += 1.0 / (ks * spacing)
    strength = {name: getattr(material, name) for name in ("cohesion", "friction", "tension")}
    stiffness = turned_stiffness(np.linalg.inv(across), axes)
    return anisotropic(material.density, stiffness, **strength)


def stiffness_of(material: Material) -> np.ndarray:
    """Return the stiffness matrix (6, 6) in Pa of an elastic or anisotropic material.

    Raises
    ------
    InputError
        If the material has another law.
    """
    if isinstance(material.law, Anisotropic):
        return material.law.stiffness
    if material.law.name != "elastic" or material.law.branches:
        law = type(material.law).__name__
        raise InputError(f"jointed: the rock must be elastic, got the law {law}")
    lame, shear = material.first_lame, material.shear
    stiffness = np.diag([2.0 * shear] * 3 + [shear] * 3)
    stiffness[:3, :3] += lame
    return stiffness


def christoffel(stiffness: np.ndarray, normal: ArrayLike) -> np.ndarray:
    """Return the Christoffel tensor (..., 3, 3) in Pa for unit normals (..., 3); (2.22)."""
    x, y, z = np.moveaxis(np.asarray(normal, dtype=float), -1, 0)
    o = np.zeros_like(x)
    rows = np.array([[x, o, o, o, z, y], [o, y, o, z, o, x], [o, o, z, y, x, o]])
    along = np.moveaxis(rows, (0, 1), (-2, -1))
    return along @ stiffness @ np.swapaxes(along, -1, -2)


def impedance(density: ArrayLike, stiffness: np.ndarray, normal: ArrayLike) -> np.ndarray:
    """Return the impedance matrix (..., 3, 3) in Pa s/m of waves along unit normals; (2.23).

    The matrix square root of density times `christoffel`.
    """
    squared, direction = np.linalg.eigh(christoffel(stiffness, normal))
    scaled = direction * np.sqrt(np.asarray(density)[..., None, None] * squared[..., None, :])
    return scaled @ np.swapaxes(direction, -1, -2)


def saturated_rock(
    dry: Material,
    porosity: float,
    solid_bulk: float,
    fluid_bulk: float = 2.2e9,
    fluid_density: float = 1000.0,
) -> Material:
    """Return the material of fluid-saturated rock (Gassmann); theory.md (1.9).

    Parameters
    ----------
    dry : Material
    porosity : float
    solid_bulk, fluid_bulk : float, Pa
    fluid_density : float, kg/m3

    Raises
    ------
    InputError
        If the porosity is not between 0 and 1, or the solid not stiffer than the dry rock.
    """
    if not 0.0 < porosity < 1.0:
        raise InputError(f"material.porosity: must lie between 0 and 1, got {porosity:g}")
    if not dry.bulk < solid_bulk:
        raise InputError(
            f"material.solid_bulk: must exceed that of the dry rock, {dry.bulk:g} Pa, got "
            f"{solid_bulk:g} Pa"
        )
    share = dry.bulk / solid_bulk
    pores = porosity / fluid_bulk + (1.0 - porosity) / solid_bulk - share / solid_bulk
    bulk = dry.bulk + (1.0 - share) ** 2 / pores
    return replace(dry, density=dry.density + porosity * fluid_density, bulk=bulk)
