"""The KITTI evaluation written as one reads its rules: plain Python, one frame and one threshold after the other.

A frame is a dict: 'truth' and 'found' lists of dicts with type, bbox, box (x, y, z, dx, dy, dz, yaw), alpha, and
truncated, occluded (truth) or score (found). Items read by :func:`read_lines` have a line instead of the box, and are
compared in the rectified camera frame.
"""

import math

from tests.reference.polygon_iou_slow import area, clip, iou_3d, iou_bev

LIMITS = {'easy': (40, 0, 0.15), 'moderate': (25, 1, 0.3), 'hard': (25, 2, 0.5)}
COUSIN = {'Car': 'Van', 'Pedestrian': 'Person_sitting'}


def intersection_2d(a, b):
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return width * height if width > 0 and height > 0 else 0.0


def size_2d(a):
    return (a[2] - a[0]) * (a[3] - a[1])


def overlap(truth, found, metric):
    if metric == 'bbox':
        shared = intersection_2d(truth['bbox'], found['bbox'])
        return shared / (size_2d(truth['bbox']) + size_2d(found['bbox']) - shared)
    if 'line' in truth:
        return camera_overlap(truth['line'], found['line'], metric)
    return iou_bev(truth['box'], found['box']) if metric == 'bev' else iou_3d(truth['box'], found['box'])


def read_lines(text, scored):
    """Items of a file of labels or results: type, truncation, occlusion, alpha, 2D box, h w l, x y z, ry, score."""
    items = []
    for name, *words in (line.split() for line in text.splitlines()):
        v = [float(word) for word in words]
        item = {'type': name, 'truncated': v[0], 'occluded': v[1], 'alpha': v[2], 'bbox': v[3:7], 'line': v[7:14]}
        items.append(item | ({'score': v[14]} if scored else {}))
    return items


def footprint(line):
    """Corners of a box on the camera's x-z plane, in the program's order, then counter-clockwise."""
    _, w, l, x, _, z, ry = line  # noqa: E741
    corners = []
    for along, across in ((l / 2, w / 2), (l / 2, -w / 2), (-l / 2, -w / 2), (-l / 2, w / 2)):
        c, s = math.cos(ry), math.sin(ry)
        corners.append((x + c * along + s * across, z - s * along + c * across))
    return corners if area(corners) > 0 else corners[::-1]


def camera_overlap(a, b, metric):
    shared = area(clip(footprint(a), footprint(b)))
    if metric == 'bev':
        return shared / (a[1] * a[2] + b[1] * b[2] - shared)
    shared *= max(0.0, min(a[4], b[4]) - max(a[4] - a[0], b[4] - b[0]))
    return shared / (a[0] * a[1] * a[2] + b[0] * b[1] * b[2] - shared)


def judge_truth(truth, name, difficulty):
    height, occlusion, truncation = LIMITS[difficulty]
    if truth['type'] == COUSIN.get(name):
        return 'ignored'
    if truth['type'] != name:
        return 'other'
    too_hard = (
        truth['bbox'][3] - truth['bbox'][1] < height or truth['occluded'] > occlusion or truth['truncated'] > truncation
    )
    return 'ignored' if too_hard else 'counts'


def judge_found(found, name, difficulty):
    if found['bbox'][3] - found['bbox'][1] < LIMITS[difficulty][0]:
        return 'ignored'
    return 'counts' if found['type'] == name else 'other'


def frame_statistics(frame, name, difficulty, metric, iou, threshold):
    """(hit scores, number of false positives, orientation similarity); threshold None: the pass that finds scores."""
    found = [
        {**f, 'role': judge_found(f, name, difficulty), 'used': False}
        for f in frame['found']
        if threshold is None or f['score'] >= threshold
    ]
    hits, similarity = [], 0.0
    for truth in frame['truth']:
        role = judge_truth(truth, name, difficulty)
        if role == 'other':
            continue
        able = [f for f in found if f['role'] != 'other' and not f['used'] and overlap(truth, f, metric) > iou]
        if not able:
            continue
        if threshold is None:
            chosen = max(able, key=lambda f: f['score'])
        else:
            sure = [f for f in able if f['role'] == 'counts']
            chosen = max(sure, key=lambda f: overlap(truth, f, metric)) if sure else able[0]
        chosen['used'] = True
        if role == 'counts' and chosen['role'] == 'counts':
            hits.append(chosen['score'])
            similarity += (1 + math.cos(truth['alpha'] - chosen['alpha'])) / 2
    false = 0
    for f in found:
        if f['used'] or f['role'] != 'counts':
            continue
        areas = [t['bbox'] for t in frame['truth'] if t['type'] == 'DontCare'] if metric == 'bbox' else []
        if not any(intersection_2d(area, f['bbox']) / size_2d(f['bbox']) > iou for area in areas):
            false += 1
    return hits, false, similarity


def average_precision(frames, name, difficulty, metric, iou):
    """The official sampling: (R40, R11) of the metric and of its orientation similarity, percent."""
    total = sum(judge_truth(t, name, difficulty) == 'counts' for frame in frames for t in frame['truth'])
    scores = []
    for frame in frames:
        scores += frame_statistics(frame, name, difficulty, metric, iou, None)[0]
    scores.sort(reverse=True)
    thresholds, target = [], 0.0
    for i, score in enumerate(scores):
        here, after = (i + 1) / total, (i + 2) / total
        if i < len(scores) - 1 and after - target < target - here:
            continue
        thresholds.append(score)
        target += 1 / 40
    precision, orientation = [0.0] * 41, [0.0] * 41
    for i, threshold in enumerate(thresholds[:41]):
        hit = false = similar = 0
        for frame in frames:
            h, f, s = frame_statistics(frame, name, difficulty, metric, iou, threshold)
            hit, false, similar = hit + len(h), false + f, similar + s
        precision[i] = hit / (hit + false) if hit + false else 0.0
        orientation[i] = similar / (hit + false) if hit + false else 0.0
    out = []
    for curve in (precision, orientation):
        best = [max(curve[i:]) for i in range(41)]
        out.append((100 * sum(best[1:]) / 40, 100 * sum(best[::4]) / 11))
    return out
