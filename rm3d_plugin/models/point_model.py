"""What segmentor and detector share: a backbone, heads on its features, and an open list of losses."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import partial
from typing import Any, Literal, final, get_args

import torch
from mmengine.dist import all_reduce
from mmengine.model import BaseModel
from mmengine.structures import BaseDataElement
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import Teacher, View, kept_statistics
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import FeatureOutput
from rm3d_plugin.models.preprocessor import join_inputs
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics, SceneSample, nest_predictions

Mode = Literal['loss', 'predict', 'tensor']
LossConfigs = Sequence[dict[str, Any] | None]


class PointModel(BaseModel):
    """A network that says something of every point.

    ::

        points ---------> encode --> features --> heads -> outputs --+
        views, if asked > encode --> features --> classify ----------+--> losses[0], losses[1], ... -> dict
        data samples ---> labels ------------------------------------+

    A subclass builds its heads in ``__init__`` and then calls :meth:`add_losses`, since the start of a network depends
    on the order of its parts.

    Args:
        backbone: Config of a backbone with ``forward(xyz, features, batch_offsets)`` and ``out_channels``;
            ``in_channels`` is filled in.
        in_channels: Features of a point that the backbone reads.
        data_preprocessor: ``ScenePreprocessor`` by default.
        init_cfg: As in mmengine.

    Attributes:
        losses: The :class:`LossTerm` of each entry by its class name (a second of a class gets a number).
        teacher: Another network of the same parts, whose answers losses find in ``batch.teacher``; None: there is none.
            It is no part of this one: neither trained with it nor in its ``state_dict``.
        predict_points: Predict what making labels needs of points; the label hook sets it while it asks for that.
        predict_features: Whether that holds the features of points, too; the hook sets it as the label maker wants.
    """

    def __init__(
        self,
        backbone: dict[str, Any],
        in_channels: int,
        data_preprocessor: dict[str, Any] | None = None,
        init_cfg: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(data_preprocessor or {'type': 'rm3d_plugin.ScenePreprocessor'}, init_cfg)
        self.backbone = MODELS.build({**backbone, 'in_channels': in_channels})
        self.predict_points, self.predict_features = False, False
        self._teacher: tuple[PointModel, ...] = ()  # in a tuple, so that torch does not take it for a part

    @abstractmethod
    def encode(self, points: Tensor, batch_offsets: Tensor) -> Tensor:
        """Features (N, F) of the points (N, D) of a batch."""

    @abstractmethod
    def classify(self, features: Tensor) -> Tensor:
        """Class scores of points, float32, from their features."""

    @abstractmethod
    def network(self, batch: Batch) -> FeatureOutput:
        """Run backbone and heads."""

    @abstractmethod
    def labels(self, samples: Sequence[BaseDataElement], batch: Batch, outputs: Any) -> Any:
        """What is known of a batch, as a named tuple: what the losses get."""

    @abstractmethod
    def predict(self, batch: Batch, samples: list[BaseDataElement]) -> None:
        """Fill in the predictions of every scene, on the CPU; gradients are off."""

    @abstractmethod
    def set_label_statistics(self, statistics: LabelStatistics) -> None:
        """Tell the model what the labels of the training set say as a whole; checkpoints keep counts and sizes."""

    @final
    def add_losses(self, configs: LossConfigs, given: set[str]) -> None:
        """Build the losses; an entry that is None is left out.

        Args:
            configs: Of :class:`LossTerm`.
            given: The fields that outputs and labels of this model have.

        Raises:
            TypeError: An entry is no :class:`LossTerm`.
            ValueError: A loss reads a field that this model does not have.
        """
        self.losses = nn.ModuleDict()  # behind the heads: the order of parameters decides the last bits
        for config in configs:
            if config is None:
                continue
            term = MODELS.build(config)
            name = type(term).__name__
            if not isinstance(term, LossTerm):
                raise TypeError(
                    f'losses: expected loss terms, called with (batch, outputs, labels), got {name}; wrap it, say as '
                    "dict(type='ViewConsistency', loss=dict(type='JSAugLoss')), or make it a LossTerm"
                )
            if missing := set(term.needs) - given:
                raise ValueError(
                    f'losses: {name} reads {", ".join(sorted(missing))}, which this {type(self).__name__} does not '
                    'have: give it the head that says so, or leave the loss out'
                )
            again = sum(type(other).__name__ == name for other in self.losses.values())
            self.losses[f'{name}_{again + 1}' if again else name] = term

    @property
    def teacher(self) -> 'PointModel | None':
        """See the class."""
        return self._teacher[0] if self._teacher else None

    @final
    def set_teacher(self, teacher: 'PointModel | None') -> None:
        """Take a teacher, or none; a hook does."""
        self._teacher = () if teacher is None else (teacher,)

    @final
    def forward(
        self,
        inputs: dict[str, Any],
        data_samples: Sequence[BaseDataElement] | None = None,
        mode: Mode = 'tensor',
    ) -> Any:
        """Losses by name, samples with predictions (fresh ones where none are given), or the plain outputs.

        Args:
            inputs: As :class:`ScenePreprocessor` gives them, or still one tensor a scene, as a preprocessor of
                another project leaves them.
            data_samples: One a scene: ``SceneSample``, or ``Det3DDataSample`` of mmdetection3d, which then gets its
                predictions in its own layout, too.
            mode: What to do.

        Raises:
            ValueError: The mode is unknown, or there is not one sample a scene.
            SceneError: Samples do not fit their scenes, or have nothing to learn from.
        """
        if mode not in get_args(Mode):
            raise ValueError(f'mode: expected one of {get_args(Mode)}, got {mode!r}')
        batch = self.join(inputs)
        if mode == 'loss':
            return self._loss(self._as_many_views(batch), _one_a_scene(data_samples or (), batch))
        if mode == 'predict':
            fresh = [SceneSample() for _ in batch.sizes]
            given = fresh if data_samples is None else _one_a_scene(data_samples, batch)
            with torch.no_grad():
                self.predict(batch, given)
            for sample in given:
                nest_predictions(sample)
            return given
        return self.network(batch)

    @final
    def join(self, inputs: dict[str, Any]) -> Batch:
        """A batch of the scenes, still one tensor a scene or joined already, with its views and the teacher."""
        inputs = inputs if 'batch_offsets' in inputs else join_inputs(inputs)
        views = (View(**view, encode=self._encode_view, classify=self.classify) for view in inputs.get('views', ()))
        batch = Batch(inputs['points'], inputs['batch_offsets'], tuple(views))
        wise = self.teacher
        if wise is None:
            return batch
        return batch._replace(teacher=Teacher(partial(wise.network, batch), wise.encode, wise.classify))

    @final
    def _as_many_views(self, batch: Batch) -> Batch:
        """As many views as any of the processes that train together has; the batch itself stands for those it lacks.

        Statistics of normalisation are those of all processes, so all must see a view where one does.
        """
        most = torch.tensor(len(batch.views), device=batch.points.device)
        all_reduce(most, 'max')
        ids = torch.arange(len(batch.points), device=batch.points.device)
        own = View(batch.points, batch.batch_offsets, ids, self._encode_view, self.classify)
        return batch._replace(views=batch.views + (own,) * (int(most) - len(batch.views)))

    @final
    def _encode_view(self, points: Tensor, batch_offsets: Tensor) -> Tensor:
        with kept_statistics(self.backbone):
            return self.encode(points, batch_offsets)

    @final
    def _loss(self, batch: Batch, samples: Sequence[BaseDataElement]) -> dict[str, Tensor]:
        """What every entry of the list says, in its order.

        Raises:
            ValueError: Two entries give a value the same name.
        """
        outputs = self.network(batch)
        labels = self.labels(samples, batch, outputs)
        found: dict[str, Tensor] = {}
        for key, term in self.losses.items():
            values = term(batch, outputs, labels)
            if twice := found.keys() & values.keys():
                raise ValueError(f'losses: {key} and an entry before it both say {", ".join(sorted(twice))}')
            found.update(values)
        return found


def _one_a_scene(samples: Sequence[BaseDataElement], batch: Batch) -> list[BaseDataElement]:
    if len(samples) != len(batch.sizes):
        raise ValueError(f'data_samples: expected {len(batch.sizes)}, one a scene, got {len(samples)}')
    return list(samples)
