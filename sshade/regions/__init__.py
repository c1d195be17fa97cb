"""Handles on proxies: regions of handle vertices, their edges and volume, and the handles of a proxy."""
