"""Self-intersections and inverted faces: found, and resolved."""
