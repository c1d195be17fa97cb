"""Times: ``sshade-eval bench`` measures them on a quiet machine, ``sshade-eval timings`` tables them."""
