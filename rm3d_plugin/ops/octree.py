"""Neighbour search in a linear octree (METHOD 4; Behley et al., ICRA 2015, as improved in the paper)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops._octree_build import build_octants
from rm3d_plugin.ops._octree_groups import count_groups, nearest_groups, radius_groups
from rm3d_plugin.ops._octree_kernels import gather_columns, pack_rows, radius_block, scatter_rows
from rm3d_plugin.ops._parallel import map_ahead, map_blocks
from rm3d_plugin.ops.morton import BITS, enclosing_cube, morton_codes, morton_order, sort_codes

CHUNK = 1 << 14  # points of the tree whose neighbours are held at a time
GATHERED = 1 << 16  # points that one thread puts in order at a time
BLOCK = 4096  # queries that one thread answers at a time
HELD = 1 << 17  # queries whose answers are held twice while they are put in order
SORT_QUERIES_FROM = 64  # fewer queries are answered in the order they come

Block = tuple[np.ndarray, np.ndarray, np.ndarray, int]  # counts, indices, squared distances, visited octants


@dataclass(frozen=True, eq=False)
class Neighbors:
    """Neighbours of each query, in CSR.

    Attributes:
        indices: (E,) int32 point numbers; those of query i are ``indices[offsets[i]:offsets[i + 1]]``.
        offsets: (M + 1,) int64.
        sq_dists: (E,) float64 squared distances in square metres.
        visits: Octants that the search looked at, all queries together.
    """

    indices: Int[np.ndarray, ' pairs']
    offsets: Int[np.ndarray, ' queries_and_one']
    sq_dists: Float[np.ndarray, ' pairs']
    visits: int = 0

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def counts(self) -> Int[np.ndarray, ' queries']:
        """Neighbours of each query."""
        return np.diff(self.offsets)


@dataclass(frozen=True, eq=False)
class Knn:
    """The k nearest points of each query.

    Attributes:
        indices: (M, k) int32 point numbers, nearest first, equal distances by point number; -1 where fewer exist.
        sq_dists: (M, k) float64 squared distances in square metres; inf where fewer exist.
        visits: Octants that the search looked at, all queries together.
    """

    indices: Int[np.ndarray, 'queries k']
    sq_dists: Float[np.ndarray, 'queries k']
    visits: int = 0


def _checked(name: str, points: np.ndarray) -> Float[np.ndarray, 'points 3']:
    given = np.asarray(points)
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f'Octree: {name}: expected shape (N, 3), got {given.shape}')
    # Kernels are compiled for one kind of array only: float64, rows side by side, writable.
    usable = given.dtype == np.float64 and given.flags.c_contiguous and given.flags.writeable
    array = given if usable else np.empty(given.shape)

    def copy(start: int, stop: int) -> int:
        if not usable:
            array[start:stop] = given[start:stop]
        finite = np.isfinite(array[start:stop])
        return 0 if finite.all() else int((~finite.all(axis=1)).sum())

    if bad := sum(map_blocks(copy, len(array), GATHERED)):
        raise ValueError(f'Octree: {name}: {bad} of {len(array)} rows are NaN or infinite; drop them first')
    return array


def _checked_radii(r: float | np.ndarray, queries: int) -> Float[np.ndarray, ' queries']:
    radii = np.asarray(r, dtype=np.float64)
    if radii.ndim > 0 and radii.shape != (queries,):
        raise ValueError(f'Octree: r: expected one radius or {queries} (one a query), got shape {radii.shape}')
    if not (np.isfinite(radii).all() and (radii >= 0).all()):
        raise ValueError(f'Octree: r: expected a radius in metres, got {radii.min() if radii.size else radii}')
    return np.array(np.broadcast_to(radii, (queries,)))  # writable: a read-only array would be compiled for anew


class Octree:
    """Points in Morton order, so that each octant is a contiguous range, and the octants over them.

    Distances are computed in float64 from the coordinates as given, so that wide coordinates lose nothing and the
    results are those of an exhaustive search (``d * d <= r * r``), whatever the number of threads. Queries are answered
    along the Morton curve and returned in the order they came.

    Args:
        points: (N, 3) metres, finite; float32 or float64.
        leaf_size: An octant with more points is divided (larger: fewer octants, longer scans).
        skip_disjoint: Rule 1, an octant that does not overlap the query ball is skipped.
        stop_inside: Rule 2, a ball inside an octant ends the search when the octant is done.
        take_contained: Rule 3, an octant inside the ball gives its points without descent or test.
        group: Queries that lie together share one descent, in which an octant is skipped when it overlaps none of
            their balls and taken whole when it lies in all of them. False, or a rule switched off, answers each alone.

    Raises:
        ValueError: A shape does not fit, or a coordinate is NaN or infinite.
    """

    def __init__(
        self,
        points: Float[np.ndarray, 'points 3'],
        leaf_size: int = 32,
        *,
        skip_disjoint: bool = True,
        stop_inside: bool = True,
        take_contained: bool = True,
        group: bool = True,
    ) -> None:
        if leaf_size < 1:
            raise ValueError(f'Octree: leaf_size: expected at least 1, got {leaf_size}')
        array = _checked('points', points)
        self.leaf_size = leaf_size
        self._rules = (bool(skip_disjoint), bool(stop_inside), bool(take_contained))
        self._group = group and all(self._rules)
        self._source = points
        self._grid = enclosing_cube(array)
        self.order: Int[np.ndarray, ' points']
        self.order, codes = sort_codes(morton_codes(array, self._grid))
        columns = np.empty((3, len(array)))

        def gather(start: int, stop: int) -> None:
            gather_columns(array, self.order[start:stop], columns[:, start:stop])

        map_blocks(gather, len(array), GATHERED)
        if len(array):
            self._tree = (columns, self.order, *build_octants(columns, codes, leaf_size, self._grid.edge))

    def __len__(self) -> int:
        return len(self.order)

    def radius(
        self,
        queries: Float[np.ndarray, 'queries 3'],
        r: float | Float[np.ndarray, ' queries'],
        max_neighbors: int | None = None,
        ordered: bool = True,
    ) -> Neighbors:
        """Points within a distance of each query.

        Args:
            queries: (M, 3) metres; a query that is itself a point of the tree finds itself.
            r: Radius in metres, inclusive; one for all queries or one each.
            max_neighbors: Keep the nearest so many of each query; None keeps all.
            ordered: Sort each query's neighbours by distance, then point number. False spares that where all are kept
                and leaves them in the order of the tree, which is deterministic too.

        Returns:
            The neighbours in CSR, in the order of the queries.

        Raises:
            ValueError: A query is not finite, ``r`` is negative or not finite, or ``max_neighbors`` is below 1.
        """
        if max_neighbors is not None:
            return self.hybrid(queries, r, max_neighbors)
        return self._radius(*self._prepare(queries), r, ordered)

    def _radius(
        self,
        array: Float[np.ndarray, 'queries 3'],
        rows: Int[np.ndarray, ' queries'],
        r: float | Float[np.ndarray, ' queries'],
        ordered: bool,
    ) -> Neighbors:
        """All points within ``r`` of the queries, which are answered in the order of ``rows``."""
        radii = _checked_radii(r, len(array))
        if not len(self) or not len(array):
            return _none(len(array))

        def work(start: int, stop: int) -> Block:
            return self._search(array, rows[start:stop], radii, ordered)

        if self._group and len(rows) > HELD:
            return self._radius_of_many(array, rows, radii, work)
        return _assemble(map_blocks(work, len(rows), BLOCK), rows)

    def _search(self, array: np.ndarray, rows: np.ndarray, radii: np.ndarray, ordered: bool) -> Block:
        """The answers to some queries, row after row."""
        if self._group:
            return radius_groups(self._tree, array, rows, radii, ordered)
        margin = 1e-6 * self._grid.edge / 2**BITS  # far above rounding, far below the smallest octant
        return radius_block(self._tree, array, rows, self._grid.low, radii, margin, self._rules, ordered)

    def _radius_of_many(
        self, queries: np.ndarray, rows: np.ndarray, radii: np.ndarray, work: Callable[[int, int], Block]
    ) -> Neighbors:
        """Counting first costs a second search, and spares to hold all answers twice."""
        counts = np.empty(len(rows), dtype=np.int64)

        def count(start: int, stop: int) -> int:
            return int(count_groups(self._tree, queries, rows[start:stop], radii, counts))

        visits = sum(map_blocks(count, len(rows), BLOCK))
        offsets = _offsets(counts)
        indices, sq_dists = np.empty(offsets[-1], dtype=np.int32), np.empty(offsets[-1])

        def fill(start: int, stop: int) -> None:
            found, near, dists, _ = work(start, stop)
            scatter_rows(rows[start:stop], offsets, found, near, dists, indices, sq_dists)

        map_blocks(fill, len(rows), BLOCK)
        return Neighbors(indices, offsets, sq_dists, visits)

    def around(
        self, r: float, max_neighbors: int | None = None, ordered: bool = True, chunk: int = CHUNK
    ) -> Iterator[tuple[Int[np.ndarray, ' some'], Neighbors]]:
        """The neighbourhoods of the tree's own points, some at a time along the Morton curve.

        The quickest way to meet all of them: memory is read and written in its order, and what was met can be let go.
        Threads search ahead while the caller works with what it got.

        Args:
            r: Radius in metres, inclusive.
            max_neighbors: As :meth:`radius`.
            ordered: As :meth:`radius`.
            chunk: Points at a time (larger: more memory).

        Yields:
            Numbers of some points, and their neighbours in that order.
        """
        radius = _checked_radii(r, 1)

        def near(start: int, stop: int) -> tuple[Int[np.ndarray, ' some'], Neighbors]:
            members = self.order[start:stop]
            queries, rows = np.ascontiguousarray(self._tree[0][:, start:stop].T), np.arange(stop - start)
            if max_neighbors is not None:
                return members, self._hybrid(queries, rows, r, max_neighbors)
            counts, indices, sq_dists, visits = self._search(queries, rows, radius.repeat(len(rows)), ordered)
            return members, Neighbors(indices, _offsets(counts), sq_dists, visits)

        yield from map_ahead(near, len(self), chunk)

    def hybrid(
        self, queries: Float[np.ndarray, 'queries 3'], r: float | Float[np.ndarray, ' queries'], max_neighbors: int
    ) -> Neighbors:
        """The nearest ``max_neighbors`` points within ``r`` metres, as :meth:`radius` with a cap."""
        if max_neighbors < 1:
            raise ValueError(f'Octree.hybrid: max_neighbors: expected at least 1, got {max_neighbors}')
        return self._hybrid(*self._prepare(queries), r, max_neighbors)

    def _hybrid(
        self,
        array: Float[np.ndarray, 'queries 3'],
        rows: Int[np.ndarray, ' queries'],
        r: float | Float[np.ndarray, ' queries'],
        max_neighbors: int,
    ) -> Neighbors:
        radii = _checked_radii(r, len(array))
        if not len(self) or not len(array):
            return _none(len(array))
        k = min(max_neighbors, len(self))
        indices, sq_dists = np.empty((len(array), k), dtype=np.int32), np.empty((len(array), k))
        counts, visits = self._nearest(array, rows, k, radii, indices, sq_dists)
        offsets = _offsets(counts)
        if offsets[-1] == indices.size:
            return Neighbors(indices.reshape(-1), offsets, sq_dists.reshape(-1), visits)
        packed = np.empty(offsets[-1], dtype=np.int32), np.empty(offsets[-1])
        pack_rows(offsets, indices, sq_dists, *packed)
        return Neighbors(packed[0], offsets, packed[1], visits)

    def knn(self, queries: Float[np.ndarray, 'queries 3'], k: int) -> Knn:
        """The k nearest points of each query; a query that is itself a point of the tree finds itself.

        Args:
            queries: (M, 3) metres.
            k: At least 1.

        Raises:
            ValueError: A query is not finite, or ``k`` is below 1.
        """
        if k < 1:
            raise ValueError(f'Octree.knn: k: expected at least 1, got {k}')
        array, rows = self._prepare(queries)
        indices, sq_dists = np.empty((len(array), k), dtype=np.int32), np.empty((len(array), k))
        found = min(k, len(self)) if len(array) else 0
        indices[:, found:], sq_dists[:, found:] = -1, np.inf
        if not found:
            return Knn(indices, sq_dists)
        radii = np.full(len(array), np.inf)
        return Knn(indices, sq_dists, self._nearest(array, rows, found, radii, indices, sq_dists)[1])

    def _nearest(
        self,
        queries: np.ndarray,
        rows: np.ndarray,
        k: int,
        radii: np.ndarray,
        indices: Int[np.ndarray, 'queries k'],
        sq_dists: Float[np.ndarray, 'queries k'],
    ) -> tuple[Int[np.ndarray, ' queries'], int]:
        """Fill the heads of the rows; how many each query found, and the octants visited."""
        counts = np.empty(len(rows), dtype=np.int64)

        def work(start: int, stop: int) -> int:
            return int(nearest_groups(self._tree, queries, rows[start:stop], k, radii, counts, indices, sq_dists))

        return counts, sum(map_blocks(work, len(rows), BLOCK))

    def _prepare(self, queries: np.ndarray) -> tuple[Float[np.ndarray, 'queries 3'], Int[np.ndarray, ' queries']]:
        """The queries as float64, and the order in which to answer them."""
        array = _checked('queries', queries)
        if queries is self._source:
            return array, self.order.astype(np.int64)
        if len(array) < SORT_QUERIES_FROM:
            return array, np.arange(len(array))
        return array, morton_order(array, self._grid)


def _none(queries: int) -> Neighbors:
    return Neighbors(np.zeros(0, dtype=np.int32), np.zeros(queries + 1, dtype=np.int64), np.zeros(0))


def _offsets(counts: Int[np.ndarray, ' queries']) -> Int[np.ndarray, ' queries_and_one']:
    out = np.zeros(len(counts) + 1, dtype=np.int64)
    np.cumsum(counts, out=out[1:])
    return out


def _assemble(blocks: list[Block], rows: Int[np.ndarray, ' queries']) -> Neighbors:
    """Put the answers of blocks of ``rows`` into CSR in the order of the queries."""
    counts = np.empty(len(rows), dtype=np.int64)
    counts[rows] = np.concatenate([block[0] for block in blocks])
    offsets = _offsets(counts)
    indices = np.empty(offsets[-1], dtype=np.int32)
    sq_dists = np.empty(offsets[-1], dtype=np.float64)
    visits = sum(int(block[3]) for block in blocks)
    first = 0
    for position, (found, near, dists, _) in enumerate(blocks):
        scatter_rows(rows[first : first + len(found)], offsets, found, near, dists, indices, sq_dists)
        first += len(found)
        blocks[position] = (found, near[:0], dists[:0], 0)
    return Neighbors(indices, offsets, sq_dists, visits)
