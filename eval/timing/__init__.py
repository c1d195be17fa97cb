"""``sshade-eval bench``: speed, measured against peers that run beside it in the same process."""
