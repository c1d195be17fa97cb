"""Textures, materials and colours of files are drawn as the programs that wrote them mean them."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from sshade import InputError
from sshade.edit.commands import Commands
from sshade.edit.document import Document
from sshade.files.meshes import write_mesh
from sshade.files.vertex_colours import colours_of
from tests.browser import changed, opened, pixels, portion
from tests.shapes import bumpy, icosphere, strip
from tests.sshade.edit.lent import lent, unpacked
from tests.sshade.edit.sessions import edited
from tests.write import columns, mesh_ply, obj, rows

pytestmark = pytest.mark.usefixtures("here")

BODY = bumpy(3)
#: Texture of four quarters: red and green above, blue and yellow below.
QUARTERS = np.array([[[220, 20, 20], [20, 200, 20]], [[20, 20, 220], [220, 220, 20]]], dtype=np.uint8)


def picture() -> Image.Image:
    return Image.fromarray(QUARTERS.repeat(16, axis=0).repeat(16, axis=1))


def textured(name: str, V: np.ndarray, F: np.ndarray, uv: np.ndarray) -> None:
    """Write a mesh whose texture coordinates grow upwards."""
    visual = trimesh.visual.TextureVisuals(uv, image=picture())
    made = trimesh.Trimesh(V, F, visual=visual, process=False)
    files = {}
    if name.endswith(".obj"):
        text, files = trimesh.exchange.obj.export_obj(made, return_texture=True, mtl_name="skin.mtl")
        Path(name).write_text(text)
    elif name.endswith(".gltf"):
        files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(made))
        files[name] = files.pop("model.gltf")
    else:
        made.export(name)
    for other, content in files.items():
        Path(other).write_bytes(content)


def colour_at(commands: Commands, skin: dict, corner: int) -> np.ndarray:
    """Colour of the texture at a corner of the drawn triangles."""
    (one,) = (i for i, material in enumerate(skin["materials"]) if material["image"])
    image = np.asarray(Image.open(io.BytesIO(commands.image({"material": str(one)}))).convert("RGB"))
    u, v = skin["uv"].reshape(-1, 2)[skin["faces"][corner]]
    h, w = image.shape[:2]
    return image[min(int(v % 1 * h), h - 1), min(int(u % 1 * w), w - 1)].astype(int)


@pytest.mark.parametrize("name", ["sheet.obj", "sheet.gltf"])
def test_every_corner_has_the_colour_that_the_texture_has_there(name):
    sheet = strip(20, 8)
    V, seam = sheet.V, 9.0
    # The faces beyond the seam at x = 9 use copies of the seam's vertices. The texture coordinates of the
    # copies lie in another quarter of the image.
    beyond = V[sheet.F].mean(axis=1)[:, 0] > seam
    copies = np.flatnonzero(V[:, 0] == seam)
    at = np.arange(sheet.n)
    at[copies] = sheet.n + np.arange(len(copies))
    F = np.where(beyond[:, None], at[sheet.F], sheet.F)
    V = np.concatenate([V, V[copies]])
    u = np.where(np.arange(len(V)) >= sheet.n, 0.75, np.where(V[:, 0] <= seam, 0.25, 0.75))
    uv = np.stack([u, np.where(V[:, 1] > 4, 0.8, 0.2)], axis=1)
    textured(name, V, F, uv)
    session = edited(name)
    assert session.mesh.n == sheet.n  # the seam is joined
    commands = Commands(session)
    skin = unpacked(commands.skin())
    assert [count for _, count, _ in skin["runs"]] == [sheet.m]
    where, faces = session.mesh.V[skin["vertex"]], skin["faces"]
    middle = where[faces.reshape(-1, 3)].mean(axis=1).repeat(3, axis=0)
    assert len(skin["vertex"]) == sheet.n + len(copies)
    for corner in range(0, len(faces), 7):
        right, above = middle[corner][0] > seam, where[faces[corner]][1] > 4
        expected = QUARTERS[0 if above else 1][1 if right else 0].astype(int)
        assert np.abs(colour_at(commands, skin, corner) - expected).max() < 30


def test_materials_of_an_obj_are_found_with_options_and_without_a_file():
    Path("a.mtl").write_text(
        "Kd 1 0 0\nnewmtl red\nKd 1 0 0\nnewmtl pic\nKd 0 0 0\nmap_Kd -s 2 2 1 -clamp on no such.png\n"
        "newmtl bad\nKd spectral a.rfl\n"
    )
    rows = [f"v {x} {y} 0" for x in range(3) for y in range(2)] + ["vt 0 0", "vt 0.5 1", "vt 1 0"]
    faces = ["f 1/-3 3/-2 2/-1", "usemtl red", "f 3 4 2", "usemtl pic", "f 3/1 5/2 4/9", "usemtl bad"]
    faces.append("f 5 6 4")
    Path("a.obj").write_text("\n".join(["mtllib none.mtl", "mtllib a.mtl", *rows, *faces]) + "\n")
    session = edited("a.obj")
    commands = Commands(session)
    skin = unpacked(commands.skin())
    colours = [material["colour"] for material in skin["materials"]]
    assert colours == [[0.8] * 3, [1, 0, 0], [1] * 3, [0.8] * 3]
    assert [material["image"] for material in skin["materials"]] == [False, False, True, False]
    uv = skin["uv"].reshape(-1, 2)[skin["faces"]]
    assert uv[:3].tolist() == [[0, 1], [0.5, 0], [1, 1]] and uv[6:8].tolist() == [[0, 1], [0.5, 0]]
    with pytest.raises(InputError, match=r"a\.obj: a texture cannot be shown \(No such file"):
        commands.image({"material": "2"})
    assert session.save("mesh", "plain.ply")[1] == ("texture coordinates", "materials")  # that PLY loses


def test_the_texture_is_drawn_and_groups_stand_out_of_it(browser):
    V = BODY.V[:, [1, 2, 0]]
    high = np.clip((V - V.min(axis=0)) / np.ptp(V, axis=0), 0.05, 0.95)
    textured("body.glb", V, BODY.F, high[:, :2])
    session = edited("body.glb")
    with lent(session) as server, opened(browser, server.address, width=900, height=640) as page:
        page.wait_for_selector("#stage[data-skin=shown]")
        page.wait_for_timeout(400)
        stage = page.locator("#stage")
        shown = pixels(stage)
        assert min(portion(shown, channel) for channel in range(3)) > 0.015
        half = shown.shape[0] // 2
        assert portion(shown[:half], 2) < portion(shown[half:], 2)  # blue is below
        session.select(np.flatnonzero(high[:, 1] > 0.6), "replace")
        session.mark("fixed")
        page.wait_for_timeout(100)
        page.reload()
        page.wait_for_selector("#stage[data-skin=shown]")
        page.wait_for_timeout(400)
        marked = pixels(stage)
        assert changed(shown, marked) > 0.03
        assert portion(marked[:half], 0) < 0.2 * portion(shown[:half], 0)  # red is covered
        page.get_by_text("Options, method fast").click()
        page.get_by_label("colours and textures").uncheck()
        page.wait_for_timeout(300)
        assert portion(pixels(stage), 1) < 0.002


BALL = icosphere(1)
COLOURS = np.random.default_rng(0).integers(0, 256, (BALL.n, 3))


def as_ply(kind: str, names: str, colours: np.ndarray, V=BALL.V, F=BALL.F) -> bytes:
    return mesh_ply(V, F, "", vertex=columns(kind, names, colours))


def as_obj(colours: np.ndarray) -> bytes:
    return obj(np.c_[BALL.V, colours], BALL.F)


FILES = {
    "bytes.ply": as_ply("uchar", "red green blue", COLOURS),
    "words.ply": as_ply("ushort", "diffuse_red diffuse_green diffuse_blue", 257 * COLOURS),
    "floats.ply": as_ply("float", "red green blue", COLOURS / 255),
    "bytes.obj": as_obj(COLOURS),
}


@pytest.mark.parametrize("name", FILES)
def test_colours_of_vertices_are_read(name):
    Path(name).write_bytes(FILES[name])
    document = Document(Path(name))
    assert document.is_coloured and np.array_equal(document.colours, COLOURS)
    assert np.abs(colours_of(Path(name)) - COLOURS / 255).max() < 1e-6


def test_of_vertices_along_a_seam_the_first_gives_the_colour():
    V, F = np.r_[BALL.V[:1], BALL.V], BALL.F + 1
    F[0][F[0] == 1] = 0
    Path("seam.ply").write_bytes(as_ply("uchar", "red green blue", np.r_[[[1, 2, 3]], COLOURS], V, F))
    document = Document(Path("seam.ply"))
    assert document.mesh.n == BALL.n and document.colours[0].tolist() == [1, 2, 3]
    assert np.array_equal(document.colours[1:], COLOURS[1:])


def test_files_without_colours_for_all_vertices_have_none():
    write_mesh("plain.ply", BALL.V, BALL.F)
    (third,) = rows("", COLOURS[3:4].astype(float))
    Path("some.obj").write_bytes(as_obj(COLOURS).replace(third.encode(), b"", 1))
    for name in "plain.ply", "some.obj":
        document = Document(Path(name))
        assert document.colours is None and not document.is_coloured


def test_colours_of_a_gltf_are_linear():
    colours = np.random.default_rng(0).integers(0, 256, (BALL.n, 4), dtype=np.uint8)
    trimesh.Trimesh(BALL.V, BALL.F, vertex_colors=colours, process=False).export("body.glb")
    found = colours_of(Path("body.glb"))
    back = np.where(found <= 0.04045, found / 12.92, ((found + 0.055) / 1.055) ** 2.4)
    assert np.abs(back - colours[:, :3] / 255).max() < 1e-6
