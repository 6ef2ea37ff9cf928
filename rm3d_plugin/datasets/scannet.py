"""ScanNet v2 in its native layout."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Int

from rm3d_plugin.datasets.base import DatasetNotFoundError, check_choice, not_found
from rm3d_plugin.datasets.scannet_format import (
    CLASSES,
    LABEL_MAP,
    NYU40,
    Group,
    align_points,
    check_segments,
    class_of_nyu40,
    nyu40_of_groups,
    object_of_points,
    read_aggregation,
    read_axis_alignment,
    read_label_map,
    read_label_ply,
    read_mesh,
    read_segments,
)
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, check_classes, only_things
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.plain_files import read_list
from rm3d_plugin.storage.scans import has_place
from rm3d_plugin.structures import PointCloud, SceneError

Split = Literal['train', 'val', 'test']
LabelSource = Literal['auto', 'ply', 'aggregation']
_LAYOUT = """
    {root}/
      scannetv2_train.txt  scannetv2_val.txt  scannetv2_test.txt    one scan a line (scene0000_00); from ScanNet's
                                                                    repository, Tasks/Benchmark
      scannetv2-labels.combined.tsv                                 names of objects -> ids
      scans/
        scene0000_00/
          scene0000_00_vh_clean_2.ply                     points (vertices of the mesh)
          scene0000_00_vh_clean_2.labels.ply              class of each vertex
          scene0000_00.aggregation.json                   objects, as lists of segments
          scene0000_00_vh_clean_2.0.010000.segs.json      segment of each vertex
          scene0000_00.txt                                axisAlignment
      scans_test/    the same without labels, for split='test' (scans/ serves, too)
"""


class Objects(NamedTuple):
    """Annotated objects of a scan, the file they come from, and the number of each point's object (-1 = none)."""

    groups: list[Group]
    path: Path
    owner: Int[np.ndarray, ' points']


