"""Synthetic rooms: the camera against a slow twin, points on their furniture, nothing behind walls, the same bytes."""

import hashlib
from functools import cache

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.datasets.synthetic import room_fusion, room_kinds, room_layout, room_scanner, rooms
from rm3d_plugin.datasets.synthetic.room_scanner import DepthCamera, View, render, view_from
from rm3d_plugin.datasets.synthetic.room_things import CATEGORIES, S3DIS_CLASSES, SCANNET_CLASSES
from rm3d_plugin.datasets.synthetic.rooms import RoomScan, make_layout, make_room

SPACING = 0.08
ROOM_HASH = 'afb5d2001de87447fb3cfa590bc1ff2f6e574eab4aeba01837616405462886ff'
SMALL = DepthCamera(40, 30)


@cache
def room(index: int) -> RoomScan:
    return make_room(0, index, SPACING)


def first_hits(corners: np.ndarray, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slow twin: every ray against every triangle (Moeller and Trumbore); t is in lengths of the ray."""
    best, owner = np.full(len(rays), np.inf), np.full(len(rays), -1)
    for number, (a, b, c) in enumerate(corners):
        e1, e2 = b - a, c - a
        p = np.cross(rays, e2)
        det = p @ e1
        with np.errstate(divide='ignore', invalid='ignore'):
            u = (p @ (origin - a)) / det
            q = np.cross(origin - a, e1)
            v = (rays @ q) / det
            t = (q @ e2) / det
        hit = (np.abs(det) > 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < best)
        best[hit], owner[hit] = t[hit], number
    return owner, best


def distance_to_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """From each point to its triangle: foot inside, else the nearest edge."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    off = np.sum((points - a) * normal, axis=1)
    foot = points - off[:, None] * normal
    sides = [np.sum(np.cross(q - p, foot - p) * normal, axis=1) >= 0 for p, q in ((a, b), (b, c), (c, a))]
    edges = []
    for p, q in ((a, b), (b, c), (c, a)):
        t = np.clip(np.sum((points - p) * (q - p), axis=1) / np.sum((q - p) ** 2, axis=1), 0, 1)
        edges.append(np.linalg.norm(points - p - t[:, None] * (q - p), axis=1))
    return np.where(np.all(sides, axis=0), np.abs(off), np.min(edges, axis=0))


# ------------------------------------------------------------------ the camera


@pytest.mark.parametrize('spread', [0.3, 2.0, 9.0])
def test_images_equal_the_slow_twin(spread: float) -> None:
    rng = np.random.default_rng(4)
    corners = rng.uniform(-3, 3, (250, 1, 3)) + rng.uniform(-1, 1, (250, 3, 3)) * spread
    view = view_from((0.3, -0.2, 0.1), 0.7, -0.4)
    face, depth, rays = render(corners, view, SMALL)
    owner, distance = first_hits(corners, view.place, rays)
    assert (owner >= 0).sum() > 40
    np.testing.assert_array_equal(face, owner)
    np.testing.assert_allclose(depth, distance, rtol=1e-9)


def test_a_wall_two_metres_ahead() -> None:
    wall = np.array([[[2.0, -9, -9], [2, 9, -9], [2, 9, 9]], [[2.0, -9, -9], [2, 9, 9], [2, -9, 9]]])
    view = view_from((0.0, 0.0, 0.0), 0.0, 0.0)
    face, depth, rays = render(np.concatenate([wall, wall]), view, SMALL)
    np.testing.assert_allclose(depth, 2.0)
    assert set(face) <= {0, 1}  # ties go to the lowest
    np.testing.assert_allclose(rays[:, 0], 1.0)
    # Columns run to the right (-y), rows downwards.
    assert rays[0, 1] > 0 > rays[SMALL.columns - 1, 1] and rays[0, 2] > 0 > rays[-1, 2]
    assert (render(np.zeros((0, 3, 3)), view, SMALL)[0] == -1).all()
    assert (render(wall, view_from((0.0, 0.0, 0.0), np.pi, 0.0), SMALL)[0] == -1).all()


def test_axes_of_a_view() -> None:
    view = view_from((1.0, 2.0, 3.0), 0.8, 0.3)
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-11)
    np.testing.assert_allclose(np.cross(view.axes[0], view.axes[1]), view.axes[2], atol=1e-11)
    assert view.axes[2, 2] == pytest.approx(np.sin(0.3)) and view.axes[1, 2] < 0


