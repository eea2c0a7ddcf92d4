"""Naive butterfly schemes, typed from the papers: plain dicts, numbers of mpmath, no matrices.

Dyn, Levin and Gregory 1990 (figure 2, w = 1/16); Zorin, Schroeder and Sweldens 1996 (section 3);
boundaries by the four-point scheme of Dyn, Levin and Gregory 1987. What is missing beyond the
boundary edge (p, q) of a triangle (p, q, o) is p + q - o; ends on boundaries have no mask of their
own, and an edge between two extraordinary vertices takes the mean of both masks.
"""

from functools import cache

from mpmath import mp, mpf

DIGITS = 90


@cache
def ring_weights(N):
    """Of the neighbours of a vertex in the point of its edge to the first of them."""
    with mp.workdps(DIGITS):
        if N == 3:
            return mpf(5) / 12, mpf(-1) / 12, mpf(-1) / 12
        if N == 4:
            return mpf(3) / 8, mpf(0), mpf(-1) / 8, mpf(0)
        return tuple(
            (mpf(1) / 4 + mp.cospi(mpf(2) * j / N) + mp.cospi(mpf(4) * j / N) / 2) / N
            for j in range(N)
        )


class Triangles:
    """Part of a mesh: faces, points, and which of its edges are true boundaries."""

    def __init__(self, faces, points, rim):
        self.faces, self.points, self.rim = faces, points, rim
        self.across = {}
        for a, b, c in faces:
            self.across |= {(a, b): c, (b, c): a, (c, a): b}

    def ring(self, p, q):
        """Neighbours of p counter-clockwise from q on; do they close up? None if unknown."""
        found = [q]
        while True:
            after = self.across.get((p, found[-1]))
            if after is None:
                return found, (False if frozenset((p, found[-1])) in self.rim else None)
            if after == q:
                return found, True
            found.append(after)

    def clockwise_end(self, p, q):
        """The last neighbour of p clockwise from q on; None if it is unknown."""
        while (q, p) in self.across:
            q = self.across[q, p]
        return q if frozenset((p, q)) in self.rim else None


def combination(terms, points):
    return tuple(sum(w * points[v][k] for w, v in terms) for k in range(len(points[terms[0][1]])))


def edge_terms(mesh, a, b, modified):
    """(weight, vertex) of the point of an edge; None if not all of them are there."""
    if (a, b) not in mesh.across or (b, a) not in mesh.across:
        if (a, b) not in mesh.across:
            a, b = b, a
        if frozenset((a, b)) not in mesh.rim:
            return None
        ring, closed = mesh.ring(a, b)
        beyond = mesh.clockwise_end(b, a)
        if closed is None or beyond is None:
            return None
        return [
            (mpf(9) / 16, a),
            (mpf(9) / 16, b),
            (mpf(-1) / 16, ring[-1]),
            (mpf(-1) / 16, beyond),
        ]
    masks = []
    for p, q in ((a, b), (b, a)):
        ring, closed = mesh.ring(p, q)
        if not closed and mesh.clockwise_end(p, q) is None:
            return None
        if modified and closed and len(ring) not in (2, 6):
            masks.append([(mpf(3) / 4, p), *zip(ring_weights(len(ring)), ring, strict=True)])
    if masks:
        return [(w / len(masks), v) for mask in masks for w, v in mask]
    c, d = mesh.across[a, b], mesh.across[b, a]
    terms = [(mpf(1) / 2, a), (mpf(1) / 2, b), (mpf(1) / 8, c), (mpf(1) / 8, d)]
    for p, q, o in ((b, c, a), (c, a, b), (a, d, b), (d, b, a)):
        wing = mesh.across.get((q, p))
        if wing is not None:
            terms.append((mpf(-1) / 16, wing))
        elif frozenset((p, q)) in mesh.rim:
            terms += [(mpf(-1) / 16, p), (mpf(-1) / 16, q), (mpf(1) / 16, o)]
        else:
            return None
    return terms


def refined(mesh, modified):
    """A step, and the vertices of the new mesh by vertices and edges of the old one."""
    name, points, rim = {}, {}, set()

    def numbered(key, point):
        name[key] = len(name)
        points[name[key]] = point

    for v, point in mesh.points.items():
        numbered(v, point)
    for a, b in mesh.across:
        edge = frozenset((a, b))
        if edge not in name:
            terms = edge_terms(mesh, a, b, modified)
            if terms is not None:
                numbered(edge, combination(terms, mesh.points))
                if edge in mesh.rim:
                    rim |= {frozenset((name[a], name[edge])), frozenset((name[b], name[edge]))}
    faces = []
    for a, b, c in mesh.faces:
        x, y, z = (name.get(frozenset(e)) for e in ((b, c), (c, a), (a, b)))
        children = ((name[a], z, y), (name[b], x, z), (name[c], y, x), (x, y, z))
        faces += [child for child in children if None not in child]
    return Triangles(faces, points, rim), name


def around(mesh, face):
    """The part of a mesh that decides what becomes of a face."""
    near = set(face)
    ring = {v for f in mesh.faces if near & set(f) for v in f}
    faces = [f for f in mesh.faces if ring & set(f)]
    kept = {v for f in faces for v in f}
    return Triangles(faces, {v: mesh.points[v] for v in kept}, mesh.rim)


class Surface:
    """Limits at dyadic parameters, by refining what is around triangles again and again."""

    def __init__(self, points, faces, modified):
        faces = [tuple(map(int, face)) for face in faces]
        sides = {side for a, b, c in faces for side in ((a, b), (b, c), (c, a))}
        rim = {frozenset((a, b)) for a, b in sides if (b, a) not in sides}
        with mp.workdps(DIGITS):
            exact = {v: tuple(map(mpf, point)) for v, point in enumerate(points)}
        self.mesh, self.faces, self.modified = Triangles(faces, exact, rim), faces, modified

    def _child(self, mesh, face, u, v):
        fine, name = refined(around(mesh, face), self.modified)
        a, b, c = face
        x, y, z = (name[frozenset(e)] for e in ((b, c), (c, a), (a, b)))
        if 2 * (u + v) <= 1:
            return fine, (name[a], z, y), 2 * u, 2 * v, 1
        if 2 * u >= 1:
            return fine, (z, name[b], x), 2 * u - 1, 2 * v, 1
        if 2 * v >= 1:
            return fine, (y, x, name[c]), 2 * u, 2 * v - 1, 1
        return fine, (x, y, z), 1 - 2 * u, 1 - 2 * v, -1

    def evaluate(self, face, u, v, more=0):
        """Position, and derivatives in u and v by differences `more` steps on, if any."""
        with mp.workdps(DIGITS):
            mesh, corners, scale = self.mesh, self.faces[face], mpf(1)
            u, v = mpf(u), mpf(v)
            while (u, v) not in ((0, 0), (1, 0), (0, 1)):
                mesh, corners, u, v, sign = self._child(mesh, corners, u, v)
                scale *= 2 * sign
            for _ in range(more):
                mesh, corners, u, v, sign = self._child(mesh, corners, u, v)
                scale *= 2 * sign
            own = mesh.points[corners[1 if u == 1 else 2 if v == 1 else 0]]
            zero, one, two = (mesh.points[v] for v in corners)
            sides = (
                tuple(scale * (p - q) for p, q in zip(end, zero, strict=True)) for end in (one, two)
            )
            return (own, *sides)
