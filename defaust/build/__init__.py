"""From a source to a DeFAUST folder."""
