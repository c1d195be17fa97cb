"""Read the command line with Hydra: methods, datasets, cases and sweeps."""
