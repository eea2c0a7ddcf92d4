"""Small meshes of triangles, in the form of `zoo`: made here, the same each time, exact as floats.

``ZOO`` has smooth cages by name, ``BOUNDED`` says which have a boundary, ``TAGGED`` the keyword
arguments for creases and corners that go with a cage, ``DEGENERATE`` what a scheme may refuse.
"""

import functools
import math
import random
from collections import Counter

import zoo
from zoo import UNIT, cage, on_circle

# --- Closed shapes


def icosahedron():
    """Twelve vertices of valence 5."""
    points = [[0, 0, UNIT], *(on_circle(i, 5, z=0.5) for i in range(5))]
    points += [*(on_circle(i + 0.5, 5, z=-0.5) for i in range(5)), [0, 0, -UNIT]]
    faces = []
    for i in range(5):
        a, b, c, d = 1 + i, 1 + (i + 1) % 5, 6 + i, 6 + (i + 1) % 5
        faces += [[0, a, b], [a, c, b], [b, c, d], [11, d, c]]
    return cage(points, faces)


def torus(m, n, seed=0):
    """A regular closed mesh, everywhere of valence 6; m, n >= 3."""
    points, quads = zoo.torus(m, n)
    return points + zoo.random_points(len(points), seed) / 8, halved(quads)


def halved(quads):
    return [t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])]


def flipped(points_and_faces, seed, steps=40, least=3, most=12):
    """Random edges turned inside their two triangles, as long as the cage stays a manifold.

    Valences of inner vertices stay between ``least`` and ``most``; no edge comes twice.
    """
    points, faces = points_and_faces
    rng, faces = random.Random(seed), [list(face) for face in faces]
    rim = zoo.boundary_vertices(faces)
    for _ in range(steps):
        f = rng.randrange(len(faces))
        k = rng.randrange(3)
        a, b, c = faces[f][k:] + faces[f][:k]
        g = next((g for g, face in enumerate(faces) if b in face and is_side(face, b, a)), None)
        if g is None:
            continue
        (d,) = set(faces[g]) - {a, b}
        valence = Counter(v for face in faces for v in face)
        shrinks = any(valence[v] - 1 < (1 if v in rim else least) for v in (a, b))
        grows = any(valence[v] + 1 > most for v in (c, d))
        if shrinks or grows or any(c in face and d in face for face in faces):
            continue
        faces[f], faces[g] = [c, a, d], [d, b, c]
    return points, faces


def is_side(face, a, b):
    return (a, b) in [(face[i - 1], face[i]) for i in range(3)]


