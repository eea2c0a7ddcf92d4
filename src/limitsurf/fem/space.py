"""Spaces of functions on a limit surface, spanned by the basis functions of its refined cage."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.caching import cached_property
from limitsurf.cage.checks import checked_integer
from limitsurf.engine.protocol import Order, threads
from limitsurf.fem import forms
from limitsurf.fem import levels as cages
from limitsurf.fem.basis import Basis, Block
from limitsurf.fem.checks import checked_where, refuse_dual
from limitsurf.fem.elements import Elements
from limitsurf.fem.extraction import Extracted
from limitsurf.fem.geometry import Geometry
from limitsurf.fem.grading import Grading
from limitsurf.fem.levels import Ends
from limitsurf.fem.parents import parent_faces
from limitsurf.fem.pattern import Pattern
from limitsurf.fem.phantoms import Phantoms
from limitsurf.fem.places import vertex_places
from limitsurf.integrals.checks import checked, is_exact
from limitsurf.integrals.quadrature import Quadrature, quadrature, refuse_infinite
from limitsurf.integrals.tails import Kind
from limitsurf.patches import NO_LIMIT
from limitsurf.surface import LimitSurface

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[Any]
Floats = NDArray[np.float64]
Function = Callable[[Array, Array], ArrayLike]
Term = tuple[Order, Order, ArrayLike]

_HIGHEST = 6  # order of derivatives that are not all 0


class Space:
    """Functions on a limit surface, spanned by the basis functions of its refined cage.

    The surface stays what it is at every level: refinement adds functions, and those of a coarser
    space are among those of a finer one. Each vertex of the refined cage is one unknown.

    Parameters
    ----------
    surface : LimitSurface
        Of float64 points (n_vertices, 3). Holes belong to no domain, but the functions of their
        vertices that reach faces with a limit are unknowns.
    levels : int
        How often the cage is refined.
    ends : {"free", "natural"}
        Beyond boundaries, and beyond infinitely sharp creases that part the cage, phantom points
        are unknowns of their own, see `extended` (default); or functions follow the boundary rules
        of the surface, by which second derivatives across the boundary vanish: that costs orders
        of convergence, wherever solutions do not do so. Where a boundary has a vertex that is not
        regular, ends are natural there, with one warning; in graded spaces along all of this
        boundary and at creases. Creases of triangles part nothing. In dual schemes ("doo-sabin")
        ends are free from level 1 on, by what is asked for or not, and natural before; in schemes
        whose faces depend on their own corners alone both are the same.
    near_poles : int
        Functions of so many more levels near special corners: of each level within three layers of
        faces of the one before. Coarse functions are dropped where finer ones take over.
    where : (n_faces,) array_like of bool or int, optional
        Functions of one more level, or of so many, on these faces of the cage, and within two
        layers of faces of the level before around them.

    Attributes
    ----------
    n : int
        Unknowns.
    cage : LimitSurface
        The surface that was given.
    surface : LimitSurface
        The same surface over the refined cage: its control points are the coefficients of x, y and
        z, and its limit faces those of `basis` and of any `quadrature`. Holes on which nothing
        depends are left out of it.
    operator : csr_array, (n, n_vertices)
        From values at the vertices of the cage to coefficients of the same function.
    ends : str

    Raises
    ------
    TypeError
        For exact points: what is solved with forms has square roots.
    ValueError
        For points that are not in space, levels or ends out of range, a surface without limit,
        `where` of another shape, and graded spaces in dual schemes ("doo-sabin").

    Warns
    -----
    UserWarning
        Where ends are natural that should be free.

    Notes
    -----
    Forms are sums over the points of a quadrature, by default of one Gauss point more in each
    direction than the degree of the functions, with rings around special corners up to 1e-12:
    of polynomials in the parameters they are exact. With elements of size h errors are of order h^4
    in L2 and h^3 in H1 where all vertices have 4 faces, or 6 triangles (h^3 and h^2 in dual
    schemes); at others functions approximate
    worse, not integrals: with the subdominant eigenvalue l the error in H1 falls by l^2, in L2 by
    l^3, with each level, where that is slower (``derivations/elements.py``).

    Cirak, Ortiz and Schroeder, "Subdivision surfaces: a new paradigm for thin-shell finite-element
    analysis", Int. J. Numer. Meth. Engng 47, 2000.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> space = ls.Space(ls.LimitSurface(ls.Mesh(points, quads)), levels=2)
    >>> space
    <Space of 98 functions on 96 limit faces, catmull-clark>
    >>> mass = space.mass()
    >>> one = space.interpolate(lambda points, normals: points[:, 0] * 0 + 1)
    >>> round(float(one @ mass @ one - ls.area(space.surface)), 8)  # the area
    0.0
    """

    def __init__(
        self,
        surface: LimitSurface,
        *,
        levels: int = 0,
        ends: Ends = "free",
        near_poles: int = 0,
        where: ArrayLike | None = None,
    ) -> None:
        surface = checked(surface, "a space")
        if is_exact(surface):
            raise TypeError(
                "a space needs float64 points, got exact ones: forms have square roots; convert "
                "the points of the cage by astype(float)"
            )
        levels = checked_integer("levels", levels, 0)
        if ends not in get_args(Ends):
            raise ValueError(f'ends must be "free" or "natural", got {ends!r}')
        near_poles = checked_integer("near_poles", near_poles, 0)
        more = checked_where(where, surface.mesh.n_faces)
        graded = near_poles > 0 or bool(more.any())
        if graded:
            refuse_dual(surface)
        if not surface.patches.with_limit.any():
            raise ValueError("a space needs a face with a limit, but no limit face has one")
        self._start(surface, levels, ends, not graded)
        if ends == "free":
            self._levels.warn_of_natural_ends(3)
        if graded:
            self._grade(near_poles, more, [])
        self._asked = near_poles, more

    def _start(self, surface: LimitSurface, levels: int, ends: Ends, parted: bool) -> None:
        """Have the cage refined."""
        self.ends: Ends = ends
        self.cage, self.levels = surface, levels
        given = surface.mesh.with_tags(channels=None, face_data=None, **surface.rules)
        self._levels = cages.Levels(given, levels, ends, parted)
        mesh = self._levels.finest
        found = surface if mesh is given else LimitSurface(mesh, engine=surface.engine)
        self.refined_surface = self.surface = found
        self.grading: Grading | Phantoms | None = self._levels.phantoms()
        if isinstance(self.grading, Phantoms):
            self.grading.build(parent_faces(self), surface.engine)
            self.surface = self.grading.surface
        self._rules: dict[str, Quadrature] = {}
        self._bases: dict[tuple[str, int], Basis] = {}

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return self.surface.mesh.n_vertices if self.grading is None else self.grading.n

    @cached_property
    def extraction(self) -> csr_array[Any]:
        """From coefficients to the vertices of `surface`, (n_vertices, n).

        The identity, but for graded spaces.
        """
        from scipy.sparse import eye_array

        if self.grading is not None:
            return self.grading.extraction
        return eye_array(self.n, format="csr")

    @cached_property
    def points(self) -> Floats:
        """The surface itself as functions of the space: coefficients (n, 3) of x, y and z."""
        if self.grading is None:
            return self.surface.points
        return np.asarray(self.grading.prolonged(self.refined_surface.points))

    @cached_property
    def parents(self) -> NDArray[np.int64]:
        """The face of the cage that each limit face of `surface` is in; -1 without a limit."""
        of_faces = parent_faces(self) if self.grading is None else self.grading.parent
        found = np.asarray(of_faces[self.surface.limit_faces.face], dtype=np.int64)
        return np.where(self.surface.patches.with_limit, found, -1)

    def rows(
        self, face: ArrayLike, u: ArrayLike, v: ArrayLike, nu: Any = (0, 0), workers: int = 1
    ) -> Any:
        """The matrix from coefficients to values at places of `surface`, (places, n).

        Parameters, and what is returned, are those of `LimitSurface.weights`.
        """
        found = self.surface.weights(face, u, v, nu=nu, workers=workers)
        if self.grading is None:
            return found
        if isinstance(found, (list, tuple)):
            return [one @ self.extraction for one in found]
        return found @ self.extraction

    def __repr__(self) -> str:
        name = self.surface.topology.rules.scheme.name
        faces = int(self.surface.patches.with_limit.sum())
        return f"<Space of {self.n} functions on {faces} limit faces, {name}>"

    @cached_property
    def operator(self) -> csr_array[Any]:
        """From values at the vertices of the cage to coefficients, (n, n_vertices)."""
        total = self._levels.operator(None, self.levels)
        return total if self.grading is None else self.grading.prolonged(total)

    def _grade(self, near_poles: int, more: Array, chosen: list[Array]) -> None:
        """Refine parts of the cage further."""
        base = self.refined_surface
        parent = parent_faces(self)
        grading = Grading(base, parent, near_poles, more, chosen)
        self.grading, self.surface = grading, grading.surface
        self._asked = near_poles, more

    def finer(self, where: ArrayLike) -> Space:
        """A space with functions of one level more on some limit faces, to refine by an error.

        Parameters
        ----------
        where : (n_limit_faces,) array_like of bool
            Limit faces of `surface`. Two layers of faces around them are refined too, so that on
            them all finer functions are there.

        Returns
        -------
        Space
            Graded, of which all functions of this one are.

        Raises
        ------
        ValueError
            For what are no booleans, one for each limit face, or none of a face with a limit; for
            dual schemes ("doo-sabin").

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square), levels=3)
        >>> corner = (space.surface.evaluate(range(100), 0.5, 0.5) < 0.2).all(axis=-1)
        >>> space.n, space.finer(corner).n
        (121, 169)
        """
        count = len(self.surface.limit_faces)
        chosen = np.asarray(where)
        if chosen.shape != (count,) or chosen.dtype != bool:
            raise ValueError(
                f"where must be ({count},) booleans, one for each limit face of space.surface, "
                f"got {chosen.dtype} of shape {chosen.shape}"
            )
        chosen = chosen & self.surface.patches.with_limit
        if not chosen.any():
            raise ValueError("where must be true on a limit face that has a limit")
        refuse_dual(self.cage)
        with warnings.catch_warnings():  # of ends: this space has said it
            warnings.simplefilter("ignore", UserWarning)
            found = Space(self.cage, levels=self.levels, ends=self.ends)
        found._start(self.cage, self.levels, self.ends, False)
        near_poles, more = self._asked
        faces = np.unique(self.surface.limit_faces.face[chosen])
        if isinstance(self.grading, Grading):
            numbers = self.grading.and_chosen(faces)
        else:  # faces with a limit are in one order, whatever is beyond them
            number = np.arange(self.refined_surface.mesh.n_faces)
            if self.grading is not None:
                corners = self.grading.own[self.surface.mesh.offsets[faces]]
                faces = self.refined_surface.mesh.corner_face[corners]
            one, other = (
                x.patches.with_limit[x.limit_faces.first]
                for x in (self.refined_surface, found.refined_surface)
            )
            number[one] = np.flatnonzero(other)
            numbers = [np.sort(number[faces])]
        found._grade(near_poles, more, numbers)
        return found

    def prolongation(self, coarser: Space) -> csr_array[Any]:
        """The matrix (n, coarser.n) from coefficients of a coarser space to those of this one.

        The function is the same.

        Parameters
        ----------
        coarser : Space
            Of the same surface, with no more levels and the same ends.

        Raises
        ------
        ValueError
            For another surface, other ends, or more levels.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> surface = ls.LimitSurface(square)
        >>> coarse, fine = ls.Space(surface), ls.Space(surface, levels=1)
        >>> P = fine.prolongation(coarse)
        >>> P.shape, bool(abs(P @ coarse.surface.points - fine.surface.points).max() < 1e-14)
        ((25, 16), True)
        """
        if not isinstance(coarser, Space):
            raise TypeError(f"prolongation needs a Space, got {type(coarser).__name__}")
        if coarser.ends != self.ends:
            raise ValueError(f"ends differ: {coarser.ends!r} of the coarser space, {self.ends!r}")
        more = self.levels - coarser.levels
        both = coarser._levels.coarsest, self._levels.coarsest
        if more < 0 or not _same_functions(coarser, self):
            raise ValueError(
                f"the space of {coarser.levels} levels on {both[0].n_faces} faces is not coarser "
                f"than this one, of {self.levels} levels on {both[1].n_faces}: both need one cage, "
                "with the same tags and rules"
            )
        if isinstance(coarser.grading, Grading):
            raise ValueError("prolongation from graded spaces is not available: take a uniform one")
        if isinstance(self.grading, Grading) and coarser.grading is not None:
            raise ValueError(
                "the coarser space has phantom points along parts of boundaries or beyond creases, "
                'which graded spaces have not: take ends="natural" for both'
            )
        found = self._levels.prolongation(coarser.refined_surface.mesh, more)
        return self.grading.prolonged(found) if isinstance(self.grading, Grading) else found

    # ------------------------------------------------------------------ functions

    def function(self, coefficients: ArrayLike, *, channel: str | None = None) -> LimitSurface:
        """The function of coefficients, as a surface to evaluate.

        Parameters
        ----------
        coefficients : (n, ...) array_like
        channel : str, optional
            What to call the function as a channel of the surface itself, to tessellate, plot and
            write it with its values.

        Returns
        -------
        LimitSurface
            Its points are the coefficients: ``evaluate``, ``jet`` and ``weights`` are those of the
            function, over the limit faces of `surface`. With `channel` it is `surface` with one
            more channel: ``evaluate(..., channel=channel)`` is the function.

        Raises
        ------
        ValueError
            For another number of coefficients.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square), levels=1)
        >>> f = space.function(space.interpolate(lambda points, normals: points[:, 0] ** 2))
        >>> f.evaluate(0, [0.5, 1.0], 0.3).round(9).tolist()  # x = 0.25, 0.5
        [0.0625, 0.25]
        """
        values = self.checked_coefficients(coefficients)
        if self.grading is not None:
            flat = self.extraction @ values.reshape(self.n, -1)
            values = flat.reshape(-1, *values.shape[1:])
        if channel is None:
            return self.surface.with_points(values)
        mesh = self.surface.mesh
        mode = "corners_only" if self.surface.rules["boundary"] == "edge_and_corner" else "none"
        rows = values.reshape(mesh.n_vertices, -1), mesh.indices, mode
        return LimitSurface(
            mesh.with_tags(channels={channel: rows}),
            **self.surface.rules,
            engine=self.surface.engine,
        )

    def interpolate(self, f: Function) -> Floats:
        """Coefficients of the function that has given values at the vertices of the refined cage.

        Where free ends leave more unknowns than there are vertices it is, of all functions that
        have these values, the one nearest to `f` in L2. In graded spaces values are given at the
        vertices of each level whose own functions are of the space.

        Parameters
        ----------
        f : callable
            ``f(points, normals)`` gives numbers (m,) or arrays (m, ...) at points (m, 3) of the
            surface, from these and unit normals there, which are NaN where there are none.

        Returns
        -------
        array, (n, ...)

        Raises
        ------
        TypeError, ValueError
            If `f` gives what are no real numbers, not finite ones, or not one for each point; for
            schemes whose vertices have no places on the surface ("doo-sabin"), where `project`
            does.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square), ends="natural")
        >>> space.interpolate(lambda points, normals: points[:, 1]).round(12).tolist()
        [0.0, 0.0, 1.0, 1.0]
        """
        from scipy.sparse import block_array

        if isinstance(self.grading, Grading):
            face, u, v = vertex_places(self.surface, self.grading.told)
        elif self.grading is not None:
            face, u, v = self.grading.places(self.refined_surface)
        else:
            face, u, v = vertex_places(self.surface)
        rows = self.rows(face, u, v)
        normals = self.surface.normal(face, u, v)
        values, shape = forms.given(f, rows @ self.points, normals)
        if len(face) == self.n:
            factors = forms.factors(rows, symmetric=False)
            forms.refuse_dependent(abs(factors.U.diagonal()))
            return np.asarray(factors.solve(values).reshape(self.n, *shape))
        mass = self.mass()
        size = mass.data.max()  # pivots of both blocks are compared
        saddle = block_array([[mass / size, rows.T], [rows, None]], format="csc")
        factors = forms.factors(saddle, symmetric=False)
        forms.refuse_dependent(abs(factors.U.diagonal()))
        loads = self.load(f).reshape(self.n, -1) / size
        found = factors.solve(np.concatenate([loads, values]))
        return np.asarray(found[: self.n].reshape(self.n, *shape))

    def project(self, f: Function, *, workers: int = 1) -> Floats:
        """Coefficients of the function that is nearest to a given one in L2.

        Parameters
        ----------
        f : callable
            As for `interpolate`; also called at the points of the quadrature.
        workers : int
            Threads, as for `LimitSurface.evaluate`.

        Returns
        -------
        array, (n, ...)

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square))
        >>> f = space.function(space.project(lambda points, normals: points[:, 0] ** 3))
        >>> round(float(f.evaluate(0, 0.5, 0.5)), 9)
        0.125
        """
        loads = self.load(f, workers=workers)
        solver = forms.factors(self.mass(workers=workers))
        forms.refuse_dependent(abs(solver.U.diagonal()))
        return np.asarray(solver.solve(loads.reshape(self.n, -1)).reshape(loads.shape))

    def checked_coefficients(self, coefficients: ArrayLike) -> Array:
        """Coefficients as an array (n, ...); a ValueError for another number."""
        values = np.asarray(coefficients)
        if values.shape[:1] != (self.n,):
            raise ValueError(
                f"coefficients must be of shape ({self.n}, ...), one for each function, got "
                f"{values.shape}"
            )
        return values

    # ------------------------------------------------------------------ at points

    def basis(self, quadrature: Quadrature, order: int = 2) -> Basis:
        """All functions and their derivatives at the points of a quadrature.

        Parameters
        ----------
        quadrature : Quadrature
            On limit faces of `surface`.
        order : int
            Highest total order of derivatives, 0 to 6.

        Returns
        -------
        Basis

        Raises
        ------
        TypeError, ValueError
            For what is no quadrature, one on other faces, NaN points, an order out of range.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square), levels=2)
        >>> space.basis(ls.quadrature(space.surface)).blocks
        [Block(16 faces, 16 points, 16 controls)]
        """
        self._check(quadrature)
        if checked_integer("order", order, 0) > _HIGHEST:
            raise ValueError(f"order must be 0 to {_HIGHEST}, got {order}")
        extraction = None if self.grading is None else self.grading.extraction
        return Basis(self.surface, self._elements, quadrature, order, extraction)

    def geometry(self, quadrature: Quadrature, *, workers: int = 1) -> Geometry:
        """Metric, normal, second form and Christoffel symbols at the points of a quadrature.

        Parameters
        ----------
        quadrature : Quadrature
            On limit faces of `surface`.
        workers : int
            Threads, as for `LimitSurface.evaluate`.

        Returns
        -------
        Geometry

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square))
        >>> q = ls.quadrature(space.surface)
        >>> round(float(q.weights @ space.geometry(q).area), 12)
        2.0
        """
        self._check(quadrature)
        q = quadrature
        return Geometry(self.surface.jet(q.face, q.u, q.v, order=2, workers=workers))

    def _check(self, quadrature: Any) -> None:
        """Refuse what is no quadrature on faces of the surface that have a limit."""
        if not isinstance(quadrature, Quadrature):
            raise TypeError(
                f"need a Quadrature on space.surface, got {type(quadrature).__name__}: "
                "ls.quadrature(space.surface) makes one"
            )
        q = quadrature
        bad = ~(np.isfinite(q.u) & np.isfinite(q.v) & np.isfinite(q.weights))
        if bad.any():
            raise ValueError(
                f"point {np.flatnonzero(bad)[0]} of the quadrature is not finite (and "
                f"{bad.sum() - 1} more)"
            )
        faces = len(self.surface.limit_faces)
        known = self.surface.patches.codes[:faces] != NO_LIMIT  # on all of it, or a part
        if not len(q):
            return
        outside = (q.face < 0) | (q.face >= faces)
        outside[~outside] |= ~known[q.face[~outside]]
        if outside.any():
            raise ValueError(
                f"limit face {q.face[outside][0]} of the quadrature is not one of the {faces} "
                "of space.surface that have a limit: make it by ls.quadrature(space.surface)"
            )

    @cached_property
    def _elements(self) -> Elements:
        return Elements(self.surface, complete=self.grading is None)

    @cached_property
    def pattern(self) -> Pattern | Extracted:
        """Where matrices of the space have entries."""
        found = Pattern(self.surface.mesh.n_vertices, self._elements.groups)
        return found if self.grading is None else Extracted(found, self.grading.extraction)

    def chosen(self, quadrature: Quadrature | None, order: int, integrand: Kind) -> Basis:
        """The basis of a quadrature, or that of the default one, which is kept."""
        if quadrature is not None:
            return self.basis(quadrature, order)
        if integrand not in self._rules:
            if integrand == "curvature":
                refuse_infinite(self.surface)
            points = self.surface.topology.rules.scheme.spline.degree + 1
            self._rules[integrand] = _default(self.surface, points, integrand)
        key = integrand, order
        if key not in self._bases:
            self._bases[key] = self.basis(self._rules[integrand], order)
        return self._bases[key]

    # ------------------------------------------------------------------ forms

    def mass(self, *, quadrature: Quadrature | None = None, workers: int = 1) -> csr_array[Any]:
        """The matrix of integrals over the surface of products of two functions.

        Parameters
        ----------
        quadrature : Quadrature, optional
            Other points than those of the default rule.
        workers : int
            Threads, as for `LimitSurface.evaluate`; matrices are the same for any number.

        Returns
        -------
        csr_array, (n, n)
            Symmetric to the last digit, positive definite. Matrices of a space share the arrays
            `indptr` and `indices`: copy one before its pattern is changed in place.

        Raises
        ------
        ValueError
            Where the area element vanishes.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> mass = ls.Space(ls.LimitSurface(square)).mass()
        >>> round(float(mass.sum()), 12)  # the area
        2.0
        """
        return self._matrix(self.chosen(quadrature, 1, "metric"), forms.mass, workers)

    def stiffness(
        self, *, quadrature: Quadrature | None = None, workers: int = 1
    ) -> csr_array[Any]:
        """The matrix of integrals over the surface of products of the gradients of two functions.

        It is that of minus the Laplace-Beltrami operator. Parameters, shape and errors are those of
        `mass`.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square))
        >>> x = space.surface.points[:, 0]
        >>> round(float(x @ space.stiffness() @ x), 12)  # of a gradient of length 1
        2.0
        """
        return self._matrix(self.chosen(quadrature, 1, "metric"), forms.stiffness, workers)

    def bilaplace(
        self, *, quadrature: Quadrature | None = None, workers: int = 1
    ) -> csr_array[Any]:
        """The matrix of integrals over the surface of products of the Laplacians of two functions.

        Parameters, shape and errors are those of `mass`.

        Raises
        ------
        ValueError
            In schemes whose functions have edges, of which Laplacians are not square integrable.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square))
        >>> f = space.project(lambda points, normals: points[:, 0] ** 2)
        >>> round(float(f @ space.bilaplace() @ f), 9)  # 2^2 on an area of 2
        8.0
        """
        scheme = self.surface.topology.rules.scheme
        if scheme.local:
            raise ValueError(
                f"bilaplace needs functions with one tangent plane across edges, which those of "
                f"scheme {scheme.name!r} have not"
            )
        basis = self.chosen(quadrature, 2, "curvature")
        points = self.surface.points
        return forms.bilaplace(basis, self.pattern, points, threads(workers))

    def _matrix(self, basis: Basis, form: Any, workers: int) -> csr_array[Any]:
        """The matrix of a form of first derivatives."""
        points = self.surface.points

        def terms(block: Block) -> forms.Terms:
            found: forms.Terms = form(forms.components(basis, block, points, forms.FIRST[1:]))
            return found

        return forms.matrix(basis, self.pattern, terms, threads(workers))

    def load(
        self, f: Function, *, quadrature: Quadrature | None = None, workers: int = 1
    ) -> Floats:
        """Integrals over the surface of a function times each function of the space.

        Parameters
        ----------
        f : callable
            As for `interpolate`. It may be called in several threads at once if `workers` says so.
        quadrature, workers
            As for `mass`.

        Returns
        -------
        array, (n, ...)

        Raises
        ------
        TypeError, ValueError
            As `interpolate` does.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> load = ls.Space(ls.LimitSurface(square)).load(lambda points, normals: points[:, 0])
        >>> round(float(load.sum()), 12)  # the integral of x
        2.0
        """
        basis = self.chosen(quadrature, 1, "metric")
        return forms.load(basis, f, self.surface.points, threads(workers))

    def assemble(
        self, terms: Sequence[Term], *, quadrature: Quadrature | None = None, workers: int = 1
    ) -> csr_array[Any]:
        """The matrix of a form of your own: sums of products of two derivatives.

        Entry (i, j) is the sum over terms (nu, mu, c) and points of the quadrature of ``weight * c
        * D^nu f_i * D^mu f_j``, where derivatives are with respect to u and v of limit faces. On
        the surface c has the area element as a factor, and others from `geometry`.

        Parameters
        ----------
        terms : sequence of ((int, int), (int, int), array_like)
            Orders of derivatives, and a coefficient at each point, or one number for all.
        quadrature : Quadrature, optional
            The points; by default those of ``ls.quadrature(space.surface)``.
        workers : int
            Threads, as for `LimitSurface.evaluate`; matrices are the same for any number.

        Returns
        -------
        csr_array, (n, n)
            On the pattern of `mass`. Symmetric to the last digit if terms are: if with each (nu,
            mu, c) there is (mu, nu, c).

        Raises
        ------
        ValueError
            For coefficients of another shape than that of the points, or that are not finite.

        Examples
        --------
        >>> import limitsurf as ls
        >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
        >>> space = ls.Space(ls.LimitSurface(square))
        >>> q = ls.quadrature(space.surface)
        >>> at = space.geometry(q)
        >>> mass = space.assemble([((0, 0), (0, 0), at.area)], quadrature=q)
        >>> bool(abs(mass - space.mass()).max() < 1e-15)
        True
        """
        if quadrature is None:
            if "ls.quadrature" not in self._rules:
                self._rules["ls.quadrature"] = _default(self.surface, 4, "metric")
            quadrature = self._rules["ls.quadrature"]
        self._check(quadrature)
        summed = forms.summed(terms, len(quadrature))
        order = max((sum(nu) for pair in summed for nu in pair), default=0)
        basis = self.basis(quadrature, order)
        symmetric = forms.is_symmetric(summed)

        def own(block: Block) -> forms.Terms:
            at = quadrature.weights[block.points]
            return {
                (nu, mu): c[block.points] * at
                for (nu, mu), c in summed.items()
                if not symmetric or nu >= mu
            }

        return forms.matrix(basis, self.pattern, own, threads(workers), symmetric)


def _same_functions(one: Space, other: Space) -> bool:
    """Whether cages have the same functions: faces, tags and rules, wherever their points are."""
    meshes = (space.cage.mesh for space in (one, other))
    arrays = ([x.sizes, x.indices, x.holes, *x.creases, *x.corners] for x in meshes)
    return one.cage.rules == other.cage.rules and all(map(np.array_equal, *arrays))


def _default(surface: LimitSurface, points: int, integrand: Kind) -> Quadrature:
    return quadrature(surface, points=points, integrand=integrand)
