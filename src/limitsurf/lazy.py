"""Dask arrays of queries in, Dask arrays of answers out.

`LimitSurface` sends its methods here when one of face, u and v is a Dask array. Nothing is
evaluated until the answer is computed, chunk by chunk, wherever Dask computes. The surface is one
node of the task graph, on which all chunks depend: threads share it, and each process of a cluster
receives it once.
"""

from __future__ import annotations

import sys
from typing import Any
from uuid import uuid4
from weakref import WeakKeyDictionary

import numpy as np

_names: WeakKeyDictionary[object, str] = WeakKeyDictionary()


def is_lazy(*arrays: Any) -> bool:
    """Whether any of them is a Dask array; Dask is not imported to know.

    Examples
    --------
    >>> from limitsurf import lazy
    >>> lazy.is_lazy([0, 1], 0.5)
    False
    """
    dask = sys.modules.get("dask.array")
    if dask is not None:
        for x in arrays:  # (a generator would cost more than all else here)
            if isinstance(x, dask.Array):
                return True
    return False


def mapped(
    surface: object, method: str, face: Any, u: Any, v: Any, out: Any = None, **options: Any
) -> Any:
    """What a method of the surface returns, with a Dask array in place of each array.

    Parameters
    ----------
    surface : LimitSurface
    method : str
        A method whose answer is an array, or a tuple or dict of arrays of one shape and type.
    face, u, v : array_like
        They broadcast, and their chunks are aligned. Sizes of chunks may be unknown (NaN), as those
        of a data frame's columns are, if all have the same partitions.
    out : None
        Nothing else: answers are made when they are computed.
    **options
        Of the method.

    Returns
    -------
    dask.array.Array, or a tuple or dict of them
        Chunks are those of the queries, and one along the axes of a point. Arrays of one answer
        come from one pass over the queries if they are computed together.

    Raises
    ------
    TypeError, ValueError
        At once for bad options, types and shapes. What is out of range is found out in computing;
        the error says where the chunk begins.

    Notes
    -----
    A surface of 100,000 faces is 20 MB in the graph, which travels with every computation. Above
    10 MB Dask's distributed scheduler says so in a warning.

    Examples
    --------
    >>> import dask.array as da
    >>> import limitsurf as ls
    >>> surface = ls.LimitSurface(ls.Mesh([[0, 0], [1, 0], [1, 2], [0, 2]], [[0, 1, 2, 3]]))
    >>> u = da.linspace(0, 1, 1_000_000, chunks=100_000)
    >>> points = surface.evaluate(0, u, 0.5)
    >>> points.shape, points.numblocks
    ((1000000, 2), (10, 1))
    >>> points.mean(axis=0).compute().round(12).tolist()
    [0.5, 1.0]
    """
    import dask.array as da

    if out is not None:
        raise TypeError(
            "out takes no answers to Dask arrays, which are computed later: store them with "
            "dask.array.store, or give NumPy arrays"
        )
    queries = _broadcast(face, u, v)
    # one query tells how answers look, and whether the call is one at all
    sample = getattr(surface, method)(*(np.zeros(1, x.dtype) for x in queries), **options)
    single = isinstance(sample, np.ndarray)
    parts = [sample] if single else list(sample.values() if isinstance(sample, dict) else sample)
    one = parts[0]
    chunks = max((x.chunks for x in queries), key=len)
    axes = [len(chunks) + k for k in range(one.ndim - 1)]
    chunks += tuple((n,) for n in one.shape[1:])
    if not single:  # stacked along a first axis
        chunks = ((len(parts),), *chunks)
        axes = [0, *(axis + 1 for axis in axes)]
    answers = da.map_blocks(
        limit_answers,
        *queries,
        surface=_node(surface),
        method=method,
        options=options,
        chunks=chunks,
        new_axis=axes or None,
        meta=np.empty((0,) * len(chunks), one.dtype),
    )
    if single:
        return answers
    arrays = [answers[k] for k in range(len(parts))]
    return dict(zip(sample, arrays, strict=True)) if isinstance(sample, dict) else tuple(arrays)


