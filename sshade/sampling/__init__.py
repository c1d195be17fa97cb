"""From M to N: fronts, farthest point sampling, the closed-ball test, the dual triangulation."""
