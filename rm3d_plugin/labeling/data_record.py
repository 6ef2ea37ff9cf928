"""Which data a run began with: a hash of each scene's points and of the labels that are shown of it."""

from pathlib import Path

from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.storage import content_key, content_of, read_json, write_json
from rm3d_plugin.structures import SceneError

DATA = 'data.json'


def check_data(folder: Path, source: LabelSource, keep: bool) -> None:
    """Note the data of a new run; compare them where a run goes on.

    A budget names points and boxes by number, so files whose order changed would put labels on other points.

    Args:
        folder: Of the label store.
        source: Scenes and their annotated labels.
        keep: A run goes on. One of an older version has no record, and gets one.

    Raises:
        SceneError: A scene is not what it was; names it, and what changed.
    """
    path = folder / DATA
    now = {scene: _hashes(source, index) for index, scene in enumerate(source.scene_ids)}
    if not keep or not path.is_file():
        write_json(path, now)
        return
    before = read_json(path)
    for scene, hashes in now.items():
        with content_of(path, 'the data of a run'):
            changed = [what for what, digest in hashes.items() if before.get(scene, {}).get(what) != digest]
        if changed:
            raise SceneError(
                f'scene {scene}: its {" and ".join(changed)} changed since the run began (or their order); '
                f'put the old files back, or train in another work dir ({path})'
            )


def _hashes(source: LabelSource, index: int) -> dict[str, str]:
    """Points, and the labels that are read from the data anew: boxes, and scenes that are labelled completely."""
    cloud, shown = source.load_cloud(index), source.annotated_labels(index)
    classes = shown.semantic if shown.complete else None
    return {
        'points': content_key(cloud.xyz, cloud.origin),
        'labels': content_key(classes, shown.boxes.tensor, shown.boxes.labels),
    }
