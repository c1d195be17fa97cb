"""Format of a DeFAUST folder: names of its files, its record, its dataset card."""
