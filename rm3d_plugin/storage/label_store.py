"""The label store: the only door through which labels reach training.

::

    root/
      current.json              the round that training reads
      round_000/
        <scene>.npz             labels of one scene
        ledger/<scene>.npz      why regions were merged (optional; for reading only)
        complete.json           scenes and summary; written last, so a round without it is half-written
      kept/<name>/<scene>.npz   what outlasts a round, by name (region_prior, say)
"""

import shutil
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

import numpy as np

from rm3d_plugin.storage.files import DamagedFileError, content_of, read_npz, write_npz
from rm3d_plugin.storage.sealed_json import read_sealed, write_sealed
from rm3d_plugin.structures import Boxes3D, PseudoLabels, SceneError

FORMAT = 2  # of a scene's file; raise it when names or meanings change, so that older files are refused
_ARRAYS = {'semantic': 'i', 'instance': 'i', 'point_is_annotated': 'b', 'confidence': 'f', 'box_is_annotated': 'b'}
_OPTIONAL = {'likeliest': 'i'}


class LabelStoreError(SceneError):
    """Labels that are asked for are not there, or not whole."""


class SceneEntry(NamedTuple):
    """What a finished round knows of a scene: how many points have a row, how many boxes are annotated."""

    points: int
    true_boxes: int


class LabelStore:
    """Pseudo labels of every training scene, round by round.

    Nothing is kept in memory: data loader processes live longer than a round and would never see a change.

    Args:
        root: Folder of the store; made when first written.
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)

    def folder(self, round: int) -> Path:
        """The folder of a round."""
        if round < 0:
            raise ValueError(f'LabelStore: rounds count from 0, got {round}')
        return self.root / f'round_{round:03d}'

    def scene_path(self, round: int, scene_id: str) -> Path:
        """The file of a scene's labels; any text may be a scene name."""
        return self.folder(round) / f'{quote(scene_id, safe="")}.npz'

    def ledger_path(self, round: int, scene_id: str) -> Path:
        """The file of a scene's merge ledger."""
        return self.folder(round) / 'ledger' / f'{quote(scene_id, safe="")}.npz'

    # ------------------------------------------------------------------ writing a round

    def begin_round(self, round: int, overwrite: bool = False) -> None:
        """Make room for a round: what a broken-off run left of it is removed.

        Raises:
            LabelStoreError: The round is complete and ``overwrite`` is False.
        """
        if self.is_complete(round):
            if not overwrite:
                raise LabelStoreError(
                    f'{self.folder(round)}: round {round} is complete; '
                    'use it (set_current) or pass overwrite=True to make it again'
                )
            if self.current_round() == round:
                self._current_file.unlink()
            self._complete_file(round).unlink()
        if self.folder(round).exists():
            shutil.rmtree(self.folder(round))
        self.folder(round).mkdir(parents=True)

    def write(
        self,
        round: int,
        scene_id: str,
        labels: PseudoLabels,
        ledger: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Write one scene's labels, and its ledger where given.

        Raises:
            LabelStoreError: The round was not begun, or is complete already.
        """
        if self.is_complete(round) or not self.folder(round).is_dir():
            state = 'is complete' if self.is_complete(round) else 'was not begun'
            raise LabelStoreError(f'{self.folder(round)}: round {round} {state}; call begin_round first')
        if ledger is not None:
            write_npz(self.ledger_path(round, scene_id), ledger)
        write_npz(self.scene_path(round, scene_id), _to_arrays(labels))

    def finish_round(self, round: int, summary: Mapping[str, Any] | None = None) -> None:
        """Check every file of a round and declare it complete.

        Args:
            round: The round.
            summary: Plain numbers and text to keep with it (coverage, precision, ...).

        Raises:
            LabelStoreError: The round was not begun, or holds no scene.
            DamagedFileError: A file is not whole.
        """
        scenes = {}
        for path in sorted(self.folder(round).glob('*.npz')):
            arrays = read_npz(path)
            entry = SceneEntry(len(arrays['semantic']), int(arrays['box_is_annotated'].sum()))
            scenes[unquote(path.stem)] = entry._asdict()
        if not scenes:
            raise LabelStoreError(f'{self.folder(round)}: round {round} holds no scene; write them first')
        content = {'round': round, 'scenes': scenes, 'summary': dict(summary or {})}
        write_sealed(self._complete_file(round), content)

    def set_current(self, round: int) -> None:
        """From now on every process reads this round.

        Raises:
            LabelStoreError: The round is not complete.
        """
        self._need_complete(round)
        write_sealed(self._current_file, {'round': round})

    def forget_rounds(self, first: int) -> None:
        """Remove this round and all later ones, which are to be made again; the current one is that before them.

        Raises:
            LabelStoreError: There is no complete round before them.
        """
        self.set_current(first - 1)
        for number in [number for number in self.rounds() if number >= first]:
            self.begin_round(number, overwrite=True)

    # ------------------------------------------------------------------ reading

    def current_round(self) -> int | None:
        """The round that training reads, None before the first; read from the disk at each call.

        Raises:
            DamagedFileError: What names it is damaged, and no round is complete.

        Warns:
            UserWarning: What names it is damaged: it is the last complete round.
        """
        try:
            return self._read_current()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except DamagedFileError as error:
            if not self.rounds():
                raise
            warnings.warn(f'{error}. Round {self.rounds()[-1]}, the last complete one, is read.', stacklevel=2)
            return self.rounds()[-1]

    def _read_current(self) -> int:
        content = read_sealed(self._current_file)
        number = content.get('round')
        if type(number) is not int or number < 0:
            raise DamagedFileError(f'{self._current_file}: expected {{"round": number from 0}}, got {content!r}')
        return number

    def is_complete(self, round: int) -> bool:
        """True where a round was written to its end."""
        return self._complete_file(round).is_file()

    def rounds(self) -> tuple[int, ...]:
        """The complete rounds, ascending."""
        names = (folder.parent.name.removeprefix('round_') for folder in self.root.glob('round_*/complete.json'))
        return tuple(sorted(int(name) for name in names if name.isdigit()))

    def read(self, scene_id: str, round: int | None = None) -> PseudoLabels:
        """Labels of one scene.

        Args:
            scene_id: The scene.
            round: None: the current round. A round that is still being written may be named.

        Raises:
            LabelStoreError: There is no current round, or the round lacks the scene.
            DamagedFileError: The file is not whole.
        """
        chosen = self._choose(round)
        path = self.scene_path(chosen, scene_id)
        try:
            arrays = read_npz(path)
        except FileNotFoundError:
            self._need_complete(chosen)
            raise LabelStoreError(
                f'scene {scene_id}, round {chosen}: no labels at {path}; the round holds {len(self.scenes(chosen))} '
                'other scenes. Train on those, or delete the store and label all scenes again'
            ) from None
        _check_format(arrays, path)
        with content_of(path, f'labels of scene {scene_id}, round {chosen}'):
            return _from_arrays(arrays)

    def read_ledger(self, scene_id: str, round: int | None = None) -> dict[str, np.ndarray]:
        """Ledger arrays of one scene.

        Raises:
            LabelStoreError: None was written.
        """
        chosen = self._choose(round)
        path = self.ledger_path(chosen, scene_id)
        if not path.is_file():
            raise LabelStoreError(f'scene {scene_id}, round {chosen}: no ledger at {path}; none was written')
        return read_npz(path)

    def keep(self, name: str, scene_id: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep something of a scene that outlasts the rounds; what was kept under the name is replaced."""
        write_npz(self._kept_path(name, scene_id), {**arrays, 'format': np.array(FORMAT)})

    def read_kept(self, name: str, scene_id: str) -> dict[str, np.ndarray] | None:
        """What is kept of a scene under a name; None: nothing.

        Raises:
            LabelStoreError: It was written by another version.
        """
        path = self._kept_path(name, scene_id)
        if not path.is_file():
            return None
        arrays = read_npz(path)
        _check_format(arrays, path)
        return arrays

    def scenes(self, round: int | None = None) -> dict[str, SceneEntry]:
        """Scenes of a complete round, sorted by name."""
        return self._read_complete(self._choose(round))[0]

    def summary(self, round: int | None = None) -> dict[str, Any]:
        """What :meth:`finish_round` was given."""
        return self._read_complete(self._choose(round))[1]

    # ------------------------------------------------------------------ helpers

    @property
    def _current_file(self) -> Path:
        return self.root / 'current.json'

    def _kept_path(self, name: str, scene_id: str) -> Path:
        return self.root / 'kept' / name / f'{quote(scene_id, safe="")}.npz'

    def _complete_file(self, round: int) -> Path:
        return self.folder(round) / 'complete.json'

    def _read_complete(self, round: int) -> tuple[dict[str, SceneEntry], dict[str, Any]]:
        """Scenes, sorted by name, and summary."""
        self._need_complete(round)
        path = self._complete_file(round)
        content = read_sealed(path)
        with content_of(path, 'the list of scenes of a round'):
            scenes = {name: SceneEntry(**entry) for name, entry in sorted(content['scenes'].items())}
            if not all(type(number) is int and number >= 0 for entry in scenes.values() for number in entry):
                raise ValueError('expected numbers of points and of boxes')
            return scenes, {**content['summary']}

    def _choose(self, round: int | None) -> int:
        chosen = self.current_round() if round is None else round
        if chosen is None:
            raise LabelStoreError(
                f'{self.root}: the label store has no current round ({self._current_file.name} is missing); '
                'label the training scenes first (`rm3d train` does), or correct label_store'
            )
        return chosen

    def _need_complete(self, round: int) -> None:
        if not self.is_complete(round):
            raise LabelStoreError(
                f'{self._complete_file(round)}: missing, so round {round} is absent or half-written '
                f'(complete rounds: {list(self.rounds())}); begin_round({round}) and write it again'
            )


def _check_format(arrays: Mapping[str, np.ndarray], path: Path) -> None:
    with content_of(path, 'labels'):
        found = int(arrays['format']) if 'format' in arrays else 1
    if found != FORMAT:
        raise LabelStoreError(
            f'{path}: has format {found}, this version reads {FORMAT}; train again in another work dir, or go on with '
            'the version that wrote it'
        )


def _to_arrays(labels: PseudoLabels) -> dict[str, np.ndarray]:
    arrays = {name: np.asarray(getattr(labels, name)) for name in _ARRAYS}
    arrays |= {name: rows for name in _OPTIONAL if (rows := getattr(labels, name)) is not None}
    boxes = labels.boxes
    assert boxes.scores is not None
    return {
        **arrays,
        'box_tensor': boxes.tensor,
        'box_labels': boxes.labels,
        'box_scores': boxes.scores,
        'complete': np.array(labels.complete),
        'format': np.array(FORMAT),
    }


def _from_arrays(arrays: Mapping[str, np.ndarray]) -> PseudoLabels:
    own = _ARRAYS | {name: kind for name, kind in _OPTIONAL.items() if name in arrays}
    for name, kind in own.items():
        if arrays[name].ndim != 1 or arrays[name].dtype.kind != kind:
            raise ValueError(f'{name} is {arrays[name].dtype} of shape {arrays[name].shape}')
    boxes = Boxes3D(arrays['box_tensor'], arrays['box_labels'], arrays['box_scores'])
    return PseudoLabels(boxes=boxes, complete=bool(arrays['complete']), **{name: arrays[name] for name in own})
