"""What the page says of a scan: counts of each class, and lines of text."""

import html
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from rm3d_plugin.annotation.session import Session

FIRST_KEYS = '123456789'
CELLS = 'padding-right: 0.7em; text-align: left; font-weight: normal; white-space: nowrap'
STYLE = f'<style>.counts td, .counts th {{{CELLS}}}</style>'


def status_of(session: Session, scan: str, semantic: Int[np.ndarray, ' points'], lines: Sequence[str]) -> str:
    """A table of the classes, their keys, labelled points and shares, and the lines below; HTML.

    Args:
        session: Whose classes.
        scan: Name of the scan.
        semantic: Class of each of its points.
        lines: Text.
    """
    rows, annotated = [], session.scan(scan).annotated
    for number, name in enumerate(session.classes):
        clicks = int(np.count_nonzero(annotated == number))
        share = 100 * float((semantic == number).mean())
        key = FIRST_KEYS[number : number + 1]
        rows.append(
            f'<tr><td style="color:{session.color(name)}">&#9632;</td><td>{key}</td>'
            f'<td>{html.escape(name)}</td><td>{clicks}</td><td>{share:.0f} %</td></tr>'
        )
    table = '<table class="counts"><tr><th></th><th>key</th><th>class</th><th>clicked</th><th>of points</th></tr>'
    text = ''.join(f'<p>{html.escape(line)}</p>' for line in lines)
    return f'{STYLE}<div style="padding:0.6em">{table}{"".join(rows)}</table>{text}</div>'
