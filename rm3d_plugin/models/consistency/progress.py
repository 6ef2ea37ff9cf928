"""How far training is, for losses that begin late."""

from mmengine.logging import MessageHub


def training_progress() -> float:
    """Share of the epochs that are done, in [0, 1), as mmengine's runner notes them; 0 outside a run."""
    hub = MessageHub.get_current_instance()
    epochs = int(hub.get_info('max_epochs', 0) or 0)
    return int(hub.get_info('epoch', 0)) / epochs if epochs else 0.0
