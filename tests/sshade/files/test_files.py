"""An output appears whole under its name, or not at all, whatever its name is and whoever else writes."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from sshade import InputError
from sshade.core.whole_files import check_output, replacing


def write(path: Path, text: str = "new") -> None:
    with replacing(path) as temporary:
        temporary.write_text(text)


@pytest.mark.parametrize("name", ["a.txt", 246 * "a" + ".ply", 82 * "変" + ".ply"], ids=len)
def test_the_file_appears_whole_on_success_under_its_name_alone(here, name):
    path = Path(name)
    path.write_text("old and longer")
    with replacing(path) as temporary:
        assert temporary.parent == path.resolve().parent and temporary != path
        assert temporary.suffix == path.suffix
        temporary.write_text("new")
        assert path.read_text() == "old and longer"
    assert path.read_text() == "new" and os.listdir() == [name]


def test_threads_that_write_one_path_do_not_disturb_each_other(here):
    path, both_opened = Path("a.txt"), Barrier(2, timeout=60)

    def write_together(text: str) -> None:
        with replacing(path) as temporary:
            temporary.write_text(text)
            both_opened.wait()
            assert temporary.read_text() == text

    texts = ["first", "second and longer"]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(write_together, texts))
    assert path.read_text() in texts and os.listdir() == ["a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_on_an_error_or_interrupt_the_old_file_stays_and_nothing_else(here, error):
    Path("a.txt").write_text("old")
    with pytest.raises(error), replacing("a.txt") as temporary:
        temporary.write_text("half")
        raise error
    assert Path("a.txt").read_text() == "old" and os.listdir() == ["a.txt"]


def test_a_link_stays_and_its_target_is_replaced_in_its_own_folder(here):
    Path("far").mkdir()
    Path("far/data.bin").write_text("old")
    for link, target in {"a.txt": "far/data.bin", "b.txt": "a.txt", "c.txt": "far/later.bin"}.items():
        Path(link).symlink_to(target)
    for link, target in {"b.txt": "far/data.bin", "c.txt": "far/later.bin"}.items():
        check_output(Path(link), (".txt",))
        with replacing(link) as temporary:
            assert temporary.resolve().parent == Path("far").resolve() and temporary.suffix == ".txt"
            temporary.write_text(link)
        assert Path(target).read_text() == link
    assert all(Path(link).is_symlink() for link in ("a.txt", "b.txt", "c.txt"))
    assert sorted(os.listdir("far")) == ["data.bin", "later.bin"]


def test_modes_stay_and_new_files_follow_the_umask(here):
    before = os.umask(0o027)
    try:
        write(Path("new.txt"))
        for mode in (0o600, 0o444, 0o755):
            path = Path(f"{mode:o}.txt")
            path.write_text("old")
            path.chmod(mode)
            with replacing(path) as temporary:
                assert temporary.stat().st_mode & 0o077 == 0  # nobody else may read it meanwhile
                temporary.write_text("new")
            assert path.stat().st_mode & 0o777 == mode and path.read_text() == "new"
    finally:
        os.umask(before)
    assert Path("new.txt").stat().st_mode & 0o777 == 0o640


def test_an_output_that_is_an_input_is_refused_under_every_name(here):
    path = Path("a.txt")
    path.write_text("old")
    Path("soft.txt").symlink_to(path)
    Path("hard.txt").hardlink_to(path)
    for name in (path, path.absolute(), Path("soft.txt"), Path("hard.txt")):
        with pytest.raises(InputError, match="is the input .*a.txt; .* --overwrite"):
            check_output(name, (".txt",), inputs=(None, Path("gone.txt"), path))
        check_output(name, (".txt",), inputs=(path,), overwrite=True)
    check_output(Path("b.txt"), (".txt",), inputs=(path,))


def test_what_a_killed_process_left_is_removed_and_that_of_a_living_one_is_not(here):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    with replacing("a.txt") as temporary:
        temporary.write_text("new")
    name, mine = temporary.name, str(os.getpid())
    living, of_another = name.replace(mine, str(os.getppid())), name.replace("a.", "b.")
    of_another = of_another.replace(mine, str(dead.pid))
    for left in (name.replace(mine, str(dead.pid)), living, of_another):
        Path(left).write_text("half")
    write(Path("a.txt"), "newer")
    assert set(os.listdir()) == {"a.txt", living, of_another} and Path("a.txt").read_text() == "newer"
