"""What all packages share and what knows no geometry: errors, progress, threads, kernels, the console."""
