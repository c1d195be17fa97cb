"""Pictures of shapes and ``sshade show``: places and colours of the drawn objects."""

import json
import re
from unittest.mock import Mock

import numpy as np
import pytest
from matplotlib import pyplot

from sshade import Handles
from sshade.cli.main import main
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from sshade.plotting import pictures
from sshade.plotting.pictures import View, new_plotter, panel
from tests.robustness.case import assert_refused
from tests.robustness.inputs import BODY
from tests.shapes import end_handles


def coloured(pixels: np.ndarray, *, red=(0, 255), green=(0, 255), blue=(0, 255)) -> np.ndarray:
    """Return a mask (h, w) of the pixels whose channels lie in the ranges."""
    low, high = np.array([red, green, blue]).T
    return ((pixels >= low) & (pixels <= high)).all(axis=2)


BLUE = {"red": (0, 90), "green": (60, 140), "blue": (120, 255)}
YELLOW = {"red": (170, 255), "green": (130, 220), "blue": (0, 60)}


def test_a_picture_fills_the_view_with_the_shape_and_its_handles(body):
    low, high = np.argsort(body.V[:, 2])[[0, -1]]
    handles = Handles(np.array([low, high]), body.V[[low, high]], dynamic=np.array([False, True]))
    view = View.of([body.V], towards=[1.0, 0, 0], up=[0, 0, 1.0])
    plotter = new_plotter(window_size=view.pixels(200))
    panel(plotter, body, body.V, view, handles=handles)
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    assert pixels.shape == (round(200 * view.size[1] / view.size[0]), 200, 3)
    rows, columns = np.nonzero((pixels < 250).any(axis=2))
    height, width = pixels.shape[:2]
    margin = 0.03 / 1.06  # on each side
    assert rows.min() == pytest.approx(margin * height, abs=0.02 * height)
    assert rows.max() == pytest.approx((1 - margin) * height, abs=0.02 * height)
    assert columns.min() == pytest.approx(margin * width, abs=0.02 * height)
    # The lowest vertex is static, the highest moves.
    assert np.nonzero(coloured(pixels, **BLUE))[0].min() > 0.9 * height
    assert np.nonzero(coloured(pixels, **YELLOW))[0].max() < 0.1 * height


def test_show_writes_a_picture_with_targets_and_errors(sound, capsys):
    write_mesh("posed.ply", BODY.V * [1, 1, 1.5], BODY.F)
    write_handles("pose.json", end_handles(BODY.V, count=2, shift=[0, 0, 2.0]))
    line = "show body.ply pose.json posed.ply -o both.PNG --up z"
    pictures = []
    for colour in ("", " --colour stretch"):
        assert main((line + colour).split()) == 0 and "both.PNG" in capsys.readouterr().err
        pixels = (255 * pyplot.imread("both.PNG")[..., :3]).astype(int)
        pictures.append((pixels[:, : pixels.shape[1] // 2], pixels[:, pixels.shape[1] // 2 :]))
    for half in (half for picture in pictures for half in picture):
        assert coloured(half, **BLUE).any() and coloured(half, **YELLOW).any()
    # Only the result is coloured, on request.
    bright = [[(np.ptp(half, axis=2) > 100).sum() for half in picture] for picture in pictures]
    assert bright[1][1] > 10 * max(*bright[0], bright[1][0])


def test_show_opens_a_page_in_the_browser(sound, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    opened, pages = [], set()
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or len(opened) == 1)
    write_mesh("posed.ply", BODY.V * [1, 1, 1.5], BODY.F)
    write_handles("pose.json", end_handles(BODY.V, count=2, shift=[0, 0, 2.0]))
    for line, label in (("", ""), (" --colour distance", "distance from the first shape")):
        assert main(f"show body.ply pose.json posed.ply{line}".split()) == 0
        (page,) = {*tmp_path.glob("sshade_body_*.html")} - pages
        pages.add(page)
        assert opened[-1] == page.as_uri()
        cases = re.search('id="turn-cases" type="application/json">(.*?)</script>', page.read_text())[1]
        (case,) = json.loads(cases)["cases"]
        assert [shape["name"] for shape in case["shapes"]] == ["rest", "posed"]
        assert [shape["error"] for shape in case["shapes"]] == [False, bool(label)]
        assert case["span"][2] > 1.4 * np.ptp(BODY.V[:, 2]) / BODY.diagonal
        assert label in case["label"] and len(case["handles"]) == 4
    said = capsys.readouterr().err
    assert all(said.count(str(page)) == 1 for page in pages) and said.count("no browser was found") == 1


def test_with_nothing_to_draw_with_the_libraries_are_told(sound, monkeypatch):
    class Last:
        def GetClassName(self):
            return "vtkOSOpenGLRenderWindow"

    monkeypatch.setattr("vtkmodules.vtkRenderingCore.vtkRenderWindow", Last)
    monkeypatch.setattr("ctypes.CDLL", Mock(side_effect=OSError))
    pictures._require_renderer.cache_clear()
    assert_refused("sshade", ["show", "body.ply", "-o", "a.png"], "apt install libegl1 libgl1-mesa-dri")
