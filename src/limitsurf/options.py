"""The options of a surface, as they are in force: which scheme, and what applies at boundaries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from limitsurf import tables
from limitsurf.cage import checks
from limitsurf.cage.mesh import Mesh

if TYPE_CHECKING:
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]


@dataclass(frozen=True)
class Rules:
    """Which scheme applies to a mesh, and how at boundaries, creases and triangles."""

    scheme: Scheme
    boundary: str
    creasing: str
    triangles: str

    @classmethod
    def resolve(
        cls,
        mesh: Mesh,
        scheme: str | Scheme | None = None,
        boundary: str | None = None,
        creasing: str | None = None,
        triangles: str | None = None,
    ) -> Rules:
        """Options from the arguments, else from the mesh, else the defaults; all are checked."""
        given = {"boundary": boundary, "creasing": creasing, "triangles": triangles}
        allowed = {
            "boundary": ("edge_and_corner", "edge_only", "none"),
            "creasing": ("uniform", "chaikin"),
            "triangles": ("catmull-clark", "smooth"),
        }
        chosen = {}
        for option, values in allowed.items():
            value = next(
                x for x in (given[option], getattr(mesh, option), values[0]) if x is not None
            )
            if value not in values:
                raise ValueError(f"{option} must be one of {', '.join(values)}, got {value!r}")
            chosen[option] = value
        named = scheme if scheme is not None else mesh.scheme
        rules = cls(tables.find_scheme("catmull-clark" if named is None else named), **chosen)
        _check_faces(mesh, rules.scheme)
        if not rules.scheme.has_creases:
            _check_smooth(mesh, rules)
        if rules.triangles == "smooth" and rules.scheme.smooth_triangle is None:
            raise ValueError(f'scheme {rules.scheme.name!r} has no triangle rule "smooth"')
        return rules

    def loose_vertices(self, mesh: Mesh) -> Array:
        """Vertices that have no limit: on untagged boundaries under "none", (n_vertices,) bool."""
        result = np.zeros(mesh.n_vertices, dtype=bool)
        if self.boundary == "none" and not self.scheme.local:
            loose = mesh.boundary_edge.copy()
            edges, sharpness = mesh.creases
            loose[mesh.edge_numbers(edges[tables.is_infinite(sharpness)])] = False
            result[mesh.edges[loose]] = True
        return result

    def without_limit(self, mesh: Mesh) -> Array:
        """Faces that are holes, tagged or by boundary "none", (n_faces,) bool."""
        result = np.zeros(mesh.n_faces, dtype=bool)
        result[mesh.holes] = True
        if self.boundary == "none" and not self.scheme.lattice.dual:  # there it is but parts
            result[mesh.corner_face[self.loose_vertices(mesh)[mesh.indices]]] = True
        return result


def _check_faces(mesh: Mesh, scheme: Scheme) -> None:
    """Refuse faces for which a scheme has no rule: others than regular ones get no face points."""
    size, name = scheme.lattice.face_size, scheme.lattice.name
    if scheme.lattice.face_points:
        return

    def wrong(face: int) -> tuple[Any, ...]:
        corners = f"scheme {scheme.name!r} is of {name}: face {face} has {mesh.sizes[face]} corners"
        return f"{corners}, need {size}; cut it into {name}, or take another scheme", ("face", face)

    checks.check(mesh.sizes != size, wrong)


def _check_smooth(mesh: Mesh, rules: Rules) -> None:
    """Refuse what is sharp under a scheme that has no rule for it."""
    name = rules.scheme.name
    advice = 'leave the tags out, or take another scheme, such as "catmull-clark"'
    if rules.creasing != "uniform":
        raise ValueError(
            f"scheme {name!r} has no creases: leave out creasing={rules.creasing!r}, or take "
            'another scheme, such as "catmull-clark"'
        )
    (edges, creases), (vertices, corners) = mesh.creases, mesh.corners

    def sharp_edge(row: int) -> tuple[Any, ...]:
        a, b = edges[row].tolist()
        text = f"scheme {name!r} has no rule for creases: edge ({a}, {b}) has sharpness"
        return f"{text} {creases[row]}; {advice}", ("crease", (a, b))

    def sharp_vertex(row: int) -> tuple[Any, ...]:
        text = f"scheme {name!r} has no rule for corners: vertex {vertices[row]} has sharpness"
        return f"{text} {corners[row]}; {advice}", ("corner", int(vertices[row]))

    checks.check(np.asarray(creases > 0, dtype=bool), sharp_edge)
    checks.check(np.asarray(corners > 0, dtype=bool), sharp_vertex)
