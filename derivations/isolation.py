# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% tags=["remove-cell"]
"""Isolation: how few refinements bring any cage to patches with one special corner.

After Catmull and Clark (1978), Stam (1998) and DeRose, Kass and Truong (1998).

Run this file: it says nothing unless an assertion fails.
"""

# %% [markdown]
# # Isolation of special corners
#
# The library cuts each limit face into a small tree whose leaves are evaluated in closed form.
# This document proves what that rests on:
#
# 1. the surface of a face depends on the faces around its corners and on nothing else, and it does
#    not matter if some of their points are the same;
# 2. after one refinement all faces are quads, and new vertices are regular but for centres of
#    faces that were no quads;
# 3. so a quad needs one split at most and the limit face of an $n$-gon one more, however crowded
#    extraordinary vertices are, boundaries and infinitely sharp creases included;
# 4. what takes the place of missing points beyond a boundary or crease;
# 5. semi-sharp creases: $\lceil s \rceil$ levels;
# 6. how $(u, v)$ of a limit face becomes $(s, t)$ of a patch;
# 7. which control points are needed is the same in exact numbers and in rounded ones.
#
# The proofs are for any mesh. Meshes that are named serve to compare the library with them.
#
# - E. Catmull, J. Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes",
#   Computer-Aided Design 10 (1978): what one refinement does to a mesh.
# - J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
#   SIGGRAPH 1998: at most one extraordinary vertex a face, after two refinements.
# - T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998:
#   sharpness falls by one a level.

# %%
from fractions import Fraction
from math import ceil

from sympy import Matrix, expand, symbols

import limitsurf as ls

# %% [markdown]
# ## 1. What a face depends on
#
# Let the *star* of a vertex be the faces around it, and the *neighbourhood* of a face the union of
# the stars of its corners.
#
# **Claim.** The limit on a face depends on the points (and tags) of its neighbourhood alone.
#
# Take the child of a face $q$ at its corner $v$. Its corners are $v$, the midpoints of the two
# edges of $q$ at $v$, and the centre of $q$. The stars of these hold the children at $v$ of all
# faces at $v$, the children of the faces at those two edges at both ends of them, and all children
# of $q$. So the points in the neighbourhood of the child are
#
# - vertex points of corners of $q$, made of the stars of these corners;
# - edge points of edges that end at a corner of $q$: all faces at such an edge are in the star of
#   that corner;
# - face points of faces at corners of $q$.
#
# All are known from the neighbourhood of $q$, and by induction so is everything at all levels, and
# the limit. (Under "chaikin" an edge point also asks for the sharpness that both halves of its edge
# will have, which depends on the tags of all edges at either end: tags, but no points, matter one
# ring farther.)
#
# **Coincidences.** Call a map of meshes *faithful* at a vertex if it maps the star there one to one
# onto the star of the image, tags included. Masks read nothing but stars: the ends of an edge, its
# faces, the faces and edges at a vertex. So refinement commutes with a map that is faithful at the
# corners of a face, and the refined map is faithful at the corners of its children. Hence the
# neighbourhood of a face may be unfolded, with points as often as they occur: the $2 N + 8$ control
# points of a quad with one extraordinary corner need not be different vertices. On a torus of
# $3 \times 3$ quads, for instance, the 16 control points of a face are 9 vertices.
#
# ## 2. One refinement
#
# A face with corners $v_0 \ldots v_{n-1}$ becomes the $n$ quads
#
# $$ (v_i, \text{ midpoint of } v_i v_{i+1}, \text{ centre}, \text{ midpoint of } v_{i-1} v_i) . $$
#
# Hence
#
# - every face is a quad;
# - a *vertex* $v$ keeps its number of faces: one child of each lies at it;
# - a *midpoint* has two faces from each face at its edge: 4 inside, 2 on a boundary;
# - a *centre* has as many faces as its face had corners.
#
# Call a vertex regular if it has 4 faces, or 2 and lies on a boundary. Then the only new
# vertices that are not regular are centres of faces that are no quads. They appear in the first
# refinement and never again.

# %%
BLOCK = [
    [0, 3, 2, 1],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
]
MESHES = {
    "cube": BLOCK,
    "cube with a roof": BLOCK[:1] + BLOCK[2:] + [[4 + k, 4 + (k + 1) % 4, 8] for k in range(4)],
    "octahedron": [[i, 2 + j, 2 + (j + 1) % 4][:: 1 - 2 * i] for i in (0, 1) for j in range(4)],
    "hexagonal prism": [
        [*range(5, -1, -1)],
        [*range(6, 12)],
        *([k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k] for k in range(6)),
    ],
    "three quads": [[0, 1, 2, 3], [0, 3, 4, 5], [0, 5, 6, 1]],
    "torus": [
        [3 * i + j, 3 * ((i + 1) % 3) + j, 3 * ((i + 1) % 3) + (j + 1) % 3, 3 * i + (j + 1) % 3]
        for i in range(3)
        for j in range(3)
    ],
    "pentagon and triangles": [[0, 1, 2, 3, 4], [0, 5, 1], [1, 5, 2], [2, 6, 3]],
}