def matrices(
    surface: object, face: Any, u: Any, v: Any, orders: list[Any], **options: Any
) -> list[Any]:
    """Weights of derivatives of some orders, as Dask arrays (queries, vertices) of sparse blocks.

    A block is a csr_array of the queries of a chunk, in C order of their broadcast shape. Those of
    several orders come from one pass over the queries, on one pattern.

    Examples
    --------
    >>> import dask.array as da
    >>> import limitsurf as ls
    >>> surface = ls.LimitSurface(ls.Mesh([[0], [1], [1], [0]], [[0, 1, 2, 3]]))
    >>> W = surface.weights(0, da.linspace(0, 1, 1000, chunks=100), 0.5)
    >>> W.shape, W.numblocks, type(W.compute()).__name__
    ((1000, 4), (10, 1), 'csr_array')
    """
    import dask.array as da
    from dask import delayed

    queries = [x.reshape(-1) if x.ndim != 1 else x for x in _broadcast(face, u, v)]
    _, queries = da.unify_chunks(*(part for x in queries for part in (x, "q")))
    # one query tells whether the call is one at all
    own: Any = surface
    sample = own.weights(*(np.zeros(1, x.dtype) for x in queries), **options)
    if not hasattr(sample, "indices"):
        raise TypeError("weights of exact numbers take no Dask arrays: ask for them chunk by chunk")
    width, node, empty = sample.shape[1], _node(surface), type(sample)((0, 0))
    blocks: list[list[Any]] = [[] for _ in orders]
    start = 0.0
    for size, *parts in zip(queries[0].chunks[0], *(x.to_delayed() for x in queries), strict=True):
        found = delayed(limit_weights)(*parts, node, orders, options, start)
        for k, column in enumerate(blocks):
            column.append(da.from_delayed(found[k], (size, width), meta=empty))
        start += size
    return [da.concatenate(column, allow_unknown_chunksizes=True) for column in blocks]


def _broadcast(*given: Any) -> list[Any]:
    """Dask arrays of one shape, where shapes are known."""
    import dask.array as da

    arrays = [x if is_lazy(x) else da.from_array(_array(x), asarray=False) for x in given]
    if np.isnan([n for x in arrays for n in x.shape]).any():
        return arrays
    np.broadcast_shapes(*(x.shape for x in arrays))  # says more than Dask where they do not fit
    return list(da.broadcast_arrays(*arrays))


def _node(surface: object) -> Any:
    """A surface as one node of task graphs."""
    from dask import delayed

    name = _names.setdefault(surface, f"limit-surface-{uuid4().hex}")
    return delayed(surface, name=name, traverse=False)


def _array(values: Any) -> Any:
    """An array, masked if the values are."""
    return values if isinstance(values, np.ma.MaskedArray) else np.asarray(values)


def limit_weights(
    face: Any, u: Any, v: Any, surface: Any, orders: list[Any], options: Any, start: float
) -> Any:
    """Weights of a chunk of queries that begins at `start` (NaN if that is not known)."""
    try:
        return surface.weights(face, u, v, nu=orders, **options)
    except (IndexError, ValueError) as error:
        where = "a chunk" if np.isnan(start) else f"the chunk that begins at [{int(start)}]"
        raise type(error)(f"in {where}: {error}") from None


def limit_answers(
    face: Any,
    u: Any,
    v: Any,
    surface: object,
    method: str,
    options: dict[str, Any],
    block_info: Any = None,
) -> Any:
    """Answers to a chunk, stacked if there are several arrays."""
    try:
        found = getattr(surface, method)(face, u, v, **options)
    except (IndexError, ValueError) as error:
        start = [start for start, _ in block_info[0]["array-location"]]
        where = f"the chunk that begins at {start}" if start else "the chunk"
        raise type(error)(f"in {where}: {error}") from None
    if isinstance(found, np.ndarray):
        return found
    return np.stack(list(found.values()) if isinstance(found, dict) else found)
