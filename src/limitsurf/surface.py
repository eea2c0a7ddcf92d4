"""The limit surface: weights times points, at any (face, u, v)."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import _kernels, html, lazy, numbers
from limitsurf.cage.checks import checked_integer
from limitsurf.cage.mesh import Boundary, Creasing, Mesh, Triangles
from limitsurf.channels import ChannelMesh
from limitsurf.engine.choice import Answers, Choice, chosen, topology_of
from limitsurf.engine.orders import checked_order, checked_orders, orders_up_to
from limitsurf.engine.protocol import Engine, Order, Request
from limitsurf.engine.results import arrays_of, by_order, written
from limitsurf.engine.topology import Topology
from limitsurf.numbers import Exact, Numbers, Plain
from limitsurf.patches import PatchTable
from limitsurf.refine import ExactOperator, on_one_pattern, over_values
from limitsurf.rules import Rules
from limitsurf.topology import LimitFaces

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]
Fractions: TypeAlias = NDArray[np.object_]

_POSITION: tuple[Order] = ((0, 0),)


class Curvature(NamedTuple):
    """What `LimitSurface.curvature` returns; fields and their shapes are described there.

    Examples
    --------
    >>> import limitsurf as ls
    >>> flat = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> ls.LimitSurface(flat).curvature(0, 0.5, 0.5)._fields
    ('k1', 'k2', 'd1', 'd2', 'mean', 'gaussian')
    """

    k1: Floats
    k2: Floats
    d1: Floats
    d2: Floats
    mean: Floats
    gaussian: Floats


class LimitSurface:
    """The limit surface of a control cage, evaluated exactly at any (face, u, v).

    Parameters
    ----------
    mesh : Mesh
        The cage; points of shape (n_vertices, ...), any number of channels.
    scheme : str or Scheme, optional
        "catmull-clark", "loop" or another of `schemes`, or one of your own; the argument, else the
        mesh's, else the first of these.
    boundary : {"edge_and_corner", "edge_only", "none"}, optional
        Boundary vertices follow the boundary curve, those of a single face stay fixed (default);
        all follow the curve; or faces at a boundary have no limit.
    creasing : {"uniform", "chaikin"}, optional
        Sharpness falls by 1 with each refinement (default), or is averaged along creases as well.
    triangles : {"catmull-clark", "smooth"}, optional
        Edges of triangles are like others (default), or have a smoother mask.
    engine : {"auto", "reference", "compiled"}, optional
        Who answers in float64: compiled kernels once they are loaded and NumPy until then ("auto";
        last digits may change then, once in a process), NumPy alone, or kernels, which are compiled
        at once where they must be, but for what they do not know: weights of derivatives beyond
        the second, directions and curvature in doubt, and points beyond 2^1000 or all below
        2^-900. The argument, else the environment variable ``LIMITSURF_ENGINE``, else "auto". Equal
        calls get the same digits of either that is chosen; kernels also give a query the same
        whatever else is in the call, but where parameters broadcast over faces, as NumPy, whose
        last digits may depend on it, does not.

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
        For an unknown option, engine or scheme.

    Notes
    -----
    **Parameters.** On a quad, corner 0 is at (u, v) = (0, 0), corner 1 at (1, 0), corner 2 at
    (1, 1), corner 3 at (0, 1). Limit face k of an n-gon has its corner k at (0, 0), the midpoints
    of the edges to the next and to the previous corner at (1, 0) and (0, 1), its centre at (1, 1).
    In schemes of triangles each is one limit face, with its corners at (0, 0), (1, 0) and (0, 1):
    there u, v >= 0 and u + v <= 1, where up to 8.9e-16 more counts as rounding.

    **Derivatives** are with respect to (u, v) of the limit face; beyond float64's range they are
    +-inf. At a vertex itself they are 0 where they vanish towards it and NaN where they have no
    limit. Along sharp edges, which are cubic B-splines, they have one, from the face's own side.

    **Vertices.** Every vertex has a limit position. What else it has depends on the faces around
    it, up to the next infinitely sharp edge on either side, and on three eigenvalues: l1 and l2 of
    the tangent plane, l3 the next. After n halvings of the distance first derivatives are of the
    order of (2 l1)^n, second ones of (4 l1)^n, or of (4 l3)^n if l1 = 1/2, the curvature of
    (l3 / l2^2)^n, and normals are (l3 / l2)^n from their limit, or 1 / n if these are equal. In
    Catmull-Clark's scheme that is:

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
    one of all these in ceil(sharpness) refinements. Powers of n beside others are left out. In any
    scheme `eigenbasis` tells the same of each kind: ``ls.eigenbasis("loop", kind="crease",
    faces=3)`` has these factors as ``growth``, and ``has_tangent_plane``.

    **Without pieces.** The butterfly schemes go through the points of the cage, and have no
    polynomial pieces: first derivatives are all that there are, those of higher order are NaN,
    exact numbers go in at dyadic u and v, and `curvature` is a ValueError, as is whatever else
    needs pieces. At extraordinary vertices first derivatives are 0 or NaN
    (``derivations/butterfly.py``).

    **NaN** is returned for NaN or infinite u or v, where face, u or v is masked (``numpy.ma``), on
    faces without a limit, and where a value does not exist; nowhere else.

    **Many queries** are answered by compiled kernels, in as many threads as `workers` says. They
    are loaded when NumPy has spent as much time as that takes, compiled in the background if need
    be (`precompile` does both at once, `engine` chooses one of both). Both are equally accurate;
    last digits may differ. Any integers and real numbers do, also strided, read-only and
    memory-mapped ones; float32 counts as the float64 that it is. Queries that broadcast all
    parameters over all faces, such as faces (n, 1) and u, v (m,), are the fastest. Dask arrays of
    queries give Dask arrays, evaluated lazily; the surface goes to each process once (extra
    ``dask``).

    **Numbers.** float64 points, u and v give float64. If any of them is an object array or a
    Fraction, ints and floats count as the rationals they are, and the result is exact. It is a
    TypeError where the scheme's masks are irrational, as they can be in schemes of triangles. To a
    type checker, which cannot know that points are exact, answers at float u and v are float64.

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

    def __init__(
        self,
        mesh: Mesh,
        *,
        scheme: str | Scheme | None = None,
        boundary: Boundary | None = None,
        creasing: Creasing | None = None,
        triangles: Triangles | None = None,
        engine: Choice | None = None,
    ) -> None:
        if not isinstance(mesh, Mesh):
            how = f"; limitsurf.read({mesh!r}) is one" if isinstance(mesh, (str, PathLike)) else ""
            raise TypeError(f"a surface needs a Mesh, got {type(mesh).__name__}{how}")
        rules, choice = Rules.resolve(mesh, scheme, boundary, creasing, triangles), chosen(engine)
        topology = topology_of(mesh, rules, choice)
        topology.prepare()
        self._begin(mesh, topology, choice, {})

    def _begin(
        self, mesh: Mesh, topology: Topology, choice: Choice, channels: dict[str, LimitSurface]
    ) -> None:
        self._mesh, self._topology, self._choice = mesh, topology, choice
        self._channels = channels
        self._answers = Answers(topology, mesh, choice)
        self._exact = numbers.type_of(mesh.points).exact
        self._shape = mesh.points.shape[1:]

    def with_points(self, points: Numbers) -> LimitSurface:
        """The surface of the same cage with other points, (n_vertices, ...); nothing is rebuilt.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> surface.with_points([[0], [1], [3], [2]]).evaluate(0, 0.25, 0.5).round(12).tolist()
        [1.25]
        """
        mesh, other = self._mesh.with_points(points), object.__new__(type(self))
        other._begin(mesh, self._topology, self._choice, self._channels)
        return other

    def __getstate__(self) -> dict[str, Any]:
        # the cage and its patches; everything else is computed again where it arrives
        topology = self._topology
        patches = topology.patches if topology.rules.scheme.has_pieces else None
        known = {"mesh": self._mesh, "rules": topology.rules, "patches": patches}
        return {**known, "choice": self._choice}

    def __setstate__(self, state: dict[str, Any]) -> None:
        topology = topology_of(state["mesh"], state["rules"], state["choice"], state["patches"])
        self._begin(state["mesh"], topology, state["choice"], {})

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
            values = ChannelMesh.of(self.mesh, channel, self._topology.rules)
            self._channels[channel] = LimitSurface(
                values, **vars(values.rules), engine=self._choice
            )
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
    def topology(self) -> Topology:
        """What answers depend on besides the points; surfaces with other points share it."""
        return self._topology

    @property
    def patches(self) -> PatchTable:
        """The patches that the surface is made of."""
        return self._topology.patches

    @property
    def limit_faces(self) -> LimitFaces:
        """Numbering of the limit faces."""
        return self._topology.limit_faces

    @property
    def engine(self) -> Choice:
        """Which implementation answers: "auto", "reference" or "compiled"."""
        return self._choice

    @property
    def rules(self) -> dict[str, Any]:
        """Scheme and options in force, as keyword arguments of `refined`."""
        return vars(self._topology.rules).copy()

    def __repr__(self) -> str:
        return (
            f"<LimitSurface of {len(self.limit_faces)} limit faces over {self.mesh.n_vertices} "
            f"vertices, {self._topology.rules.scheme.name}>"
        )

    def _repr_html_(self) -> str:
        known = {"limit faces": len(self.limit_faces), "vertices": self.mesh.n_vertices}
        rules = {name: getattr(rule, "name", rule) for name, rule in self.rules.items()}
        channels = ", ".join(self.mesh.channels)
        return html.facts(type(self).__name__, {**known, **rules, "channels": channels})

    # ------------------------------------------------------------------ public evaluation

    @overload
    def evaluate(  # type: ignore[overload-overlap]  # an empty list is of either: floats
        self, face: ArrayLike, u: Plain, v: Plain, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ..., out: Floats | None = ...,
    ) -> Floats: ...  # fmt: skip
    @overload
    def evaluate(
        self, face: ArrayLike, u: Exact, v: Numbers, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> Fractions: ...  # fmt: skip
    @overload
    def evaluate(
        self, face: ArrayLike, u: Numbers, v: Exact, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> Fractions: ...  # fmt: skip
    @overload
    def evaluate(
        self, face: ArrayLike, u: Numbers, v: Numbers, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ..., out: Floats | None = ...,
    ) -> Array: ...  # fmt: skip
    def evaluate(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        *,
        nu: Order = _POSITION[0],
        channel: str | None = None,
        workers: int = 1,
        out: Floats | None = None,
    ) -> Any:
        """Positions on the limit surface, or derivatives of any order.

        Parameters
        ----------
        face : array_like of int
            Limit faces, 0 to ``len(limit_faces) - 1``.
        u, v : array_like
            Parameters in [0, 1]; in triangles u + v <= 1, where up to 8.9e-16 beyond is rounding.
        nu : (int, int)
            Order of the derivative in u and in v.
        channel : str, optional
            A face-varying channel of the mesh, to evaluate instead of the points: each face gets
            the values of its own side of a seam.
        workers : int
            Threads among which many queries are divided, -1 for one to each processor; results
            are the same for any number.
        out : ndarray, optional
            An array of float64, of the shape of the result, to write the result to: in loops over
            many queries this saves the time that the system takes to find memory, most so if it is
            contiguous. It may share memory with u and v; after an error its values are undefined.

        Returns
        -------
        ndarray
            `out`, or a new array, of shape ``broadcast(face, u, v).shape + points.shape[1:]``; with
            `channel`, of its values instead of the points. float64, or Fractions if u, v or the
            points are exact, which of points a type checker cannot know. See the class for the
            scaling of derivatives, and for NaN and infinity.

        Raises
        ------
        IndexError
            For a face out of range.
        ValueError
            For finite u or v outside the limit face, an order that is not two integers >= 0, a
            channel that the mesh does not have, or an `out` of another shape, or read-only.
        TypeError
            For exact numbers where the scheme's masks are irrational; for an `out` that is no array
            of float64, and for any `out` if numbers are exact or queries are Dask arrays.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 2], [0, 2]], [[0, 1, 2, 3]]))
        >>> surface.evaluate(0, 0.5, [0.25, 0.75]).round(12).tolist()
        [[0.5, 0.5], [0.5, 1.5]]
        >>> surface.evaluate(0, 0.5, 0.5, nu=(0, 1)).round(12).tolist()
        [0.0, 2.0]

        Memory that is used again and again:

        >>> import numpy as np
        >>> points = np.empty((3, 2))
        >>> for v in (0.25, 0.75):
        ...     same = surface.evaluate(0, [0, 0.5, 1], v, out=points)
        ...     print(same is points, points[:, 1].round(12).tolist())
        True [0.5, 0.5, 0.5]
        True [1.5, 1.5, 1.5]
        """
        orders = _POSITION if nu is _POSITION[0] else (checked_order(nu),)
        if channel is None and out is None and not self._exact:
            known = self._answers.one(face, u, v, orders, workers)
            if known is not None:
                return known[0].reshape(self._shape)[()]
        if lazy.is_lazy(face, u, v):
            options = {"nu": nu, "channel": channel, "workers": workers}
            return lazy.mapped(self, "evaluate", face, u, v, out=out, **options)
        if channel is not None:
            own = self.of_channel(channel)
            return own.evaluate(face, u, v, nu=nu, workers=workers, out=out)
        request = Request.of(face, u, v, self._exact, workers)
        engine, shape = self._answers.engine(request, orders), request.face.shape + self._shape
        if out is None:
            (found,) = engine.derivatives(request, orders)
            return found.reshape(shape)[()]
        written({"out": out}, shape, request, lambda r, to: engine.derivatives(r, orders, to))
        return out

    @overload
    def jet(  # type: ignore[overload-overlap]
        self, face: ArrayLike, u: Plain, v: Plain, *, order: int = ...,
        channel: str | None = ..., workers: int = ..., out: dict[Order, Floats] | None = ...,
    ) -> dict[Order, Floats]: ...  # fmt: skip
    @overload
    def jet(
        self, face: ArrayLike, u: Exact, v: Numbers, *, order: int = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> dict[Order, Fractions]: ...  # fmt: skip
    @overload
    def jet(
        self, face: ArrayLike, u: Numbers, v: Exact, *, order: int = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> dict[Order, Fractions]: ...  # fmt: skip
    @overload
    def jet(
        self, face: ArrayLike, u: Numbers, v: Numbers, *, order: int = ...,
        channel: str | None = ..., workers: int = ..., out: dict[Order, Floats] | None = ...,
    ) -> dict[Order, Array]: ...  # fmt: skip
    def jet(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        *,
        order: int = 2,
        channel: str | None = None,
        workers: int = 1,
        out: dict[Order, Floats] | None = None,
    ) -> Any:
        """All derivatives up to a total order in one pass, as {(i, j): array}.

        Arguments, shapes and errors are those of `evaluate`; (0, 0) is the position. Derivatives
        beyond the third in u or in v, in triangles beyond the fourth order, are 0 where there are
        any, so that no more than order 6 says anything; orders above 139, of more than 10,000
        derivatives, are refused. `out` is a dict of arrays for all of them, such as an earlier
        answer: its arrays lie side by side, which is the fastest.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> {nu: round(float(x[0]), 12) for nu, x in surface.jet(0, 0.25, 0.0, order=1).items()}
        {(0, 0): 0.25, (1, 0): 1.0, (0, 1): 0.0}
        """
        orders, within = orders_up_to(checked_integer("order", order, 0))
        if channel is None and out is None and not self._exact:
            known = self._answers.one(face, u, v, within, workers)
            if known is not None:
                return by_order(orders, known, self._shape)
        if lazy.is_lazy(face, u, v):
            options = {"order": order, "channel": channel, "workers": workers}
            return lazy.mapped(self, "jet", face, u, v, out=out, **options)
        if channel is not None:
            own = self.of_channel(channel)
            return own.jet(face, u, v, order=order, workers=workers, out=out)
        request = Request.of(face, u, v, self._exact, workers)
        engine, shape = self._answers.engine(request, within), request.face.shape + self._shape
        if out is None:
            return by_order(orders, engine.derivatives(request, within), shape)
        arrays = arrays_of(out, orders)
        written(arrays, shape, request, lambda r, to: engine.derivatives(r, within, to))
        return out

    def tangents(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        *,
        channel: str | None = None,
        workers: int = 1,
    ) -> tuple[Floats, Floats]:
        """Unit directions of d/du and d/dv, along the last axis of the points.

        At a special vertex they are the limits along the face's own two edges, also where there is
        no limit normal; in triangles, of what is along the third edge, that on the line between
        these two. On a sharp edge they are those of its curve. At a boundary or crease vertex of
        one face they are opposite. NaN where a derivative vanishes otherwise, up to rounding
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
            options = {"channel": channel, "workers": workers}
            both: tuple[Any, Any] = lazy.mapped(self, "tangents", face, u, v, **options)
            return both
        if channel is not None:
            return self.of_channel(channel).tangents(face, u, v, workers=workers)
        request, engine = self._inexact(face, u, v, workers, "tangents")
        width = self._shape[-1] if self._shape else 1
        shape = request.face.shape + self._shape
        along, across = engine.tangents(request, width)
        return along.reshape(shape), across.reshape(shape)

    def normal(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        *,
        workers: int = 1,
        channel: str | None = None,
        out: Floats | None = None,
    ) -> Floats:
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

        Arguments and errors are those of `evaluate`; the points, or the values of `channel`, must
        have shape (n, 3).

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
        if channel is not None:
            return self.of_channel(channel).normal(face, u, v, workers=workers, out=out)
        self._in_space("a normal")
        if out is None and not self._exact:
            known = self._answers.one(face, u, v, None, workers)
            if known is not None:
                return known[0].reshape(3)
        if lazy.is_lazy(face, u, v):
            lazily: Floats = lazy.mapped(self, "normal", face, u, v, out=out, workers=workers)
            return lazily
        request, engine = self._inexact(face, u, v, workers, "normal")
        shape = (*request.face.shape, 3)
        if out is None:
            return engine.normals(request).reshape(shape)
        written({"out": out}, shape, request, lambda r, to: engine.normals(r, out=to[0]))
        return out

    def curvature(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        *,
        workers: int = 1,
        channel: str | None = None,
    ) -> Curvature:
        """Principal, mean and Gaussian curvatures, and principal directions.

        A principal curvature is positive where the surface bends towards its `normal`: a sphere of
        radius r with normals outwards has -1 / r. The scale of a special corner is taken out before
        anything is added up, so that they are as precise next to a vertex as elsewhere: within some
        1e-12 of the larger one's size, as long as the points say what it is.

        Arguments and errors are those of `normal`. The unit is 1 / that of the points. Queries next
        to or at a special vertex where what bends the surface is near rounding errors take some
        microseconds each: kernels leave them to NumPy.

        Returns
        -------
        Curvature
            `k1` >= `k2`, of the shape of the query; their directions `d1`, `d2`, unit vectors in
            the tangent plane, (..., 3), with d1 x d2 the normal; `mean`, (k1 + k2) / 2, and
            `gaussian`, k1 k2. Where k1 = k2 the directions are some of all. Curvatures are +-inf
            beyond float64's range. What is flat within rounding errors is 0. NaN where these errors
            outweigh what bends the surface (beside an edge that is a point), where derivatives are
            dependent, and at vertices where they have no limit: in general all but those of smooth
            valence 4 and 3, where they tend to 0 and directions are NaN. `LimitSurface` has the
            table.

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
        if channel is not None:
            return self.of_channel(channel).curvature(face, u, v, workers=workers)
        self._in_space("a curvature")
        if lazy.is_lazy(face, u, v):
            found = lazy.mapped(self, "_curvatures", face, u, v, workers=workers)
        else:
            found = self._curvatures(face, u, v, workers)
        k1, k2, mean, gaussian = (found[..., k][()] for k in range(4))
        return Curvature(k1, k2, found[..., 4:7], found[..., 7:], mean, gaussian)

    def _curvatures(self, face: ArrayLike, u: Numbers, v: Numbers, workers: int) -> Array:
        """Both principal, mean and Gaussian curvature, and both directions, (..., 10)."""
        request, engine = self._inexact(face, u, v, workers, "curvature")
        found = engine.curvatures(request)
        return found.reshape(*request.face.shape, 10)

    @overload
    def weights(
        self, face: ArrayLike, u: Plain, v: Plain, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> csr_array[Any]: ...  # fmt: skip
    @overload
    def weights(
        self, face: ArrayLike, u: Exact, v: Numbers, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> ExactOperator: ...  # fmt: skip
    @overload
    def weights(
        self, face: ArrayLike, u: Numbers, v: Exact, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> ExactOperator: ...  # fmt: skip
    @overload
    def weights(
        self, face: ArrayLike, u: Numbers, v: Numbers, *, nu: Order = ...,
        channel: str | None = ..., workers: int = ...,
    ) -> csr_array[Any] | ExactOperator: ...  # fmt: skip
    @overload
    def weights(
        self, face: ArrayLike, u: Plain, v: Plain, *, nu: Sequence[Order],
        channel: str | None = ..., workers: int = ...,
    ) -> list[csr_array[Any]]: ...  # fmt: skip
    @overload
    def weights(
        self, face: ArrayLike, u: Exact, v: Numbers, *, nu: Sequence[Order],
        channel: str | None = ..., workers: int = ...,
    ) -> list[ExactOperator]: ...  # fmt: skip
    @overload
    def weights(
        self, face: ArrayLike, u: Numbers, v: Exact, *, nu: Sequence[Order],
        channel: str | None = ..., workers: int = ...,
    ) -> list[ExactOperator]: ...  # fmt: skip
    @overload
    def weights(
        self, face: ArrayLike, u: Numbers, v: Numbers, *, nu: Sequence[Order],
        channel: str | None = ..., workers: int = ...,
    ) -> list[Any]: ...  # fmt: skip
    def weights(
        self,
        face: ArrayLike,
        u: Numbers,
        v: Numbers,
        *,
        nu: Order | Sequence[Order] = (0, 0),
        workers: int = 1,
        channel: str | None = None,
    ) -> Any:
        """Sparse matrix that maps control points to positions or derivatives, or several of them.

        Parameters
        ----------
        face, u, v, workers, channel
            As for `evaluate`; the rows are the queries in C order of their broadcast shape. With
            `channel` columns are its values, ``mesh.channels[channel][0]``, instead of the points.
        nu : (int, int) or sequence of (int, int)
            Order of the derivative in u and in v; or several orders, at little more than the cost
            of one.

        Returns
        -------
        csr_array or ExactOperator, or a list of them
            Shape (n_queries, n_vertices), or as many columns as the channel has values; indices
            sorted; an `ExactOperator` if u, v or the points are exact. Where `evaluate` gives NaN
            the row has a NaN; derivatives beyond float64's range have infinite weights. Far from
            the origin `evaluate` is more accurate than the product: it forms differences of nearby
            points first.

            For several orders a list, in their order, on one pattern: entries are at the same
            places, zeros where only another order has any, and the arrays that say where, `indptr`
            and `indices` (or `rows` and `columns`), are shared. Copy a matrix before its pattern is
            changed in place, as by ``eliminate_zeros``.

            If face, u or v is a Dask array, Dask arrays of blocks that are csr_arrays, one for each
            chunk of queries: they compute to a csr_array, and ``map_blocks`` works on each.

        Raises
        ------
        IndexError, ValueError, TypeError
            As `evaluate` does; a TypeError for exact numbers in Dask arrays.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> abs(surface.weights(0, 0.25, [0.0, 0.5])).toarray().round(12).tolist()
        [[0.75, 0.25, 0.0, 0.0], [0.375, 0.125, 0.125, 0.375]]
        >>> P, du, dv = surface.weights(0, 0.5, 0.5, nu=[(0, 0), (1, 0), (0, 1)])
        >>> P.indices is du.indices, du.toarray().round(12).tolist()
        (True, [[-0.5, 0.5, 0.5, -0.5]])
        """
        several, orders = checked_orders(nu)
        if lazy.is_lazy(face, u, v):
            options = {"channel": channel, "workers": workers}
            rows = lazy.matrices(self, face, u, v, orders, **options)
            return rows if several else rows[0]
        if channel is None:
            request = Request.of(face, u, v, self._exact, workers)
            engine = self._answers.engine(request, orders, _kernels.WEIGHTS)
            found = engine.weights(request, orders)
        else:
            own, values = self.of_channel(channel), self.mesh.channels[channel]
            rows = own.weights(face, u, v, nu=orders, workers=workers)
            found = on_one_pattern([over_values(one, own.mesh, values) for one in rows])
        return found if several else found[0]

    def _inexact(
        self, face: ArrayLike, u: Numbers, v: Numbers, workers: int, what: str
    ) -> tuple[Request, Engine]:
        """A request whose answers need square roots, and who gives these."""
        request = Request.of(face, u, v, self._exact, workers)
        if request.exact:
            request.check(len(self.limit_faces), self._topology.lattice)
            raise TypeError(
                f"{what} needs square roots, which exact numbers do not have: give float64 ones, "
                "with points of float64"
            )
        part = "" if what == "normal" else _kernels.CURVATURE
        return request, self._answers.engine(request, part=part)

    def _in_space(self, what: str) -> None:
        """Complain of points that are not of shape (n, 3)."""
        if self._shape != (3,):
            raise ValueError(f"{what} needs points of shape (n, 3), got {self.points.shape}")