def children(faces):
    """Faces of the refined mesh, by names."""
    result = []
    for face in faces:
        centre = ("centre", *face)
        middles = [frozenset((a, b)) for a, b in zip(face, face[1:] + face[:1], strict=True)]
        result += [[v, middles[i], centre, middles[i - 1]] for i, v in enumerate(face)]
    return result


def irregular(faces):
    """Vertices that are not regular, with the number of their faces."""
    stars, sides = {}, {}
    for face in faces:
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            stars.setdefault(a, []).append(face)
            sides[frozenset((a, b))] = sides.get(frozenset((a, b)), 0) + 1
    rim = {end for ends, count in sides.items() if count == 1 for end in ends}
    return {v: len(star) for v, star in stars.items() if len(star) != (2 if v in rim else 4)}


for faces in MESHES.values():
    once = children(faces)
    twice = children(once)
    assert all(len(face) == 4 for face in once)
    centres = {("centre", *face): len(face) for face in faces if len(face) != 4}
    assert irregular(once) == irregular(faces) | centres
    assert irregular(twice) == irregular(once)

# %% [markdown]
# ## 3. At most one special corner
#
# A child has four corners of three kinds: an old vertex, two midpoints, a centre. So
#
# - the child of a *quad* has one corner at most that is not regular, the old vertex;
# - the child of an $n$-gon has two at most, the old vertex and the centre, which are opposite; each
#   of *its* children has one at most.
#
# After one refinement all faces around are quads, too, which is what Stam's patch asks for. A quad
# that has it already, and one irregular corner at most, is a patch as it stands. Hence, without
# semi-sharp tags: **a quad of the cage is a patch or four of them; the limit face of an $n$-gon,
# which is a child of it, is a patch or four of them.**
#
# *Infinitely sharp edges* cut stars into sectors. A mesh keeps being cut along the halves of its
# sharp edges. A midpoint of a sharp edge has two faces on each side, a crease of two faces, which
# is regular; so is the midpoint of an edge of three faces or more, in each of its sectors. Centres
# and the edges inside a face are smooth. So the counting is the same with "regular" for four faces
# around a smooth vertex, two faces along a crease or boundary, or one face at a corner, and
# "special" for everything else: interior, crease, corner, cone, dart, pendant and flap
# ([sectors](sectors.py)). A sector keeps its kind and its number of faces under refinement. A dart
# is special, the midpoint of its sharp edge is a crease of two faces on either side.

# %%
for faces in MESHES.values():
    odd = irregular(children(faces))
    for parent in faces:
        own = children([parent])
        assert all(sum(v in odd for v in face) <= (1 if len(parent) == 4 else 2) for face in own)
        assert not any(v in odd for face in own for v in face[1::2])
        for child in own:
            assert all(sum(v in odd for v in face) <= 1 for face in children([child]))


def depths(surface):
    """Greatest depth of the tree of each limit face in the library."""
    patches = surface.patches

    def depth(code):
        if code >= -1:
            return 0
        first = patches.n_limit_faces + 4 * (-2 - code)
        return 1 + max(depth(c) for c in patches.codes[first : first + 4])

    return [depth(code) for code in patches.codes[: patches.n_limit_faces]]


def built(faces, number=Fraction, **tags):
    count = 1 + max(max(face) for face in faces)
    points = [
        [number(7 * k * k % 11), number((3 * k + 5) % 7), number(k**3 % 13)] for k in range(count)
    ]
    return ls.Mesh(points, faces, **tags)


for name, faces in MESHES.items():
    found = depths(ls.LimitSurface(built(faces)))
    assert max(found) <= 1
    assert name != "cube" or found == [1] * 6
sharp = {(0, 1): 10, (1, 2): 10, (4, 5): 10}
assert max(depths(ls.LimitSurface(built(MESHES["cube"], creases=sharp, corners={6: 10})))) == 1

# %% [markdown]
# And the values: the limits of all vertices after two refinements, taken by limit masks
# ([limit_masks](limit_masks.py), [sectors](sectors.py)), must be what the patches give at their
# parameters. In Fractions, so the two are equal, at every vertex of every mesh above, with and
# without sharp tags.

# %%
for faces, tags in (
    *((faces, {}) for faces in MESHES.values()),
    (MESHES["cube"], {"creases": sharp, "corners": {6: 10}}),
    (MESHES["pentagon and triangles"], {"boundary": "edge_only", "creases": {(0, 1): 10}}),
):
    mesh = built(faces, **tags)
    fine = ls.refined(mesh, levels=2)
    places = fine.parent_face, fine.parent_u, fine.parent_v
    assert (fine.limit_points == ls.LimitSurface(mesh).evaluate(*places)).all()

