"""The arguments by which commands find their config."""

import argparse
from pathlib import Path

from mmengine.config import Config

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.key_values import KeyValues
from rm3d_plugin.registry import SCOPE


def add_config_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``config``, ``--demo``, ``--work-dir`` and ``--cfg-options``."""
    parser.add_argument(
        'config', help='a config file, or the name of one that comes with RM3D: rm3d_votenet_kitti_1pct, say'
    )
    parser.add_argument('--demo', action='store_true', help='run on synthetic demo data, made on first use')
    parser.add_argument(
        '--work-dir', metavar='FOLDER', help='receives all that the run leaves; default work_dirs/CONFIG'
    )
    parser.add_argument(
        '--cfg-options',
        nargs='+',
        action=KeyValues,
        default={},
        metavar='KEY=VALUE',
        help='change config keys: data_root=/my/kitti descriptor.type=FPFH budget=3pct seed=1',
    )


def check_config(args: argparse.Namespace) -> Config:
    """Look at the arguments before anything that takes long is imported; what it returns lacks what is measured.

    Raises:
        ConfigError: As :func:`config_of`, but for demo data.
    """
    return load_config(args.config, args.work_dir, args.demo, args.cfg_options)


def config_of(args: argparse.Namespace) -> Config:
    """The config that the arguments name; demo data are made for a demo, and what it leaves to the data is measured.

    Raises:
        ConfigError: No such config, a bad reference, or an option for a key that the config does not have.
    """
    config = load_config(args.config, args.work_dir, args.demo, args.cfg_options)

    from mmengine.dist import barrier  # torch takes seconds; a wrong config is told before
    from mmengine.registry import init_default_scope

    from rm3d_plugin.engine.run import set_threads

    set_threads(config.threads)
    init_default_scope(SCOPE)
    if args.demo:
        _make_demo_data(config)
        barrier()
    return _measured(config, args) if config.get('measured') else config


def _measured(config: Config, args: argparse.Namespace) -> Config:
    """The config with what it leaves to the data."""
    from mmengine.dist import is_main_process

    import rm3d_plugin.datasets  # noqa: F401  (registers them)
    from rm3d_plugin.engine.measured import measure_boxes

    found = measure_boxes(config)
    if is_main_process():
        print('\n'.join(found.lines))
    return load_config(args.config, args.work_dir, args.demo, {**found.options, **args.cfg_options})


def _make_demo_data(config: Config) -> None:
    from mmengine.dist import is_main_process

    from rm3d_plugin.datasets.synthetic import make_demo  # virtual sensors take seconds to import
    from rm3d_plugin.engine.run import DEMO_NOTE
    from rm3d_plugin.storage.locks import waiting_lock

    if not is_main_process():
        return
    try:
        print(DEMO_NOTE)
        for wanted in ({'root': config.data_root, **config.demo_data}, *config.get('more_demo_data', ())):
            root = Path(wanted['root'])
            with waiting_lock(root.parent / f'.{root.name}.lock'):  # two runs may want the same data
                make_demo(**wanted)
    except ValueError as error:  # a folder that holds real data is left alone
        raise ConfigError(f'--demo: {error}') from error
