"""Every object and tool: sound meshes, the promised sizes, and prints that a tracker can hold."""

import cv2
import numpy as np
import pytest

from vita.errors import BadInput, UnknownName
from vita.poses import pose_matrix
from vita.scenario.schema import ObjectSpec
from vita.sim import people
from vita.sim.meshes import ear_clip, slab_visuals
from vita.sim.objects import OBJECT_KINDS, build_object
from vita.sim.obstacles import obstacle_capsules
from vita.sim.stereo_things import HALF_BASELINE, HEAD_DOWN_DEG, LENS_HEIGHT
from vita.sim.tools import TOOLS, build_environment, build_tool

PRINTED = ("card", "board", "cube", "frame", "rail", "bolt")
OWN_TOOLS = [kind for kind in TOOLS if kind != "hand"]


def assert_sound(visuals):
    for visual in visuals:
        count = len(visual.vertices)
        assert visual.normals.shape == visual.vertices.shape == (count, 3)
        assert np.allclose(np.linalg.norm(visual.normals, axis=1), 1)
        assert visual.faces.min() >= 0 and visual.faces.max() < count
        a, b, c = (visual.vertices[visual.faces[:, i]] for i in range(3))
        facing = np.cross(b - a, c - a)
        mean = visual.normals[visual.faces].mean(axis=1)
        assert (np.einsum("ij,ij->i", facing, mean) > 0).all(), "triangles and normals look the same way"
        assert (visual.uv is None) == (visual.texture is None)
        if visual.uv is not None:
            assert visual.uv.shape == (count, 2) and visual.uv.min() >= 0 and visual.uv.max() <= 1


def assert_closed(visuals):
    """The flux of a constant field through a closed surface is zero, and its volume is positive."""
    corners = np.concatenate([v.vertices[v.faces] for v in visuals])
    areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.allclose(areas.sum(axis=0), 0, atol=1e-9)
    assert np.einsum("ij,ij->i", areas, corners.mean(axis=1)).sum() > 0


@pytest.mark.parametrize("kind", OBJECT_KINDS)
def test_objects_are_sound_closed_and_in_their_body(kind):
    visuals = build_object(kind, "thing")
    assert visuals and {visual.body for visual in visuals} == {"thing"}
    assert_sound(visuals)
    assert_closed(visuals)


@pytest.mark.parametrize("kind", OWN_TOOLS)
def test_tools_are_sound_closed_and_in_the_tool_body(kind):
    visuals = build_tool(kind)
    assert {visual.body for visual in visuals} <= {"tool"}
    assert_sound(visuals)
    if visuals:
        assert_closed(visuals)


@pytest.mark.parametrize("table", [True, False])
def test_the_workshop_is_sound_and_its_ground_is_where_the_arm_stands(table):
    visuals = build_environment(table)
    assert_sound(visuals)
    tops = [v for v in visuals if np.allclose(v.normals[:, 2], 1) and np.allclose(v.vertices[:, 2], 0)]
    assert any((v.vertices.min(0)[:2] < 0).all() and (v.vertices.max(0)[:2] > 0).all() for v in tops)


@pytest.mark.parametrize(
    "kind, low, high",
    [
        ("card", (-0.03, -0.04, -0.002), (0.03, 0.04, 0)),
        ("board", (-0.15, -0.11, -0.004), (0.15, 0.11, 0)),
        ("cube", (-0.03, -0.03, -0.03), (0.03, 0.03, 0.03)),
        ("frame", (-0.08, -0.08, -0.012), (0.08, 0.08, 0)),
        ("post", (-0.035, -0.035, -0.25), (0.035, 0.035, 0.008)),
        ("rail", (-0.2, -0.015, -0.03), (0.2, 0.015, 0)),
        ("screen", (-0.125, -0.125, -0.004), (0.125, 0.125, 0)),
        ("ball", (-0.06, -0.06, -0.06), (0.06, 0.06, 0.06)),
    ],
)
def test_objects_have_the_sizes_that_tasks_rely_on(kind, low, high):
    points = np.concatenate([visual.vertices for visual in build_object(kind, "x")])
    assert np.allclose(points.min(axis=0), low, atol=1e-9) and np.allclose(
        points.max(axis=0), high, atol=1e-9
    )


@pytest.mark.parametrize("kind, side", [("target", 0.08), ("marker_tool", 0.05)])
def test_the_printed_square_has_the_promised_side(kind, side):
    """Measured on the sheet: the share of the picture that the black frame takes, times the sheet's size."""
    visuals = build_tool(kind) if kind in TOOLS else build_object(kind, "x")
    (sheet,) = [visual for visual in visuals if visual.texture is not None]
    assert sheet.texture is not None
    black = np.flatnonzero((sheet.texture[:, :, 0] < 128).any(axis=0))
    columns = sheet.texture.shape[1]
    metre = np.ptp(sheet.vertices, axis=0).max() / columns
    assert np.isclose((black[-1] + 1 - black[0]) * metre, side, atol=1e-9)
    assert black[0] == columns - 1 - black[-1], "in the sheet's middle"
    assert black[0] * metre >= side / 8 - 1e-9, "a quiet zone of one cell at least"


