"""Charts and textures of meshes: against a cube with a known colour on each side, and the files as others read them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.camera import Camera
from dgs.core.errors import DgsError, FormatError, OutputError
from dgs.core.formats.gltf_file import open_gltf
from dgs.core.formats.meshes import files_of, write_mesh
from dgs.core.mesh import unwrapping
from dgs.core.mesh.build import MeshSettings, build_mesh
from dgs.core.mesh.surfaces import SeenSurface, weights
from dgs.core.mesh.texturing import TexturingSettings, continued, painted, texel_owners
from dgs.core.mesh.unwrapping import UnwrappingSettings, unwrapped
from dgs.core.progress import Silent
from dgs.core.triangles import Mesh, Texture
from dgs.tests.card_twin import write_card_twin
from dgs.tests.core.mesh.test_mesh import flat_ball, looking_at_the_middle
from PIL import Image

SIZE = 128
#: sRGB of the cube's sides: -x, +x, -y, +y, -z, +z.
SIDES = np.array([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1], [0.1, 0.1, 0.9], [0.9, 0.9, 0.1], [0.1, 0.9, 0.9], [0.9, 0.1, 0.9]])


def cube(cuts: int = 4) -> Mesh:
    """Round the origin, side 1, each side of cuts x cuts squares, corners shared, the right way out."""
    step, places, faces = np.arange(cuts + 1) / cuts - 0.5, [], []
    for axis in range(3):
        for end in (-0.5, 0.5):
            first = len(places)
            for a in step:
                for b in step:
                    place = np.empty(3)
                    place[[axis, (axis + 1) % 3, (axis + 2) % 3]] = end, a, b
                    places.append(place)
            for i in range(cuts):
                for j in range(cuts):
                    p = first + i * (cuts + 1) + j
                    both = [[p, p + cuts + 1, p + cuts + 2], [p, p + cuts + 2, p + 1]]
                    faces += both if end > 0 else [face[::-1] for face in both]
    vertices, index = np.unique(np.round(places, 9), axis=0, return_inverse=True)
    return Mesh(vertices, index.reshape(-1)[np.array(faces)])


def side_of(places: np.ndarray) -> np.ndarray:
    """The side of the cube that places on its surface are nearest to."""
    axis = np.abs(places).argmax(axis=-1)
    along = np.take_along_axis(places, axis[..., None], axis=-1)[..., 0]
    return 2 * axis + (along > 0)


def seen_cube(camera: Camera, wrong: float = 0.0) -> SeenSurface:
    """The cube in closed form, in its colours; `wrong` is added to all of them."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    centre, rays = -camera.rotation.T @ camera.translation, rays @ camera.rotation
    ends = np.stack([(end - centre) / rays for end in (-0.5, 0.5)])
    entry, leaving = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    depth = np.where(entry < leaving, entry, np.nan).astype(np.float32)
    image = SIDES[side_of(centre + np.nan_to_num(depth)[..., None] * rays)] + wrong
    return SeenSurface(camera, depth, weights(depth, camera), image.transpose(2, 0, 1).astype(np.float32))


def cameras() -> list[Camera]:
    return [looking_at_the_middle(angle, tilt) for tilt in (-0.7, 0.7) for angle in 0.4 + np.arange(8) * np.pi / 4]