# %% [markdown]
# ## 4. Phantoms beyond boundaries and creases
#
# A patch asks for points around all four corners. Where a side of the quad lies on a boundary, or
# on an infinitely sharp crease, that is not the special corner's own, the points beyond are
# reflections: $2 b - i$ across a side, and $4 p - 2 x - 2 y + o$ beyond the corner $p$ of one face.
# By [creases](creases.py) (part 2) they stay reflections under refinement, at regular vertices, so
# the quad is that of the continued mesh at every level. At a corner
# of the quad whose one side is on the rim the other one is on it, too (one face: the double
# reflection), or is not (two faces: what is reflected there belongs to the next face). At the
# corner of one face the order does not matter: reflecting either row of reflections again gives the
# double one.

# %%
p, x, y, o = symbols("p x y o")
across_x, across_y = 2 * p - x, 2 * p - y  # beyond p, against x and against y
beyond_along_x = 2 * across_x - (2 * y - o)  # in the row of y: 2 y - o, reflected at 2 p - x
beyond_along_y = 2 * across_y - (2 * x - o)
assert expand(beyond_along_x - beyond_along_y) == 0
assert expand(beyond_along_x - (4 * p - 2 * x - 2 * y + o)) == 0

# %% [markdown]
# At the special corner itself nothing is reflected. If its own side is sharp the points beyond it
# have no influence on this side and are left out ([sectors](sectors.py), part 7).
#
# ## 5. Semi-sharp creases
#
# A semi-sharp edge or vertex of sharpness $s$ has children of sharpness $\max(s - 1, 0)$. Under
# "chaikin" ([sharpness](sharpness.py)) a half gets a mean of sharpnesses, less 1: at most the
# largest less 1. So the largest finite sharpness $s$ is at most $\max(s - m, 0)$ after $m$ levels,
# and after $\lceil s \rceil$ levels nothing is semi-sharp. Then part 3 applies to what is left:
#
# - the limit face of a quad has a tree of depth $\lceil s \rceil$ at most if $s > 0$ (one level
#   isolates, and it is among these), the limit face of an $n$-gon at most
#   $\max(\lceil s \rceil - 1, 1)$, its children being of level 1;
# - only children that touch something semi-sharp, with an edge or a corner, go on: the others are
#   patches as soon as they touch nothing of the kind, at level 1 at the earliest;
# - where a crease of one sharpness goes straight on through regular vertices the patch is a strip
#   and there is no tree ([creases](creases.py), part 3).

# %%
for sharpness in (Fraction(1, 3), Fraction(1), Fraction(5, 2), Fraction(19, 4)):
    for creasing in ("uniform", "chaikin"):
        tags = {"creases": {(0, 1): sharpness, (1, 5): Fraction(1, 2)}, "creasing": creasing}
        found = depths(ls.LimitSurface(built(MESHES["cube"], **tags)))
        assert max(found) == ceil(sharpness)
tags = {"creases": {(0, 1): Fraction(5, 2)}}
found = depths(ls.LimitSurface(built(MESHES["hexagonal prism"], **tags)))
assert (max(found[:12]), max(found[12:])) == (2, 3)  # both hexagons, then the quads

# %% [markdown]
# Again the values, in Fractions, at a level where creases have died out and one where they have
# not:

# %%
for creasing in ("uniform", "chaikin"):
    tags = {
        "creases": {(0, 1): Fraction(3, 2), (1, 5): Fraction(1, 3)},
        "corners": {6: Fraction(1, 2)},
    }
    mesh = built(MESHES["cube"], creasing=creasing, **tags)
    fine = ls.refined(mesh, levels=2)
    places = fine.parent_face, fine.parent_u, fine.parent_v
    assert (fine.limit_points == ls.LimitSurface(mesh).evaluate(*places)).all()

# %% [markdown]
# ## 6. Parameters
#
# Let a patch have its parameters $(s, t)$ with the special corner at $(0, 0)$, and let this corner
# lie at corner $k$ of the parameter square, *turn* $k$. Then $(u, v)$ is $(s, t)$ turned by $k$
# quarters about the middle of the square:
#
# $$ k = 0: (s, t) = (u, v), \quad 1: (v, 1 - u), \quad 2: (1 - u, 1 - v), \quad 3: (1 - v, u) . $$
#
# Child $c$ of a quad has its first corner at corner $c$ of the quad, counted from the quad's own
# first corner. If that lies at corner $k$ of the square, the child's lies at corner $k + c$, in the
# quadrant at that corner, and at the same corner of that quadrant: so its turn is $k + c$ modulo 4.
# In formulas, for all $k$ and $c$: turning the quad's parameters, then going to its child, is going
# to the quadrant, then turning.


