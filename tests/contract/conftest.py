"""The small tasks of tests/eval serve the contract tests too."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "eval"))
