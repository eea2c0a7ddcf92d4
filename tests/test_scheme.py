"""Schemes as values: lattices, splines and masks; and what is derived from those of Loop.

Against polynomials typed from a paper, a naive refinement of triangles, and closed forms.
"""

import copy
import dataclasses
import functools
import itertools
import pickle
from collections import Counter
from fractions import Fraction as F

import mpmath
import numpy as np
import pytest
import sympy

import limitsurf as ls
from limitsurf import tables
from limitsurf._kernels import reference
from limitsurf.exact.fixed import BITS, mp, to_mpf
from limitsurf.exact.matrices import subdivision_matrix
from limitsurf.exact.sectors import limit_weights
from limitsurf.exact.spectrum import dense_basis, spectrum
from limitsurf.exact.symbolic import SymbolicBasis
from limitsurf.exact.symbolic_sectors import SectorBasis
from limitsurf.numbers import FLOAT64, RATIONAL
from limitsurf.scheme.catmull_clark import CATMULL_CLARK
from limitsurf.scheme.lattice import QUADS, TRIANGLES
from limitsurf.scheme.loop import LOOP
from limitsurf.scheme.spline import BICUBIC, QUARTIC

LATTICES = pytest.mark.parametrize("lattice", [QUADS, TRIANGLES], ids=lambda x: x.name)
SCHEMES = pytest.mark.parametrize("scheme", [CATMULL_CLARK, LOOP], ids=lambda x: x.name)
OUTER = [(3, 0), (3, 1), (2, 2), (1, 3), (0, 3)]
BEYOND = [(4, 0), (4, 1), (3, 2), (2, 3), (1, 4), (0, 4)]

# Stam, Evaluation of Loop subdivision surfaces (1999), appendix A: the weights of a corner, of what
# lies across an edge, and of what lies beyond a corner, times 12; w = 1 - u - v
CORNER = (
    "6w4 + 24uw3 + 24u2w2 + 8u3w + u4 + 24vw3 + 60uvw2 + 36u2vw + 6u3v + 24v2w2 + 36uv2w"
    " + 12u2v2 + 8v3w + 6uv3 + v4"
)
ACROSS = "u4 + 6u3w + 12u2w2 + 6uw3 + w4 + 2u3v + 6u2vw + 6uvw2 + 2vw3"
BEYOND_CORNER = "u4 + 2u3v"


def terms(text):
    """{(powers of u, v, w): weight}."""
    found = {}
    for term in text.replace(" ", "").split("+"):
        number = "".join(itertools.takewhile(str.isdigit, term))
        powers = dict.fromkeys("uvw", 0)
        rest = term[len(number) :]
        while rest:
            power = "".join(itertools.takewhile(str.isdigit, rest[1:]))
            powers[rest[0]] = int(power or 1)
            rest = rest[1 + len(power) :]
        found[powers["u"], powers["v"], powers["w"]] = int(number or 1)
    return found


def barycentric(text, u, v, w):
    return sum(x * u**i * v**j * w**k for (i, j, k), x in terms(text).items()) / 12


def typed_weights(u, v):
    """Weights of the twelve control points of a quartic triangle, by place."""
    w = 1 - u - v
    corner, across, beyond = (
        functools.partial(barycentric, text) for text in (CORNER, ACROSS, BEYOND_CORNER)
    )
    return {
        (1, 1): corner(u, v, w),
        (2, 1): corner(w, v, u),
        (1, 2): corner(u, w, v),
        (2, 0): across(u, v, w),
        (0, 2): across(v, u, w),
        (2, 2): across(u, w, v),
        (1, 0): beyond(w, u, v),
        (0, 1): beyond(w, v, u),
        (3, 0): beyond(u, w, v),
        (3, 1): beyond(u, v, w),
        (0, 3): beyond(v, w, u),
        (1, 3): beyond(v, u, w),
    }


# --- lattices -------------------------------------------------------------------------------------


