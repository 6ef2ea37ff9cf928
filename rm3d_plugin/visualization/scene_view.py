"""Scenes to turn in the browser: points with several colourings, packed into the page itself."""

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.visualization.palette import class_color
from rm3d_plugin.visualization.scene_view_script import SCRIPT

Kind = Literal['rgb', 'class', 'number']
BYTES: dict[Kind, int] = {'rgb': 3, 'class': 1, 'number': 2}  # of a point
NO_CLASS, NO_NUMBER = 255, 65535
MAX_POINTS = 60_000  # of a scene; a browser turns so many without delay
MAX_BYTES = 6_000_000  # of all scenes together, as text
MAX_MARKED = 2000  # labelled points of a scene beyond which marking them hides the scene


@dataclass(frozen=True, eq=False)
class Layer:
    """One way to colour the points.

    Attributes:
        name: Word on its button.
        kind: 'rgb': (N, 3) in [0, 1]; 'class': (N,) class number, -1 = none; 'number': (N,) number of a region or
            instance, -1 = none.
        values: As ``kind`` says.
        role: What the page compares: the 'prediction' with the 'truth'; 'labels' are those that training saw.
    """

    name: str
    kind: Kind
    values: np.ndarray
    role: Literal['', 'labels', 'prediction', 'truth'] = ''


@dataclass(frozen=True, eq=False)
class SceneView:
    """A scene to turn.

    Attributes:
        title: Words for the scene.
        xyz: (N, 3) metres, z up.
        layers: At least one.
        marked: Numbers of the points whose label was annotated; they are always shown, larger.
    """

    title: str
    xyz: Float[np.ndarray, 'points 3']
    layers: Sequence[Layer]
    marked: Int[np.ndarray, ' marked'] | None = None

    def __post_init__(self) -> None:
        if not self.layers:
            raise ValueError(f'SceneView {self.title!r}: expected at least one layer')
        for layer in self.layers:
            shape = (len(self.xyz), 3) if layer.kind == 'rgb' else (len(self.xyz),)
            if np.shape(layer.values) != shape:
                raise ValueError(
                    f'SceneView {self.title!r}, layer {layer.name!r}: expected shape {shape}, got {layer.values.shape}'
                )
            if layer.kind == 'class' and len(layer.values) and layer.values.max() >= NO_CLASS:
                raise ValueError(
                    f'SceneView {self.title!r}, layer {layer.name!r}: class {layer.values.max()}, but at most '
                    f'{NO_CLASS} classes can be shown'
                )


