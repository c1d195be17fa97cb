"""Tests of every entry point with bad and hard input."""