@LATTICES
def test_lattice_is_one(lattice):
    assert pickle.loads(pickle.dumps(lattice)) is lattice
    assert copy.deepcopy(lattice) is lattice


def is_inside(lattice, u, v):
    return all(a + b * u + c * v >= 0 for a, b, c in lattice.sides)


@LATTICES
def test_children_fill_the_domain(lattice):
    assert len(lattice.children) == lattice.ratio**2
    rng = np.random.default_rng(0)
    inside = rng.random((100, 2))
    inside = inside[[is_inside(lattice, *p) for p in inside]]
    assert len(inside) > 30
    for u, v in inside:
        within = []
        for child in lattice.children:
            sign = -1 if child.turned else 1
            s, t = (sign * (lattice.ratio * x - o) for x, o in zip((u, v), child.origin))  # noqa: B905
            within.append(is_inside(lattice, s, t))
        assert sum(within) == 1
    assert not is_inside(lattice, F(1, 2), F(-1, 9))
    assert not is_inside(lattice, F(11, 10), F(11, 10))


@LATTICES
def test_turns_map_corners_to_corners(lattice):
    n = lattice.face_size
    for k, ((x, y), (a, b), (c, d)) in enumerate(lattice.turns):
        seen = [(x + s * a + t * c, y + s * b + t * d) for s, t in lattice.corners]
        assert seen == [lattice.corners[(k + j) % n] for j in range(n)]
        assert a * d - b * c == 1


@LATTICES
def test_orientations(lattice):
    """Coordinates are affine, derivatives of any order turn like those of polynomials."""
    n, (u, v) = lattice.face_size, sympy.symbols("u v")
    u0, v0 = F(1, 7), F(2, 5)
    coordinates = reference.coordinates(np.array([u0]), np.array([v0]), lattice.sides)
    affine = [a + b * u + c * v for a, b, c in lattice.sides]
    assert [x[0] for x in coordinates] == [x.subs({u: u0, v: v0}) for x in affine]
    for k, ((x, y), (a, b), (c, d)) in enumerate(lattice.turns):
        s, t = coordinates[k][0], coordinates[(k + 1) % n][0]
        assert (x + s * a + t * c, y + s * b + t * d) == (u0, v0)
    for k, (gradients, against) in enumerate(zip(lattice.gradients, lattice.against, strict=True)):
        sign = -1 if k >= n else 1
        s, t = affine[k % n], affine[(k + 1) % n]
        assert gradients == tuple((sign * x.diff(u), sign * x.diff(v)) for x in (s, t))
        nearer = [F(x.subs({u: 1, v: 1}) - x.subs({u: 0, v: 0})) for x in (s, t, s + t)]
        assert against[:2] == tuple(sign * x < 0 for x in nearer[:2])
        f = (s**2 * t + 3 * s * t**2 - t + s**3).expand()
        x, y = sympy.symbols("x y")
        g = (x**2 * y + 3 * x * y**2 - y + x**3).subs({x: sign * x, y: sign * y})
        for nu in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (2, 1), (0, 3)):
            needed = f.diff(u, nu[0]).diff(v, nu[1]) if sum(nu) else f
            found = sum(
                factors[k] * (g.diff(x, i).diff(y, j) if i or j else g)
                for (i, j), factors in lattice.turned(nu).items()
            ).subs({x: sign * s, y: sign * t}, simultaneous=True)
            assert sympy.expand(found - needed) == 0


@LATTICES
def test_neighbourhoods(lattice):
    assert lattice.valence == {"quads": 4, "triangles": 6}[lattice.name]
    spline = {"quads": BICUBIC, "triangles": QUARTIC}[lattice.name]
    assert lattice.template == spline.template
    if lattice is TRIANGLES:
        assert lattice.outer == tuple(OUTER)
        assert lattice.beyond == tuple(BEYOND)
        assert [len(lattice.parents(p)) for p in ((1, 1), (2, 1), (1, 2), (2, 2))] == [1, 2, 2, 2]
    # the mean of an element is where its point is
    for place in itertools.product(range(5), repeat=2):
        corners = lattice.parents(place)
        assert all(2 * sum(x) == (p + 1) * len(corners) for x, p in zip(zip(*corners), place))  # noqa: B905


