"""Evaluation under schemes that keep vertices."""

from __future__ import annotations

from limitsurf.cage.mesh import Mesh
from limitsurf.engine.stepwise import StepwiseTopology


class Interpolating:
    """The engine for the points of `mesh`."""

    def __init__(self, topology: StepwiseTopology, mesh: Mesh, exact: bool) -> None:
        self._topology, self._mesh, self._exact = topology, mesh, exact
