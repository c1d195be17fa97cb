"""The method `interpolate`: a smooth map of space through dense handles, without a proxy and a solver."""
