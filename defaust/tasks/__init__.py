"""From a DeFAUST folder to deformation and transfer tasks."""
