"""Makes the bundled cage of ``limitsurf demo``: a small octopus with a pearl.

Run it to write the cage anew; a test compares the committed file with it to the last byte. z is
up, the face looks along -y. Each part is there for a reason: triangles around poles of valence 8
and 16, pentagons where eight segments become sixteen, hexagons on the eyes, arms rooted in vertices
of valence 5, a handle (the clasped front arms), an open boundary (the funnel), and a second
component (the pearl, a cube: valence 3).
"""

from __future__ import annotations

from itertools import pairwise
from math import cos, radians, sin, tau
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FILE = Path(__file__).resolve().parents[1] / "src" / "limitsurf" / "_data" / "demo.obj"

Vector = NDArray[np.float64]  # (3,)
Frame = NDArray[np.float64]  # (3, 3): rows forward, left, up
Loop = list[int]  # vertices of a cross-section, counter-clockwise seen from outside

# The body from the floor up: radius, height, and how far back each ring of 16 points leans.
# Segment i is centred at i/16 of a turn; odd segments carry an arm.
PROFILE = [
    (0.80, 0.16, 0.00),
    (1.02, 0.30, 0.00),
    (0.96, 0.78, 0.00),
    (0.74, 1.10, 0.03),
    (0.76, 1.42, 0.06),
    (0.92, 1.86, 0.12),
    (1.18, 2.36, 0.28),
    (1.26, 2.92, 0.46),
    (1.04, 3.40, 0.62),
]
ARM_BAND, FUNNEL_BAND, EYE_BAND = 1, 3, 4  # from a ring of PROFILE to the next

# Arms: segment, length of the first step, and the turns before each step in degrees, up and left.
CURLS: list[tuple[int, float, list[int], list[int]]] = [
    (1, 0.40, [-18, -12, 0, 14, 26, 34, 42, 50, 56], [0, 8, 14, 14, 4, -8, -14, -18, -18]),
    (3, 0.42, [-18, -14, 2, 16, 8, 8, 10, 8, 8], [0, -8, -18, -22, -26, -30, -38, -46, -52]),
    (5, 0.40, [-18, -12, 0, 16, 10, 8, 8, 8, 8], [0, 6, 16, 22, 26, 34, 42, 48, 54]),
    (7, 0.40, [-16, -12, 0, 16, 26, 34, 40, 48, 54], [0, -10, -14, -10, 0, 8, 14, 20, 22]),
    (9, 0.42, [-18, -14, 2, 16, 8, 8, 8, 8, 8], [0, 10, 20, 26, 30, 36, 42, 48, 54]),
    (15, 0.36, [4, 16, 24, 22, 6, -16, -26, 24, 34], [0, 6, 8, 4, -10, -14, -10, 0, 0]),
]
# The front arms meet in the plane x = 0: half of their path.
CLASP = [
    (-0.78, -1.42, 0.36),
    (-1.00, -1.90, 0.26),
    (-0.96, -2.38, 0.26),
    (-0.58, -2.74, 0.32),
    (0.00, -2.88, 0.36),
]


class Cage:
    def __init__(self) -> None:
        self.points: list[Vector] = []
        self.faces: list[Loop] = []

    def add(self, points: list[Vector]) -> Loop:
        self.points += points
        return list(range(len(self.points) - len(points), len(self.points)))

    def centre(self, loop: Loop) -> Vector:
        return np.asarray(np.mean([self.points[i] for i in loop], axis=0))

    def tube(self, loops: list[Loop]) -> None:
        """Quads from each loop to the next."""
        for old, new in pairwise(loops):
            for i, j in zip(range(len(old)), [*range(1, len(old)), 0], strict=True):
                self.faces.append([old[i], old[j], new[j], new[i]])

    def fan(self, loop: Loop, apex: Vector) -> None:
        (tip,) = self.add([apex])
        self.faces += [[a, b, tip] for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]


def outward(segment: float) -> Frame:
    """The frame that looks out of the body at a segment."""
    c, s = cos(segment * tau / 16), sin(segment * tau / 16)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def turned(frame: Frame, up: float, left: float) -> Frame:
    c, s = cos(radians(up)), sin(radians(up))
    pitch = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    c, s = cos(radians(left)), sin(radians(left))
    yaw = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(yaw @ pitch @ frame)


def section(centre: Vector, frame: Frame, radius: float, n: int = 4) -> list[Vector]:
    """A regular n-gon across the frame, in the order of the loop around a window of the body."""
    angles = [((i + 0.5) / n - 0.5) * tau for i in range(n)]
    return [centre + radius * (cos(a) * frame[1] + sin(a) * frame[2]) for a in angles]


