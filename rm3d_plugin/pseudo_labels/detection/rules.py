"""When a group of points is an object, and every rule of a detection run's labels."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from rm3d_plugin.pseudo_labels.common.self_training import SelfTrainingRules
from rm3d_plugin.pseudo_labels.common.strategy import Strategy, is_paper, optional_rules, with_gamma
from rm3d_plugin.regions import MergeRules
from rm3d_plugin.structures.check_field import check_choice, check_field, check_switches

BoxKind = Literal['completed', 'tight', 'axis_aligned']
Proposed = Literal['boxes', 'instances', 'clusters']


@dataclass(frozen=True)
class ObjectRules:
    """When a group of points is an object, and when a region cannot be one.

    Attributes:
        gamma: Confidence from which a group is a candidate, in place of ``MergeRules.gamma``. None: the same.
        class_gamma: Confidence from which the network gives a group a class, for each class, background last; above 1:
            never; None: ``gamma`` for all. Classes differ in how soon a network is sure of them. And objects that
            nobody annotated are taught as background at first, so a network that is sure of background may be sure of
            its own prejudice; geometry's background is not concerned.
        box: 'completed': from the faces that the sensor saw to the usual size of the class. 'tight': around the
            points, turned to fit their sides. 'axis_aligned': around the points, along the axes of the scene (as the
            paper has it, METHOD 7).
        min_points: Fewest points of a pseudo box; larger: fewer, better boxes.
        max_excess: A group larger than this times its class's usual size is not one object.
        max_iou: Overlap from above that two boxes may have.
        background_ratio: A region larger or higher than this times every class's usual size is background.
        part_share: Where this share of a region is confidently of another class than the rest, it is cut out; above 1:
            regions stay whole.
        support_iou: Overlap, seen from above, from which a box that the network predicts speaks for a group of its
            class: the group's score becomes the geometric mean of its own and the best such box's, 0 where there is
            none. None: the group's own.
        seen_height: Share of the usual height that the points of an object must reach, for each class; objects show
            their top unless something hangs over them. None: any.
        seen_length: Share of the usual length that they must span, for each class. None: any.
        top_fraction: Share of all candidates of a class, best scores first, that become pseudo boxes: in the first
            round with predictions, in the second, ...; the last number holds from there on. Smaller: fewer and purer.
            None: all.
        max_growth: With ``top_fraction``: at most so many times the pseudo boxes that a class had when it first had
            any, or its annotated boxes where these are more; larger: trusts more what a network learnt from itself.
    """

    gamma: float | None = None
    class_gamma: tuple[float, ...] | None = None
    box: BoxKind = 'completed'
    min_points: int = 8
    max_excess: float = 1.35
    max_iou: float = 0.1
    background_ratio: float = 1.5
    part_share: float = 0.25
    support_iou: float | None = None
    seen_height: tuple[float, ...] | None = None
    seen_length: tuple[float, ...] | None = None
    top_fraction: tuple[float, ...] | None = None
    max_growth: float = 2.0

    def __post_init__(self) -> None:
        check_choice(self, 'box', get_args(BoxKind))
        check_field(self, 'gamma', self.gamma is None or 0 < self.gamma <= 1, 'a probability in (0, 1], or None')
        fractions = self.top_fraction
        good = fractions is None or (len(fractions) > 0 and all(0 < share <= 1 for share in fractions))
        check_field(self, 'top_fraction', good, 'shares above 0 and up to 1, or None')
        for name, low in (
            ('min_points', 1),
            ('max_excess', 1),
            ('background_ratio', 1),
            ('max_growth', 1),
            ('max_iou', 0),
            ('part_share', 0),
        ):
            check_field(self, name, getattr(self, name) >= low, f'at least {low}')


AS_PRINTED = ObjectRules(box='axis_aligned', part_share=2.0)
"""METHOD 7 alone: every confident group, whole, in its axis-aligned box."""


@dataclass(frozen=True)
class TeacherRules:
    """When a box that the network predicts becomes a pseudo box.

    Attributes:
        source: 'boxes': what the network predicts as boxes. 'instances': boxes around the instances that its classes
            and votes of points make (paper 3.4), of the kind :attr:`ObjectRules.box`. 'clusters': the same, around
            clusters of points above the ground.
        share: Share of the score that annotated objects of the class get (their median) from which a box is accepted;
            larger: fewer and purer.
        recognised: Probability that the points of annotated objects of a class must have for it (the median over the
            objects): a network that does not know the objects that it was shown names no others. 0: never asked.
        size_ratio: A box with a side or a height that is more than this times the greatest of the class's annotated
            boxes, or that many times less than the least, is not of the class.
        min_points: Fewest points in a box that are not surely background.
        free_above: Share that the points in a box have at least among these and all in the metre over it: objects end,
            poles, trunks and bushes go on. With ``top`` a box is looked at as if it were as high as the tallest of its
            class. 0: never asked.
        top: The points of a box reach no higher above the ground than the highest annotated box of the class over this
            share. What has no class's height, from this share of the lowest annotated box on, is background; the
            widest gap in height between two points is allowed for, since beams may pass just over an object. 0: never
            asked.
        seen_height: With ``top``: share of its own height that the points of a box must reach above the ground, that
            gap included. A box that claims more than is there is around something else. 0: never asked.
        lowest: With ``top``: share of the height of the lowest annotated box of the class that points in the place of a
            box must reach. Larger: purer, and without those who are lower than all that were annotated. 0: never asked.
        least_likeness: Points above the ground fall into clusters, and annotated objects tell how like them each is by
            its shape and by a descriptor (1: as these are like each other). A cluster whose likeness to each class is
            below this is background where no pseudo box is, from the first labels on, and what is still unknown is in
            doubt, where each class has two annotated objects or more. Larger: more background, fewer hidden objects
            spared. 0: never asked, nor where the first labels stay.
        usual_likeness: With ``least_likeness``: a cluster that is at least so like the annotated objects of a class may
            be one. A box around any other does not pass, and the network alone makes no background of one that may be
            an object: it was taught as background what nobody annotated. Larger: fewer and purer, more background.
        growth: A round may expect so many times the objects of a class that the last one did. A network that learnt
            from pseudo boxes confirms them and finds more; larger: trusts it more. Where whole scenes are labelled,
            their counts tell the number.
        max_iou: Overlap from above that two boxes may have.
        refit: The class's usual box is fitted to the points of an accepted box, and takes its place.
        background: Probability from which the network makes a point background that lies in no candidate's box. None:
            geometry alone makes background.
        ignore_unknown: Once the network or shapes (``least_likeness``) were asked, what is unknown is ignored in
            training; False: it goes on to count as background in part (``unlabelled_weight``), hidden objects with it.
    """

    source: Proposed = 'boxes'
    share: float = 0.7
    recognised: float = 0.4
    size_ratio: float = 1.4
    min_points: int = 5
    free_above: float = 0.95
    top: float = 0.0
    seen_height: float = 0.0
    lowest: float = 0.0
    least_likeness: float = 0.0
    usual_likeness: float = 0.5
    growth: float = 2.0
    max_iou: float = 0.1
    refit: bool = False
    background: float | None = 0.95
    ignore_unknown: bool = True

    def __post_init__(self) -> None:
        check_choice(self, 'source', get_args(Proposed))
        check_switches(self, 'refit', 'ignore_unknown')
        check_field(self, 'share', 0 < self.share <= 1, 'a share in (0, 1]')
        check_field(self, 'recognised', 0 <= self.recognised <= 1, 'a probability')
        check_field(self, 'size_ratio', self.size_ratio >= 1, 'at least 1')
        check_field(self, 'min_points', self.min_points >= 1, 'at least 1')
        check_field(self, 'free_above', 0 <= self.free_above <= 1, 'a share in [0, 1]')
        check_field(self, 'top', 0 <= self.top <= 1, 'a share in [0, 1]')
        check_field(self, 'least_likeness', 0 <= self.least_likeness <= 1, 'a share in [0, 1]')
        check_field(self, 'seen_height', 0 <= self.seen_height <= 1, 'a share in [0, 1]')
        check_field(self, 'lowest', 0 <= self.lowest <= 1, 'a share in [0, 1]')
        least = self.least_likeness
        usual = least <= self.usual_likeness <= 1
        check_field(self, 'usual_likeness', usual, f'a share from least_likeness, {least}, to 1')
        check_field(self, 'growth', self.growth >= 1, 'at least 1')
        check_field(self, 'max_iou', 0 <= self.max_iou < 1, 'a share in [0, 1)')
        sure = self.background
        check_field(self, 'background', sure is None or 0 < sure <= 1, 'a probability in (0, 1], or None')


@dataclass(frozen=True)
class DetectionRules:
    """How labels of points and boxes are made.

    Attributes:
        merge: How regions merge (the paper).
        objects: When a group is an object.
        self_training: How a round's new labels are limited; None: they are not.
        teacher: When a box that the network predicts becomes a pseudo box. None: groups of regions do, by ``objects``.
    """

    merge: MergeRules
    objects: ObjectRules = ObjectRules()
    self_training: SelfTrainingRules | None = None
    teacher: TeacherRules | None = None


def detection_rules(
    strategy: Strategy = 'default',
    merge: Mapping[str, Any] | None = None,
    objects: Mapping[str, Any] | None = None,
    self_training: Mapping[str, Any] | None = None,
    teacher: Mapping[str, Any] | None = None,
) -> DetectionRules:
    """The rules of a run from the fields that its config gives.

    Args:
        strategy: 'paper': ``merge`` and :data:`AS_PRINTED` boxes, the method as METHOD 6 and 7 have it; the rest is not
            read. 'default': all.
        merge: Fields of :class:`~rm3d_plugin.regions.MergeRules`.
        objects: Fields of :class:`ObjectRules`. Its ``gamma`` takes the place of that of
            ``merge``, which is then left out.
        self_training: Fields of :class:`SelfTrainingRules`, or None.
        teacher: Fields of :class:`TeacherRules`, or None.

    Raises:
        ValueError: A value is not allowed; the message names class and field.
    """
    merging = MergeRules(**(merge or {}))
    if is_paper(strategy):
        return DetectionRules(merging, AS_PRINTED)
    rules = ObjectRules(**(objects or {}))
    merging = with_gamma(merging, merge, rules.gamma, 'ObjectRules.gamma')
    limited = optional_rules(SelfTrainingRules, self_training)
    return DetectionRules(merging, rules, limited, optional_rules(TeacherRules, teacher))
