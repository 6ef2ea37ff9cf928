"""Package definition of rm3d_plugin; wheels only, no compile step."""

from pathlib import Path

from setuptools import find_namespace_packages, find_packages, setup

HERE = Path(__file__).parent
CONFIGS = ['rm3d_plugin.configs', *(f'rm3d_plugin.configs.{name}' for name in find_namespace_packages('configs'))]

setup(
    name='rm3d_plugin',
    version='0.2.0',
    description='3D scene parsing from almost no labels: region merging with 3D descriptors, as an mmengine plug-in',
    long_description=(HERE / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    python_requires='>=3.11,<3.14',
    packages=[*find_packages(include=['rm3d_plugin', 'rm3d_plugin.*']), *CONFIGS],
    package_dir={'rm3d_plugin.configs': 'configs'},  # `rm3d_plugin::NAME.py` needs no checkout
    package_data={
        'rm3d_plugin': ['py.typed', 'baselines/*/README.md'],
        'rm3d_plugin.experiments': ['paper_tables/*.csv'],
        'rm3d_plugin.experiments.benchmarks': ['*.cpp'],
        'rm3d_plugin.descriptors.learned': ['weights/*.npz', 'weights/*.md'],
    },
    entry_points={'console_scripts': ['rm3d = rm3d_plugin.commands.main:main']},
    install_requires=[
        'torch>=2.6',
        'matplotlib>=3.9',
        'numpy>=1.26,<3',
        'scipy>=1.13',
        'cachetools>=5.3',
        'numba>=0.60',
        'omegaconf>=2.4',  # references within configs
        'robust-laplacian>=1.1',
        'jaxtyping>=0.2.34',
        'joblib>=1.4',
        'tqdm>=4.66',
        'tensorboard>=2.17',
        'setuptools>=77.0.3,<82',  # torch needs the first, mmengine's pkg_resources the second
    ],
    # mmengine and OpenCV come in several packages of the same files, of which a project has its own: none is required.
    extras_require={
        'standalone': ['mmengine-lite>=0.10.7,<0.11', 'opencv-python-headless>=4.8'],
        'test': [
            'pytest>=8',
            'pytest-xdist>=3.6',
            'hypothesis>=6.100',
            'pytest-benchmark>=5',
            'beartype>=0.19',
            'ruff>=0.9',
            'mypy>=1.14',
            'import-linter>=2.1',
            'dask[distributed]>=2024.8',  # preparation on a cluster
            'playwright>=1.45',  # the page of annotate in a browser, where there is one
            'pyarrow>=17',  # as the extra waymo
        ],
        'docs': ['mkdocs-material>=9.5'],
        'superpoints': ['cut-pursuit-py>=1.0.12'],  # solver of the over-segmenter CutPursuit (MIT)
        'annotate': ['viser>=1.1,<2'],  # the page on which scans are labelled
        'waymo': ['pyarrow>=17'],  # Waymo's parquet files
        'las': ['laspy[lazrs]>=2.5'],  # LAS and LAZ scans
        'e57': ['pye57>=0.4.11'],  # E57 scans
        'peers': ['open3d-cpu==0.20.0'],  # only compared with, in tests and benchmarks; needs libusb and libGL
    },
)