def shots_of(xyz: list[list[float]], thing: list[int], shape: tuple[int, int, int]) -> room_scanner.Shots:
    count = len(xyz)
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    return room_scanner.Shots(
        np.array(xyz, dtype=float).reshape(-1, 3), np.full((count, 3), 0.5), up, np.array(thing, dtype=np.int64),
        np.arange(count), np.arange(count), shape,
    )  # fmt: skip


# ------------------------------------------------------------------ fusion


def test_a_voxel_takes_the_thing_of_most_pixels_and_the_mean_of_its_pixels() -> None:
    shots = shots_of([[0.01, 0, 0], [0.03, 0, 0], [0.09, 0, 0], [0.5, 0, 0]], [2, 2, 1, 1], (1, 2, 2))
    fused = room_fusion.fuse(shots, 0.1)
    np.testing.assert_allclose(fused.xyz, [[0.02, 0, 0], [0.5, 0, 0]])
    np.testing.assert_array_equal(fused.thing, [2, 1])
    np.testing.assert_array_equal(fused.point, [0, 0, 0, 1])
    tie = room_fusion.fuse(shots_of([[0.01, 0, 0], [0.03, 0, 0]], [7, 3], (1, 1, 2)), 0.1)
    np.testing.assert_array_equal(tie.thing, [3])
    np.testing.assert_allclose(tie.xyz, [[0.03, 0, 0]])


def test_one_point_and_none() -> None:
    fused = room_fusion.fuse(shots_of([[1.0, 2, 3]], [0], (1, 1, 1)), 0.1)
    np.testing.assert_allclose(fused.xyz, [[1, 2, 3]])
    faces = room_fusion.mesh_faces(fused, shots_of([[1.0, 2, 3]], [0], (1, 1, 1)), 1.0)
    assert faces.shape == (0, 3)
    np.testing.assert_array_equal(room_fusion.mesh_segments(faces, fused.normals, fused.colors, fused.thing), [0])
    with pytest.raises(ValueError, match='expected at least one pixel'):
        room_fusion.fuse(shots_of([], [], (1, 1, 1)), 0.1)


def test_the_mesh_of_four_pixels() -> None:
    corners = [[0.0, 0, 0], [1.0, 0, 0], [0.0, 1, 0], [1.0, 1, 0]]
    shots = shots_of(corners * 2, [0] * 8, (2, 2, 2))  # seen twice: no triangle twice
    fused = room_fusion.fuse(shots, 0.5)
    faces = room_fusion.mesh_faces(fused, shots, 2.0)
    assert {tuple(sorted(fused.point[[0, 2, 1]])), tuple(sorted(fused.point[[1, 2, 3]]))} == {
        tuple(sorted(face)) for face in faces.tolist()
    }
    assert len(room_fusion.mesh_faces(fused, shots, 1.2)) == 0  # the diagonal is too long


def test_segments_split_at_an_edge_and_at_a_thing() -> None:
    count = 30
    xyz = np.arange(4 * count)
    faces = np.stack([xyz[:-2], xyz[1:-1], xyz[2:]], axis=1).astype(np.int32)
    normals = np.repeat([[0.0, 0, 1], [1.0, 0, 0]], 2 * count, axis=0)
    thing = np.repeat([0, 0, 0, 1], count)
    segment = room_fusion.mesh_segments(faces, normals, np.full((4 * count, 3), 0.5), thing)
    np.testing.assert_array_equal(segment, np.repeat([0, 1, 2], [2 * count, count, count]))


# ------------------------------------------------------------------ rooms


def test_the_same_bytes_every_time_and_other_rooms_for_other_numbers() -> None:
    def digest(scan: RoomScan) -> str:
        arrays = (scan.xyz, scan.colors, scan.normals, scan.instance, scan.segment, scan.faces, scan.axis_alignment)
        return hashlib.sha256(b''.join(a.tobytes() for a in arrays)).hexdigest()

    first = digest(make_room(0, 1, SPACING))
    assert first == digest(make_room(0, 1, SPACING))
    assert first == ROOM_HASH  # raise room_demo.ROOMS_VERSION whenever this changes
    assert first != digest(make_room(1, 1, SPACING)) and first != digest(make_room(0, 9, SPACING))


