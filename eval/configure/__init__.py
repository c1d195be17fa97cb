"""From the command line to a task and a method: Hydra, cases, functions named in a configuration."""