# --- splines --------------------------------------------------------------------------------------


def weights_at(spline, s, t):
    """Of the control points, by the polynomials of a spline."""
    monomials = [s**i * t**j for i, j in spline.exponents]
    columns = zip(*spline.pieces, strict=True)
    return [sum(x * y for x, y in zip(column, monomials, strict=True)) for column in columns]


def test_bicubic_piece_is_its_fast_twin():
    s, t = (np.array([F(k, 7), F(1), F(0)], dtype=object) for k in (2, 5))
    for k, twin in enumerate(reference.bicubic_weights(s, t, (0, 0))):
        assert weights_at(BICUBIC, s[k], t[k]) == twin.tolist()
    assert BICUBIC.exponents == tuple((i, j) for j in range(4) for i in range(4))


def test_quartic_piece_is_that_of_the_paper():
    assert len(QUARTIC.exponents) == 15
    for u, v in ((F(0), F(0)), (F(1), F(0)), (F(1, 3), F(1, 5)), (F(2, 7), F(4, 7))):
        found = dict(zip(QUARTIC.template, weights_at(QUARTIC, u, v), strict=True))
        assert found == typed_weights(u, v)


@SCHEMES
def test_a_piece_is_made_of_its_children(scheme):
    """Refined control points by the stencils, on each child, give the same polynomial."""
    lattice, spline = scheme.lattice, scheme.spline
    s, t = F(1, 3), F(1, 4)
    for child in lattice.children:
        sign = -1 if child.turned else 1
        u, v = ((o + sign * x) / 2 for x, o in zip((s, t), child.origin, strict=True))
        total = Counter()
        for near, weight in zip(spline.template, weights_at(spline, s, t), strict=True):
            i, j = child.place(near)
            for (x, y), w in spline.stencil((i - 1, j - 1)).items():
                total[1 + x, 1 + y] += w * weight
        wanted = dict(zip(spline.template, weights_at(spline, u, v), strict=True))
        assert {p: w for p, w in total.items() if w} == {p: w for p, w in wanted.items() if w}


@SCHEMES
def test_curves_are_cubic(scheme):
    cubic = [[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]
    assert [[6 * x for x in row] for row in scheme.spline.curve] == cubic
    assert scheme.spline.curve_stencil(1) == {0: F(1, 2), 1: F(1, 2)}


# --- masks ----------------------------------------------------------------------------------------


def test_weights_of_loop():
    rational = {2: F(39, 128), 3: F(3, 16), 4: F(31, 256), 6: F(1, 16)}
    assert {n: LOOP.vertex_mask(n)[1] for n in rational} == rational
    for n in (5, 7, 8, 30):
        own, beside = LOOP.vertex_mask(n)
        assert sympy.expand(own + n * beside) == 1
        cosine = mpmath.cospi(mpmath.mpf(2) / n)
        needed = (mpmath.mpf(5) / 8 - (mpmath.mpf(3) / 8 + cosine / 4) ** 2) / n
        assert abs(float(beside) - needed) < 1e-15
        assert LOOP.key(n)["masks"][f"vertex({n})"] == [str(own), str(beside)]
    assert LOOP.face_mask(3) == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"edge": (F(1, 4), F(1, 4))}, r"edge is \(1/4, 1/4\), but the quartic box spline needs"),
        ({"vertex": lambda N: (F(1, 2), F(1, 2 * N))}, r"vertex\(6\) is \(1/2, 1/12\), but"),
        ({"vertex": lambda N: (F(1, 2), F(1, 4), F(1, 4))}, r"vertex\(6\) must be 2 Fractions"),
        ({"face": lambda n: (F(1, n),) * n}, r"face\(3\) is \(1/3, 1/3, 1/3\), but"),
        ({"vertex": lambda N: (sympy.sqrt(2), F(1, N))}, r"vertex\(6\) sums to .*, not to 1"),
        ({"boundary_vertex": (F(1), F(0))}, r"boundary_vertex is \(1, 0\), but"),
    ],
)
def test_wrong_masks_of_triangles_are_refused(change, message):
    with pytest.raises(ValueError, match=f"'wicked': {message}"):
        dataclasses.replace(LOOP, name="wicked", **change)