@pytest.mark.parametrize('index', range(8))
def test_what_a_scan_promises(index: int) -> None:
    scan = room(index)
    count = len(scan)
    assert scan.kind == rooms.room_kind(index) and count > 2000
    assert scan.xyz.dtype == np.float32 and scan.colors.dtype == np.uint8 and scan.faces.dtype == np.int32
    np.testing.assert_allclose(np.linalg.norm(scan.normals, axis=1), 1, atol=1e-5)
    assert set(scan.instance) == set(range(len(scan.things))) and set(scan.things) <= set(CATEGORIES)
    assert scan.faces.min() >= 0 and scan.faces.max() < count
    assert all((scan.faces[:, i] != scan.faces[:, (i + 1) % 3]).all() for i in range(3))
    assert len(np.unique(np.sort(scan.faces, axis=1), axis=0)) == len(scan.faces)
    assert np.bincount(scan.faces.ravel()).max() <= room_fusion.MOST_FACES
    # Segments: numbered by first point, none crosses a thing, connected in the mesh.
    assert len(np.unique(np.stack([scan.segment, scan.instance]), axis=1).T) == scan.segment.max() + 1
    np.testing.assert_array_equal(
        np.unique(scan.segment, return_index=True)[1].argsort(), np.arange(scan.segment.max() + 1)
    )
    a, b = scan.faces[:, [0, 1, 2]].ravel(), scan.faces[:, [1, 2, 0]].ravel()
    inner = scan.segment[a] == scan.segment[b]
    graph = coo_matrix((np.ones(inner.sum()), (a[inner], b[inner])), shape=(count, count))
    assert connected_components(graph, directed=False)[0] == scan.segment.max() + 1
    # The raw frame is turned and shifted against the walls, and the matrix takes it back.
    turn = scan.axis_alignment[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=2e-6)
    # Labels are given to segments of the mesh, so that a few reach up what stands on the floor.
    assert np.quantile(np.abs(scan.aligned[scan.names == 'floor', 2]), 0.95) < 0.08
    assert np.abs(scan.xyz - scan.aligned).max() > 0.1


@pytest.mark.parametrize('index', [0, 1, 4])
def test_points_lie_on_their_own_furniture(index: int) -> None:
    layout = make_layout(0, index)
    surfaces = room_scanner.surfaces_of(layout)
    views = room_scanner.plan_views(layout, 'handheld', np.random.default_rng(0))
    camera = DepthCamera(40, 30)
    shots = room_scanner.shoot(layout, surfaces, views, camera, np.random.default_rng(1))
    gap = distance_to_triangles(shots.xyz, surfaces.corners[shots.face])
    assert np.median(gap) < 0.012 and np.quantile(gap, 0.99) < 0.1  # warped depths, drifting poses
    np.testing.assert_array_equal(surfaces.thing[shots.face], shots.thing)
    # Without noise and drift they lie on the surface, and nothing is nearer to the camera: nothing is seen through.
    still = DepthCamera(24, 18, noise=0.0, warp=0.0, drift=0.0, lost=0.0)
    shots = room_scanner.shoot(layout, surfaces, views[:3], still, np.random.default_rng(1))
    assert distance_to_triangles(shots.xyz, surfaces.corners[shots.face]).max() < 1e-9
    size = still.rows * still.columns
    for number, view in enumerate(views[:3]):
        mine = shots.pixel // size == number
        owner, t = first_hits(surfaces.corners, view.place, shots.xyz[mine] - view.place)
        np.testing.assert_allclose(t, 1.0, atol=1e-9)
        assert (surfaces.thing[owner] == shots.thing[mine]).mean() > 0.999


@pytest.mark.parametrize('index', range(8))
def test_nothing_is_seen_behind_walls(index: int) -> None:
    layout = make_layout(0, index)
    length, width, height = layout.size
    xyz, margin = room(index).aligned, 0.17 + 0.2  # recesses of doors and windows, noise
    assert (xyz > -margin).all() and (xyz < [length + margin, width + margin, height + margin]).all()
    # A camera without noise sees only doors, windows and reveals beyond the walls, in their openings.
    still = DepthCamera(64, 48, noise=0.0, warp=0.0, drift=0.0, lost=0.0)
    views = room_scanner.plan_views(layout, 'handheld', np.random.default_rng(0))
    shots = room_scanner.shoot(layout, room_scanner.surfaces_of(layout), views, still, np.random.default_rng(1))
    xyz, names = shots.xyz, np.array([item.name for item in layout.things])[shots.thing]
    beyond = (-xyz[:, 1], xyz[:, 0] - length, xyz[:, 1] - width, -xyz[:, 0])
    along = (xyz[:, 0], xyz[:, 1], length - xyz[:, 0], width - xyz[:, 1])
    for wall in range(4):
        for number in np.flatnonzero(beyond[wall] > 1e-5):
            assert names[number] in {'door', 'window', 'wall'}
            place, z = along[wall][number], xyz[number, 2]
            spans = layout.openings[wall]
            assert any(s.start - 0.01 < place < s.end + 0.01 and s.low - 0.02 < z < s.high + 0.02 for s in spans)


