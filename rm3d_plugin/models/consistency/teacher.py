"""What a slowly following copy of the network says of a batch."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import torch

from rm3d_plugin.models.consistency.view import Classify, Encode, View


class Teacher:
    """Answers of a teacher network, without gradients; it is asked when a loss needs it, and once.

    Which network that is, and how it follows, is the business of a hook (``EMATeacherHook``).

    Args:
        ask: What the teacher says of the first view: ``SegmentorOutput`` or ``DetectorOutput``.
        encode: Its ``(points, batch_offsets) -> features``.
        classify: Its features of points -> logits.
    """

    def __init__(self, ask: Callable[[], Any], encode: Encode, classify: Classify) -> None:
        self._ask, self._encode, self._classify = ask, encode, classify

    @cached_property
    def outputs(self) -> Any:
        """What the teacher says of the points that the network sees."""
        with torch.no_grad():
            return self._ask()

    def view(self, view: View) -> View:
        """The same points of a further view, with what the teacher says of them; each call asks anew."""
        encode, classify = torch.no_grad()(self._encode), torch.no_grad()(self._classify)
        return View(view.points, view.batch_offsets, view.point_ids, encode, classify)
