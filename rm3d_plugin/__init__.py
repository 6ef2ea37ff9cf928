"""RM3D: 3D scene parsing from almost no labels, as a plug-in for mmengine.

The folders are the data flow. Making labels (numpy and numba, no network code)::

    datasets -> descriptors -> oversegmentation -> regions -> pseudo_labels -> storage (label store)

Learning from labels (torch)::

    storage -> datasets.transforms -> models -> evaluation, visualization

The two meet only in ``engine`` (a hook regenerates the pseudo labels every sigma epochs) and in the label store.
``ops`` holds pure functions, ``structures`` the containers, ``label_budgets`` what training may see.
"""

__version__ = '0.1.0'

from rm3d_plugin import registry as registry  # noqa: E402  the scope `rm3d_plugin` exists once the package is imported
