"""Configuration of `defaust build`."""
