"""Independent oracle for face-varying channels: naive, exact, sharing no code with `src`.

A channel gives each corner of each face an index into a list of values.  Around a vertex, faces
with the same index share a value; an edge across which they do not share is a seam.  The refiner
here keeps to that picture: it walks the faces of the geometry, looks up who shares what, and
classifies every value at every vertex.  It never builds a mesh of the values.  All numbers are
Fractions, so results compare with ``==``.

A vertex without a seam (and without a boundary that the mode sharpens) follows the geometry's rule
with the channel's values.  At any other vertex each value has a rule of its own:

"corner"  it never moves;
"own"     it lies on a crease that runs along the two ends of its fan, but stays a corner while
          the vertex or an edge inside the fan is sharp;
"other"   it lies on a crease, but stays a corner as long as the vertex's other value does.

``state = start(...)``, then ``state = step(state)``; ``state.values`` and the flat
``state.face_indices`` give the value at each corner of ``state.faces``.  The faces' vertices are
numbered: vertex points, edge points (edges as sorted pairs, in order), face points; the children
of a face come in the order of its corners, each with the parent's corner first.

References
----------
[DKT] DeRose, Kass, Truong, Subdivision surfaces in character animation, SIGGRAPH 1998
[OSD] OpenSubdiv 3 documentation, Subdivision surfaces: face-varying interpolation rules
"""

import math
import operator
from collections import Counter
from dataclasses import dataclass, replace
from fractions import Fraction

MODES = ("none", "corners_only", "corners_plus1", "corners_plus2", "boundaries", "all")

INFINITE = 10  # this sharp or sharper never decays
TRIANGLE_WEIGHT = Fraction(47, 100)  # of a triangle's face point, triangles="smooth"


@dataclass(frozen=True)
class State:
    """Faces and sharpness of the geometry, and a channel over them; never changed in place."""

    faces: list
    edge_sharpness: dict  # of every edge (a, b), a < b
    vertex_sharpness: list
    creasing: str
    triangles: str
    mode: str
    values: list  # of tuples of Fractions
    corner_values: list  # for each face the indices at its corners
    seams: set  # of edges
    rules: dict  # {vertex: {value index: rule}}; a vertex that is absent follows the geometry

    @property
    def face_indices(self):
        """Indices into ``values``, flat, face corner by face corner."""
        return [index for indices in self.corner_values for index in indices]


def start(
    faces,
    n_vertices,
    creases,
    corners,
    boundary,
    creasing,
    triangles,
    values,
    face_indices,
    mode,
):
    """Classify the edges, vertices and values of a cage.

    ``creases`` maps pairs of vertices, ``corners`` vertices, to sharpness; ``face_indices`` is flat
    over the face corners.  No face may have a vertex twice; else the cage need not be manifold.
    """
    assert mode in MODES
    faces = [list(face) for face in faces]
    face_indices = iter(face_indices)
    corner_values = [[next(face_indices) for _ in face] for face in faces]
    edge_corners, vertex_corners = _incidence(faces)
    odd_edges, odd_vertices = _not_manifold(faces, edge_corners, vertex_corners)

    edge_sharpness = dict.fromkeys(edge_corners, 0)
    for (a, b), s in creases.items():
        edge_sharpness[_edge(a, b)] = _exact(s)
    for edge, at in edge_corners.items():
        if len(at) == 1 or edge in odd_edges:
            edge_sharpness[edge] = math.inf

    vertex_edges = _vertex_edges(edge_corners)
    vertex_sharpness = [_exact(corners.get(v, 0)) for v in range(n_vertices)]
    for v, at in vertex_corners.items():
        edges = vertex_edges[v]
        fins = (
            sum(e in odd_edges for e in edges) == 2
            and all(len(edge_corners[e]) > 1 for e in edges)
            and len(at) > len(edges)
        )
        alone = len(at) == 1 and len(edges) == 2
        if (alone and boundary == "edge_and_corner") or (v in odd_vertices and not fins):
            vertex_sharpness[v] = math.inf

    seams = {
        (a, b)
        for (a, b), at in edge_corners.items()
        if len({(_at(faces, corner_values, f, a), _at(faces, corner_values, f, b)) for f, _ in at})
        > 1
    }
    state = State(
        faces=faces,
        edge_sharpness=edge_sharpness,
        vertex_sharpness=vertex_sharpness,
        creasing=creasing,
        triangles=triangles,
        mode=mode,
        values=[tuple(Fraction(x) for x in value) for value in values],
        corner_values=corner_values,
        seams=seams,
        rules={},
    )
    rules = {}
    for v, at in vertex_corners.items():
        on_boundary = any(len(edge_corners[e]) == 1 for e in vertex_edges[v])
        if (
            any(e in seams for e in vertex_edges[v])
            or len({corner_values[f][i] for f, i in at}) > 1
            or (on_boundary and mode == "boundaries")
            or (len(at) == 1 and mode != "none")
        ):
            rules[v] = _first_rules(state, v, at, on_boundary, v in odd_vertices)
    return replace(state, rules=rules)


