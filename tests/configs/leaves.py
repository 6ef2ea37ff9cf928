"""The config leaves, sorted by what they train."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LEAVES = sorted((ROOT / 'configs').glob('*.py'))
SEGMENTATION = [path for path in LEAVES if path.stem.startswith(('rm3d_sem', 'rm3d_ins', 'sup_sem', 'sup_ins'))]
DETECTION = [path for path in LEAVES if path not in SEGMENTATION]
