"""From N' to M': projection onto the proxy, local frames, and the binding of M to N."""
