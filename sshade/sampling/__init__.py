"""From M to N: farthest point sampling, Voronoi cells, the closed-ball test, the dual triangulation."""
