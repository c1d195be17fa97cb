"""Everything that may go wrong, tried at full strength: ``make robustness``."""
