"""The limit surface: weights times points, at any (face, u, v)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf import basis, tables
from limitsurf._kernels import reference as kernels
from limitsurf.mesh import Mesh
from limitsurf.patches import REGULAR, LimitFaces, PatchTable, irregular_boundary
from limitsurf.refine import ExactOperator, Rules, sparse_operator, stacked

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.exact.scheme import Scheme

Array = NDArray[Any]
Order: TypeAlias = tuple[int, int]
Numbers: TypeAlias = ArrayLike | Fraction | Sequence[Fraction]

# queries handled at once, and control values gathered at once: what stays in cache and in memory
_CHUNK = 1 << 16
_GATHER = 1 << 22


@dataclass(frozen=True)
class _Group:
    """Queries of a chunk that lie in patches of one kind."""

    kind: int
    query: Array  # (q,) places in the chunk
    row: Array  # (q,) rows of the patches in the control table of the kind
    s: Array  # (q,) parameters in the patch
    t: Array
    depth: Array  # (q,) halvings from limit face to patch
    turn: Array  # (q,) corners that the patch is turned against the limit face


@dataclass(frozen=True)
class _Corners:
    """Queries of a group around extraordinary corners, with what their patches have in common."""

    query: Array  # (q,) places in the group
    table: tables.EigenTable
    place: basis.CornerPlace
    powers: basis.EigenPowers
    origin: Array  # (P, d) first control points of the patches concerned
    modes: Array  # (P, K, d) their coefficients in the eigenbasis
    size: Array  # (P, 1, 1) largest distances of control points from the first
    which: Array  # (q,) patch of each query


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
    triangles : {"catmull-clark", "smooth"}, optional

    Attributes
    ----------
    mesh, points
        The cage and its points.
    limit_faces : LimitFaces
        Numbering of the limit faces: a quad is one, an n-gon n consecutive ones, in order of its
        corners; fields `face`, `corner` (-1 for quads), `first`, and ``len()``.

    Raises
    ------
    NotImplementedError
        For creases, corner tags, triangles="smooth" with triangles, and boundary vertices other
        than of two faces, or of one under "edge_and_corner".
    ValueError
        For an unknown option or scheme.

    Notes
    -----
    **Parameters.** On a quad, corner 0 is at (u, v) = (0, 0), corner 1 at (1, 0), corner 2 at
    (1, 1), corner 3 at (0, 1). Limit face k of an n-gon has its corner k at (0, 0), the midpoints
    of the edges to the next and to the previous corner at (1, 0) and (0, 1), its centre at (1, 1).

    **Derivatives** are with respect to (u, v) of the limit face. After n halvings towards an
    extraordinary vertex of subdominant eigenvalue lambda, a derivative of order m scales as
    (2^m lambda)^n. First derivatives vanish towards a vertex of valence 3 (2 lambda = 0.82),
    and diverge for valence 5 and more (2 lambda = 1.1 to 1.31); at the vertex itself they are 0
    and NaN. Beyond float64's range they are +-inf. Directions, `normal` and `tangents`, converge
    nevertheless, slowly: at distance 2^-n like (mu / lambda)^n, mu being the next eigenvalue.

    **NaN** is returned for NaN or infinite u or v, on faces without a limit, and where a value
    does not exist; nowhere else.

    **Numbers.** float64 points, u and v give float64. If any of them is an object array or a
    Fraction, ints and floats count as the rationals they are, and the result is exact.

    After Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter
    values", SIGGRAPH 1998. A face is cut, where it must be, until each piece has one extraordinary
    corner (``limitsurf/patches.py``); the eigenstructure is derived in
    ``derivations/eigenstructure.py``.

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
        odd = irregular_boundary(mesh, rules)
        if len(odd):
            n, more = int(mesh.vertex_faces[odd[0]]), len(odd) - 1
            raise NotImplementedError(
                f"boundary vertex {odd[0]} has {n} face{'s' * (n > 1)}"
                + (f" ({more} more like it)" if more else "")
                + f': under boundary="{rules.boundary}" a limit is evaluated at boundary vertices '
                + "of two faces"
                + (" or one" if rules.boundary == "edge_and_corner" else "")
            )
        self.limit_faces = LimitFaces.of(mesh)
        self._rules = rules
        self._tables: dict[bool, PatchTable] = {False: PatchTable(mesh, rules, np.dtype(float))}
        self._eigen = {
            kind: tables.eigen_table(rules.scheme, kind)
            for kind in self.patches.controls
            if kind != REGULAR
        }
        self._set_points(mesh)

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
        >>> surface.with_points([[0], [1], [3], [2]]).evaluate(0, 0.25, 0.5).tolist()
        [1.25]
        """
        other = object.__new__(type(self))
        other.__dict__.update(
            {k: v for k, v in self.__dict__.items() if k not in ("_local", "_exact_points")}
        )
        other._set_points(self.mesh.with_points(points))
        return other

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
        return self._tables[False]

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

    def evaluate(self, face: ArrayLike, u: Numbers, v: Numbers, nu: Order = (0, 0)) -> Any:
        """Positions on the limit surface, or derivatives of any order.

        Parameters
        ----------
        face : array_like of int
            Limit faces, 0 to ``len(limit_faces) - 1``.
        u, v : array_like
            Parameters in [0, 1].
        nu : (int, int)
            Order of the derivative in u and in v.

        Returns
        -------
        ndarray
            Shape ``broadcast(face, u, v).shape + points.shape[1:]``. See the class for the
            scaling of derivatives, and for NaN and infinity.

        Raises
        ------
        IndexError
            For a face out of range.
        ValueError
            For finite u or v outside [0, 1], or an order that is not two integers >= 0.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 2], [0, 2]], [[0, 1, 2, 3]]))
        >>> surface.evaluate(0, 0.5, [0.25, 0.75]).tolist()
        [[0.5, 0.5], [0.5, 1.5]]
        >>> surface.evaluate(0, 0.5, 0.5, nu=(0, 1)).tolist()
        [0.0, 2.0]
        """
        return self._derivatives(face, u, v, [_order(nu)])[0]

    def jet(self, face: ArrayLike, u: Numbers, v: Numbers, order: int = 2) -> dict[Order, Any]:
        """All derivatives up to a total order in one pass, as {(i, j): array}.

        Arguments, shapes and errors are those of `evaluate`; (0, 0) is the position.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
        >>> {nu: round(float(x[0]), 12) for nu, x in surface.jet(0, 0.25, 0.0, order=1).items()}
        {(0, 0): 0.25, (1, 0): 1.0, (0, 1): 0.0}
        """
        if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 0:
            raise ValueError(f"order must be an integer >= 0, got {order!r}")
        orders = [(m - j, j) for m in range(int(order) + 1) for j in range(m + 1)]
        return dict(zip(orders, self._derivatives(face, u, v, orders), strict=True))

    def tangents(self, face: ArrayLike, u: Numbers, v: Numbers) -> tuple[Any, Any]:
        """Unit directions of d/du and d/dv, along the last axis of the points.

        At an extraordinary vertex they are the limits along the face's own two edges. NaN where a
        derivative vanishes otherwise, up to rounding (degenerate points), and at interior vertices
        of valence 2, where in general no tangent plane exists.

        Arguments, shapes and errors are those of `evaluate`.

        Raises
        ------
        TypeError
            On exact numbers: a length needs a square root, which Fractions do not have.

        Examples
        --------
        >>> import limitsurf as ls
        >>> surface = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 2], [0, 2]], [[0, 1, 2, 3]]))
        >>> [t.tolist() for t in surface.tangents(0, 0.5, 0.5)]
        [[1.0, 0.0], [0.0, 1.0]]
        """
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

    def normal(self, face: ArrayLike, u: Numbers, v: Numbers) -> Any:
        """Unit normals, along d/du x d/dv: outwards where faces are counter-clockwise from outside.

        The normal is that of its own (u, v) at every distance from an extraordinary vertex, and
        the limit at the vertex itself. NaN where the derivatives are dependent up to rounding, and
        at interior vertices of valence 2, where in general no limit normal exists.

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
        if self.points.shape[1:] != (3,):
            raise ValueError(f"a normal needs points of shape (n, 3), got {self.points.shape}")
        (along, noise), (across, other), shape = self._directions(face, u, v, "normal")
        return kernels.unit_normals(along, across, (noise, other)).reshape(*shape, 3)

    def weights(
        self, face: ArrayLike, u: Numbers, v: Numbers, nu: Order = (0, 0)
    ) -> csr_array[Any] | ExactOperator:
        """Sparse matrix that maps control points to positions or derivatives.

        Parameters
        ----------
        face, u, v, nu
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
        >>> surface.weights(0, 0.25, [0.0, 0.5]).toarray().tolist()
        [[0.75, 0.25, 0.0, 0.0], [0.375, 0.125, 0.125, 0.375]]
        """
        nu = _order(nu)
        face, u, v, exact = self._queries(face, u, v)
        face, u, v = face.ravel(), u.ravel(), v.ravel()
        patches = self._patch_table(exact)
        dtype = np.dtype(object if exact else float)
        parts = []
        for start in range(0, max(len(face), 1), _CHUNK):
            part = slice(start, start + _CHUNK)
            undefined, groups = self._groups(patches, face[part], u[part], v[part])
            corner = self.mesh.offsets[self.limit_faces.face[face[part][undefined]]]
            rows, columns = [undefined], [self.mesh.indices[corner]]
            values = [np.full(len(undefined), np.nan, dtype=dtype)]
            for group in groups:
                for g in _pieces(group, patches.controls[group.kind].shape[1]):
                    ids = patches.controls[g.kind][g.row]
                    rows.append(np.repeat(g.query, ids.shape[1]))
                    columns.append(ids.ravel())
                    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                        values.append(self._control_weights(g, nu, exact).ravel())
            total = sparse_operator(
                np.concatenate(rows),
                np.concatenate(columns),
                np.concatenate(values),
                (len(face[part]), patches.n_points),
            )
            # back through the extra control points, last ones first
            for operator in reversed(patches.extras):
                total = _eliminated(total, operator)
            parts.append(total)
        return stacked(parts)

    # ------------------------------------------------------------------ how it is done

    def _patch_table(self, exact: bool) -> PatchTable:
        if exact not in self._tables:
            self._tables[exact] = PatchTable(self.mesh, self._rules, np.dtype(object))
        return self._tables[exact]

    def _queries(self, face: ArrayLike, u: Numbers, v: Numbers) -> tuple[Array, Array, Array, bool]:
        """Broadcast and check a query; tell whether it is to be answered exactly."""
        faces, us, vs = np.asarray(face), np.asarray(u), np.asarray(v)
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
        return faces.astype(np.int64, copy=False), us, vs, exact

    def _groups(
        self, patches: PatchTable, face: Array, u: Array, v: Array
    ) -> tuple[Array, Iterator[_Group]]:
        """Queries without a value (NaN), and the others by kind of patch; all flat."""
        if u.dtype == object:
            finite = np.array([x == x and y == y for x, y in zip(u, v, strict=True)], dtype=bool)
        else:
            finite = np.isfinite(u) & np.isfinite(v)
        defined = np.flatnonzero(finite & (patches.codes[face] != -1))
        undefined = np.flatnonzero(~(finite & (patches.codes[face] != -1)))
        patch, s, t, depth = patches.locate(face[defined], u[defined], v[defined])

        def groups() -> Iterator[_Group]:
            kinds = patches.kind[patch]
            for kind in np.unique(kinds).tolist():
                here = np.flatnonzero(kinds == kind)
                turn = patches.turn[patch[here]]
                sides = [s[here], t[here], 1 - s[here], 1 - t[here]]
                yield _Group(
                    kind,
                    defined[here],
                    patches.row[patch[here]],
                    np.choose(turn, sides),
                    np.choose(turn, sides[1:] + sides[:1]),
                    depth[here],
                    turn,
                )

        return undefined, groups()

    @cached_property
    def _local(self) -> tuple[Array, Array]:
        """A vertex near each control point (n_points, d) and its offset from there (n_points, d).

        Offsets are sums of differences of nearby points: cages far from the origin keep digits.
        """
        patches = self.patches
        anchor = np.zeros(patches.n_points, dtype=np.int64)
        anchor[: self.mesh.n_vertices] = np.arange(self.mesh.n_vertices)
        offset = np.zeros((patches.n_points, self._flat.shape[1]))
        done = self.mesh.n_vertices
        for operator in patches.extras:
            new = slice(done, done + operator.shape[0])
            anchor[new] = anchor[operator.indices[operator.indptr[:-1]]]
            offset[new] = kernels.differences(
                operator.indptr,
                operator.indices,
                operator.data,
                self._flat,
                anchor,
                offset,
                anchor[new],
            )
            done = new.stop
        return self._flat[anchor], offset

    @cached_property
    def _exact_points(self) -> Array:
        """All control points as Fractions, (n_points, d)."""
        points = kernels.exact(self._flat)
        for operator in self._patch_table(True).extras:
            points = np.concatenate([points, operator @ points])
        return points

    def _derivatives(
        self, face: ArrayLike, u: Numbers, v: Numbers, orders: Sequence[Order]
    ) -> list[Any]:
        """The derivatives of the given orders, each of the shape that `evaluate` promises."""
        face, u, v, exact = self._queries(face, u, v)
        compute = self._exact_values if exact else self._float_values
        results = self._over_chunks(
            face, u, v, exact, [self._flat.shape[1]] * len(orders), partial(compute, orders=orders)
        )
        shape = face.shape + self.points.shape[1:]
        return [r.reshape(shape)[()] for r in results]

    def _directions(self, face: ArrayLike, u: Numbers, v: Numbers, what: str) -> tuple[Any, ...]:
        """d/du and d/dv up to positive factors, each (Q, d) with its noise (Q, 1); query shape."""
        face, u, v, exact = self._queries(face, u, v)
        if exact:
            raise TypeError(
                f"{what} needs square roots, which Fractions do not have: give float64 numbers "
                "(or mpf or sympy ones, where these are supported)"
            )
        d = self._flat.shape[1]
        along, across, noise, other = self._over_chunks(
            face, u, v, False, [d, d, 1, 1], self._float_directions
        )
        return (along, noise), (across, other), face.shape

    def _over_chunks(
        self,
        face: Array,
        u: Array,
        v: Array,
        exact: bool,
        widths: Sequence[int],
        compute: Callable[[_Group, Array], Sequence[Array]],
    ) -> list[Array]:
        """Arrays (Q, width) of `compute` over all queries, some thousands at a time; NaN elsewhere.

        Overflow to infinity and underflow to zero are results, not accidents.
        """
        face, u, v = face.ravel(), u.ravel(), v.ravel()
        patches = self._patch_table(exact)
        dtype = object if exact else float
        results = [np.full((len(face), width), np.nan, dtype=dtype) for width in widths]
        for start in range(0, len(face), _CHUNK):
            part = slice(start, start + _CHUNK)
            _, groups = self._groups(patches, face[part], u[part], v[part])
            for group in groups:
                size = patches.controls[group.kind].shape[1] * max(*widths, 1)
                for g in _pieces(group, size):
                    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                        values = compute(g, patches.controls[g.kind])
                    for result, value in zip(results, values, strict=True):
                        result[start + g.query] = value
        return results

    def _differences(self, ids: Array) -> tuple[Array, Array]:
        """First control point of patches, (P, d), and all of them relative to it, (P, K, d)."""
        near, offset = self._local
        origin = near[ids[:, 0]]
        points = near[ids]
        points -= origin[:, None]
        extra = ids >= self.mesh.n_vertices
        if extra.any():
            points[extra] += offset[ids[extra]]
        return origin, points

    def _float_values(self, g: _Group, ids: Array, orders: Sequence[Order]) -> list[Array]:
        """Derivatives (q, d) of the queries of a group, in float64."""
        values = []
        if g.kind == REGULAR:
            origin, points = self._differences(ids[g.row])
            for nu in orders:
                value = _contract(kernels.bicubic_weights(g.s, g.t, nu), points)
                values.append(value + origin if nu == (0, 0) else _scaled(value, g.depth * sum(nu)))
            return values
        # in patch parameters first: all orders at once, then each query picks by its turn
        turned = [_turned(nu) for nu in orders]
        needed = sorted({order for choices, _ in turned for order in choices})
        parts = np.empty((len(g.query), len(needed), self._flat.shape[1]))
        for c in self._corners(g, ids):
            eigen = [basis.eigen_weights(c.table, c.place, c.powers, order) for order in needed]
            rows = np.stack([x.rows for x in eigen], axis=1)  # (q, orders, K - 1)
            found = np.matmul(rows, c.modes[c.which, 1:])  # (q, orders, d)
            for k, (order, x) in enumerate(zip(needed, eigen, strict=True)):
                found[:, k] = _scaled(found[:, k], x.exponent + g.depth[c.query] * sum(order))
                if x.with_limit:
                    found[:, k] += c.modes[c.which, 0]
                    found[:, k] += c.origin[c.which]
            parts[c.query] = found
        for choices, sign in turned:
            pick = np.array([needed.index(order) for order in choices])[g.turn]
            values.append(parts[np.arange(len(pick)), pick] * sign[g.turn][:, None])
        return values

    def _float_directions(self, g: _Group, ids: Array) -> list[Array]:
        """Directions of d/du and d/dv (q, d) of a group, and their rounding errors (q, 1)."""
        noise = 16 * np.finfo(float).eps
        if g.kind == REGULAR:
            _, points = self._differences(ids[g.row])
            size = np.abs(points).max(axis=2, initial=0, keepdims=True)  # (q, 16, 1)
            weights = [kernels.bicubic_weights(g.s, g.t, nu) for nu in ((1, 0), (0, 1))]
            return [_contract(w, points) for w in weights] + [
                noise * _contract(np.abs(w), size) for w in weights
            ]
        found = np.empty((4, len(g.query), self._flat.shape[1]))
        for c in self._corners(g, ids):
            # a coefficient is a sum over all control points: its error is of their size
            size = np.abs(c.modes[:, 1:]).max(axis=2, initial=0, keepdims=True) + c.size
            for k, x in enumerate(basis.eigen_tangents(c.table, c.place, c.powers)):
                found[k, c.query] = _contract(x.rows, c.modes[c.which, 1:])
                found[k + 2, c.query] = noise * _contract(np.abs(x.rows), size[c.which])
        ds, dt, noise_s, noise_t = found
        odd, turn = (g.turn % 2 == 1)[:, None], g.turn[:, None]
        along = np.where(odd, dt, ds) * np.where((turn == 1) | (turn == 2), -1, 1)
        across = np.where(odd, ds, dt) * np.where((turn == 2) | (turn == 3), -1, 1)
        errors = np.where(odd, noise_t, noise_s), np.where(odd, noise_s, noise_t)
        return [along, across, errors[0][:, :1], errors[1][:, :1]]

    def _corners(self, g: _Group, ids: Array) -> Iterator[_Corners]:
        """What evaluation around an extraordinary corner needs, for queries of a group.

        Queries are parted by the first eigenfunction that occurs in their patch at all: the
        second, but for degenerate points.
        """
        table = self._eigen[g.kind]
        patch, which = np.unique(g.row, return_inverse=True)
        origin, points = self._differences(ids[patch])
        modes = basis.eigen_coefficients(table, points)
        size = np.abs(points).max(axis=(1, 2), initial=0)[:, None, None]
        occurs = (modes[:, 1:] != 0).any(axis=2)
        leads = 1 + occurs.argmax(axis=1)
        place = basis.CornerPlace.of(g.s, g.t, g.turn)
        for lead in np.unique(leads).tolist():
            query = np.flatnonzero(leads[which] == lead)
            here = place[query]
            powers = basis.EigenPowers.of(table, here, lead)
            yield _Corners(query, table, here, powers, origin, modes, size, which[query])

    def _exact_values(self, g: _Group, ids: Array, orders: Sequence[Order]) -> list[Array]:
        """Derivatives (q, d) of the queries of a group, as Fractions."""
        points = self._exact_points[ids[g.row]]
        return [
            (self._control_weights(g, nu, True)[:, :, None] * points).sum(axis=1) for nu in orders
        ]

    def _control_weights(self, g: _Group, nu: Order, exact: bool) -> Array:
        """Weights (q, K) of the control points for a derivative in (u, v) of the limit face."""
        turned, sign = _turned(nu)
        dtype = np.dtype(object if exact else float)
        scale = kernels.scale_by_two(sign[g.turn].astype(dtype), g.depth * sum(nu))[:, None]
        if g.kind == REGULAR:
            return np.asarray(kernels.bicubic_weights(g.s, g.t, nu) * scale)
        table = self._eigen[g.kind]
        place = basis.CornerPlace.of(g.s, g.t, g.turn)
        result = np.empty((len(g.s), table.size), dtype=dtype)
        for order in set(turned):
            here = np.array([o == order for o in turned])[g.turn]
            sub = place[here]
            if exact:
                zero = basis.vanishes_at_corner(table, order)
                rational = tables.rational_table(self._rules.scheme, g.kind)
                at_corner = Fraction(0) if zero else np.nan
                result[here] = basis.rational_weights(rational, sub, order, at_corner)
            else:
                powers = basis.EigenPowers.of(table, sub)
                eigen = basis.eigen_weights(table, sub, powers, order)
                result[here] = basis.control_weights(table, eigen)
        return np.asarray(result * scale)


def _order(nu: Any) -> Order:
    """Two non-negative integers."""
    order = tuple(nu) if isinstance(nu, (tuple, list, np.ndarray)) else ()
    if len(order) != 2 or not all(
        isinstance(n, (int, np.integer)) and not isinstance(n, bool) and n >= 0 for n in order
    ):
        raise ValueError(f"nu must be two integers >= 0, got {nu!r}")
    return int(order[0]), int(order[1])


def _turned(nu: Order) -> tuple[list[Order], Array]:
    """Order of the derivative in patch parameters, by turn 0 to 3, and its sign (4,).

    A patch turned by 1 has s = v, t = 1 - u; by 2, s = 1 - u, t = 1 - v; by 3, s = 1 - v, t = u.
    """
    i, j = nu
    signs = [1, (-1) ** i, (-1) ** (i + j), (-1) ** j]
    return [(i, j), (j, i), (i, j), (j, i)], np.array(signs)


def _pieces(group: _Group, width: int) -> Iterator[_Group]:
    """Cut a group so that no piece gathers too much: `width` numbers a query."""
    step = max(1, _GATHER // max(width, 1))
    if len(group.query) <= step:
        yield group
        return
    for start in range(0, len(group.query), step):
        part = slice(start, start + step)
        yield _Group(
            group.kind,
            *(x[part] for x in (group.query, group.row, group.s, group.t, group.depth, group.turn)),
        )


def _contract(weights: Array, points: Array) -> Array:
    """Sum over k of weights (q, K) times points (q, K, d)."""
    return np.asarray(np.matmul(weights[:, None], points)[:, 0])


def _scaled(values: Array, exponent: Array) -> Array:
    """Values (q, d) times 2 ** exponent (q,); infinite beyond float64's range."""
    return kernels.scale_by_two(values, exponent[:, None])


def _eliminated(total: Any, operator: Any) -> Any:
    """Replace the last columns of `total` by the rows of `operator` that they stand for."""
    n = operator.shape[1]
    if isinstance(total, ExactOperator):
        kept = total.columns < n
        last = ExactOperator(
            total.rows[~kept],
            total.columns[~kept] - n,
            total.values[~kept],
            (total.shape[0], operator.shape[0]),
        )
        more = last @ operator
        return ExactOperator(
            np.concatenate([total.rows[kept], more.rows]),
            np.concatenate([total.columns[kept], more.columns]),
            np.concatenate([total.values[kept], more.values]),
            (total.shape[0], n),
        )
    result = total[:, :n] + total[:, n:] @ operator
    result.sort_indices()
    return result


def _first(values: Array, bad: Array) -> str:
    """The first offending value, where it is, and how many there are."""
    place = np.unravel_index(int(np.argmax(bad)), bad.shape) if bad.ndim else ()
    where = f" at index {', '.join(map(str, place))}" if place else ""
    count = int(np.count_nonzero(bad))
    more = f" ({count - 1} more like it)" if count > 1 else ""
    return f"{values[place]}{where}{more}"
