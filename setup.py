"""The build steps that pyproject.toml cannot say.

A wheel holds the folder ``conf/defaust`` as ``defaust/conf``, the rest of ``conf`` as ``eval/conf``, and
compiled kernels in ``sshade/compiled``. Because of the kernels, it is for one Python and one platform.
"""

import subprocess
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py


class BuildWhole(build_py):
    def run(self) -> None:
        super().run()
        if self.editable_mode:  # such an installation reads the folders of the clone
            return
        build = Path(self.build_lib).resolve()
        of_others = ignore_patterns("defaust")
        copytree("conf", build / "eval" / "conf", ignore=of_others, dirs_exist_ok=True)
        copytree("conf/defaust", build / "defaust" / "conf", dirs_exist_ok=True)
        kernels = build / "sshade" / "compiled"
        if Path("sshade/compiled").is_dir():  # the command compiles those that are missing
            copytree("sshade/compiled", kernels, dirs_exist_ok=True)
        command = [sys.executable, "-m", "tools.compile_kernels", "--wheel", "--into", kernels]
        subprocess.run(command, check=True)


class PlatformDistribution(Distribution):
    def has_ext_modules(self) -> bool:
        return True


setup(cmdclass={"build_py": BuildWhole}, distclass=PlatformDistribution)