def test_a_mask_may_depend_on_both_ends_of_an_edge():
    def edge(a, b):
        heavy, light = (F(3, 8), F(3, 8)) if a == b else (F(1, 2), F(1, 4))
        return (heavy, light, F(1, 8)) if a <= b else (light, heavy, F(1, 8))

    scheme = dataclasses.replace(LOOP, name="leaning", edge=edge)
    rows = subdivision_matrix(scheme, scheme.sector("interior", 5)).rows
    assert rows[1] == {0: F(1, 2), 1: F(1, 4), 2: F(1, 8), 5: F(1, 8)}
    assert scheme.key(5)["masks"]["edges"] == ["1/2", "1/4", "1/8"]
    regular = subdivision_matrix(scheme, scheme.sector("interior", 6)).rows
    assert regular == subdivision_matrix(LOOP, LOOP.sector("interior", 6)).rows


def test_a_sector_belongs_to_a_lattice():
    assert LOOP.sector("interior", 5) != CATMULL_CLARK.sector("interior", 5)
    assert LOOP.sector("crease", 3, 1) == LOOP.sector("crease", 3, 1)
    with pytest.raises(ValueError, match="'loop' is of triangles, not of quads"):
        subdivision_matrix(LOOP, CATMULL_CLARK.sector("interior", 5))


# --- a local cage of triangles, refined naively ---------------------------------------------------


