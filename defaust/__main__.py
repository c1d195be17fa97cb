"""``python -m defaust``."""

import sys

from defaust.cli import main

if __name__ == "__main__":
    sys.exit(main())