# %%
def turned(k, point):
    """Parameters (u, v) of a point (s, t) of a patch of turn k."""
    for _ in range(k % 4):
        point = (1 - point[1], point[0])
    return point


def child_place(c, point):
    """The point of a quad, in its own parameters, that child c has at (s, t)."""
    s_, t_ = point
    corner = [(0, 0), (1, 0), (1, 1), (0, 1)][c]
    first, second = [((1, 0), (0, 1)), ((0, 1), (-1, 0)), ((-1, 0), (0, -1)), ((0, -1), (1, 0))][c]
    return tuple(corner[a] + (s_ * first[a] + t_ * second[a]) / 2 for a in (0, 1))


u, v = symbols("u v")
inverse = {0: (u, v), 1: (v, 1 - u), 2: (1 - u, 1 - v), 3: (1 - v, u)}
for k, (s_, t_) in inverse.items():
    assert [expand(w) for w in turned(k, (s_, t_))] == [u, v]
    for c in range(4):
        whole = turned(k, child_place(c, (u, v)))
        i, j = [(0, 0), (1, 0), (1, 1), (0, 1)][(k + c) % 4]
        part = turned(k + c, (u, v))
        assert [
            expand(a - b)
            for a, b in zip(whole, ((i + part[0]) / 2, (j + part[1]) / 2), strict=True)
        ] == [0, 0]

# %% [markdown]
# The limit face $k$ of an $n$-gon is its child $k$, with $(0, 0)$ at the corner $v_k$, $(1, 0)$ at
# the midpoint of the edge to $v_{k+1}$, $(1, 1)$ at the centre and $(0, 1)$ at the midpoint of the
# edge to $v_{k-1}$: the order of corners in part 2. Derivatives gain a factor 2 for each level and
# order, and turns exchange $u$ and $v$ and change signs:
# $\partial_u = \partial_s \,\partial s / \partial u + \ldots$, read off the formulas above.

# %%
X = Matrix([symbols("X_s X_t")])
for k, signs in {
    0: ((1, 0), (0, 1)),
    1: ((0, -1), (1, 0)),
    2: ((-1, 0), (0, -1)),
    3: ((0, 1), (-1, 0)),
}.items():
    jacobian = Matrix(inverse[k]).jacobian([u, v])
    expected = [X[0] * a + X[1] * b for a, b in signs]
    assert (X * jacobian - Matrix([expected])).expand() == Matrix.zeros(1, 2)

# %% [markdown]
# ## 7. What all of it needs
#
# Control points that no patch needs are left out of the table, and so are those that only these
# combine. Which they are is found from the weights in float64, once for all types of numbers. Some
# of these weights are 0 by rounding alone: at a crease of sharpness $1 - 10^{-20}$ the edge point
# is the midpoint, but for $10^{-20}$ of what lies across. All the same
#
# **Claim.** Whatever a needed point combines in exact numbers is needed in float64, too.
#
# Take a split face $f$ and its corner $v$, and, of the faces at $v$, the *sector* of $f$ between
# infinitely sharp edges (all, if there is one such edge or none). Some descendant of $f$ with
# corner $v$ is a patch, whose control points include, of its level, the points of all faces and
# edges of the sector. A face point combines all corners of its face, an edge point both ends of its
# edge, whatever their weights. At $v$ one of these corners is the face point of the level before,
# and one of the ends the edge point. So all of these are needed at all levels from the first on,
# and all corners of the faces in the sector.
#
# Points that are needed belong to corners $v$ of such $f$, to edges at $v$, or to faces at $v$ (the
# claim in part 1). The rest is what rounding may lose:
#
# - of an edge point, what lies across: face points, or corners. Edges that have this are not
#   infinitely sharp, so they are inside the sector, with both of their faces;
# - of a vertex point, its neighbours and the face points around it, where a smooth mask has a share
#   in it: there is one such edge at most, and one sector;
# - of a vertex point, its neighbours along a crease. If one of the two edges is not infinitely
#   sharp there is one sector again. Otherwise they bound the sectors, or the patches of sectors
#   that they do not bound take the points of both.

# %%
cross = [[3 * i + j + k for k in (0, 1, 4, 3)] for i in range(2) for j in range(2)]
for tiny in (Fraction(1, 10**20), Fraction(1, 10**400)):
    tags = {"creases": {(1, 4): 1 - tiny, (3, 4): 1 - tiny}, "corners": {5: 1 + tiny}}
    mesh = built(cross, **tags)
    fine = ls.refined(mesh, levels=2)
    places = fine.parent_face, fine.parent_u, fine.parent_v
    # the table of Fractions is that of float64 with other weights
    assert (fine.limit_points == ls.LimitSurface(mesh).evaluate(*places)).all()