def _first_rules(state, v, corners, on_boundary, not_manifold):
    """Rule of each value at a vertex of the cage that does not just follow the geometry."""
    mode, sharpness = state.mode, state.edge_sharpness
    values = list(dict.fromkeys(state.corner_values[f][i] for f, i in corners))
    size = Counter(state.corner_values[f][i] for f, i in corners)
    fans = {value: _fan(state, corners, value) for value in values}
    several = {value: len(fans[value][0]) != 2 for value in values}  # fans, or one cut by a seam
    infinite = {value: any(_infinite(sharpness[e]) for e in fans[value][1]) for value in values}
    decaying = {value: any(0 < sharpness[e] < INFINITE for e in fans[value][1]) for value in values}

    linked = mode in ("corners_plus1", "corners_plus2")
    all_sharp = (
        mode in ("boundaries", "all")
        or not_manifold
        or _infinite(state.vertex_sharpness[v])
        or (linked and len(values) > 2)
        or (linked and len(values) == 2 and any(several[x] or infinite[x] for x in values))
    )
    if mode == "corners_plus2":
        all_sharp |= len(values) == 2 and any(size[x] == 1 for x in values)
        all_sharp |= len(values) == 1 and not on_boundary  # a seam ends here

    rules = {}
    for value in values:
        if all_sharp or several[value] or infinite[value] or (size[value] == 1 and mode != "none"):
            rules[value] = "corner"
        elif (
            linked
            and len(values) == 2
            and state.vertex_sharpness[v] == 0
            and not decaying[value]
            and any(decaying.values())
        ):
            rules[value] = "other"
        else:
            rules[value] = "own"
    return rules


def step(state):
    """Refine once: new faces, sharpness, values and rules."""
    faces, corner_values = state.faces, state.corner_values
    edge_corners, vertex_corners = _incidence(faces)
    vertex_edges = _vertex_edges(edge_corners)
    n_vertices = len(state.vertex_sharpness)
    edges = sorted(edge_corners)
    edge_vertex = {e: n_vertices + k for k, e in enumerate(edges)}
    face_vertex = [n_vertices + len(edges) + f for f in range(len(faces))]

    # Sharpness of the children: of a vertex, and of an edge at each of its ends.
    child_vertex = [_decayed(s) for s in state.vertex_sharpness]
    child_edge = {(e, v): _child_sharpness(state, e, vertex_edges[v]) for e in edges for v in e}

    values, index_of = [], {}

    def keep(key, value):
        index_of[key] = len(values)
        values.append(value)

    face_point = [_mean([state.values[index] for index in indices]) for indices in corner_values]
    rules = {}
    for v in range(n_vertices):
        at = vertex_corners.get(v, [])
        incident = vertex_edges.get(v, [])
        if v not in state.rules:
            for value in sorted({corner_values[f][i] for f, i in at}):
                point = _geometric_vertex(
                    state, v, value, at, incident, face_point, child_vertex, child_edge
                )
                keep((v, value), point)
            continue
        rules[v] = {}
        for value, rule in state.rules[v].items():
            point, rule = _value_point(
                state, v, value, rule, at, incident, child_vertex, child_edge
            )
            keep((v, value), point)
            rules[v][index_of[v, value]] = rule
    for e in edges:
        at = edge_corners[e]
        halves = [child_edge[e, v] for v in e]
        if e in state.seams:  # every face keeps a midpoint of its own
            for f, _ in at:
                keep((e, f), _mean(_edge_values(state, f, e)))
        else:
            point = _edge_point(state, e, at, face_point, halves)
            keep((e, None), point)
        linear = state.mode in ("boundaries", "all")
        if e in state.seams or (linear and len(at) == 1):
            own = {index_of[e, f if e in state.seams else None] for f, _ in at}
            rules[edge_vertex[e]] = dict.fromkeys(sorted(own), "corner" if linear else "own")
    for f, point in enumerate(face_point):
        keep(f, point)

    child_faces, child_values = [], []
    for f, face in enumerate(faces):
        for i, v in enumerate(face):
            after, before = _edge(v, face[(i + 1) % len(face)]), _edge(face[i - 1], v)
            child_faces.append([v, edge_vertex[after], face_vertex[f], edge_vertex[before]])
            child_values.append(
                [
                    index_of[v, corner_values[f][i]],
                    index_of[after, f if after in state.seams else None],
                    index_of[f],
                    index_of[before, f if before in state.seams else None],
                ]
            )

    smooth = dict.fromkeys(_incidence(child_faces)[0], 0)
    halves = {(v, edge_vertex[e]): s for (e, v), s in child_edge.items()}
    return replace(
        state,
        faces=child_faces,
        edge_sharpness=smooth | halves,
        vertex_sharpness=child_vertex + [0] * (len(edges) + len(faces)),
        values=values,
        corner_values=child_values,
        seams={(v, edge_vertex[e]) for e in state.seams for v in e},
        rules=rules,
    )


