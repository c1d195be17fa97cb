"""The leaderboard: static pages from published rows, and submissions of others."""
