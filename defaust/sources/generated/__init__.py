"""Shapes generated from formulas at any resolution."""
