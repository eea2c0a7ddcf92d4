"""What answers depend on besides the points, where a scheme has no polynomial pieces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage import checks
from limitsurf.cage.mesh import Mesh
from limitsurf.engine.topology import Topology
from limitsurf.rules import Rules
from limitsurf.topology import LimitFaces

Array = NDArray[Any]


class StepwiseTopology(Topology):
    """A cage and its rules, for those who evaluate by steps; it refuses to hand out pieces.

    Attributes
    ----------
    mesh : Mesh
        The cage with points of no channels.
    lattice : Lattice
    limit_faces : LimitFaces
    """

    def __init__(self, mesh: Mesh, rules: Rules, choice: str) -> None:
        self.rules, self.lattice, self.choice = rules, rules.scheme.lattice, choice
        self.limit_faces = LimitFaces.of(mesh, self.lattice)
        self.mesh = mesh.with_points(np.zeros((mesh.n_vertices, 0)))
        checks.distinct_corners(mesh.connectivity, rules.scheme.name)
        self._kept: dict[str, Any] = {}
        self._with_limit = ~rules.without_limit(mesh)[self.limit_faces.face]

    def kept(self, name: str, make: Callable[[], Any]) -> Any:
        """What answers depend on besides the points, made when it is first asked for."""
        if name not in self._kept:
            self._kept[name] = make()
        return self._kept[name]

    @property
    def patches(self) -> Any:  # type: ignore[override]
        """There are none: a ValueError that says what there is."""
        return self.rules.scheme.spline

    groups = exact_groups = packing = patches

    @property
    def with_limit(self) -> Array:
        """Which limit faces have a limit, (n_limit_faces,) bool."""
        return self._with_limit

    def prepare(self) -> None:
        """There are no spectra to be looked at first."""

    @property
    def shape(self) -> str | None:
        """There are no compiled kernels of pieces; steps have some, which the engines choose."""
        return None