@DATASETS.register_module()
class ScanNetDataset(SegmentationDataset):
    """ScanNet v2: one scan, one scene; vertices of the mesh, 20 benchmark classes, instances but of wall and floor.

    Args:
        data_root: Folder that holds ``scans`` and the lists of the splits.
        split: 'test' has no labels.
        ann_file: List of scans, relative to data_root; None: ``scannetv2_SPLIT.txt``.
        classes: Names of the benchmark's classes, in the order of their NYU40 ids.
        align: Turn walls to the axes by the scan's ``axisAlignment``; False: raw axes.
        label_source: 'ply': classes from ``labels.ply``. 'aggregation': from the annotated objects and the label map.
            'auto': from ``labels.ply``, unless it is missing or holds raw ids, as releases before v2 do.
        common: Arguments of :class:`SegmentationDataset` and :class:`SceneDataset`.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        ann_file: str | None = None,
        classes: Sequence[str] = CLASSES,
        align: bool = True,
        label_source: LabelSource = 'auto',
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        check_choice('label_source', label_source, get_args(LabelSource))
        super().__init__(split, classes=classes, **common)
        check_classes('ScanNet', self.classes, len(CLASSES))
        self.data_root = Path(data_root)
        self.ann_file = self.data_root / (ann_file or f'scannetv2_{split}.txt')
        self.align = align
        self.label_source = label_source
        self._label_map: dict[str, int] | None = None

    # ------------------------------------------------------------------ scenes

    def find_scenes(self) -> tuple[str, ...]:
        """Scans of the list."""
        if not any((self.data_root / name).is_dir() for name in ('scans', 'scans_test')):
            raise self._not_found('there is no folder scans')
        if not self.ann_file.is_file():
            raise self._not_found(f'there is no list {self.ann_file}')
        scans = tuple(read_list(self.ann_file, words=True))
        doubled = len(scans) - len(set(scans))
        if doubled or not scans:
            raise SceneError(f'{self.ann_file}: {len(scans)} scans, {doubled} of them twice; list each scan once')
        return scans

    def _not_found(self, what: str) -> DatasetNotFoundError:
        return not_found(
            'ScanNet', self.data_root, what, 'Ask for it at http://www.scan-net.org', _LAYOUT, 'scans/scene*'
        )

    def file(self, index: int, ending: str) -> Path:
        """A file of a scan: ``file(0, '_vh_clean_2.ply')``, say."""
        scan = self.scene_ids[index]
        folders = [self.data_root / name / scan for name in ('scans', 'scans_test')]
        if self.split == 'test':
            folders.reverse()
        folder = next((folder for folder in folders if folder.is_dir()), None)
        if folder is None:
            raise SceneError(f'{folders[0]}: no such folder, but {self.ann_file} lists {scan}; download it')
        return folder / f'{scan}{ending}'

    # ------------------------------------------------------------------ one scene

    def read_scene(self, index: int) -> RawScene:
        """Vertices, and for split 'train' and 'val' class and instance of each."""
        mesh = read_mesh(self.file(index, '_vh_clean_2.ply'))
        xyz = self._aligned(mesh.xyz, index)
        if not has_place(xyz).all():
            raise SceneError(f'{self.file(index, ".txt")}: axisAlignment: moves points too far away; copy it again')
        cloud = PointCloud(xyz, colors=mesh.colors)
        if self.split == 'test':
            return RawScene(cloud)
        objects = self._objects(index, len(cloud))
        semantic = class_of_nyu40(self._nyu40(index, objects))
        return RawScene(cloud, semantic, only_things(objects.owner, semantic, self.thing_classes))

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """All but wall and floor."""
        return tuple(range(2, len(CLASSES)))

    def why_no_truth(self, index: int) -> str:
        """ScanNet's benchmark measures the test split itself."""
        return "ScanNet keeps the labels of its test scans to itself; use split='val'"

    def _aligned(self, xyz: np.ndarray, index: int) -> np.ndarray:
        path = self.file(index, '.txt')
        if not self.align or (self.split == 'test' and not path.is_file()):
            return xyz
        matrix = read_axis_alignment(path)
        return xyz if matrix is None else align_points(xyz, matrix)

    def _objects(self, index: int, rows: int) -> Objects:
        path = self.file(index, '.aggregation.json')
        groups = read_aggregation(path)
        segments_path = self.file(index, '_vh_clean_2.0.010000.segs.json')
        segments = read_segments(segments_path, rows)
        check_segments(groups, segments, path, segments_path)
        return Objects(groups, path, object_of_points(segments, groups))

    def _nyu40(self, index: int, objects: Objects) -> Int[np.ndarray, ' points']:
        """NYU40 id of each point, from the source that ``label_source`` asks for."""
        path = self.file(index, '_vh_clean_2.labels.ply')
        if self.label_source == 'aggregation' or (self.label_source == 'auto' and not path.is_file()):
            return self._nyu40_of_objects(objects)
        ids = read_label_ply(path, len(objects.owner))
        beyond = int(ids.max()) > NYU40
        if self.label_source == 'auto' and (beyond or (self.data_root / LABEL_MAP).is_file()):
            from_objects = self._nyu40_of_objects(objects)
            if beyond or _disagree(ids, from_objects):
                return from_objects
        if beyond:
            raise SceneError(
                f'{path}: label: expected NYU40 ids from 0 to {NYU40}, got {ids.max()}; these are raw ids of ScanNet '
                "v1, label_source='aggregation' maps the objects by name instead"
            )
        return ids

    def _nyu40_of_objects(self, objects: Objects) -> Int[np.ndarray, ' points']:
        if self._label_map is None:
            self._label_map = read_label_map(self.data_root / LABEL_MAP)
        ids = nyu40_of_groups(objects.groups, self._label_map, objects.path)
        return np.where(objects.owner >= 0, np.r_[ids, 0][objects.owner], 0)


def _disagree(ids: Int[np.ndarray, ' points'], nyu40: Int[np.ndarray, ' points']) -> bool:
    """True where most annotated points have another id than their object: raw ids of ScanNet v1 are small ones, too."""
    both = (nyu40 != 0) & (ids != 0)
    return bool(both.any()) and float((ids == nyu40)[both].mean()) < 0.5
