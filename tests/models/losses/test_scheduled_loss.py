import math

import pytest
import torch
from mmengine.logging import MessageHub

from rm3d_plugin.models import Batch
from rm3d_plugin.models.consistency import training_progress
from rm3d_plugin.models.losses import LossTerm, ScheduledLoss
from rm3d_plugin.registry import MODELS

NO_BATCH = Batch(torch.zeros(0, 3), torch.tensor([0, 0]))


@MODELS.register_module(name='TwoValues', force=True)
class TwoValues(LossTerm):
    needs = ('logits',)

    def forward(self, batch, outputs, labels):
        return {'loss_two': torch.tensor(2.0), 'seen': torch.tensor(7.0)}


@pytest.fixture
def epoch(monkeypatch):
    """Says how many of 40 epochs are done."""
    hub = MessageHub('test_scheduled_loss')
    monkeypatch.setattr(MessageHub, 'get_current_instance', classmethod(lambda cls: hub))
    assert training_progress() == 0.0
    hub.update_info('max_epochs', 40)
    return lambda number: hub.update_info('epoch', number)


def test_it_begins_late_and_rises(epoch):
    term = ScheduledLoss([dict(type='TwoValues')], start=0.5, ramp=0.1)
    assert term.needs == ('logits',)
    found = []
    for number in (19, 20, 22, 24, 39):
        epoch(number)
        found.append(term(NO_BATCH, None, None))
    assert found[0] == {} and all(values['seen'] == 7.0 for values in found[1:])
    wanted = [2 * math.exp(-5), 2 * math.exp(-1.25), 2.0, 2.0]
    assert [values['loss_two'].item() for values in found[1:]] == pytest.approx(wanted)


def test_without_a_ramp_it_is_there_at_once(epoch):
    epoch(0)
    assert ScheduledLoss([dict(type='TwoValues')])(NO_BATCH, None, None)['loss_two'].item() == 2.0
    with pytest.raises(ValueError, match='start and ramp'):
        ScheduledLoss([dict(type='TwoValues')], start=50)
