"""Where compiled kernels find what scattered queries need: patches, parameters, control points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf._kernels.evaluation import (
    AHEAD,
    FAR,
    KIND,
    ROW,
    TURN,
    TURNS,
    Patches,
    Points,
    Room,
    Tables,
    control_points,
)
from limitsurf._kernels.jit import differences, inlined, prefetch

Array = NDArray[Any]


def finder(shape: Any) -> tuple[Any, Any, Any]:
    """What finds queries, asks for their memory and hands out control points of splines."""
    size = shape.POINTS
    pieces = np.concatenate([shape.PIECES, shape.AROUND])
    around, _, copied, fetch = control_points(shape)
    same = np.arange(size, dtype=np.int32)
    near = differences(size, shape.OWN)
    located, turned, place_around = shape.located, shape.turned, shape.place_around

    @inlined
    def locate(
        face: Array, u: Array, v: Array, begin: int, count: int, patches: Patches, room: Room
    ) -> bool:
        """Find a block of queries; False if one is out of range."""
        for k in range(count):
            if begin + k + 4 * AHEAD < len(face):
                prefetch(patches.info, face[begin + k + 4 * AHEAD])
            code, depth, s, t, fine = located(face[begin + k], u[begin + k], v[begin + k], patches)
            if not fine:
                return False
            level, piece = 0, 0
            if code >= 0:
                turn = code >> TURN & TURNS
                s, t = turned(s, t, turn)
                if code >> KIND > 1:
                    level, piece, s, t = place_around(s, t, turn)
            room.codes[k], room.s[k], room.t[k] = code, s, t
            room.places[k], room.depths[k] = piece + 4 * (level + 1), depth
        return True

    @inlined
    def ask(
        i: int, count: int, room: Room, patches: Patches, tables: Tables, points: Points
    ) -> None:
        """Prefetch what queries some way beyond number i need."""
        codes = room.codes
        for j in range(0 if i == 0 else i + 2 * AHEAD, min(i + 2 * AHEAD + 1, count)):
            code = codes[j]
            if code >= 0 and code >> KIND <= 1:
                prefetch(patches.ids, (code & ROW) * size)
        j = i + AHEAD
        if j >= count or codes[j] < 0:
            return
        fetch(codes[j], room.places[j], patches, tables, points)

    @inlined
    def controls(
        code: int, place: int, channel: int, patches: Patches, tables: Tables, points: Points,
        room: Room,
    ) -> tuple[Array, Array, int, int, int]:  # fmt: skip
        """Control points of a spline: of what, numbers, where these begin, base, channel."""
        grid, numbers, at, base = points.high, patches.ids, (code & ROW) * size, 0
        copy = copied(code, patches)
        if code >> KIND > 1:
            base, _, at = around(code, place, tables)
            grid, numbers = points.fine, pieces
        elif copy >= 0:
            grid, numbers, at, base = points.fine, same, 0, copy
        elif code >> FAR & 1:
            near(points.high, points.extras, patches.ids, at, channel, room.near)
            grid, numbers, at, channel = room.near, same, 0, 0
        return grid, numbers, at, base, channel

    return locate, ask, controls