def middles(mesh: Mesh, texture: Texture, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[T, 3] where the texels of charts are on the mesh, and [T, 3] their colours of 1."""
    rows, columns = np.nonzero(owner >= 0)
    face = owner[rows, columns]
    a, b, c = (texture.places[texture.faces[face, k]] for k in range(3))
    place = np.stack([columns + 0.5, len(owner) - rows - 0.5], axis=1) / len(owner)
    # (a chart may hold a face without an area)
    shares = (np.linalg.pinv(np.stack([b - a, c - a], axis=2)) @ (place - a)[..., None])[..., 0].clip(0, 1)
    p, q, r = (mesh.vertices[mesh.faces[face, k]] for k in range(3))
    world = p + shares[:, :1] * (q - p) + shares[:, 1:] * (r - p)
    return world, texture.image[rows, columns] / 255.0


def test_charts_lie_in_the_square_and_apart() -> None:
    mesh = cube()
    for part in (5000, 40):  # whole, and in parts that are joined again
        charts = unwrapped(mesh, SIZE, UnwrappingSettings(part=part))
        assert charts.places.min() >= 0.0 and charts.places.max() <= 1.0 and charts.count >= 3
        assert (charts.vertices[charts.faces] == mesh.faces).all(), "each face keeps its corners, in their order"
        assert 0.3 < charts.areas().sum() < 1.0
        # texels are drawn face by face: those whose middles lie well inside two faces are nobody's right
        inside = np.zeros((4 * SIZE, 4 * SIZE), int)
        y, x = np.mgrid[: 4 * SIZE, : 4 * SIZE] + 0.5
        for corners in charts.places[charts.faces] * 4 * SIZE:
            edges = np.roll(corners, -1, axis=0) - corners
            turns = [e[0] * (y - p[1]) - e[1] * (x - p[0]) for e, p in zip(edges, corners, strict=True)]
            far = [turn / np.linalg.norm(e) for turn, e in zip(turns, edges, strict=True)]
            inside += (np.min(far, axis=0) > 0.1) | (np.max(far, axis=0) < -0.1)
        assert inside.max() == 1


def test_texels_have_the_colours_of_their_sides() -> None:
    mesh = cube()
    charts = unwrapped(mesh, SIZE)
    found = painted(mesh, charts, SIZE, [seen_cube(camera) for camera in cameras()], 0.02)
    owner = texel_owners(charts, SIZE)
    assert (np.bincount(owner[owner >= 0], minlength=len(mesh.faces)) > 0).all(), "every face has texels"
    world, colours = middles(mesh, found.texture, owner)
    inner = np.sort(np.abs(world), axis=1)[:, 1] < 0.46  # two px from an edge views mix both sides
    error = np.abs(colours - SIDES[side_of(world)]).max(axis=1)
    assert inner.sum() > 3000 and np.quantile(error[inner], 0.999) < 0.01 and found.unseen == 0.0
    assert (error > 0.3).mean() < 0.04, "half a texel along the edges at most"


def test_thin_things_are_not_seen_from_behind() -> None:
    """Voxels as large as the cube: the depth test lets its far sides pass."""
    mesh = cube()
    charts = unwrapped(mesh, SIZE)
    found = painted(mesh, charts, SIZE, [seen_cube(camera) for camera in cameras()], 1.0)
    world, colours = middles(mesh, found.texture, texel_owners(charts, SIZE))
    inner = np.sort(np.abs(world), axis=1)[:, 1] < 0.4
    assert np.abs(colours - SIDES[side_of(world)])[inner].max() < 0.02


def test_between_charts_colours_go_on() -> None:
    mesh = cube()
    charts = unwrapped(mesh, SIZE)
    found = painted(mesh, charts, SIZE, [seen_cube(camera) for camera in cameras()], 0.02)
    assert np.ptp(found.texture.image, axis=2).min() > 0, "nothing is left grey"
    image, known = np.zeros((3, 5, 3), np.uint8), np.zeros((3, 5), bool)
    image[1, 0], image[1, 4], known[1, [0, 4]] = 10, 20, True
    assert continued(image, known)[0, :, 0].tolist()[:2] == [10, 10] and continued(image, known)[2, 4, 0] == 20
    assert (continued(image, known & False) == image).all()


def test_views_that_disagree_hardly_count() -> None:
    mesh, views = cube(), cameras()
    charts = unwrapped(mesh, SIZE)
    surfaces = [seen_cube(camera, 0.5 if index == 3 else 0.0) for index, camera in enumerate(views)]
    errors = {}
    for rounds in (0, 3):
        found = painted(mesh, charts, SIZE, surfaces, 0.02, TexturingSettings(rounds=rounds))
        world, colours = middles(mesh, found.texture, texel_owners(charts, SIZE))
        inner = np.sort(np.abs(world), axis=1)[:, 1] < 0.4
        errors[rounds] = np.abs(colours - SIDES[side_of(world)])[inner].mean()
    assert errors[3] < 0.25 * errors[0] and errors[0] > 0.01


def test_what_nobody_sees_is_grey_and_counted() -> None:
    mesh = cube()
    charts = unwrapped(mesh, SIZE)
    found = painted(mesh, charts, SIZE, [seen_cube(looking_at_the_middle(0.0, 0.0))], 0.002)
    world, colours = middles(mesh, found.texture, texel_owners(charts, SIZE))
    front, back = np.abs(world[:, 2] + 0.5) < 1e-6, np.abs(world[:, 2] - 0.5) < 1e-6
    inner = np.sort(np.abs(world), axis=1)[:, 1] < 0.4
    assert np.allclose(colours[front & inner], SIDES[4], atol=0.01)
    assert np.allclose(colours[back & inner], 0.5, atol=0.01) and 0.5 < found.unseen < 0.9


def test_nothing_to_unwrap_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    for mesh, size in ((empty, SIZE), (flat, SIZE), (cube(), 0)):
        with pytest.raises(DgsError, match="needs faces and texels"):
            unwrapped(mesh, size)
    monkeypatch.setattr(unwrapping, "xatlas", None)
    with pytest.raises(OutputError, match="xatlas.*Install the engine again"):
        build_mesh(flat_ball(50), cameras(), MeshSettings(texture=64), Silent())


def test_a_face_without_area_and_a_texture_far_too_small_are_no_harm() -> None:
    mesh = cube()
    bad = Mesh(mesh.vertices, np.concatenate([mesh.faces, [[0, 0, 1], [5, 5, 5]]]))
    for size in (1, 16, 64):
        found = painted(bad, unwrapped(bad, size), size, [seen_cube(camera) for camera in cameras()], 0.02)
        assert found.texture.image.shape == (size, size, 3) and len(found.texture.faces) == len(bad.faces)


def test_a_twins_texture_is_in_its_colours() -> None:
    views = [looking_at_the_middle(angle) for angle in np.arange(8) * np.pi / 4]
    made = build_mesh(flat_ball(), views, MeshSettings(faces=1000, texture=256), Silent())
    texture = made.mesh.texture
    assert texture is not None and len(texture.faces) == len(made.mesh.faces) <= 1000 and made.unseen < 0.01
    charts = unwrapping.Charts(texture.places, texture.vertices, texture.faces, 0)
    world, colours = middles(made.mesh, texture, texel_owners(charts, 256))
    expected = 0.5 + 0.4 * world / np.linalg.norm(world, axis=1, keepdims=True)
    assert np.median(np.abs(colours - expected)) < 0.02
    area = 4 * np.pi * 0.25  # a ball's, less two ends that no camera sees
    assert 0.6 * area < made.texel**2 * charts.areas().sum() * 256**2 < area


def test_a_textured_mesh_has_few_faces_unless_asked() -> None:
    assert MeshSettings().most_faces == 500_000 and MeshSettings(texture=64).most_faces == 50_000
    assert MeshSettings(faces=7, texture=64).most_faces == 7 and MeshSettings(faces=0, texture=64).most_faces == 0


def one_square() -> Mesh:
    """Two faces whose texture has four colours and a seam along the diagonal."""
    vertices = np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 2]])
    image = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [10, 20, 30]]], np.uint8)
    places = np.array([[0.1, 0.2], [0.3, 0.2], [0.1, 0.4], [0.9, 0.8], [0.7, 0.8], [0.9, 0.6]])
    texture = Texture(image, places, np.array([0, 2, 1, 1, 2, 3]), np.array([[0, 1, 2], [3, 4, 5]]))
    colours, deviation = np.full((4, 3), 9, np.uint8), np.arange(4, dtype=np.float32)
    return Mesh(vertices, np.array([[0, 2, 1], [1, 2, 3]]), colours, deviation, texture)


def test_a_glb_holds_the_texture(tmp_path: Path) -> None:
    mesh, file = one_square(), tmp_path / "m.glb"
    write_mesh(file, mesh)
    asset = open_gltf(file)
    ((content, _),) = asset.placed_meshes()
    (part,) = content["primitives"]
    assert sorted(part["attributes"]) == ["NORMAL", "POSITION", "TEXCOORD_0", "_DEVIATION"], "colours would multiply"
    assert mesh.texture is not None
    assert np.allclose(asset.array(part["attributes"]["TEXCOORD_0"]), mesh.texture.places * [1, -1] + [0, 1])
    corners = asset.array(part["attributes"]["POSITION"])[asset.array(part["indices"]).ravel().astype(int)]
    assert np.allclose(corners, mesh.vertices[mesh.faces].reshape(-1, 3) * [1, -1, -1])
    data = file.read_bytes()
    picture = Image.open(io.BytesIO(data[data.index(b"\x89PNG") :]))
    assert (np.asarray(picture.convert("RGB")) == mesh.texture.image).all() and picture.info["srgb"] == 0


def test_an_obj_names_its_material_and_its_picture(tmp_path: Path) -> None:
    mesh, file = one_square(), tmp_path / "m.obj"
    write_mesh(file, mesh)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.mtl", "m.obj", "m.png"]
    assert sorted(files_of(file, True)) == sorted(tmp_path.iterdir()) and files_of(file, False) == [file]
    lines = file.read_text().splitlines()
    assert "mtllib m.mtl" in lines and "vt 0.900000 0.600000" in lines and "f 2/4/2 3/5/3 4/6/4" in lines
    assert "map_Kd m.png" in (tmp_path / "m.mtl").read_text()
    with pytest.raises(FormatError, match="no texture.*leave the texture out"):
        write_mesh(tmp_path / "m.ply", mesh)


def test_the_command_writes_textures_and_refuses_what_cannot_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    twin = write_card_twin(tmp_path)
    words = ["mesh", str(twin), "--progress", "none", "--faces", "500"]
    for size in ("0", "-1", "15", "16385", "x"):
        assert run([*words, "--out", str(tmp_path / "a.glb"), "--texture", size]) == 2
        assert "from 16 to 16384" in capsys.readouterr().err
    assert run([*words, "--out", str(tmp_path / "a.ply"), "--texture", "64"]) == 2
    assert "End its name with .glb or .obj" in capsys.readouterr().err
    out = tmp_path / "out" / "a.obj"
    for _ in range(2):  # what it wrote itself it may replace
        assert run([*words, "--out", str(out), "--texture", "64"]) == 0
    assert Image.open(out.with_suffix(".png")).size == (64, 64)
    out.with_suffix(".png").write_bytes(b"mine")
    assert run([*words, "--out", str(out), "--texture", "64"]) == 2
    assert "was not written by this program" in capsys.readouterr().err and out.is_file()
    assert out.with_suffix(".png").read_bytes() == b"mine"
