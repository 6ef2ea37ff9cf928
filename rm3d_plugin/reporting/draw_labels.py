"""Draw a label budget and show it: what `rm3d draw_labels` does."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from mmengine.config import Config

import rm3d_plugin.datasets
import rm3d_plugin.models  # noqa: F401  (both register their parts)
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.config_errors import config_errors
from rm3d_plugin.engine.work_dir import check_folder
from rm3d_plugin.inference.outputs import check_targets
from rm3d_plugin.label_budgets import clicks_of
from rm3d_plugin.labeling.point_source import PointBudgetSource
from rm3d_plugin.labeling.sources import BoxBudgetSource, LabelSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.reporting.box_scenes import box_view
from rm3d_plugin.reporting.scenes import CEILING, CUT, own_colors
from rm3d_plugin.storage import Click, write_bytes, write_clicks
from rm3d_plugin.structures import PointCloud
from rm3d_plugin.visualization import BudgetSummary, Picture, RunReport, write_report
from rm3d_plugin.visualization.label_picture import draw_label_picture
from rm3d_plugin.visualization.scene_view import Layer, SceneView, pack_views

CLICK_ENDINGS = ('.csv', '.json', '.jsonl')
MAX_CLICKS = 200_000  # a budget that shows more is written as clicks only where a click file is asked for by name


def source_of(config: Config, budget: str | None = None, seed: int | None = None) -> LabelSource:
    """The label source of a config's training, with another budget or seed where given.

    Raises:
        ConfigError: The config has no hook that makes labels.
    """
    hooks = [hook for hook in config.custom_hooks if hook.type.endswith('RegionMergeHook')]
    if not hooks:
        raise ConfigError(f'{config.config_name}: no RegionMergeHook among custom_hooks, so no label budget is drawn')
    return _build(config, hooks[0].label_maker.source, budget, seed)


def source_of_dataset(dataset: str, options: Mapping[str, Any], budget: str, seed: int = 0) -> LabelSource:
    """Points of a segmentation data set.

    Args:
        dataset: Registered type, such as ScanNetDataset.
        options: Its arguments.
        budget: Name or fields of a :class:`~rm3d_plugin.label_budgets.PointAmount`.
        seed: Chooses the draw.

    Raises:
        ConfigError: No such data set, or an argument that it does not take.
    """
    config = Config({'config_name': f'--dataset {dataset}'})
    made = {'type': dataset, 'split': 'train', **options}
    return _build(config, {'type': 'PointBudgetSource', 'dataset': made}, budget, seed)


def draw_labels(source: LabelSource, out: Path, title: str, max_scenes: int = 8, synthetic: bool = False) -> list[Path]:
    """Draw the budget of a source and write it.

    Args:
        source: The scenes and their budget.
        out: A folder: ``budget.json`` (with ``budget.npz``), ``clicks.csv`` and ``labels.html`` are written into it.
            Or one file: ``.csv``, ``.json`` or ``.jsonl`` for the labels as clicks, ``.html`` for the page alone.
        title: Headline of the page.
        max_scenes: Scenes with a label that the page shows.
        synthetic: True puts a note on the page that the data are synthetic.

    Returns:
        The files written.

    Raises:
        ConfigError: ``out`` has another ending, or clicks are asked for where boxes are drawn.
    """
    ending = out.suffix.lower()
    check_targets([out / 'clicks.csv', *([] if out.is_dir() else [out])], _inputs(source), out)
    if ending in CLICK_ENDINGS:
        return [_write_clicks(out, source)]
    if ending not in ('', '.html') and not out.is_dir():
        raise ConfigError(f'--out {out}: expected a folder, or a file that ends with .csv, .json, .jsonl or .html')
    folder = out.parent if ending == '.html' else out
    check_folder(folder)
    written = []
    if ending != '.html':
        if isinstance(source, PointBudgetSource) and source.budget.annotated_count <= MAX_CLICKS:
            written.append(_write_clicks(folder / 'clicks.csv', source))  # first: it refuses to replace others
        source.open(folder, resume=False)
        written += sorted(path for path in (folder / 'budget.json', folder / 'budget.npz') if path.is_file())
    page = out if ending == '.html' else folder / 'labels.html'
    return [*written, _write_page(page, source, title, max_scenes, synthetic)]


def _build(config: Config, source: Mapping[str, Any], budget: str | None, seed: int | None) -> LabelSource:
    changes = {name: value for name, value in (('budget', budget), ('seed', seed)) if value is not None}
    with config_errors(config):
        built: LabelSource = TASK_UTILS.build({**source, **changes})
    return built


def _inputs(source: LabelSource) -> list[Path]:
    """The file of clicks or points that the budget is read from, if any."""
    file = source.amount.file if isinstance(source, PointBudgetSource) else None
    return [] if file is None else [Path(file)]


def _write_clicks(path: Path, source: LabelSource) -> Path:
    if not isinstance(source, PointBudgetSource):
        raise ConfigError(f'{path}: {type(source).__name__} shows no points, so there are no clicks; give a folder')
    clicks = list(_clicks(source))
    with TemporaryDirectory() as folder:
        fresh = Path(folder) / path.name
        write_clicks(fresh, clicks, source.classes)
        if path.is_file() and fresh.read_bytes() != path.read_bytes():
            raise ConfigError(f'{path}: holds other clicks, which are not replaced; name another place')
        return write_bytes(path, fresh.read_bytes())


def _clicks(source: PointBudgetSource) -> Iterator[Click]:
    for index, scene in enumerate(source.scene_ids):
        cloud = source.load_cloud(index)
        yield from clicks_of(scene, source.annotated(index, len(cloud)), cloud, source.rows_of(scene))


def _write_page(path: Path, source: LabelSource, title: str, max_scenes: int, synthetic: bool) -> Path:
    summary = source.describe().splitlines()[0]
    pictures = list(_pictures(source, max_scenes))
    shown = f'The first {len(pictures)} of the scenes with a label are shown; {len(source.scene_ids)} scenes in all.'
    page = RunReport(
        title=title,
        synthetic=synthetic,
        notes=[summary, shown],
        budget=_budget_summary(source),
        pictures=pictures,
        views=_views(source, max_scenes),
    )
    return write_report(path, page)


def _budget_summary(source: LabelSource) -> BudgetSummary | None:
    if not isinstance(source, BoxBudgetSource | PointBudgetSource):
        return None
    drawn = source.budget
    annotated, total = drawn.annotated_per_class, drawn.total_per_class
    counts = {name: (annotated.get(c, 0), total.get(c, 0)) for c, name in enumerate(source.classes)}
    fields = ((item.name, getattr(drawn.amount, item.name)) for item in dataclasses.fields(drawn.amount))
    words = ', '.join(f'{name} = {value}' for name, value in fields if value is not None)
    clicked = isinstance(source, PointBudgetSource) and source.amount.clicks is not None
    unit = 'boxes' if isinstance(source, BoxBudgetSource) else 'clicked points' if clicked else 'points'
    return BudgetSummary(words, drawn.hash, counts, drawn.seed, unit, not clicked)


def _views(source: LabelSource, count: int) -> dict[str, Any] | None:
    """Scenes with a label to turn, each in its own colours and with its labels, which are marked."""
    views = []
    for scene, cloud, annotated in _labelled(source, count):
        semantic = annotated.semantic
        if len(annotated.boxes):
            views.append(box_view(f'Scene {scene}', cloud, {'annotated': annotated.boxes}, source.classes))
            continue
        marked = None if annotated.complete else np.flatnonzero(semantic >= 0)
        layers = [Layer('colour', 'rgb', own_colors(cloud)), Layer('labels', 'class', semantic, 'labels')]
        views.append(SceneView(f'Scene {scene}', cloud.xyz, layers, marked))
    return pack_views(views, source.classes, cut=CUT if CEILING in source.classes else 1.0) if views else None


def _labelled(source: LabelSource, count: int) -> Iterator[tuple[str, PointCloud, AnnotatedLabels]]:
    """The first scenes of which something is annotated."""
    found = 0
    for index, scene in enumerate(source.scene_ids):
        if found == count:
            return
        annotated = source.annotated_labels(index)
        if (annotated.semantic >= 0).any() or len(annotated.boxes):
            found += 1
            yield scene, source.load_cloud(index), annotated


def _pictures(source: LabelSource, count: int) -> Iterator[Picture]:
    for scene, cloud, annotated in _labelled(source, count):
        points, boxes = int((annotated.semantic >= 0).sum()), len(annotated.boxes)
        picture = draw_label_picture(cloud, annotated.semantic, source.classes, annotated.boxes)
        what = f'{points} labelled points' + (f' in {boxes} boxes' if boxes else '')
        yield Picture(f'Scene {scene}: {what} of {len(annotated)} points', picture)
