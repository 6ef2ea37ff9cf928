"""How good the pseudo labels of a network are, round by round, whatever it learns from."""

from collections.abc import Iterator
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

from mmengine.dist import all_gather_object, is_main_process
from mmengine.hooks import Hook
from mmengine.runner import Runner

from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.engine.hooks.region_merge_hook import RegionMergeHook
from rm3d_plugin.evaluation.functional.pseudo_label_counts import PseudoLabelCounts, count_pseudo_labels
from rm3d_plugin.evaluation.functional.pseudo_label_scores import pseudo_label_scores
from rm3d_plugin.labeling.accept import confident
from rm3d_plugin.labeling.annotated import annotated_only, scene_truth
from rm3d_plugin.labeling.predicted import with_pseudo_labels
from rm3d_plugin.registry import HOOKS
from rm3d_plugin.storage import read_json, write_json

RECORD = 'predicted_labels.json'


@HOOKS.register_module()
class PredictionQualityHook(Hook):
    """Compares what the network says of the training points with their truth, at the end of each round.

    Methods that make no pseudo labels are compared so with those that do: from all, the answers of which the network is
    sure count, point by point. It is a report: training sees nothing of it. The work dir's ``predicted_labels.json``
    has for each round, from 0, ``coverage`` (share of all points with a label, annotated ones too), ``precision``
    (share of the accepted answers that are right) and ``offset_error`` (metres from the centre that a point votes for
    to that of its instance), null where nothing is known.

    Args:
        threshold: Least probability; larger: fewer and purer labels.
    """

    priority = 'LOW'

    def __init__(self, threshold: float = 0.9) -> None:
        self.threshold = threshold
        self._rounds: dict[str, dict[str, float]] = {}

    def before_train(self, runner: Runner) -> None:
        """Take up what an interrupted run noted, or begin anew."""
        path = Path(runner.work_dir) / RECORD
        self._rounds = read_json(path) if runner.epoch and path.is_file() else {}

    def after_train_epoch(self, runner: Runner) -> None:
        """Note a round that ends here."""
        merging = merging_hook(runner)
        number, rest = divmod(runner.epoch + 1, merging.interval)
        if rest:
            return
        own = reduce(add, self._counts(merging, runner.model), PseudoLabelCounts.none(_classes(merging)))
        scores = pseudo_label_scores(reduce(add, all_gather_object(own)))
        told = {'coverage': scores.coverage, 'precision': scores.precision, 'offset_error': scores.vote_error}
        self._rounds[str(number - 1)] = told
        if is_main_process():
            write_json(Path(runner.work_dir) / RECORD, self._rounds)

    def _counts(self, merging: RegionMergeHook, model: Any) -> Iterator[PseudoLabelCounts]:
        """Of the scenes of this process, one by one."""
        maker = merging.label_maker
        for scene, prediction in maker.checked(merging.predictions(model, 'what the network says')):
            index = maker.index_of[scene]
            annotated = annotated_only(maker.source.annotated_labels(index))
            labels = with_pseudo_labels(annotated, *confident(prediction.probabilities, self.threshold))
            truth = scene_truth(maker.source, index)
            yield count_pseudo_labels(labels, truth, _classes(merging), voted_centres=prediction.centers)


def merging_hook(runner: Runner) -> RegionMergeHook:
    """The hook that knows the rounds, the training scenes and their labels.

    Raises:
        ConfigError: The run has none, or is of detection.
    """
    for hook in runner.hooks:
        if isinstance(hook, RegionMergeHook) and hook.label_maker.task == 'segmentation':
            return hook
    raise ConfigError(
        'PredictionQualityHook: expected a RegionMergeHook of segmentation, whose rounds and scenes it reads; '
        'found none; take the hook out, or train classes of points'
    )


def _classes(merging: RegionMergeHook) -> int:
    return len(merging.label_maker.source.classes)
