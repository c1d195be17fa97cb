import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from sshade.errors import InputError
from sshade.io.files import replacing


def test_the_file_appears_whole_on_success_under_its_name_alone(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old and longer")
    with replacing(path) as temporary:
        assert temporary.parent == tmp_path and temporary.suffix == ".txt" and temporary != path
        temporary.write_text("new")
        assert path.read_text() == "old and longer"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


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
    assert (tmp_path / "file").read_text() == "old"


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