def test_scans_have_holes_and_uneven_density() -> None:
    layout = make_layout(0, 4)
    scan = room(4)
    floor = scan.aligned[scan.names == 'floor', :2]
    cells = len(np.unique(np.floor(floor / 0.2), axis=0))
    share = cells * 0.04 / (layout.size[0] * layout.size[1])
    assert 0.3 < share < 0.97


def test_every_class_occurs() -> None:
    seen = set(np.concatenate([np.unique(room(i).nyu40) for i in range(16)]))
    ids = {item.nyu40 for item in CATEGORIES.values()}
    wanted = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 16, 24, 28, 33, 34, 36, 39}
    assert wanted <= ids and len(SCANNET_CLASSES) == 20
    assert wanted <= seen
    assert {item.s3dis for item in CATEGORIES.values()} == set(S3DIS_CLASSES)


def test_a_tripod_sees_the_ceiling_and_beams() -> None:
    names = make_room(0, 3, SPACING, 'office', 'tripod', structure=1.0).s3dis
    assert {'ceiling', 'floor', 'wall', 'beam', 'door'} <= set(names)
    assert (names == 'ceiling').mean() > 0.05


def test_spacing_changes_the_density_and_not_the_room() -> None:
    coarse, fine = make_room(0, 1, 0.12), make_room(0, 1, 0.06)
    assert 2.2 < len(fine) / len(coarse) < 6
    ends = [np.quantile(scan.aligned, [0.02, 0.98], axis=0) for scan in (coarse, fine)]
    np.testing.assert_allclose(*ends, atol=0.25)
    assert set(coarse.things) & set(fine.things) >= {'floor', 'wall', 'bathtub', 'toilet', 'door'}


def test_bad_arguments_are_named() -> None:
    with pytest.raises(ValueError, match='spacing: expected 0.002 to 0.2 m, got 0'):
        make_room(0, 0, 0.0)
    with pytest.raises(ValueError, match='scanner: expected one of handheld, tripod'):
        make_room(0, 0, scanner='drone')  # type: ignore[arg-type]
    with pytest.raises(ValueError, match='kind: expected one of office'):
        make_room(0, 0, kind='attic')


# ------------------------------------------------------------------ layout


def test_turned_rectangles_overlap() -> None:
    rect = room_layout.Rect(0.0, 0.0, 1.0, 0.5, 0.0)
    assert room_layout.overlap(rect, room_layout.Rect(1.5, 0.0, 0.6, 0.5, 0.0))
    assert not room_layout.overlap(rect, room_layout.Rect(1.5, 0.0, 0.5, 0.5, 0.0))
    assert not room_layout.overlap(rect, room_layout.Rect(1.35, 0.9, 0.5, 0.5, np.pi / 4))  # boxes around them meet
    assert room_layout.overlap(rect, room_layout.Rect(1.2, 0.6, 0.5, 0.5, np.pi / 4))


def test_wall_poses_head_into_the_room() -> None:
    layout = make_layout(0, 0)
    for wall in range(4):
        pose = layout.wall_pose(wall, 0.5, 0.2)
        x, y = pose.x + 0.1 * np.cos(pose.yaw), pose.y + 0.1 * np.sin(pose.yaw)
        inside = min(x, y, layout.size[0] - x, layout.size[1] - y)
        assert inside == pytest.approx(0.3, abs=1e-9)


@pytest.mark.parametrize('kind', room_kinds.ROOM_KINDS)
def test_furniture_stays_inside_and_apart(kind: str) -> None:
    for seed in range(3):
        layout = room_kinds.random_layout(np.random.default_rng(seed), kind, 0.5)
        length, width, height = layout.size
        for item in layout.things:
            low, high = item.bounds
            assert (low > [-0.3, -0.3, -0.01]).all() and (high < [length + 0.3, width + 0.3, height + 0.01]).all(), (
                item.name
            )
        assert all(np.isfinite(body.corners).all() for item in layout.things for body, _ in item.parts)


def test_a_camera_has_pixels_for_its_spacing() -> None:
    camera = DepthCamera.for_spacing(0.05, 'handheld')
    assert camera.pitch * room_scanner.TYPICAL == pytest.approx(0.05, rel=0.02)
    assert DepthCamera.for_spacing(0.05, 'tripod').far > camera.far
    assert isinstance(view_from((0, 0, 0), 0, 0), View)