def shown_points(view: SceneView, count: int) -> Int[np.ndarray, ' shown']:
    """Numbers of the points that are drawn, ascending: every so-and-so-many-th, and the marked ones."""
    every = np.arange(0, len(view.xyz), max(1, -(-len(view.xyz) // max(count, 1))))
    return every if view.marked is None else np.union1d(every, view.marked[:MAX_MARKED])


def pack_view(view: SceneView, count: int = MAX_POINTS) -> dict[str, Any]:
    """The scene as plain values for the page's script.

    Args:
        view: What to pack.
        count: Points drawn at most, marked ones aside.

    Returns:
        ``title``, ``count``, ``total``; ``low`` and ``step`` (3 numbers each, metres): a coordinate is
        ``low + step * q`` with q in ``xyz``; ``marked``: places among the drawn points; ``layers`` with ``name``,
        ``kind``, ``role`` and ``data``.
        Arrays are little-endian, in base64: xyz uint16 (n, 3), rgb uint8 (n, 3), class uint8 (255 = none), number
        uint16 (65535 = none, larger ones begin again), marked uint32.
    """
    rows = shown_points(view, count)
    xyz = np.asarray(view.xyz, dtype=np.float64)[rows]
    low = xyz.min(axis=0) if len(xyz) else np.zeros(3)
    step = np.maximum(np.ptp(xyz, axis=0) if len(xyz) else np.zeros(3), 1e-6) / 65535
    marked = np.zeros(0, dtype=np.int64) if view.marked is None else view.marked[:MAX_MARKED]
    return {
        'title': view.title,
        'count': len(rows),
        'total': len(view.xyz),
        'low': low.tolist(),
        'step': step.tolist(),
        'xyz': _base64(np.round((xyz - low) / step), '<u2'),
        'marked': _base64(np.searchsorted(rows, np.sort(marked)), '<u4'),
        'layers': [
            {'name': layer.name, 'kind': layer.kind, 'role': layer.role, 'data': _layer_data(layer, rows)}
            for layer in view.layers
        ],
    }


def pack_views(
    views: Sequence[SceneView],
    classes: Sequence[str],
    max_points: int = MAX_POINTS,
    max_bytes: int = MAX_BYTES,
    cut: float = 1.0,
) -> dict[str, Any]:
    """All scenes with the classes' names and colours; points are thinned so that the text stays below ``max_bytes``.

    Args:
        views: Scenes.
        classes: Class names.
        max_points: Points of a scene.
        max_bytes: Of all scenes together.
        cut: Share of the height that is shown at first; below 1: ceilings are cut off.
    """
    each = max_bytes * 3 // 4 // max(len(views), 1)
    packed = [pack_view(view, min(max_points, each // (6 + sum(BYTES[y.kind] for y in view.layers)))) for view in views]
    names = [{'name': name, 'color': class_color(c)} for c, name in enumerate(classes)]
    return {'classes': names, 'cut': cut, 'scenes': packed}


def view_block(packed: dict[str, Any]) -> str:
    """HTML of the view: controls, canvas, data and script; at most one a page."""
    scenes = packed['scenes']
    no_truth = '' if any(layer['role'] == 'truth' for scene in scenes for layer in scene['layers']) else ' hidden'
    no_marks = '' if any(scene['marked'] for scene in scenes) else ' hidden'
    titles = ''.join(f'<option value="{i}">{escape(s["title"])}</option>' for i, s in enumerate(scenes))
    data = json.dumps(packed, separators=(',', ':'), ensure_ascii=False).replace('<', '\\u003c')
    return (
        '<div class="view" id="view">\n'
        f'<div class="bar"><label>Scene <select id="view-scene">{titles}</select></label>'
        '<span class="buttons" id="view-layers" role="group" aria-label="Colours"></span></div>\n'
        '<canvas id="view-canvas" tabindex="0" role="img" aria-label="Points of the scene, to be turned"></canvas>\n'
        '<p class="told" id="view-told" aria-live="polite">&nbsp;</p>\n'
        '<div class="bar"><label>Show up to <input type="range" id="view-cut" min="1" max="100"> of the height</label>'
        '<label>Point size <input type="range" id="view-size" min="1" max="8" value="3"></label>'
        f'<label{no_truth}><input type="checkbox" id="view-fade"> fade what is correct</label>'
        f'<label{no_marks}><input type="checkbox" id="view-marks" checked> mark annotated points</label>'
        '<button type="button" id="view-reset">Reset</button></div>\n'
        '<ul class="legend" id="view-legend"></ul>\n'
        '<p class="note">Click into the view, then: drag turns, with shift or two fingers moves, wheel or pinch zooms; '
        'arrow keys, + and &minus; work too. Point at a spot to read its labels; click a class to hide it.</p>\n'
        f'<script type="application/json" id="view-data">{data}</script>\n'
        f'<script>\n{SCRIPT}</script>\n</div>'
    )


def _layer_data(layer: Layer, rows: Int[np.ndarray, ' shown']) -> str:
    values = np.asarray(layer.values)[rows]
    if layer.kind == 'rgb':
        return _base64(np.round(np.clip(values, 0, 1) * 255), '<u1')
    if layer.kind == 'class':
        return _base64(np.where(values < 0, NO_CLASS, values), '<u1')
    return _base64(np.where(values < 0, NO_NUMBER, values % NO_NUMBER), '<u2')


def _base64(values: np.ndarray, dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values.astype(dtype)).tobytes()).decode('ascii')