def test_the_tripod_stands_on_the_floor_and_is_out_of_its_own_cameras_sight():
    """Seen from either lens, what is ahead at all (a foot) is 65 degrees and more off the optical axis."""
    points = np.concatenate([visual.vertices for visual in build_object("tripod", "x")])
    for side in (-1, 1):
        sight = points - (side * HALF_BASELINE, 0, 0)
        off = np.degrees(np.arctan2(np.hypot(sight[:, 0], sight[:, 1]), sight[:, 2]))
        assert off.min() > 65
        assert np.linalg.norm(sight, axis=1).min() < 0.02, "a lens is there"
    down = np.array([0.0, np.cos(np.radians(HEAD_DOWN_DEG)), np.sin(np.radians(HEAD_DOWN_DEG))])
    assert np.isclose((points @ down).max(), LENS_HEIGHT, atol=0.003)


def test_a_person_stands_on_the_floor_and_is_175_cm_tall():
    points = np.concatenate([visual.vertices for visual in build_object("person", "x")])
    assert np.isclose(points[:, 2].min(), people.FLOOR, atol=0.002)
    assert np.isclose(np.ptp(points[:, 2]), 1.75, atol=0.01)
    assert points[:, 0].max() < people.HAND[0] + 0.05, "the hand is what reaches farthest"


@pytest.mark.parametrize("kind", sorted(people.SEGMENTS))
def test_every_vertex_of_an_obstacle_lies_within_its_capsules(kind):
    """Wherever it stands; and no capsule is a barrel around nothing: each is touched somewhere."""
    T = pose_matrix((0.4, -0.7, 0.1), (10, -20, 130))
    capsules = obstacle_capsules([ObjectSpec("it", kind), ObjectSpec("card", "card")], {"it": T})
    points = np.concatenate([visual.vertices for visual in build_object(kind, "it")])
    world = points @ T[:3, :3].T + T[:3, 3]
    outside = np.array([distance_to_axis(c, world) - c.radius for c in capsules])
    assert outside.min(axis=0).max() < 1e-9
    assert np.abs(outside).min(axis=1).max() < 0.03
    assert {c.body for c in capsules} == {"it"}


def distance_to_axis(capsule, points):
    way = capsule.end - capsule.start
    share = np.clip((points - capsule.start) @ way / max(way @ way, 1e-12), 0, 1)
    return np.linalg.norm(points - capsule.start - share[:, None] * way, axis=1)


def test_the_card_tool_ends_at_its_tip_and_its_plate_looks_along_x():
    printed = [visual for visual in build_tool("card_tool") if visual.texture is not None]
    assert len(printed) == 2
    for visual in printed:
        assert np.allclose(np.abs(visual.normals), [1, 0, 0])
        assert np.allclose(visual.vertices[:, 1:].min(axis=0), [-0.035, 0.05])
        assert np.allclose(visual.vertices[:, 1:].max(axis=0), [0.035, 0.12])


def weakest_patch(picture, patch=0.22):
    """The smallest of the best Shi-Tomasi values over a grid of patches of a print, seen 120 px large."""
    small = cv2.resize(
        picture,
        None,
        fx=120 / min(picture.shape[:2]),
        fy=120 / min(picture.shape[:2]),
        interpolation=cv2.INTER_AREA,
    )
    grey = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    strength = cv2.cornerMinEigenVal(grey, 7, ksize=3)
    step = int(patch * 120)
    blocks = [
        strength[r : r + step, c : c + step].max()
        for r in range(0, grey.shape[0] - step + 1, step)
        for c in range(0, grey.shape[1] - step + 1, step)
    ]
    return min(blocks)


@pytest.mark.parametrize("kind", [*PRINTED, "card_tool", "wrench"])
def test_prints_have_corners_everywhere(kind):
    visuals = build_tool(kind) if kind in TOOLS else build_object(kind, "x")
    pictures = [visual.texture for visual in visuals if visual.texture is not None]
    assert pictures
    for picture in pictures:
        # A tracker on the slim rail covers its whole height.
        assert weakest_patch(picture, 0.95 if kind == "rail" else 0.22) > 1e-3


def test_no_print_repeats_itself():
    """No other place on the card looks like a given patch of it."""
    (picture,) = [v.texture for v in build_object("card", "x") if v.texture is not None]
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    for row, column in [(40, 40), (150, 100), (280, 200), (60, 200)]:
        match = cv2.matchTemplate(grey, grey[row : row + 56, column : column + 56], cv2.TM_CCOEFF_NORMED)
        match[row - 12 : row + 13, column - 12 : column + 13] = 0
        assert match.max() < 0.8


def test_building_twice_gives_the_same_bits():
    for first, second in zip(build_object("cube", "x"), build_object("cube", "x"), strict=True):
        assert first.texture is not None and second.texture is not None
        assert np.array_equal(first.texture, second.texture)


def test_unknown_names_list_the_choices():
    with pytest.raises(UnknownName, match="card, board") as caught:
        build_object("crad", "x")
    assert caught.value.choices == OBJECT_KINDS
    with pytest.raises(UnknownName, match="card_tool"):
        build_tool("hammer")


def test_cutting_ears_keeps_the_area_of_a_hollow_outline():
    outline = np.array([[0, 0], [4, 0], [4, 3], [3, 3], [3, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
    corners = outline[ear_clip(outline)]
    (ab, ac) = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    assert (areas > 0).all() and np.isclose(areas.sum(), 8)


def test_an_outline_that_runs_clockwise_is_refused():
    with pytest.raises(BadInput):
        slab_visuals("x", np.array([[0, 0], [0, 1], [1, 1], [1, 0]], dtype=float), 0, 1, (1, 1, 1))


def test_a_pose_moves_vertices_and_normals_together():
    pose = pose_matrix((1, 2, 3), (90, 0, 0))
    outline = np.array([[0, 0], [1, 0], [0, 1]], dtype=float)
    assert_sound(slab_visuals("x", outline, 0, 1, (1, 1, 1), pose))
