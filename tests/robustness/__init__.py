"""What every entry point does with bad and hard input. ``python -m tests.robustness`` prints a table."""
