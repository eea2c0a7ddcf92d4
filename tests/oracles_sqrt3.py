"""The scheme of Kobbelt by naive refinement, with masks as the paper prints them.

Face by face, in Python, by numbers of any type: Fractions where masks are rational, mpmath else.
"""

from fractions import Fraction as F


def alpha(n, cosine):
    """Of all neighbours together, as in the paper; `cosine` is that of 2 pi / n."""
    return (4 - 2 * cosine(n)) / 9


def rational_cosine(n):
    """Of 2 pi / n, where it is rational."""
    return {2: F(-1), 3: F(-1, 2), 4: F(0), 6: F(1, 2)}[n]


def sides(faces):
    """(face, place in it) by the ends of each half-edge."""
    return {(f[k], f[k - 2]): (n, k) for n, f in enumerate(faces) for k in range(3)}


def step(points, faces, second, cosine, fixed=()):
    """One step: new points, new faces. Boundaries rest in the first, are cut in the second."""
    side = sides(faces)
    beside, curve = [set() for _ in points], {}
    for a, b in side:
        beside[a].add(b)
        beside[b].add(a)
        if (b, a) not in side:
            curve.setdefault(a, []).append(b)
            curve.setdefault(b, []).append(a)
    new = []
    for v, p in enumerate(points):
        if v in curve:
            moves = second and v not in fixed
            one, other = (points[w] for w in curve[v])
            new.append((4 * one + 19 * p + 4 * other) / 27 if moves else p)
        else:
            n = len(beside[v])
            a = alpha(n, cosine)
            new.append((1 - a) * p + a / n * sum(points[w] for w in beside[v]))

    def third(near, far):
        (beyond,) = (w for w in curve[near] if w != far)
        before = 2 * points[near] - points[far] if near in fixed else points[beyond]
        return (before + 16 * points[near] + 10 * points[far]) / 27

    middles, made = {}, []
    for n, f in enumerate(faces):
        rim = [k for k in range(3) if (f[k - 2], f[k]) not in side]
        if second and rim:
            (k,) = rim
            a, b, c = f[k], f[k - 2], f[k - 1]
            new += [third(a, b), third(b, a)]
            middles[n, (k + 2) % 3], middles[n, (k + 1) % 3] = len(new) - 2, len(new) - 1
            made.append((len(new) - 2, len(new) - 1, c))
        else:
            new.append((points[f[0]] + points[f[1]] + points[f[2]]) / 3)
            middles.update({(n, k): len(new) - 1 for k in range(3)})
    for (a, b), at in side.items():
        if (b, a) in side:
            made.append((a, middles[side[b, a]], middles[at]))
        elif not second:
            made.append((a, b, middles[at]))
    return new, made


def refined(points, faces, levels, cosine, fixed=()):
    """So many steps, from a cage on."""
    for level in range(levels):
        points, faces = step(points, faces, level % 2 == 1, cosine, fixed)
    return points, faces


def around(vertex, points, faces):
    """The neighbours of an interior vertex, counter-clockwise."""
    after = {f[k - 2]: f[k - 1] for f in faces for k in range(3) if f[k] == vertex}
    ring = [min(after)]
    while after[ring[-1]] != ring[0]:
        ring.append(after[ring[-1]])
    return [points[w] for w in ring]
