"""DeFAUST: a benchmark for the deformation of large meshes by handles."""
