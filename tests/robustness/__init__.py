"""What every entry point does with bad and hard input."""
