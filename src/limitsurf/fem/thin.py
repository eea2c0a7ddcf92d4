"""Thin shells on the limit surface itself: Koiter's linear model, of first-order kinematics."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limitsurf.caching import cached_property
from limitsurf.cage.checks import checked_integer, checked_number, count
from limitsurf.engine.packing import over_chunks
from limitsurf.engine.protocol import threads
from limitsurf.fem import forms
from limitsurf.fem.checks import power_of_two, reals
from limitsurf.fem.creases import Hinges, held, hinges
from limitsurf.fem.modes import Eigenmodes, lowest
from limitsurf.fem.space import Space
from limitsurf.fem.supports import (
    Support,
    conditions,
    described,
    independent,
    motions_left,
    null_space,
    rigid_motions,
    values_at,
)
from limitsurf.integrals.sums import cross

if TYPE_CHECKING:
    from limitsurf.fem.basis import Block
    from limitsurf.integrals.quadrature import Quadrature
    from limitsurf.surface import LimitSurface

Array = NDArray[Any]
Function: TypeAlias = Callable[[Array, Array], ArrayLike]

# the least eigenvalue, relative to the norm, that is no rounding
_SINGULAR = 1e-14
_SHIFT = 1e-10  # of the largest eigenvalue, from below 0, for modes without energy
# derivatives that strains come from, in the order of columns below
_ORDERS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
# second derivatives by parameters 1 and 2 as strains have them: 11, 22, 12
_SECOND = (2, 4, 3)


def strain_rows(jets: Array) -> tuple[Array, Array, Array]:
    """How strains come from derivatives of displacements, in a frame of unit vectors.

    With E_1 along the first derivative and E_2 across, the strains (11, 22, twice 12) are sums over
    derivatives r and components c of these (..., 3, 5, 3), membrane and bending, times derivatives
    of the displacement; and area elements (...). Of derivatives (..., 5, 3) of the surface, in the
    order of `_ORDERS`. ``derivations/thin_shells.py``, 1 and 3.
    """
    a1, a2 = jets[..., 0, :], jets[..., 1, :]
    across = cross(a1, a2)
    area = np.sqrt((across * across).sum(axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        n = across / area[..., None]
        length = np.sqrt((a1 * a1).sum(axis=-1))
        e1 = a1 / length[..., None]
        slant = (a2 * e1).sum(axis=-1)
        t11, t22 = 1 / length, length / area
        t12 = -slant * t11 * t22
    membrane, bending = np.zeros((2, *area.shape, 3, 5, 3))
    membrane[..., 0, 0, :] = a1
    membrane[..., 1, 1, :] = a2
    membrane[..., 2, 0, :], membrane[..., 2, 1, :] = a2, a1
    one, other = cross(a2, n), cross(n, a1)
    for row, column in enumerate(_SECOND):
        second = jets[..., column, :]
        height = (n * second).sum(axis=-1)[..., None]
        factor = (1 + (row == 2)) / area[..., None]
        bending[..., row, 0, :] = factor * (cross(second, a2) + height * one)
        bending[..., row, 1, :] = factor * (cross(a1, second) + height * other)
        bending[..., row, column, :] = -(1 + (row == 2)) * n
    turn = np.zeros((*area.shape, 3, 3))
    turn[..., 0, 0] = t11 * t11
    turn[..., 1, 0], turn[..., 1, 1], turn[..., 1, 2] = t12 * t12, t22 * t22, t12 * t22
    turn[..., 2, 0], turn[..., 2, 2] = 2 * t11 * t12, t11 * t22
    shape = (*area.shape, 3, 15)
    found = [
        np.matmul(turn, rows.reshape(shape)).reshape(rows.shape) for rows in (membrane, bending)
    ]
    return found[0], found[1], area


class ThinShell:
    """A thin shell on the limit surface of a space: Koiter's linear model, plane stress.

    Displacements are functions of the space with three components, coefficients (n, 3) in the order
    of its unknowns; matrices have ``3 n`` rows, the components of an unknown together, as
    ``coefficients.ravel()`` has them. Units are the caller's: those of the points, of force, and
    what follows for moduli (force per area) and energies.

    Parameters
    ----------
    space : Space
        Of a scheme whose surfaces have tangent planes, with points of three columns.
    young : float or (n_faces,) array_like
        Young's modulus, positive; one for all, or one for each face of the cage,
        ``space.cage.mesh``.
    poisson : float or (n_faces,) array_like
        Poisson's ratio, in (-1, 0.5].
    thickness : float or (n_faces,) array_like
        Positive.
    density : float or (n_faces,) array_like
        Mass per unit of volume, not negative; for masses and gravity.
    quadrature : Quadrature, optional
        On ``space.surface``; by default 4 points per direction and rings for products of second
        derivatives. Five points change deflections of coarse cages by some 1e-5 of them.
    stiff_creases : bool
        Whether infinitely sharp creases within the shell keep their angle: by a penalty of
        ``10 D / l`` per length, with the bending modulus ``D = E h^3 / (12 (1 - nu^2))`` of the
        softer side and the mean size ``l`` of both faces across the crease. Otherwise they are
        hinges, of which a warning tells. Where more than two faces meet at an edge, or where they
        are turned against each other, there are hinges in any case.

    Raises
    ------
    TypeError
        For a space of exact points, or what is no space.
    ValueError
        For a scheme without tangent planes, points that are not (n, 3), moduli out of range, or
        values of faces in a refined space of a scheme whose finer faces are on several coarser
        ones ("doo-sabin").

    Notes
    -----
    What is stored is the integral of membrane and bending strains squared
    (``derivations/thin_shells.py``), after Cirak, Ortiz and Schroeder, "Subdivision surfaces: a new
    paradigm for thin-shell finite-element analysis" (2000). Coarse cages of thin shells are too
    stiff (they lock): refine the space until answers settle.

    Examples
    --------
    A square plate, clamped all around, under a pressure:

    >>> import numpy as np
    >>> import limitsurf as ls
    >>> from limitsurf.fem.supports import clamped
    >>> plane = [[x, y, 0] for y in range(5) for x in range(5)]
    >>> quads = [[k, k + 1, k + 6, k + 5] for k in range(19) if k % 5 < 4]
    >>> space = ls.Space(ls.LimitSurface(ls.Mesh(np.array(plane) / 4, quads)), levels=1)
    >>> shell = ls.ThinShell(space, young=1e6, poisson=0.3, thickness=0.01)
    >>> found = shell.solve(shell.load(pressure=-1.0), clamped(where=lambda x: x[:, 0] < 2))
    >>> stiff = 1e6 * 0.01**3 / 12 / (1 - 0.3**2)
    >>> deepest = found.displacement.evaluate(22, 0.0, 0.0)[2]  # at the middle
    >>> round(float(deepest * stiff), 5)  # -0.00127 after Timoshenko
    -0.00127
    """

    def __init__(
        self,
        space: Space,
        *,
        young: ArrayLike,
        poisson: ArrayLike,
        thickness: ArrayLike,
        density: ArrayLike = 0.0,
        quadrature: Quadrature | None = None,
        stiff_creases: bool = False,
    ) -> None:
        if not isinstance(space, Space):
            raise TypeError(f"a shell needs a Space, got {type(space).__name__}")
        scheme = space.surface.topology.rules.scheme
        if scheme.local:
            raise ValueError(
                f"thin shells need surfaces with one tangent plane across edges, which those of "
                f"scheme {scheme.name!r} have not"
            )
        self.space = space
        self.young = self._per_face("young", young, lambda x: x > 0, "positive")
        self.poisson = self._per_face(
            "poisson", poisson, lambda x: (x > -1) & (x <= 0.5), "in (-1, 0.5]"
        )
        self.thickness = self._per_face("thickness", thickness, lambda x: x > 0, "positive")
        self.density = self._per_face("density", density, lambda x: x >= 0, "not negative")
        self._basis = space.chosen(quadrature, 2, "curvature")
        self.stiff_creases = stiff_creases
        if not stiff_creases and len(self._hinges.corners):
            warnings.warn(
                f"the shell has {count(len(self._hinges.corners), 'edge')} on infinitely sharp "
                "creases, which are hinges: stiff_creases=True keeps their angles",
                UserWarning,
                stacklevel=2,
            )
        apart = int(space.surface.mesh.nonmanifold_edge.sum())
        if apart:
            warnings.warn(
                f"the shell has {count(apart, 'edge')} at which more than two faces meet, or whose "
                "faces are turned against each other: its parts are hinged there",
                UserWarning,
                stacklevel=2,
            )

    def _per_face(self, name: str, given: ArrayLike, good: Any, need: str) -> Array:
        """One value for each limit face of the space's surface, from those of faces of the cage."""
        n = self.space.cage.mesh.n_faces
        values = reals(name, given)
        if values.shape not in ((), (n,)):
            raise ValueError(f"{name}: got shape {values.shape}, need a number, or {n}, one a face")
        bad = ~(np.isfinite(values) & good(values))
        if bad.any():
            where = f" at face {int(np.flatnonzero(bad)[0])}" if values.ndim else ""
            raise ValueError(f"{name} must be {need}, got {values[bad].flat[0]}{where}")
        n_faces = len(self.space.surface.limit_faces)
        return np.broadcast_to(values, n_faces) if not values.ndim else values[self._parent]

    @cached_property
    def _parent(self) -> Array:
        """The face of the cage of each limit face, the last one where there is no limit."""
        return self.space.parents

    @cached_property
    def _hinges(self) -> Hinges:
        return hinges(self.space)

    # --- Matrices

    def stiffness(self, *, workers: int = 1) -> Any:
        """The stiffness matrix: twice the energy of displacements x is ``x @ K @ x``.

        Returns
        -------
        csr_array, (3 n, 3 n)
            Symmetric to the last digit.
        """
        points = self.space.surface.points

        def work(part: slice) -> tuple[int, Array, Array]:
            block = self._basis.blocks[part.start]
            return block.group, block.rows, self._elements(block, points)

        blocks = over_chunks(len(self._basis.blocks), threads(workers), work, 1)
        found = self.space.pattern.vectors(blocks)
        if self.stiff_creases and len(self._hinges.corners):
            plane = self.young * self.thickness / (1 - self.poisson**2)
            found = found + held(self.space, self._hinges, plane, self.thickness)
        return found

    def _elements(self, block: Block, points: Array) -> Array:
        """Matrices of a block, as blocks (F, C (C + 1) / 2, 3, 3) of pairs of functions."""
        at = forms.components(self._basis, block, points, _ORDERS)
        jets = np.stack([np.moveaxis(at.jet[nu], 0, 2) for nu in _ORDERS], axis=2)  # (F, P, 5, 3)
        membrane, bending, _ = strain_rows(jets)
        thickness, poisson = self.thickness[block.face], self.poisson[block.face]
        plane = self.young[block.face] * thickness / (1 - poisson**2)
        root = _root(poisson)[:, None, :, :]  # (F, 1, 3, 3)
        bent = thickness / at.unit[:, 0] / np.sqrt(12)
        rows = np.concatenate(
            [root @ _flat(membrane), bent[:, None, None, None] * (root @ _flat(bending))], axis=2
        )  # (F, P, 6, 15)
        f, p = rows.shape[:2]
        c = block.controls.shape[1]
        rows = np.ascontiguousarray(rows.reshape(f, p, 6, 5, 3).swapaxes(3, 4).reshape(f, p, 18, 5))
        if block.table is not None:
            values = np.stack([block.table.of(nu) for nu in _ORDERS], axis=1)  # (P, 5, C)
        else:
            found = block.values()
            values = np.stack([found[nu] for nu in _ORDERS], axis=2)  # (F, P, 5, C)
        strains = np.matmul(rows, values).reshape(f, 6 * p, 3 * c)
        weights = np.repeat(plane[:, None] * at.own_measure, 6, axis=1)
        whole = np.matmul((strains * weights[:, :, None]).swapaxes(1, 2), strains)
        whole = whole.reshape(f, 3, c, 3, c)
        i, j = np.triu_indices(c)
        pairs = np.moveaxis(whole[:, :, i, :, j], 0, 1)  # (F, E, 3, 3)
        same = np.flatnonzero(i == j)
        pairs[:, same] = (pairs[:, same] + pairs[:, same].swapaxes(2, 3)) / 2
        return np.asarray(pairs)

    def mass(self, *, workers: int = 1) -> Any:
        """The mass matrix (3 n, 3 n): density times thickness times area, of translations only.

        Returns
        -------
        csr_array
        """
        from scipy.sparse import eye_array, kron

        basis, points = self.space.chosen(None, 1, "metric"), self.space.surface.points
        heavy = self.density * self.thickness

        def terms(block: Block) -> forms.Terms:
            at = forms.components(basis, block, points, forms.FIRST[1:])
            return {((0, 0), (0, 0)): heavy[block.face][:, None] * at.measure}

        found = forms.matrix(basis, self.space.pattern, terms, threads(workers))
        return kron(found, eye_array(3), format="csr")

    # --- Loads and answers

    def load(
        self,
        *,
        traction: ArrayLike | Function | None = None,
        pressure: ArrayLike | Function | None = None,
        gravity: ArrayLike | None = None,
        points: Sequence[tuple[int, float, float, ArrayLike]] = (),
        workers: int = 1,
    ) -> Array:
        """What loads do to each unknown: the sum of all that is given.

        Parameters
        ----------
        traction : (3,) or (n_faces, 3) array_like, or callable, optional
            Force per area; for each face of the cage, or ``f(points, normals)`` as for
            `Space.load`.
        pressure : float or (n_faces,) array_like, or callable, optional
            Force per area along the normal, against it if negative.
        gravity : (3,) array_like, optional
            Acceleration, times density and thickness.
        points : sequence of (face, u, v, force)
            Forces (3,) at places: limit faces of ``space.surface``, and parameters.
        workers : int
            Threads, as for `LimitSurface.evaluate`.

        Returns
        -------
        array, (n, 3)
        """
        n_faces = self.space.cage.mesh.n_faces
        total = np.zeros((self.space.n, 3))
        each = np.zeros((len(self.young), 3))
        along = np.zeros(len(self.young))
        called: list[Function] = []
        if callable(traction):
            called.append(traction)
        elif traction is not None:
            each = each + self._given("traction", traction, (3,), n_faces)
        if callable(pressure):
            called.append(lambda x, n, f=pressure: _along_normals(f, x, n))  # type: ignore[misc]
        elif pressure is not None:
            along = along + self._given("pressure", pressure, (), n_faces)
        if gravity is not None:
            own = self._given("gravity", gravity, (3,), 0)
            each = each + (self.density * self.thickness)[:, None] * own
        basis, cage = self.space.chosen(None, 1, "metric"), self.space.surface.points
        for f in called:
            found = forms.load(basis, f, cage, threads(workers))
            if found.shape != total.shape:
                raise ValueError(
                    "a traction must give vectors (m, 3) at m points, and a pressure numbers (m,)"
                )
            total += found
        if each.any() or along.any():

            def values(block: Block, _: Array, normals: Array) -> Array:
                count = block.points.shape[1]
                own = np.repeat(block.face, count)
                return each[own] + along[own, None] * normals

            total += forms.load_of_blocks(basis, values, cage, threads(workers))
        return total + self._at_points(points)

    def _given(self, name: str, given: Any, each: tuple[int, ...], n: int) -> Array:
        """One value, or one for each limit face."""
        values = reals(name, given)
        if values.shape not in (each, (n, *each)):
            more = f", or {(n, *each)}, one a face" if n else ""
            raise ValueError(f"{name}: got shape {values.shape}, need {each}{more}")
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite")
        return values if values.shape == each else values[self._parent]

    def _at_points(self, points: Sequence[tuple[int, float, float, ArrayLike]]) -> Array:
        points = list(points)
        if not points:
            return np.zeros((self.space.n, 3))
        for k, point in enumerate(points):
            if not isinstance(point, (tuple, list)) or len(point) != 4:
                raise ValueError(f"points: number {k} must be (face, u, v, force), got {point!r}")
        face, u, v, force = (list(x) for x in zip(*points, strict=True))
        forces = reals("points: forces", force)
        if forces.shape != (len(points), 3) or not np.isfinite(forces).all():
            raise ValueError(
                f"points: forces must be finite vectors of 3, got shape {forces.shape}"
            )
        return np.asarray(values_at(self.space, face, u, v, "points").T @ forces)

    def solve(self, loads: ArrayLike, *supports: Support, workers: int = 1) -> ShellSolution:
        """Displacements under loads.

        Parameters
        ----------
        loads : (n, 3) array_like
            From `load`, or sums of these.
        supports
            From `limitsurf.fem.supports`.
        workers : int
            Threads for the matrix, as for `LimitSurface.evaluate`.

        Returns
        -------
        ShellSolution

        Raises
        ------
        ValueError
            For loads of another shape, that are not finite or all zero, supports that leave rigid
            motions (how many, and which), loads that do not balance where rigid motions have been
            removed, and shells that bend without energy (mechanisms).
        """
        f = self._checked_loads(loads)
        free, left = self._free(supports)
        if left is not None:
            unbalanced, most = np.abs(left.T @ f), abs(left).max(axis=0).toarray()
            if (unbalanced > 1e-9 * most * np.abs(f).sum()).any():
                raise ValueError(
                    "loads do not balance: there are supports against rigid motions alone "
                    "(rigid_modes_removed), which bear nothing"
                )
        K = self.stiffness(workers=workers)
        x = np.zeros(len(f))  # where supports hold all
        if free.shape[1]:
            x = free @ _solver((free.T @ K @ free).tocsc())(free.T @ f)
        reactions = K @ x - f
        energy = float(x @ (K @ x)) / 2
        shape = self.space.n, 3
        return ShellSolution(self, x.reshape(shape), reactions.reshape(shape), energy)

    def _checked_loads(self, loads: ArrayLike) -> Array:
        f = reals("loads", loads)
        if f.shape != (self.space.n, 3):
            raise ValueError(f"loads: got shape {f.shape}, need {(self.space.n, 3)}, from load()")
        if not np.isfinite(f).all():
            raise ValueError("loads must be finite")
        if not f.any():
            raise ValueError("loads are all zero: nothing would move")
        return f.ravel()

    def _free(self, supports: Sequence[Support], modes: bool = False) -> tuple[Any, Any]:
        """What supports leave free, and rigid motions that were removed, if they were."""
        from scipy.sparse import csr_array, diags_array, vstack

        rows = conditions(self.space, supports)
        rigid = rigid_motions(self.space)
        scaled = abs(rows).sum(axis=1)
        left = motions_left(diags_array(1 / np.where(scaled > 0, scaled, 1)) @ (rows @ rigid))
        if not left.shape[1] or modes:
            return null_space(rows), None
        if not any(one.kind == "rigid modes" for one in supports):
            raise ValueError(
                f"supports leave {count(left.shape[1], 'rigid motion')}: the shell "
                f"{described(left)}; hold it, or give rigid_modes_removed() where loads balance"
            )
        motions = rigid @ left
        pivot = independent(motions)
        here = np.arange(len(pivot))
        more = csr_array((np.ones(len(pivot)), (here, pivot)), shape=(len(pivot), 3 * self.space.n))
        return null_space(vstack([rows, more], format="csr")), motions

    def modes(self, k: int, *supports: Support, workers: int = 1) -> Eigenmodes:
        """Free vibrations: the k lowest eigenvalues of stiffness over mass.

        Parameters
        ----------
        k : int
            How many, rigid motions and all copies of multiple ones included.
        supports
            From `limitsurf.fem.supports`; none leave six rigid motions of each part.
        workers : int
            Threads for the matrices, as for `LimitSurface.evaluate`.

        Returns
        -------
        Eigenmodes
            ``eigenvalues`` (k,), squares of angular frequencies, ascending, and ``modes`` (n, 3, k)
            of mass 1.

        Raises
        ------
        ValueError
            Without a density, for a k out of range, or with `rigid_modes_removed`, since to hold
            single unknowns changes vibrations.
        """
        if not (self.density > 0).all():
            raise ValueError("modes need a density above 0 everywhere: ThinShell(..., density=)")
        if any(isinstance(one, Support) and one.kind == "rigid modes" for one in supports):
            raise ValueError(
                "modes has no use for rigid_modes_removed: rigid motions come first, with "
                "eigenvalues that are 0 up to rounding; leave them out of what is returned"
            )
        free, _ = self._free(supports, modes=True)
        if not free.shape[1]:
            raise ValueError("supports hold all that could move: there are no modes")
        K, M = (
            (free.T @ x @ free).tocsr()
            for x in (self.stiffness(workers=workers), self.mass(workers=workers))
        )
        k = checked_integer("k", k, 1)
        if k > K.shape[0]:
            raise ValueError(f"k must be 1 to {K.shape[0]}, the number of unknowns, got {k}")
        shift = -_SHIFT * float((K.diagonal() / M.diagonal()).max())
        found = lowest(K, M, k, shift)
        modes = (free @ found.modes).reshape(self.space.n, 3, k)
        return Eigenmodes(found.eigenvalues, modes)

    # --- What displacements do to the shell

    def strains(
        self, x: ArrayLike, face: ArrayLike, u: ArrayLike, v: ArrayLike, *, workers: int = 1
    ) -> tuple[Array, Array]:
        """Membrane and bending strains of displacements, tensors in space that are tangential.

        Parameters
        ----------
        x : (n, 3) array_like
        face, u, v : array_like
            Limit faces of ``space.surface``, and parameters; they broadcast.
        workers : int
            Threads, as for `LimitSurface.evaluate`.

        Returns
        -------
        membrane, bending : (..., 3, 3)
            At the height z along the normal the strain is ``membrane + z * bending``. NaN where the
            surface has no tangent plane.
        """
        frame, *strains = self._strains(x, face, u, v, workers)
        one, other = (z * np.array([1.0, 1.0, 0.5]) for z in strains)
        return _in_space(frame, one), _in_space(frame, other)

    def resultants(
        self, x: ArrayLike, face: ArrayLike, u: ArrayLike, v: ArrayLike, *, workers: int = 1
    ) -> tuple[Array, Array]:
        """Membrane forces per length and bending moments per length, tensors in space.

        Parameters are those of `strains`.

        Returns
        -------
        forces, moments : (..., 3, 3)
        """
        frame, membrane, bending = self._strains(x, face, u, v, workers)
        face = np.broadcast_arrays(face, u, v)[0]
        h = self.thickness[face][..., None]
        one, other = (self._stress(face, z) for z in (membrane, bending))
        return _in_space(frame, h * one), _in_space(frame, h * (h * (h * other)) / 12)

    def stresses(
        self,
        x: ArrayLike,
        face: ArrayLike,
        u: ArrayLike,
        v: ArrayLike,
        *,
        height: float = 0.0,
        workers: int = 1,
    ) -> Array:
        """Stresses of displacements, tensors in space that are tangential.

        Parameters
        ----------
        x, face, u, v, workers
            As of `strains`.
        height : float
            Where in the shell: -1 at its lower, 0 in its middle, 1 at its upper side, on which the
            normal is.

        Returns
        -------
        (..., 3, 3)
        """
        frame, membrane, bending = self._strains(x, face, u, v, workers)
        face = np.broadcast_arrays(face, u, v)[0]
        z = checked_number("height", height) * self.thickness[face][..., None] / 2
        return _in_space(frame, self._stress(face, membrane + z * bending))

    def _strains(
        self, x: ArrayLike, face: ArrayLike, u: ArrayLike, v: ArrayLike, workers: int
    ) -> tuple[Array, Array, Array]:
        """Unit vectors (..., 2, 3), and strains (..., 3): 11, 22 and twice 12."""
        surface = self.space.surface
        coefficients = reals("displacements", x)
        if coefficients.shape != (self.space.n, 3):
            raise ValueError(
                f"displacements: got shape {coefficients.shape}, need {(self.space.n, 3)}, as the "
                "coefficients of a solution"
            )
        moved = self.space.function(coefficients)
        jets = []
        for one in (surface, moved):
            jet = one.jet(face, u, v, order=2, workers=workers)
            jets.append(np.stack([jet[nu] for nu in _ORDERS], axis=-2))
        unit = power_of_two(jets[0][..., :2, :], (-2, -1))
        jets = [jet / unit for jet in jets]
        membrane, bending, _ = strain_rows(jets[0])
        a1, a2 = jets[0][..., 0, :], jets[0][..., 1, :]
        n = cross(a1, a2)
        with np.errstate(invalid="ignore", divide="ignore"):
            e1 = a1 / np.linalg.norm(a1, axis=-1, keepdims=True)
            n = n / np.linalg.norm(n, axis=-1, keepdims=True)
        frame = np.stack([e1, cross(n, e1)], axis=-2)
        one, other = (np.einsum("...src,...rc->...s", z, jets[1]) for z in (membrane, bending))
        return frame, one, other / unit[..., 0]

    def _stress(self, face: Array, strain: Array) -> Array:
        """Plane stress (..., 3), 11, 22 and 12, of strains."""
        nu, young = self.poisson[face], self.young[face]
        plane = young / (1 - nu**2)
        one, other, twice = (strain[..., k] for k in range(3))
        return np.stack(
            [
                plane * (one + nu * other),
                plane * (other + nu * one),
                plane * (1 - nu) / 2 * twice,
            ],
            axis=-1,
        )


