"""RM3D: 3D scene parsing from almost no labels, as a plug-in for mmengine.

The folders are the data flow. Making labels (numpy and numba, no network code)::

    datasets -> descriptors -> oversegmentation -> regions -> pseudo_labels -> storage (label store)

Learning from labels (torch)::

    storage -> datasets.transforms -> models -> evaluation, visualization

The two meet only in ``labeling`` and ``engine`` (a hook makes new pseudo labels every sigma epochs) and in the label
store. ``ops`` holds pure functions, ``structures`` the containers, ``label_budgets`` what training may see;
``inference``, ``reporting``, ``experiments`` and ``commands`` use all of them.
"""

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

__version__ = '0.2.0'

for _module in ('mmengine', 'cv2'):  # of several packages with the same files; a project has its own
    if importlib.util.find_spec(_module) is None:
        raise ImportError(
            f'rm3d_plugin needs {_module}: install mmengine, or mmengine-lite with any package of OpenCV; '
            'pip install "rm3d_plugin[standalone]" brings the latter'
        )

from rm3d_plugin import registry as registry  # noqa: E402  the scope `rm3d_plugin` exists once the package is imported

if TYPE_CHECKING:
    from rm3d_plugin.engine.config import ConfigError as ConfigError
    from rm3d_plugin.engine.config import load_config as load_config

# Public name -> module that holds it; imported when first asked for, so that `import rm3d_plugin` stays light.
_PUBLIC = {
    'ConfigError': 'rm3d_plugin.engine.config',
    'load_config': 'rm3d_plugin.engine.config',
}
__all__ = ['ConfigError', '__version__', 'load_config', 'registry']  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(_PUBLIC[name]), name)
