"""Files of a release that name its version agree."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_versions_agree():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    for name, pattern in {"CITATION.cff": r"^version: (\S+)$", "CHANGELOG.md": r"^## ([^,\s]+)"}.items():
        assert re.search(pattern, (ROOT / name).read_text("utf-8"), re.MULTILINE)[1] == version, name
