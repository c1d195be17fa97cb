import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from sshade.core.atomic import check_output, read_npz, replacing
from sshade.core.errors import InputError


def test_the_file_appears_whole_on_success_under_its_name_alone(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old and longer")
    with replacing(path) as temporary:
        assert temporary.parent == tmp_path and temporary.suffix == ".txt" and temporary != path
        temporary.write_text("new")
        assert path.read_text() == "old and longer"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", [246 * "a" + ".ply", 82 * "変" + ".ply"])
def test_names_of_any_length_are_written(tmp_path, name):
    with replacing(tmp_path / name) as temporary:
        temporary.write_text("new")
    assert (tmp_path / name).read_text() == "new"


def test_threads_that_write_one_path_do_not_disturb_each_other(tmp_path):
    path, both_opened = tmp_path / "a.txt", Barrier(2, timeout=60)

    def write(text: str) -> None:
        with replacing(path) as temporary:
            temporary.write_text(text)
            both_opened.wait()
            assert temporary.read_text() == text

    texts = ["first", "second and longer"]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(write, texts))
    assert path.read_text() in texts
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_on_an_error_or_interrupt_the_old_file_stays_and_nothing_else(tmp_path, error):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(error), replacing(path) as temporary:
        temporary.write_text("half")
        raise error
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_place_that_cannot_be_written_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("old")
    for path in (tmp_path / "nowhere" / "a.txt", tmp_path / "file" / "a.txt", Path("/dev/null/a.txt")):
        with pytest.raises(InputError, match=r"a\.txt: cannot be written \("), replacing(path) as temporary:
            temporary.write_text("new")
    with pytest.raises(InputError, match=r"file.a\.txt: the folder .* does not exist"):
        check_output(tmp_path / "file" / "a.txt", (".txt",))
    assert (tmp_path / "file").read_text() == "old"


def write(path: Path, text: str = "new") -> None:
    with replacing(path) as temporary:
        temporary.write_text(text)


def test_a_link_stays_and_its_target_is_replaced_in_its_own_folder(tmp_path):
    folder = tmp_path / "far"
    folder.mkdir()
    (folder / "data.bin").write_text("old")
    link, second = tmp_path / "a.txt", tmp_path / "b.txt"
    link.symlink_to("far/data.bin")
    second.symlink_to("a.txt")
    check_output(second, (".txt",))
    with replacing(second) as temporary:
        assert temporary.resolve().parent == folder.resolve() and temporary.suffix == ".txt"
        temporary.write_text("new")
    assert link.is_symlink() and second.is_symlink() and (folder / "data.bin").read_text() == "new"
    dangling = tmp_path / "c.txt"
    dangling.symlink_to("far/later.bin")
    write(dangling, "made")
    assert dangling.is_symlink() and (folder / "later.bin").read_text() == "made"
    assert sorted(p.name for p in folder.iterdir()) == ["data.bin", "later.bin"]


def test_links_that_lead_nowhere_are_refused_before_any_work(tmp_path):
    loop, lost = tmp_path / "loop.txt", tmp_path / "lost.txt"
    loop.symlink_to("loop.txt")
    lost.symlink_to("gone/a.txt")
    for path, words in ((loop, "symbolic links"), (lost, "gone does not exist")):
        with pytest.raises(InputError, match=words):
            check_output(path, (".txt",))
        with pytest.raises(InputError, match="cannot be written"):
            write(path)
        assert path.is_symlink()


def test_modes_stay_and_new_files_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write(tmp_path / "new.txt")
        for mode in (0o600, 0o640, 0o444, 0o755):
            path = tmp_path / f"{mode:o}.txt"
            path.write_text("old")
            path.chmod(mode)
            with replacing(path) as temporary:
                assert temporary.stat().st_mode & 0o077 == 0  # nobody else may read it meanwhile
                temporary.write_text("new")
            assert path.stat().st_mode & 0o777 == mode and path.read_text() == "new"
    finally:
        os.umask(before)
    assert (tmp_path / "new.txt").stat().st_mode & 0o777 == 0o640


def test_pipes_and_devices_are_never_replaced(tmp_path):
    pipe, device = tmp_path / "a.txt", tmp_path / "null.txt"
    os.mkfifo(pipe)
    device.symlink_to("/dev/null")
    for path in (pipe, device, Path("/dev/null")):
        with pytest.raises(InputError, match="is a device or a pipe"):
            check_output(path, (path.suffix,))
        with pytest.raises(InputError, match="is a device or a pipe"):
            write(path)
    assert pipe.is_fifo() and Path("/dev/null").is_char_device()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "null.txt"]


def test_an_output_that_is_an_input_is_refused_under_every_name(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    (tmp_path / "soft.txt").symlink_to(path)
    (tmp_path / "hard.txt").hardlink_to(path)
    for name in (path, tmp_path / "." / "a.txt", tmp_path / "soft.txt", tmp_path / "hard.txt"):
        with pytest.raises(InputError, match="is the input .*a.txt; .* --overwrite"):
            check_output(name, (".txt",), inputs=(None, tmp_path / "gone.txt", path))
        check_output(name, (".txt",), inputs=(path,), overwrite=True)
    check_output(tmp_path / "b.txt", (".txt",), inputs=(path,))


def test_what_a_killed_process_left_is_removed_and_that_of_a_living_one_is_not(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    path = tmp_path / "a.txt"
    with replacing(path) as temporary:
        temporary.write_text("new")
        name = temporary.name
    mine = str(os.getpid())
    for pid in (dead.pid, os.getppid()):
        (tmp_path / name.replace(mine, str(pid))).write_text("half")
    (tmp_path / name.replace("a.", "b.").replace(mine, str(dead.pid))).write_text("of another file")
    (tmp_path / name.replace(mine, "x")).write_text("no process")
    with replacing(path) as temporary:
        temporary.write_text("newer")
    left = {name.replace(mine, str(os.getppid())), name.replace(mine, "x"), "a.txt"}
    left.add(name.replace("a.", "b.").replace(mine, str(dead.pid)))
    assert {p.name for p in tmp_path.iterdir()} == left and path.read_text() == "newer"


def test_a_file_that_is_no_npz_is_refused_without_advice_to_load_a_pickle(tmp_path):
    with pytest.raises(InputError, match=r"gone\.npz: no such file$"):
        read_npz(tmp_path / "gone.npz", what="a map")
    for content in (b"", b"random bytes", b"PK\x03\x04"):
        (tmp_path / "map.npz").write_bytes(content)
        words = r"map\.npz: not a map \(it is no \.npz file, or ends too early\)$"
        with pytest.raises(InputError, match=words):
            read_npz(tmp_path / "map.npz", what="a map")
