"""``python -m sshade``."""

import sys

from sshade.cli import main

sys.exit(main())
