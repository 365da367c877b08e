"""Ground: geometry, materials, joints, fields and boundaries, whatever elements it is cut into."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from ..config.ground import AbsorbingLayerConfig, BoundariesConfig, GroundConfig, MeshConfig
from ..mesh.grid import Geometry
from ..model.joint import Joint
from ..model.material import Material
from ..readers.provenance import ReadLog
from .surface import benches_of, make_surface
from .tables import damages_material, make_geometry


@dataclass(frozen=True, eq=False)
class Ground:
    """Ground: what is there, and how fine its mesh is asked to be.

    Parameters
    ----------
    mesh : MeshConfig
        Box, layers, joint sets, faults and fractures, or a mesh file; sizes and kind of elements.
    variation : GroundConfig
        Spatial fields of the file.
    boundaries : BoundariesConfig
    absorbing_layer : AbsorbingLayerConfig or None
    materials : dict of str to Material
    joints : tuple of Joint
    terrain : (n, 3) or (n, 3, 3) float64, m, or None
        Surveyed top surface, or its triangles, in place of that of the mesh table.
    entered : str
        How motion enters through a side: "velocity", "stress", "plane_wave"; empty: it does not.
    top : float or None, Hz
        Highest frequency in which records are compared, where one is stated.
    folder : Path
        Where files are looked for.
    log : ReadLog
        Takes what is read from them.
    """

    mesh: MeshConfig
    variation: GroundConfig
    boundaries: BoundariesConfig
    absorbing_layer: AbsorbingLayerConfig | None
    materials: dict[str, Material]
    joints: tuple[Joint, ...]
    terrain: np.ndarray | None
    entered: str
    top: float | None
    folder: Path
    log: ReadLog = field(default_factory=ReadLog, repr=False)

    @cached_property
    def surface(self) -> np.ndarray | None:
        """Surveyed top surface, (n, 3) m, or its triangles (n, 3, 3); None where flat."""
        if self.terrain is not None:
            return self.terrain
        return make_surface(self.mesh, self.folder, self.log)

    @property
    def frequency(self) -> float | None:
        """Highest frequency in Hz that the mesh is asked to carry, None where nothing states it."""
        return self.top if self.mesh.frequency_hz is None else self.mesh.frequency_hz

    @property
    def geometry(self) -> Geometry:
        """Box, layers, planes and sides; InputError where they contradict one another."""
        viscous = set() if self.entered else set(self.boundaries.viscous)
        benches = benches_of(self.mesh, self.folder) if self.terrain is None else ()
        return make_geometry(self.mesh, viscous, self.surface, benches)

    def key(self) -> tuple:
        """Return what decides the mesh: all but the values of materials and joints.

        Edges that follow from speeds are those of the ground that was meshed first.
        """
        laws = tuple((name, rock.law.name) for name, rock in self.materials.items())
        joints = tuple(joint.surface for joint in self.joints)
        tables = self.mesh, self.variation, self.boundaries
        heights = None if self.terrain is None else np.asarray(self.terrain, dtype=float).tobytes()
        return *(t.model_dump_json() for t in tables), heights, joints, laws

    @property
    def sized_by_speeds(self) -> bool:
        """Whether edges are stated as a share of the wavelength."""
        parts = [self.mesh, *self.mesh.layers]
        return any(part.edges_per_wavelength is not None for part in parts)

    @property
    def of_one_blast(self) -> bool:
        """Whether the holes of one blast have changed its material, so that no other shares it."""
        return damages_material(self.variation)
