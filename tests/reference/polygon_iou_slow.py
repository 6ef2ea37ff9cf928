"""Rotated overlap in plain Python: corners in the scene frame, Sutherland-Hodgman, shoelace."""

import math


def corners(box):
    x, y, _, dx, dy, _, yaw = (float(v) for v in box)
    out = []
    for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        u, v = sx * dx / 2, sy * dy / 2
        out.append((x + u * math.cos(yaw) - v * math.sin(yaw), y + u * math.sin(yaw) + v * math.cos(yaw)))
    return out


def clip(subject, clipper):
    """The part of a polygon inside a convex counter-clockwise one."""
    for (ax, ay), (bx, by) in zip(clipper, clipper[1:] + clipper[:1], strict=True):

        def side(p, ax=ax, ay=ay, bx=bx, by=by):
            return (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax)

        out = []
        for p, q in zip(subject, subject[1:] + subject[:1], strict=True):
            if side(p) >= 0:
                out.append(p)
            if (side(p) > 0) != (side(q) > 0) and side(p) != side(q):
                t = side(p) / (side(p) - side(q))
                if 0 < t < 1:
                    out.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
        subject = out
        if not subject:
            return []
    return subject


def area(polygon):
    return 0.5 * sum(p[0] * q[1] - q[0] * p[1] for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True))


def iou_bev(a, b):
    shared = area(clip(corners(a), corners(b)))
    union = a[3] * a[4] + b[3] * b[4] - shared
    return shared / union if union > 0 else 0.0


def iou_3d(a, b):
    height = max(0.0, min(a[2] + a[5] / 2, b[2] + b[5] / 2) - max(a[2] - a[5] / 2, b[2] - b[5] / 2))
    shared = area(clip(corners(a), corners(b))) * height
    union = a[3] * a[4] * a[5] + b[3] * b[4] * b[5] - shared
    return shared / union if union > 0 else 0.0
