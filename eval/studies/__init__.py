"""Single questions about the method, each answered by a command."""
