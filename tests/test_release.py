"""Checks of the files of a release refuse files that must not be published."""

from zipfile import ZipFile

import pytest

from tests.sshade.blender.wheels import small_wheel
from tools import release


def write_zip(path, files):
    with ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def test_links_that_lead_nowhere_are_named(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "a b.png").write_bytes(b"")
    (tmp_path / "404.html").write_text("<a href=/nothing>")
    (tmp_path / "sub" / "index.html").write_text("<img src='../a%20b.png'><a href='../index.html?x=1#part'>")
    links = ["sub", "https://a.b/c", "mailto:a@b", "#here", "gone.html", "sub/lost.js"]
    (tmp_path / "index.html").write_text("".join(f"<a href='{link}'>" for link in links))
    assert release.broken_links(tmp_path) == ["index.html: gone.html", "index.html: sub/lost.js"]


def test_versions_must_agree(tmp_path):
    files = {
        "pyproject.toml": '[project]\nversion = "1.0"\n',
        "CITATION.cff": "cff-version: 1.2.0\nversion: 1.0\n",
    }
    for name, text in (files | {"CHANGELOG.md": "# Changes\n\n## 1.0, not released\n"}).items():
        (tmp_path / name).write_text(text)
    assert release.version_of(tmp_path) == "1.0"
    (tmp_path / "CHANGELOG.md").write_text("# Changes\n\n## 0.9\n\n## 1.0\n")
    with pytest.raises(release.Failed, match=r"CHANGELOG.md has the version 0.9, and pyproject.toml has 1.0"):
        release.version_of(tmp_path)
    assert release.version_of(release.ROOT)


def test_an_extension_without_a_wheel_or_of_another_version_is_refused(tmp_path):
    content = small_wheel(tmp_path).read_bytes()
    ours = "wheels/sshade-1.0-py3-none-any.whl"
    whole = {
        "blender_manifest.toml": f'version = "1.0"\nwheels = ["./{ours}"]\n',
        "__init__.py": "",
        ours: content,
    }
    release.check_extension(write_zip(tmp_path / "a.zip", whole), "1.0")
    with pytest.raises(release.Failed, match="a.zip is not of version 1.1"):
        release.check_extension(tmp_path / "a.zip", "1.1")
    without = {name: text for name, text in whole.items() if name != ours}
    with pytest.raises(release.Failed, match="does not have the wheels that its manifest names"):
        release.check_extension(write_zip(tmp_path / "b.zip", without), "1.0")
    with pytest.raises(release.Failed, match=r"wheels/.* in c.zip is damaged"):
        release.check_extension(write_zip(tmp_path / "c.zip", whole | {ours: content[:-30]}), "1.0")


def test_a_wheel_without_kernels_or_with_tests_is_refused(tmp_path):
    names = ["sshade/compiled/a-1", "eval/conf/config.yaml", "sshade-1.0.dist-info/licenses/LICENSE"]
    release.check_wheel(write_zip(tmp_path / "a.whl", dict.fromkeys(names, "")))
    with pytest.raises(release.Failed, match="b.whl has no sshade/compiled/"):
        release.check_wheel(write_zip(tmp_path / "b.whl", dict.fromkeys(names[1:], "")))
    with pytest.raises(release.Failed, match=r"c.whl has tests/a.py, which belongs to no package"):
        release.check_wheel(write_zip(tmp_path / "c.whl", dict.fromkeys([*names, "tests/a.py"], "")))


def test_a_failure_is_one_sentence_and_leaves_no_sums(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(release, "DIST", tmp_path / "dist")
    monkeypatch.setattr("sys.argv", ["release", "--site", str(tmp_path), "--data", str(tmp_path)])
    assert release.main() == 1
    assert capsys.readouterr().err == f"error: {tmp_path} has no index.html; `make docs` writes it\n"
    assert list((tmp_path / "dist").iterdir()) == []
