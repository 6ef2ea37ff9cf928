"""Sparse convolution as written on paper: for every output voxel, look every input voxel up."""


def neighbours_slowly(coords, targets, offsets, stride):
    """For every offset the (input row, output row) pairs, by a dictionary of coordinates."""
    rows = {tuple(c): i for i, c in enumerate(coords.tolist())}
    found = []
    for offset in offsets:
        wanted = [
            (b, *(s * c + o for s, c, o in zip(stride, cell, offset, strict=True))) for b, *cell in targets.tolist()
        ]
        found.append([(rows[w], j) for j, w in enumerate(wanted) if w in rows])
    return found
