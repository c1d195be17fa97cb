"""The command ``sshade``, and helpers for all commands of the project."""
