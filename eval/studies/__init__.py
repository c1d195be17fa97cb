"""Studies of the method; each module is a command."""
