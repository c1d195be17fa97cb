"""Studies of the method: a command each."""
