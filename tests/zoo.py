"""Small meshes that every part of the library is tried on, all made here and the same each time.

A cage is ``(points, faces)``: a float64 array (n, 3) of multiples of 1/256, so that it is exact as
floats and as Fractions, and a list of faces, each a list of vertices. While it is being built, its
points are lists of three integers in units of 1/256.
"""

import itertools
import math
import random
from collections import Counter, defaultdict
from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

UNIT = 256


def cage(points, faces):
    return np.array(points, dtype=np.float64) / UNIT, [list(map(int, face)) for face in faces]


def raw(points_and_faces):
    """Points as lists of integers again, ready for the operations below."""
    points, faces = points_and_faces
    scaled = np.asarray(points) * UNIT
    assert (scaled == np.rint(scaled)).all()
    return scaled.astype(int).tolist(), [list(face) for face in faces]


def on_circle(i, n, radius=1.0, z=0.0):
    angle = 2 * math.pi * i / n
    coordinates = radius * math.cos(angle), radius * math.sin(angle), z
    return [round(UNIT * x) for x in coordinates]


# --- Closed shapes


def cube():
    points = [[UNIT * x, UNIT * y, UNIT * z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return cage(points, faces)


def tetrahedron():
    points = [[0, 0, 0], [UNIT, 0, 0], [0, UNIT, 0], [0, 0, UNIT]]
    return cage(points, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def bipyramid(n):
    """Two poles of valence n over a ring of n vertices of valence 4: 2 n triangles."""
    points = [on_circle(i, n) for i in range(n)] + [[0, 0, UNIT], [0, 0, -UNIT]]
    upper = [[i, (i + 1) % n, n] for i in range(n)]
    lower = [[(i + 1) % n, i, n + 1] for i in range(n)]
    return cage(points, upper + lower)


def octahedron():
    return bipyramid(4)


def prism(n):
    points = [on_circle(i, n, z=z) for z in (0, 1) for i in range(n)]
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    return cage(points, [list(range(n))[::-1], list(range(n, 2 * n)), *sides])


def trapezohedron(n):
    """Two poles of valence n, 2 n quads, and between them 2 n vertices of valence 3."""
    ring = [on_circle(i, 2 * n, z=0.25 * (-1) ** i) for i in range(2 * n)]
    points = [*ring, [0, 0, UNIT], [0, 0, -UNIT]]
    wrap = [(i % (2 * n), (i + 1) % (2 * n), (i + 2) % (2 * n)) for i in range(2 * n)]
    top = [[a, b, c, 2 * n] for a, b, c in wrap[0::2]]
    bottom = [[c, b, a, 2 * n + 1] for a, b, c in wrap[1::2]]
    return cage(points, top + bottom)


def dodecahedron():
    """Twelve pentagons: the dual of the icosahedron, rounded to the grid."""
    golden = (1 + math.sqrt(5)) / 2
    signs = (-1, 1)
    corners = [(x, y, z) for x in signs for y in signs for z in signs]
    for a in signs:
        for b in signs:
            x, y = a / golden, b * golden
            corners += [(0, x, y), (x, y, 0), (y, 0, x)]
    axes = [(0, a * golden, b) for a in signs for b in signs]
    axes = [axis[i:] + axis[:i] for axis in axes for i in range(3)]
    faces = []
    for axis in axes:
        normal = np.array(axis)
        near = sorted(range(20), key=lambda i: -float(np.dot(corners[i], normal)))[:5]
        start = np.cross(normal, np.cross(corners[near[0]], normal))
        side = np.cross(normal, start) / np.linalg.norm(normal)

        def angle(i, start=start, side=side):
            return math.atan2(np.dot(corners[i], side), np.dot(corners[i], start))

        faces.append(sorted(near, key=angle))
    return cage([[round(UNIT * x) for x in corner] for corner in corners], faces)


def pillow_of_quads():
    """Two quads back to back: four interior vertices of valence 2."""
    points = [[0, 0, 0], [UNIT, 0, 64], [UNIT, UNIT, 0], [0, UNIT, 96]]
    return cage(points, [[0, 1, 2, 3], [3, 2, 1, 0]])


def pillow_of_triangles():
    return cage([[0, 0, 0], [UNIT, 0, 0], [0, UNIT, 32]], [[0, 1, 2], [2, 1, 0]])


def torus(m, n):
    """A regular closed quad mesh, everywhere of valence 4; m, n >= 3."""
    points = []
    for i in range(m):
        for j in range(n):
            ring = 2 + math.cos(2 * math.pi * j / n)
            points.append(on_circle(i, m, ring, math.sin(2 * math.pi * j / n)))

    def vertex(i, j):
        return i % m * n + j % n

    cells = [(i, j) for i in range(m) for j in range(n)]
    return cage(points, [quad(vertex, i, j) for i, j in cells])


def quad(vertex, i, j):
    return [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)]


def sphere(n, rings):
    """Poles of valence n among triangles, quads between them."""
    points = [[0, 0, -UNIT]]
    for k in range(1, rings + 1):
        height = math.pi * (k / (rings + 1) - 0.5)
        points += [on_circle(i, n, math.cos(height), math.sin(height)) for i in range(n)]
    points.append([0, 0, UNIT])

    def vertex(i, j):
        return 1 + j * n + i % n

    south = [[0, vertex(i + 1, 0), vertex(i, 0)] for i in range(n)]
    north = [[vertex(i, rings - 1), vertex(i + 1, rings - 1), n * rings + 1] for i in range(n)]
    between = [quad(vertex, i, j) for j in range(rings - 1) for i in range(n)]
    return cage(points, south + between + north)


# --- Open shapes


def ball(n, rings, repeat=False, seed=None):
    """A cage of quads with a pole: a boundary row of coinciding points, or one point n times."""
    angle, height = np.meshgrid(np.arange(n) / n, np.arange(rings) / rings)
    angle, height = 2 * np.pi * angle, np.pi * height
    sphere = [np.sin(height) * np.cos(angle), np.sin(height) * np.sin(angle), np.cos(height)]
    points = np.stack(sphere, axis=-1)
    if seed is not None:
        points[1:] += np.random.default_rng(seed).normal(size=points[1:].shape) / 10
    points[0] = points[0, 0]
    i, j = np.arange(n), np.arange(rings - 1)[:, None] * n
    after = (i + 1) % n
    faces = np.stack([j + i, j + n + i, j + n + after, j + after], axis=-1).reshape(-1, 4)
    return points.reshape(-1, 3), np.where(faces < n, 0, faces) if repeat else faces


def grid(m, n, seed=0):
    """m by n quads over a bumpy rectangle."""
    bump = random.Random(seed)
    points = [
        [UNIT * i, UNIT * j, bump.randrange(-UNIT, UNIT)]
        for i in range(m + 1)
        for j in range(n + 1)
    ]
    cells = [(i, j) for i in range(m) for j in range(n)]
    return cage(points, [quad(lambda i, j: i * (n + 1) + j, i, j) for i, j in cells])


def cylinder(n, height):
    """n quads around, open at both ends."""
    points = [on_circle(i, n, z=k) for k in range(height + 1) for i in range(n)]
    cells = [(i, j) for j in range(height) for i in range(n)]
    return cage(points, [quad(lambda i, j: j * n + i % n, i, j) for i, j in cells])


def disk(n):
    """A vertex of valence n in a fan of n triangles, open around."""
    points = [[0, 0, UNIT // 2], *(on_circle(i, n) for i in range(n))]
    return cage(points, [[0, 1 + i, 1 + (i + 1) % n] for i in range(n)])


def half_disk(n):
    """A boundary vertex of n triangles."""
    points = [[0, 0, UNIT // 2], *(on_circle(i, 2 * n) for i in range(n + 1))]
    return cage(points, [[0, 1 + i, 2 + i] for i in range(n)])


def single_face(n):
    return cage([on_circle(i, n) for i in range(n)], [list(range(n))])


def flower(n, rings=2):
    """n sectors of rings x rings quads around a vertex of valence n; open, its boundary regular."""
    ids = {(0, 0, 0): 0}
    points = [[0, 0, UNIT // 2]]
    for i in range(n):
        for a in range(1, rings + 1):
            for b in range(rings + 1):
                ids[i, a, b] = len(points)
                points.append(on_circle(i + b / (a + b), n, a + b / 2, 0.25 * (a * b % 3)))

    def vertex(i, a, b):
        if a > 0:
            return ids[i % n, a, b]
        return ids[(i + 1) % n, b, 0] if b > 0 else 0

    cells = [(i, a, b) for i in range(n) for a in range(rings) for b in range(rings)]
    faces = [quad(lambda p, q, i=i: vertex(i, p, q), a, b) for i, a, b in cells]
    return cage(points, faces)


def local_cage(n, seed=0):
    """The neighbourhood of an extraordinary vertex (Stam 1998) with random points.

    Faces 4 i hold the vertex, number 0, at corner 0; their limits are determined by the cage.
    """
    points, faces = flower(n, 2)
    return random_points(len(points), seed), faces


def random_points(n, seed):
    g = random.Random(seed)
    return np.array([[g.randrange(-UNIT, UNIT + 1) for _ in range(3)] for _ in range(n)]) / UNIT


def corner_of_three():
    """A cube with one face missing: boundary vertices of two faces, next to valence 3."""
    points, faces = cube()
    return points, faces[1:]


def poles_at_the_boundary(n):
    """A flower of one ring: a vertex of valence n whose faces all touch the boundary."""
    return flower(n, 1)


def stairs():
    """An L of three quads: a boundary vertex of three faces, which is extraordinary."""
    points, faces = grid(2, 2)
    return points, faces[:3]


# --- Compositions


def disjoint(*cages):
    """Cages side by side as one."""
    points = np.concatenate([np.add(p, [3.0 * k, 0, 0]) for k, (p, _) in enumerate(cages)])
    starts = np.cumsum([0, *(len(p) for p, _ in cages)]).tolist()
    pairs = zip(starts, cages, strict=False)
    return points, [[start + v for v in face] for start, (_, faces) in pairs for face in faces]


def with_unused(points_and_faces, at=0):
    """A vertex of no face put in before vertex ``at``."""
    points, faces = points_and_faces
    points = np.insert(points, at, [9.0, -9.0, 0.5], axis=0)
    return points, [[v + (v >= at) for v in face] for face in faces]


def relabelled(points_and_faces, seed):
    """The same surface with vertices and faces in another order and rotated faces."""
    points, faces = points_and_faces
    g = random.Random(seed)
    new = list(range(len(points)))
    g.shuffle(new)
    turned = [[new[v] for v in face] for face in faces]
    turned = [face[k:] + face[:k] for face in turned for k in [g.randrange(len(face))]]
    g.shuffle(turned)
    old = np.argsort(new)
    return points[old], turned


# --- Operations: each changes points and faces in place, and says whether it applied.
# ``choose(n)`` gives an integer from 0 to n - 1.


def mean(points, face):
    return [sum(points[v][i] for v in face) // len(face) for i in range(3)]


def between(p, q, weight=2):
    return [a + (b - a) // weight for a, b in zip(p, q, strict=True)]


def inset(points, faces, choose):
    """A smaller face inside a face, pushed out or in: an extrusion."""
    i = choose(len(faces))
    face = faces[i]
    centre = mean(points, face)
    push = [choose(129) - 64 for _ in range(3)]
    inner = []
    for v in face:
        inner.append(len(points))
        points.append([x + d for x, d in zip(between(points[v], centre), push, strict=True)])
    n = len(face)
    sides = [[face[k], face[(k + 1) % n], inner[(k + 1) % n], inner[k]] for k in range(n)]
    faces[i : i + 1] = [inner, *sides]
    return True


def poke(points, faces, choose):
    """A face split into triangles around a vertex in its middle."""
    i = choose(len(faces))
    face = faces[i]
    points.append([x + choose(129) - 64 for x in mean(points, face)])
    n = len(face)
    faces[i : i + 1] = [[face[k], face[(k + 1) % n], len(points) - 1] for k in range(n)]
    return True


def cut_face(points, faces, choose):
    """A face split in two by a diagonal that is no edge yet."""
    i = choose(len(faces))
    face = faces[i]
    n = len(face)
    if n < 4:
        return False
    a = choose(n)
    face = face[a:] + face[:a]
    b = 2 + choose(n - 3)
    if any({face[0], face[b]} <= set(other) for other in faces if other is not faces[i]):
        return False
    faces[i : i + 1] = [face[: b + 1], [*face[b:], face[0]]]
    return True


def cut_edge(points, faces, choose):
    """A vertex on an edge, joined to another vertex of each face at it."""
    i = choose(len(faces))
    k = choose(len(faces[i]))
    ends = {faces[i][k], faces[i][k - 1]}
    points.append(mean(points, ends))
    new = len(points) - 1
    for j in range(len(faces))[::-1]:
        face = faces[j]
        at = [k for k in range(len(face)) if {face[k], face[k - 1]} == ends]
        if at:
            face = face[at[0] :] + face[: at[0]]  # the edge joins its last vertex to its first
            b = 1 + choose(len(face) - 2)
            faces[j : j + 1] = [[new, *face[: b + 1]], [new, *face[b:]]]
    return True


def insert_vertex(points, faces, choose):
    """A vertex on an edge and nothing else: of valence 2 if the edge has two faces."""
    i = choose(len(faces))
    k = choose(len(faces[i]))
    a, b = faces[i][k - 1], faces[i][k]
    points.append(mean(points, [a, b]))
    for face in faces:
        for k in range(len(face)):
            if {face[k - 1], face[k]} == {a, b}:
                face.insert(k, len(points) - 1)
                break
    return True


def truncate(points, faces, choose):
    """An interior vertex cut off: a face in its place, one new vertex on each of its edges."""
    inner = sorted({v for face in faces for v in face} - boundary_vertices(faces))
    if not inner:
        return False
    v = inner[choose(len(inner))]
    after = {}  # the vertex before v in a face -> the one after
    for face in faces:
        if v in face:
            k = face.index(v)
            after[face[k - 1]] = face[(k + 1) % len(face)]
    if len(after) < 3:
        return False
    new = {}
    for w in after:
        new[w] = len(points)
        points.append(between(points[v], points[w], 4))
    for face in faces:
        if v in face:
            k = face.index(v)
            face[k : k + 1] = [new[face[k - 1]], new[face[(k + 1) % len(face)]]]
    w = min(after)
    cap = [new[w]]
    while after[w] != min(after):
        w = after[w]
        cap.append(new[w])
    faces.append(cap[::-1])
    remove_vertex(points, faces, v)
    return True


def remove_face(points, faces, choose):
    """A face less, if the rest is still a manifold; with the vertices that nothing else uses."""
    i = choose(len(faces))
    if len(faces) == 1 or not is_manifold(faces[:i] + faces[i + 1 :]):
        return False
    gone = faces.pop(i)
    used = {v for face in faces for v in face}
    for v in sorted(set(gone) - used, reverse=True):
        remove_vertex(points, faces, v)
    return True


def remove_vertex(points, faces, v):
    del points[v]
    for face in faces:
        face[:] = [w - (w > v) for w in face]


OPERATIONS = [inset, poke, cut_face, cut_edge, truncate, remove_face]


def operated(points_and_faces, choose, steps, operations=OPERATIONS, keep=lambda faces: True):
    """The cage after random operations; those whose outcome ``keep`` refuses are undone."""
    points, faces = raw(points_and_faces)
    for _ in range(steps):
        new_points, new_faces = [list(p) for p in points], [list(f) for f in faces]
        operation = operations[choose(len(operations))]
        if operation(new_points, new_faces, choose) and keep(new_faces):
            points, faces = new_points, new_faces
    return cage(points, faces)


def carved(points_and_faces, seed, steps=8):
    """A cage after random operations that leave it as open or closed as it is."""
    g = random.Random(seed)
    before = len(boundary_vertices(points_and_faces[1])) > 0
    closed_operations = [inset, poke, cut_face, cut_edge, truncate]
    changed = operated(
        points_and_faces, g.randrange, steps, closed_operations, keep=has_regular_boundary
    )
    assert (len(boundary_vertices(changed[1])) > 0) == before
    return relabelled(changed, seed)


def truncated(points_and_faces):
    """All vertices cut off."""
    points, faces = raw(points_and_faces)
    n = len(points)
    for _ in range(n):  # the lowest number is an old vertex: new ones are appended
        assert truncate(points, faces, lambda n: 0)
    return cage(points, faces)


# --- What a list of faces is, naively


def half_edges(faces):
    return [(a, b) for face in faces for a, b in zip(face, face[1:] + face[:1], strict=True)]


def boundary_vertices(faces):
    directed = set(half_edges(faces))
    return {v for a, b in directed if (b, a) not in directed for v in (a, b)}


def is_manifold(faces):
    """Distinct corners, edges of one face or two of one orientation, one fan at every vertex."""
    directed = Counter(half_edges(faces))
    if max(directed.values()) > 1 or any(len(face) != len(set(face)) for face in faces):
        return False
    fans = defaultdict(list)  # vertex -> [(edge towards, edge away)], as the other vertices
    for face in faces:
        for a, v, b in zip(face[-1:] + face[:-1], face, face[1:] + face[:1], strict=True):
            fans[v].append((a, b))
    for spokes in fans.values():
        before = {b: a for a, b in spokes}
        starts = [a for a, _ in spokes if a not in before] or [spokes[0][0]]
        after = dict(spokes)
        vertex, steps = after[starts[0]], 1
        while vertex in after and vertex != starts[0]:
            vertex, steps = after[vertex], steps + 1
        if steps != len(spokes):
            return False
    return True


def has_regular_boundary(faces, boundary="edge_and_corner"):
    """Whether every boundary vertex is of two faces, or of one where that is a corner."""
    count = Counter(v for face in faces for v in face)
    allowed = {2} | ({1} if boundary == "edge_and_corner" else set())
    return is_manifold(faces) and all(count[v] in allowed for v in boundary_vertices(faces))


# --- The zoo

ZOO = {
    "cube": cube,
    "tetrahedron": tetrahedron,
    "octahedron": octahedron,
    "dodecahedron": dodecahedron,
    "truncated_cube": lambda: truncated(cube()),
    "truncated_octahedron": lambda: truncated(octahedron()),
    "truncated_twice": lambda: truncated(truncated(tetrahedron())),
    "pillow_of_quads": pillow_of_quads,
    "pillow_of_triangles": pillow_of_triangles,
    "prism_3": lambda: prism(3),
    "prism_7": lambda: prism(7),
    "prism_12": lambda: prism(12),
    "bipyramid_3": lambda: bipyramid(3),
    "bipyramid_9": lambda: bipyramid(9),
    "bipyramid_64": lambda: bipyramid(64),
    "trapezohedron_5": lambda: trapezohedron(5),
    "trapezohedron_12": lambda: trapezohedron(12),
    "sphere_8": lambda: sphere(8, 4),
    "torus_3x3": lambda: torus(3, 3),
    "torus_4x5": lambda: torus(4, 5),
    "grid_1x1": lambda: grid(1, 1),
    "grid_1x4": lambda: grid(1, 4),
    "grid_3x3": lambda: grid(3, 3),
    "cylinder_5": lambda: cylinder(5, 2),
    "cylinder_3": lambda: cylinder(3, 1),
    "triangle": lambda: single_face(3),
    "heptagon": lambda: single_face(7),
    "disk_3": lambda: disk(3),
    "disk_7": lambda: disk(7),
    "half_disk_2": lambda: half_disk(2),
    **{f"half_disk_{n}": (lambda n=n: half_disk(n)) for n in (4, 5, 6, 7)},
    "corner_of_three": corner_of_three,
    "stairs": stairs,
    "flower_2": lambda: flower(2),
    "flower_3": lambda: flower(3),
    "flower_5_wide": lambda: flower(5, 4),
    "flower_64": lambda: flower(64),
    "poles_at_the_boundary_3": lambda: poles_at_the_boundary(3),
    "poles_at_the_boundary_6": lambda: poles_at_the_boundary(6),
    **{f"local_cage_{n}": (lambda n=n: local_cage(n, n)) for n in (3, 4, 5, 6, 7, 12, 33)},
    **{f"carved_cube_{k}": (lambda k=k: carved(cube(), k)) for k in range(4)},
    "carved_dodecahedron": lambda: carved(dodecahedron(), 5),
    "carved_bipyramid": lambda: carved(bipyramid(7), 6),
    "carved_prism": lambda: carved(prism(9), 7, 12),
    "carved_torus": lambda: carved(torus(3, 4), 8),
    "carved_flower": lambda: carved(flower(6, 3), 9),
    "carved_grid": lambda: carved(grid(4, 4), 10, 12),
    "carved_cylinder": lambda: carved(cylinder(6, 4), 11, 12),
    "cube_with_cut_edges": lambda: operated(
        cube(), random.Random(13).randrange, 9, [insert_vertex]
    ),
    "disconnected": lambda: disjoint(cube(), grid(2, 2), pillow_of_quads(), single_face(5)),
    "unused_vertices": lambda: with_unused(with_unused(with_unused(cube(), 0), 4), 10),
    "relabelled_sphere": lambda: relabelled(sphere(5, 3), 12),
}

SIX = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 1], [2, 1, 1]]

# name: (points, faces, what the MeshError says)
BAD = {
    "no_vertex": (np.zeros((0, 3)), [[0, 1, 2]], "need at least one vertex"),
    "no_face": (SIX, [], "need at least one face"),
    "no_face_in_array": (SIX, np.zeros((0, 4), dtype=int), "need at least one face"),
    "nan": (
        [[0, 0, 0], [1, math.nan, 0], [math.nan, 1, 0]],
        [[0, 1, 2]],
        "vertex 1: coordinate nan is not finite; 1 more like it",
    ),
    "infinite": (
        [[0, 0, 0], [1, 0, 0], [0, 1, -math.inf]],
        [[0, 1, 2]],
        "vertex 2: coordinate -inf is not finite",
    ),
    "out_of_range": (
        SIX,
        [[0, 1, 2], [0, 2, 6]],
        "face 1: vertex index 6 is out of range, need 0 to 5",
    ),
    "negative": (
        SIX,
        [[0, 1, 2], [0, 2, -3]],
        "face 1: vertex index -3 is negative, need 0 to 5",
    ),
    "two_corners": (SIX, [[0, 1, 2], [2, 3]], "face 1 has 2 corners, need at least 3"),
    "one_corner": (SIX, [[4], [2], [0, 1, 2]], "face 0 has 1 corner, need at least 3; 1 more"),
    "empty_face": (SIX, [[0, 1, 2], []], "face 1 has 0 corners"),
}


def pinched():
    """Two octahedra that share a vertex."""
    points, faces = disjoint(octahedron(), octahedron())
    return points, [[4 if v == 10 else v for v in face] for face in faces]


def with_random_points(faces, seed):
    return random_points(1 + max(map(max, faces)), seed), faces


def fins(n, height=2):
    """n strips of quads that meet at a row of edges."""
    faces = []
    for i in range(n):
        first = (height + 1) * (i + 1)
        faces += [[j, j + 1, first + j + 1, first + j] for j in range(height)]
    return with_random_points(faces, n)


def crossed_grids():
    """Two regular grids through each other along a row of edges, each of four faces."""
    faces = grid(4, 4)[1]
    new = {v: 25 + v - 5 * (v > 14) for v in range(25)} | {v: v for v in range(10, 15)}
    return with_random_points(faces + [[new[v] for v in face] for face in faces], 2)


# name: (points, faces, non-manifold edges, non-manifold vertices)
NONMANIFOLD = {
    "three_faces": (*with_random_points([[0, 1, 2], [1, 0, 3], [1, 0, 4]], 1), [(0, 1)], [0, 1]),
    "eight_faces": (*with_random_points([[0, 1, k] for k in range(2, 10)], 2), [(0, 1)], [0, 1]),
    "doubled_face": (
        *with_random_points([[0, 1, 2, 3], [0, 1, 2, 3]], 3),
        [(0, 1), (0, 3), (1, 2), (2, 3)],
        [0, 1, 2, 3],
    ),
    "torus_2x2": (
        *with_random_points(torus(2, 2)[1], 4),
        [(0, 1), (0, 2), (1, 3), (2, 3)],
        [0, 1, 2, 3],
    ),
    "opposite_orientation": (
        *with_random_points([[0, 1, 2, 3], [1, 2, 5, 4]], 5),
        [(1, 2)],
        [1, 2],
    ),
    "moebius": (
        *with_random_points([[0, 1, 3, 2], [2, 3, 5, 4], [4, 5, 0, 1]], 6),
        [(0, 1)],
        [0, 1],
    ),
    "bow_tie": (*with_random_points([[0, 1, 2], [2, 3, 4]], 7), [], [2]),
    "pinched": (*pinched(), [], [4]),
    "open_and_closed_fan": (
        *with_random_points([*tetrahedron()[1], [0, 4, 5], [0, 5, 6]], 8),
        [],
        [0],
    ),
    "fin": (*fins(3), [(0, 1), (1, 2)], [0, 1, 2]),
    "cross": (*fins(4), [(0, 1), (1, 2)], [0, 1, 2]),
    "crossed_grids": (*crossed_grids(), [(v, v + 1) for v in range(10, 14)], [10, 11, 12, 13, 14]),
    "collapsed_side": (*with_random_points([[0, 1, 2, 2], [1, 0, 3]], 9), [(2, 2)], [2]),
    "folded_face": (
        *with_random_points([[0, 1, 0, 2], [1, 0, 3]], 10),
        [(0, 1), (0, 1), (0, 2), (0, 2)],
        [0, 1, 2],
    ),
    "vertex_twice": (*with_random_points([[0, 1, 2, 0, 3, 4], [2, 1, 5]], 11), [], [0]),
}


# --- Tagged cages: (points, faces, tags), the tags being keyword arguments of a mesh

# how many random cages each property is tried on; see conftest.py
EXAMPLES = 25

SHARPNESSES = [0.3, 1, 2.5, 4.7, 7, math.inf]
MODES = ["edge_and_corner", "edge_only", "none"]


def tagged(points_and_faces, seed=0, **tags):
    """Random points: no symmetry hides an error."""
    points, faces = points_and_faces
    return random_points(len(points), seed), faces, tags


def edges_of(faces):
    return sorted({(min(pair), max(pair)) for pair in half_edges(faces)})


def row_of_edges(m, n, i, end=None):
    """The edges along the i-th row of vertices of a grid of m by n quads, up to the end-th."""
    first = i * (n + 1)
    return [(first + j, first + j + 1) for j in range(n if end is None else end)]


def crossed_grid(s, t):
    """A grid with creases of two sharpnesses, one across, one that ends in the middle."""
    creases = dict.fromkeys(row_of_edges(5, 4, 2), s)
    creases |= {(5 * i + 2, 5 * i + 7): t for i in range(3)}
    return tagged(grid(5, 4), creases=creases)


def crossing_rings(s, t, **tags):
    """A closed crease around a torus, another one that crosses it."""
    creases = {(j, (j + 1) % 5): s for j in range(5)} | {
        (5 * i, 5 * (i + 1) % 20): t for i in range(4)
    }
    return tagged(torus(4, 5), creases={(min(e), max(e)): x for e, x in creases.items()}, **tags)


def spoke(faces, i):
    """The edges from the centre of `flower(N, 2)` to its boundary, between sectors i - 1 and i."""
    return [(0, faces[4 * i][1]), (faces[4 * i + 2][0], faces[4 * i + 2][1])]


def spokes(N, sharpness, **tags):
    """A vertex of valence N with creases {spoke: sharpness} out of it, as far as the boundary."""
    points, faces = flower(N)
    creases = {edge: s for i, s in sharpness.items() for edge in spoke(faces, i)}
    return tagged((points, faces), N, creases=creases, **tags)


def fan(k, n=None):
    """k sectors of `flower`, of two by two quads each: a boundary vertex of k faces."""
    points, faces = flower(n or k + 2)
    faces = faces[: 4 * k]
    used = sorted({v for face in faces for v in face})
    return points[used], [[used.index(v) for v in face] for face in faces]


def carried(fans, flaps=(), rings=(), **tags):
    """A crease from one vertex over vertex 0 to another, between which are fans of so many sectors.

    Sectors are of two by two quads. There are flaps, which begin and end at one of its two edges by
    turns, and closed rings, which share nothing but the vertex. An edge of three and more faces is
    a crease, without a tag.
    """
    size = 1

    def new(n):
        nonlocal size
        size += n
        return [*range(size - n, size)]

    def between(spokes):
        found = []
        for (a, b), (c, d) in itertools.pairwise(spokes):
            m, e, f, g = new(4)
            found += [[0, a, m, c], [a, b, e, m], [m, e, f, g], [c, m, g, d]]
        return found

    ends, faces = [new(2), new(2)], []
    for k in fans:
        faces += between([ends[0], *(new(2) for _ in range(k - 1)), ends[1]])
    for i, k in enumerate(flaps):
        faces += between([ends[i % 2], *(new(2) for _ in range(k - 1)), ends[i % 2]])
    for k in rings:
        spokes = [new(2) for _ in range(k)]
        faces += between([*spokes, spokes[0]])
    return random_points(size, size), faces, tags


def randomly_tagged(points_and_faces, seed, density=0.3, **tags):
    """Creases of any sharpness anywhere, some corners and a hole."""
    g = random.Random(seed)
    points, faces = points_and_faces
    creases = {e: g.choice(SHARPNESSES) for e in edges_of(faces) if g.random() < density}
    corners = {v: g.choice(SHARPNESSES) for v in range(len(points)) if g.random() < density / 3}
    if len(faces) > 5:
        tags |= {"holes": [g.randrange(len(faces))]}
    return tagged((points, faces), seed, **{"creases": creases, "corners": corners} | tags)


TAGGED = {
    **{f"crossed_grid_{s}": (lambda s=s: crossed_grid(s, 1.5)) for s in SHARPNESSES},
    **{f"crossing_rings_{s}": (lambda s=s: crossing_rings(s, 2.5)) for s in SHARPNESSES},
    "ring_2.5": lambda: crossing_rings(2.5, 0),
    "ring_sharp": lambda: crossing_rings(10, 0),
    "unequal_ring": lambda: tagged(torus(3, 4), creases={(0, 1): 0.5, (1, 2): 3, (2, 3): 0.3}),
    # darts
    **{f"dart_{N}": (lambda N=N: spokes(N, {0: math.inf})) for N in range(2, 10)},
    **{f"dart_{N}_2.5": (lambda N=N: spokes(N, {0: 2.5})) for N in (3, 4, 5)},
    # sectors of k and N - k faces between sharp edges
    **{
        f"crease_{k}_{N - k}": (lambda k=k, N=N: spokes(N, {0: math.inf, k: math.inf}))
        for k, N in (
            (1, 2),
            (1, 3),
            (1, 4),
            (2, 4),
            (2, 5),
            (3, 6),
            (4, 8),
            (5, 10),
            (6, 12),
            (7, 14),
        )
    },
    **{
        f"corner_{k}": (lambda k=k: spokes(k + 2, dict.fromkeys((0, 1, 2), math.inf)))
        for k in (1, 2, 3, 4, 5, 6)
    },
    "corner_of_one_crease": lambda: spokes(4, {0: math.inf}, corners={0: math.inf}),
    "corner_of_two_creases": lambda: spokes(5, {0: math.inf, 2: 12}, corners={0: 12}),
    "sharp_and_semi_sharp": lambda: spokes(5, {0: math.inf, 2: math.inf, 3: 1.5}),
    "semi_sharp_corner": lambda: spokes(5, {0: 0.3, 1: 1, 3: 2.5}),
    "semi_sharp_crossing": lambda: spokes(6, {0: 4.7, 3: 4.7, 1: 0.3, 4: 2.5}),
    "semi_sharp_beside_sharp": lambda: spokes(4, {0: math.inf, 1: 0.3, 2: math.inf}),
    # cones
    **{f"cone_{N}": (lambda N=N: spokes(N, {}, corners={0: math.inf})) for N in range(2, 8)},
    "cone_5_0.3": lambda: spokes(5, {}, corners={0: 0.3}),
    "cone_4_2.5": lambda: spokes(4, {}, corners={0: 2.5}),
    "corner_on_a_crease": lambda: spokes(4, {0: 2.5, 2: 2.5}, corners={0: 1.3}),
    # boundaries
    **{
        f"boundary_{k}_{mode}": (lambda k=k, mode=mode: tagged(fan(k), k, boundary=mode))
        for k in range(1, 8)
        for mode in MODES[:2]
    },
    **{f"boundary_{k}_none": (lambda k=k: tagged(fan(k, 8), boundary="none")) for k in (2, 6)},
    "sharp_corners_of_the_boundary": lambda: tagged(
        fan(3), corners={0: math.inf, 1: 2.5, 5: 0.3}, boundary="edge_only"
    ),
    "tagged_boundary": lambda: tagged(
        grid(3, 3),
        creases={(0, 1): math.inf, (1, 2): 2, (0, 4): 10, (3, 7): 12},
        boundary="none",
    ),
    "boundary_sharp_all_around": lambda: tagged(
        grid(2, 2),
        creases={e: math.inf for e in edges_of(grid(2, 2)[1]) if 4 not in e},
        boundary="none",
    ),
    # n-gons and triangles
    "sharp_prism": lambda: tagged(prism(5), creases=dict.fromkeys([(0, 1), (1, 2), (2, 7)], 12)),
    "semi_sharp_prism": lambda: tagged(prism(6), creases={(0, 1): 2.5, (1, 2): 0.3, (2, 8): 4.7}),
    "sharp_tetrahedron": lambda: tagged(tetrahedron(), creases={(0, 1): math.inf, (1, 2): 1.5}),
    "smooth_triangles": lambda: tagged(bipyramid(5), triangles="smooth"),
    "smooth_triangles_and_quads": lambda: randomly_tagged(sphere(5, 2), 1, triangles="smooth"),
    "smooth_open_triangles": lambda: tagged(disk(4), creases={(0, 1): 1.5}, triangles="smooth"),
    "smooth_truncated": lambda: randomly_tagged(truncated(tetrahedron()), 3, triangles="smooth"),
    # creasing
    **{
        f"chaikin_{k}": (lambda k=k, s=s: spokes(N=5, sharpness=s, creasing="chaikin"))
        for k, s in enumerate([{0: 2.5, 2: 1}, {0: 3, 1: 0.3, 3: math.inf}, {0: 1.5}])
    },
    "chaikin_ring": lambda: crossing_rings(2.5, 4.7, creasing="chaikin"),
    "chaikin_row": lambda: tagged(
        grid(4, 4),
        creases=dict(zip(row_of_edges(4, 4, 2), [3, 0.5, 5, 1.3], strict=True)),
        creasing="chaikin",
    ),
    # faces beside a crease of non-manifold edges that they do not lie between
    **{f"pendant_{k}": (lambda k=k: carried([1, 1, 1], rings=[k])) for k in (2, 3, 5)},
    **{f"flap_{k}": (lambda k=k: carried([1, 1, 1], flaps=[k])) for k in (2, 3, 4)},
    "flaps_alone": lambda: carried([], [2, 3, 4, 2], [4], boundary="edge_only"),
    "semi_sharp_pendant": lambda: carried([1, 1, 2], [3], [3, 3], corners={0: 1.3}),
    "semi_sharp_flap": lambda: carried([1, 1, 2], [3], [3], creases={(0, 23): 0.3, (0, 39): 2.5}),
    # holes
    "holes": lambda: tagged(flower(5), holes=[0, 4], corners={0: 1.5}),
    "hole_beside_a_crease": lambda: tagged(
        grid(4, 4), creases=dict.fromkeys(row_of_edges(4, 4, 2), 2.5), holes=[5, 10]
    ),
    # parts
    "tagged_parts": lambda: randomly_tagged(disjoint(cube(), grid(2, 2), single_face(5)), 4),
    "tagged_with_unused": lambda: randomly_tagged(with_unused(cube(), 3), 5),
    # all mixed
    **{f"mixed_cube_{k}": (lambda k=k: randomly_tagged(carved(cube(), k), k)) for k in range(3)},
    **{
        f"mixed_{base}_{creasing}": (
            lambda base=base, creasing=creasing: randomly_tagged(ZOO[base](), 6, creasing=creasing)
        )
        for base in ("truncated_cube", "carved_grid", "flower_3", "torus_3x3")
        for creasing in ("uniform", "chaikin")
    },
    "mixed_pillow": lambda: randomly_tagged(pillow_of_quads(), 7, 0.5),
    # non-manifold and degenerate cages, and some more of them tagged
    **{name: (lambda n=name: (*NONMANIFOLD[n][:2], {})) for name in NONMANIFOLD},
    **{
        f"{name}_{mode}": (lambda n=name, m=mode: (*NONMANIFOLD[n][:2], {"boundary": m}))
        for name in ("bow_tie", "fin", "opposite_orientation", "vertex_twice")
        for mode in MODES[1:]
    },
    **{
        f"mixed_{name}": (lambda n=name: randomly_tagged(NONMANIFOLD[n][:2], 8, 0.4))
        for name in ("cross", "crossed_grids", "pinched", "moebius", "open_and_closed_fan")
    },
}


# --- Random cages for hypothesis

SEEDLINGS = [
    cube(),
    tetrahedron(),
    grid(1, 1),
    grid(2, 3),
    disk(3),
    bipyramid(5),
    prism(5),
    flower(5),
    bipyramid(12),
    flower(9),
    cylinder(4, 2),
    torus(3, 3),
    dodecahedron(),
    disjoint(tetrahedron(), grid(2, 2)),
]


@st.composite
def cages(draw, max_steps=6, keep=is_manifold, operations=OPERATIONS):
    """Random cages, open and closed: any faces, valences from 3 to a dozen and more, any labels.

    Pass ``keep=has_regular_boundary`` for those with regular boundaries only, and other operations,
    such as ``[*OPERATIONS, insert_vertex]``, for interior vertices of valence 2 as well.
    """
    start = draw(st.sampled_from(SEEDLINGS))

    def choose(n):
        return draw(st.integers(0, n - 1))

    grown = operated(start, choose, draw(st.integers(0, max_steps)), operations, keep)
    seed = draw(st.integers(0, 2**32 - 1))
    if seed == 0:
        return grown
    points, faces = relabelled(grown, seed)
    noise = random_points(len(points), seed) if seed % 2 else 0
    return points + noise, faces


def glued(faces, v, w):
    """One vertex in place of two; faces may come to hold it twice."""
    return [[v if x == w else x for x in face] for face in faces]


@st.composite
def tagged_cages(draw, max_steps=3):
    """Random cages with all kinds of tags and options; some are non-manifold."""
    points, faces = draw(cages(max_steps, operations=[*OPERATIONS, insert_vertex]))
    if draw(st.integers(0, 9)) == 0:
        points, faces, *_ = draw(st.sampled_from(list(NONMANIFOLD.values())))
    faces = [list(face) for face in faces]
    vertices, numbers = st.integers(0, len(points) - 1), st.integers(0, len(faces) - 1)
    if draw(st.integers(0, 7)) == 0:
        faces = glued(faces, draw(vertices), draw(vertices))
    if draw(st.integers(0, 7)) == 0:
        faces[draw(numbers)].reverse()
    creasing = draw(st.sampled_from(["uniform", "uniform", "chaikin"]))
    sharpness = st.one_of(
        st.sampled_from([0, *SHARPNESSES, 10, 12]),
        st.floats(0, 4),
        st.builds(
            Fraction, st.integers(0, 40), st.sampled_from([8] + [3] * (creasing == "uniform"))
        ),
    )
    edges = edges_of(faces)
    some = draw(st.lists(st.tuples(st.sampled_from(edges), sharpness), max_size=12))
    creases = dict(some)
    if draw(st.booleans()):  # a path of one sharpness
        path, s = [draw(st.sampled_from(edges))], draw(sharpness)
        for _ in range(draw(st.integers(1, 4))):
            path.append(draw(st.sampled_from([e for e in edges if path[-1][1] in e])))
        creases |= dict.fromkeys(path, s)
    return (
        points,
        faces,
        {
            "creases": creases,
            "corners": dict(draw(st.lists(st.tuples(vertices, sharpness), max_size=3))),
            "holes": sorted(draw(st.sets(numbers, max_size=2))) if draw(st.booleans()) else [],
            "boundary": draw(st.sampled_from(MODES)),
            "creasing": creasing,
            "triangles": draw(st.sampled_from(["catmull-clark", "catmull-clark", "smooth"])),
        },
    )
