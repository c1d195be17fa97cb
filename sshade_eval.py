"""The command ``sshade-eval``, in a module with a name of its own.

Users have packages called ``eval``. On PYTHONPATH, such a package comes before ours.
"""

import sys
from pathlib import Path


def main() -> int:
    """Run the command; return the exit code."""
    sys.path.insert(1, str(Path(__file__).parent))  # behind the folder of the script, before PYTHONPATH
    from eval.main import main as evaluate

    return evaluate()
