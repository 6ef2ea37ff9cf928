"""A scan in, its regions out: what `rm3d oversegment` does."""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from mmengine.registry import Registry

import rm3d_plugin.descriptors
import rm3d_plugin.oversegmentation  # noqa: F401  (both register their parts)
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.work_dir import check_folder
from rm3d_plugin.inference.outputs import check_targets
from rm3d_plugin.label_budgets import BudgetError
from rm3d_plugin.label_budgets.clicks import resolve_clicks
from rm3d_plugin.ops.segment import scatter_rows
from rm3d_plugin.oversegmentation import RegionGrowing
from rm3d_plugin.oversegmentation.tuning import Tuning, tune_region_growing
from rm3d_plugin.regions.prepare import with_normals
from rm3d_plugin.registry import DESCRIPTORS, OVERSEGMENTERS
from rm3d_plugin.storage import click_classes, read_clicks, write_npz
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.storage.scans import read_cloud
from rm3d_plugin.structures import Descriptors, PointCloud, Regions
from rm3d_plugin.visualization.palette import by_height, region_colors
from rm3d_plugin.visualization.regions_page import write_regions_page
from rm3d_plugin.visualization.scene_view import Layer

ENDINGS = ('.ply', '.npz', '.html')
# Presets that are the parts of a shipped config: the regions are those that training on such scans starts from.
SHIPPED = {'outdoor': 'rm3d_sem_files_streets_clicks', 'airborne': 'rm3d_sem_files_airborne_clicks'}
PRESETS = ('indoor', 'lidar', *SHIPPED)
POINTS_PER_REGION = 150  # where nobody says how many regions tuning shall aim at


def build_part(registry: Registry, name: str | None, preset: str | None, options: Mapping[str, Any]) -> Any:
    """Build a registered part by its type name.

    Args:
        registry: Where the name is looked up.
        name: Type name; None: the preset's, or the first choice of the house.
        preset: Start from the numbers of this preset, where the part has any.
        options: Arguments; they win over the preset's.

    Raises:
        ConfigError: No such part or preset, or an argument that it does not take.
    """
    kinds, arguments = registry.module_dict, _shipped_part(registry, preset)
    shipped = arguments.pop('type', None)
    name = name or shipped or ('AdaptedPFH' if registry is DESCRIPTORS else 'RegionGrowing')
    if name not in kinds:
        raise ConfigError(f'{registry.name}: expected one of {sorted(kinds)}, got {name!r}')
    numbers = presets_of(kinds[name])
    if preset is not None and name != shipped and numbers:
        if preset not in numbers:
            raise ConfigError(f'{name}: preset: expected one of {sorted(numbers)}, got {preset!r}')
        arguments = dict(numbers[preset])
    try:
        return kinds[name](**arguments | dict(options))
    except (TypeError, ValueError) as error:
        told = str(error).removeprefix(f'{name}: ')
        strange = isinstance(error, TypeError) and f'{name}.__init__' not in told
        raise ConfigError(f'{name}: a value of the wrong kind ({told})' if strange else f'{name}: {told}') from error


def _shipped_part(registry: Registry, preset: str | None) -> dict[str, Any]:
    if preset not in SHIPPED:
        return {}
    return dict(load_config(SHIPPED[preset]).label_maker['descriptor' if registry is DESCRIPTORS else 'oversegmenter'])


def presets_of(kind: type) -> Mapping[str, Mapping[str, Any]]:
    """The presets of a part: its own ``presets``, or those beside it in its file; empty where it has none."""
    presets: Mapping[str, Mapping[str, Any]] = getattr(kind, 'presets', {})
    return presets or (vars(sys.modules[kind.__module__]).get('PRESETS', {}) if hasattr(kind, 'preset') else {})


