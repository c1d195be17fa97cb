"""``python -m eval``."""

import sys

if __name__ == "__main__":
    try:
        from eval.configure.app import main
    except KeyboardInterrupt:  # while the libraries are read
        print("interrupted", file=sys.stderr)  # noqa: T201
        sys.exit(130)
    sys.exit(main())
