"""Small generated scenes with classes and instances, as a data set: floor 0, boxes 1 (things), a wall 2."""

import numpy as np

from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset
from rm3d_plugin.structures import PointCloud

CLASSES = ('floor', 'box', 'wall')


def _sheet(rng, low, side_a, side_b, count):
    return np.asarray(low) + rng.uniform(size=(count, 1)) * side_a + rng.uniform(size=(count, 1)) * side_b


def make_scene(seed: int, density: int = 1) -> RawScene:
    """A floor of 4 m x 3 m, a wall, and three boxes of different colour; 40 points have no label."""
    rng = np.random.default_rng(seed)
    x, y, z = np.eye(3)
    parts = [_sheet(rng, [0, 0, 0], 4 * x, 3 * y, 900 * density), _sheet(rng, [0, 3, 0], 4 * x, 1.5 * z, 500 * density)]
    semantic, instance = [0, 2], [-1, -1]
    for number, place in enumerate([(0.5, 0.5), (1.8, 1.2), (3.0, 0.6)]):
        low, size = np.array([*place, 0.0]), np.diag([0.6, 0.5, 0.4 + 0.2 * number])
        for a, b, shift in ((0, 1, size[2]), (0, 2, 0), (1, 2, 0), (0, 2, size[1]), (1, 2, size[0])):
            parts.append(_sheet(rng, low + shift, size[a], size[b], 60 * density))
            semantic.append(1)
            instance.append(number)
    counts = [len(part) for part in parts]
    xyz = np.concatenate(parts) + rng.normal(0, 0.002, size=(sum(counts), 3))
    labels, objects = np.repeat(semantic, counts), np.repeat(instance, counts)
    order = rng.permutation(len(xyz))
    colors = np.array([[0.5, 0.5, 0.5], [0.8, 0.2, 0.1], [0.9, 0.9, 0.8]])[labels] + rng.normal(0, 0.03, (len(xyz), 3))
    unknown = order[:40]
    labels[unknown], objects[unknown] = -1, -1
    cloud = PointCloud(xyz[order].astype(np.float32), colors=np.clip(colors[order], 0, 1))
    return RawScene(cloud, labels[order], objects[order])


class ToyRooms(SegmentationDataset):
    """``count`` such scenes, named room0, room1, ..."""

    thing_classes = (1,)

    def __init__(self, count: int = 3, split: str = 'train', truth: bool = True, density: int = 1, **settings) -> None:
        super().__init__(split, classes=CLASSES, **settings)
        self.count, self.truth, self.density = count, truth, density

    def find_scenes(self) -> tuple[str, ...]:
        return tuple(f'room{i}' for i in range(self.count))

    def read_scene(self, index: int) -> RawScene:
        scene = make_scene(index, self.density)
        return scene if self.truth else RawScene(scene.cloud)
