"""The page a run leaves behind: one HTML file that needs no network."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from rm3d_plugin.storage.files import write_text
from rm3d_plugin.visualization.curves import Chart
from rm3d_plugin.visualization.report_labels import label_section
from rm3d_plugin.visualization.report_merges import MergeReport, merge_section
from rm3d_plugin.visualization.report_sections import BudgetSummary as BudgetSummary
from rm3d_plugin.visualization.report_sections import (
    budget_section,
    chart_section,
    config_section,
    page,
    picture_section,
    result_section,
    score_section,
    section,
    summary_section,
)
from rm3d_plugin.visualization.report_times import RoundTime, time_section
from rm3d_plugin.visualization.scene_view import view_block


class Picture(NamedTuple):
    """A picture with its words; ``png`` are the bytes of a PNG file."""

    caption: str
    png: bytes


class ResultRow(NamedTuple):
    """One line of the result table: percent at each difficulty, NaN where there was nothing to find."""

    class_name: str
    metric: str
    easy: float
    moderate: float
    hard: float


class ScoreTable(NamedTuple):
    """Scores of classes: a name and percent in each row, NaN where there was nothing to find; 'mean' stands out."""

    caption: str
    head: Sequence[str]
    rows: Sequence[tuple[Any, ...]]


@dataclass(frozen=True)
class RunReport:
    """Everything the page shows; what is left empty is left out.

    Attributes:
        title: Headline.
        synthetic: True puts a note on top that the data are synthetic.
        notes: Further sentences on top.
        summary: Headline numbers and facts by name.
        budget: Which labels training saw.
        results: Rows (class, metric, easy, moderate, hard), percent.
        scores: Scores of classes in segmentation.
        charts: Loss and AP curves.
        rounds: One summary a round: ``coverage`` in [0, 1]; ``points``: by class ``pseudo`` (count) and ``precision``
            (in [0, 1] or None); ``boxes``: by class ``annotated``, ``pseudo``, ``correct``, ``true`` (counts);
            ``truth_known``: False where correct and true mean nothing. ``round`` numbers the row, else its place does.
        pictures: Bird's-eye views.
        views: Scenes to turn, as :func:`~rm3d_plugin.visualization.scene_view.pack_views` gives them.
        merges: Strongest and weakest merges of the last round.
        config: Settings by name.
        config_text: The whole resolved config.
        seconds: Wall-clock seconds by stage; they add up.
        times: What each round took.
    """

    title: str
    synthetic: bool = False
    notes: Sequence[str] = ()
    summary: Mapping[str, Any] = field(default_factory=dict)
    budget: BudgetSummary | None = None
    results: Sequence[tuple[str, str, float, float, float]] = ()
    scores: ScoreTable | None = None
    charts: Sequence[Chart] = ()
    rounds: Sequence[Mapping[str, Any]] = ()
    pictures: Sequence[Picture] = ()
    views: Mapping[str, Any] | None = None
    merges: MergeReport | None = None
    config: Mapping[str, Any] = field(default_factory=dict)
    config_text: str = ''
    seconds: Mapping[str, float] = field(default_factory=dict)
    times: Sequence[RoundTime] = ()


def render_report(run: RunReport) -> str:
    """The page as text: valid HTML with every picture inline; all words are escaped."""
    budget = run.budget
    sections = [
        summary_section(run.summary),
        result_section(run.results),
        '' if run.scores is None else score_section(*run.scores),
        '' if budget is None else budget_section(budget),
        label_section(run.rounds),
        chart_section(run.charts),
        '' if run.views is None else section('turn', 'Scenes to turn', view_block(dict(run.views))),
        picture_section(run.pictures),
        '' if run.merges is None else merge_section(run.merges),
        time_section(run.seconds, run.times),
        config_section(run.config, run.config_text),
    ]
    return page(run.title, run.synthetic, run.notes, [part for part in sections if part])


def write_report(path: str | Path, run: RunReport) -> Path:
    """Write the page; a reader never sees half of it.

    Args:
        path: The HTML file.
        run: What to show.

    Returns:
        The file written.
    """
    return write_text(path, render_report(run))