def oversegment_file(
    scan: str | Path,
    out: str | Path,
    descriptor: str | None = None,
    oversegmenter: str | None = None,
    preset: str | None = None,
    descriptor_options: Mapping[str, Any] | None = None,
    oversegmenter_options: Mapping[str, Any] | None = None,
    columns: str | None = None,
    tune: str | Path | None = None,
    target_regions: int | None = None,
    log: Callable[[str], None] = print,
) -> Regions:
    """Read a scan, describe and partition it, and write the regions.

    Args:
        scan: See :func:`rm3d_plugin.storage.scans.read_cloud`.
        out: ``.ply`` (points in their own coordinates, coloured by region, with a column ``region``), ``.npz``
            (``xyz``, ``origin``, ``labels``) or ``.html`` (3D view).
        descriptor: Type name in ``DESCRIPTORS``; None: the preset's, else AdaptedPFH.
        oversegmenter: Type name in ``OVERSEGMENTERS``; None: the preset's, else RegionGrowing.
        preset: ``'indoor'`` or ``'lidar'`` for the parts that have presets, ``'outdoor'`` or ``'airborne'`` for the
            parts of the config of such scans (``SHIPPED``); None: their defaults.
        descriptor_options: Arguments of the descriptor.
        oversegmenter_options: Arguments of the over-segmenter.
        columns: What the scan's columns hold, see :func:`rm3d_plugin.storage.scans.read_cloud`.
        tune: File of some labelled points of this scan, see :func:`read_annotated_labels`: theta and zeta of region
            growing are chosen by them (:func:`rm3d_plugin.oversegmentation.tune_region_growing`).
        target_regions: Regions that tuning aims at; None: one for 150 points above the ground.
        log: Told what tuning found.

    Raises:
        SceneError: The scan cannot be used.
        ClickFileError, BudgetError: The file of labels cannot be used.
        ConfigError: A part, argument or ending is not known, or needs a package that is not installed.
    """
    out = Path(out)
    check_folder(Path(out).parent)
    check_targets([out], [Path(scan), *([Path(tune)] if tune else [])], out)
    if out.suffix.lower() not in ENDINGS:
        raise ConfigError(f'{out}: unknown ending {out.suffix!r}; expected one of {" ".join(ENDINGS)}')
    describer = build_part(DESCRIPTORS, descriptor, preset, descriptor_options or {})
    segmenter = build_part(OVERSEGMENTERS, oversegmenter, preset, oversegmenter_options or {})
    if tune is not None and not isinstance(segmenter, RegionGrowing):
        raise ConfigError(
            f'tune: chooses theta and zeta of RegionGrowing, got {type(segmenter).__name__!r}; leave one of them out'
        )
    cloud = read_cloud(scan, columns)
    kept = np.flatnonzero(~segmenter.find_ground(cloud))
    rest = with_normals(cloud.select(kept))
    try:
        described = describer.for_scene(Path(scan).stem).compute(rest)
        if tune is not None:
            options = {**(presets_of(type(segmenter)).get(preset or '', {})), **(oversegmenter_options or {})}
            known = read_annotated_labels(tune, cloud, Path(scan).stem)[kept]
            found = _tune(rest, described, known, options, target_regions)
            log(f'{Path(tune).name}: {_report(found)}')
            segmenter = build_part(OVERSEGMENTERS, 'RegionGrowing', None, {**options, **found.options})
        labels = np.asarray(segmenter.partition(rest, described, None, Path(scan).stem), dtype=np.int64)
        regions = Regions(scatter_rows(labels, kept, len(cloud), fill=-1))
        write_regions(out, cloud, regions, Path(scan).name)
    except ImportError as error:
        raise ConfigError(str(error)) from error
    return regions


def read_annotated_labels(path: str | Path, cloud: PointCloud, scene: str) -> Int[np.ndarray, ' points']:
    """Class of the labelled points of one scan, -1 elsewhere.

    Args:
        path: CSV or JSON as :func:`rm3d_plugin.storage.read_clicks` reads it, ``scene,x,y,z,class`` say; classes
            are any names or numbers.
        cloud: The scan.
        scene: Its name in the file.

    Raises:
        ClickFileError, BudgetError: The file cannot be used, or labels no point of this scan.
    """
    clicks = [click for click in read_clicks(path, click_classes(path)) if click.scene == scene]
    if not clicks:
        raise BudgetError(f'{path}: labels no point of scene {scene!r}; the column scene names the scan without ending')
    annotated = resolve_clicks(clicks, cloud)
    labels = np.full(len(cloud), -1, dtype=np.int64)
    labels[annotated.points] = annotated.semantic
    return labels


def _tune(
    cloud: PointCloud,
    described: Descriptors,
    labels: Int[np.ndarray, ' points'],
    options: Mapping[str, Any],
    target: int | None,
) -> Tuning:
    """Tune region growing on one scan whose ground is off."""
    wanted = max(1, round(len(cloud) / POINTS_PER_REGION)) if target is None else target
    try:
        return tune_region_growing([cloud], [described], [labels], wanted, {**options, 'ground': None})
    except ValueError as error:
        raise ConfigError(f'tune: {error}') from error


def _report(tuning: Tuning) -> str:
    options = ', '.join(f'{name} {value:.3g}' for name, value in tuning.options.items())
    score = tuning.score
    return (
        f'{options}: {score.conflicts} of {score.labelled} labelled points in conflict, {score.regions} regions '
        f'(aimed at {tuning.target})'
    )


def discarded_text(regions: Regions) -> str:
    """How many points are in no region, and which: the ground, where it is left out, and small pieces."""
    count = int((regions.labels < 0).sum())
    return f'{count} of {len(regions.labels)} points are in no region: the ground, and pieces that are too small (-1)'


def write_regions(out: Path, cloud: PointCloud, regions: Regions, name: str) -> Path:
    """Write a partition as its ending says, see :func:`oversegment_file`."""
    if out.suffix.lower() == '.npz':
        arrays = {'xyz': cloud.xyz, 'origin': np.asarray(cloud.origin), 'labels': regions.labels}
        return write_npz(out, arrays)
    if out.suffix.lower() == '.html':
        layers = [Layer('height', 'rgb', by_height(cloud.xyz))]
        if cloud.colors is not None:
            layers.insert(0, Layer('colour', 'rgb', cloud.colors))
        title = f'{name}: {len(regions)} regions'
        return write_regions_page(out, cloud.xyz, regions.labels, title, layers, [discarded_text(regions)])
    world = cloud.xyz.astype(np.float64) + np.asarray(cloud.origin)
    xyz = world if np.any(cloud.origin) else cloud.xyz
    colors = np.round(region_colors(regions.labels) * 255).astype(np.uint8)
    columns = {name: xyz[:, i] for i, name in enumerate('xyz')}
    columns |= {name: colors[:, i] for i, name in enumerate(('red', 'green', 'blue'))}
    return write_ply(out, columns | {'region': regions.labels.astype(np.int32)})