def _along_normals(f: Function, x: Array, normals: Array) -> Array:
    """A pressure at points as a traction."""
    found, each = forms.given(f, x, normals)
    if each:
        raise ValueError(f"pressure must give one number (m,) at each of m points, got {each}")
    return found * normals


def _solver(matrix: Any) -> Callable[[Array], Array]:
    """What solves with a positive matrix; a ValueError if it is not positive, up to rounding."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import norm

    diagonal = matrix.diagonal()
    good = bool((diagonal > 0).all())
    if good:
        # the same size for all unknowns, whatever the units and however thin the shell
        size = np.ldexp(1.0, -(np.frexp(diagonal)[1] // 2))
        own = (diags_array(size) @ matrix @ diags_array(size)).tocsc()
        try:
            found = forms.factors(own)
            v = np.random.default_rng(0).normal(size=len(size))
            for _ in range(2):  # towards what moves with the least energy
                v = found.solve(v / np.linalg.norm(v))
            good = bool(1 / np.linalg.norm(v) > _SINGULAR * norm(own, 1))
        except ValueError:  # a pivot is exactly 0
            good = False
    if not good:
        raise ValueError(
            "the shell moves without energy: creases that are hinges make it a mechanism "
            "(stiff_creases=True keeps their angles), or functions of the space depend on each "
            "other (as on a cube: levels=1 parts them)"
        )
    return lambda b: size * found.solve(size * b)


@dataclass(frozen=True, eq=False, repr=False)
class ShellSolution:
    """What `ThinShell.solve` returns.

    Attributes
    ----------
    shell : ThinShell
    coefficients : (n, 3)
        Of the displacement.
    reactions : (n, 3)
        Forces of the supports on each unknown; their sum is the force on the whole.
    energy : float
        What is stored: half the work of the loads.

    Examples
    --------
    A strip held at one end, under its weight, and the energy and deflection of a beam:

    >>> import numpy as np
    >>> import limitsurf as ls
    >>> from limitsurf.fem.supports import clamped
    >>> plane = [[x, y, 0] for y in range(2) for x in range(9)]
    >>> quads = [[k, k + 1, k + 10, k + 9] for k in range(8)]
    >>> space = ls.Space(ls.LimitSurface(ls.Mesh(plane, quads)))
    >>> shell = ls.ThinShell(space, young=1e6, poisson=0.0, thickness=0.5, density=0.25)
    >>> weight = shell.load(gravity=[0, 0, -8])
    >>> found = shell.solve(weight, clamped(where=lambda x: x[:, 0] < 1e-9))
    >>> np.allclose(found.reactions.sum(axis=0), [0, 0, 8])
    True
    >>> bending, q, length = 1e6 * 0.5**3 / 12, 0.25 * 0.5 * 8, 8  # q: weight per length
    >>> end = found.displacement.evaluate(7, 1.0, 1.0)[2]
    >>> bool(np.isclose(end, -q * length**4 / (8 * bending)))
    True
    >>> bool(np.isclose(found.energy, q**2 * length**5 / (40 * bending), rtol=1e-4))
    True
    """

    shell: ThinShell
    coefficients: Array
    reactions: Array
    energy: float

    def __repr__(self) -> str:
        most = float(np.abs(self.coefficients).max(initial=0))
        n = len(self.coefficients)
        return f"ShellSolution({n} functions, {most:.3g} at most, energy {self.energy:.3g})"

    @property
    def displacement(self) -> LimitSurface:
        """The displacement as a function: ``evaluate`` gives vectors (..., 3)."""
        return self.shell.space.function(self.coefficients)

    def deformed(self, scale: float = 1.0) -> LimitSurface:
        """The surface moved by so many times the displacement."""
        surface = self.shell.space.surface
        moves = self.shell.space.function(self.coefficients).points
        return surface.with_points(surface.points + scale * moves)


def _in_space(frame: Array, tensor: Array) -> Array:
    """Tensors (..., 3, 3) of components 11, 22 and 12 in a frame (..., 2, 3)."""
    square = tensor[..., [0, 2, 2, 1]].reshape(*tensor.shape[:-1], 2, 2)
    return np.asarray(frame.swapaxes(-1, -2) @ square @ frame)


def _flat(rows: Array) -> Array:
    return rows.reshape(*rows.shape[:-2], 15)


def _root(poisson: Array) -> Array:
    """Matrices (F, 3, 3) whose squares, R.T @ R, are the moduli of plane stress over E' = 1."""
    root = np.zeros((len(poisson), 3, 3))
    root[:, 0, 0], root[:, 0, 1] = 1, poisson
    root[:, 1, 1] = np.sqrt(1 - poisson**2)
    root[:, 2, 2] = np.sqrt((1 - poisson) / 2)
    return root
