"""Parts of a cage that hang together, of which some are refined."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.mesh import CHOICES, Mesh
from limitsurf.cage.selection import selected
from limitsurf.refine import refined

Array = NDArray[Any]


class Parts:
    """The parts of a cage that share no vertex.

    Attributes
    ----------
    of_face : (n_faces,) int
        Numbers of parts, in the order of their first faces.
    """

    def __init__(self, mesh: Mesh) -> None:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        n = mesh.n_vertices
        pairs = mesh.corner_face + n, mesh.indices
        graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(n + mesh.n_faces,) * 2)
        _, label = connected_components(graph, directed=False)
        _, first, number = np.unique(label[n:], return_index=True, return_inverse=True)
        rank = np.empty(len(first), dtype=np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        self.mesh, self.of_face = mesh, rank[number.reshape(-1)]

    def __len__(self) -> int:
        return int(self.of_face.max()) + 1

    def refined(self, which: Array, rules: dict[str, Any]) -> Mesh:
        """A cage of the same surface in which some parts (k,) bool are refined once.

        Where not all of them are, those that are come first, and vertices of no face are left out.
        """
        here = which[self.of_face]
        chosen = self.mesh if here.all() else selected(self.mesh, here)
        own = {name: getattr(self.mesh, name) for name in CHOICES}
        finer: Mesh = refined(chosen, 1, **rules).with_tags(**own)
        return finer if here.all() else joined(finer, selected(self.mesh, ~here))


def joined(first: Mesh, second: Mesh) -> Mesh:
    """Both cages as one: vertices and faces of the first, then those of the second."""
    n, m = first.n_vertices, first.n_faces
    channels = {}
    for name, (values, rows, how) in first.channels.items():
        more, further, _ = second.channels[name]
        both = np.concatenate([values, more]), np.concatenate([rows, further + len(values)])
        channels[name] = (*both, how)
    data = {
        name: np.concatenate([values, second.face_data[name]])
        for name, values in first.face_data.items()
    }
    tags = (
        (np.concatenate([getattr(first, name)[0], getattr(second, name)[0] + n]),
         np.concatenate([getattr(first, name)[1], getattr(second, name)[1]]))
        for name in ("creases", "corners")
    )  # fmt: skip
    creases, corners = tags
    return Mesh(
        np.concatenate([first.points, second.points]),
        (
            np.concatenate([first.sizes, second.sizes]),
            np.concatenate([first.indices, second.indices + n]),
        ),
        creases=creases,
        corners=corners,
        holes=np.concatenate([first.holes, second.holes + m]),
        channels=channels,
        face_data=data,
        **{name: getattr(first, name) for name in CHOICES},
    )