def poked(points_and_faces, seed, count):
    """A vertex of valence 3 in the middle of random triangles."""
    points, faces = zoo.raw(points_and_faces)
    rng, faces = random.Random(seed), list(faces)
    for _ in range(count):
        a, b, c = faces.pop(rng.randrange(len(faces)))
        v = len(points)
        corners = zip(*(points[i] for i in (a, b, c)), strict=True)
        points.append([sum(x) // 3 + rng.randint(-16, 16) for x in corners])
        faces += [[a, b, v], [b, c, v], [c, a, v]]
    return cage(points, faces)


def sphere(seed, count=8):
    """A random closed cage: valences from 3 to 12, extraordinary corners side by side."""
    grown = poked(zoo.octahedron() if seed % 2 else icosahedron(), seed, count)
    points, faces = flipped(grown, seed)
    return points + zoo.random_points(len(points), seed) / 16, faces


def crowded():
    """A tetrahedron with one face cut in three: valences 3, 4, 4, 4, 3, all within one face."""
    return poked(zoo.tetrahedron(), 0, 1)


# --- With a boundary


def triangle():
    return cage([[0, 0, 0], [UNIT, 0, 32], [64, UNIT, 0]], [[0, 1, 2]])


def fan(n, seed=0):
    """A boundary vertex, number 0, with n triangles around it, all of its faces."""
    points = [[0, 0, 0], *(on_circle(i, 2 * n, z=0.1 * (-1) ** i) for i in range(n + 1))]
    points, faces = cage(points, [[0, i, i + 1] for i in range(1, n + 1)])
    return points + zoo.random_points(len(points), seed) / 16, faces


def ringed_fan(n, seed=0):
    """A boundary vertex, number 0, with n triangles around it, and a ring around those.

    The first n faces have their limits whatever comes beyond.
    """
    points, faces = rings(n, open_at=True)
    return points + zoo.random_points(len(points), seed) / 16, faces


def disc(n, seed=0):
    """An inner vertex, number 0, of valence n; faces 0 .. n - 1 around it, 3 n around those.

    The other inner vertices are regular.
    """
    points, faces = rings(n)
    return points + zoo.random_points(len(points), seed) / 16, faces


def rings(n, open_at=False):
    """A vertex with n triangles around it and 3 n around those, all the way round or half."""
    turns = 2 * n if open_at else n
    ends, outer = n + open_at, 2 * n + open_at
    points = [[0, 0, 0], *(on_circle(i, turns) for i in range(ends))]
    points += [on_circle(j / 2, turns, 2 if j % 2 == 0 else 1.75) for j in range(outer)]
    faces = [[0, 1 + i, 1 + (i + 1) % ends] for i in range(n)]
    for i in range(n):
        a, b = 1 + i, 1 + (i + 1) % ends
        x, y, z = (1 + ends + (2 * i + j) % outer for j in range(3))
        faces += [[a, x, y], [a, y, b], [b, y, z]]
    return cage(points, faces)


def strip(n):
    """n triangles in a row, each with a side on the boundary."""
    points = [[UNIT * i // 2, UNIT * (i % 2), 40 * (i % 3)] for i in range(n + 2)]
    faces = [[i, i + 1, i + 2] if i % 2 else [i, i + 2, i + 1] for i in range(n)]
    return cage(points, faces)


def grid(m, n, seed=0):
    """m x n squares, each cut in two: boundary vertices of 3 faces, corners of 1 and of 2."""
    points, quads = zoo.grid(m, n, seed)
    return points, halved(quads)


def patch(seed):
    """A random cage with a boundary, inner valences from 3 to 9."""
    points, faces = flipped(poked(grid(3, 3, seed), seed, 4), seed, most=9)
    return points + zoo.random_points(len(points), seed) / 16, faces


def cylinder(n, height=2):
    points, quads = zoo.cylinder(n, height)
    return points, halved(quads)


ZOO = {
    "tetrahedron": zoo.tetrahedron,
    "octahedron": zoo.octahedron,
    "icosahedron": icosahedron,
    "crowded": crowded,
    "bipyramid_3": functools.partial(zoo.bipyramid, 3),
    "bipyramid_5": functools.partial(zoo.bipyramid, 5),
    "bipyramid_12": functools.partial(zoo.bipyramid, 12),
    "torus_3x4": functools.partial(torus, 3, 4),
    "torus_5x4": functools.partial(torus, 5, 4),
    **{f"sphere_{seed}": functools.partial(sphere, seed) for seed in range(4)},
    "triangle": triangle,
    **{f"fan_{n}": functools.partial(fan, n) for n in range(1, 9)},
    **{f"ringed_fan_{n}": functools.partial(ringed_fan, n) for n in range(1, 9)},
    **{f"strip_{n}": functools.partial(strip, n) for n in (2, 3, 7)},
    "grid_1x1": functools.partial(grid, 1, 1),
    "grid_3x2": functools.partial(grid, 3, 2),
    "grid_4x4": functools.partial(grid, 4, 4),
    "cylinder_5": functools.partial(cylinder, 5),
    **{f"disc_{n}": functools.partial(disc, n) for n in (3, 4, 5, 6, 7, 8, 9, 16)},
    **{f"patch_{seed}": functools.partial(patch, seed) for seed in range(3)},
}
BOUNDED = [name for name, make in ZOO.items() if zoo.boundary_vertices(make()[1])]

# Two faces on the same three vertices, each of valence 2. (A vertex of valence 2 in any other cage
# has its two faces beside a pair of vertices with two edges.)
DEGENERATE = {"pillow_of_triangles": zoo.pillow_of_triangles}


# Edges of three faces and more, two fans at a vertex, faces turned against each other
NONMANIFOLD = {
    "book": lambda: book(3),
    "thick_book": lambda: book(5),
    "two_tetrahedra": lambda: joined(zoo.tetrahedron(), zoo.tetrahedron(), (0,)),
    "along_an_edge": lambda: joined(zoo.tetrahedron(), icosahedron(), (0, 1)),
    "moebius": lambda: twisted(9),
}


def book(pages):
    """Discs of valence 6 cut in half, with the cut in common."""
    points, faces = disc(6)
    half = [face for face in faces if all(points[v][1] > -0.1 for v in face)]
    axis = {v for face in half for v in face if abs(points[v][1]) < 0.1}
    used = sorted({v for face in half for v in face} - axis)
    numbers = {v: i for i, v in enumerate(sorted(axis))}
    turned, leaves = [], []
    for page in range(pages):
        ids = numbers | {v: len(axis) + page * len(used) + i for i, v in enumerate(used)}
        leaves += [[ids[v] for v in face] for face in half]
        angle = 2 * math.pi * page / pages
        for v in used:
            x, y, _ = points[v]
            turned.append([UNIT * x, UNIT * y * math.cos(angle), UNIT * y * math.sin(angle)])
    whole = [[UNIT * x for x in points[v]] for v in sorted(axis)] + turned
    return cage([[round(x) for x in point] for point in whole], leaves)


def joined(one, other, shared):
    """Two cages that have the first vertices of the second in common with some of the first."""
    (points, faces), (more, others) = map(zoo.raw, (one, other))
    numbers = dict(enumerate(shared))
    rest = [v for v in range(len(more)) if v not in numbers]
    numbers |= {v: len(points) + i for i, v in enumerate(rest)}
    points += [[x + 3 * UNIT for x in more[v]] for v in rest]
    return cage(points, faces + [[numbers[v] for v in face] for face in others])


def twisted(n):
    """A strip of n triangles, n odd, closed to a ring with one side."""
    points, faces = strip(n)
    return points[:n], [[v % n for v in face] for face in faces]


# --- Creases and corners


def spokes(n, sharp, sharpness=math.inf, **tags):
    """A disc of valence n, sharp from its centre out along the edges ``sharp``, to the rim."""
    points, faces = disc(n)
    creases = {}
    for i in sharp:
        creases |= {(0, 1 + i): sharpness, (1 + i, 1 + n + 2 * i): sharpness}
    return points, faces, {"creases": creases, **tags}


def tagged_sphere(seed, **tags):
    return zoo.randomly_tagged(sphere(seed), seed, **tags)


def tagged_patch(seed, **tags):
    return zoo.randomly_tagged(patch(seed), seed, **tags)


TAGGED = {
    **{f"dart_{n}": functools.partial(spokes, n, [0]) for n in (3, 4, 5, 6, 9)},
    **{f"crease_{k}_of_6": functools.partial(spokes, 6, [0, k]) for k in (1, 2, 3)},
    "crease_6_of_8": functools.partial(spokes, 8, [0, 6]),
    "corner_3": functools.partial(spokes, 9, [0, 3, 6]),
    "corner_1_and_5": functools.partial(spokes, 7, [0, 1, 2]),
    "cone_5": functools.partial(spokes, 5, [], corners={0: math.inf}),
    **{f"semi_{s}": functools.partial(spokes, 6, [0, 3], s) for s in (0.3, 1, 2.5, 4.7)},
    "semi_dart": functools.partial(spokes, 5, [0], 1.5),
    "semi_corner": functools.partial(spokes, 7, [], corners={0: 2.25}),
    "chaikin": lambda: (
        *disc(6),
        {"creases": {(0, 1): 2.5, (0, 4): 1.25, (1, 7): 3}, "creasing": "chaikin"},
    ),
    **{f"tagged_sphere_{seed}": functools.partial(tagged_sphere, seed) for seed in range(2)},
    "tagged_patch_0": functools.partial(tagged_patch, 0, boundary="edge_only"),
    "tagged_patch_1": functools.partial(tagged_patch, 1, creasing="chaikin"),
    "tagged_patch_2": functools.partial(tagged_patch, 2, boundary="none"),
    "holes": lambda: (*zoo.octahedron(), {"holes": [0, 5]}),
}
