"""The config leaves, sorted by what they train."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ROOT / 'configs'
LEAVES = sorted([*CONFIGS.glob('*.py'), *CONFIGS.glob('baselines/*.py')])
DESCRIPTORS = sorted(CONFIGS.glob('descriptors/*.py'))
SEGMENTATION = [path for path in LEAVES if '_sem_' in path.stem or '_ins_' in path.stem]
DETECTION = [path for path in LEAVES if path not in SEGMENTATION]


def has_demo(path: Path) -> bool:
    """Real tiles and scans of one's own have none."""
    return not any(word in path.stem for word in ('oakland', 'files'))