def octopus() -> Cage:
    cage = Cage()
    body = [
        cage.add([np.array([0.0, lean, z]) + r * outward(i - 0.5)[0] for i in range(16)])
        for r, z, lean in PROFILE
    ]

    def window(band: int, first: int, last: int) -> Loop:
        """The loop around segments first to last of a band."""
        around = [i % 16 for i in range(first, last + 2)]
        return [body[band][i] for i in around] + [body[band + 1][i] for i in reversed(around)]

    open_windows = {(ARM_BAND, i) for i in range(1, 16, 2)} | {(FUNNEL_BAND, 0)}
    open_windows |= {(EYE_BAND, i) for i in (10, 11, 13, 14)}
    for band in range(len(body) - 1):
        for i in range(16):
            if (band, i) not in open_windows:
                cage.faces.append(window(band, i, i))

    crown = cage.add([np.array([0.0, 0.32, 1.5]) + 0.6 * cage.points[i] for i in body[-1][::2]])
    for j in range(8):
        outer = [body[-1][i % 16] for i in (2 * j, 2 * j + 1, 2 * j + 2)]
        cage.faces.append([*outer, crown[(j + 1) % 8], crown[j]])
    cage.fan(crown, np.array([0.0, 0.76, 3.72]))
    cage.fan(body[0][::-1], np.array([0.0, 0.0, 0.24]))

    for segment, step, ups, lefts in CURLS:
        loops = [window(ARM_BAND, segment, segment)]
        centre, frame = cage.centre(loops[0]), outward(segment)
        for i, (up, left) in enumerate(zip(ups, lefts, strict=True)):
            frame = turned(frame, up, left)
            centre = centre + step * (1 - 0.05 * i) * frame[0]
            loops.append(cage.add(section(centre, frame, 0.27 * 0.84**i)))
        cage.tube(loops)
        cage.faces.append(loops[-1])

    # The pearl floats at the tip of the last arm.
    axes = 0.36 * turned(outward(0), 30, 20)
    centre = centre + 0.55 * frame[0]
    square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    lower, upper = (
        cage.add([centre + np.array([x, y, z]) @ axes for x, y in square]) for z in (-1, 1)
    )
    cage.tube([lower, upper])
    cage.faces += [lower[::-1], upper]

    here, there = [window(ARM_BAND, 11, 11)], [window(ARM_BAND, 13, 13)]
    path = [cage.centre(here[0]), *map(np.array, CLASP)]
    path.append(path[-2] * [-1.0, 1.0, 1.0])
    for i in range(1, len(path) - 1):
        forward = path[i + 1] - path[i - 1]
        left = np.cross([0.0, 0.0, 1.0], forward)
        frame = np.array([v / np.linalg.norm(v) for v in (forward, left, np.cross(forward, left))])
        here.append(cage.add(section(path[i], frame, 0.27 * 0.9**i)))
        if i < len(CLASP):
            mirrored = cage.add([cage.points[k] * [-1.0, 1.0, 1.0] for k in here[-1]])
        else:
            mirrored = here[-1]  # the hands: one section, in the plane of symmetry
        there.append([mirrored[k] for k in (1, 0, 3, 2)])
    cage.tube(here)
    cage.tube(there)

    for first in (10, 13):
        loops = [window(EYE_BAND, first, first + 1)]
        centre, frame = cage.centre(loops[0]), turned(outward(first + 0.5), 12, 0)
        for radius, depth in [(0.34, 0.04), (0.34, 0.22), (0.18, 0.36)]:
            loops.append(cage.add(section(centre + depth * frame[0], frame, radius, n=6)))
        cage.tube(loops)
        cage.faces.append(loops[-1])

    loops = [window(FUNNEL_BAND, 0, 0)]
    centre, frame = cage.centre(loops[0]), outward(0)
    for radius, up, step in [(0.22, 10, 0.2), (0.2, 14, 0.22), (0.2, 16, 0.22), (0.3, 10, 0.16)]:
        frame = turned(frame, up, 0)
        centre = centre + step * frame[0]
        loops.append(cage.add(section(centre, frame, radius)))
    cage.tube(loops)
    return cage


def text() -> str:
    cage = octopus()
    lines = ["# the cage of `limitsurf demo`, made by tests/make_demo_cage.py"]
    # Adding 0.0 turns a negative zero into a plain one.
    lines += ["v {:.4f} {:.4f} {:.4f}".format(*(np.round(p, 4) + 0.0)) for p in cage.points]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in cage.faces]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_bytes(text().encode("ascii"))
