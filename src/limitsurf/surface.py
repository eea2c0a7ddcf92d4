"""The limit surface: weights times points, at any (face, u, v)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import _kernels, lazy, tables
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.channels import ChannelMesh
from limitsurf.checks import checked_integer
from limitsurf.groups import JET, ExactValues, Group, Groups, Order, Values, curvatures
from limitsurf.masked import unmasked
from limitsurf.mesh import Mesh
from limitsurf.packing import TERMS, Packing, threads
from limitsurf.patches import PatchTable
from limitsurf.refine import ExactOperator, eliminated, refined, sparse_operator, stacked
from limitsurf.rules import Rules, Sharpness
from limitsurf.topology import LimitFaces

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf._kernels.evaluation import Points
    from limitsurf.exact.scheme import Scheme

Array = NDArray[Any]
Numbers: TypeAlias = ArrayLike | Fraction | Sequence[Fraction]

_PORTION = 1 << 20  # queries whose jets are in memory at once
_MOST = 10_000  # derivatives in a jet
# what is kept of the points
_OF_POINTS = ("_values", "_exact_values", "_packed", "_corner_normals")
# derivatives that kernels know, in the order of `jet`
_PLACES = {nu: place for place, nu in enumerate(TERMS)}


class Curvature(NamedTuple):
    """What `LimitSurface.curvature` returns; fields and their shapes are described there.

    Examples
    --------
    >>> import limitsurf as ls
    >>> flat = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.LimitSurface(flat).curvature(0, 0.5, 0.5)._fields
    ('k1', 'k2', 'd1', 'd2', 'mean', 'gaussian')
    """

    k1: Any
    k2: Any
    d1: Any
    d2: Any
    mean: Any
    gaussian: Any


class LimitSurface:
    """The limit surface of a control cage, evaluated exactly at any (face, u, v).

    Parameters
    ----------
    mesh : Mesh
        The cage; points of shape (n_vertices, ...), any number of channels.
    scheme : str or Scheme, optional
        "catmull-clark" or a scheme of your own; the argument, else the mesh's, else this default.
    boundary : {"edge_and_corner", "edge_only", "none"}, optional
        Boundary vertices follow the boundary curve, those of a single face stay fixed (default);
        all follow the curve; or faces at a boundary have no limit.
    creasing : {"uniform", "chaikin"}, optional
        Sharpness falls by 1 with each refinement (default), or is averaged along creases as well.
    triangles : {"catmull-clark", "smooth"}, optional
        Edges of triangles are like others (default), or have a smoother mask.

    Attributes
    ----------
    mesh, points
        The cage and its points.
    limit_faces : LimitFaces
        Numbering of the limit faces: a quad is one, an n-gon n consecutive ones, in order of its
        corners; fields `face`, `corner` (-1 for quads), `first`, and ``len()``.

    Raises
    ------
    ValueError
        For an unknown option or scheme.

    Notes
    -----
    **Parameters.** On a quad, corner 0 is at (u, v) = (0, 0), corner 1 at (1, 0), corner 2 at
    (1, 1), corner 3 at (0, 1). Limit face k of an n-gon has its corner k at (0, 0), the midpoints
    of the edges to the next and to the previous corner at (1, 0) and (0, 1), its centre at (1, 1).

    **Derivatives** are with respect to (u, v) of the limit face; beyond float64's range they are
    +-inf. At a vertex itself they are 0 where they vanish towards it and NaN where they have no
    limit. Along sharp edges, which are cubic B-splines, they have one, from the face's own side.

    **Vertices.** Every vertex has a limit position. What else it has depends on the faces around
    it, up to the next infinitely sharp edge on either side, and on three eigenvalues: l1 and l2 of
    the tangent plane, l3 the next. After n halvings of the distance first derivatives are of the
    order of (2 l1)^n, second ones of (4 l1)^n, or of (4 l3)^n if l1 = 1/2, the curvature of
    (l3 / l2^2)^n, and normals are (l3 / l2)^n from their limit, or 1 / n if these are equal:

    ====================  =====  =====  =====  =========  =========  =========  ==========
    vertex                l1     l2     l3     first      second     curvature  normal
    ====================  =====  =====  =====  =========  =========  =========  ==========
    smooth, valence 2     0.250  0.250  -.250  0.50^n     bounded    4^n        none
    smooth, valence 3     0.410  0.410  0.167  0.82^n     1.64^n     0.991^n    yes
    smooth, valence 4     0.500  0.500  0.250  limit      limit      limit      yes
    smooth, valence 5     0.550  0.550  0.340  1.10^n     2.20^n     1.12^n     yes
    ... to infinity       0.655  0.655  0.655  1.31^n     2.62^n     1.53^n     yes
    crease of 1 face      0.500  0.250  0.250  bounded    n          4^n        yes, 1 / n
    crease of 2 faces     0.500  0.500  0.250  limit      limit      limit      yes
    crease of 3 faces     0.580  0.500  0.410  1.16^n     2.32^n     1.64^n     yes
    crease of 4 faces     0.611  0.500  0.500  1.22^n     2.44^n     2^n        yes, 1 / n
    crease of 5 faces     0.626  0.550  0.500  1.25^n     2.51^n     1.65^n     none
    ... to infinity       0.655  0.655  0.655  1.31^n     2.62^n     1.53^n     none
    corner of 1 face      0.500  0.500  0.250  limit      limit      limit      yes
    corner of 2 faces     0.500  0.500  0.500  n          2^n        2^n        yes, 1 / n
    corner of 3 faces     0.580  0.500  0.500  1.16^n     2.32^n     2^n        none
    ... to infinity       0.655  0.655  0.655  1.31^n     2.62^n     1.53^n     none
    dart of 2 faces       0.388  -.281  0.250  0.78^n     1.55^n     3.16^n     none
    dart of 3 faces       0.462  0.410  0.225  0.92^n     1.85^n     1.34^n     yes
    dart of 4 faces       0.500  0.500  0.320  bounded    1.28^n     1.28^n     yes
    dart of 5 faces       0.550  0.526  0.392  1.10^n     2.20^n     1.41^n     yes
    ... to infinity       0.655  0.655  0.655  1.31^n     2.62^n     1.53^n     yes
    cone of 2 faces       0.655  0.250  0.250  1.31^n     2.62^n     4^n        none
    cone of 3 faces       0.655  0.410  0.410  1.31^n     2.62^n     2.44^n     none
    ... to infinity       0.655  0.655  0.655  1.31^n     2.62^n     1.53^n     none
    ====================  =====  =====  =====  =========  =========  =========  ==========

    A dart is the end of one sharp edge, a cone a sharp vertex amid smooth faces. Other vertices on
    sharp edges (so are boundaries and non-manifold edges) have several sectors, each with a normal
    of its own: creases where there are two such edges, corners where there are more or the vertex
    is sharp; ``exact/creases.py`` tells which are. A crease of non-manifold edges can also carry a
    ring of faces that shares but the vertex with it, or faces that begin and end at one of its two
    edges: these behave as cones and corners do, without a normal. Whatever is semi-sharp becomes
    one of all these in ceil(sharpness) refinements. Powers of n beside others are left out.

    **NaN** is returned for NaN or infinite u or v, where face, u or v is masked (``numpy.ma``), on
    faces without a limit, and where a value does not exist; nowhere else.

    **Many queries**, 100,000 in a call and more, are answered by compiled kernels, in as many
    threads as `workers` says; fewer by NumPy, to spare small jobs the loading of a compiler
    (`precompile` loads it at once). Both are equally accurate; last digits may differ. Any integers
    and real numbers do, also strided, read-only and memory-mapped ones; float32 counts as the
    float64 that it is. Queries that broadcast all parameters over all faces, such as faces (n, 1)
    and u, v (m,), are the fastest. Dask arrays of queries give Dask arrays, evaluated lazily; the
    surface goes to each process once (extra ``dask``).

    **Numbers.** float64 points, u and v give float64. If any of them is an object array or a
    Fraction, ints and floats count as the rationals they are, and the result is exact.

    After Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter
    values", SIGGRAPH 1998; sharpness after DeRose, Kass and Truong, SIGGRAPH 1998. A face is cut,
    where it must be, until each piece has one special corner (``limitsurf/patches.py``). Where
    more than 64 faces meet, the ring around them is refined as deep as queries go
    (``limitsurf/rings.py``). The eigenstructure is derived in ``derivations/eigenstructure.py`` and
    ``derivations/sectors.py``, the table in ``derivations/limit_normals.py``; that it is what the
    spectra say is asserted in ``derivations/analysis.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> surface = ls.LimitSurface(ls.Mesh(points, quads))
    >>> surface
    <LimitSurface of 6 limit faces over 8 vertices, catmull-clark>
    >>> surface.evaluate([0, 1], 0.5, 0.5).shape
    (2, 3)
    """

    limit_faces: LimitFaces

    def __init__(
        self,
        mesh: Mesh,
        scheme: str | Scheme | None = None,
        boundary: str | None = None,
        creasing: str | None = None,
        triangles: str | None = None,
    ) -> None:
        if not isinstance(mesh, Mesh):
            raise TypeError(f"a surface needs a Mesh, got {type(mesh).__name__}")
        rules = Rules.resolve(mesh, scheme, boundary, creasing, triangles)
        self._rules = rules
        patches = PatchTable(mesh, rules, np.dtype(float))
        # masks that do not converge are refused here, not at the first query
        for kind, sector in enumerate(patches.sectors):
            if sector is not None and kind in patches.rings:
                tables.ring_masks(rules.scheme, sector.kind, sector.faces)
            elif sector is not None:
                tables.eigen_table(rules.scheme, sector)
        self._begin(mesh, patches)

    def _set_points(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._flat = mesh.points.reshape(mesh.n_vertices, -1)
        if self._flat.dtype == object:
            self._flat = kernels.exact(self._flat)

    def with_points(self, points: ArrayLike) -> LimitSurface:
        """The surface of the same cage with other points, (n_vertices, ...); nothing is rebuilt.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> surface.with_points([[0], [1], [3], [2]]).evaluate(0, 0.25, 0.5).round(12).tolist()
        [1.25]
        """
        other = object.__new__(type(self))
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k not in _OF_POINTS})
        other._set_points(self.mesh.with_points(points))
        return other

    def __getstate__(self) -> dict[str, Any]:
        # the cage and its patches; everything else is computed again where it arrives
        return {"_mesh": self._mesh, "_rules": self._rules, "_patches": self.patches}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._rules = state["_rules"]
        self._begin(state["_mesh"], state["_patches"])

    def _begin(self, mesh: Mesh, patches: PatchTable) -> None:
        self.limit_faces = LimitFaces.of(mesh)
        self._channels: dict[str, LimitSurface] = {}
        self._packings: dict[None, Packing] = {}
        self._groups = {False: Groups(patches, self._rules.scheme, False)}
        self._set_points(mesh)

    def of_channel(self, channel: str | None) -> LimitSurface:
        """The surface of a face-varying channel over the same limit faces; this one if it is None.

        Raises
        ------
        ValueError
            For a channel that the mesh does not have.

        Examples
        --------
        >>> import limitsurf as ls
        >>> uv = [[0, 0], [1, 0], [1, 1], [0, 1]], [0, 1, 2, 3], "corners_only"
        >>> square = ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]], channels={"uv": uv})
        >>> ls.LimitSurface(square).of_channel("uv").evaluate(0, 0.25, 0.5).round(12).tolist()
        [0.25, 0.5]
        """
        if channel is None:
            return self
        if channel not in self._channels:
            values = ChannelMesh.of(self.mesh, channel, self._rules)
            self._channels[channel] = LimitSurface(values, **vars(values.rules))
        return self._channels[channel]

    @property
    def mesh(self) -> Mesh:
        """The control cage."""
        return self._mesh

    @property
    def points(self) -> Array:
        """The points of the cage, (n_vertices, ...)."""
        return self._mesh.points

    @property
    def patches(self) -> PatchTable:
        """The patches that the surface is made of."""
        return self._groups[False].patches

    @property
    def rules(self) -> dict[str, Any]:
        """Scheme and options in force, as keyword arguments of `refined`."""
        return vars(self._rules).copy()

    def __repr__(self) -> str:
        return (
            f"<LimitSurface of {len(self.limit_faces)} limit faces over {self.mesh.n_vertices} "
            f"vertices, {self._rules.scheme.name}>"
        )

    # ------------------------------------------------------------------ public evaluation

    def evaluate(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        nu: Order = (0, 0),
        channel: str | None = None,
        workers: int = 1,
    ) -> Any:
        """Positions on the limit surface, or derivatives of any order.

        Parameters
        ----------
        face : array_like of int
            Limit faces, 0 to ``len(limit_faces) - 1``.
        u, v : array_like
            Parameters in [0, 1].
        nu : (int, int)
            Order of the derivative in u and in v.
        channel : str, optional
            A face-varying channel of the mesh, to evaluate instead of the points: each face gets
            the values of its own side of a seam.
        workers : int
            Threads among which many queries are divided, -1 for one to each processor; results
            are the same for any number.

        Returns
        -------
        ndarray
            Shape ``broadcast(face, u, v).shape + points.shape[1:]``; with `channel`, of its values
            instead of the points. See the class for the scaling of derivatives, and for NaN and
            infinity.

        Raises
        ------
        IndexError
            For a face out of range.
        ValueError
            For finite u or v outside [0, 1], an order that is not two integers >= 0, or a channel
            that the mesh does not have.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 2], [0, 2]], [[0, 1, 2, 3]]))
        >>> surface.evaluate(0, 0.5, [0.25, 0.75]).round(12).tolist()
        [[0.5, 0.5], [0.5, 1.5]]
        >>> surface.evaluate(0, 0.5, 0.5, nu=(0, 1)).round(12).tolist()
        [0.0, 2.0]
        """
        if lazy.is_lazy(face, u, v):
            options = {"nu": nu, "channel": channel, "workers": workers}
            return lazy.mapped(self, "evaluate", face, u, v, **options)
        return self.of_channel(channel)._derivatives(face, u, v, [_order(nu)], workers)[0]

    def jet(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        order: int = 2,
        channel: str | None = None,
        workers: int = 1,
    ) -> dict[Order, Any]:
        """All derivatives up to a total order in one pass, as {(i, j): array}.

        Arguments, shapes and errors are those of `evaluate`; (0, 0) is the position. Derivatives
        beyond the third in u or in v are 0 where there are any, so that no more than order 6 says
        anything; orders above 139, of more than 10,000 derivatives, are refused.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> {nu: round(float(x[0]), 12) for nu, x in surface.jet(0, 0.25, 0.0, order=1).items()}
        {(0, 0): 0.25, (1, 0): 1.0, (0, 1): 0.0}
        """
        order = checked_integer("order", order, 0)
        count = (order + 1) * (order + 2) // 2
        if count > _MOST:
            raise ValueError(
                f"a jet of order {order} has {count:,} derivatives, more than {_MOST:,}; those "
                "beyond the third in u or in v are 0: ask for order 6, which has all others, or "
                "evaluate those you need by nu="
            )
        if lazy.is_lazy(face, u, v):
            options = {"order": order, "channel": channel, "workers": workers}
            found: dict[Order, Any] = lazy.mapped(self, "jet", face, u, v, **options)
            return found
        orders = [(m - j, j) for m in range(order + 1) for j in range(m + 1)]
        within = [_order(nu) for nu in orders]
        derivatives = self.of_channel(channel)._derivatives(face, u, v, within, workers)
        return dict(zip(orders, derivatives, strict=True))

    def tangents(self, face: ArrayLike, u: Numbers, v: Numbers) -> tuple[Any, Any]:
        """Unit directions of d/du and d/dv, along the last axis of the points.

        At a special vertex they are the limits along the face's own two edges, also where there is
        no limit normal; on a sharp edge those of its curve. At a boundary or crease vertex of one
        face they are opposite. NaN where a derivative vanishes otherwise, up to rounding
        (degenerate points), and at smooth vertices of valence 2, where in general they oscillate.

        Arguments, shapes and errors are those of `evaluate`.

        Raises
        ------
        TypeError
            On exact numbers: a length needs a square root, which Fractions do not have.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 2], [0, 2]], [[0, 1, 2, 3]]))
        >>> [t.round(12).tolist() for t in surface.tangents(0, 0.5, 0.5)]
        [[1.0, 0.0], [0.0, 1.0]]
        """
        if lazy.is_lazy(face, u, v):
            both: tuple[Any, Any] = lazy.mapped(self, "tangents", face, u, v)
            return both
        *directions, shape = self._directions(face, u, v, "tangents")
        shape += self.points.shape[1:]
        width = self.points.shape[-1] if self.points.ndim > 1 else 1
        along, across = (
            kernels.unit(
                x.reshape(-1, width), np.repeat(noise, x.shape[1] // max(width, 1), axis=0)
            ).reshape(shape)
            for x, noise in directions
        )
        return along, across

    def normal(self, face: ArrayLike, u: Numbers, v: Numbers, workers: int = 1) -> Any:
        """Unit normals, along d/du x d/dv: outwards where faces are counter-clockwise from outside.

        The normal is that of its own (u, v) at every distance from a special vertex, and the limit
        at the vertex itself. On sharp edges each side has its own, that of the face asked; also
        where derivatives vanish along the edge, as at the pole of a sphere of quads, a boundary row
        of points that coincide, or a single one that its faces repeat: there the normal is its
        limit along the face, which may differ with the place on the edge.

        NaN where the derivatives might be dependent within their rounding errors, which are bounded
        by the sizes of what was added up, as on the edges of two polygons glued back to back; and
        where no limit normal exists, as it depends on the direction of approach: at boundary and
        crease vertices with 5 or more faces on that side, at corners with 3 or more between two
        sharp edges, at cones, at what a crease carries that does not bound it, and where there are
        but 2 faces around a smooth vertex or a dart. `LimitSurface` has the table,
        ``derivations/limit_normals.py`` the proofs.

        Arguments and errors are those of `evaluate`; the points must have shape (n, 3).

        Raises
        ------
        TypeError
            On exact numbers, which have no square root; ValueError on points that are not 3D.

        Examples
        --------
        >>> import limitsurf as ls
        >>> points = [[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]]
        >>> surface = ls.LimitSurface(ls.Mesh(points, [[0, 1, 2, 3]]))
        >>> surface.normal(0, 0.5, 0.5).tolist()
        [0.0, 0.0, 1.0]
        """
        self._check_space("a normal")
        if lazy.is_lazy(face, u, v):
            return lazy.mapped(self, "normal", face, u, v, workers=workers)
        face, u, v = self._inexact_queries(face, u, v, "normal")
        normals = self._regular_normals(face, u, v, workers)
        lost = np.isnan(normals[:, 0])
        if lost.any():
            self._find_limits(face.flat[lost], u.flat[lost], v.flat[lost], lost, normals)
        return normals.reshape(*face.shape, 3)

    def curvature(self, face: ArrayLike, u: Numbers, v: Numbers, workers: int = 1) -> Curvature:
        """Principal, mean and Gaussian curvatures, and principal directions.

        A principal curvature is positive where the surface bends towards its `normal`: a sphere of
        radius r with normals outwards has -1 / r. The scale of a special corner is taken out before
        anything is added up, so that they are as precise next to a vertex as elsewhere: within some
        1e-12 of the larger one's size, as long as the points say what it is.

        Arguments and errors are those of `normal`. The unit is 1 / that of the points. Patches
        with a special corner take some microseconds a query, without kernels and threads.

        Returns
        -------
        Curvature
            `k1` >= `k2`, of the shape of the query; their directions `d1`, `d2`, unit vectors in
            the tangent plane, (..., 3), with d1 x d2 the normal; `mean`, (k1 + k2) / 2, and
            `gaussian`, k1 k2. Where k1 = k2 the directions are some of all. Curvatures are +-inf
            beyond float64's range. What is flat within rounding errors is 0, exactly so in calls
            without kernels. NaN where these errors outweigh what bends the surface (beside an edge
            that is a point), where derivatives are dependent, and at vertices where they have no
            limit: in general all but those of smooth valence 4 and 3, where they tend to 0 and
            directions are NaN. `LimitSurface` has the table.

        Examples
        --------
        >>> import limitsurf as ls
        >>> trough = [[x, y, x * x] for x in range(4) for y in range(4)]
        >>> faces = [[4 * i + j, 4 * i + j + 4, 4 * i + j + 5, 4 * i + j + 1]
        ...          for i in range(3) for j in range(3)]
        >>> bent = ls.LimitSurface(ls.Mesh(trough, faces)).curvature(4, 0.5, 0.5)
        >>> at = 3 / 2  # z = x^2 there has
        >>> float((bent.k1 * (1 + 4 * at * at) ** 1.5).round(9)), abs(bent.d1).round(6).tolist()
        (2.0, [0.316228, 0.0, 0.948683])
        """
        self._check_space("a curvature")
        if lazy.is_lazy(face, u, v):
            found = lazy.mapped(self, "_curvatures", face, u, v, workers=workers)
        else:
            found = self._curvatures(face, u, v, workers)
        k1, k2, mean, gaussian = (found[..., k][()] for k in range(4))
        return Curvature(k1, k2, found[..., 4:7], found[..., 7:], mean, gaussian)

    def _curvatures(self, face: ArrayLike, u: Numbers, v: Numbers, workers: int) -> Array:
        """Both principal, mean and Gaussian curvature, and both directions, (..., 10)."""
        face, u, v = self._inexact_queries(face, u, v, "curvature")
        self._check_ranges(face, u, v, False)
        groups, compute = self._groups[False], self._values.curvatures
        if self._values.balance or not _kernels.compiled(face.size):
            (found,) = groups.answers(face, u, v, [10], compute)
            return found.reshape(*face.shape, 10)
        found, start = np.empty((face.size, 10)), 0
        # kernels' answers, but around special corners
        for part in np.array_split(found, max(1, face.size // _PORTION)):  # views
            here = slice(start, start + len(part))
            f, x, y = face.flat[here], u.flat[here], v.flat[here]
            jet = np.stack(self._derivatives(f, x, y, JET, workers))
            part[:] = curvatures(jet, self._regular_normals(f, x, y, workers))
            # and where errors may outweigh what bends the surface
            thin = kernels.nearly_dependent(*jet[:2])
            special = np.flatnonzero(groups.special(f, x, y) | thin)
            (part[special],) = groups.answers(f[special], x[special], y[special], [10], compute)
            start = here.stop
        return found.reshape(*face.shape, 10)

    def weights(
        self, face: ArrayLike, u: Numbers, v: Numbers, nu: Order = (0, 0), workers: int = 1
    ) -> csr_array[Any] | ExactOperator:
        """Sparse matrix that maps control points to positions or derivatives.

        Parameters
        ----------
        face, u, v, nu, workers
            As for `evaluate`; the rows are the queries in C order of their broadcast shape.

        Returns
        -------
        csr_array or ExactOperator
            Shape (n_queries, n_vertices), indices sorted; an `ExactOperator` if u, v or the points
            are exact. Where `evaluate` gives NaN the row has a NaN; derivatives beyond float64's
            range have infinite weights. Far from the origin `evaluate` is more accurate than the
            product: it forms differences of nearby points first.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> abs(surface.weights(0, 0.25, [0.0, 0.5])).toarray().round(12).tolist()
        [[0.75, 0.25, 0.0, 0.0], [0.375, 0.125, 0.125, 0.375]]
        """
        nu = _order(nu)
        if lazy.is_lazy(face, u, v):
            raise TypeError("weights takes no Dask arrays: ask for them chunk by chunk")
        face, u, v, exact = self._broadcast(face, u, v)
        count = threads(workers)
        if not exact and nu in _PLACES and _kernels.compiled(face.size):
            rest = self._without_rows(face, u, v)
            flat = face.ravel(), u.ravel(), v.ravel()
            known = (face, u, v) if rest is None else (x[~rest] for x in flat)
            f, x, y = known
            found: csr_array[Any] = self._packing.weights((f, x, y), _PLACES[nu], count)
            if found is not None and rest is None:
                return found
            if found is not None and rest is not None:
                f, x, y = (z[rest] for z in flat)
                both = stacked([found, self._reference_weights(f, x, y, nu, exact)])
                both = both[np.argsort(np.argsort(rest, kind="stable"), kind="stable")]
                parts = [x.astype(found.indices.dtype) for x in (both.indices, both.indptr)]
                return type(found)((both.data, *parts), shape=both.shape)
        self._check_ranges(face, u, v, exact)
        return self._reference_weights(face, u, v, nu, exact)

    def _without_rows(self, face: Array, u: Array, v: Array) -> Array | None:
        """Queries whose rows of weights only the reference can give, flat; None if there are none.

        Complains of what is out of range before it looks.
        """
        if not self._packing.without_rows.any():
            return None
        self._check_ranges(face, u, v, False)
        there = np.flatnonzero(np.isfinite(u.ravel()) & np.isfinite(v.ravel()))
        where = [x.ravel()[there] for x in (face, u, v)]
        patch, *_ = self.patches.locate(where[0].astype(np.int64), where[1], where[2])
        result = np.zeros(face.size, dtype=bool)
        result[there] = self._packing.without_rows[patch] & (patch >= 0)
        return result if result.any() else None

    def _reference_weights(
        self, face: Array, u: Array, v: Array, nu: Order, exact: bool
    ) -> csr_array[Any] | ExactOperator:
        """The same by NumPy."""
        groups = self._groups_of(exact)
        patches, dtype = groups.patches, np.dtype(object if exact else float)
        flat, parts = face.ravel(), []
        for part, undefined, pieces in groups.chunks(face, u, v):
            corner = self.mesh.offsets[self.limit_faces.face[flat[part][undefined]]]
            rows, columns = [undefined], [self.mesh.indices[corner]]
            values = [np.full(len(undefined), np.nan, dtype=dtype)]
            for g in pieces:
                ids = groups.controls(g)
                rows.append(np.repeat(g.query, ids.shape[1]))
                columns.append(ids.ravel())
                with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                    values.append(groups.weights(g, nu).ravel())
            total = sparse_operator(
                np.concatenate(rows),
                np.concatenate(columns),
                np.concatenate(values),
                (len(flat[part]), patches.n_points),
            )
            # back through the extra control points, last ones first
            for operator in reversed(patches.extras):
                total = eliminated(total, operator)
            parts.append(total)
        return stacked(parts)

    # ------------------------------------------------------------------ how it is done

    def _groups_of(self, exact: bool) -> Groups:
        if exact not in self._groups:
            patches = PatchTable(self.mesh, self._rules, np.dtype(object))
            self._groups[exact] = Groups(patches, self._rules.scheme, exact)
        return self._groups[exact]

    @cached_property
    def _values(self) -> Values:
        return Values(self._groups[False], self._flat)

    @cached_property
    def _exact_values(self) -> ExactValues:
        return ExactValues(self._groups_of(True), kernels.exact(self._flat))

    def _broadcast(
        self, face: ArrayLike, u: Numbers, v: Numbers
    ) -> tuple[Array, Array, Array, bool]:
        """Arrays of numbers of one shape; whether they are to be answered exactly."""
        (faces, us, vs), masks = zip(*map(unmasked, (face, u, v)), strict=True)
        if faces.size == 0 and faces.dtype == float:
            faces = faces.astype(np.int64)
        if faces.dtype.kind not in "iu":
            raise TypeError(f"faces must be integers, got {faces.dtype}")
        exact = object in (us.dtype, vs.dtype, self.points.dtype)
        if exact:
            us, vs = kernels.exact(us), kernels.exact(vs)
        else:
            for name, x in (("u", us), ("v", vs)):
                if x.dtype.kind not in "iuf":
                    raise TypeError(f"{name} must be real numbers, got {x.dtype}")
            us, vs = us.astype(float, copy=False), vs.astype(float, copy=False)
        try:
            faces, us, vs = np.broadcast_arrays(faces, us, vs)
        except ValueError:
            raise ValueError(
                f"face, u and v of shapes {faces.shape}, {us.shape} and {vs.shape} "
                "cannot be broadcast together"
            ) from None
        for mask in masks:
            if mask is not None:  # a query without an answer
                us = np.where(mask, np.nan, us)
        return faces, us, vs, exact

    def _check_ranges(self, faces: Array, us: Array, vs: Array, exact: bool) -> None:
        """Complain of the first face or parameter out of range."""
        n = len(self.limit_faces)
        bad = (faces < 0) | (faces >= n)
        if bad.any():
            raise IndexError(
                f"limit face {_first(faces, bad)} is out of range: there are {n}, 0 to {n - 1}"
            )
        for name, x in (("u", us), ("v", vs)):
            with np.errstate(invalid="ignore"):
                bad = ((x < 0) | (x > 1)).astype(bool)
            if not exact:
                bad &= np.isfinite(x)
            if bad.any():
                raise ValueError(f"{name} = {_first(x, bad)} is outside [0, 1]")

    def _derivatives(
        self, face: ArrayLike, u: Numbers, v: Numbers, orders: Sequence[Order], workers: int
    ) -> list[Any]:
        """The derivatives of the given orders, each of the shape that `evaluate` promises."""
        face, u, v, exact = self._broadcast(face, u, v)
        compute = self._exact_values.derivatives if exact else self._values.derivatives
        widths = [self._flat.shape[1]] * len(orders)
        results = self._answers(
            face, u, v, exact, widths, partial(compute, orders=orders), orders, workers
        )
        shape = face.shape + self.points.shape[1:]
        return [r.reshape(shape)[()] for r in results]

    def _answers(
        self,
        face: Array,
        u: Array,
        v: Array,
        exact: bool,
        widths: Sequence[int],
        compute: Callable[[Group], Sequence[Array]],
        orders: Sequence[Order] | None,
        workers: int,
    ) -> Sequence[Array]:
        """Arrays (Q, width): derivatives, or unit normals where `orders` is None.

        By compiled kernels if that pays, but for those queries that they leave to `compute`.
        """
        count = threads(workers)
        known = orders is None or all(nu in _PLACES for nu in orders)
        known = known and not exact and all(widths) and not self._values.balance
        if not known or not _kernels.compiled(face.size):
            self._check_ranges(face, u, v, exact)
            return self._groups_of(exact).answers(face, u, v, widths, compute)
        found = self._packing.evaluate(
            self._packed_points,
            (face, u, v),
            widths[0],
            None if orders is None else [_PLACES[nu] for nu in orders],
            count,
        )
        if found is None:
            self._check_ranges(face, u, v, exact)
            raise AssertionError("kernels and checks disagree about what is in range")
        results, rest = found
        if len(rest):
            some = [x.flat[rest] for x in (face, u, v)]
            parts = self._groups[False].answers(some[0], some[1], some[2], widths, compute)
            for result, part in zip(results, parts, strict=True):
                result[rest] = part
        return list(results)

    def _regular_normals(self, face: Array, u: Array, v: Array, workers: int) -> Array:
        """Normals (Q, 3) where derivatives are independent."""
        (normals,) = self._answers(face, u, v, False, [3], self._values.normals, None, workers)
        return normals

    def _find_limits(self, face: Array, u: Array, v: Array, lost: Array, normals: Array) -> None:
        """Fill in normals (Q, 3) that are `lost` at queries where they are limits all the same.

        At and beside sharp sides (boundaries are) along which derivatives vanish, and at vertices
        of sides that are points.
        """
        at = np.isfinite(u) & np.isfinite(v) & (self.patches.codes[face] != -1)
        away = np.where(self._sharp_sides[face].T, [v, 1 - u, 1 - v, u], np.inf)
        side, nearest = away.argmin(axis=0), away.min(axis=0)
        # beyond, only directions that differ by rounding are in doubt
        at &= nearest < 2.0**-10
        corner = at & ((u == 0) | (u == 1)) & ((v == 0) | (v == 1))
        found = np.full((len(face), 3), np.nan)
        if corner.any():
            which = np.where(v[corner] == 0, u[corner], 3 - u[corner]).astype(int)
            found[corner] = self._corner_normals[face[corner], which]
        here = np.flatnonzero(at & ~corner)
        face, side, nearest = face[here], side[here], nearest[here]
        u = np.choose(side, [u[here], 1.0, u[here], 0.0])
        v = np.choose(side, [0.0, v[here], 1.0, v[here]])
        groups, limits = self._groups[False], np.full((len(here), 3), np.nan)
        for part, _, pieces in groups.chunks(face, u, v, 64):
            for g in pieces:
                given = side[part][g.query], nearest[part][g.query]
                limits[part.start + g.query] = self._values.edge_normals(g, *given)
        found[here] = limits
        normals[lost] = found

    @cached_property
    def _sharp_sides(self) -> Array:
        """Whether the sides v = 0, u = 1, v = 1, u = 0 of limit faces stay sharp, (n, 4)."""
        mesh, faces = self.mesh, self.limit_faces
        sharpness = Sharpness.of(mesh, self._rules, np.dtype(float))
        sharp = np.zeros(mesh.n_corners, dtype=bool)
        sharp[sharpness.sides] = tables.is_infinite(sharpness.edge_sharpness)[sharpness.edge]
        quad = faces.corner < 0
        first = mesh.offsets[faces.face] + np.where(quad, 0, faces.corner)
        sides = np.zeros((len(faces), 4), dtype=bool)
        sides[quad] = sharp[first[quad, None] + np.arange(4)]
        # only those at the corner are on edges of an n-gon
        sides[~quad, 0] = sharp[first[~quad]]
        sides[~quad, 3] = sharp[mesh.previous_corner[first[~quad]]]
        return sides

    @cached_property
    def _corner_normals(self) -> Array:
        """Limit normals at the corners (0, 0), (1, 0), (1, 1), (0, 1) of limit faces, (n, 4, 3)."""
        quads = bool((self.mesh.sizes == 4).all())
        fine = refined(self.mesh, 0 if quads else 1, **vars(self._rules))
        normals: Array = fine.limit_normals.reshape(-1, 4, 3)
        if quads:
            return normals
        faces, sizes = self.limit_faces, self.mesh.sizes
        child = self.mesh.offsets[faces.face] + np.maximum(faces.corner, 0)
        result: Array = normals[child]
        quad = np.flatnonzero(sizes[faces.face] == 4)
        result[quad] = normals[child[quad, None] + np.arange(4), 0]
        return result

    @property
    def _packing(self) -> Packing:
        """Patches and tables as compiled kernels want them; shared by surfaces of one topology."""
        if None not in self._packings:
            with _kernels.preparing:
                if None not in self._packings:
                    strips, which = self._groups[False].strips
                    own = self.mesh.indices[self.mesh.offsets[self.limit_faces.face]]
                    made = Packing(self.patches, strips, which, self._rules.scheme, own)
                    self._packings[None] = made
        return self._packings[None]

    @property
    def _packed_points(self) -> Points:
        """Control points as compiled kernels want them."""
        if "_packed" not in self.__dict__:
            with _kernels.preparing:
                if "_packed" not in self.__dict__:
                    self.__dict__["_packed"] = self._packing.points(self._flat)
        packed: Points = self.__dict__["_packed"]
        return packed

    def _directions(self, face: ArrayLike, u: Numbers, v: Numbers, what: str) -> tuple[Any, ...]:
        """d/du and d/dv up to positive factors, each (Q, d) with its noise (Q, 1); query shape."""
        face, u, v = self._inexact_queries(face, u, v, what)
        self._check_ranges(face, u, v, False)
        d = self._flat.shape[1]
        along, across, noise, other = self._groups[False].answers(
            face, u, v, [d, d, 1, 1], self._values.directions
        )
        return (along, noise), (across, other), face.shape

    def _inexact_queries(
        self, face: ArrayLike, u: Numbers, v: Numbers, what: str
    ) -> tuple[Array, Array, Array]:
        """Broadcast a query whose answer needs square roots."""
        face, u, v, exact = self._broadcast(face, u, v)
        if exact:
            self._check_ranges(face, u, v, exact)
            raise TypeError(
                f"{what} needs square roots, which exact numbers do not have: give float64 ones, "
                "with points of float64"
            )
        return face, u, v

    def _check_space(self, what: str) -> None:
        if self.points.shape[1:] != (3,):
            raise ValueError(f"{what} needs points of shape (n, 3), got {self.points.shape}")


def precompile() -> None:
    """Compile all kernels now, or load them, and use them for calls of any size from now on.

    For services that answer many small queries: a call takes microseconds instead of milliseconds.
    The first time on a machine this takes some twenty seconds, later about one: what is compiled is
    kept in a cache directory, ``LIMITSURF_CACHE_DIR`` or else the user's, which is used only if
    nobody but the user, root and the owner of the installed package may write it.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.precompile()  # doctest: +SKIP
    """
    _kernels.always()
    points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    surface = LimitSurface(refined(Mesh(points, quads, creases={(0, 1): 1.5}), operator=True)[0])
    face, u = np.arange(len(surface.limit_faces)), np.linspace(0, 1, 5)
    for places in (0.5, u):
        surface.jet(face[:, None], places, places)
        surface.normal(face[:, None], places, places)
    surface.weights(face, 0.5, 0.5)
    fine = refined(surface.mesh)
    fine.limit_points, fine.limit_normals, fine.edges  # noqa: B018


def _order(nu: Any) -> Order:
    """Two non-negative integers; those beyond the third are alike, for pieces are bicubic."""
    order = tuple(nu) if isinstance(nu, (tuple, list, np.ndarray)) else ()
    if len(order) != 2 or not all(
        isinstance(n, (int, np.integer)) and not isinstance(n, bool) and n >= 0 for n in order
    ):
        raise ValueError(f"nu must be two integers >= 0, got {nu!r}")
    return min(int(order[0]), 4), min(int(order[1]), 4)


def _first(values: Array, bad: Array) -> str:
    """The first offending value, where it is, and how many there are."""
    place = np.unravel_index(int(np.argmax(bad)), bad.shape) if bad.ndim else ()
    where = f" at index {', '.join(map(str, place))}" if place else ""
    count = int(np.count_nonzero(bad))
    more = f" ({count - 1} more like it)" if count > 1 else ""
    return f"{values[place]}{where}{more}"