# --- values at a seam -----------------------------------------------------------------------------


def _value_point(state, v, value, rule, corners, incident, child_vertex, child_edge):
    """Where a value with a rule of its own moves, and the rule of its child."""
    here = state.values[value]
    if state.mode == "all" or rule == "corner":
        return here, "corner"
    leader = value
    if rule == "other":
        (leader,) = set(state.rules[v]) - {value}
    inside = _fan(state, corners, leader)[1]
    if child_vertex[v] > 0 or any(child_edge[e, v] > 0 for e in inside):
        return here, rule
    if rule == "other" and any(0 < child_edge[e, v] < INFINITE for e in incident):
        # As in OpenSubdiv: while sharpness decays along the seam itself, the value whose leader
        # has just become smooth is released one step later, and then at once.
        return here, "own"
    (_, a), (_, b) = _fan(state, corners, value)[0]
    crease = _blend((6, here), (1, state.values[a]), (1, state.values[b]))
    gone = [state.vertex_sharpness[v], *(state.edge_sharpness[e] for e in inside)]
    return _transition(crease, here, [s for s in gone if s > 0]), "own"


def _fan(state, corners, value):
    """The (edge, value at its other end) where a value's faces end, and the edges inside.

    What two of the faces agree about is inside.  A seam that runs into the middle of the faces
    gives two ends: the same edge with different values.
    """
    links = Counter()
    for f, i in corners:
        face, indices = state.faces[f], state.corner_values[f]
        if indices[i] == value:
            for j in ((i + 1) % len(face), i - 1):
                links[_edge(face[i], face[j]), indices[j]] += 1
    ends = [link for link, count in links.items() if count == 1]
    return ends, [edge for (edge, _), count in links.items() if count > 1]


# --- the geometry's rules, applied to values ------------------------------------------------------


def _geometric_vertex(state, v, value, corners, incident, face_point, child_vertex, child_edge):
    """Vertex point by the geometry's rule [DKT], from the values around."""
    here = state.values[value]
    if state.mode == "all":
        return here
    across = {}  # no edge here is a seam, so all of its faces agree about the value
    for f, i in corners:
        face, indices = state.faces[f], state.corner_values[f]
        for j in ((i + 1) % len(face), i - 1):
            across[_edge(face[i], face[j])] = state.values[indices[j]]

    def mask(vertex_sharpness, sharp):
        if vertex_sharpness > 0 or len(sharp) > 2:
            return "corner", here
        if len(sharp) == 2:
            return "crease", _blend((6, here), (1, across[sharp[0]]), (1, across[sharp[1]]))
        n = len(corners)
        around = [(1, face_point[f]) for f, _ in corners] + [(1, across[e]) for e in incident]
        return "smooth", _blend((n * (n - 2), here), *around)

    before, old = mask(
        state.vertex_sharpness[v], [e for e in incident if state.edge_sharpness[e] > 0]
    )
    after, new = mask(child_vertex[v], [e for e in incident if child_edge[e, v] > 0])
    if before in ("smooth", after):
        return old
    gone = [state.edge_sharpness[e] for e in incident if child_edge[e, v] == 0]
    if child_vertex[v] == 0:
        gone.append(state.vertex_sharpness[v])
    return _transition(new, old, [s for s in gone if s > 0])


