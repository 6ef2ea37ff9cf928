"""Balls of points around queries, and values gathered along them; a missing index is -1."""

import numpy as np
import torch
from jaxtyping import Float, Int
from numba import njit
from torch import Tensor

_CHUNK = 1024  # queries whose distances are held at once on a GPU


@njit(cache=True)
def _ball(points, queries, radius_sq, out, first):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for q in range(len(queries)):
        found = 0
        for j in range(len(points)):
            dx = points[j, 0] - queries[q, 0]
            dy = points[j, 1] - queries[q, 1]
            dz = points[j, 2] - queries[q, 2]
            if dx * dx + dy * dy + dz * dz <= radius_sq:
                out[q, found] = first + j
                found += 1
                if found == out.shape[1]:
                    break


def _ball_torch(points: Tensor, queries: Tensor, radius_sq: float, limit: int, first: int) -> Tensor:
    numbers = torch.arange(len(points), device=points.device)
    rows = []
    for part in queries.split(_CHUNK):
        inside = (part[:, None] - points[None]).square().sum(-1) <= radius_sq
        order = torch.where(inside, numbers, len(points)).sort(dim=1).values[:, :limit]
        order = torch.nn.functional.pad(order, (0, limit - order.shape[1]), value=len(points))
        rows.append(torch.where(order < len(points), order + first, -1))
    return torch.cat(rows)


def batch_index(batch_offsets: Int[Tensor, ' scenes_and_one']) -> Int[Tensor, ' rows']:
    """The scene number of every row of a batch."""
    scenes = torch.arange(len(batch_offsets) - 1, device=batch_offsets.device)
    return scenes.repeat_interleave(batch_offsets.diff())


def ball_query(
    points: Float[Tensor, 'points 3'],
    queries: Float[Tensor, 'queries 3'],
    radius: float,
    limit: int,
    point_offsets: Int[Tensor, ' scenes_and_one'] | None = None,
    query_offsets: Int[Tensor, ' scenes_and_one'] | None = None,
) -> Int[Tensor, 'queries limit']:
    """The first points (lowest numbers) within a radius of each query, of the same scene.

    Args:
        points: Coordinates in metres.
        queries: Coordinates in metres.
        radius: Metres; a point at exactly this distance is in.
        limit: Most points a query. Their order being that of the rows, points in the order of furthest point
            sampling give a group that is spread over the ball.
        point_offsets: Row offsets of the scenes among the points; one scene when not given.
        query_offsets: The same among the queries.

    Returns:
        Point rows, ascending; -1 where a ball holds fewer.

    Raises:
        ValueError: The radius is negative, the limit not positive, or the offsets name different scene counts.
    """
    if radius < 0 or limit < 1:
        raise ValueError(f'ball_query: expected radius >= 0 and limit >= 1, got {radius} and {limit}')
    ends_p = [0, len(points)] if point_offsets is None else [int(v) for v in point_offsets.tolist()]
    ends_q = [0, len(queries)] if query_offsets is None else [int(v) for v in query_offsets.tolist()]
    if len(ends_p) != len(ends_q):
        raise ValueError(f'ball_query: {len(ends_p) - 1} scenes of points, {len(ends_q) - 1} of queries')
    points, queries = points.detach().double(), queries.detach().double()
    out = torch.full((len(queries), limit), -1, dtype=torch.int64, device=queries.device)
    for a, b, c, d in zip(ends_p[:-1], ends_p[1:], ends_q[:-1], ends_q[1:], strict=True):
        if a == b or c == d:
            continue
        if points.device.type == 'cpu':
            p, q = np.ascontiguousarray(points[a:b].numpy()), np.ascontiguousarray(queries[c:d].numpy())
            _ball(p, q, float(radius) ** 2, out[c:d].numpy(), a)
        else:
            out[c:d] = _ball_torch(points[a:b], queries[c:d], float(radius) ** 2, limit, a)
    return out


def gather_groups(
    values: Float[Tensor, 'points channels'], index: Int[Tensor, 'groups members']
) -> Float[Tensor, 'groups members channels']:
    """Rows of ``values`` along an index table; zeros where the index is -1."""
    if len(values) == 0:
        return values.new_zeros(*index.shape, values.shape[1])
    return values[index.clamp_min(0)] * (index >= 0)[..., None]


def group_max(
    values: Float[Tensor, 'groups members channels'], index: Int[Tensor, 'groups members']
) -> Float[Tensor, 'groups channels']:
    """Maximum over the members that exist; zeros for a group that has none."""
    missing = index < 0
    pooled = values.masked_fill(missing[..., None], -torch.inf).amax(dim=1)
    return pooled.masked_fill(missing.all(dim=1)[:, None], 0.0)
