"""The command ``sshade-eval``, in a module with a name of its own.

Users have packages called ``eval``. On PYTHONPATH, such a package comes before ours.
"""

import sys
from pathlib import Path


def main() -> int:
    """Run the command; return the exit code."""
    # Before PYTHONPATH, and behind the folder of the script, which -P leaves out.
    sys.path.insert(0 if sys.flags.safe_path else 1, str(Path(__file__).parent))
    from eval.main import main as evaluate

    return evaluate()
