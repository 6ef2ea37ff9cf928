"""A trainer that writes what a test tells it to, and says which runs it began.

Run as ``fake_commands.py train|test CONFIG [CHECKPOINT] ... --work-dir D --cfg-options K=V ...``. The work directory's
options: ``fail=1`` ends with an error, ``hang=1`` waits for a file ``go`` beside the runs; the score is ``score``, or
the seed where none is given.
"""

import json
import sys
import time
import zipfile
from pathlib import Path


def command(kind, *words):
    """The command line; it imports nothing but the standard library, so that a test starts many."""
    return [sys.executable, '-S', __file__, kind, *words]


def main(kind, *words):
    options = dict(word.split('=', 1) for word in words[words.index('--cfg-options') + 1 :])
    folder = Path(words[words.index('--work-dir') + 1])
    out = folder.parent if kind == 'train' else folder.parent.parent
    with (out / 'begun.txt').open('a') as file:
        file.write(f'{folder.relative_to(out)} {" ".join(words[: words.index("--work-dir")])}\n')
    print('the fake one speaks')
    while options.get('hang') == '1' and not (out / 'go').exists():
        time.sleep(0.02)
    if options.get('fail') == '1':
        sys.exit(3)
    score = float(options.get('score', options['seed']))
    if kind == 'train':
        record = {
            'losses': {},
            'validation': {},
            'final': {'mIoU': score, 'acc': 2 * score, 'network/mIoU': 2 * score},
            'options': options,
        }
        with zipfile.ZipFile(folder / 'epoch_4.pth', 'w') as file:  # as whole as torch's
            file.writestr('weights', '')
        (folder / 'metrics.json').write_text(json.dumps(record))
    else:
        (folder / 'test_metrics.json').write_text(json.dumps({'mIoU': score}))


if __name__ == '__main__':
    main(*sys.argv[1:])
