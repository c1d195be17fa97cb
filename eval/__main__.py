"""``python -m eval``: the command ``sshade-eval`` in a clone that is not installed."""

import sys

if __name__ == "__main__":
    from eval.main import main

    sys.exit(main())
