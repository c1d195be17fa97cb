"""The leaderboard: static pages made from published rows, and what others hand in for them."""
