"""The command ``sshade``, and what all commands of the project share."""
