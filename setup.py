"""The one build step that pyproject.toml cannot say: a wheel holds the folder ``conf`` as ``eval/conf``."""

from pathlib import Path
from shutil import copytree

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithConfiguration(build_py):
    def run(self) -> None:
        super().run()
        if not self.editable_mode:  # such an installation reads the folder of the clone
            copytree("conf", Path(self.build_lib, "eval", "conf"), dirs_exist_ok=True)


setup(cmdclass={"build_py": BuildWithConfiguration})
