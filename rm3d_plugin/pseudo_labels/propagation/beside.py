"""What is known of a scan beside its own labels: examples of other scans, classes that may be there, a network."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.rules import NetworkSay


@dataclass(frozen=True, eq=False)
class Beside:
    """Further knowledge of a scan; all of it may be left away.

    Attributes:
        features: (E, F) of labelled points of other scans, of :func:`examples_of`; they teach what classes look like.
        classes: (E,) of these.
        possible: (C,) classes that may be in the scan although none of its points is labelled so. They get what the
            features of other scans and the network say for them; other classes without a label are never named.
        network: (N, C) float32 probabilities of a network; rows of NaN where it saw nothing.
        unseen: (N,) labelled points that the network was not taught: they alone can judge it. None: it has no say.
        say: How the network enters, where labels of several scans judged it; ``unseen`` is then not asked.
        sharpness: Power of the probabilities by which they are right as often as they say, where labels of several
            scans told; the scan's own labels are then not left out.
    """

    features: Float[np.ndarray, 'examples features'] | None = None
    classes: Int[np.ndarray, ' examples'] | None = None
    possible: Bool[np.ndarray, ' classes'] | None = None
    network: Float[np.ndarray, 'points classes'] | None = None
    unseen: Bool[np.ndarray, ' points'] | None = None
    say: NetworkSay | None = None
    sharpness: float | None = None

    def check(self, scene: PreparedCloud, num_classes: int) -> None:
        """Whether it fits a scan.

        Raises:
            ValueError: It does not; the message names the field.
        """
        points, width = len(scene.cloud), scene.features.shape[1]
        rows = 0 if self.features is None else len(self.features)
        expected = {
            'features': (rows, width),
            'classes': (rows,),
            'possible': (num_classes,),
            'network': (points, num_classes),
            'unseen': (points,),
        }
        for name, shape in expected.items():
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                hint = '; scans teach each other if they have the same channels' if name == 'features' else ''
                raise ValueError(f'propagate: Beside.{name}: expected shape {shape}, got {value.shape}{hint}')
        if (self.features is None) != (self.classes is None):
            raise ValueError('propagate: Beside: features and classes go together, one of them is missing')
        if rows and not (0 <= int(self.classes.min()) and int(self.classes.max()) < num_classes):  # type: ignore[union-attr]
            raise ValueError(f'propagate: Beside.classes: expected 0 to {num_classes - 1}')


def examples_of(
    scene: PreparedCloud, annotated: Int[np.ndarray, ' points']
) -> tuple[Float[np.ndarray, 'examples features'], Int[np.ndarray, ' examples']]:
    """What a scan gives to :class:`Beside` of others: small regions about its labelled points, and classes.

    A region with many labels of a class, as of a stroke, is one example.

    Args:
        scene: The scan.
        annotated: Class of each point, -1 = unknown.
    """
    rows = np.flatnonzero(annotated >= 0)
    regions = scene.scales[0].region[rows]
    _, first = np.unique(np.column_stack([regions, annotated[rows]]), axis=0, return_index=True)
    first.sort()
    return scene.features[regions[first]], annotated[rows[first]].astype(np.int64)
