"""What fills a room beside its main furniture: more along the walls, and things that nobody labels."""

from rm3d_plugin.datasets.synthetic import room_clutter as clutter
from rm3d_plugin.datasets.synthetic import room_seats as seats
from rm3d_plugin.datasets.synthetic import room_storage as storage
from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_layout import HALF_TURN, Layout, Pose
from rm3d_plugin.datasets.synthetic.room_things import Thing, Top
from rm3d_plugin.datasets.synthetic.shapes import cos_sin

LINED = (0.7, 1.1)  # more things along the walls, a metre of length and width
CLUTTER = (0.6, 1.3)  # groups of unlabelled things a square metre of floor


def ahead(pose: Pose, forward: float, left: float = 0.0, turn: float = 0.0) -> Pose:
    """A place some metres before and to the left of a pose, turned by some radians."""
    c, s = (float(v) for v in cos_sin(pose.yaw))
    return Pose(pose.x + c * forward - s * left, pose.y + s * forward + c * left, pose.yaw + turn)


def wall_thing(layout: Layout, item: Thing, amount: float = 1.0) -> Pose | None:
    """Put a thing against a wall, with small things on it."""
    pose = layout.against_wall([item], tries=30)
    if pose is not None:
        lay_clutter(layout, pose, item.tops, amount)
    return pose


def lay_clutter(layout: Layout, pose: Pose, tops: tuple[Top, ...], amount: float) -> None:
    """Scatter small things over surfaces of a thing that stands at a pose; amount = how many, on average."""
    rng = layout.rng
    c, s = (float(v) for v in cos_sin(pose.yaw))
    for top in tops:
        placed: list[tuple[float, float]] = []
        for _ in range(int(rng.random() * 4 * amount + 0.5)):
            x, y = pick(rng, *top.x), pick(rng, *top.y)
            if all((x - a) ** 2 + (y - b) ** 2 > 0.02 for a, b in placed):
                placed.append((x, y))
                spot = Pose(pose.x + c * x - s * y, pose.y + s * x + c * y, pick(rng, -HALF_TURN, HALF_TURN))
                layout.put([clutter.table_clutter(rng, layout.palette)], spot, top.z)


def line_walls(layout: Layout) -> None:
    """More furniture along the walls, much of it side by side: walls of real rooms are seldom free."""
    rng, palette = layout.rng, layout.palette
    makers = (storage.cabinet, storage.bookshelf, storage.cabinet, seats.chair, seats.armchair, storage.dresser)
    for _ in range(int((layout.size[0] + layout.size[1]) * pick(rng, *LINED))):
        wall_thing(layout, makers[int(rng.random() * len(makers))](rng, palette))


def add_clutter(layout: Layout) -> None:
    """Boxes, bags, plants, heaps of clothes: alone, in groups that touch, and along walls."""
    rng, palette = layout.rng, layout.palette
    area = layout.size[0] * layout.size[1]
    for _ in range(int(area * pick(rng, *CLUTTER))):
        item = clutter.floor_clutter(rng, palette)
        if rng.random() < 0.45:
            pose = layout.against_wall([item], gap=0.0, tries=5)
        else:
            pose = layout.somewhere([item], tries=5)
        while pose is not None and rng.random() < 0.45:
            reach = float(item.bounds[1][1])
            item = clutter.floor_clutter(rng, palette)
            pose = ahead(pose, pick(rng, -0.05, 0.05), reach - float(item.bounds[0][1]), pick(rng, -0.4, 0.4))
            if not layout.stand([item], pose, gap=-0.02):
                break
