"""Scores of point classes, counted one point at a time with sets."""


def scores(predictions, truths, classes, ignored=(-1, 255)):
    """IoU (None without truth), recall and precision of each class, and the share of right points."""
    pairs = [(p, t) for ps, ts in zip(predictions, truths, strict=True) for p, t in zip(ps, ts, strict=True)]
    pairs = [(p, t) for p, t in pairs if t not in ignored]
    out = []
    for c in range(classes):
        both = sum(p == c and t == c for p, t in pairs)
        either = sum(p == c or t == c for p, t in pairs)
        true, given = sum(t == c for _, t in pairs), sum(p == c for p, _ in pairs)
        out.append((both / either if true else None, both / true if true else None, both / given if given else None))
    right = sum(p == t for p, t in pairs) / len(pairs) if pairs else 0.0
    return out, right
