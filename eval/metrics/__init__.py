"""What is measured of a deformed mesh."""
