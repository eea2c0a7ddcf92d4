"""How far solutions are from solving their equation, face by face: where to refine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.engine.packing import over_chunks
from limitsurf.engine.protocol import threads
from limitsurf.fem import forms
from limitsurf.fem.space import Space

Array = NDArray[Any]


def element_residuals(
    space: Space,
    coefficients: ArrayLike,
    f: Callable[[Array, Array], ArrayLike],
    *,
    reaction: float = 0.0,
    workers: int = 1,
) -> NDArray[np.float64]:
    """An indicator of the error of a solution of ``c u - Laplace u = f``, for each limit face.

    Functions have one tangent plane across edges, so that gradients have no jumps: what is left of
    the equation within faces says it all.

    Parameters
    ----------
    space : Space
    coefficients : (n,) array_like
        Of u.
    f : callable
        As for `Space.interpolate`, one number for each point.
    reaction : float
        c, of the unit 1 / length^2.
    workers : int
        Threads, as for `LimitSurface.evaluate`; `f` may be called in several at once.

    Returns
    -------
    array, (n_limit_faces,)
        ``h |c u - Laplace u - f|``, the norm that of L2 on a limit face of ``space.surface``, h the
        square root of its area; 0 without a limit. The square root of the sum of squares is the
        error in H1 (its seminorm) up to a factor, where boundary conditions are natural.

    Raises
    ------
    TypeError, ValueError
        For what is no space, coefficients or values of `f` of other shapes, a reaction that is not
        finite, and schemes whose functions have edges.

    Notes
    -----
    Verfürth, *A Posteriori Error Estimation Techniques for Finite Element Methods*, 2013,
    section 1.4; ``derivations/elements.py``, 5. Feed it to `Space.finer`, or add up its squares for
    faces of the cage by ``space.parents``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> space = ls.Space(ls.LimitSurface(square), levels=1)
    >>> x2 = space.project(lambda points, normals: points[:, 0] ** 2)
    >>> there = space.surface.patches.with_limit
    >>> off = ls.element_residuals(space, x2, lambda points, normals: 0 * points[:, 0])
    >>> off[there].round(9).tolist()  # h * 2 * h, where h = 0.5
    [0.5, 0.5, 0.5, 0.5]
    """
    if not isinstance(space, Space):
        raise TypeError(f"element_residuals needs a Space, got {type(space).__name__}")
    scheme = space.surface.topology.rules.scheme
    if scheme.local:
        raise ValueError(
            "element_residuals needs functions with one tangent plane across edges, which those of "
            f"scheme {scheme.name!r} have not"
        )
    given = space.checked_coefficients(coefficients)
    if given.ndim != 1:
        raise ValueError(f"coefficients must be of shape ({space.n},), got {given.shape}")
    if not np.isfinite(reaction):
        raise ValueError(f"reaction must be finite, got {reaction}")
    own = given if space.grading is None else space.extraction @ given
    basis, points = space.chosen(None, 2, "curvature"), space.surface.points

    def work(part: slice) -> tuple[Array, Array]:
        block = basis.blocks[part.start]
        at = forms.components(basis, block, points, basis.orders)
        x, normal = (np.stack([z.ravel() for z in y], axis=1) for y in (at.jet[0, 0], at.cross))
        values, shape = forms.given(f, x, normal / at.area.reshape(-1, 1))
        if shape != ():
            raise ValueError(f"f must give one number for each point, got arrays of shape {shape}")
        local, made = own[block.controls], block.values()
        off = values.reshape(at.area.shape)
        laplacian = {nu: c / at.unit / at.unit for nu, c in at.laplacian().items()}
        for nu, c in {(0, 0): -reaction, **laplacian}.items():
            off = off + c * np.einsum("fpc,fc->fp", made[nu], local)
        squares = np.maximum((off * off * at.measure).sum(axis=1), 0)
        return block.face, np.sqrt(at.measure.sum(axis=1) * squares)

    found = np.zeros(len(space.surface.limit_faces))
    for face, values in over_chunks(len(basis.blocks), threads(workers), work, 1):
        found[face] = values
    return found