def _edge_point(state, edge, corners, face_point, halves):
    """Edge point of an edge that is no seam."""
    a, b = _edge_values(state, corners[0][0], edge)
    crease = _mean([a, b])
    s = state.edge_sharpness[edge]
    if state.mode == "all" or s >= 1 or (s > 0 and min(halves) > 0):
        return crease
    weight = Fraction(1, 4)
    if state.triangles == "smooth":
        weights = [
            TRIANGLE_WEIGHT if len(state.faces[f]) == 3 else Fraction(1, 4) for f, _ in corners
        ]
        weight = sum(weights) / 2
    (f, _), (g, _) = corners
    rest = Fraction(1, 2) - weight
    smooth = _blend((rest, a), (rest, b), (weight, face_point[f]), (weight, face_point[g]))
    return _blend((1 - s, smooth), (s, crease)) if s else smooth


def _child_sharpness(state, edge, around):
    """Sharpness of the half of an edge at a vertex with the edges ``around``."""
    s = state.edge_sharpness[edge]
    others = [t for e in around if e != edge and 0 < (t := state.edge_sharpness[e]) < INFINITE]
    if state.creasing == "chaikin" and 0 < s < INFINITE and others:
        return max(Fraction(3, 4) * s + Fraction(1, 4) * sum(others) / len(others) - 1, 0)
    return _decayed(s)


def _decayed(s):
    return s if _infinite(s) else max(s - 1, 0)


def _transition(new, old, gone):
    """Blend two masks' points by the mean of the sharpness that vanishes in this step [DKT]."""
    w = min(sum(gone) / Fraction(len(gone)), 1) if gone else 0
    return _blend((1 - w, new), (w, old)) if w else new


# --- faces, edges, numbers ------------------------------------------------------------------------


def _edge(a, b):
    return (a, b) if a < b else (b, a)


def _incidence(faces):
    """The corners (face, position) at each edge, by its face's direction, and at each vertex."""
    edges, vertices = {}, {}
    for f, face in enumerate(faces):
        for i, v in enumerate(face):
            edges.setdefault(_edge(v, face[(i + 1) % len(face)]), []).append((f, i))
            vertices.setdefault(v, []).append((f, i))
    return edges, vertices


def _vertex_edges(edges):
    around = {}
    for e in sorted(edges):
        for v in e:
            around.setdefault(v, []).append(e)
    return around


def _not_manifold(faces, edge_corners, vertex_corners):
    """Edges of three faces or of two faces in one direction; their ends; vertices of two fans."""
    odd_edges = {
        e
        for e, at in edge_corners.items()
        if len(at) > 2 or (len(at) == 2 and faces[at[0][0]][at[0][1]] == faces[at[1][0]][at[1][1]])
    }
    odd_vertices = {v for e in odd_edges for v in e}
    for v, at in vertex_corners.items():
        left, fan = {f for f, _ in at}, []
        while left:
            if not fan:
                odd_vertices |= {v} if len(left) < len(at) else set()
                fan = [min(left)]
            f = fan.pop()
            left.discard(f)
            for i, a in enumerate(faces[f]):
                edge = _edge(a, faces[f][i - 1])
                if v in edge:
                    fan += [g for g, _ in edge_corners[edge] if g in left]
    return odd_edges, odd_vertices


def _at(faces, corner_values, f, v):
    return corner_values[f][faces[f].index(v)]


def _edge_values(state, f, edge):
    return [state.values[_at(state.faces, state.corner_values, f, v)] for v in edge]


def _infinite(s):
    return s >= INFINITE


def _exact(s):
    return math.inf if _infinite(s) else Fraction(s)


def _blend(*terms):
    """Weighted mean of points, for weights of any sum."""
    weights = _integers(w for w, _ in terms)[0]
    blended = []
    for xs in zip(*(p for _, p in terms), strict=True):
        numerators, D = _integers(xs)
        blended.append(Fraction(sum(map(operator.mul, weights, numerators)), D * sum(weights)))
    return tuple(blended)


def _integers(fractions):
    """Integers, and the common denominator of which they are the numerators."""
    fractions = list(fractions)
    D = math.lcm(*(x.denominator for x in fractions))
    return [x.numerator * (D // x.denominator) for x in fractions], D


def _mean(points):
    return _blend(*((1, p) for p in points))
