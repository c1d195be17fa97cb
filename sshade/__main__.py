"""``python -m sshade``."""

import sys

from sshade.cli.main import main

sys.exit(main())
