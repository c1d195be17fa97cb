"""The tests; a package, so that `tests/sshade` never stands in for `sshade` on the import path."""