class LocalCage:
    """Two rings of triangles around vertex 0, named by face and steps along its two edges."""

    def __init__(self, kind, k):
        self.kind, self.k = kind, k
        self.closed = kind in ("interior", "dart", "cone")
        names = [(i, a, b) for i in range(k) for a in range(3) for b in range(3 - a)]
        self.ids = {}
        for place in names:
            self.ids.setdefault(self.key(*place), len(self.ids))
        cells = ((0, 0), (1, 0), (0, 1)), ((1, 1), (0, 1), (1, 0))
        self.faces = [
            tuple(self.at(i, a + x, b + y) for x, y in cell)
            for i in range(k)
            for a, b in ((0, 0), (1, 0), (0, 1))
            for cell in cells
            if all(a + b + x + y <= 2 for x, y in cell)
        ]
        sides = {"dart": [(0, 0)], "crease": [(0, 0), (k - 1, 1)], "corner": [(0, 0), (k - 1, 1)]}
        self.sharp = set()
        for i, side in sides.get(kind, ()):
            curve = [self.at(i, 0, n) if side else self.at(i, n, 0) for n in range(3)]
            self.sharp |= {frozenset(ends) for ends in itertools.pairwise(curve)}

    def key(self, i, a, b):
        if a == b == 0:
            return 0, 0, 0
        if a == 0:
            i, a, b = i + 1, b, 0
        return (i % self.k if self.closed else i), a, b

    def at(self, i, a, b):
        return self.ids[self.key(i, a, b)]

    @staticmethod
    def place(p, x, y):
        """Face and steps of a place of face p: e_(p-1) = e_p - e_(p+1), and so on around."""
        a, b = x - 1, y - 1
        if b < 0:
            return p - 1, -b, a + b
        return (p + 1, a + b, -a) if a < 0 else (p, a, b)

    def places(self, p, which):
        along_u = self.kind not in ("interior", "cone") and p == 0
        along_v = self.kind not in ("interior", "cone") and p == self.k - 1
        kept = [(x, y) for x, y in which if (y or not along_u) and (x or not along_v)]
        return [self.place(p, x, y) for x, y in kept]

    def ring(self):
        last = [] if self.closed else [(self.k - 1, 0, 1)]
        return [(0, 0, 0), *((i, 1, 0) for i in range(self.k)), *last]

    @functools.cached_property
    def opposite(self):
        found = {}
        for face in self.faces:
            for n in range(3):
                found.setdefault(frozenset((face[n - 1], face[n - 2])), []).append(face[n])
        return found

    def refined(self, i, a, b):
        """The form of the refined point that lies so many half steps along."""
        ends = {
            (a // 2, -(-b // 2)) if a % 2 and b % 2 else (a // 2, b // 2),
            (-(-a // 2), b // 2) if a % 2 and b % 2 else (-(-a // 2), -(-b // 2)),
        }
        ends = [self.at(i, *end) for end in sorted(ends)]
        form = Counter()
        if len(ends) == 2:
            edge = frozenset(ends)
            smooth = edge not in self.sharp
            form.update(dict.fromkeys(ends, F(3, 8) if smooth else F(1, 2)))
            across = self.opposite[edge]
            assert len(across) == 2 or not smooth
            form.update(dict.fromkeys(across, F(1, 8)) if smooth else {})
            return dict(form)
        (v,) = ends
        sharp = [w for edge in self.sharp if v in edge for w in edge - {v}]
        if v == 0 and self.kind in ("corner", "cone"):
            return {v: F(1)}
        if len(sharp) == 2:
            return {v: F(3, 4)} | dict.fromkeys(sharp, F(1, 8))
        near = [w for edge in self.opposite if v in edge for w in edge - {v}]
        own, beside = LOOP.vertex_mask(len(near))
        return {v: own} | dict.fromkeys(near, beside)


KINDS = {"interior": range(3, 9), "cone": (3, 5), "dart": (3, 5, 6), "crease": range(1, 8)}
KINDS["corner"] = range(1, 7)
CASES = [(kind, k, p) for kind, sizes in KINDS.items() for k in sizes for p in (0, k // 2, k - 1)]
CASES = sorted({(kind, k, p if kind not in ("interior", "cone") else 0) for kind, k, p in CASES})
cases = pytest.mark.parametrize(("kind", "k", "p"), CASES)


@cases
def test_matrix_is_one_naive_refinement(kind, k, p):
    cage = LocalCage(kind, k)
    matrix = subdivision_matrix(LOOP, LOOP.sector(kind, k, p))
    control = [*cage.ring(), *cage.places(p, OUTER)]
    column = {cage.at(*place): n for n, place in enumerate(control)}
    refined = [*cage.ring(), *cage.places(p, [*OUTER, *BEYOND])]
    assert matrix.size == len(control) == len(column)
    for row, place in zip(matrix.rows, refined, strict=False):
        assert dict(row) == {column[v]: w for v, w in cage.refined(*place).items()}


# --- eigenbases -----------------------------------------------------------------------------------


@functools.cache
def derived(kind, k, p=0):
    """A spectrum, and V, V^-1, J and A as mpf."""
    s = spectrum(LOOP, LOOP.sector(kind, k, p))
    number = np.vectorize(lambda x: mp.ldexp(mp.mpf(int(x)), -BITS), otypes=[object])
    J = np.diag(np.array([mp.re(x) for x in s.eigenvalues], dtype=object))
    for n in s.chains:
        J[n - 1, n] = mp.mpf(1)
    for n in s.pairs:
        turn = s.eigenvalues[n].imag
        J[n, n + 1], J[n + 1, n] = turn, -turn
    A = np.zeros(J.shape, dtype=object)
    for i, row in enumerate(s.matrix.rows[: s.matrix.size]):
        for c, w in row.items():
            A[i, c] = to_mpf(w)
    return s, *map(number, dense_basis(s)), J, A


@cases
def test_basis_of_triangles(kind, k, p):
    s, V, Vinv, J, A = derived(kind, k, p)
    assert abs(A.dot(V) - V.dot(J)).max() < 1e-90
    assert abs(V.dot(Vinv) - np.eye(len(V), dtype=int)).max() < 1e-90
    assert s.pieces.shape == (3, 15, s.matrix.size)
    mask = [to_mpf(w) for w in limit_weights(LOOP, s.matrix.sector)]
    assert max(abs(x - y) for x, y in zip(mask, Vinv[0], strict=False)) < 1e-90


@pytest.mark.parametrize("N", [2, *range(3, 13), 25, 64])
def test_eigenvalues_of_smooth_vertices(N):
    s, *_ = derived("interior", N)
    waves = [mp.mpf(3) / 8 + mp.cospi(mp.mpf(2 * f) / N) / 4 for f in range(1, N)]
    others = [mp.mpf(1), (mp.mpf(3) / 8 + mp.cospi(mp.mpf(2) / N) / 4) ** 2]
    outer = [mp.mpf(1) / 8] * 3 + [mp.mpf(1) / 16] * 2
    needed = sorted([*waves, *others, *outer])
    assert max(abs(x - y) for x, y in zip(sorted(s.eigenvalues), needed, strict=True)) < 1e-90
    assert s.chains == ([7] if N == 3 else [])
    assert s.normal == ((1, 2) if N > 2 else ())


@pytest.mark.parametrize("k", range(1, 14))
def test_jordan_blocks_of_sectors(k):
    crease, corner = derived("crease", k)[0], derived("corner", k)[0]
    assert [crease.eigenvalues[n] for n in crease.chains] == [0.5] * (k % 6 == 0)
    assert [corner.eigenvalues[n] for n in corner.chains] == [0.5] * (k % 3 == 0)


@pytest.mark.parametrize("N", [2, 3, 4, 5, 6, 7, 8, 9])
def test_symbolic_basis_of_smooth_vertices(N):
    exact = SymbolicBasis(LOOP, N)
    assert exact.residual.is_zero_matrix
    s, V, Vinv, *_ = derived("interior", N)
    if N > 6:
        return
    values = sympy.Matrix(exact.eigenvalues), np.array(s.eigenvalues)
    with mpmath.workdps(50):
        for symbols, numbers in ((exact.V, V), (exact.Vinv, Vinv), values):
            for x, y in zip(symbols, numbers.ravel(), strict=True):
                assert abs(mpmath.mpf(str(sympy.N(x, 45))) - y) < 1e-38


def test_a_block_of_valence_three_multiplied_out():
    exact = SymbolicBasis(LOOP, 3)
    assert exact.J[6, 7] == 1
    assert exact.J[7, 7] == sympy.Rational(1, 16)
    assert (exact.A * exact.V - exact.V * exact.J).applyfunc(sympy.expand).is_zero_matrix


@pytest.mark.parametrize(
    ("kind", "k"),
    [
        *(("crease", k) for k in (1, 3, 6)),
        *(("corner", k) for k in (3, 4)),
        *(("dart", k) for k in (3, 4)),
        *(("flap", k) for k in (1, 3)),
        ("cone", 5),
        ("pendant", 4),
    ],
)
def test_symbolic_basis_of_sectors(kind, k):
    assert SectorBasis(LOOP, LOOP.sector(kind, k)).residual.is_zero_matrix


@pytest.mark.parametrize(("k", "p"), [(5, 1), (8, 0)])
def test_symbolic_basis_of_darts_of_irrational_weights(k, p):
    exact = ls.eigenbasis(LOOP, kind="dart", faces=k, position=p).exact
    s, V, Vinv, *_ = derived("dart", k, p)
    found = np.array([complex(x.evalf(20)) for x in exact.eigenvalues])
    np.testing.assert_allclose(found, np.array(s.eigenvalues, dtype=complex), rtol=0, atol=1e-15)
    assert np.any(found.imag) == (k == 8)  # two of them are complex
    if k == 5:
        with mpmath.workdps(50):
            for symbols, numbers in ((exact.V, V), (exact.Vinv, Vinv)):
                for x, y in zip(symbols, numbers.ravel(), strict=True):
                    assert abs(mpmath.mpf(str(sympy.N(x, 45))) - y) < 1e-38
    assert exact.residual.is_zero_matrix


@SCHEMES
@pytest.mark.parametrize(
    ("kind", "k"),
    [("interior", 3), ("interior", 5), ("crease", 5), ("flap", 2), ("dart", 5), ("dart", 8)],
)
def test_any_number_of_digits(scheme, kind, k):
    basis = ls.eigenbasis(scheme, kind=kind, faces=k)
    few, many = basis.in_digits(10), basis.in_digits(300)
    assert many is basis.in_digits(300)
    with mpmath.workdps(320):
        assert abs(many.residual).max() < mpmath.mpf(10) ** -300
        whole = many.V @ many.Vinv - np.eye(len(many.V), dtype=int)
        assert abs(whole).max() < mpmath.mpf(10) ** -300
        assert abs(many.V - few.V).max() < mpmath.mpf(10) ** -80
        assert abs(many.limit_mask.sum() - 1) < mpmath.mpf(10) ** -300
        if scheme is CATMULL_CLARK and kind == "interior":
            c, s = mpmath.cospi(mpmath.mpf(2) / k), mpmath.cospi(mpmath.mpf(1) / k)
            known = (5 + c + s * mpmath.sqrt(18 + 2 * c)) / 16
            assert abs(many.eigenvalues[1] - known) < mpmath.mpf(10) ** -300
    table = basis.float64
    for name in ("A", "V", "J", "Vinv", "eigenvalues", "limit_mask", "tangent_masks"):
        exact, rounded = getattr(many, name), getattr(table, name)
        assert exact.shape == rounded.shape
        number = complex if name == "eigenvalues" else float
        # the modulus and argument of complex pairs are rounded, not their parts
        np.testing.assert_allclose(exact.astype(number), rounded, rtol=1e-15, atol=1e-16)
    for digits in (0, 2.5, "3"):
        with pytest.raises(ValueError, match="digits must be an integer >= 1"):
            basis.in_digits(digits)


@pytest.mark.parametrize(("kind", "row"), [*(("interior", r) for r in (1, 3, 7, 10)), ("dart", 3)])
def test_the_proof_around_an_irrational_weight_proves(kind, row):
    """It fails when one weight of another row moves to another point."""
    exact = SymbolicBasis(LOOP, 5)
    if kind == "dart":
        exact = SectorBasis(LOOP, LOOP.sector("dart", 5))
    assert exact.residual.is_zero_matrix
    rows = [dict(r) for r in exact._matrix.rows]
    first, second = list(rows[row])[:2]
    rows[row][first] += F(1, 1000)
    rows[row][second] -= F(1, 1000)
    exact._matrix = dataclasses.replace(exact._matrix, rows=tuple(rows))
    del exact.residual
    with pytest.raises(ArithmeticError, match="A V - V J is not zero in row"):
        _ = exact.residual


@pytest.mark.parametrize(("kind", "k"), [("crease", 1), ("crease", 4), ("corner", 2), ("dart", 3)])
def test_reflections_continue_the_curve(kind, k):
    """Along a sharp edge the surface is the cubic B-spline of the points on it."""
    matrix = subdivision_matrix(LOOP, LOOP.sector(kind, k))
    assert all(sum(row.values()) == 1 for row in matrix.rows)
    piece = dict(zip(TRIANGLES.template, matrix.pieces[0], strict=True))
    on_curve = [piece[i, 1] for i in (1, 2)]  # its ends
    before, after = piece[0, 1], piece[3, 1]
    for s in (F(0), F(1, 3), F(1)):
        found, needed = Counter(), Counter()
        for place, weight in typed_weights(s, F(0)).items():
            for c, w in matrix.rows[piece[place]].items():
                found[c] += weight * w
        cubic = (1 - s) ** 3, 4 - 6 * s**2 + 3 * s**3, 1 + 3 * s + 3 * s**2 - 3 * s**3, s**3
        for row, weight in zip([before, *on_curve, after], cubic, strict=True):
            for c, w in matrix.rows[row].items():
                needed[c] += weight * w / 6
        assert all(found[c] == needed[c] for c in found.keys() | needed.keys())


@cases
def test_eigenexpansion_is_naive_recursion(kind, k, p):
    """At depth n: control points refined n times, then the paper's polynomials on a child."""
    s, _, Vinv, J, A = derived(kind, k, p)
    rng = np.random.default_rng(k)
    points = rng.integers(-99, 100, s.matrix.size).astype(object)
    places = {0: (F(3, 4), F(1, 5)), 1: (F(1, 9), F(4, 5)), 2: (F(1, 3), F(2, 5))}
    coefficients, near = Vinv.dot(points), points
    for _ in range(4):
        refined = [sum(to_mpf(w) * near[c] for c, w in row.items()) for row in s.matrix.rows]
        for piece, (u, v) in places.items():
            S, T = ((2 * u - 1, 2 * v), (2 * u, 2 * v - 1), (1 - 2 * u, 1 - 2 * v))[piece]
            typed = typed_weights(S, T)
            control = zip(TRIANGLES.template, s.matrix.pieces[piece], strict=True)
            needed = sum(to_mpf(typed[place]) * refined[n] for place, n in control)
            monomials = np.array([to_mpf(S**i * T**j) for i, j in QUARTIC.exponents])
            found = monomials.dot(s.pieces[piece]).dot(coefficients) / mp.mpf(2) ** BITS
            assert abs(found - needed) < 1e-85
        coefficients, near = J.dot(coefficients), A.dot(near)


# --- tables ---------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:.* has no tangent plane")  # at valence 2
@pytest.mark.parametrize("N", [2, 3, 5, 6, 8, 17])
def test_tables_of_smooth_vertices(N, monkeypatch, tmp_path):
    monkeypatch.setenv("LIMITSURF_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(tables.cache, "_memory", {})
    table = ls.eigenbasis(LOOP, valence=N).float64
    s, V, Vinv, *_ = derived("interior", N)
    assert abs(table.residual).max() < 1e-14
    assert np.array_equal(table.pieces, (s.pieces / (1 << BITS)).astype(float)) or N > 2
    assert abs(table.V - V.astype(float)).max() < 1e-13
    assert abs(table.limit_mask - Vinv[0].astype(float)).max() < 1e-15
    points = np.random.default_rng(0).normal(size=(1, table.size, 3))
    assert table.coefficients(points)[0] == pytest.approx(Vinv.astype(float) @ points[0], abs=1e-12)
    # read again, and believed
    assert tables.cache._holds(table)
    monkeypatch.setattr(tables.cache, "_memory", {})
    monkeypatch.setattr(tables.cache, "_derive", None)
    again = ls.eigenbasis(LOOP, valence=N).float64
    assert np.array_equal(again.pieces, table.pieces)
    assert pickle.loads(pickle.dumps(again)) is again


def test_a_wrong_table_of_triangles_is_not_believed():
    table = ls.eigenbasis(LOOP, valence=5).float64
    pieces = table.pieces.copy()
    pieces[1, 3, 4] += 1e-3
    assert not tables.cache._holds(dataclasses.replace(table, pieces=pieces))
    normal = table.normal[::-1]
    assert not tables.cache._holds(dataclasses.replace(table, normal=normal))


def test_masks_as_arrays():
    found = tables.vertex_weights(LOOP, np.array([6, 3, 6]), RATIONAL)
    rows = {3: [F(7, 16), F(3, 16)], 6: [F(5, 8), F(1, 16)]}
    assert found.tolist() == [rows[6], rows[3], rows[6]]
    assert tables.vertex_weights(LOOP, np.array([], dtype=int), FLOAT64).shape == (0, 2)
    assert tables.vertex_weights(LOOP, np.array([5]), FLOAT64)[0] @ [1, 5] == pytest.approx(1)
    assert tables.limit_mask(LOOP, "interior", 3, RATIONAL).tolist() == [F(2, 5), *[F(1, 5)] * 3]
