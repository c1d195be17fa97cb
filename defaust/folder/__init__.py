"""The files of a DeFAUST folder: names, records, checks, the dataset card."""
